"""`solen bench analyse` for files of other programs."""

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
from tests.analysis.simulated_support import Protocol, Truth, simulated

TRUTH = Truth(noise_V=0.01)


def write(path: Path, truth: Truth, header: str = "time_s,angle_deg,left_V,right_V", decimal: str = ".") -> Path:
    """Write a simulated recording as a table."""
    separator = ";" if ";" in header else ","
    signals = simulated(truth)
    rows = np.column_stack([signals.time_s, signals.angle_deg, signals.volts])
    lines = [separator.join(f"{value:.5f}".replace(".", decimal) for value in row) for row in rows.tolist()]
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def cycle_count(result: Study, label: str) -> int:
    return len(result.sensors[label].runs[0].motion.cycles)


def analysed(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    """Return the result that the command prints with ``--json``."""
    assert run_command(["bench", "analyse", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_assigns_columns_by_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "S1.csv", TRUTH, "Clock (s);stage;ai0;ai1", ",")
    result = analysed(
        capsys, str(path), "--time", "Clock (s)", "--angle", "stage", "--channel", "left=ai0", "--channel", "right=ai1"
    )
    sensor = result["sensors"]["S1"]
    (run,) = sensor["runs"]
    assert len(run["motion"]["cycles"]) == 6
    assert run["used"] == [1, 2, 3, 4, 5]
    right = sensor["receivers"]["right"]
    assert right["mean_V"] == pytest.approx(TRUTH.response_V(np.array(right["angle_deg"]))[:, 1].tolist(), abs=0.02)
    assert len(right["sd_V"]) == len(right["angle_deg"]) == len(right["rising"]["mean_V"])
    assert any("specifies no unit; V is assumed" in warning for warning in result["warnings"])


def test_warns_of_an_unknown_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "S1.csv", TRUTH, "time (s);angle (deg);left (foo);right (foo)", ",")
    warnings = analysed(capsys, str(path))["warnings"]
    assert any('"foo"' in warning and "V is assumed" in warning for warning in warnings)
    path = write(tmp_path / "S1.csv", TRUTH, "time (s);angle (deg);left (foo);right [V]", ",")
    warnings = analysed(capsys, str(path))["warnings"]
    assert any('left (foo) is not used, because "foo"' in warning for warning in warnings)


def test_recognises_german_headers(tmp_path: Path) -> None:
    path = write(tmp_path / "messung.csv", TRUTH, "Zeit (s);Winkel (°);PD links (V);PD rechts (V)", ",")
    sensor = study([path]).to_dict()["sensors"]["messung"]
    assert list(sensor["receivers"]) == ["PD links", "PD rechts"]
    assert sensor["left_minus_right"]["swing_V"] < 0.0


def test_converts_units(tmp_path: Path) -> None:
    signals = simulated(TRUTH)
    rows = np.column_stack([1e3 * signals.time_s, np.radians(signals.angle_deg), 1e3 * signals.volts])
    path = tmp_path / "units.csv"
    np.savetxt(path, rows, delimiter=",", header="t_ms,angle_rad,left_mV,right_mV", comments="", fmt="%.8g")
    sensor = study([path]).to_dict()["sensors"]["units"]
    assert sensor["receivers"]["right"]["range_V"] == pytest.approx(1.81, abs=0.03)
    assert sensor["runs"][0]["motion"]["high_deg"] == pytest.approx(3.0, abs=0.01)
    assert sensor["runs"][0]["motion"]["cycles"][1]["start_s"] == pytest.approx(3.4, abs=0.02)


@pytest.mark.parametrize(("unit", "key"), [("pF", "pF"), ("a.u.", "a_u"), ("counts", "counts"), ("kΩ", "kΩ")])
def test_keys_contain_the_unit_of_the_recording(tmp_path: Path, unit: str, key: str) -> None:
    path = write(tmp_path / "S1.csv", replace(TRUTH, noise_V=0.002), f"time_s,angle_deg,left ({unit}),right ({unit})")
    sensor = study([path]).to_dict()["sensors"]["S1"]
    assert sensor["unit"] == unit
    right = sensor["receivers"]["right"]
    assert right[f"range_{key}"] == pytest.approx(2.0 * np.tanh(1.5), rel=0.02)
    assert {f"mean_{key}", f"u_sensitivity_{key}_per_deg"} <= set(right)
    assert not [name for name in (*right, *sensor["left_minus_right"]) if "_V" in name]


def test_printed_lines_and_axes_contain_the_unit_of_the_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "S1.csv", replace(TRUTH, noise_V=0.002), "time_s,angle_deg,left (kΩ),right (kΩ)")
    figure = tmp_path / "response.svg"
    arguments = ["bench", "analyse", str(path), "--figure", str(figure), "--traces", str(tmp_path / "traces.svg")]
    assert run_command(arguments) == 0
    printed = capsys.readouterr().out
    assert "signal (kΩ)" in figure.read_text(encoding="utf-8")
    assert " kΩ/°" in printed
    assert " V" not in printed
    assert run_command(["bench", "calibrate", str(path)]) == 0
    assert run_command(["bench", "diagnose", str(path)]) == 2  # its model of the circuit requires volts
    assert "kΩ" in capsys.readouterr().err


def test_refuses_receivers_with_different_units(tmp_path: Path) -> None:
    path = write(tmp_path / "S1.csv", TRUTH, "time_s,angle_deg,left (pF),right (lux)")
    with pytest.raises(DataError, match="lux"):
        study([path], AnalysisOptions(channel=("left=left", "right=right")))


def test_pattern_reads_sensor_and_lens_from_file_names(tmp_path: Path) -> None:
    paths = [
        write(tmp_path / f"{name}.csv", replace(TRUTH, swing_V=swing, seed=seed))
        for seed, (name, swing) in enumerate(
            {"S1_lens_1": 1.0, "S1_lens_2": 1.0, "S2_lens_1": 1.2, "S3_nolens_1": 0.01}.items()
        )
    ]
    result = study(paths, AnalysisOptions(pattern="{sensor}_{lens}_{run}.csv")).to_dict()
    assert list(result["sensors"]) == ["S1", "S2", "S3"]
    assert result["sensors"]["S1"]["cycles_used"] == 10
    assert [result["sensors"][name]["lens"] for name in ("S1", "S2", "S3")] == [True, True, False]
    assert result["mean_of_sensors"]["n"] == 2
    assert result["lens_beside_none"]["right_V"]["without_lens_percent"] == pytest.approx(100 * 0.01 / 1.1, abs=0.5)
    assert len(result["sources"]) == 4


def test_file_may_contain_several_sensors(tmp_path: Path) -> None:
    signals = simulated(TRUTH)
    rows = np.column_stack([signals.time_s, signals.angle_deg, signals.volts, 2.0 + 0.01 * (signals.volts - 2.0)])
    path = tmp_path / "rig.csv"
    np.savetxt(path, rows, delimiter=",", header="time_s,angle_deg,S1_L,S1_R,S4_L,S4_R", comments="", fmt="%.7g")
    result = study([path], AnalysisOptions(control=("S4",))).to_dict()
    assert list(result["sensors"]) == ["S1", "S4"]
    assert list(result["sensors"]["S1"]["receivers"]) == ["left", "right"]
    assert result["lens_beside_none"]["right"]["without_lens_percent"] == pytest.approx(1.0, abs=0.01)
    assigned = AnalysisOptions(channel=("A.l=S1_L", "A.r=S1_R", "B.l=S4_L", "B.r=S4_R"))
    assert list(study([path], assigned).sensors) == ["A", "B"]


def test_table_without_times_requires_a_rate(tmp_path: Path) -> None:
    signals = simulated(TRUTH)
    path = tmp_path / "raw.txt"
    np.savetxt(path, np.column_stack([signals.angle_deg, signals.volts]), delimiter="\t", fmt="%.6f")
    options = AnalysisOptions(columns=("angle_deg", "left_V", "right_V"), rate_hz=200.0)
    assert cycle_count(study([path], options), "raw") == 6


def test_result_and_figures_report_smoothing(tmp_path: Path) -> None:
    path = write(tmp_path / "S1.csv", TRUTH)
    figure, traces, out = tmp_path / "response.svg", tmp_path / "traces.svg", tmp_path / "S1.json"
    options = AnalysisOptions(smooth_ms=25.0)
    outcome = pipeline.analyse(path, options=options, figure=FigureOptions(figure=figure), traces=traces, out=out)
    assert outcome.to_dict()["options"]["smooth_ms"] == 25.0
    for file in (figure, traces):
        assert "moving mean over 25 ms" in file.read_text(encoding="utf-8")
    assert json.loads(out.read_text(encoding="utf-8"))["kind"] == "analysis"
    pipeline.analyse(path, figure=FigureOptions(figure=figure))
    assert "moving mean" not in figure.read_text(encoding="utf-8")


def test_labels_simulated_recordings(tmp_path: Path) -> None:
    path = write(tmp_path / "S1.csv", TRUTH)
    path.write_text("# simulated: yes\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    figure = tmp_path / "response.svg"
    assert pipeline.analyse(path, figure=FigureOptions(figure=figure)).result.simulated is True
    assert "simulated data" in figure.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (AnalysisOptions(angle="angel"), "S1.csv: --angle angel; no such column; its columns are time, angle, left_V"),
        (AnalysisOptions(time="stamp"), "no such column; its columns are"),
        (AnalysisOptions(channel=("left=V_L",)), "--channel V_L; no such column; its columns are"),
    ],
)
def test_refuses_an_unknown_column_and_lists_the_existing_ones(
    tmp_path: Path, options: AnalysisOptions, message: str
) -> None:
    path = write(tmp_path / "S1.csv", TRUTH)
    with pytest.raises(DataError, match=message):
        study([path], options)


def test_requests_options_for_unrecognised_columns(tmp_path: Path) -> None:
    path = write(tmp_path / "S1.csv", TRUTH, "time_s,how far,left_V,right_V")
    with pytest.raises(DataError, match="name an angle column with --angle, a stage log"):
        study([path])
    path = write(tmp_path / "S2.csv", TRUTH, "n,angle_deg,left_V,right_V")
    with pytest.raises(DataError, match="name the time column with --time, or specify the rate with --rate-hz"):
        study([path])
    signals = simulated(TRUTH)
    rows = np.column_stack([1e3 * signals.time_s, signals.angle_deg, signals.volts])
    np.savetxt(path, rows, delimiter=",", header="timestamp,angle_deg,left_V,right_V", comments="", fmt="%.8g")
    with pytest.raises(DataError, match="specify --time-unit"):
        study([path])
    assert cycle_count(study([path], AnalysisOptions(time_unit="ms")), "S2") == 6


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pattern": "S1.csv"}, "has no field"),
        ({"control": ("S9",)}, "no sensor has this name"),
        ({"smooth_ms": -1.0}, "smooth_ms"),
        ({"smooth_ms": 1e6}, "a twentieth of the duration of S1.csv"),
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
def test_refuses_invalid_options(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    path = write(tmp_path / "S1.csv", TRUTH)
    with pytest.raises(SpecError, match=message):
        study([path], AnalysisOptions(**options))


def test_refuses_invalid_files(tmp_path: Path) -> None:
    path = write(tmp_path / "S1.csv", TRUTH)
    with pytest.raises(SpecError, match="at least one recording"):
        study([])
    with pytest.raises(SpecError, match="is named twice"):
        study([path, path])
    with pytest.raises(DataError, match="does not match the pattern"):
        study([path], AnalysisOptions(pattern="{sensor}_{run}.csv"))
    with pytest.raises(DataError, match="more than 20,000 points"):
        study([path], AnalysisOptions(step_deg=1e-9))


def test_aligns_a_log_on_another_clock(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    signals = simulated(TRUTH)
    volts, log = tmp_path / "daq.csv", tmp_path / "stage.csv"
    np.savetxt(
        volts, np.column_stack([signals.time_s, signals.volts]), delimiter=",", header="time_s,L_V,R_V", comments=""
    )
    rows = np.column_stack([1e3 * (signals.time_s[::5] + 7.25), signals.angle_deg[::5]])
    np.savetxt(log, rows, delimiter=";", header="t_ms;pos_deg", comments="", fmt="%.6f")
    result = analysed(capsys, str(volts), "--angle-file", str(log))
    assert result["alignment"]["daq"]["lag_s"] == pytest.approx(7.25, abs=1e-3)
    assert len(result["sensors"]["daq"]["runs"][0]["motion"]["cycles"]) == 6
    assert len(result["sources"]) == 2
    np.savetxt(log, rows[:, 1], header="pos_deg", comments="")
    assert run_command(["bench", "analyse", str(volts), "--angle-file", str(log)]) == 2
    assert "--angle-time, or specify the rate with --angle-rate-hz" in capsys.readouterr().err


def test_computes_the_angle_from_a_protocol(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    signals = simulated(TRUTH)
    path = tmp_path / "daq.csv"
    np.savetxt(
        path, np.column_stack([signals.time_s, signals.volts]), delimiter=",", header="time_s,L_V,R_V", comments=""
    )
    result = analysed(capsys, str(path), "--amplitude-deg", "3")
    assert len(result["sensors"]["daq"]["runs"][0]["motion"]["cycles"]) == 6
    assert any("no angle was recorded" in warning for warning in result["warnings"])
    assert run_command(["bench", "analyse", str(path)]) == 2
    assert "specify --amplitude-deg" in capsys.readouterr().err


def waveform(truth: Truth, rate_hz: float, sample_hz: float) -> tuple[Any, Any, Any]:
    """Return times, angles and voltages of a sensor with a switched emitter in flickering and drifting light."""
    end = truth.protocol.corners()[0][-1]
    time_s = np.arange(0.0, end, 1.0 / sample_hz)
    angle = truth.protocol.angle_deg(time_s)
    on = (time_s * rate_hz) % 1.0 < 0.5
    light_V = 4.5 - truth.response_V(angle)  # decrease due to the emitter's light
    ambient_V = 0.3 + 0.2 * np.sin(2.0 * np.pi * 100.3 * time_s) + 0.1 * time_s / end
    volts = 5.0 - on[:, None] * light_V - ambient_V[:, None]
    rng = np.random.default_rng(truth.seed)
    return time_s, angle, volts + truth.noise_V * rng.standard_normal(volts.shape)


def test_removes_ambient_light_from_raw_waveforms(tmp_path: Path) -> None:
    """Less than a tenth of the flicker, 0.2 V at 100 Hz, remains."""
    truth = Truth(noise_V=0.01)
    time_s, angle, volts = waveform(truth, 200.0, 8000.0)
    path = tmp_path / "raw.csv"
    rows = np.column_stack([time_s, angle, volts])
    np.savetxt(path, rows, delimiter=",", header="time_s,angle_deg,left_V,right_V", comments="", fmt="%.5f")
    result = study([path], AnalysisOptions(on_off_hz=200.0)).to_dict()
    sensor = result["sensors"]["raw"]
    assert result["dark_V"] == 0.0
    assert sensor["left_minus_right"]["contrast"]["at_low"] > 0.1
    right = sensor["receivers"]["right_V"]
    expected = truth.response_V(np.array(right["angle_deg"]))[:, 1] - 4.5
    errors = np.array(right["mean_V"]) - expected
    assert np.abs(errors - errors.mean()).max() < 0.02
    assert abs(right["drift_V_per_min"]) < 4.0 * right["u_drift_V_per_min"] + 0.01
    assert right["mean_hysteresis_V"] == pytest.approx(0.0, abs=0.01)


def test_groups_of_a_file_are_sensors(tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    with h5py.File(path, "w") as file:
        file.attrs["simulated"] = "yes"
        for name, swing in (("S1", 1.0), ("S2", 1.1), ("C", 0.01)):
            signals = simulated(replace(TRUTH, swing_V=swing))
            group = file.create_group(name)
            group.attrs["lens"] = "no" if name == "C" else "yes"
            columns = {"time_s": signals.time_s, "angle_deg": signals.angle_deg}
            columns |= {"left": signals.volts[:, 0], "right": signals.volts[:, 1], "right_ambient": signals.volts[:, 0]}
            columns |= {"right_clipped": 1.0 * (np.arange(signals.time_s.size) == 900)}
            for key, values in columns.items():
                unit = {"time_s": "s", "angle_deg": "deg", "right_clipped": "1"}.get(key, "V")
                group.create_dataset(key, data=values).attrs["units"] = unit
    result = study([path]).to_dict()
    assert list(result["sensors"]) == ["C", "S1", "S2"]
    assert [sensor["lens"] for sensor in result["sensors"].values()] == [False, True, True]
    assert list(result["sensors"]["S1"]["receivers"]) == ["left", "right"]
    assert result["sensors"]["S1"]["receivers"]["right"]["clipped_samples"] == 1
    assert result["simulated"] is True
    assert result["dark_V"] is None  # ambient light was recorded for one receiver only
    assert result["mean_of_sensors"]["n"] == 2
    assert len(result["sources"]) == 1


def test_shipped_recording_responds_like_the_sensors_of_the_paper(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The right voltage rises with the angle and the left voltage falls; without a lens, less than a tenth remains."""
    path = tmp_path / "recording.csv"
    path.write_bytes(sample("rotation-simulated.csv"))
    result = analysed(capsys, str(path))
    assert result["simulated"] is True
    assert list(result["sensors"]) == ["S1", "S2", "S3", "C"]
    for label in ("S1", "S2", "S3"):
        sensor = result["sensors"][label]
        right, left = (np.array(sensor["receivers"][side]["mean_V"]) for side in ("right", "left"))
        middle = right.size // 2
        assert right[0] < right[middle] < right[-1]
        assert left[0] > left[middle] > left[-1]
        assert len(sensor["runs"][0]["motion"]["cycles"]) == 6
    assert result["lens_beside_none"]["right"]["without_lens_percent"] < 10.0
    assert not any("convention" in warning for warning in result["warnings"])


@pytest.mark.evidence
def test_script_reproduces_the_shipped_recording() -> None:
    from tools.recording import recording

    shipped, reproduced = sample("rotation-simulated.csv").decode(), recording()
    expected, values = (np.loadtxt(text.splitlines(), delimiter=",", skiprows=4) for text in (shipped, reproduced))
    assert shipped.split("\n")[:4] == reproduced.split("\n")[:4]
    assert values == pytest.approx(expected, abs=1.5e-3)  # other systems round to another step of the ADC


def test_warns_of_an_offset_angle_and_of_receivers_that_do_not_respond(tmp_path: Path) -> None:
    signals = simulated(TRUTH)

    def warnings(angle_deg: Any, volts: Any) -> str:
        path = tmp_path / "S1.csv"
        rows = np.column_stack([signals.time_s, angle_deg, volts])
        np.savetxt(path, rows, delimiter=",", header="time_s,angle_deg,left_V,right_V", comments="", fmt="%.5f")
        result = study([path])
        json.dumps(result.to_dict(), allow_nan=False)
        return " | ".join(result.warnings)

    assert "set the zero there with --zero-deg 90" in warnings(signals.angle_deg + 90.0, signals.volts)
    constant = warnings(signals.angle_deg, 0.0 * signals.volts + 2.5)
    assert "does not respond to the angle" in constant
    assert "both change in the same direction" not in constant


def test_warns_that_recordings_with_the_same_name_are_pooled(tmp_path: Path) -> None:
    path = write(tmp_path / "S1.csv", TRUTH)
    folder = tmp_path / "other"
    folder.mkdir()
    result = study([path, write(folder / "S1.csv", replace(TRUTH, seed=2))])
    assert any("pooled as one sensor" in warning for warning in result.warnings)


@pytest.mark.evidence
def test_memory_for_an_hour_of_eight_receivers(tmp_path: Path) -> None:
    """Both figures at 300 dpi require less than 600 MB, from a table and from arrays."""
    resource = pytest.importorskip("resource")
    del resource
    signals = simulated(replace(TRUTH, protocol=Protocol(cycles=1499)))
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
        process = subprocess.run(
            [sys.executable, "-c", PRINT_MEMORY, str(path), str(tmp_path)], capture_output=True, text=True, check=True
        )
        print(f"{path.name}: {float(process.stdout):.0f} MB")
        assert float(process.stdout) < 600.0


PRINT_MEMORY = """
import resource, sys
from pathlib import Path
from solen.pipeline.bench import analyse as pipeline
from solen.report.options import FigureOptions
file, folder = map(Path, sys.argv[1:])
result = pipeline.analyse(file, figure=FigureOptions(figure=folder / "a.png"), traces=folder / "b.png").result
assert [len(sensor.runs[0].motion.cycles) for sensor in result.sensors.values()] == 4 * [1499]
usage = resource.getrusage(resource.RUSAGE_SELF)
print(usage.ru_maxrss / (1024.0 if sys.platform == "linux" else 1024.0**2))
"""
