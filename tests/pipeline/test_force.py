"""Recordings of a force or a depth: commands with results in newtons and millimetres."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, SignalOptions, study
from solen.analysis.calibration import Decoding, calibrated_sensors
from solen.analysis.calibration.decoder import Decoder
from solen.arrays import FloatArray
from solen.cli import run_command
from solen.errors import SolenError
from solen.pipeline.bench import decode as pipeline
from solen.units import factor
from tests.analysis.force_support import CELL, ZERO_V, Presses

COLUMNS = ("time_s", "force_N", "low68_N", "high68_N", "low95_N", "high95_N", "heading", "rises", "flags", "other")
TRUE_V_PER_N = np.array([2.9 - 0.6 * 0.3, -2.7 + 1.2 * 0.3])
"""Slopes of the least-squares lines of both curves over 0 to 0.3 N, i.e. of these parabolas at the midpoint."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of recordings with the voltage of a load cell, and with force and depth."""
    path = tmp_path_factory.mktemp("force")
    (path / "cell.toml").write_text(CELL, encoding="utf-8")
    Presses().write(path / "a.csv")
    Presses(seed=2).write(path / "again.csv")
    Presses().write(path / "both.csv", "force_N", 1.0, depth=True)
    return path


@pytest.fixture(scope="module")
def calibration(folder: Path) -> Path:
    """Return the calibration of a recording with a load cell."""
    arguments = [str(folder / "a.csv"), *cell_options(folder), "--motion", "loaded"]
    assert run_command(["bench", "calibrate", *arguments, "--figure", str(folder / "c.svg")]) == 0
    return folder / "a.calibration.json"


def cell_options(folder: Path) -> list[str]:
    return ["--load-cell", str(folder / "cell.toml"), "--tare-s", "0.9"]


def test_converts_the_voltage_of_a_load_cell_to_newtons(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    figures = ["--figure", str(folder / "r.svg"), "--traces", str(folder / "t.svg")]
    assert run_command(["bench", "analyse", str(folder / "a.csv"), *cell_options(folder), *figures, "--json"]) == 0
    sensor = json.loads(capfd.readouterr().out)["sensors"]["a"]
    for side, slope in zip(("left_V", "right_V"), TRUE_V_PER_N, strict=True):
        receiver = sensor["receivers"][side]
        u = receiver["u_sensitivity_V_per_N"]
        assert receiver["sensitivity_V_per_N"] == pytest.approx(slope, abs=4.0 * u + 2e-3)
        assert receiver["resolution_N"] == pytest.approx(receiver["noise_V"] / abs(receiver["sensitivity_V_per_N"]))
        assert receiver["noise_V"] == pytest.approx(1e-3, rel=0.1)
        assert receiver["hysteresis_V"] < 2e-3
    assert sensor["near_zero_N"] == pytest.approx(0.05)
    assert [sensor["runs"][0]["motion"][key] for key in ("low_N", "high_N")] == pytest.approx([0.0, 0.3], abs=1e-3)
    text = json.dumps(sensor)
    assert "_deg" not in text
    assert "angle" not in text
    assert all("force (N)" in (folder / name).read_text(encoding="utf-8") for name in ("r.svg", "t.svg"))


def test_uncertainties_include_errors_common_to_all_readings_of_the_cell(folder: Path, tmp_path: Path) -> None:
    """The scatter of the cycles shows neither errors of the scale of up to 2 u nor non-linearity."""
    options = AnalysisOptions(load_cell=folder / "cell.toml", tare_s=0.9)
    for scale, bow in ((0.02, 0.0), (-0.02, 0.0), (0.0, 0.005), (0.01, -0.005)):
        path = Presses(cycles=4, scale=scale, bow=bow).write(tmp_path / "a.csv")
        for receiver, true in zip(study([path], options).sensors["a"].receivers.values(), TRUE_V_PER_N, strict=True):
            error, u = abs(receiver.sensitivity_V_per_deg - true), receiver.u_sensitivity_V_per_deg
            assert error < 2.1 * u
            assert 0.01 * abs(true) < u < 0.02 * abs(true)


def test_load_cell_only_adds_uncertainties_to_a_force_in_newtons(folder: Path) -> None:
    without, with_cell = (
        study([folder / "both.csv"], AnalysisOptions(load_cell=cell)) for cell in (None, folder / "cell.toml")
    )
    left, left_with_cell = (result.sensors["both"].receivers["left_V"] for result in (without, with_cell))
    assert left.sensitivity_V_per_deg == left_with_cell.sensitivity_V_per_deg
    assert left.u_sensitivity_V_per_deg < 0.1 * left_with_cell.u_sensitivity_V_per_deg
    assert any("u_sensitivity_percent" in line for line in without.warnings)
    assert any("--load-cell" in line for line in with_cell.warnings)


@pytest.mark.parametrize("header", ["force_N", "Kraft [kN]", "Force (gf)", "Load (lbf)", "load_mN"])
def test_recognises_units_of_force(header: str, tmp_path: Path) -> None:
    unit = header.strip(")]").replace("_", "(").replace("[", "(").rpartition("(")[2]
    to_newton = factor(unit, "N")
    assert to_newton is not None
    path = Presses().write(tmp_path / "a.csv", header, 1.0 / to_newton)
    left = study([path]).sensors["a"].receivers["left_V"]
    assert left.sensitivity_V_per_deg == pytest.approx(TRUE_V_PER_N[0], abs=5e-3)


def test_rated_output_is_equivalent_to_a_sensitivity(folder: Path, tmp_path: Path) -> None:
    """2 mV/V at 0.5 N and 5 V, amplified 100 times, are 2 V/N."""
    rated = "mV_per_V = 2.0\ncapacity_N = 0.5\nexcitation_V = 5.0\ngain = 100.0\n"
    cell = tmp_path / "rated.toml"
    cell.write_text(f"[load_cell]\n{rated}zero_V = {ZERO_V}\n", encoding="utf-8")
    by_rating, by_sensitivity = (
        study([folder / "a.csv"], options).sensors["a"]
        for options in (AnalysisOptions(load_cell=cell), AnalysisOptions(load_cell=folder / "cell.toml", tare_s=0.9))
    )
    slope, expected = (sensor.receivers["left_V"].sensitivity_V_per_deg for sensor in (by_rating, by_sensitivity))
    assert slope == pytest.approx(expected, rel=1e-4)
    expected_N = by_sensitivity.runs[0].signals.angle_deg
    assert by_rating.runs[0].signals.angle_deg == pytest.approx(expected_N, abs=1e-4)


def test_notes_the_selected_quantity_if_there_are_several(folder: Path) -> None:
    default, depth = (study([folder / "both.csv"], AnalysisOptions(**more)) for more in ({}, {"against": "depth"}))
    assert default.stimulus.name == "force"
    assert any("--against depth" in line for line in default.warnings)
    assert not any("--against" in line for line in depth.warnings)
    assert depth.to_dict()["sensors"]["both"]["runs"][0]["motion"]["high_mm"] == pytest.approx(1.5, abs=1e-3)


def test_two_speeds_determine_the_lag_of_the_load_cell(tmp_path: Path) -> None:
    fast = Presses(late_s=0.01, cycles=4)
    slow = Presses(late_s=0.01, cycles=4, newton_per_s=0.1, seed=3)
    rows = [
        np.column_stack([presses.time_s, (presses.cell_V - ZERO_V) / 2.0, presses.volts]) for presses in (fast, slow)
    ]
    rows[1][:, 0] += rows[0][-1, 0] + 0.005
    path = tmp_path / "two.csv"
    np.savetxt(path, np.vstack(rows), delimiter=",", header="time_s,force_N,left_V,right_V", comments="")
    timing = study([path]).sensors["two"].timing
    assert timing.lag_s == pytest.approx(0.01, abs=max(3.0 * timing.u_lag_s, 3e-4))


def test_aligns_a_load_cell_on_another_clock(folder: Path, tmp_path: Path) -> None:
    presses = Presses()
    for name, columns, header in (
        ("volts.csv", [presses.time_s, presses.volts], "time_s,left_V,right_V"),
        ("cell.csv", [presses.time_s + 0.37, presses.cell_V], "time_s,load_cell_V"),
    ):
        np.savetxt(tmp_path / name, np.column_stack(columns), delimiter=",", header=header, comments="")
    options = AnalysisOptions(angle_file=(tmp_path / "cell.csv",), load_cell=folder / "cell.toml", tare_s=0.9)
    result = study([tmp_path / "volts.csv"], options)
    alignment = next(iter(result.alignment.values()))
    assert alignment.lag_s == pytest.approx(0.37, abs=max(4.0 * alignment.u_lag_s, 3e-4))
    assert result.stimulus.name == "force"
    slope = result.sensors["volts"].receivers["left_V"].sensitivity_V_per_deg
    assert slope == pytest.approx(TRUE_V_PER_N[0], abs=5e-3)


def test_calibration_reports_the_common_error_of_the_load_cell(
    folder: Path, calibration: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    svg = (folder / "c.svg").read_text(encoding="utf-8")
    assert "decoded force (N)" in svg
    assert "load cell" in svg
    assert "true" not in svg
    recording = ["bench", "calibrate", str(folder / "a.csv"), *cell_options(folder), "--motion", "loaded"]
    assert run_command([*recording, "--out", str(calibration)]) == 0
    printed = capfd.readouterr().out
    assert "relative to the load cell" in printed
    assert "share an error with a standard uncertainty of 1 %" in printed


def test_decodes_forces_with_bands(folder: Path, calibration: Path, capfd: pytest.CaptureFixture[str]) -> None:
    table = folder / "out.csv"
    options = [*cell_options(folder), "--motion", "loaded", "--out", str(table)]
    capfd.readouterr()
    assert run_command(["bench", "decode", str(calibration), str(folder / "again.csv"), *options]) == 0
    printed = capfd.readouterr()
    assert "relative to the recorded force" in printed.out
    assert "share an error with a standard uncertainty of 1 %" in printed.err
    assert "WARNING" not in printed.err
    rows = np.genfromtxt(table, delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert rows.dtype.names == COLUMNS
    true = Presses(seed=2).force_N
    assert ((rows["low95_N"] <= true + 1e-5) & (true <= rows["high95_N"] + 1e-5)).mean() > 0.97
    assert np.sqrt(np.mean((rows["force_N"] - true) ** 2)) < 1.5e-3


@pytest.mark.parametrize("cell_noise_V", [1e-3, 4e-3])
def test_bands_contain_the_ends_of_the_range_despite_noise_of_the_cell(
    cell_noise_V: float, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cell.toml").write_text("[load_cell]\nN_per_V = 0.5\n", encoding="utf-8")
    options = AnalysisOptions(load_cell=tmp_path / "cell.toml", tare_s=0.9)
    path = Presses(cell_noise_V=cell_noise_V).write(tmp_path / "a.csv")
    result = study([path], options)
    assert "use a longer --tare-s" not in str(result.warnings)
    short = study([path], options.model_copy(update={"tare_s": 0.05}))
    assert ("use a longer --tare-s" in str(short.warnings)) is (cell_noise_V > 2e-3)
    calibration = calibrated_sensors(result).calibrations[0].calibration
    presses = Presses(seed=7, cell_noise_V=cell_noise_V)
    decoded = Decoder(calibration).decode(presses.volts)
    assert not decoded.outside.mean() > 0.01
    force = presses.force_N
    inner = (force > 0.02) & (force < 0.28)
    for part in (force < 1e-9, force > 0.2999, inner):
        assert decoded.holds(force, 1)[part].mean() > 0.9
    assert np.median(np.ptp([decoded.low_deg[inner, 1], decoded.high_deg[inner, 1]], axis=0)) < 3e-3  # 4 u are 1 mN
    assert run_command(["bench", "calibrate", str(path), *cell_options(tmp_path)]) == 0
    capfd.readouterr()
    files = [str(tmp_path / "a.calibration.json"), str(path), "--out", str(tmp_path / "o.csv")]
    assert run_command(["bench", "decode", *files, *cell_options(tmp_path)]) == 0
    printed, total = capfd.readouterr().out, presses.time_s.size
    force = 0.5 * (np.genfromtxt(path, delimiter=",", skip_header=1)[:, 1] - ZERO_V)
    outside = ((force < calibration.angle_deg[0]) | (force > calibration.angle_deg[-1])).sum()
    count = int(printed.split(f" of {total} readings (")[0].split()[-1])
    assert count == pytest.approx(outside, abs=0.03 * total)  # the tare differs slightly from ZERO_V


def test_table_for_a_board_is_in_newtons(folder: Path, calibration: Path) -> None:
    assert run_command(["bench", "table", str(calibration), str(folder / "board")]) == 0
    assert "float *force_N, float *u_N" in (folder / "board" / "solen_decode.h").read_text(encoding="utf-8")


def coverage(seeds: int, folder: Path, bow: float = 0.005) -> tuple[FloatArray, FloatArray]:
    """Return the fractions of true forces within their 68 % and 95 % bands, for many load cells, and their errors."""
    fractions, rng = [], np.random.default_rng(20)
    (folder / "cell.toml").write_text(CELL.replace("percent = 0.5", f"percent = {100.0 * bow}"), encoding="utf-8")
    options = AnalysisOptions(load_cell=folder / "cell.toml", tare_s=0.9)
    for seed in range(seeds):
        cell = Presses(seed=seed, scale=0.01 * rng.standard_normal(), bow=bow * rng.uniform(-1.0, 1.0), cycles=5)
        file = calibrated_sensors(study([cell.write(folder / "a.csv")], options)).calibrations[0]
        repeated = replace(cell, seed=seed + 10_000)
        inner = (repeated.force_N > 0.02) & (repeated.force_N < 0.28)
        decoded = Decoder(file.calibration).decode(repeated.volts[inner])
        true = repeated.force_N[inner, None]
        fractions.append(((decoded.low_deg <= true) & (true <= decoded.high_deg)).mean(axis=0))
    return np.mean(fractions, axis=0), np.std(fractions, axis=0) / np.sqrt(seeds)


def test_bands_contain_the_true_force(tmp_path: Path) -> None:
    """The error of a cell is common to all its readings, so all bands of one in 12 cells may miss the force."""
    fraction, _ = coverage(12, tmp_path)
    assert (fraction >= [0.5, 0.85]).all()


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("bow", "lowest", "highest"),
    [
        (0.0, (0.60, 0.91), (0.77, 0.98)),
        (0.005, (0.68, 0.95), (0.85, 0.995)),  # bands do not take into account that this error vanishes without load
    ],
)
def test_bands_have_their_coverage_of_the_true_force(
    bow: float, lowest: tuple[float, float], highest: tuple[float, float], tmp_path: Path
) -> None:
    fraction, error = coverage(200, tmp_path, bow)
    print(f"bow {bow}: {fraction.round(3)} ± {error.round(3)}")
    assert (fraction >= lowest).all()
    assert (fraction <= highest).all()


CELL_FILE, TARE = "--load-cell {}/cell.toml", "--tare-s 0.9"


@pytest.mark.parametrize(
    ("header", "options", "words"),
    [
        ("load_cell_V", "", ("is a voltage", "--load-cell")),
        ("load_cell_V", CELL_FILE, ("without load", "--tare-s")),
        ("load_cell_V", f"{CELL_FILE} {TARE} --zero-deg 1", ("--zero-deg", "with --tare-s")),
        ("load_cell_V", f"{CELL_FILE} {TARE} --step-deg 1", ("--step-deg", "force")),
        ("load_cell_V", "--load-cell {}/none.toml", ("none.toml",)),
        ("load_cell_V", "--load-cell {}/empty.toml", ("[load_cell]",)),
        ("load_cell_V", "--load-cell {}/both.toml", ("mV_per_V", "N_per_V")),
        ("load_cell_V", "--against depth", ("depth", "--depth")),
        ("force_N", "--against angle", ("this recording contains force", "--angle")),
        ("Force (g)", "", ("no unit", "force_gf")),
        ("force_N", "--against angle --angle force", ("unit of angle",)),
        ("angle_deg", f"{CELL_FILE}", ("--load-cell", "angle")),
        ("angle_deg", TARE, ("--tare-s", "angle")),
        ("depth", "", ("--depth",)),
        ("depth", "--depth depth", ("no unit", "depth_mm")),
    ],
)
def test_refuses_invalid_options_for_a_force(
    header: str, options: str, words: tuple[str, ...], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cell.toml").write_text(CELL, encoding="utf-8")
    (tmp_path / "empty.toml").write_text("a = 1\n", encoding="utf-8")
    (tmp_path / "both.toml").write_text("[load_cell]\nN_per_V = 2.0\nmV_per_V = 2.0\n", encoding="utf-8")
    path = Presses(cycles=2).write(tmp_path / "a.csv", header)
    assert run_command(["bench", "analyse", str(path), *options.format(tmp_path).split()]) == 2
    line = capfd.readouterr().err
    assert line.count("\n") == 1
    assert all(word in line for word in words), line


def test_refuses_recordings_of_an_angle_and_of_a_force_together(folder: Path, tmp_path: Path) -> None:
    of_angle = Presses().write(tmp_path / "angle.csv", "angle_deg", 10.0)
    with pytest.raises(SolenError, match="--against"):
        study([of_angle, folder / "both.csv"])


def test_decoded_forces_are_not_compared_with_an_angle(folder: Path, calibration: Path) -> None:
    of_angle = Presses(seed=4).write(folder / "angle.csv", "angle_deg", 10.0)
    decoding = pipeline.decode(calibration, str(of_angle), signals=SignalOptions()).result
    assert isinstance(decoding, Decoding)
    assert decoding.against_angle is None
    assert decoding.highest_deg == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("option", ["--angle depth_mm", "--depth depth_mm", "--against depth"])
def test_refuses_a_column_of_another_quantity(
    option: str, folder: Path, calibration: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    files = [str(calibration), str(folder / "both.csv")]
    capfd.readouterr()
    assert run_command(["bench", "decode", *files, *option.split()]) == 2
    line = capfd.readouterr().err
    assert all(word in line for word in (*option.split(), "force")), line
