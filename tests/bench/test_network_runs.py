"""Runs of a network on a simulated rig: emitters in turn, several motions, what a kill leaves, what is refused."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from solen.bench import record as recording
from solen.bench.journal import read_journal
from solen.bench.netcdf import RecordedRun
from solen.bench.protocol import load_protocol
from solen.bench.record import RecordOptions, record, recover
from solen.bench.rig import load_rig
from solen.errors import BenchError, SolenError
from solen.readout import volts
from solen.recording import read_parts
from tests.bench.network_support import EMITTERS, PLAN, RECEIVERS, RIG, light, network_of, without_tracing, write

DAQ = RIG.replace("[board]\nrate_hz = 100.0", '[daq]\nswitching = "counter"\nrate_hz = 8000.0\nswitch_hz = 100.0')
DAQ = DAQ.replace("b = 3", "b = 2")  # counters light two emitters


def run(folder: Path, **more: object) -> RecordedRun:
    return record(folder / "plan.toml", folder / "rig.toml", folder / "out", RecordOptions(**more))


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    without_tracing(monkeypatch)
    return write(tmp_path)


@pytest.mark.parametrize("rig", [RIG, DAQ], ids=["board", "daq"])
def test_each_emitter_has_the_light_of_its_state(bench: Path, rig: str) -> None:
    write(bench, rig=rig)
    recorded = run(bench)
    assert recorded.outcome == "done"
    assert set(recorded.sensors) == {"fork.a", "fork.b"}
    circuit = network_of(load_rig(bench / "rig.toml")).circuit
    parts = dict(read_parts(recorded.path))
    for place, emitter in enumerate(EMITTERS):
        part = parts[f"fork.{emitter}"]
        column = {one.name: one.values for one in part.channels}
        for state in ((-10.0, 8.0), (0.0, 0.0), (10.0, -8.0)):
            held = (np.abs(column["lean_deg"] - state[0]) < 1e-9) & (np.abs(column["sway_deg"] - state[1]) < 1e-9)
            assert held.sum() >= 15
            shares = light(*np.array(state))[place]
            expected = (volts(shares, circuit, 0.05) - volts(np.zeros(3), circuit, 0.05)).tolist()
            got = [column[name][held][2:-2].mean() for name in RECEIVERS]
            assert got == pytest.approx(expected, abs=4e-3)  # flicker bends the knee a little


def test_a_grid_goes_through_every_state_one_motion_at_a_time(bench: Path) -> None:
    protocol = load_protocol(bench / "plan.toml")
    states = [tuple(step.targets.values()) for step in protocol.steps]
    assert len(set(states)) == 9
    assert all(sum(a != b for a, b in zip(*pair, strict=True)) == 1 for pair in pairwise(states))
    assert protocol.ranges == {"lean": (-10.0, 10.0), "sway": (-8.0, 8.0)}


def test_scattered_states_fill_the_ranges_evenly(bench: Path) -> None:
    (bench / "plan.toml").write_text(PLAN.replace("[grid]\n", "[grid]\nscatter = 64\n"), encoding="utf-8")
    protocol = load_protocol(bench / "plan.toml")
    states = np.array([list(step.targets.values()) for step in protocol.steps[9:]])
    quarters = np.floor((states - [-10.0, -8.0]) / [5.0, 4.0]).astype(int)
    counts = np.bincount(4 * quarters[:, 0] + quarters[:, 1], minlength=16)
    assert counts.sum() == 64
    assert counts.min() >= 2  # of four on average
    assert protocol.ranges == {"lean": (-10.0, 10.0), "sway": (-8.0, 8.0)}


def test_a_killed_run_loses_no_state_that_was_written(bench: Path) -> None:
    path = run(bench, name="whole").path
    whole = dict(read_parts(path))
    # the journal of the same run, cut in the middle as a kill would
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "close_journal", lambda *_: None)
        run(bench, name="killed")
    journal = bench / "out" / "killed.journal"
    data = journal.read_bytes()
    journal.write_bytes(data[: len(data) * 2 // 3])
    content = read_journal(journal)
    assert content.outcome == "killed"
    kept = recover(journal)
    rows = min(kept.sensors.values())
    assert rows >= content.counts["board"] - 2 > 100
    again = dict(read_parts(kept.path))
    for name, part in whole.items():
        angle = next(one.values for one in part.channels if one.name == "sway_deg")
        found = next(one.values for one in again[name].channels if one.name == "sway_deg")
        assert found[: rows - 100] == pytest.approx(angle[: rows - 100], abs=5e-3)


@pytest.mark.parametrize(
    ("file", "old", "new", "named"),
    [
        ("rig", "{a = 1, b = 3}", "{a = 1, c = 3}", ("'c'", "a, b")),
        ("rig", "end = 2,", "tip = 2,", ("'tip'", "end, side, right")),
        ("rig", "[stages.sway]", "[stages.sway]\n[stages.nod]", ("'nod'", "lean, sway")),
        ("rig", "[stages.sway]", "", ("'sway'", "lean")),
        ("rig", "end = 2, side = 1", "end = 2, side = 2", ("inputs", "2 twice")),
        ("rig", "emitters = {a = 1, b = 3}\n", "", ("emitters", "missing")),
        ("rig", "emitters = {a = 1, b = 3}", "emitters = {a = 1, b = 3}\nright = 5", ("right", "5")),
        ("rig", "[stages.lean]\n[stages.sway]\n", "", ("stages", "fork")),
        ("plan", "sway = [-8.0, 0.0, 8.0]", "sway = []", ("sway",)),
        ("plan", "sway = [-8.0, 0.0, 8.0]", "nod = [0.0]", ("'nod'", "lean, sway")),
        ("plan", PLAN[PLAN.index("[grid]") :], "[[step]]\nto_deg = 1.0\nvelocity_deg_per_s = 1.0\n", ("lean, sway",)),
    ],
)
def test_what_cannot_be_is_refused_by_its_name(
    tmp_path: Path, file: str, old: str, new: str, named: tuple[str, ...]
) -> None:
    text = {"rig": RIG, "plan": PLAN}[file]
    assert old in text
    write(tmp_path, **{file: text.replace(old, new)})
    with pytest.raises(BenchError) as refused:
        run(tmp_path)
    assert all(one in str(refused.value) for one in named), refused.value
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").glob("*.nc"))


def test_a_protocol_of_motions_needs_a_rig_with_them(bench: Path) -> None:
    plain = RIG.replace("[stages.lean]\n[stages.sway]\n", "").replace("emitters = {a = 1, b = 3}", "emitter = 1")
    write(bench, rig=plain.replace("inputs = {end = 2, side = 1, right = 4}", "right = 1\nleft = 2"))
    with pytest.raises(SolenError, match="lean"):
        run(bench)
