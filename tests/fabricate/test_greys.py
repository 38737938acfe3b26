"""Grey pixels: the measurement of their light with the grey-steps coupon, and its use in drawings and predictions."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.optimize import brentq

from solen.errors import DataError, SpecError
from solen.fabricate.coupons import printable_coupon, written_coupons
from solen.fabricate.grey import Greys
from solen.fabricate.layers import Job, Slicing
from solen.fabricate.process import (
    FlatImage,
    GreyOptions,
    Process,
    default_process,
    dose_map,
    measured_greys,
    process_text,
    read_process,
    straight_edge_um,
)
from solen.geometry.coupons import CouponOptions
from solen.recording import Recording, read
from tests.command_support import answered, refusal
from tests.fabricate.print_support import settings
from tests.fabricate.test_layers import printer

GREYS = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 1.0)
EXPONENT = 1.8
"""Exponent of the light of a screen as a function of the grey level."""
DP, U_DP, EC, DOSE = 110.0, 5.0, 5.0, 200.0


def process_with_Dp() -> Process:
    """Return a process whose Dp was measured."""
    process = default_process().with_settings(Dp_um=DP)
    source, uncertainty = process.source | {"Dp_um": "measured"}, process.uncertainty | {"Dp_um": U_DP}
    return process.model_copy(update={"source": source, "uncertainty": uncertainty})


def table(folder: Path, rng: np.random.Generator, *, noise_um: float = 1.5, Dp: float = DP, **change: Any) -> Recording:
    """Return a table of simulated discs, cured according to Jacobs' law with the light of such a screen."""
    greys = np.array(change.get("greys", GREYS))
    depth = Dp * np.log(greys ** change.get("exponent", EXPONENT) * DOSE / EC) + rng.normal(0.0, noise_um, len(greys))
    path = folder / "steps.csv"
    rows = [f"{grey:g},{um:.3f},{max(noise_um, 0.01):g}" for grey, um in zip(greys, depth, strict=True)]
    path.write_text("\n".join(["grey,thickness_um,u_thickness_um", *rows]) + "\n", encoding="utf-8")
    return read(path)


def test_corrected_grey_levels_give_the_covered_fraction_of_light() -> None:
    response = tuple((grey, grey**2.2) for grey in np.linspace(0.1, 0.9, 9).tolist())
    corrected, uncorrected = Greys(response), Greys(response, corrected=False)
    fractions = np.arange(256) / 255.0
    assert np.abs(corrected.light - fractions).max() < 2.2 * 0.5 / 255.0 + 1e-3, "half a level, where it is steepest"
    assert uncorrected.light[64] == pytest.approx((64 / 255) ** 2.2, abs=2e-3)
    assert (uncorrected.levels == np.arange(256)).all()
    assert corrected.levels[[0, 255]].tolist() == [0, 255]
    assert (np.diff(corrected.levels.astype(int)) >= 0).all()


@pytest.mark.parametrize("exponent", [0.5, 1.0, 1.3, 2.2])
def test_the_shift_of_an_edge_is_the_mean_excess_of_light(exponent: float) -> None:
    """For uniformly distributed covered fractions c, the mean light is the integral of c^p, 1/(p + 1)."""
    assert Greys(exponent=exponent).shift == pytest.approx(1.0 / (exponent + 1.0) - 0.5, abs=2e-4)


@pytest.mark.parametrize("exponent", [1.0, 1.8])
def test_the_mean_of_printed_walls_agrees_with_the_closed_form(exponent: float) -> None:
    """The mean for eight positions in a pixel agrees to 0.9 µm, as the closed form assumes Gaussian pixels.

    With an exponent of 1.8, the wall is 4 µm farther inside than with proportional light.
    """
    process = settings(grey_power=exponent, halo_fraction=0.0, sigma_um=12.0, burn_in_layers=0)
    height, layers = 12.5, 40
    growths_um = []
    for phase in np.arange(8) / 8.0:
        strip = np.array([(-5.0, -2.0), (0.0, -2.0), (0.0, 2.0), (-5.0, 2.0)])
        strip = strip + np.array((2e-3 * process.pixel_um, 0.0))
        image = FlatImage.of([strip], np.array([(-0.5, -0.1), (0.5, 0.1)]), process, layers, (float(phase), 0.0))
        dose = dose_map(image, process, height)
        wall = brentq(lambda x, dose=dose: float(dose.log_excess(np.array([[x, 0.0]]))[0]), -60.0, 120.0)
        growths_um.append(wall - 2.0 * process.pixel_um)
    assert np.mean(growths_um) == pytest.approx(straight_edge_um(process, layers, height), abs=0.9)


def test_the_grey_steps_coupon_is_a_single_image(tmp_path: Path) -> None:
    files = written_coupons("grey-steps", CouponOptions(spacing_mm=1.0))[1]
    path = tmp_path / "grey-steps.json"
    path.write_bytes(files["grey-steps.json"])
    part, slicing = printable_coupon(path, Slicing())
    job = Job(part.solid, printer(50.0, 2000, 200), slicing)
    (layer,) = job.layers()
    assert (layer.exposure_s, job.count, job.burn_in_layers) == (6.0, 1, 0)
    columns = [round(float(x) * 8.0 / 0.05) + 1000 for x in np.arange(10) - 4.5]
    assert [int(layer.image[100, column]) for column in columns] == [round(255 * grey) for grey in GREYS]
    exposures = json.loads(path.read_text())["stages"][0]["exposures"]
    assert [row["grey"] for row in exposures] == list(GREYS)
    with pytest.raises(SpecError, match="--process"):
        Job(part.solid, printer(50.0, 2000, 200), slicing, grey_process(tmp_path).process.greys)


def grey_process(folder: Path) -> Process:
    """Return a process with a measured grey response."""
    return measured_greys(table(folder, np.random.default_rng(1)), process_with_Dp()).process


def test_recovers_the_light_of_grey_levels(tmp_path: Path) -> None:
    """Without noise, the light of each disc is exact, and corrected edges are not shifted."""
    result = measured_greys(table(tmp_path, np.random.default_rng(0), noise_um=0.0), process_with_Dp())
    assert result.light == pytest.approx(result.grey**EXPONENT, abs=1e-4)
    assert result.discs == (1,) * 8 + (2,)
    assert result.u_power == pytest.approx(U_DP / DP, rel=1e-2), "an error of Dp acts as an exponent"
    assert result.edge_shift_px == pytest.approx(1.0 / (EXPONENT + 1.0) - 0.5, abs=2e-3)
    assert abs(result.process.process.greys.shift) < 1e-3


def test_uncertainties_of_light_and_edge_shift_are_calibrated(tmp_path: Path) -> None:
    """In 300 tables with noise of 1.5 µm and errors of Dp of 5 %, the 95 % intervals contain the true values."""
    rng = np.random.default_rng(5)
    true_light, true_shift = 0.5**EXPONENT, 1.0 / (EXPONENT + 1.0) - 0.5
    covered = np.zeros(2)
    for _ in range(300):
        true_Dp = DP + rng.normal(0.0, U_DP)
        result = measured_greys(table(tmp_path, rng, Dp=true_Dp), process_with_Dp())
        greys = result.process.process.greys
        light = float(greys.light_of(np.array(0.5)))
        u_exponent = abs(np.log(light)) * light * result.u_power
        u_disc = float(result.u_light[result.grey == 0.5][0])
        covered[0] += abs(light - true_light) < 1.96 * np.hypot(u_exponent, u_disc)
        high, low = (Greys(greys.response, False, 1.0 + sign * result.u_power).shift for sign in (1.0, -1.0))
        covered[1] += abs(result.edge_shift_px - true_shift) < 1.96 * abs(high - low) / 2.0
    assert (covered / 300.0 > 0.92).all(), covered / 300.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("grey,thickness_um\n0.2,100\n0.4,200\n0.6,250\n0.8,300", "full grey level"),
        ("grey,thickness_um\n1,400\n0.5,250\n0.7,320", "at least 4 grey levels"),
        ("grey (%),thickness_um\n10,20\n120,40", "120"),
        ("grey,thickness_um\n255,400\n200,350\n150,180\n100,290\n50,100", "thickness"),
    ],
    ids=["no full level", "few levels", "above full level", "swapped discs"],
)
def test_refuses_invalid_tables(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "t.csv").write_text(f"{text}\n", encoding="utf-8")
    with pytest.raises(DataError, match=message):
        measured_greys(read(tmp_path / "t.csv"), process_with_Dp(), GreyOptions(u_thickness_um=2.0))


def test_layers_use_the_process_that_the_command_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    table(tmp_path, np.random.default_rng(3))
    result = answered(capfd, "print", "grey", "steps.csv", "--out", "mine.toml")
    assert any("Dp is assumed" in warning for warning in result["warnings"])
    process = read_process(Path("mine.toml"))
    assert len(process.process.grey) == 9
    assert process.uncertainty["grey_power"] == pytest.approx(result["u_power"])
    assert "grey_power" not in process.assumptions
    trimesh.creation.box((2.0, 2.0, 0.1)).export("box.stl")
    options = ("--process", "mine.toml", "--phase-px", "0.25", "0.5")
    layers = answered(capfd, "print", "layers", "box.stl", "--out", "out", *options)
    assert not any("50 µm" in warning for warning in layers["warnings"]), "the pixel of the process is an assumption"
    settings = json.loads(Path(layers["files"]["settings"]).read_text(encoding="utf-8"))
    assert (settings["process"], settings["phase_px"]) == ("mine.toml", [0.25, 0.5])
    assert settings["greys"] == [list(pair) for pair in process.process.grey]
    with zipfile.ZipFile(layers["files"]["layers"]) as archive:
        assert "grey response" in json.loads(archive.read("job.json"))["rule"]
    sheet = Path(layers["files"]["sheet"]).read_text(encoding="utf-8")
    assert "9 measured grey levels of `mine.toml`" in sheet
    assert "0.25, 0.5" in sheet


def test_warns_of_a_process_measured_with_other_pixels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((2.0, 2.0, 0.1)).export("box.stl")
    process = grey_process(tmp_path)
    Path("mine.toml").write_text(process_text(process.with_settings(pixel_um=50.0, pixel_y_um=50.0)), encoding="utf-8")
    command = ("print", "layers", "box.stl", "--out", "out")
    result = answered(capfd, *command, "--process", "mine.toml")
    assert not any("50 µm" in warning for warning in result["warnings"])
    Path("mine.toml").write_text(process_text(process.with_settings(pixel_um=27.0)), encoding="utf-8")
    result = answered(capfd, *command, "--process", "mine.toml")
    assert any("27 µm" in warning and "50 µm" in warning for warning in result["warnings"])


@pytest.mark.parametrize("options", [("--format", "goo"), ("--no-anti-aliasing",)])
def test_refuses_image_options_without_images(
    options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((2.0, 2.0, 0.1)).export("box.stl")
    command = ("print", "layers", "box.stl", "--out", "out", "--sheet-only")
    assert "--sheet-only" in refusal(capfd, tmp_path, *command, *options)


def test_grey_response_with_the_spectrum_of_a_lamp(tmp_path: Path) -> None:
    """The thickness of each disc is a root: the depth at which the sum over the lines is the critical dose."""
    lines = ((0.5, 1.6), (0.5, 0.4))
    process = process_with_Dp().with_settings(lamp=lines)
    s = process.process
    greys, light = np.array([0.4, 0.6, 0.8, 1.0]), np.array([0.25, 0.5, 0.75, 1.0])

    def excess(um: float, dose: float) -> float:
        return dose * sum(w * float(np.exp(-um * r / s.Dp_um)) for w, r in lines) - s.Ec_mJ_per_cm2

    um = [brentq(excess, 0.0, 5000.0, args=(40.0 * s.Ec_mJ_per_cm2 * fraction,)) for fraction in light]
    path = tmp_path / "lamp.csv"
    rows = [f"{grey},{thickness}" for grey, thickness in zip(greys, um, strict=True) for _ in range(2)]
    path.write_text("\n".join(["grey,thickness_um", *rows]) + "\n", encoding="utf-8")
    result = measured_greys(read(path), process, GreyOptions(u_thickness_um=1.0))
    assert np.allclose(result.light, light, rtol=1e-4)


def test_refuses_a_missing_thickness_of_a_level_that_must_cure(tmp_path: Path) -> None:
    path = tmp_path / "steps.csv"
    table(tmp_path, np.random.default_rng(1))
    lines = path.read_text(encoding="utf-8").split("\n")
    grey, _, u = lines[4].split(",")
    path.write_text("\n".join([*lines[:4], f"{grey},,{u}", *lines[5:]]), encoding="utf-8")
    with pytest.raises(DataError, match=r"thickness.*row 4.*0\.7"):
        measured_greys(read(path), process_with_Dp())


@pytest.mark.parametrize(("u_disc_um", "u_scale_percent"), [(4.0, 0.0), (1.0, 4.0)])
def test_uncertainties_include_common_errors_of_all_discs(
    u_disc_um: float, u_scale_percent: float, tmp_path: Path
) -> None:
    """In 300 tables, all levels are compared with the same disc of full grey, or measured by a gauge with an error.

    The exponent is fitted to the light with the weights of the errors, and compared with its stated uncertainty.
    """
    rng = np.random.default_rng(11)
    exact = process_with_Dp()
    exact = exact.model_copy(update={"uncertainty": exact.uncertainty | {"Dp_um": 0.0}})
    errors, logs = [], EXPONENT * np.log(np.array(GREYS[1:]))
    for _ in range(300):
        gauge = 1.0 + 0.01 * u_scale_percent * rng.normal()
        depth = DP * np.log(np.array(GREYS) ** EXPONENT * DOSE / EC) + rng.normal(0.0, u_disc_um, len(GREYS))
        rows = [f"{grey:g},{gauge * um:.4f},{u_disc_um}" for grey, um in zip(GREYS, depth, strict=True)]
        path = tmp_path / "gauge.csv"
        path.write_text("\n".join(["grey,thickness_um,u_thickness_um", *rows]), encoding="utf-8")
        result = measured_greys(read(path), exact, GreyOptions(u_scale_percent=u_scale_percent))
        measured = np.log(np.interp(GREYS[1:], result.grey, result.light))
        weights = np.linalg.inv(np.eye(len(logs)) + 1.0)
        errors.append((logs @ weights @ measured / (logs @ weights @ logs) - 1.0) / result.u_power)
    assert np.mean(np.abs(errors) < 1.96) == pytest.approx(0.95, abs=0.03)
