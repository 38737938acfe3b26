"""The scale of an objective from simulated images of stage micrometers, drawn from a closed formula."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as Pillow
from scipy.special import erf

from solen.errors import DataError, SpecError
from solen.metrology import InspectOptions, read_image
from solen.metrology.image import read_plane
from solen.metrology.micrometer import MeasuredScale, MicrometerOptions, measured_scale
from solen.metrology.scale import read_scale, scale_text
from solen.recording import Provenance
from tests.command_support import answered

SOURCE = Provenance("micrometer.png", "0" * 64, "png", simulated=True)


def ruler(
    rng: np.random.Generator, period: float, angle_deg: float, *, shape: tuple[int, int] = (300, 420), **options: Any
) -> NDArray[np.float64]:
    """Return blurred dark lines, every tenth of them longer, on a non-uniform background with noise."""
    rows, columns = shape
    y, x = np.indices(shape)
    turn = np.deg2rad(angle_deg)
    s = (x - columns / 2) * np.cos(turn) + (y - rows / 2) * np.sin(turn)
    t = (y - rows / 2) * np.cos(turn) - (x - columns / 2) * np.sin(turn)
    s = s + options.get("stretch", 0.0) * s**2 / columns
    start, width, blur = rng.uniform(0.0, period), options.get("width", 0.22) * period, options.get("blur", 1.3)
    grey = 0.75 + 0.08 * x / columns - 0.05 * (y / rows) ** 2
    nearest = np.rint((s - start) / period)
    for number in (nearest - 1.0, nearest, nearest + 1.0):  # lines farther away contribute less than 1e-8
        half_length = np.where(number % 10.0 == 0.0, 0.5, options.get("reach", 0.32)) * rows
        at = s - start - number * period
        line = 0.5 * (erf((at + 0.5 * width) / (blur * 2**0.5)) - erf((at - 0.5 * width) / (blur * 2**0.5)))
        grey -= options.get("contrast", 0.45) * line * 0.5 * (1.0 - erf((np.abs(t) - half_length) / 2.0))
    return np.clip(grey + rng.normal(0.0, options.get("noise", 0.02), shape), 0.0, 1.0)


def measured(grey: NDArray[np.float64], **options: Any) -> MeasuredScale:
    return measured_scale(grey, SOURCE, MicrometerOptions(**{"spacing_mm": 0.01} | options))


@pytest.mark.parametrize("angle_deg", [0.0, 0.7, -12.0, 33.0, 45.0, 88.0, 90.0])
def test_period_at_any_angle(angle_deg: float) -> None:
    scale = measured(ruler(np.random.default_rng(1), 17.3, angle_deg))
    assert scale.um_per_px == pytest.approx(10.0 / 17.3, rel=3e-4)
    assert abs(scale.um_per_px - 10.0 / 17.3) < 4.0 * scale.u_um_per_px
    assert (scale.angle_deg - angle_deg + 90.0) % 180.0 - 90.0 == pytest.approx(0.0, abs=0.05)
    assert scale.stretch_percent is None
    assert scale.lines >= 12
    assert scale.simulated


def error_ratios(count: int) -> NDArray[np.float64]:
    """Return errors over stated uncertainties, for images of various periods, angles, blurs and noise."""
    rng = np.random.default_rng(4)
    ratios = []
    for _ in range(count):
        period, angle = rng.uniform(9.0, 28.0), rng.uniform(-90.0, 90.0)
        noise, blur = rng.uniform(0.005, 0.04), rng.uniform(0.8, 2.0)
        scale = measured(ruler(rng, period, angle, shape=(240, 320), noise=noise, blur=blur))
        ratios.append((scale.um_per_px * period / 10.0 - 1.0) / (scale.u_um_per_px / scale.um_per_px))
    return np.array(ratios)


def test_coverage_of_uncertainty() -> None:
    """In 40 images, 90 to 100 % of the 95 % intervals contain the true value."""
    ratios = error_ratios(40)
    assert np.mean(np.abs(ratios) < 1.96) >= 0.9
    assert np.sqrt(np.mean(np.square(ratios))) < 1.2


@pytest.mark.evidence
def test_coverage_of_uncertainty_in_300_images() -> None:
    """The true value is within 1.96 u in 95 % of 300 images, to within their statistical uncertainty."""
    ratios = np.abs(error_ratios(300))
    within = [f"{np.mean(ratios < limit):.3f} within {limit} u" for limit in (1.0, 1.96, 3.0)]
    print(", ".join(within))
    assert 0.935 <= np.mean(ratios < 1.96) <= 0.975


def test_bright_lines_and_certificate() -> None:
    dark = ruler(np.random.default_rng(2), 20.0, 5.0)
    bare, certified = measured(1.0 - dark), measured(1.0 - dark, u_spacing_mm=2e-5)
    assert bare.um_per_px == pytest.approx(0.5, rel=3e-4)
    assert certified.u_um_per_px == pytest.approx(np.hypot(bare.u_um_per_px, 2e-3 * bare.um_per_px), rel=1e-6)
    assert any("--u-spacing-mm" in line for line in bare.warnings)
    assert not certified.warnings


def test_reports_scale_that_changes_across_image() -> None:
    """At positions s + 0.02 s²/w, the local scale changes by 4 % from side to side, and u covers that."""
    scale = measured(ruler(np.random.default_rng(3), 18.0, 0.0, stretch=0.02))
    assert scale.stretch_percent is not None
    assert abs(scale.stretch_percent) == pytest.approx(4.0, rel=0.15)
    assert scale.u_um_per_px / scale.um_per_px == pytest.approx(0.04 / np.sqrt(12.0), rel=0.2)


@pytest.mark.parametrize("kind", ["noise", "uniform", "one line", "three lines"])
def test_rejects_image_without_equal_lines(kind: str) -> None:
    rng = np.random.default_rng(5)
    grey = {
        "noise": rng.uniform(0.0, 1.0, (200, 200)),
        "uniform": np.full((200, 200), 0.4),
        "one line": ruler(rng, 900.0, 0.0, width=0.01),
        "three lines": ruler(rng, 140.0, 0.0, width=0.05),
    }[kind]
    with pytest.raises(DataError, match=r"micrometer\.png"):
        measured(grey)


def test_scale_file_of_command_is_accepted_by_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    grey = ruler(np.random.default_rng(6), 16.0, 3.0)
    Pillow.fromarray(np.rint(255 * grey).astype(np.uint8)).save("micrometer.png")
    printed = answered(
        capfd, "print", "scale", "micrometer.png", "--spacing-mm", "0.01", "--objective", "10x", "--out", "s.toml"
    )
    scale = read_scale(Path("s.toml"))
    assert (scale.um_per_px, scale.u_um_per_px) == (printed["um_per_px"], printed["u_um_per_px"])
    assert (scale.objective, scale.columns, scale.rows) == ("10x", 420, 300)
    assert "micrometer.png" in scale.source
    options = InspectOptions(scale=Path("s.toml"))
    image = read_image(Path("micrometer.png"), options.um_per_px, options.u_um_per_px)
    assert (image.scale.um_per_px, image.scale.u_um_per_px) == (scale.um_per_px, scale.u_um_per_px)
    assert read_plane(Path("micrometer.png"))[0].grey.shape == (300, 420)
    assert not any("rescaled" in line for line in read_image(Path("micrometer.png"), options=options).warnings)
    Pillow.open("micrometer.png").resize((210, 150)).save("half.png")
    assert any("rescaled" in line for line in read_image(Path("half.png"), options=options).warnings)
    with pytest.raises(SpecError, match="--um-per-px"):
        InspectOptions(scale=Path("s.toml"), um_per_px=1.0)
    Path("t.toml").write_text(scale_text(scale).replace("um_per_px = ", "um_per_px = -", 1), encoding="utf-8")
    with pytest.raises(DataError, match=r"t\.toml"):
        InspectOptions(scale=Path("t.toml"))
