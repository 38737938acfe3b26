"""Runs on a simulated rig: recordings, stopped and resumed runs, and refused files."""

import json
import math
import sqlite3
from collections.abc import Callable
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
from solen.bench.run import Instruments, Tick, begin
from solen.bench.run import run as run_protocol
from solen.bench.simulated.sensors import simulated_sensors
from solen.bench.simulated.stage import SimulatedStage
from solen.errors import BenchError, OutputError, SpecError
from solen.pipeline.bench.record import new
from solen.readout import volts
from solen.sensor import Sensor
from solen.spec import load, save, with_values


def run_in(folder: Path, out: str = "out", watch: Any = None, **options: Any) -> RecordedRun:
    files = folder / "protocol.toml", folder / "rig.toml"
    return record(*files, folder / out, RecordOptions(**options), watch=watch)


@pytest.fixture
def short_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples are read every 0.1 s of a simulated run, so that a stop takes effect within its cycle."""
    monkeypatch.setattr(recording, "MIN_SIMULATED_READ_S", 0.1)


def group(path: Path, name: str) -> dict[str, np.ndarray]:
    with h5netcdf.File(path, "r") as file:
        return {key: variable[...] for key, variable in file.groups[name].variables.items()}


def test_readings_match_traced_sensor(bench: Path) -> None:
    run = run_in(bench)
    assert (run.outcome, run.cycles, run.simulated) == ("done", 3, True)
    assert not list((bench / "out").glob("*.journal"))
    (sensor, _) = simulated_sensors(load_rig(bench / "rig.toml"), bench, 3.0, np.random.default_rng([5, 0]))
    fractions = sensor.at(np.array([-3.0]))
    traced = Sensor.of(load(bench / "sensor.toml")).integrate(-3.0)
    assert fractions[0] == pytest.approx([traced.detectors[side].power for side in ("right", "left")], abs=2e-3)
    expected = volts(fractions, sensor.circuit, 0.05) - volts(np.zeros((1, 2)), sensor.circuit, 0.05)
    columns = group(bench / "out" / "protocol.nc", "A")
    at_end = np.abs(columns["angle_deg"] + 3.0) < 1e-6
    right, left = (columns[side][at_end].mean() for side in ("right", "left"))
    assert (right, left) == pytest.approx(expected[0], abs=0.02)  # the ambient light drifts
    assert right < -1.0 < left  # at -3 deg the right receiver gets more light, which lowers its voltage


def swing_V(columns: dict[str, np.ndarray], side: str) -> float:
    return float(np.ptp([columns[side][np.abs(columns["angle_deg"] - end) < 0.01].mean() for end in (-3.0, 3.0)]))


def test_control_has_small_response(bench: Path) -> None:
    path = run_in(bench).path
    control = max(swing_V(group(path, "B"), side) for side in ("right", "left"))
    assert control < 0.1 * swing_V(group(path, "A"), "right")


def test_seed_determines_recording(bench: Path) -> None:
    for folder, name, seed in (("out", "a", None), ("again", "a", None), ("out", "b", None), ("out", "c", 6)):
        run_in(bench, folder, name=name, seed=seed)
    a, again, b, c = (group(bench / path, "A") for path in ("out/a.nc", "again/a.nc", "out/b.nc", "out/c.nc"))
    assert all(np.array_equal(a[key], again[key]) for key in a)
    assert not np.array_equal(a["right"], b["right"])  # another run of the same sensors
    assert a["right"] == pytest.approx(b["right"], abs=5e-3)
    assert not np.array_equal(a["right"], c["right"])


def test_recording_contains_rig_protocol_and_designs(bench: Path) -> None:
    run_in(bench)
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


def test_xarray_opens_recording(bench: Path) -> None:
    import xarray as xr

    run_in(bench)
    with xr.open_dataset(bench / "out" / "protocol.nc", engine="h5netcdf") as data:
        assert float(data["voltage"].max()) < 5.0
    with xr.open_dataset(bench / "out" / "protocol.nc", engine="h5netcdf", group="A") as data:
        assert data["right"].attrs["units"] == "V"


def raise_after(cycles: int, error: BaseException) -> Callable[[Tick], None]:
    def watch(tick: Tick) -> None:
        if tick.cycle > cycles:
            raise error

    return watch


@pytest.mark.usefixtures("short_reads")
@pytest.mark.parametrize(
    ("error", "outcome"), [(KeyboardInterrupt(), "stopped"), (BenchError("stage", limit="overheated"), "fault")]
)
def test_resumes_after_last_complete_cycle(bench: Path, error: BaseException, outcome: str) -> None:
    with pytest.raises(type(error)):
        run_in(bench, watch=raise_after(1, error))
    previous = read_journal(bench / "out" / "protocol.journal")
    assert previous.cycles == 1
    assert previous.events[-1]["what"] == outcome
    run = run_in(bench, resume=True)
    assert (run.outcome, run.cycles) == ("done", 3)
    with h5netcdf.File(bench / "out" / "protocol.nc", "r") as file:
        time_s, part = file.variables["time_s"][...], file.variables["part"][...]
    assert (np.diff(time_s) > 0.0).all()
    assert set(part) == {0, 1}


@pytest.mark.usefixtures("short_reads")
@pytest.mark.parametrize("error", [KeyboardInterrupt(), BenchError("board", limit="overheated")])
def test_reports_stage_that_was_not_stopped(bench: Path, error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(stage: SimulatedStage) -> None:
        raise BenchError(stage.name, limit="does not stop")

    monkeypatch.setattr(SimulatedStage, "stop", fail)
    with pytest.raises(type(error), match=r"stage not stopped: .*does not stop.*--resume") as end:
        run_in(bench, watch=raise_after(1, error))
    assert "stage stopped" not in str(end.value)
    assert len(str(end.value).splitlines()) == 1


@pytest.mark.usefixtures("short_reads")
def test_recovers_stopped_run(bench: Path) -> None:
    with pytest.raises(KeyboardInterrupt, match=r"emitters off, stage stopped; .*protocol\.journal: .*--resume"):
        run_in(bench, watch=raise_after(2, KeyboardInterrupt()))
    with pytest.raises(BenchError, match=r"protocol\.journal; already exists.*; use solen bench recover"):
        run_in(bench)
    periods = len(read_journal(bench / "out" / "protocol.journal").streams["board"])
    run = recover(bench / "out" / "protocol.journal")
    assert (run.outcome, run.cycles, run.periods) == ("stopped", 2, periods)
    assert "the run ended early: KeyboardInterrupt" in run.warnings
    (entry,) = list_recordings(bench / "out").recordings
    assert (entry.outcome, entry.sensors, entry.there) == ("stopped", ("A", "B"), True)


@pytest.mark.usefixtures("short_reads")
def test_refuses_to_resume_with_changed_protocol(bench: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run_in(bench, watch=raise_after(1, KeyboardInterrupt()))
    text = (bench / "protocol.toml").read_text(encoding="utf-8")
    (bench / "protocol.toml").write_text(text.replace("hold_s = 0.1", "hold_s = 0.2"), encoding="utf-8")
    with pytest.raises(BenchError, match=r"protocol\.toml; .*; change it back"):
        run_in(bench, resume=True)


class SilentBoard:
    """A board that sends nothing."""

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


class StuckStage(SimulatedStage):
    """A stage that never arrives."""

    def on_target(self) -> bool:
        return False


@pytest.mark.parametrize(
    ("stage", "message"), [(SimulatedStage, r"has sent no data for 2\."), (StuckStage, "has sent no data|not arrived")]
)
def test_silent_board_or_stuck_stage_ends_run(bench: Path, stage: type[SimulatedStage], message: str) -> None:
    clock, board = SimulatedClock(), SilentBoard()
    instruments = Instruments(stage(clock), board, clock)
    with begin(bench / "a.journal", instruments, {}) as journal, pytest.raises(BenchError, match=message):
        run_protocol(load_protocol(bench / "protocol.toml"), instruments, journal)
    assert board.calls == ["start", "stop"]
    assert read_journal(bench / "a.journal").events[-1]["what"] == "fault"


def test_refuses_protocol_in_other_unit_than_stage(bench: Path) -> None:
    clock, board = SimulatedClock(), SilentBoard()
    instruments = Instruments(SimulatedStage(clock, "mm"), board, clock)
    with begin(bench / "a.journal", instruments, {}) as journal, pytest.raises(BenchError, match=r"in deg, .* in mm"):
        run_protocol(load_protocol(bench / "protocol.toml"), instruments, journal)
    assert board.calls == []


def test_fits_board_clock_to_arrivals() -> None:
    rng = np.random.default_rng(2)
    board_s: FloatArray = np.asarray(np.arange(1, 3000) * 0.1, dtype=np.float64)
    delay_s: FloatArray = np.asarray(rng.exponential(0.01, len(board_s)), dtype=np.float64)
    arrival_s: FloatArray = np.asarray(7.0 + board_s * (1 - 50e-6) + delay_s, dtype=np.float64)
    line = fit_clock(board_s, arrival_s)
    assert line.rate == pytest.approx(1 - 50e-6, abs=2e-6)
    assert line.at(board_s) == pytest.approx(7.0 + board_s * (1 - 50e-6), abs=1e-3)
    assert fit_clock(board_s[:3], arrival_s[:3]).rate == 1.0
    few = slice(None, 180, 3)  # the rate from 18 s is less accurate than a quartz
    assert abs(fit_clock(board_s[few], arrival_s[few]).rate - 1.0) < 60e-6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("cycles = 3", "cycles = 0"), r"protocol\.toml: cycles = 0; must be at least 1"),
        (("to_deg = 0.0", "to_mm = 0.0"), r"step\[2\]; must have a target and a velocity in the same unit"),
        (("velocity_deg_per_s = 15.0", "speed = 15.0"), r"step\[0\]\.speed; unknown key"),
        (("to_deg = 3.0", "to_deg = 300.0"), r"protocol = 300\.0; a simulated sensor is traced up to 80 deg"),
    ],
)
def test_refuses_bad_protocol_in_one_line(bench: Path, change: tuple[str, str], message: str) -> None:
    text = (bench / "protocol.toml").read_text(encoding="utf-8")
    (bench / "protocol.toml").write_text(text.replace(*change, 1), encoding="utf-8")
    with pytest.raises((BenchError, SpecError), match=message) as bad:
        run_in(bench)
    assert len(str(bad.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('name = "B"', 'name = "A"'), "name A is used twice"),
        (('name = "B"', 'name = "aux.1"'), "'aux.1'; is reserved for a device on Windows"),
        (('name = "B"', 'name = "B."'), "or end in a dot"),
        (("right = 4", "right = 1"), "input 1 is used twice"),
        (("[board]", '[stage]\nmodel = "M-1"\n[board]'), r"model = 'M-1'; .*M-060\.DG, M-111\.1DG"),
        (("[board]", '[stage]\nmodel = "M-111.1DG"\nlever_mm = 20.0\n[board]'), "is in deg, and the stage moves in mm"),
        (("[board]", '[board]\nport = "COM1"'), "port = 'COM1'; cannot be combined with driver"),
        (("[board]", '[stage]\ndriver = "gcs2"\n[board]'), r"stage\.port; is required by the driver gcs2"),
        (("trim_v = 1.0", "trim_v = 9.0"), "must be below the supply, 5 V"),
        (('design = "sensor.toml"', 'design = "none.toml"'), "no such file"),
    ],
)
def test_refuses_bad_rig_in_one_line(bench: Path, change: tuple[str, str], message: str) -> None:
    text = (bench / "rig.toml").read_text(encoding="utf-8")
    (bench / "rig.toml").write_text(text.replace(*change, 1), encoding="utf-8")
    with pytest.raises((BenchError, SpecError, OutputError), match=message) as bad:
        run_in(bench)
    assert len(str(bad.value).splitlines()) == 1
    assert not (bench / "out").exists()


@pytest.mark.parametrize("kind", ["rotation", "bend"])
def test_linear_stage_turns_or_bends_sensor(bench: Path, kind: str) -> None:
    rig = (bench / "rig.toml").read_text(encoding="utf-8")
    stage = '[stage]\nmodel = "M-111.1DG"\nlever_mm = 40.0\n[board]'
    (bench / "rig.toml").write_text(rig.replace("[board]", stage), encoding="utf-8")
    protocol = (bench / "protocol.toml").read_text(encoding="utf-8")
    protocol = protocol.replace("to_deg", "to_mm").replace("velocity_deg", "velocity_mm").replace("15.0", "8.0")
    (bench / "protocol.toml").write_text(protocol.replace("-3.0", "-2.0").replace("3.0", "2.0"), encoding="utf-8")
    save(bench / "sensor.toml", with_values(load(bench / "sensor.toml"), {"motion.kind": kind}))
    receivers = study([run_in(bench).path]).to_dict()["sensors"]["A"]["receivers"]
    end_deg = math.degrees(math.atan(2.0 / 40.0))
    for side, brightest in (("right", 0), ("left", -1)):  # negative angles send more light to the right receiver
        angles, volts = receivers[side]["angle_deg"], receivers[side]["mean_V"]
        assert (angles[0], angles[-1]) == pytest.approx((-end_deg, end_deg), abs=0.1)  # a step of the grid
        assert volts[brightest] < volts[-1 - brightest] - 1.0
    assert receivers["right"]["swing_V"] > 1.0


@pytest.mark.usefixtures("short_reads")
def test_interrupted_cycle_is_only_among_raw_samples(bench: Path) -> None:
    for resume, cycles in ((False, 1), (True, 2)):
        with pytest.raises(KeyboardInterrupt):
            run_in(bench, resume=resume, watch=raise_after(cycles, KeyboardInterrupt()))
    run = run_in(bench, resume=True)
    with h5netcdf.File(run.path, "r") as file:
        interrupted = json.loads(file.attrs["cut_short"])
        raw_s, reading_s = file.variables["time_s"][...], file.groups["A"].variables["time_s"][...]
    assert len(interrupted) == 2
    for begin_s, end_s in interrupted:
        assert ((raw_s > begin_s) & (raw_s < end_s)).any()
        assert not ((reading_s > begin_s + 0.01) & (reading_s < end_s)).any()
    analysis = study([run.path]).to_dict()
    assert [len(sensor["runs"][0]["motion"]["cycles"]) for sensor in analysis["sensors"].values()] == [3, 3]
    assert not [line for line in analysis["warnings"] if "incomplete" in line]


def test_checks_disk_space_before_writing_recording(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=200_000))
    with pytest.raises(OutputError, match=r"protocol\.nc; .*0\.2 MB .*; free some space"):
        run_in(bench)
    monkeypatch.undo()
    assert [path.name for path in (bench / "out").iterdir()] == ["protocol.journal"]
    assert recover(bench / "out" / "protocol.journal").outcome == "done"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -4}, "seed = -4; must be at least 0"),
        ({"name": "a" * 300}, r"--name = 'a+…'; is 300 bytes long; at most 200"),
        ({"name": "../a"}, "must be the name of a file, without its folder"),
        ({"name": "nul"}, "--name = 'nul'; is reserved for a device on Windows"),
        ({"name": "a."}, "or end in a dot"),
        ({"resume": True}, r"protocol\.journal; does not exist.*; omit --resume"),
    ],
)
def test_refuses_bad_options_before_run(bench: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises((BenchError, SpecError), match=message):
        run_in(bench, **options)
    assert not (bench / "out").exists()


def test_starter_files_are_valid_and_never_overwritten(tmp_path: Path) -> None:
    new(tmp_path / "bench")
    for name in ("rotation", "bending"):
        assert load_protocol(tmp_path / "bench" / f"{name}.toml").cycles == 6
    for name, kind in (("rig", "rotation"), ("rig-bending", "bend")):
        rig = load_rig(tmp_path / "bench" / f"{name}.toml")
        assert (rig.inputs, rig.stage.lever_mm) == (8, 40.0 if kind == "bend" else None)
        assert load(tmp_path / "bench" / rig.sensor[0].design).motion.kind == kind
    new(tmp_path / "bench")  # unchanged files are accepted
    (tmp_path / "bench" / "rig.toml").write_text("changed", encoding="utf-8")
    with pytest.raises(OutputError, match="already exists"):
        new(tmp_path / "bench")
    assert (tmp_path / "bench" / "rig.toml").read_text(encoding="utf-8") == "changed"


def test_lists_recordings_of_read_only_folder(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_in(bench)
    out, connect = bench / "out", sqlite3.connect

    def connect_read_only(path: Path, **options: Any) -> sqlite3.Connection:
        connection: sqlite3.Connection = connect(f"{path.as_uri()}?mode=ro", uri=True, **options)
        return connection

    (out / "other.nc").write_bytes(b"no netCDF")
    monkeypatch.setattr("sqlite3.connect", connect_read_only)
    with_catalogue = list_recordings(out)
    from_files = list_recordings(out, look=True)
    (out / "recordings.sqlite").unlink()
    without_catalogue = list_recordings(out)
    assert with_catalogue.recordings == from_files.recordings == without_catalogue.recordings
    assert from_files.not_recordings == without_catalogue.not_recordings == ("other.nc",)
    assert not (out / "recordings.sqlite").exists()


def test_catalogue_lists_new_and_missing_recordings(bench: Path) -> None:
    run_in(bench)
    out = bench / "out"
    (out / "protocol.nc").rename(out / "moved.nc")
    (out / "other.nc").write_bytes(b"no netCDF")
    catalogue = list_recordings(out, look=True)
    assert {entry.file: entry.there for entry in catalogue.recordings} == {"protocol.nc": False, "moved.nc": True}
    assert catalogue.not_recordings == ("other.nc",)
    assert "other.nc" in catalogue.warnings[0]
    (out / "recordings.sqlite").write_bytes(b"not a database, but as long as one" * 50)
    with pytest.raises(OutputError, match="cannot be used"):
        list_recordings(out)
