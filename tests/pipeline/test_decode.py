"""`solen bench calibrate` and `solen bench decode` for recordings, streams and runs, and what they refuse."""

import io
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.analysis import SignalOptions
from solen.analysis.calibration import Decoding
from solen.analysis.calibration import file as saved
from solen.analysis.calibration.stream_decoder import COLUMNS
from solen.bench.clock import SimulatedClock, WallClock
from solen.bench.follow import JournalFollower
from solen.bench.journal import Journal
from solen.bench.outlets import Paced
from solen.bench.record import record
from solen.cli import run_command
from solen.errors import DataError, SpecError
from solen.pipeline.bench import decode as pipeline
from solen.recording import read_parts
from tests.analysis.simulated_support import Protocol, Truth, simulated
from tests.bench.lsl_support import recorded_streams
from tests.bench.rig_support import PROTOCOL
from tests.bench.wire_support import Served
from tests.command_support import answered

TRUTH = Truth(noise_V=0.01, protocol=Protocol(hold_s=0.2))
DESIGN = 'schema = 1\nname = "one"\n\n[material]\nindex = 1.44\n'


def write(
    path: Path, truth: Truth = TRUTH, header: str = "time_s,angle_deg,left_V,right_V", scale: float = 1.0
) -> Path:
    """Write a simulated recording as a table, with scaled voltages."""
    signals = simulated(truth)
    rows = np.column_stack([signals.time_s, signals.angle_deg, scale * signals.volts])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.6f")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with recordings of a rotation and a calibration."""
    path = tmp_path_factory.mktemp("decode")
    write(path / "S1.csv")
    write(path / "again.csv", replace(TRUTH, seed=5))
    (path / "design.toml").write_text(DESIGN, encoding="utf-8")
    (path / "bend.toml").write_text(f'{DESIGN}\n[motion]\nkind = "bend"\n', encoding="utf-8")
    (path / "emitter.toml").write_text(f'{DESIGN}\n[motion]\npivot = "emitter"\n', encoding="utf-8")
    assert run_command(["bench", "calibrate", str(path / "S1.csv"), "--design", str(path / "design.toml")]) == 0
    return path


@pytest.fixture
def calibration(folder: Path) -> Path:
    return folder / "S1.calibration.json"


def decoded_lines(folder: Path, **options: Any) -> Decoding:
    """Return the result of decoding lines of CSV."""
    decoding = pipeline.decode(folder / "S1.calibration.json", "-", **options).result
    assert isinstance(decoding, Decoding)
    return decoding


def test_calibrates_and_checks_a_recording(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    figure = tmp_path / "calibration.svg"
    result = answered(
        capfd, "bench", "calibrate", str(folder / "again.csv"), "--out", str(tmp_path / "a.json"),
        "--figure", str(figure), "--motion", "rotation",
    )  # fmt: skip
    (calibration,) = result["calibrations"]
    assert calibration["cycles"] == 5
    check = calibration["leave_one_cycle_out"]["whole"]
    assert check["rms_deg"] < 0.06  # from 10 mV of noise of two receivers, with 0.5 V/° at 0 and 0.1 V/° at the ends
    assert 0.9 < check["within_95"] <= 1.0
    assert "<svg" in figure.read_text(encoding="utf-8")


def test_calibration_file_describes_its_conditions(folder: Path) -> None:
    file = saved.load(folder / "S1.calibration.json")
    assert file.motion.kind == "rotation"
    assert file.motion.pivot == "stem-base"
    assert file.motion.parts == ("lens", "emitter")
    assert file.motion.speed_deg_per_s == pytest.approx(15.0, rel=0.01)
    assert file.circuit.ambient == "not subtracted"
    assert file.circuit.load_ohm == 2000.0
    assert len(str(file.circuit.design_sha256)) == 64
    assert file.sources[0]["file"] == "S1.csv"
    assert saved.CalibrationFile(**file.model_dump(), curves=file.curves) == file
    assert "curves" in saved.json_schema()["properties"]


def test_decodes_a_recording_and_compares_it_with_its_angle(
    folder: Path, calibration: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "angles.csv"
    result = answered(capfd, "bench", "decode", str(calibration), str(folder / "again.csv"), "--out", str(out))
    assert result["readings"] == len(simulated(TRUTH).time_s)
    assert result["against_angle"]["rms_deg"] < 0.06
    assert 0.92 < result["against_angle"]["within_95"] <= 1.0
    assert result["outside"] < 0.01 * result["readings"]
    lines = out.read_text(encoding="utf-8").splitlines()
    assert lines[0] == ",".join(COLUMNS)
    assert len(lines) == result["readings"] + 1
    rows = [line.split(",") for line in lines[1:]]
    angles = simulated(replace(TRUTH, seed=5)).angle_deg
    assert [float(row[1]) for row in rows] == pytest.approx(angles.tolist(), abs=0.35)
    outer = [
        (row[6], "left" if angle > 0 else "right") for row, angle in zip(rows, angles, strict=True) if abs(angle) > 0.5
    ]
    assert {direction for direction, _ in outer} == {"left", "right"}
    assert all(direction == expected for direction, expected in outer)
    rising = [row[8] for row, step in zip(rows, np.diff(angles, prepend=0.0), strict=True) if step > 0.05]
    assert rising.count("rising") > 0.5 * len(rising)
    assert rising.count("falling") < 0.05 * len(rising)


def test_notes_a_file_with_another_name_and_warns_of_another_sensor(
    folder: Path, calibration: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    command = ("bench", "decode", str(calibration), str(folder / "again.csv"))
    (note,) = [line for line in answered(capfd, *command)["warnings"] if '--sensor "again"' in line]
    assert note.startswith("note")
    other = answered(capfd, *command, "--sensor", "again")
    assert any("sensor again instead of S1" in line for line in other["warnings"])


def test_replaces_an_existing_table_only_with_force(
    folder: Path, calibration: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "angles.csv"
    out.write_text("existing", encoding="utf-8")
    command = ("bench", "decode", str(calibration), str(folder / "again.csv"), "--out", str(out))
    assert "angles.csv; already exists; specify another file, or add --force" in refused(capfd, *command)
    assert out.read_text(encoding="utf-8") == "existing"
    answered(capfd, *command, "--force")


def test_decodes_each_line_before_the_next_is_read(folder: Path) -> None:
    read: list[str] = []
    written = io.StringIO()

    def lines() -> Iterator[str]:
        yield "Zeit (s);PD links (mV);PD rechts (mV)\n"
        for number, row in enumerate(("0;2000;2000\n", "0,005;1500,0;2500\n", "0,01;;2500\n", "0,015;oops;1\n", "\n")):
            assert written.getvalue().count("\n") == number + 1  # the rows of all lines before this one
            read.append(row)
            yield row

    decoding = decoded_lines(folder, rows=written, text=lines())
    assert len(read) == 5
    rows = [line.split(",") for line in written.getvalue().splitlines()[1:]]
    assert len(rows) == 4
    assert (decoding.readings, decoding.missing) == (2, 2)
    assert all(len(row) == len(COLUMNS) for row in rows)
    assert float(rows[0][1]) == pytest.approx(0.0, abs=0.05)
    assert float(rows[1][1]) == pytest.approx(2.0 * np.arctanh(0.5), abs=0.06)
    assert [row[10] for row in rows[2:]] == ["missing", "missing"]
    assert any("cannot be checked" in warning for warning in decoding.warnings)


def test_columns_of_lines_without_a_header_are_options(folder: Path) -> None:
    rows = io.StringIO()
    columns = SignalOptions(columns=("t", "left_V", "right_V"))
    decoded_lines(folder, signals=columns, rows=rows, text=["0.5,2.0,2.0\n"])
    assert rows.getvalue().splitlines()[1].startswith("0.500000,")
    channels = SignalOptions(channel=("left=a", "right=b"), rate_hz=200.0)
    assert decoded_lines(folder, signals=channels, text=["a,b\n", "2.0,2.0\n"]).readings == 1


@pytest.mark.parametrize(
    ("header", "assumed", "in_A"),
    [("t,left,right", 3, False), ("t_s,left_V,right_V", 0, False), ("t_s,left (mA),right (mA)", 0, True)],
)
def test_lines_and_files_have_the_same_units(
    folder: Path, tmp_path: Path, header: str, assumed: int, *, in_A: bool
) -> None:
    calibration, scale = folder / "S1.calibration.json", 1e3 if in_A else 1.0
    if in_A:
        content = json.loads(calibration.read_text(encoding="utf-8").replace('_V"', '_A"'))
        calibration = tmp_path / "A.json"
        calibration.write_text(json.dumps({**content, "unit": "A"}), encoding="utf-8")
    readings = [f"{0.005 * n:.3f},{scale * (2.0 - 0.02 * n):.6g},{scale * (2.0 + 0.02 * n):.6g}" for n in range(20)]
    source = tmp_path / "file.csv"
    source.write_text("\n".join([header, *readings, ""]), encoding="utf-8")
    tables = []
    for name, text in ((str(source), None), ("-", [header, *readings])):
        rows = io.StringIO()
        result = pipeline.decode(calibration, name, rows=rows, text=text).result
        assert sum("assumed" in line for line in result.warnings) == assumed
        tables.append(rows.getvalue())
    assert tables[0] == tables[1]


def test_repeated_readings_are_not_taken_for_repeated_headers(folder: Path) -> None:
    rows = io.StringIO()
    columns = SignalOptions(columns=("left_V", "right_V"), rate_hz=50.0)
    decoded_lines(folder, signals=columns, rows=rows, text=["2.0,2.0\n"] * 3)
    assert [row.split(",")[0] for row in rows.getvalue().splitlines()[1:]] == ["0.000000", "0.020000", "0.040000"]
    repeated_header = ["t_s,left_V,right_V\n", "0.5,2.0,2.0\n"] * 2
    assert decoded_lines(folder, text=repeated_header).readings == 2


@pytest.mark.parametrize("mark", ["\ufeff", "\xef\xbb\xbf"], ids=["UTF-8", "Windows-1252"])
@pytest.mark.parametrize("header", ["t/s,U_L/V,U_R/V", "time_s,left_V,right_V", "Zeit (s);U_L [V];U_R [V]"])
def test_header_may_begin_with_a_byte_order_mark(folder: Path, mark: str, header: str) -> None:
    rows = io.StringIO()
    row = "0.5,2.0,2.0\n" if "," in header else "0,5;2,0;2,0\n"
    lines = [f"{mark}{header}\n", row, f"{header}\n", row, f"{mark}{header}\n", row]
    decoding = decoded_lines(folder, rows=rows, text=lines)
    assert (decoding.readings, decoding.missing) == (3, 0)
    assert rows.getvalue().splitlines()[1].startswith("0.500000,")


def test_stream_without_times_requires_a_rate(folder: Path) -> None:
    lines = ["left_V,right_V\n", "2.0,2.0\n", "2.0,2.0\n"]
    with pytest.raises(DataError, match="--rate-hz"):
        decoded_lines(folder, text=lines)
    rows = io.StringIO()
    decoded_lines(folder, signals=SignalOptions(rate_hz=50.0), rows=rows, text=lines)
    assert [row.split(",")[0] for row in rows.getvalue().splitlines()[1:]] == ["0.000000", "0.020000"]


def test_units_may_follow_a_slash(folder: Path, tmp_path: Path) -> None:
    write(tmp_path / "S1.csv", header="t/s,angle/deg,U_L/V,U_R/V")
    decoding = pipeline.decode(folder / "S1.calibration.json", str(tmp_path / "S1.csv")).result
    assert isinstance(decoding, Decoding)
    assert decoding.against_angle is not None
    assert decoding.against_angle.rms_deg < 0.06


def test_ctrl_c_ends_a_stream_with_a_complete_file(folder: Path, tmp_path: Path) -> None:
    def lines() -> Iterator[str]:
        yield "time_s,left_V,right_V\n"
        yield "0,2,2\n"
        raise KeyboardInterrupt

    out = tmp_path / "live.csv"
    decoding = decoded_lines(folder, out=out, text=lines())
    assert decoding.interrupted is True
    assert decoding.readings == 1
    assert len(out.read_text(encoding="utf-8").splitlines()) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["live.csv"]


def test_writes_rows_before_a_pipe_is_closed(calibration: Path) -> None:
    command = [sys.executable, "-m", "solen", "bench", "decode", str(calibration), "-"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8"
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write("time_s,left_V,right_V\n0,2,2\n")
        process.stdin.flush()
        assert process.stdout.readline().startswith("time_s,angle_deg")
        assert process.stdout.readline().startswith("0.000000,")
        process.stdin.close()
        assert process.wait(timeout=30) == 0
        process.stdin = None


def test_warns_of_readings_outside_the_curve(folder: Path) -> None:
    lines = ["time_s,left_V,right_V", *(f"{0.01 * n},9,9" for n in range(20))]
    assert any("20 readings (100 %)" in line for line in decoded_lines(folder, text=lines).warnings)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--design", "design.toml"), ""),
        (("--design", "bend.toml"), "does not match the calibration: kind of motion bend instead of rotation"),
        (("--design", "emitter.toml"), "does not match the calibration: pivot emitter instead of stem-base"),
        (("--motion", "bend"), "does not match the calibration: kind of motion bend instead of rotation"),
        ((), "does not specify the kind of motion and the pivot and the moving parts"),
    ],
)
def test_warns_of_another_motion(
    folder: Path, calibration: Path, options: tuple[str, ...], message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(folder / option) if option.endswith(".toml") else option for option in options]
    result = answered(capfd, "bench", "decode", str(calibration), str(folder / "S1.csv"), *arguments)
    warnings = [line for line in result["warnings"] if "the calibration: " in line or "does not specify" in line]
    assert len(warnings) == bool(message)
    assert all(message in warning for warning in warnings)


def test_pools_prints(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    paths = [
        write(tmp_path / f"S{n}.csv", replace(TRUTH, seed=n, swing_V=1.0 + 0.05 * n, offset_V=2.0 + 0.05 * (-1) ** n))
        for n in range(3)
    ]
    pooled = answered(capfd, "bench", "calibrate", *map(str, paths), "--pool")
    (calibration,) = pooled["calibrations"]
    assert calibration["prints"] == ["S0", "S1", "S2"]
    assert Path(pooled["files"]["calibration.pooled"]).name == "pooled.calibration.json"
    assert calibration["leave_one_cycle_out"] is None
    assert [part["name"] for part in calibration["leave_one_sensor_out"]["parts"]] == ["S0", "S1", "S2"]
    separate = answered(capfd, "bench", "calibrate", *map(str, paths))
    assert [Path(file).name for file in separate["files"].values()] == [f"S{n}.calibration.json" for n in range(3)]
    by_pool, by_print = (
        answered(capfd, "bench", "decode", file, str(paths[1]))["against_angle"]["rms_deg"]
        for file in (pooled["files"]["calibration.pooled"], str(tmp_path / "S1.calibration.json"))
    )
    assert by_pool > by_print


def refused(capfd: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Return the error message of a command that fails; its last line on stderr."""
    capfd.readouterr()
    assert run_command([*arguments]) == 2
    last = capfd.readouterr().err.strip().splitlines()[-1]
    assert last.startswith("solen: ")
    return last


def test_refuses_recordings_that_cannot_be_calibrated(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    without_sides = write(tmp_path / "S1.csv", header="time_s,angle_deg,top_V,bottom_V")
    assert "no pair of a left and a right receiver" in refused(capfd, "bench", "calibrate", str(without_sides))
    short = write(tmp_path / "short.csv", replace(TRUTH, protocol=Protocol(hold_s=0.2, cycles=2)))
    assert "1 usable cycle" in refused(capfd, "bench", "calibrate", str(short))
    good = write(tmp_path / "good.csv")
    assert "--with-controls" in refused(capfd, "bench", "calibrate", str(good), "--control", "good")
    assert "at least two sensors" in refused(capfd, "bench", "calibrate", str(good), "--pool")
    assert "no sensor has this name" in refused(capfd, "bench", "calibrate", str(good), "--sensor", "S9")
    assert "end in .json" in refused(capfd, "bench", "calibrate", str(good), "--out", "x.toml")
    assert "'rotation', 'bend' or 'loaded'" in refused(capfd, "bench", "calibrate", str(good), "--motion", "twist")
    assert not list(tmp_path.glob("*.json"))


def test_refuses_invalid_calibration_files(
    folder: Path, calibration: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    data = json.loads(calibration.read_text(encoding="utf-8"))
    curves, invalid = data["curves"], tmp_path / "invalid.json"

    def message(content: str) -> str:
        invalid.write_text(content, encoding="utf-8")
        return refused(capfd, "bench", "decode", str(invalid), str(folder / "S1.csv"))

    missing = refused(capfd, "bench", "decode", str(tmp_path / "none.json"), str(folder / "S1.csv"))
    assert "no such file" in missing
    assert "solen bench calibrate" in missing
    assert "not valid JSON" in message(calibration.read_text(encoding="utf-8")[:500])
    assert "not valid JSON: NaN is not a valid JSON number" in message('{"kind": "calibration", "schema": NaN}')
    assert "is not the calibration of a sensor" in message('{"kind": "analysis"}')
    assert "is not the calibration of a sensor" in message("[1, 2]")
    assert "written by a newer solen" in message(json.dumps(data | {"schema": 2}))
    assert "schema is missing" in message(json.dumps({key: data[key] for key in data if key != "schema"}))
    assert "curves" in message(json.dumps({key: data[key] for key in data if key != "curves"}))
    assert "unknown key" in message(json.dumps(data | {"colour": "red"}))
    too_short = curves | {"rising_V": curves["rising_V"][1:]}
    assert "one for each angle" in message(json.dumps(data | {"curves": too_short}))
    descending = curves | {"angle_deg": curves["angle_deg"][::-1]}
    assert "must be in ascending order" in message(json.dumps(data | {"curves": descending}))
    indefinite = curves | {"noise_V2": [[1e-6, 1e-3, 1e-6]] * len(curves["angle_deg"])}
    assert "must be covariance matrices" in message(json.dumps(data | {"curves": indefinite}))


def test_table_begins_with_a_do_not_use_warning_of_the_calibration(
    folder: Path, calibration: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    data = json.loads(calibration.read_text(encoding="utf-8"))
    data["warnings"] = ["do not use: only 40 % are within the bands", "two cycles"]
    poor, out = tmp_path / "poor.json", tmp_path / "angles.csv"
    poor.write_text(json.dumps(data), encoding="utf-8")
    result = answered(capfd, "bench", "decode", str(poor), str(folder / "S1.csv"), "--out", str(out))
    warning = "calibration: do not use: only 40 % are within the bands"
    assert warning in result["warnings"]
    assert not any("two cycles" in line for line in result["warnings"])
    lines = out.read_text(encoding="utf-8").splitlines()
    assert lines[0] == f"# {warning}"
    assert lines[1].startswith("time_s,")


def test_refuses_invalid_lines(folder: Path) -> None:
    def message(*lines: str, **options: Any) -> str:
        with pytest.raises(DataError) as refusal:
            decoded_lines(folder, text=lines, **options)
        return str(refusal.value)

    assert "is empty" in message()
    assert "is empty" in message("\n", "\n")
    assert "contains no reading" in message("time_s,left_V,right_V\n")
    assert "contains no reading" in message("time_s,left_V,right_V\n", "0,nan,1\n")
    assert "has 0 columns that could be the right receiver" in message("time_s,left_V\n", "0,1\n")
    assert "has 2 columns that could be the left receiver" in message("t,left_V,left2_L,right_V\n", "0,1,1,1\n")
    assert "begins with numbers" in message("0,2,2\n")
    assert "--time stage; no such column" in message("t,left_V,right_V\n", signals=SignalOptions(time="stage"))
    assert "left_mV" in message("t,left,right\n", "0,2000,2000\n")
    with pytest.raises(SpecError, match="--smooth-ms; applies only to recorded files"):
        decoded_lines(folder, signals=SignalOptions(smooth_ms=25.0), text=["t,left_V,right_V\n", "0,2,2\n"])


def test_refuses_recordings_and_options_that_cannot_be_decoded(
    folder: Path, calibration: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    millivolts = write(tmp_path / "millivolts.csv", scale=1000.0)

    def message(*options: str, source: Path = millivolts) -> str:
        return refused(capfd, "bench", "decode", str(calibration), str(source), *options)

    assert "left_mV" in message("--json")
    assert "no such file" in message(source=tmp_path / "none.csv")
    assert "--follow" in message("--follow")
    assert "end in .csv" in message("--out", "a.json")
    for options in ((), ("--force",)):
        assert "input file" in message("--out", str(millivolts), *options)
    assert "voltage without light" in message("--gain-percent", "5")
    out = tmp_path / "out.csv"
    assert "left_mV" in message("--out", str(out))
    assert not out.exists()
    missing_folder = str(tmp_path / "none" / "out.csv")
    assert "cannot be written" in message("--out", missing_folder, source=folder / "S1.csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["millivolts.csv"]


RIG = """
schema = 1
name = "two prints"
seed = 5
[board]
trim_v = 1.0
[[sensor]]
name = "A"
design = "sensor.toml"
emitter = 1
right = 1
left = 2
[ambient]
mean_mw_cm2 = 0.05
"""


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the recording of a simulated run, its journal and a calibration."""
    path = tmp_path_factory.mktemp("run")
    (path / "sensor.toml").write_text(DESIGN, encoding="utf-8")
    (path / "rig.toml").write_text(RIG, encoding="utf-8")
    (path / "protocol.toml").write_text(PROTOCOL.replace("cycles = 3", "cycles = 4"), encoding="utf-8")
    original_end = Journal.end

    def end_and_copy(self: Journal, **kwargs: Any) -> None:
        original_end(self, **kwargs)
        (path / "kept.journal").write_bytes(self.path.read_bytes())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Journal, "end", end_and_copy)
        record(path / "protocol.toml", path / "rig.toml", path)
    assert run_command(["bench", "calibrate", str(path / "protocol.nc"), "--out", str(path / "A.json")]) == 0
    return path


def test_calibrates_and_decodes_the_recording_of_a_run(run_folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The response of a point emitter saturates within a degree; the bands of larger angles are wide."""
    calibration = saved.load(run_folder / "A.json")
    assert calibration.circuit.ambient == "subtracted"
    assert calibration.motion.pivot == "stem-base"
    assert calibration.motion.protocol == "short"
    assert calibration.simulated is True
    assert calibration.leave_one_cycle_out is not None
    assert calibration.leave_one_cycle_out.whole.rms_deg < 0.3
    assert calibration.leave_one_cycle_out.whole.within_95 > 0.9
    decoded = answered(capfd, "bench", "decode", str(run_folder / "A.json"), str(run_folder / "protocol.nc"))
    assert decoded["against_angle"]["rms_deg"] < 0.3
    assert not [line for line in decoded["warnings"] if "the calibration: " in line]


def test_follows_the_journal_of_a_run(run_folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The journal grows in pieces that end at any byte."""
    command = ("bench", "decode", str(run_folder / "A.json"))
    ended = answered(capfd, *command, str(run_folder / "kept.journal"))
    data, growing = (run_folder / "kept.journal").read_bytes(), tmp_path / "growing.journal"
    cuts = [*np.linspace(len(data) // 3, len(data), 6).astype(int).tolist()]
    growing.write_bytes(data[: cuts[0]])

    def grow() -> None:
        for start, end in pairwise(cuts):
            time.sleep(0.05)
            with growing.open("ab") as file:
                file.write(data[start:end])

    thread = threading.Thread(target=grow)
    thread.start()
    followed = answered(capfd, *command, str(growing), "--follow")
    thread.join()
    assert followed["readings"] == ended["readings"] > 300
    assert (followed["to_s"], followed["highest_deg"]) == (ended["to_s"], ended["highest_deg"])


def test_journal_contains_the_readings_of_the_recording(run_folder: Path) -> None:
    readings = next(iter(JournalFollower(run_folder / "kept.journal").readings("A")))
    ((_, recording),) = list(read_parts(run_folder / "protocol.nc"))
    assert readings.volts[:, 0] == pytest.approx(recording.channel("left").values, abs=1e-12)
    assert readings.volts[:, 1] == pytest.approx(recording.channel("right").values, abs=1e-12)


def test_refuses_a_file_that_is_no_journal(
    calibration: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "no.journal").write_bytes(b"something else")
    message = refused(capfd, "bench", "decode", str(calibration), str(tmp_path / "no.journal"))
    assert "is not a journal of solen" in message


def test_time_of_a_line_may_be_missing_or_earlier(folder: Path) -> None:
    written = io.StringIO()
    steps = (f"{0.005 * n},{2 - 0.1 * n},{2 + 0.1 * n}\n" for n in range(5))
    lines = ["time_s,left_V,right_V\n", ",2,2\n", "9,2,2\n", *steps]
    decoding = decoded_lines(folder, rows=written, text=lines)
    assert (decoding.readings, decoding.missing) == (6, 1)
    rows = [line.split(",") for line in written.getvalue().splitlines()[1:]]
    assert rows[0][10] == "missing"
    assert rows[2][8] == ""  # the previous reading is later
    assert rows[-1][8] == "rising"
    assert float(rows[-1][9]) > 0.975


LIVE = "time_s,left_V,right_V\n0.0,-1.0,-1.2\n0.1,-1.0,-1.3\n0.2,,-1.0\n"


def test_sends_rows_as_datagrams(folder: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5.0)
        rows = io.StringIO()
        url = f"udp://127.0.0.1:{receiver.getsockname()[1]}"
        decoded_lines(folder, text=io.StringIO(LIVE), rows=rows, send=url)
        datagrams = [receiver.recv(4096).decode("ascii") for _ in range(4)]
    assert datagrams == rows.getvalue().splitlines()
    assert datagrams[0] == ",".join(COLUMNS)


def test_sends_rows_over_a_serial_line(folder: Path) -> None:
    received = bytearray()

    class Listener:
        def reply(self, data: bytes) -> bytes:
            received.extend(data)
            return b""

    rows = io.StringIO()
    with Served(Listener()) as served:
        decoded_lines(folder, text=io.StringIO(LIVE), rows=rows, send=f"serial:{served.url}@9600")
        end_s = time.monotonic() + 5.0
        while received.count(b"\n") < 4 and time.monotonic() < end_s:
            time.sleep(0.01)
    assert received.decode("ascii") == rows.getvalue()


def test_sends_angles_and_bands_as_a_stream_of_samples(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = recorded_streams(monkeypatch)
    written = io.StringIO()
    decoded_lines(folder, text=io.StringIO(LIVE), rows=written, send="lsl:finger")
    assert calls[0] == ("finger", "Angle", 4, 0.0, 2, "solen-finger")
    assert [value for _, value in calls[1:5]] == ["time_s", "angle_deg", "low95_deg", "high95_deg"]
    rows = [dict(zip(COLUMNS, row.split(","), strict=True)) for row in written.getvalue().splitlines()[1:]]
    samples = [values for values, stamp_s in calls[5:] if stamp_s == 7.5]
    assert len(samples) == len(rows) == 3
    assert samples[0] == [float(rows[0][name]) for name in ("time_s", "angle_deg", "low95_deg", "high95_deg")]
    assert np.isnan(samples[2][1])


INVALID_OUTLETS = ["udp://127.0.0.1", "udp:127.0.0.1:99999999", "serial:", "serial:COM5@fast", "tcp://x:1"]


@pytest.mark.parametrize("send", INVALID_OUTLETS)
def test_refuses_an_invalid_outlet(folder: Path, send: str) -> None:
    with pytest.raises(SpecError, match=r"--send = .*udp://HOST:PORT"):
        decoded_lines(folder, text=io.StringIO(LIVE), send=send)


class TimedRows:
    """An outlet that records the time of each row."""

    def __init__(self, clock: SimulatedClock) -> None:
        self.clock, self.rows = clock, list[tuple[float, str]]()

    def write(self, text: str) -> None:
        self.rows.append((self.clock.now_s(), text))

    def flush(self) -> None:
        """Do nothing."""


def test_rows_of_a_recording_are_sent_at_their_intervals() -> None:
    clock = SimulatedClock(100.0)
    outlet = TimedRows(clock)
    paced = Paced(outlet, clock)
    paced.write("time_s,angle_deg\n")
    paced.write("7.0,1.0\n7.5,1.5\n,missing\n")
    clock.sleep(1.0)  # the duration of decoding; a late row is sent at once
    paced.write("8.0,2.0\n9.0,3.0\n")
    assert [(round(time_s, 9), row.split(",")[0]) for time_s, row in outlet.rows] == [
        (100.0, "time_s"), (100.0, "7.0"), (100.5, "7.5"), (100.5, ""), (101.5, "8.0"), (102.0, "9.0"),
    ]  # fmt: skip


def test_decode_sends_a_recording_at_its_intervals(
    calibration: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    waited: list[float] = []
    monkeypatch.setattr(WallClock, "sleep", lambda _, duration_s: waited.append(duration_s))
    path = tmp_path / "short.csv"
    path.write_text("time_s,left_V,right_V\n" + "".join(f"{10 * n},2,2\n" for n in range(20)), encoding="utf-8")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        pipeline.decode(calibration, str(path), send=f"udp://127.0.0.1:{receiver.getsockname()[1]}")
    assert waited == pytest.approx([10.0 * n for n in range(1, 20)], abs=5.0)  # from the start, because no time passes
