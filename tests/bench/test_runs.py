"""Runs on a simulated rig: what is sampled, what a stop or a kill leaves, what is refused."""

import json
import math
import sqlite3
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5netcdf
import numpy as np
import pytest

from solen.analysis import study
from solen.arrays import FloatArray
from solen.bench import record as recording
from solen.bench.catalogue import list_recordings
from solen.bench.clock import SimulatedClock
from solen.bench.clock_fit import fit_clock
from solen.bench.frames import Layout, Losses, Periods
from solen.bench.journal import read_journal
from solen.bench.netcdf import RecordedRun
from solen.bench.protocol import load_protocol
from solen.bench.record import RecordOptions, record, recover
from solen.bench.rig import load_rig
from solen.bench.run import Instruments, Tick, begin, run
from solen.bench.simulated.sensors import simulated_sensors
from solen.bench.simulated.stage import SimulatedStage
from solen.errors import BenchError, OutputError, SpecError
from solen.pipeline.bench.record import new
from solen.sensor import Sensor
from solen.spec import load, save, with_values


def recorded(folder: Path, out: str = "out", watch: Any = None, **more: Any) -> RecordedRun:
    files = folder / "protocol.toml", folder / "rig.toml"
    return record(*files, folder / out, RecordOptions(**more), watch=watch)


def group(path: Path, name: str) -> dict[str, np.ndarray]:
    with h5netcdf.File(path, "r") as file:
        return {key: variable[...] for key, variable in file.groups[name].variables.items()}


def test_a_run_is_what_the_traced_sensor_would_give(bench: Path) -> None:
    found = recorded(bench)
    assert (found.outcome, found.cycles, found.simulated) == ("done", 3, True)
    assert not list((bench / "out").glob("*.journal"))
    path = bench / "out" / "protocol.nc"
    read = group(path, "A")
    # light as the tracer has it, made volts by the sensor's own circuit, without the room's light
    (one, _) = simulated_sensors(load_rig(bench / "rig.toml"), bench, 3.0, np.random.default_rng([5, 0]))
    traced = Sensor.of(load(bench / "sensor.toml")).integrate(-3.0)
    assert one.at(np.array([-3.0]))[0] == pytest.approx(
        [traced.detectors["right"].power, traced.detectors["left"].power], abs=2e-3
    )
    held = np.abs(read["angle_deg"] + 3.0) < 1e-6
    circuit, lit = one.circuit, one.at(np.array([-3.0]))
    from solen.readout import volts

    expected = volts(lit, circuit, 0.05) - volts(np.zeros((1, 2)), circuit, 0.05)
    got = np.array([read["right"][held].mean(), read["left"][held].mean()])
    assert got == pytest.approx(expected[0], abs=0.02)  # the room's light drifts, and bends the knee a little
    right, left = read["right"][held].mean(), read["left"][held].mean()
    assert right < -1.0 < left  # brighter is lower: -3 degrees brighten the right receiver


def test_the_control_hardly_answers_and_wires_are_kept_apart(bench: Path) -> None:
    recorded(bench)
    read = group(bench / "out" / "protocol.nc", "B")
    ends = [np.abs(read["angle_deg"] - angle) < 0.01 for angle in (-3.0, 3.0)]
    swing = {side: np.ptp([read[side][end].mean() for end in ends]) for side in ("right", "left")}
    lens = group(bench / "out" / "protocol.nc", "A")
    ends = [np.abs(lens["angle_deg"] - angle) < 0.01 for angle in (-3.0, 3.0)]
    assert max(swing.values()) < 0.1 * np.ptp([lens["right"][end].mean() for end in ends])


def test_a_seed_gives_the_same_recording_and_another_another(bench: Path) -> None:
    for folder, name, seed in (("one", "a", None), ("two", "a", None), ("one", "b", None), ("one", "c", 6)):
        recorded(bench, folder, name=name, seed=seed)
    a, again, b, c = (group(bench / path, "A") for path in ("one/a.nc", "two/a.nc", "one/b.nc", "one/c.nc"))
    assert all(np.array_equal(a[key], again[key]) for key in a)
    assert not np.array_equal(a["right"], b["right"])  # another run of the same prints
    assert a["right"] == pytest.approx(b["right"], abs=5e-3)
    assert not np.array_equal(a["right"], c["right"])


def test_everything_that_made_it_is_in_the_file(bench: Path) -> None:
    recorded(bench)
    with h5netcdf.File(bench / "out" / "protocol.nc", "r") as file:
        header, events = json.loads(file.attrs["header"]), json.loads(file.attrs["events"])
        assert file.attrs["simulated"] == "yes"
        assert file.attrs["control"] == "B"
        raw = file.variables["voltage"]
        assert raw.shape == (file.dimensions["period"].size, 2, 2, 4)
        assert raw.attrs["scale_factor"] == pytest.approx(5.0 / 65536)
    assert header["designs"]["sensor.toml"] == (bench / "sensor.toml").read_text(encoding="utf-8")
    assert header["protocol"]["cycles"] == 3
    assert [event["what"] for event in events].count("cycle done") == 3


def test_it_opens_in_xarray(bench: Path) -> None:
    import xarray as xr

    recorded(bench)
    with xr.open_dataset(bench / "out" / "protocol.nc", engine="h5netcdf") as data:
        assert float(data["voltage"].max()) < 5.0
    with xr.open_dataset(bench / "out" / "protocol.nc", engine="h5netcdf", group="A") as data:
        assert data["right"].attrs["units"] == "V"


def stopping(after: int, how: BaseException) -> Any:
    def watch(tick: Tick) -> None:
        if tick.cycle > after:
            raise how

    return watch


@pytest.mark.parametrize(
    ("how", "outcome"), [(KeyboardInterrupt(), "stopped"), (BenchError("stage", limit="is on fire"), "fault")]
)
def test_a_run_that_was_ended_is_taken_up_after_its_last_whole_cycle(
    bench: Path, how: BaseException, outcome: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "READ_SIMULATED_S", 0.1)
    with pytest.raises(type(how)):
        recorded(bench, watch=stopping(1, how))
    left = bench / "out" / "protocol.journal"
    before = read_journal(left)
    assert before.cycles == 1
    assert [event["what"] for event in before.events][-1] == outcome
    found = recorded(bench, resume=True)
    assert (found.outcome, found.cycles) == ("done", 3)
    with h5netcdf.File(bench / "out" / "protocol.nc", "r") as file:
        time, part = file.variables["time_s"][...], file.variables["part"][...]
    assert (np.diff(time) > 0.0).all()
    assert set(part) == {0, 1}


@pytest.mark.parametrize("how", [KeyboardInterrupt(), BenchError("board", limit="is on fire")])
def test_a_stage_that_was_not_stopped_is_said(bench: Path, how: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    def goes_on(stage: SimulatedStage) -> None:
        raise BenchError(stage.name, limit="goes on")

    monkeypatch.setattr(recording, "READ_SIMULATED_S", 0.1)
    monkeypatch.setattr(SimulatedStage, "stop", goes_on)
    with pytest.raises(type(how), match=r"stage not stopped: .*goes on.*--resume") as ended:
        recorded(bench, watch=stopping(1, how))
    assert "stage stopped" not in str(ended.value)
    assert len(str(ended.value).splitlines()) == 1


def test_what_a_stop_leaves_can_be_closed(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "READ_SIMULATED_S", 0.1)
    with pytest.raises(KeyboardInterrupt, match=r"emitters off, stage stopped; .*protocol\.journal: .*--resume"):
        recorded(bench, watch=stopping(2, KeyboardInterrupt()))
    with pytest.raises(BenchError, match=r"protocol\.journal; already exists.*; use solen bench recover"):
        recorded(bench)
    periods = len(read_journal(bench / "out" / "protocol.journal").streams["board"])
    found = recover(bench / "out" / "protocol.journal")
    assert (found.outcome, found.cycles, found.periods) == ("stopped", 2, periods)
    assert "the run ended early: KeyboardInterrupt" in found.warnings
    (row,) = list_recordings(bench / "out").recordings
    assert (row.outcome, row.sensors, row.there) == ("stopped", ("A", "B"), True)


def test_a_changed_protocol_is_not_taken_up(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "READ_SIMULATED_S", 0.1)
    with pytest.raises(KeyboardInterrupt):
        recorded(bench, watch=stopping(1, KeyboardInterrupt()))
    text = (bench / "protocol.toml").read_text(encoding="utf-8")
    (bench / "protocol.toml").write_text(text.replace("hold_s = 0.1", "hold_s = 0.2"), encoding="utf-8")
    with pytest.raises(BenchError, match=r"protocol\.toml; .*; change it back"):
        recorded(bench, resume=True)


class Silent:
    """A board that says nothing."""

    name, layout, period_s, volts_per_count = "silent", Layout(1, 1), 0.005, 1.0
    losses = Losses()

    def __init__(self) -> None:
        self.calls: list[str] = []

    def start(self) -> None:
        self.calls.append("start")

    def read(self) -> Periods:
        return Periods.joined([], self.layout)

    def stop(self) -> None:
        self.calls.append("stop")

    def close(self) -> None:
        self.calls.append("close")


class Stuck(SimulatedStage):
    """A stage that does not move."""

    def on_target(self) -> bool:
        return False


@pytest.mark.parametrize("stage", [SimulatedStage, Stuck])
def test_a_silent_board_and_a_stuck_stage_end_the_run_safely(bench: Path, stage: type[SimulatedStage]) -> None:
    clock, board = SimulatedClock(), Silent()
    on = Instruments(stage(clock), board, clock)
    with (
        begin(bench / "a.journal", on, {}) as journal,
        pytest.raises(BenchError, match=r"sent nothing for 2\.|not arrived"),
    ):
        run(load_protocol(bench / "protocol.toml"), on, journal)
    assert board.calls == ["start", "stop"]
    assert read_journal(bench / "a.journal").events[-1]["what"] == "fault"


def test_a_stage_in_another_unit_than_its_protocol_does_not_move(bench: Path) -> None:
    clock, board = SimulatedClock(), Silent()
    on = Instruments(SimulatedStage(clock, "mm"), board, clock)
    with begin(bench / "a.journal", on, {}) as journal, pytest.raises(BenchError, match=r"in deg, .* in mm"):
        run(load_protocol(bench / "protocol.toml"), on, journal)
    assert board.calls == []


def test_the_board_s_clock_is_laid_on_the_run_s() -> None:
    rng = np.random.default_rng(2)
    board_s: FloatArray = np.asarray(np.arange(1, 3000) * 0.1, dtype=np.float64)
    delay: FloatArray = np.asarray(rng.exponential(0.01, len(board_s)), dtype=np.float64)
    came: FloatArray = np.asarray(7.0 + board_s * (1 - 50e-6) + delay, dtype=np.float64)
    line = fit_clock(board_s, came)
    assert line.rate == pytest.approx(1 - 50e-6, abs=2e-6)
    assert line.at(board_s) == pytest.approx(7.0 + board_s * (1 - 50e-6), abs=1e-3)
    assert fit_clock(board_s[:3], came[:3]).rate == 1.0
    few = slice(None, 180, 3)  # 18 s with few arrivals tell less of the rate than what a quartz is
    assert abs(fit_clock(board_s[few], came[few]).rate - 1.0) < 60e-6


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            ("cycles = 3", "cycles = 0"),
            r"protocol\.toml: cycles = 0; must be greater than or equal to 1|must be at least 1",
        ),
        (("to_deg = 0.0", "to_mm = 0.0"), r"step\[2\]; must state a target and a speed, in one unit"),
        (("velocity_deg_per_s = 15.0", "speed = 15.0"), r"step\[0\]\.speed; unknown key"),
        (
            ("to_deg = 3.0", "to_deg = 300.0"),
            r"the protocol's reach in deg = 300.0; a simulated sensor is traced up to 80 deg",
        ),
    ],
)
def test_bad_protocols_are_reported_in_one_line(bench: Path, change: tuple[str, str], told: str) -> None:
    text = (bench / "protocol.toml").read_text(encoding="utf-8")
    (bench / "protocol.toml").write_text(text.replace(*change, 1), encoding="utf-8")
    with pytest.raises((BenchError, SpecError), match=told) as refusal:
        recorded(bench)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (('name = "B"', 'name = "A"'), "name A is used twice"),
        (('name = "B"', 'name = "aux.1"'), "'aux.1'; is reserved for a device on Windows"),
        (('name = "B"', 'name = "B."'), "or end in a dot"),
        (("right = 4", "right = 1"), "input 1 is used twice"),
        (("[board]", '[stage]\nmodel = "M-1"\n[board]'), "model = 'M-1'; .* known are M-060.DG, M-111.1DG"),
        (("[board]", '[stage]\nmodel = "M-111.1DG"\nlever_mm = 20.0\n[board]'), "moves in deg, and the stage in mm"),
        (("[board]", '[board]\nport = "COM1"'), "port = 'COM1'; is for a real board"),
        (("[board]", '[stage]\ndriver = "gcs2"\n[board]'), "a real stage requires it$"),
        (("trim_v = 1.0", "trim_v = 9.0"), "must be below the supply, 5 V"),
        (('design = "sensor.toml"', 'design = "none.toml"'), "no such file"),
    ],
)
def test_bad_rigs_are_reported_in_one_line(bench: Path, change: tuple[str, str], told: str) -> None:
    text = (bench / "rig.toml").read_text(encoding="utf-8")
    (bench / "rig.toml").write_text(text.replace(*change, 1), encoding="utf-8")
    with pytest.raises((BenchError, SpecError, OutputError), match=told) as refusal:
        recorded(bench)
    assert len(str(refusal.value).splitlines()) == 1
    assert not (bench / "out").exists()


@pytest.mark.parametrize("kind", ["rotation", "bend"])
def test_a_linear_stage_turns_and_bends(bench: Path, kind: str) -> None:
    rig = (bench / "rig.toml").read_text(encoding="utf-8")
    stage = '[stage]\nmodel = "M-111.1DG"\nlever_mm = 40.0\n[board]'
    (bench / "rig.toml").write_text(rig.replace("[board]", stage), encoding="utf-8")
    protocol = (bench / "protocol.toml").read_text(encoding="utf-8")
    protocol = protocol.replace("to_deg", "to_mm").replace("velocity_deg", "velocity_mm").replace("15.0", "8.0")
    (bench / "protocol.toml").write_text(protocol.replace("-3.0", "-2.0").replace("3.0", "2.0"), encoding="utf-8")
    save(bench / "sensor.toml", with_values(load(bench / "sensor.toml"), {"motion.kind": kind}))
    found = recorded(bench)
    told = study([found.path]).to_dict()["sensors"]["A"]["receivers"]
    reach = math.degrees(math.atan(2.0 / 40.0))
    for side, at in (("right", 0), ("left", -1)):
        angles, volts = told[side]["angle_deg"], told[side]["mean_V"]
        assert (angles[0], angles[-1]) == pytest.approx((-reach, reach), abs=0.1)  # a step of the grid
        assert volts[at] < volts[-1 - at] - 1.0  # brighter is lower, and negative angles brighten the right receiver
    assert told["right"]["swing_V"] > 1.0


def test_a_cycle_that_was_cut_short_is_in_the_root_and_in_no_group(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "READ_SIMULATED_S", 0.1)
    for resume, after in ((False, 1), (True, 2)):
        with pytest.raises(KeyboardInterrupt):
            recorded(bench, resume=resume, watch=stopping(after, KeyboardInterrupt()))
    found = recorded(bench, resume=True)
    with h5netcdf.File(found.path, "r") as file:
        cuts = json.loads(file.attrs["cut_short"])
        root, read = file.variables["time_s"][...], file.groups["A"].variables["time_s"][...]
    assert len(cuts) == 2
    for begin_s, end_s in cuts:
        assert ((root > begin_s) & (root < end_s)).any()
        assert not ((read > begin_s + 0.01) & (read < end_s)).any()
    told = study([found.path]).to_dict()
    assert [len(one["runs"][0]["motion"]["cycles"]) for one in told["sensors"].values()] == [3, 3]
    assert not [line for line in told["warnings"] if "incomplete" in line]


def test_a_full_disk_is_reported_before_anything_is_written_to_it(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=200_000))
    with pytest.raises(OutputError, match=r"protocol\.nc; .*0\.2 MB .*; free some space"):
        recorded(bench)
    monkeypatch.undo()
    assert [path.name for path in (bench / "out").iterdir()] == ["protocol.journal"]
    assert recover(bench / "out" / "protocol.journal").outcome == "done"


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"seed": -4}, "seed = -4; must be at least 0"),
        ({"name": "a" * 300}, r"--name = 'a+…'; is 300 bytes long; at most 200"),
        ({"name": "../a"}, "must be the name of a file, without its folder"),
        ({"name": "nul"}, "--name = 'nul'; is reserved for a device on Windows"),
        ({"name": "a."}, "or end in a dot"),
        ({"resume": True}, "no such journal: .*; leave --resume out"),
    ],
)
def test_bad_options_are_reported_in_one_line(bench: Path, more: dict[str, Any], told: str) -> None:
    with pytest.raises((BenchError, SpecError), match=told):
        recorded(bench, **more)
    assert not (bench / "out").exists()


def test_what_is_written_to_start_from_runs(tmp_path: Path) -> None:
    new(tmp_path / "bench")
    for name in ("rotation", "bending"):
        assert load_protocol(tmp_path / "bench" / f"{name}.toml").cycles == 6
    for name, kind in (("rig", "rotation"), ("rig-bending", "bend")):
        rig = load_rig(tmp_path / "bench" / f"{name}.toml")
        assert (rig.inputs, rig.stage.lever_mm) == (8, 40.0 if kind == "bend" else None)
        assert load(tmp_path / "bench" / rig.sensor[0].design).motion.kind == kind
    new(tmp_path / "bench")  # the same again changes nothing
    (tmp_path / "bench" / "rig.toml").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="already exists"):
        new(tmp_path / "bench")
    assert (tmp_path / "bench" / "rig.toml").read_text(encoding="utf-8") == "mine"


def test_a_folder_that_cannot_be_written_to_is_listed(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(bench)
    out, connect = bench / "out", sqlite3.connect

    def read_only(path: Path, **more: Any) -> sqlite3.Connection:
        opened: sqlite3.Connection = connect(f"{path.as_uri()}?mode=ro", uri=True, **more)
        return opened

    (out / "strange.nc").write_bytes(b"no netCDF")
    monkeypatch.setattr("sqlite3.connect", read_only)
    with_catalogue = list_recordings(out)
    looked = list_recordings(out, look=True)
    (out / "recordings.sqlite").unlink()
    without = list_recordings(out)
    assert with_catalogue.recordings == looked.recordings == without.recordings
    assert looked.not_recordings == without.not_recordings == ("strange.nc",)
    assert not (out / "recordings.sqlite").exists()


def test_a_catalogue_takes_in_what_was_put_there_and_tells_what_is_missing(bench: Path) -> None:
    recorded(bench)
    out = bench / "out"
    (out / "protocol.nc").rename(out / "moved.nc")
    (out / "strange.nc").write_bytes(b"no netCDF")
    found = list_recordings(out, look=True)
    assert {row.file: row.there for row in found.recordings} == {"protocol.nc": False, "moved.nc": True}
    assert found.not_recordings == ("strange.nc",)
    assert "strange.nc" in found.warnings[0]
    (out / "recordings.sqlite").write_bytes(b"no database, but long enough to be looked at as one" * 30)
    with pytest.raises(OutputError, match="cannot be used"):
        list_recordings(out)
