"""`solen bench calibrate` and `solen bench decode` from files to answers, and what they refuse."""

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
from tests.analysis.made_support import Protocol, Truth, made
from tests.bench.lsl_support import recorded_streams
from tests.bench.rig_support import PROTOCOL
from tests.bench.wire_support import Served
from tests.command_support import answered

TRUTH = Truth(noise_V=0.01, protocol=Protocol(hold_s=0.2))
DESIGN = 'schema = 1\nname = "one"\n\n[material]\nindex = 1.44\n'


def write(
    path: Path, truth: Truth = TRUTH, header: str = "time_s,angle_deg,left_V,right_V", scale: float = 1.0
) -> Path:
    signals = made(truth)
    rows = np.column_stack([signals.time_s, signals.angle_deg, scale * signals.volts])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.6f")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of a rotation and its calibration."""
    where = tmp_path_factory.mktemp("decode")
    write(where / "S1.csv")
    write(where / "again.csv", replace(TRUTH, seed=5))
    (where / "design.toml").write_text(DESIGN, encoding="utf-8")
    (where / "bend.toml").write_text(f'{DESIGN}\n[motion]\nkind = "bend"\n', encoding="utf-8")
    (where / "emitter.toml").write_text(f'{DESIGN}\n[motion]\npivot = "emitter"\n', encoding="utf-8")
    assert run_command(["bench", "calibrate", str(where / "S1.csv"), "--design", str(where / "design.toml")]) == 0
    return where


@pytest.fixture
def calibration(folder: Path) -> Path:
    return folder / "S1.calibration.json"


def decoded(folder: Path, **more: Any) -> Decoding:
    """What comes of lines of CSV."""
    found = pipeline.decode(folder / "S1.calibration.json", "-", **more).result
    assert isinstance(found, Decoding)
    return found


def test_a_calibration_is_left_beside_its_recording_and_says_what_it_is(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    figure = tmp_path / "one.svg"
    found = answered(
        capfd, "bench", "calibrate", str(folder / "again.csv"), "--out", str(tmp_path / "a.json"),
        "--figure", str(figure), "--motion", "rotation",
    )  # fmt: skip
    (one,) = found["calibrations"]
    assert one["cycles"] == 5
    check = one["leave_one_cycle_out"]["whole"]
    assert check["rms_deg"] < 0.06  # 10 mV over 0.5 V/deg at 0 and 0.1 at the ends, by two receivers
    assert 0.9 < check["within_95"] <= 1.0
    assert "<svg" in figure.read_text(encoding="utf-8")
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


def test_a_recording_is_decoded_to_its_own_angle(
    folder: Path, calibration: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "angles.csv"
    told = answered(capfd, "bench", "decode", str(calibration), str(folder / "again.csv"), "--out", str(out))
    assert told["readings"] == len(made(TRUTH).time_s)
    assert told["against_angle"]["rms_deg"] < 0.06
    assert 0.92 < told["against_angle"]["within_95"] <= 1.0
    assert told["outside"] < 0.01 * told["readings"]
    (named,) = [line for line in told["warnings"] if '--sensor "again"' in line]
    assert named.startswith("note")
    command = ("bench", "decode", str(calibration), str(folder / "again.csv"), "--out", str(out))
    out.write_text("measured once", encoding="utf-8")
    assert "angles.csv; already exists; specify another file, or add --force" in refused(capfd, *command)
    assert out.read_text(encoding="utf-8") == "measured once"
    answered(capfd, *command, "--force")
    other = answered(capfd, "bench", "decode", str(calibration), str(folder / "again.csv"), "--sensor", "again")
    assert any("sensor again instead of S1" in line for line in other["warnings"])
    text = out.read_text(encoding="utf-8").splitlines()
    assert text[0] == ",".join(COLUMNS)
    assert len(text) == told["readings"] + 1
    rows = [line.split(",") for line in text[1:]]
    signals = made(replace(TRUTH, seed=5))
    assert [float(row[1]) for row in rows] == pytest.approx(signals.angle_deg.tolist(), abs=0.35)
    assert {row[6] for row in rows} == {"left", "right"}
    far = np.abs(signals.angle_deg) > 0.5
    assert all(row[6] == ("left" if angle > 0 else "right") for row, angle in zip(rows, signals.angle_deg, strict=True)
               if abs(angle) > 0.5)  # fmt: skip
    assert far.any()
    rising = [row[8] for row, step in zip(rows, np.diff(signals.angle_deg, prepend=0.0), strict=True) if step > 0.05]
    assert rising.count("rising") > 0.5 * len(rising)
    assert rising.count("falling") < 0.05 * len(rising)


def test_lines_are_answered_as_they_come(folder: Path) -> None:
    asked_for: list[str] = []
    answers = io.StringIO()

    def lines() -> Iterator[str]:
        yield "Zeit (s);PD links (mV);PD rechts (mV)\n"
        for number, row in enumerate(("0;2000;2000\n", "0,005;1500,0;2500\n", "0,01;;2500\n", "0,015;oops;1\n", "\n")):
            # everything before this line has been answered when this line is asked for
            assert answers.getvalue().count("\n") == number + 1
            asked_for.append(row)
            yield row

    found = decoded(folder, rows=answers, text=lines())
    assert len(asked_for) == 5
    rows = [line.split(",") for line in answers.getvalue().splitlines()[1:]]
    assert len(rows) == 4
    assert (found.readings, found.missing) == (2, 2)
    assert all(len(row) == len(COLUMNS) for row in rows)
    assert float(rows[0][1]) == pytest.approx(0.0, abs=0.05)
    assert float(rows[1][1]) == pytest.approx(2.0 * np.arctanh(0.5), abs=0.06)
    assert [row[10] for row in rows[2:]] == ["missing", "missing"]
    assert any("cannot be checked" in warning for warning in found.warnings)


def test_lines_without_a_header_have_named_columns(folder: Path) -> None:
    answers = io.StringIO()
    named = SignalOptions(columns=("t", "left_V", "right_V"))
    decoded(folder, signals=named, rows=answers, text=["0.5,2.0,2.0\n"])
    assert answers.getvalue().splitlines()[1].startswith("0.500000,")
    named = SignalOptions(channel=("left=a", "right=b"), rate_hz=200.0)
    decoded(folder, signals=named, rows=answers, text=["a,b\n", "2.0,2.0\n"])


@pytest.mark.parametrize(
    ("header", "assumed", "in_A"),
    [("t,left,right", 3, False), ("t_s,left_V,right_V", 0, False), ("t_s,left (mA),right (mA)", 0, True)],
)
def test_lines_have_the_units_of_a_file(folder: Path, tmp_path: Path, header: str, assumed: int, *, in_A: bool) -> None:
    """Without a unit, lines had that of the calibration, and a file V."""
    known, unit = folder / "S1.calibration.json", 1e3 if in_A else 1.0
    if in_A:
        content = json.loads(known.read_text(encoding="utf-8").replace('_V"', '_A"'))
        known = tmp_path / "A.json"
        known.write_text(json.dumps({**content, "unit": "A"}), encoding="utf-8")
    readings = [f"{0.005 * n:.3f},{unit * (2.0 - 0.02 * n):.6g},{unit * (2.0 + 0.02 * n):.6g}" for n in range(20)]
    source = tmp_path / "file.csv"
    source.write_text("\n".join([header, *readings, ""]), encoding="utf-8")
    answers = []
    for name, text in ((str(source), None), ("-", [header, *readings])):
        rows = io.StringIO()
        found = pipeline.decode(known, name, rows=rows, text=text).result
        answers.append((rows.getvalue(), [line for line in found.warnings if "assumed" in line]))
    assert answers[0][0] == answers[1][0]
    assert [len(lines) for _, lines in answers] == [assumed, assumed]


def test_a_reading_like_the_first_one_is_no_header_again(folder: Path) -> None:
    """Of a sensor at rest many lines are alike; only a header that is written again is left out."""
    answers = io.StringIO()
    named = SignalOptions(columns=("left_V", "right_V"), rate_hz=50.0)
    decoded(folder, signals=named, rows=answers, text=["2.0,2.0\n"] * 3)
    assert [row.split(",")[0] for row in answers.getvalue().splitlines()[1:]] == ["0.000000", "0.020000", "0.040000"]
    headed = ["t_s,left_V,right_V\n", "0.5,2.0,2.0\n"] * 2
    assert decoded(folder, text=headed).readings == 2


@pytest.mark.parametrize("mark", ["\ufeff", "\xef\xbb\xbf"], ids=["UTF-8", "Windows-1252"])
@pytest.mark.parametrize("header", ["t/s,U_L/V,U_R/V", "time_s,left_V,right_V", "Zeit (s);U_L [V];U_R [V]"])
def test_a_header_may_begin_with_a_mark_of_its_byte_order(folder: Path, mark: str, header: str) -> None:
    answers = io.StringIO()
    row = "0.5,2.0,2.0\n" if "," in header else "0,5;2,0;2,0\n"
    found = decoded(folder, rows=answers, text=[f"{mark}{header}\n", row, f"{header}\n", row, f"{mark}{header}\n", row])
    assert (found.readings, found.missing) == (3, 0)
    assert answers.getvalue().splitlines()[1].startswith("0.500000,")


def test_a_stream_without_times_is_refused_unless_its_rate_is_known(folder: Path) -> None:
    lines = ["left_V,right_V\n", "2.0,2.0\n", "2.0,2.0\n"]
    with pytest.raises(DataError, match="--rate-hz"):
        decoded(folder, text=lines)
    answers = io.StringIO()
    decoded(folder, signals=SignalOptions(rate_hz=50.0), rows=answers, text=lines)
    assert [row.split(",")[0] for row in answers.getvalue().splitlines()[1:]] == ["0.000000", "0.020000"]


def test_volts_after_a_stroke_are_two_receivers_of_one_sensor(folder: Path, tmp_path: Path) -> None:
    write(tmp_path / "S1.csv", header="t/s,angle/deg,U_L/V,U_R/V")
    found = pipeline.decode(folder / "S1.calibration.json", str(tmp_path / "S1.csv")).result
    assert isinstance(found, Decoding)
    assert found.against_angle is not None
    assert found.against_angle.rms_deg < 0.06


def test_ctrl_c_ends_a_stream_and_leaves_a_whole_file(folder: Path, tmp_path: Path) -> None:
    def lines() -> Iterator[str]:
        yield "time_s,left_V,right_V\n"
        yield "0,2,2\n"
        raise KeyboardInterrupt

    out = tmp_path / "live.csv"
    found = decoded(folder, out=out, text=lines())
    assert found.interrupted is True
    assert found.readings == 1
    assert len(out.read_text(encoding="utf-8").splitlines()) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["live.csv"]


def test_a_pipe_is_answered_before_it_is_closed(calibration: Path) -> None:
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


def test_all_readings_are_100_percent(folder: Path) -> None:
    lines = ["time_s,left_V,right_V", *(f"{0.01 * n},9,9" for n in range(20))]
    assert any("20 readings (100 %)" in line for line in decoded(folder, text=lines).warnings)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--design", "design.toml"), ""),
        (("--design", "bend.toml"), "does not match the calibration: kind of motion bend instead of rotation"),
        (("--design", "emitter.toml"), "does not match the calibration: pivot emitter instead of stem-base"),
        (("--motion", "bend"), "does not match the calibration: kind of motion bend instead of rotation"),
        ((), "does not specify the kind of motion, pivot, moving parts"),
    ],
)
def test_another_motion_is_warned_of_once(
    folder: Path, calibration: Path, options: tuple[str, ...], words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    named = [str(folder / one) if one.endswith(".toml") else one for one in options]
    warnings = answered(capfd, "bench", "decode", str(calibration), str(folder / "S1.csv"), *named)["warnings"]
    told = [
        line
        for line in warnings
        if "calibration applies" in line or "the calibration: " in line or "calibration is" in line
    ]
    assert len(told) == bool(words)
    assert all(words in line for line in told)


def test_a_pool_of_prints(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    paths = [
        write(tmp_path / f"S{n}.csv", replace(TRUTH, seed=n, swing_V=1.0 + 0.05 * n, offset_V=2.0 + 0.05 * (-1) ** n))
        for n in range(3)
    ]
    found = answered(capfd, "bench", "calibrate", *map(str, paths), "--pool")
    (one,) = found["calibrations"]
    assert one["prints"] == ["S0", "S1", "S2"]
    assert Path(found["files"]["calibration.pooled"]).name == "pooled.calibration.json"
    assert one["leave_one_cycle_out"] is None
    assert [part["name"] for part in one["leave_one_sensor_out"]["parts"]] == ["S0", "S1", "S2"]
    many = answered(capfd, "bench", "calibrate", *map(str, paths))
    assert [Path(file).name for file in many["files"].values()] == [f"S{n}.calibration.json" for n in range(3)]
    told = answered(capfd, "bench", "decode", next(iter(found["files"].values())), str(paths[1]))
    own = answered(capfd, "bench", "decode", str(tmp_path / "S1.calibration.json"), str(paths[1]))
    assert told["against_angle"]["rms_deg"] > own["against_angle"]["rms_deg"]


def refused(capfd: pytest.CaptureFixture[str], *arguments: str) -> str:
    capfd.readouterr()
    assert run_command([*arguments]) == 2
    err = capfd.readouterr().err.strip().splitlines()
    return [line for line in err if line.startswith("solen: ")][-1] if err[-1].startswith("solen: ") else ""


def test_recordings_that_cannot_be_calibrated(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    one = write(tmp_path / "one.csv", header="time_s,angle_deg,top_V,bottom_V")
    assert "no pair of a left and a right receiver" in refused(capfd, "bench", "calibrate", str(one))
    short = write(tmp_path / "short.csv", replace(TRUTH, protocol=Protocol(hold_s=0.2, cycles=2)))
    assert "1 usable cycle" in refused(capfd, "bench", "calibrate", str(short))
    good = write(tmp_path / "good.csv")
    assert "--with-controls" in refused(capfd, "bench", "calibrate", str(good), "--control", "good")
    assert "at least two sensors" in refused(capfd, "bench", "calibrate", str(good), "--pool")
    assert "no sensor has this name" in refused(capfd, "bench", "calibrate", str(good), "--sensor", "S9")
    assert "end in .json" in refused(capfd, "bench", "calibrate", str(good), "--out", "x.toml")
    assert "'rotation', 'bend' or 'loaded'" in refused(capfd, "bench", "calibrate", str(good), "--motion", "twist")
    assert not list(tmp_path.glob("*.json"))


def test_calibrations_that_cannot_be_read(
    folder: Path, calibration: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    data = json.loads(calibration.read_text(encoding="utf-8"))
    bad = tmp_path / "bad.json"

    def told(text: str) -> str:
        bad.write_text(text, encoding="utf-8")
        return refused(capfd, "bench", "decode", str(bad), str(folder / "S1.csv"))

    missing = refused(capfd, "bench", "decode", str(tmp_path / "none.json"), str(folder / "S1.csv"))
    assert "solen bench calibrate" in missing
    assert "not JSON" in told(calibration.read_text(encoding="utf-8")[:500])
    assert "not JSON: NaN is not a valid JSON number" in told('{"kind": "calibration", "schema": NaN}')
    assert "is not the calibration of a sensor" in told('{"kind": "analysis"}')
    assert "is not the calibration of a sensor" in told("[1, 2]")
    assert "written by a newer solen" in told(json.dumps(data | {"schema": 2}))
    assert "schema is missing" in told(json.dumps({key: data[key] for key in data if key != "schema"}))
    assert "curves" in told(json.dumps({key: data[key] for key in data if key != "curves"}))
    assert "unknown key" in told(json.dumps(data | {"colour": "red"}))
    curves = data["curves"]
    assert "one for each angle" in told(json.dumps(data | {"curves": curves | {"rising_V": curves["rising_V"][1:]}}))
    assert "must ascend" in told(json.dumps(data | {"curves": curves | {"angle_deg": curves["angle_deg"][::-1]}}))
    wrong = [[1e-6, 1e-3, 1e-6]] * len(curves["angle_deg"])
    assert "not a covariance" in told(json.dumps(data | {"curves": curves | {"noise_V2": wrong}}))
    assert "no such file" in refused(capfd, "bench", "decode", str(tmp_path / "none.json"), str(folder / "S1.csv"))


def test_a_calibration_not_to_be_used_marks_its_angles(
    folder: Path, calibration: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    data = json.loads(calibration.read_text(encoding="utf-8"))
    data["warnings"] = ["do not use: only 40 % lie within the bands", "two cycles"]
    poor, out = tmp_path / "poor.json", tmp_path / "angles.csv"
    poor.write_text(json.dumps(data), encoding="utf-8")
    found = answered(capfd, "bench", "decode", str(poor), str(folder / "S1.csv"), "--out", str(out))
    doubt = "calibration: do not use: only 40 % lie within the bands"
    assert doubt in found["warnings"]
    assert not any("two cycles" in line for line in found["warnings"])
    lines = out.read_text(encoding="utf-8").splitlines()
    assert lines[0] == f"# {doubt}"
    assert lines[1].startswith("time_s,")


def test_streams_that_cannot_be_decoded(
    folder: Path, calibration: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def told(*lines: str, **more: Any) -> str:
        with pytest.raises(DataError) as bad:
            decoded(folder, text=lines, **more)
        return str(bad.value)

    assert "is empty" in told()
    assert "is empty" in told("\n", "\n")
    assert "holds no reading" in told("time_s,left_V,right_V\n")
    assert "holds no reading" in told("time_s,left_V,right_V\n", "0,nan,1\n")
    assert "no columns are recognised as the right receiver" in told("time_s,left_V\n", "0,1\n")
    assert "2 columns are recognised as the left receiver" in told("t,left_V,left2_L,right_V\n", "0,1,1,1\n")
    assert "begins with numbers" in told("0,2,2\n")
    assert "--time stage; no such column" in told("t,left_V,right_V\n", signals=SignalOptions(time="stage"))
    assert "left_mV" in told("t,left,right\n", "0,2000,2000\n")
    with pytest.raises(SpecError, match="--smooth-ms; applies to recorded files"):
        decoded(folder, signals=SignalOptions(smooth_ms=25.0), text=["t,left_V,right_V\n", "0,2,2\n"])
    milli = write(tmp_path / "milli.csv", scale=1000.0)
    assert "left_mV" in refused(capfd, "bench", "decode", str(calibration), str(milli), "--json")
    assert "no such file" in refused(capfd, "bench", "decode", str(calibration), str(tmp_path / "no.csv"))
    assert "--follow" in refused(capfd, "bench", "decode", str(calibration), str(milli), "--follow")
    assert "end in .csv" in refused(capfd, "bench", "decode", str(calibration), str(milli), "--out", "a.json")
    for more in ((), ("--force",)):
        itself = refused(capfd, "bench", "decode", str(calibration), str(milli), "--out", str(milli), *more)
        assert "input file" in itself
    assert "voltage without light" in refused(
        capfd, "bench", "decode", str(calibration), str(milli), "--gain-percent", "5"
    )
    out = tmp_path / "out.csv"
    assert "left_mV" in refused(capfd, "bench", "decode", str(calibration), str(milli), "--out", str(out))
    assert not out.exists()
    nowhere = str(tmp_path / "none" / "out.csv")
    assert "cannot be written" in refused(
        capfd, "bench", "decode", str(calibration), str(folder / "S1.csv"), "--out", nowhere
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["milli.csv"]


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


def test_a_run_is_calibrated_and_its_journal_followed(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "sensor.toml").write_text(DESIGN, encoding="utf-8")
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    (tmp_path / "protocol.toml").write_text(PROTOCOL.replace("cycles = 3", "cycles = 4"), encoding="utf-8")
    whole = tmp_path / "kept.journal"
    original = Journal.end

    def keep(self: Journal, **more: Any) -> None:
        original(self, **more)
        whole.write_bytes(self.path.read_bytes())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Journal, "end", keep)
        record(tmp_path / "protocol.toml", tmp_path / "rig.toml", tmp_path)
    found = answered(capfd, "bench", "calibrate", str(tmp_path / "protocol.nc"))
    (one,) = found["calibrations"]
    assert one["circuit"]["ambient"] == "subtracted"
    assert one["motion"]["pivot"] == "stem-base"
    assert one["motion"]["protocol"] == "short"
    assert found["simulated"] is True
    # a point emitter's response saturates within a degree: beyond, little is known, and the bands say so
    assert one["leave_one_cycle_out"]["whole"]["rms_deg"] < 0.3
    assert one["leave_one_cycle_out"]["whole"]["within_95"] > 0.9
    told = answered(capfd, "bench", "decode", next(iter(found["files"].values())), str(tmp_path / "protocol.nc"))
    assert told["against_angle"]["rms_deg"] < 0.3
    assert not [line for line in told["warnings"] if "calibration is" in line]

    data = whole.read_bytes()
    stopped = answered(capfd, "bench", "decode", next(iter(found["files"].values())), str(whole))

    # the same journal as it grows: a piece now and then, cut anywhere
    growing = tmp_path / "growing.journal"
    cuts = [*np.linspace(len(data) // 3, len(data), 6).astype(int).tolist()]
    growing.write_bytes(data[: cuts[0]])

    def grow() -> None:
        for begin, end in pairwise(cuts):
            time.sleep(0.05)
            with growing.open("ab") as file:
                file.write(data[begin:end])

    thread = threading.Thread(target=grow)
    thread.start()
    followed = answered(capfd, "bench", "decode", next(iter(found["files"].values())), str(growing), "--follow")
    thread.join()
    assert followed["readings"] == stopped["readings"] > 300
    assert (followed["to_s"], followed["highest_deg"]) == (stopped["to_s"], stopped["highest_deg"])
    # its readings are those of the closed recording
    fresh = next(iter(JournalFollower(whole).readings("A")))
    from solen.recording import read_parts

    ((_, closed),) = list(read_parts(tmp_path / "protocol.nc"))
    assert fresh.volts[:, 0] == pytest.approx(closed.channel("left").values, abs=1e-12)
    assert fresh.volts[:, 1] == pytest.approx(closed.channel("right").values, abs=1e-12)
    (tmp_path / "no.journal").write_bytes(b"something else")
    assert "is not a journal of solen" in refused(
        capfd, "bench", "decode", next(iter(found["files"].values())), str(tmp_path / "no.journal")
    )


def test_a_reading_without_a_time_is_missing_and_a_clock_may_be_set_back(folder: Path) -> None:
    answers = io.StringIO()
    steps = (f"{0.005 * n},{2 - 0.1 * n},{2 + 0.1 * n}\n" for n in range(5))
    lines = ["time_s,left_V,right_V\n", ",2,2\n", "9,2,2\n", *steps]
    found = decoded(folder, rows=answers, text=lines)
    assert (found.readings, found.missing) == (6, 1)
    rows = [line.split(",") for line in answers.getvalue().splitlines()[1:]]
    assert rows[0][10] == "missing"
    assert rows[2][8] == ""  # the reading before is of another time
    assert rows[-1][8] == "rising"
    assert float(rows[-1][9]) > 0.975


LIVE = "time_s,left_V,right_V\n0.0,-1.0,-1.2\n0.1,-1.0,-1.3\n0.2,,-1.0\n"


def test_angles_go_out_as_datagrams(folder: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind(("127.0.0.1", 0))
        there.settimeout(5.0)
        where = f"udp://127.0.0.1:{there.getsockname()[1]}"
        shown = io.StringIO()
        decoded(folder, text=io.StringIO(LIVE), rows=shown, send=where)
        got = [there.recv(4096).decode("ascii") for _ in range(4)]
    assert got == shown.getvalue().splitlines()
    assert got[0] == ",".join(COLUMNS)


def test_angles_go_out_over_a_serial_line(folder: Path) -> None:
    heard = bytearray()

    class Listens:
        def reply(self, data: bytes) -> bytes:
            heard.extend(data)
            return b""

    shown = io.StringIO()
    with Served(Listens()) as served:
        decoded(folder, text=io.StringIO(LIVE), rows=shown, send=f"serial:{served.url}@9600")
        due = time.monotonic() + 5.0
        while heard.count(b"\n") < 4 and time.monotonic() < due:
            time.sleep(0.01)
    assert heard.decode("ascii") == shown.getvalue()


def test_angles_go_out_as_a_stream_of_samples(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = recorded_streams(monkeypatch)
    shown = io.StringIO()
    decoded(folder, text=io.StringIO(LIVE), rows=shown, send="lsl:finger")
    assert told[0] == ("finger", "Angle", 4, 0.0, 2, "solen-finger")
    assert [value for _, value in told[1:5]] == ["time_s", "angle_deg", "low95_deg", "high95_deg"]
    rows = [dict(zip(COLUMNS, row.split(","), strict=True)) for row in shown.getvalue().splitlines()[1:]]
    sent = [values for values, at_s in told[5:] if at_s == 7.5]
    assert len(sent) == len(rows) == 3
    assert sent[0] == [float(rows[0][name]) for name in ("time_s", "angle_deg", "low95_deg", "high95_deg")]
    assert np.isnan(sent[2][1])


NONE = ["udp://127.0.0.1", "udp:127.0.0.1:99999999", "serial:", "serial:COM5@fast", "tcp://x:1"]


@pytest.mark.parametrize("where", NONE)
def test_an_outlet_that_is_none_is_refused(folder: Path, where: str) -> None:
    with pytest.raises(SpecError, match=r"--send = .*udp://HOST:PORT"):
        decoded(folder, text=io.StringIO(LIVE), send=where)


class Stamped:
    """An outlet that keeps when each row came."""

    def __init__(self, clock: SimulatedClock) -> None:
        self.clock, self.rows = clock, list[tuple[float, str]]()

    def write(self, text: str) -> None:
        self.rows.append((self.clock.now_s(), text))

    def flush(self) -> None:
        """Nothing waits."""


def test_rows_of_a_recording_are_sent_at_the_pace_of_their_times() -> None:
    clock = SimulatedClock(100.0)
    stamped = Stamped(clock)
    paced = Paced(stamped, clock)
    paced.write("time_s,angle_deg\n")
    paced.write("7.0,1.0\n7.5,1.5\n,missing\n")
    clock.sleep(1.0)  # decoding took so long: what is late goes at once
    paced.write("8.0,2.0\n9.0,3.0\n")
    assert [(round(at, 9), row.split(",")[0]) for at, row in stamped.rows] == [
        (100.0, "time_s"), (100.0, "7.0"), (100.5, "7.5"), (100.5, ""), (101.5, "8.0"), (102.0, "9.0"),
    ]  # fmt: skip


def test_a_recording_goes_out_paced(calibration: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    waited: list[float] = []
    monkeypatch.setattr(WallClock, "sleep", lambda _, duration_s: waited.append(duration_s))
    path = tmp_path / "short.csv"
    path.write_text("time_s,left_V,right_V\n" + "".join(f"{10 * n},2,2\n" for n in range(20)), encoding="utf-8")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        pipeline.decode(calibration, str(path), send=f"udp://127.0.0.1:{receiver.getsockname()[1]}")
    assert waited == pytest.approx([10.0 * n for n in range(1, 20)], abs=5.0)  # nothing waits here, nor does time pass
