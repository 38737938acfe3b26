"""A rig that presses a sensor: a linear stage, a load cell on an input, and the analysis of its recordings."""

from collections.abc import Mapping
from pathlib import Path

import h5netcdf
import numpy as np
import pytest

from solen.analysis import study
from solen.bench.check import CheckOptions, check
from solen.bench.record import RecordOptions, record
from solen.bench.rig import Rig, load_rig
from solen.bench.simulated.cell import SimulatedCell
from solen.bench.simulated.sensors import SimulatedSensor, adc_of
from solen.bench.starter import starter_files
from solen.cli import run_command
from solen.errors import BenchError
from solen.readout import circuit_of
from solen.spec import loads

FILES = starter_files()
DEPTH_MM = np.linspace(0.0, 0.31, 20)
DAQ = '[daq]\ndriver = "simulated"\nswitching = "counter"\nrate_hz = 5000.0\ntrim_v = 1.0\n'


def force_N(depth_mm: np.ndarray) -> np.ndarray:
    """Return the force on the finger of the sensor that replaces a traced one in these tests."""
    return 0.8 * depth_mm + 0.4 * depth_mm**2


def untraced_sensors(rig: Rig, *_: object) -> tuple[SimulatedSensor, ...]:
    """Return a sensor whose light and force are formulas."""
    light = np.column_stack([0.2 + 0.35 * DEPTH_MM, 0.2 - 0.3 * DEPTH_MM])
    circuit = circuit_of(loads(FILES["sensor-press"]), {"right": 12.0, "left": 12.0})
    circuit = circuit.__class__(**(vars(circuit) | {"adc": adc_of(rig), "load_ohm": (400.0, 400.0)}))
    return (SimulatedSensor(rig.sensor[0], {}, DEPTH_MM, light, circuit, force_N(DEPTH_MM)),)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder with the shipped rig of a press, for a sensor that is not traced."""
    monkeypatch.setattr("solen.bench.simulated.instruments.simulated_sensors", untraced_sensors)
    for name in ("press", "rig-press", "sensor-press"):
        (tmp_path / f"{name}.toml").write_text(FILES[name], encoding="utf-8")
    return tmp_path


def record_press(folder: Path, replacements: Mapping[str, str] = {}) -> Path:
    """Record with the rig file after replacements, and return the recording."""
    rig = FILES["rig-press"]
    for old, new in replacements.items():
        assert old in rig
        rig = rig.replace(old, new)
    (folder / "rig-press.toml").write_text(rig, encoding="utf-8")
    return record(folder / "press.toml", folder / "rig-press.toml", folder / "out", RecordOptions()).path


def columns(path: Path) -> dict[str, np.ndarray]:
    with h5netcdf.File(path, "r") as file:
        return {key: variable[...] for key, variable in file.groups["finger"].variables.items()}


BOARD = "[board]" + FILES["rig-press"].partition("[board]")[2].partition("[load_cell]")[0]
SAMPLERS = pytest.mark.parametrize("sampler", [{}, {BOARD: DAQ}], ids=["board", "daq"])
"""Replacements in the rig file for each kind of sampler."""


@SAMPLERS
def test_recording_contains_depth_and_force(sampler: dict[str, str], bench: Path) -> None:
    read = columns(record_press(bench, sampler))
    assert "angle_deg" not in read
    assert (read["depth_mm"].min(), read["depth_mm"].max()) == pytest.approx((0.0, 0.3), abs=1e-3)
    rig = load_rig(bench / "rig-press.toml")
    assert rig.load_cell is not None
    cell = SimulatedCell.drawn(rig.load_cell, untraced_sensors(rig)[0], np.random.default_rng([rig.seed, 2]))
    true_N = force_N(np.maximum(read["depth_mm"], 0.0))
    fraction = true_N / 0.5
    expected_N = true_N * (1.0 + cell.scale_error) + 4.0 * cell.bow_N * fraction * (1.0 - fraction)
    # the depth, interpolated between position queries, is less accurate at the corners of ramps
    assert np.quantile(np.abs(read["force_N"] - expected_N), 0.97) < 2e-4
    assert abs(read["force_N"][read["time_s"] < 1.0].mean()) < 2e-5  # tared


def test_decodes_force_from_second_run(bench: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out, calibration = bench / "out", bench / "out" / "press.finger.calibration.json"
    run = ["bench", "run", str(bench / "press.toml"), "--rig", str(bench / "rig-press.toml"), "--out", str(out)]
    assert run_command(run) == 0
    assert run_command(["bench", "calibrate", str(out / "press.nc")]) == 0
    assert run_command([*run, "--name", "again"]) == 0
    capfd.readouterr()
    table = bench / "out.csv"
    assert run_command(["bench", "decode", str(calibration), str(out / "again.nc"), "--out", str(table)]) == 0
    assert "relative to the recorded force" in capfd.readouterr().out
    rows = np.genfromtxt(table, delimiter=",", skip_header=1, names=True, dtype=None, encoding="utf-8")
    true_N = force_N(np.maximum(columns(out / "again.nc")["depth_mm"], 0.0))
    assert ((rows["low95_N"] <= true_N + 2e-5) & (true_N <= rows["high95_N"] + 2e-5)).mean() > 0.9
    sensor = study([out / "press.nc"]).sensors["finger"]
    assert (sensor.stimulus.name, sensor.runs[0].timed) == ("force", (1, 2, 3, 4, 5, 6, 7))
    assert sensor.timing.separated
    assert run_command(["bench", "diagnose", str(out / "press.nc")]) == 2
    assert "calibrate" in capfd.readouterr().err


def test_overloaded_cell_gives_no_force(bench: Path) -> None:
    rig = FILES["rig-press"].replace("N_per_V = 0.2", "N_per_V = 0.05")
    (bench / "rig-press.toml").write_text(rig, encoding="utf-8")
    run = record(bench / "press.toml", bench / "rig-press.toml", bench / "out", RecordOptions())
    assert any("no force" in line for line in run.warnings if "load cell" in line)
    assert np.isnan(columns(run.path)["force_N"]).any()


def test_check_includes_load_cell(bench: Path) -> None:
    cell = check(bench / "rig-press.toml", CheckOptions(seconds=0.5)).load_cell
    assert cell is not None
    assert cell.level_V == pytest.approx(0.5, abs=1e-3)
    assert cell.noise_N == pytest.approx(0.2 * cell.noise_V)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("input = 3\n", "", ("load_cell.input", "input = 3")),
        ("input = 3", "input = 2", ("load_cell.input", "receiver")),
        ("N_per_V = 0.2", "", ("load_cell", "N_per_V")),
        ("N_per_V = 0.2", "N_per_V = 0.2\ngain = 2.0", ("load_cell.gain", "N_per_V")),
        ("capacity_N = 0.5", "", ("capacity_N", "nonlinearity_percent")),
        ('drives = "depth"', 'drives = "depth"\nlever_mm = 40.0', ("lever_mm", "depth")),
        ('drives = "depth"', "", ("lever_mm", 'drives = "depth"')),
        ('model = "M-111.1DG"', "", ("stage.drives", "linear")),
        ("rate_hz = 200.0", 'rate_hz = 200.0\nunit = "lux"\nper_count = 1.0', ("load_cell", "volts")),
        (
            "[spread]",
            '[[sensor]]\nname = "b"\ndesign = "x"\nemitter = 2\nright = 4\nleft = 5\n[spread]',
            ("one sensor",),
        ),
    ],
)
def test_names_invalid_key_of_rig(old: str, new: str, words: tuple[str, ...], tmp_path: Path) -> None:
    assert old in FILES["rig-press"]
    path = tmp_path / "rig.toml"
    path.write_text(FILES["rig-press"].replace(old, new, 1), encoding="utf-8")
    with pytest.raises(BenchError) as bad:
        load_rig(path)
    assert all(word in str(bad.value) for word in words), str(bad.value)


def test_refuses_design_without_finger(tmp_path: Path) -> None:
    for name in ("press", "rig-press"):
        (tmp_path / f"{name}.toml").write_text(FILES[name], encoding="utf-8")
    (tmp_path / "sensor-press.toml").write_text(FILES["sensor"], encoding="utf-8")
    with pytest.raises(BenchError, match=r"sensor-press\.toml.*rotation.*stage\.drives"):
        record(tmp_path / "press.toml", tmp_path / "rig-press.toml", tmp_path / "out", RecordOptions())


FORCES = """
schema = 1
name = "forces"
cycles = 2
[[step]]
to_N = 0.1
velocity_mm_per_s = 0.5
hold_s = 0.3
[[step]]
to_N = 0.2
velocity_mm_per_s = 0.5
hold_s = 0.3
[[step]]
to_N = 0.1
velocity_mm_per_s = 0.5
hold_s = 0.3
[[step]]
to_mm = 0.0
velocity_mm_per_s = 0.5
hold_s = 0.3
"""
DEPTH, TRAVEL = 'drives = "depth"', 'drives = "depth"\ntravel = [-0.1, 0.3]'


@SAMPLERS
def test_presses_to_forces(sampler: dict[str, str], bench: Path) -> None:
    (bench / "press.toml").write_text(FORCES, encoding="utf-8")
    read = columns(record_press(bench, {DEPTH: TRAVEL, **sampler}))
    at_rest = np.abs(np.gradient(read["force_N"], read["time_s"])) < 0.02
    force = read["force_N"][at_rest]
    # at 0.5 mm/s and about 1 N/mm, the overshoot within two position queries and a period is up to 25 mN
    for low, high in ((0.2, 0.226), (0.1, 0.126), (0.074, 0.1)):
        assert ((force > low) & (force < high)).sum() > 50, (low, high)
    assert read["depth_mm"].max() < 0.3


def test_force_that_is_never_reached_ends_run(bench: Path) -> None:
    (bench / "press.toml").write_text(FORCES.replace("0.2", "0.4"), encoding="utf-8")
    with pytest.raises(BenchError, match=r"load cell.*0\.4 N at the end of travel, 0\.3 mm"):
        record_press(bench, {DEPTH: TRAVEL})
    assert (bench / "out" / "press.journal").exists()


@pytest.mark.parametrize(
    ("rig", "protocol", "words"),
    [
        ((DEPTH, DEPTH), ("", ""), ("to_N", "travel")),
        ((DEPTH, TRAVEL), ("to_N = 0.2", "to_N = 0.6"), ("0.6", "capacity")),
        ((DEPTH, TRAVEL), ("to_mm = 0.0\n", "to_N = 0.1\n"), ("last step", "to_mm")),
        ((DEPTH, TRAVEL), ("to_N = 0.2", "to_N = 0.2\nto_mm = 0.1"), ("to_N", "to_mm")),
        ((DEPTH, TRAVEL), ("to_N = 0.2", "to_N = 0.0"), ("to_N", "than 0")),
    ],
)
def test_refuses_invalid_step_to_force(
    rig: tuple[str, str], protocol: tuple[str, str], words: tuple[str, ...], bench: Path
) -> None:
    (bench / "press.toml").write_text(FORCES.replace(*protocol), encoding="utf-8")
    with pytest.raises(BenchError) as bad:
        record_press(bench, {rig[0]: rig[1]})
    assert all(word in str(bad.value) for word in words), str(bad.value)


def test_steps_to_forces_require_load_cell(bench: Path) -> None:
    (bench / "press.toml").write_text(FORCES, encoding="utf-8")
    cell = FILES["rig-press"].partition("[load_cell]")[2].partition("[[sensor]]")[0]
    with pytest.raises(BenchError, match=r"to_N.*\[load_cell\]"):
        record_press(bench, {f"[load_cell]{cell}": ""})


def test_load_cell_without_zero_requires_rest(bench: Path) -> None:
    (bench / "press.toml").write_text(FILES["press"].replace("rest_s = 1.0", "rest_s = 0.0"), encoding="utf-8")
    with pytest.raises(BenchError, match=r"rest_s.*zero_V"):
        record(bench / "press.toml", bench / "rig-press.toml", bench / "out", RecordOptions())
