"""`solen bench analyse` on files in the conventions of others."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from solen.analysis import AnalysisOptions, Study, study
from solen.cli import run_command
from solen.errors import DataError, SpecError
from solen.pipeline.bench import analyse as pipeline
from solen.report.options import FigureOptions
from solen.samples import sample
from tests.analysis.simulated_support import Protocol, Truth, made

TRUTH = Truth(noise_V=0.01)


def write(path: Path, truth: Truth, header: str = "time_s,angle_deg,left_V,right_V", mark: str = ".") -> Path:
    separator = ";" if ";" in header else ","
    signals = made(truth)
    rows = np.column_stack([signals.time_s, signals.angle_deg, signals.volts])
    lines = [separator.join(f"{value:.5f}".replace(".", mark) for value in row) for row in rows.tolist()]
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def cycles_of(found: Study, label: str) -> int:
    return len(found.sensors[label].runs[0].motion.cycles)


def result(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    assert run_command(["bench", "analyse", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_columns_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "one.csv", TRUTH, "Clock (ms);stage;ai0;ai1", ",")
    path.write_text(path.read_text(encoding="utf-8").replace("(ms)", "(s)"), encoding="utf-8")
    found = result(
        capsys, str(path), "--time", "Clock (s)", "--angle", "stage", "--channel", "left=ai0", "--channel", "right=ai1"
    )
    sensor = found["sensors"]["one"]
    (run,) = sensor["runs"]
    assert len(run["motion"]["cycles"]) == 6
    assert run["used"] == [1, 2, 3, 4, 5]
    right = sensor["receivers"]["right"]
    assert right["mean_V"] == pytest.approx(TRUTH.response_V(np.array(right["angle_deg"]))[:, 1].tolist(), abs=0.02)
    assert len(right["sd_V"]) == len(right["angle_deg"]) == len(right["rising"]["mean_V"])
    assert any("specifies no unit; V is assumed" in warning for warning in found["warnings"])


def test_an_unknown_unit_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = result(capsys, str(write(tmp_path / "one.csv", TRUTH, "time (s);angle (deg);left (foo);right (foo)", ",")))
    assert any('"foo"' in warning and "V is assumed" in warning for warning in found["warnings"])
    found = result(capsys, str(write(tmp_path / "one.csv", TRUTH, "time (s);angle (deg);left (foo);right [V]", ",")))
    assert any('left (foo) is not used, because "foo"' in warning for warning in found["warnings"])


def test_german_headers_are_recognised(tmp_path: Path) -> None:
    path = write(tmp_path / "messung.csv", TRUTH, "Zeit (s);Winkel (°);PD links (V);PD rechts (V)", ",")
    found = study([path]).to_dict()
    sensor = found["sensors"]["messung"]
    assert list(sensor["receivers"]) == ["PD links", "PD rechts"]
    assert sensor["left_minus_right"]["swing_V"] < 0.0


def test_units_are_converted(tmp_path: Path) -> None:
    signals = made(TRUTH)
    rows = np.column_stack([1e3 * signals.time_s, np.radians(signals.angle_deg), 1e3 * signals.volts])
    path = tmp_path / "units.csv"
    np.savetxt(path, rows, delimiter=",", header="t_ms,angle_rad,left_mV,right_mV", comments="", fmt="%.8g")
    found = study([path]).to_dict()["sensors"]["units"]
    assert found["receivers"]["right"]["range_V"] == pytest.approx(1.81, abs=0.03)
    assert found["runs"][0]["motion"]["high_deg"] == pytest.approx(3.0, abs=0.01)
    assert found["runs"][0]["motion"]["cycles"][1]["start_s"] == pytest.approx(3.4, abs=0.02)


@pytest.mark.parametrize(("unit", "key"), [("pF", "pF"), ("a.u.", "a_u"), ("counts", "counts"), ("kΩ", "kΩ")])
def test_units_are_free(tmp_path: Path, capsys: pytest.CaptureFixture[str], unit: str, key: str) -> None:
    """Nothing is taken for volts that is none: keys, lines, axes and warnings say what the recording says."""
    path = write(tmp_path / "S1.csv", replace(TRUTH, noise_V=0.002), f"time_s,angle_deg,left ({unit}),right ({unit})")
    figure = tmp_path / "response.svg"
    found = result(capsys, str(path), "--figure", str(figure), "--traces", str(tmp_path / "traces.svg"))
    sensor = found["sensors"]["S1"]
    assert sensor["unit"] == unit
    right = sensor["receivers"]["right"]
    assert right[f"range_{key}"] == pytest.approx(2.0 * np.tanh(1.5), rel=0.02)
    assert {f"mean_{key}", f"u_sensitivity_{key}_per_deg"} <= set(right)
    assert not [name for name in (*right, *sensor["left_minus_right"]) if "_V" in name]
    assert f"signal ({unit})" in figure.read_text(encoding="utf-8")
    assert run_command(["bench", "analyse", str(path)]) == 0
    said = capsys.readouterr().out
    assert f" {unit}/°" in said
    assert " V" not in said.replace("VL", "")
    assert run_command(["bench", "calibrate", str(path)]) == 0
    assert run_command(["bench", "diagnose", str(path)]) == 2  # a model of a circuit takes volts
    assert unit in capsys.readouterr().err


def test_receivers_of_two_units_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "S1.csv", TRUTH, "time_s,angle_deg,left (pF),right (lux)")
    with pytest.raises(DataError, match="lux"):
        study([path], AnalysisOptions(channel=("left=left", "right=right")))


def test_labels_lens_and_runs_from_names(tmp_path: Path) -> None:
    paths = [
        write(tmp_path / f"{name}.csv", replace(TRUTH, swing_V=swing, seed=seed))
        for seed, (name, swing) in enumerate(
            {"S1_lens_1": 1.0, "S1_lens_2": 1.0, "S2_lens_1": 1.2, "S3_nolens_1": 0.01}.items()
        )
    ]
    found = study(paths, AnalysisOptions(pattern="{sensor}_{lens}_{run}.csv")).to_dict()
    assert list(found["sensors"]) == ["S1", "S2", "S3"]
    assert found["sensors"]["S1"]["cycles_used"] == 10
    assert [found["sensors"][name]["lens"] for name in ("S1", "S2", "S3")] == [True, True, False]
    assert found["mean_of_sensors"]["n"] == 2
    assert found["lens_beside_none"]["right_V"]["without_lens_percent"] == pytest.approx(100 * 0.01 / 1.1, abs=0.5)
    assert len(found["sources"]) == 4


def test_several_sensors_in_one_file(tmp_path: Path) -> None:
    signals = made(TRUTH)
    rows = np.column_stack([signals.time_s, signals.angle_deg, signals.volts, 2.0 + 0.01 * (signals.volts - 2.0)])
    path = tmp_path / "rig.csv"
    np.savetxt(path, rows, delimiter=",", header="time_s,angle_deg,S1_L,S1_R,S4_L,S4_R", comments="", fmt="%.7g")
    found = study([path], AnalysisOptions(control=("S4",))).to_dict()
    assert list(found["sensors"]) == ["S1", "S4"]
    assert list(found["sensors"]["S1"]["receivers"]) == ["left", "right"]
    assert found["lens_beside_none"]["right"]["without_lens_percent"] == pytest.approx(1.0, abs=0.01)
    other = AnalysisOptions(channel=("A.l=S1_L", "A.r=S1_R", "B.l=S4_L", "B.r=S4_R"))
    assert list(study([path], other).sensors) == ["A", "B"]


def test_a_table_without_times_has_a_rate(tmp_path: Path) -> None:
    signals = made(TRUTH)
    path = tmp_path / "raw.txt"
    np.savetxt(path, np.column_stack([signals.angle_deg, signals.volts]), delimiter="\t", fmt="%.6f")
    options = AnalysisOptions(columns=("angle_deg", "left_V", "right_V"), rate_hz=200.0)
    assert cycles_of(study([path], options), "raw") == 6


def test_smoothing_is_said_in_result_and_figures(tmp_path: Path) -> None:
    path = write(tmp_path / "one.csv", TRUTH)
    figure, traces = tmp_path / "response.svg", tmp_path / "traces.svg"
    options = AnalysisOptions(smooth_ms=25.0)
    found = pipeline.analyse(
        path, options=options, figure=FigureOptions(figure=figure), traces=traces, out=tmp_path / "one.json"
    )
    assert found.to_dict()["options"]["smooth_ms"] == 25.0
    for drawn in (figure, traces):
        assert "moving mean over 25 ms" in drawn.read_text(encoding="utf-8")
    assert json.loads((tmp_path / "one.json").read_text(encoding="utf-8"))["kind"] == "analysis"
    pipeline.analyse(path, figure=FigureOptions(figure=figure))
    assert "moving mean" not in figure.read_text(encoding="utf-8")


def test_a_simulated_recording_is_called_so(tmp_path: Path) -> None:
    path = write(tmp_path / "one.csv", TRUTH)
    path.write_text("# simulated: yes\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    figure = tmp_path / "response.svg"
    assert pipeline.analyse(path, figure=FigureOptions(figure=figure)).result.simulated is True
    assert "simulated data" in figure.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (AnalysisOptions(angle="angel"), "one.csv: --angle angel; no such column; its columns are time, angle, left_V"),
        (AnalysisOptions(time="stamp"), "no such column; its columns are"),
        (AnalysisOptions(channel=("left=V_L",)), "--channel V_L; no such column; its columns are"),
    ],
)
def test_a_wrong_name_lists_the_columns_there_are(tmp_path: Path, options: AnalysisOptions, said: str) -> None:
    path = write(tmp_path / "one.csv", TRUTH)
    with pytest.raises(DataError) as refused:
        study([path], options)
    assert said in str(refused.value)


def test_what_cannot_be_known_is_asked_for(tmp_path: Path) -> None:
    path = write(tmp_path / "one.csv", TRUTH, "time_s,how far,left_V,right_V")
    with pytest.raises(DataError, match="name an angle column with --angle, a stage log"):
        study([path])
    path = write(tmp_path / "two.csv", TRUTH, "n,angle_deg,left_V,right_V")
    with pytest.raises(DataError, match="name the time column with --time, or specify the rate with --rate-hz"):
        study([path])
    signals = made(TRUTH)
    rows = np.column_stack([1e3 * signals.time_s, signals.angle_deg, signals.volts])
    np.savetxt(path, rows, delimiter=",", header="timestamp,angle_deg,left_V,right_V", comments="", fmt="%.8g")
    with pytest.raises(DataError, match="specify --time-unit"):
        study([path])
    assert cycles_of(study([path], AnalysisOptions(time_unit="ms")), "two") == 6


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"pattern": "one.csv"}, "has no field"),
        ({"control": ("S9",)}, "no sensor has this name"),
        ({"smooth_ms": -1.0}, "smooth_ms"),
        ({"smooth_ms": 1e6}, "a twentieth of the duration of one.csv"),
        ({"zero_deg": math.nan}, "finite number"),
        ({"dark_V": math.inf}, "finite number"),
        ({"angle_time": "t"}, "--angle-file"),
        ({"amplitude_deg": 3.0, "angle": "angle"}, "without an angle"),
        ({"rails": (5.0, 0.0)}, "lowest and the highest"),
        ({"rate_hz": 200.0, "time": "t"}, "--time"),
        ({"channel": ("=x",)}, "NAME=COLUMN"),
        ({"channel": ("left=left_V", "left=right_V")}, "is named twice"),
        ({"channel": ("left=left_V", "right=left_V")}, "has two roles"),
        ({"angle_file": (Path("a"), Path("b"))}, "one log for all recordings"),
    ],
)
def test_options_that_cannot_be(tmp_path: Path, options: dict[str, Any], said: str) -> None:
    path = write(tmp_path / "one.csv", TRUTH)
    with pytest.raises(SpecError, match=said):
        study([path], AnalysisOptions(**options))


def test_files_that_cannot_be(tmp_path: Path) -> None:
    path = write(tmp_path / "one.csv", TRUTH)
    with pytest.raises(SpecError, match="at least one recording"):
        study([])
    with pytest.raises(SpecError, match="is named twice"):
        study([path, path])
    with pytest.raises(DataError, match="is not named as"):
        study([path], AnalysisOptions(pattern="{sensor}_{run}.csv"))
    with pytest.raises(DataError, match="more than 20,000 points"):
        study([path], AnalysisOptions(step_deg=1e-9))


def test_a_log_on_another_clock(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    signals = made(TRUTH)
    volts, log = tmp_path / "daq.csv", tmp_path / "stage.csv"
    np.savetxt(
        volts, np.column_stack([signals.time_s, signals.volts]), delimiter=",", header="time_s,L_V,R_V", comments=""
    )
    rows = np.column_stack([1e3 * (signals.time_s[::5] + 7.25), signals.angle_deg[::5]])
    np.savetxt(log, rows, delimiter=";", header="t_ms;pos_deg", comments="", fmt="%.6f")
    found = result(capsys, str(volts), "--angle-file", str(log))
    assert found["alignment"]["daq"]["lag_s"] == pytest.approx(7.25, abs=1e-3)
    assert len(found["sensors"]["daq"]["runs"][0]["motion"]["cycles"]) == 6
    assert len(found["sources"]) == 2
    np.savetxt(log, rows[:, 1], header="pos_deg", comments="")
    assert run_command(["bench", "analyse", str(volts), "--angle-file", str(log)]) == 2
    assert "--angle-time, or specify the rate with --angle-rate-hz" in capsys.readouterr().err


def test_an_angle_that_nobody_recorded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    signals = made(TRUTH)
    path = tmp_path / "daq.csv"
    np.savetxt(
        path, np.column_stack([signals.time_s, signals.volts]), delimiter=",", header="time_s,L_V,R_V", comments=""
    )
    found = result(capsys, str(path), "--amplitude-deg", "3")
    assert len(found["sensors"]["daq"]["runs"][0]["motion"]["cycles"]) == 6
    assert any("no angle was recorded" in warning for warning in found["warnings"])
    assert run_command(["bench", "analyse", str(path)]) == 2
    assert "specify --amplitude-deg" in capsys.readouterr().err


def waveform(truth: Truth, rate_hz: float, sample_hz: float) -> tuple[Any, Any, Any]:
    """Times, angles and voltages of a sensor whose emitter switches, in light that flickers and drifts."""
    end = truth.protocol.corners()[0][-1]
    time_s = np.arange(0.0, end, 1.0 / sample_hz)
    angle = truth.protocol.angle_deg(time_s)
    on = (time_s * rate_hz) % 1.0 < 0.5
    pulled = 4.5 - truth.response_V(angle)  # what light of the emitter pulls down
    flicker = 0.3 + 0.2 * np.sin(2.0 * np.pi * 100.3 * time_s) + 0.1 * time_s / end
    volts = 5.0 - on[:, None] * pulled - flicker[:, None]
    draw = np.random.default_rng(truth.seed)
    return time_s, angle, volts + truth.noise_V * draw.standard_normal(volts.shape)


def test_ambient_light_is_taken_out_of_raw_waveforms(tmp_path: Path) -> None:
    """100 Hz of 0.2 V in readings at 200 Hz: on less the mean of both off phases leaves less than a hundredth of it."""
    truth = Truth(noise_V=0.01)
    time_s, angle, volts = waveform(truth, 200.0, 8000.0)
    path = tmp_path / "raw.csv"
    rows = np.column_stack([time_s, angle, volts])
    np.savetxt(path, rows, delimiter=",", header="time_s,angle_deg,left_V,right_V", comments="", fmt="%.5f")
    found = study([path], AnalysisOptions(on_off_hz=200.0)).to_dict()
    sensor = found["sensors"]["raw"]
    assert found["dark_V"] == 0.0
    assert sensor["left_minus_right"]["contrast"]["at_low"] > 0.1
    right = sensor["receivers"]["right_V"]
    expected = truth.response_V(np.array(right["angle_deg"]))[:, 1] - 4.5
    apart = np.array(right["mean_V"]) - expected
    assert np.abs(apart - apart.mean()).max() < 0.02
    assert abs(right["drift_V_per_min"]) < 4.0 * right["u_drift_V_per_min"] + 0.01
    assert right["mean_hysteresis_V"] == pytest.approx(0.0, abs=0.01)


def test_a_file_of_several_sensors_by_groups(tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    with h5py.File(path, "w") as file:
        file.attrs["simulated"] = "yes"
        for name, swing in (("S1", 1.0), ("S2", 1.1), ("C", 0.01)):
            signals = made(replace(TRUTH, swing_V=swing))
            group = file.create_group(name)
            group.attrs["lens"] = "no" if name == "C" else "yes"
            columns = {"time_s": signals.time_s, "angle_deg": signals.angle_deg}
            columns |= {"left": signals.volts[:, 0], "right": signals.volts[:, 1], "right_ambient": signals.volts[:, 0]}
            columns |= {"right_clipped": 1.0 * (np.arange(signals.time_s.size) == 900)}
            for key, values in columns.items():
                unit = {"time_s": "s", "angle_deg": "deg", "right_clipped": "1"}.get(key, "V")
                group.create_dataset(key, data=values).attrs["units"] = unit
    found = study([path]).to_dict()
    assert list(found["sensors"]) == ["C", "S1", "S2"]
    assert [one["lens"] for one in found["sensors"].values()] == [False, True, True]
    assert list(found["sensors"]["S1"]["receivers"]) == ["left", "right"]
    assert found["sensors"]["S1"]["receivers"]["right"]["clipped_samples"] == 1
    assert found["simulated"] is True
    assert found["dark_V"] is None  # only one of the two receivers has its ambient light beside it
    assert found["mean_of_sensors"]["n"] == 2
    assert len(found["sources"]) == 1


def test_the_shipped_recording_answers_as_the_paper_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At −3° the right receiver's voltage falls and the left's rises; without a lens a tenth of it is left."""
    path = tmp_path / "recording.csv"
    path.write_bytes(sample("rotation-simulated.csv"))
    found = result(capsys, str(path))
    assert found["simulated"] is True
    assert list(found["sensors"]) == ["S1", "S2", "S3", "C"]
    for label in ("S1", "S2", "S3"):
        sensor = found["sensors"][label]
        right, left = (np.array(sensor["receivers"][side]["mean_V"]) for side in ("right", "left"))
        middle = right.size // 2
        assert right[0] < right[middle] < right[-1]
        assert left[0] > left[middle] > left[-1]
        assert len(sensor["runs"][0]["motion"]["cycles"]) == 6
    assert found["lens_beside_none"]["right"]["without_lens_percent"] < 10.0
    assert not any("convention" in warning for warning in found["warnings"])


@pytest.mark.evidence
def test_the_shipped_recording_is_what_its_script_writes() -> None:
    from tools.recording import recording

    text = sample("rotation-simulated.csv").decode()
    made = recording()
    numbers = [np.loadtxt(lines.splitlines(), delimiter=",", skiprows=4) for lines in (text, made)]
    assert text.split("\n")[:4] == made.split("\n")[:4]
    assert numbers[1] == pytest.approx(numbers[0], abs=1.5e-3)  # a step of the converter, as others round


def test_what_a_recording_cannot_say_is_said(tmp_path: Path) -> None:
    signals = made(TRUTH)

    def warnings(angle_deg: Any, volts: Any) -> str:
        path = tmp_path / "one.csv"
        rows = np.column_stack([signals.time_s, angle_deg, volts])
        np.savetxt(path, rows, delimiter=",", header="time_s,angle_deg,left_V,right_V", comments="", fmt="%.5f")
        found = study([path])
        json.dumps(found.to_dict(), allow_nan=False)
        return " | ".join(found.warnings)

    assert "set the zero there with --zero-deg 90" in warnings(signals.angle_deg + 90.0, signals.volts)
    told = warnings(signals.angle_deg, 0.0 * signals.volts + 2.5)
    assert "does not respond to the angle" in told
    assert "both move" not in told


def test_recordings_of_one_name_are_pooled_with_a_warning(tmp_path: Path) -> None:
    path = write(tmp_path / "one.csv", TRUTH)
    other = tmp_path / "other"
    other.mkdir()
    found = study([path, write(other / "one.csv", replace(TRUTH, seed=2))])
    assert any("pooled as one sensor" in warning for warning in found.warnings)


@pytest.mark.evidence
def test_an_hour_of_eight_receivers_at_200_hz(tmp_path: Path) -> None:
    """Analysed with both figures of 300 dpi in less than 600 MB, from a table and from arrays."""
    resource = pytest.importorskip("resource")
    del resource
    signals = made(replace(TRUTH, protocol=Protocol(cycles=1499)))
    table, arrays = tmp_path / "hour.csv", tmp_path / "hour.nc"
    names = [f"S{n}.{side}_V" for n in range(1, 5) for side in ("left", "right")]
    rows = np.column_stack([signals.time_s, signals.angle_deg, *4 * [signals.volts]])
    np.savetxt(table, rows, delimiter=",", header=",".join(["time_s", "angle_deg", *names]), comments="", fmt="%.5f")
    with h5py.File(arrays, "w") as file:
        for n in range(1, 5):
            columns = {"time_s": signals.time_s, "angle_deg": signals.angle_deg}
            for key, values in (columns | {"left_V": signals.volts[:, 0], "right_V": signals.volts[:, 1]}).items():
                file.create_dataset(f"S{n}/{key}", data=values)
    del rows
    for path in (table, arrays):
        done = subprocess.run(
            [sys.executable, "-c", HOUR, str(path), str(tmp_path)], capture_output=True, text=True, check=True
        )
        print(f"{path.name}: {float(done.stdout):.0f} MB")
        assert float(done.stdout) < 600.0


HOUR = """
import resource, sys
from pathlib import Path
from solen.report.options import FigureOptions
from solen.pipeline.bench import analyse as pipeline
from solen.report.options import FigureOptions
file, folder = map(Path, sys.argv[1:])
found = pipeline.analyse(file, figure=FigureOptions(figure=folder / "a.png"), traces=folder / "b.png").result
assert [len(one.runs[0].motion.cycles) for one in found.sensors.values()] == 4 * [1499]
used = resource.getrusage(resource.RUSAGE_SELF)
print(used.ru_maxrss / (1024.0 if sys.platform == "linux" else 1024.0**2))
"""
