"""Runs of a network on a simulated rig: alternating emitters, several motions, a killed run, and refused files."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.bench import record as recording
from solen.bench.journal import read_journal
from solen.bench.netcdf import RecordedRun
from solen.bench.protocol import load_protocol
from solen.bench.record import RecordOptions, record, recover
from solen.bench.rig import load_rig
from solen.errors import BenchError, SolenError
from solen.readout import volts
from solen.recording import Recording, read_parts
from tests.bench.network_support import EMITTERS, PLAN, RECEIVERS, RIG, light, network_of, without_tracing, write

DAQ = RIG.replace("[board]\nrate_hz = 100.0", '[daq]\nswitching = "counter"\nrate_hz = 8000.0\nswitch_hz = 100.0')
DAQ = DAQ.replace("b = 3", "b = 2")  # the device has two counters


def run_in(folder: Path, **options: object) -> RecordedRun:
    return record(folder / "plan.toml", folder / "rig.toml", folder / "out", RecordOptions(**options))


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    without_tracing(monkeypatch)
    return write(tmp_path)


@pytest.mark.parametrize("rig", [RIG, DAQ], ids=["board", "daq"])
def test_readings_of_each_emitter_match_circuit(bench: Path, rig: str) -> None:
    write(bench, rig=rig)
    run = run_in(bench)
    assert run.outcome == "done"
    assert set(run.sensors) == {"fork.a", "fork.b"}
    circuit = network_of(load_rig(bench / "rig.toml")).circuit
    parts = dict(read_parts(run.path))
    for index, emitter in enumerate(EMITTERS):
        columns = {channel.name: channel.values for channel in parts[f"fork.{emitter}"].channels}
        for lean, sway in ((-10.0, 8.0), (0.0, 0.0), (10.0, -8.0)):
            at_state = (np.abs(columns["lean_deg"] - lean) < 1e-9) & (np.abs(columns["sway_deg"] - sway) < 1e-9)
            assert at_state.sum() >= 15
            fractions = light(np.array(lean), np.array(sway))[index]
            expected = (volts(fractions, circuit, 0.05) - volts(np.zeros(3), circuit, 0.05)).tolist()
            means = [columns[name][at_state][2:-2].mean() for name in RECEIVERS]
            assert means == pytest.approx(expected, abs=4e-3)  # the ambient light flickers


def test_grid_visits_all_states_and_moves_one_motion_per_step(bench: Path) -> None:
    protocol = load_protocol(bench / "plan.toml")
    states = [tuple(step.targets.values()) for step in protocol.steps]
    assert len(set(states)) == 9
    assert all(sum(a != b for a, b in zip(*pair, strict=True)) == 1 for pair in pairwise(states))
    assert protocol.ranges == {"lean": (-10.0, 10.0), "sway": (-8.0, 8.0)}


def test_scattered_states_cover_ranges_evenly(bench: Path) -> None:
    (bench / "plan.toml").write_text(PLAN.replace("[grid]\n", "[grid]\nscatter = 64\n"), encoding="utf-8")
    protocol = load_protocol(bench / "plan.toml")
    states = np.array([list(step.targets.values()) for step in protocol.steps[9:]])
    cells = np.floor((states - [-10.0, -8.0]) / [5.0, 4.0]).astype(int)
    counts = np.bincount(4 * cells[:, 0] + cells[:, 1], minlength=16)
    assert counts.sum() == 64
    assert counts.min() >= 2  # the mean is 4
    assert protocol.ranges == {"lean": (-10.0, 10.0), "sway": (-8.0, 8.0)}


def column(part: Recording, name: str) -> FloatArray:
    return next(channel.values for channel in part.channels if channel.name == name)


def test_recovers_written_states_of_killed_run(bench: Path) -> None:
    complete = dict(read_parts(run_in(bench, name="complete").path))
    # a second run, whose journal is truncated as by a kill
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "close_journal", lambda *_: None)
        run_in(bench, name="killed")
    journal = bench / "out" / "killed.journal"
    data = journal.read_bytes()
    journal.write_bytes(data[: len(data) * 2 // 3])
    content = read_journal(journal)
    assert content.outcome == "killed"
    recovered = recover(journal)
    rows = min(recovered.sensors.values())
    assert rows >= content.counts["board"] - 2 > 100
    parts = dict(read_parts(recovered.path))
    for name, part in complete.items():
        sway, expected = (column(of_run, "sway_deg")[: rows - 100] for of_run in (parts[name], part))
        assert sway == pytest.approx(expected, abs=5e-3)


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("rig", "{a = 1, b = 3}", "{a = 1, c = 3}", ("'c'", "a, b")),
        ("rig", "end = 2,", "tip = 2,", ("'tip'", "end, side, right")),
        ("rig", "[stages.sway]", "[stages.sway]\n[stages.nod]", ("'nod'", "lean, sway")),
        ("rig", "[stages.sway]", "", ("'sway'", "lean")),
        ("rig", "end = 2, side = 1", "end = 2, side = 2", ("inputs", "2 occurs twice")),
        ("rig", "emitters = {a = 1, b = 3}\n", "", ("emitters", "missing")),
        ("rig", "emitters = {a = 1, b = 3}", "emitters = {a = 1, b = 3}\nright = 5", ("right", "5")),
        ("rig", "[stages.lean]\n[stages.sway]\n", "", ("stages", "fork")),
        ("plan", "sway = [-8.0, 0.0, 8.0]", "sway = []", ("sway",)),
        ("plan", "sway = [-8.0, 0.0, 8.0]", "nod = [0.0]", ("'nod'", "lean, sway")),
        ("plan", PLAN[PLAN.index("[grid]") :], "[[step]]\nto_deg = 1.0\nvelocity_deg_per_s = 1.0\n", ("lean, sway",)),
    ],
)
def test_names_invalid_key_of_rig_or_protocol(
    tmp_path: Path, file: str, old: str, new: str, words: tuple[str, ...]
) -> None:
    text = {"rig": RIG, "plan": PLAN}[file]
    assert old in text
    write(tmp_path, **{file: text.replace(old, new)})
    with pytest.raises(BenchError) as bad:
        run_in(tmp_path)
    assert all(word in str(bad.value) for word in words), bad.value
    assert "\n" not in str(bad.value)
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").glob("*.nc"))


def test_refuses_protocol_with_motions_of_other_rig(bench: Path) -> None:
    plain = RIG.replace("[stages.lean]\n[stages.sway]\n", "").replace("emitters = {a = 1, b = 3}", "emitter = 1")
    write(bench, rig=plain.replace("inputs = {end = 2, side = 1, right = 4}", "right = 1\nleft = 2"))
    with pytest.raises(SolenError, match="lean"):
        run_in(bench)
