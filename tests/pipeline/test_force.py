"""Recordings of a force or a depth: the same commands, in newtons and millimetres."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, SignalOptions, study
from solen.analysis.calibration import Decoding, calibrated_sensors
from solen.analysis.calibration.decoder import Decoder
from solen.cli import run_command
from solen.errors import SolenError
from solen.pipeline.bench import decode as pipeline
from solen.units import factor
from tests.analysis.force_support import CELL, ZERO_V, Presses

COLUMNS = ("time_s", "force_N", "low68_N", "high68_N", "low95_N", "high95_N", "heading", "rises", "flags", "other")
TRUE_V_PER_N = np.array([2.9 - 0.6 * 0.3, -2.7 + 1.2 * 0.3])
"""Slopes of the least-squares lines of both curves over 0 to 0.3 N: those of a parabola at the middle."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings with the volts of a load cell, and with depth and force beside each other."""
    where = tmp_path_factory.mktemp("force")
    (where / "cell.toml").write_text(CELL, encoding="utf-8")
    Presses().write(where / "a.csv")
    Presses(seed=2).write(where / "again.csv")
    Presses().write(where / "both.csv", "force_N", 1.0, depth=True)
    return where


def by_cell(folder: Path) -> list[str]:
    return ["--load-cell", str(folder / "cell.toml"), "--tare-s", "0.9"]


def test_a_load_cells_volts_become_newtons(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    figures = ["--figure", str(folder / "r.svg"), "--traces", str(folder / "t.svg")]
    assert run_command(["bench", "analyse", str(folder / "a.csv"), *by_cell(folder), *figures, "--json"]) == 0
    sensor = json.loads(capfd.readouterr().out)["sensors"]["a"]
    for side, slope in zip(("left_V", "right_V"), TRUE_V_PER_N, strict=True):
        own = sensor["receivers"][side]
        assert own["sensitivity_V_per_N"] == pytest.approx(slope, abs=4.0 * own["u_sensitivity_V_per_N"] + 2e-3)
        assert own["resolution_N"] == pytest.approx(own["noise_V"] / abs(own["sensitivity_V_per_N"]))
        assert own["noise_V"] == pytest.approx(1e-3, rel=0.1)
        assert own["hysteresis_V"] < 2e-3
    assert sensor["near_zero_N"] == pytest.approx(0.05)
    assert [sensor["runs"][0]["motion"][key] for key in ("low_N", "high_N")] == pytest.approx([0.0, 0.3], abs=1e-3)
    text = json.dumps(sensor)
    assert "_deg" not in text
    assert "angle" not in text
    assert all("force (N)" in (folder / name).read_text(encoding="utf-8") for name in ("r.svg", "t.svg"))


def test_uncertainties_hold_what_all_readings_of_the_cell_share(folder: Path, tmp_path: Path) -> None:
    # cells two of their standard uncertainties off, in scale and in bow: the scatter of the cycles knows of neither
    options = AnalysisOptions(load_cell=folder / "cell.toml", tare_s=0.9)
    for scale, bow in ((0.02, 0.0), (-0.02, 0.0), (0.0, 0.005), (0.01, -0.005)):
        path = Presses(cycles=4, scale=scale, bow=bow).write(tmp_path / "a.csv")
        for own, true in zip(study([path], options).sensors["a"].receivers.values(), TRUE_V_PER_N, strict=True):
            off, u = abs(own.sensitivity_V_per_deg - true), own.u_sensitivity_V_per_deg
            assert off < 2.1 * u
            assert 0.01 * abs(true) < u < 0.02 * abs(true)


def test_of_a_force_in_newtons_a_cell_states_only_how_well_it_is_known(folder: Path) -> None:
    bare, stated = (
        study([folder / "both.csv"], AnalysisOptions(load_cell=cell)) for cell in (None, folder / "cell.toml")
    )
    ours, theirs = (one.sensors["both"].receivers["left_V"] for one in (bare, stated))
    assert ours.sensitivity_V_per_deg == theirs.sensitivity_V_per_deg
    assert ours.u_sensitivity_V_per_deg < 0.1 * theirs.u_sensitivity_V_per_deg
    assert any("u_sensitivity_percent" in line for line in bare.warnings)
    assert any("--load-cell" in line for line in stated.warnings)


@pytest.mark.parametrize("header", ["force_N", "Kraft [kN]", "Force (gf)", "Load (lbf)", "load_mN"])
def test_units_of_force_are_known_by_their_header(header: str, tmp_path: Path) -> None:
    unit = header.strip(")]").replace("_", "(").replace("[", "(").rpartition("(")[2]
    to_newton = factor(unit, "N")
    assert to_newton is not None
    path = Presses().write(tmp_path / "a.csv", header, 1.0 / to_newton)
    own = study([path]).sensors["a"].receivers["left_V"]
    assert own.sensitivity_V_per_deg == pytest.approx(TRUE_V_PER_N[0], abs=5e-3)


def test_rated_output_and_a_stated_zero_give_the_same(folder: Path, tmp_path: Path) -> None:
    # 2 mV/V at 0.5 N and 5 V, 100 times amplified: 2 V/N
    rated = "mV_per_V = 2.0\ncapacity_N = 0.5\nexcitation_V = 5.0\ngain = 100.0\n"
    cell = tmp_path / "rated.toml"
    cell.write_text(f"[load_cell]\n{rated}zero_V = {ZERO_V}\n", encoding="utf-8")
    rated_study = study([folder / "a.csv"], AnalysisOptions(load_cell=cell))
    tared = study([folder / "a.csv"], AnalysisOptions(load_cell=folder / "cell.toml", tare_s=0.9))
    ours, theirs = (one.sensors["a"].receivers["left_V"] for one in (rated_study, tared))
    assert ours.sensitivity_V_per_deg == pytest.approx(theirs.sensitivity_V_per_deg, rel=1e-4)
    assert (
        abs(rated_study.sensors["a"].runs[0].signals.angle_deg - tared.sensors["a"].runs[0].signals.angle_deg).max()
        < 1e-4
    )


def test_of_several_quantities_the_one_taken_is_said(folder: Path) -> None:
    default, depth = (study([folder / "both.csv"], AnalysisOptions(**more)) for more in ({}, {"against": "depth"}))
    assert default.stimulus.name == "force"
    assert any("--against depth" in line for line in default.warnings)
    assert not any("--against" in line for line in depth.warnings)
    assert depth.to_dict()["sensors"]["both"]["runs"][0]["motion"]["high_mm"] == pytest.approx(1.5, abs=1e-3)


def test_a_lag_of_the_load_cell_is_reported_by_two_speeds(tmp_path: Path) -> None:
    fast = Presses(late_s=0.01, cycles=4)
    slow = Presses(late_s=0.01, cycles=4, newton_per_s=0.1, seed=3)
    rows = [np.column_stack([one.time_s, (one.cell_V - ZERO_V) / 2.0, one.volts]) for one in (fast, slow)]
    rows[1][:, 0] += rows[0][-1, 0] + 0.005
    path = tmp_path / "two.csv"
    np.savetxt(path, np.vstack(rows), delimiter=",", header="time_s,force_N,left_V,right_V", comments="")
    timing = study([path]).sensors["two"].timing
    assert timing.lag_s == pytest.approx(0.01, abs=max(3.0 * timing.u_lag_s, 3e-4))


def test_a_load_cell_on_a_clock_of_its_own_is_laid_on_the_voltages(folder: Path, tmp_path: Path) -> None:
    one = Presses()
    for name, columns, head in (
        ("volts.csv", [one.time_s, one.volts], "time_s,left_V,right_V"),
        ("cell.csv", [one.time_s + 0.37, one.cell_V], "time_s,load_cell_V"),
    ):
        np.savetxt(tmp_path / name, np.column_stack(columns), delimiter=",", header=head, comments="")
    log = {"angle_file": (tmp_path / "cell.csv",), "load_cell": folder / "cell.toml", "tare_s": 0.9}
    found = study([tmp_path / "volts.csv"], AnalysisOptions(**log))
    laid = next(iter(found.alignment.values()))
    assert laid.lag_s == pytest.approx(0.37, abs=max(4.0 * laid.u_lag_s, 3e-4))
    assert found.stimulus.name == "force"
    slope = found.sensors["volts"].receivers["left_V"].sensitivity_V_per_deg
    assert slope == pytest.approx(TRUE_V_PER_N[0], abs=5e-3)


def test_forces_are_decoded_with_their_bands(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    known, table = folder / "a.calibration.json", folder / "out.csv"
    figure = ["--figure", str(folder / "c.svg")]
    motion = ["--motion", "loaded"]
    assert run_command(["bench", "calibrate", str(folder / "a.csv"), *by_cell(folder), *motion, *figure]) == 0
    drawn, said = (folder / "c.svg").read_text(encoding="utf-8"), capfd.readouterr().out
    assert "decoded force (N)" in drawn
    assert "true" not in drawn
    assert all("load cell" in text for text in (drawn, said))
    assert "share an error with a standard uncertainty of 1 %" in said
    again = ["bench", "decode", str(known), str(folder / "again.csv"), *by_cell(folder), *motion, "--out", str(table)]
    assert run_command(again) == 0
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
def test_noise_of_the_cell_leaves_rest_and_hold_in_the_range(
    cell_noise_V: float, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cell.toml").write_text("[load_cell]\nN_per_V = 0.5\n", encoding="utf-8")
    options = AnalysisOptions(load_cell=tmp_path / "cell.toml", tare_s=0.9)
    path = Presses(cell_noise_V=cell_noise_V).write(tmp_path / "a.csv")
    studied = study([path], options)
    assert "use a longer --tare-s" not in str(studied.warnings)
    short = study([path], options.model_copy(update={"tare_s": 0.05}))
    assert ("use a longer --tare-s" in str(short.warnings)) is (cell_noise_V > 2e-3)
    found = calibrated_sensors(studied).calibrations[0].calibration
    other = Presses(seed=7, cell_noise_V=cell_noise_V)
    decoded = Decoder(found).decode(other.volts)
    assert not decoded.outside.mean() > 0.01
    force = other.force_N
    for part in (force < 1e-9, force > 0.2999, (force > 0.02) & (force < 0.28)):
        assert decoded.holds(force, 1)[part].mean() > 0.9
    middle = (force > 0.02) & (force < 0.28)
    assert np.median(np.ptp([decoded.low_deg[middle, 1], decoded.high_deg[middle, 1]], axis=0)) < 3e-3  # 4 u: 1 mN
    own = ["--load-cell", str(tmp_path / "cell.toml"), "--tare-s", "0.9"]
    assert run_command(["bench", "calibrate", str(path), *own]) == 0
    capfd.readouterr()
    args = ["bench", "decode", str(tmp_path / "a.calibration.json"), str(path), *own, "--out", str(tmp_path / "o.csv")]
    assert run_command(args) == 0
    said, total = capfd.readouterr().out, other.time_s.size
    force = 0.5 * (np.genfromtxt(path, delimiter=",", skip_header=1)[:, 1] - ZERO_V)
    beyond = ((force < found.angle_deg[0]) | (force > found.angle_deg[-1])).sum()
    counted = int(said.split(f" of {total} readings (")[0].split()[-1])
    assert counted == pytest.approx(beyond, abs=0.03 * total)  # its own tare


def test_a_board_decodes_newtons(folder: Path) -> None:
    known = folder / "a.calibration.json"
    assert run_command(["bench", "table", str(known), str(folder / "board")]) == 0
    assert "float *force_N, float *u_N" in (folder / "board" / "solen_decode.h").read_text(encoding="utf-8")


def coverage(seeds: int, folder: Path, bow: float = 0.005) -> tuple[np.ndarray, np.ndarray]:
    """Share of true forces within their bands of 68 and 95 %, over cells as [load_cell] states them; and its error."""
    shares, rng = [], np.random.default_rng(20)
    (folder / "cell.toml").write_text(CELL.replace("percent = 0.5", f"percent = {100.0 * bow}"), encoding="utf-8")
    options = AnalysisOptions(load_cell=folder / "cell.toml", tare_s=0.9)
    for seed in range(seeds):
        cell = Presses(seed=seed, scale=0.01 * rng.standard_normal(), bow=bow * rng.uniform(-1.0, 1.0), cycles=5)
        file = calibrated_sensors(study([cell.write(folder / "a.csv")], options)).calibrations[0]
        fresh = replace(cell, seed=seed + 10_000)
        inside = (fresh.force_N > 0.02) & (fresh.force_N < 0.28)
        decoded = Decoder(file.calibration).decode(fresh.volts[inside])
        true = fresh.force_N[inside, None]
        shares.append(((decoded.low_deg <= true) & (true <= decoded.high_deg)).mean(axis=0))
    return np.mean(shares, axis=0), np.std(shares, axis=0) / np.sqrt(seeds)


def test_bands_hold_the_true_force_whatever_the_cell_is(tmp_path: Path) -> None:
    # a cell's error is one for all readings of a seed: of 12 cells one may be beyond its band
    share, _ = coverage(12, tmp_path)
    assert (share >= [0.5, 0.85]).all()


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("bow", "least", "most"),
    [
        (0.0, (0.60, 0.91), (0.77, 0.98)),
        (0.005, (0.68, 0.95), (0.85, 0.995)),  # a bow vanishes without load, and bands do not know that
    ],
)
def test_bands_hold_the_true_force_at_length(
    bow: float, least: tuple[float, float], most: tuple[float, float], tmp_path: Path
) -> None:
    share, error = coverage(200, tmp_path, bow)
    print(f"bow {bow}: {share.round(3)} ± {error.round(3)}")
    assert (share >= least).all()
    assert (share <= most).all()


CELL_FILE, TARE = "--load-cell {}/cell.toml", "--tare-s 0.9"


@pytest.mark.parametrize(
    ("header", "more", "words"),
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
def test_what_a_force_lacks_is_said_in_one_line(
    header: str, more: str, words: tuple[str, ...], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cell.toml").write_text(CELL, encoding="utf-8")
    (tmp_path / "empty.toml").write_text("a = 1\n", encoding="utf-8")
    (tmp_path / "both.toml").write_text("[load_cell]\nN_per_V = 2.0\nmV_per_V = 2.0\n", encoding="utf-8")
    path = Presses(cycles=2).write(tmp_path / "a.csv", header)
    assert run_command(["bench", "analyse", str(path), *more.format(tmp_path).split()]) == 2
    line = capfd.readouterr().err
    assert line.count("\n") == 1
    assert all(word in line for word in words), line


def test_recordings_of_an_angle_and_of_a_force_are_not_mixed(folder: Path, tmp_path: Path) -> None:
    turned = Presses().write(tmp_path / "turned.csv", "angle_deg", 10.0)
    with pytest.raises(SolenError, match="--against"):
        study([turned, folder / "both.csv"])


def test_a_calibration_of_force_judges_only_forces(folder: Path) -> None:
    turned = Presses(seed=4).write(folder / "turned.csv", "angle_deg", 10.0)
    found = pipeline.decode(folder / "a.calibration.json", str(turned), signals=SignalOptions()).result
    assert isinstance(found, Decoding)
    assert found.against_angle is None
    assert found.highest_deg == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("option", ["--angle depth_mm", "--depth depth_mm", "--against depth"])
def test_a_column_of_what_is_not_decoded_is_refused(
    option: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    files = [str(folder / "a.calibration.json"), str(folder / "both.csv")]
    assert run_command(["bench", "decode", *files, *option.split()]) == 2
    line = capfd.readouterr().err
    assert all(word in line for word in (*option.split(), "force")), line
