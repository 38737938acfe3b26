"""The scale of an objective from simulated images of stage micrometers, drawn by their own closed form."""

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
    rng: np.random.Generator, period: float, angle_deg: float, *, shape: tuple[int, int] = (300, 420), **more: Any
) -> NDArray[np.float64]:
    """Dark lines of a width, blurred, each tenth longer, on an uneven background with noise; the closed form."""
    rows, columns = shape
    y, x = np.indices(shape)
    turn = np.deg2rad(angle_deg)
    s = (x - columns / 2) * np.cos(turn) + (y - rows / 2) * np.sin(turn)
    t = (y - rows / 2) * np.cos(turn) - (x - columns / 2) * np.sin(turn)
    s = s + more.get("stretch", 0.0) * s**2 / columns
    start, width, blur = rng.uniform(0.0, period), more.get("width", 0.22) * period, more.get("blur", 1.3)
    grey = 0.75 + 0.08 * x / columns - 0.05 * (y / rows) ** 2
    for number in range(-int(columns / period) - 2, int(columns / period) + 3):
        high = 0.5 * rows if number % 10 == 0 else more.get("reach", 0.32) * rows
        at = s - start - number * period
        line = 0.5 * (erf((at + 0.5 * width) / (blur * 2**0.5)) - erf((at - 0.5 * width) / (blur * 2**0.5)))
        grey -= more.get("contrast", 0.45) * line * 0.5 * (1.0 - erf((np.abs(t) - high) / 2.0))
    return np.clip(grey + rng.normal(0.0, more.get("noise", 0.02), shape), 0.0, 1.0)


def measured(grey: NDArray[np.float64], **options: Any) -> MeasuredScale:
    return measured_scale(grey, SOURCE, MicrometerOptions(**{"spacing_mm": 0.01} | options))


@pytest.mark.parametrize("angle_deg", [0.0, 0.7, -12.0, 33.0, 45.0, 88.0, 90.0])
def test_a_period_comes_back_at_any_angle(angle_deg: float) -> None:
    found = measured(ruler(np.random.default_rng(1), 17.3, angle_deg))
    assert found.um_per_px == pytest.approx(10.0 / 17.3, rel=3e-4)
    assert abs(found.um_per_px - 10.0 / 17.3) < 4.0 * found.u_um_per_px
    assert (found.angle_deg - angle_deg + 90.0) % 180.0 - 90.0 == pytest.approx(0.0, abs=0.05)
    assert found.stretch_percent is None
    assert found.lines >= 12
    assert found.simulated


def over_u(count: int) -> NDArray[np.float64]:
    """Errors over stated uncertainties of images of other periods, angles, widths and noise."""
    rng = np.random.default_rng(4)
    off = []
    for _ in range(count):
        period, angle = rng.uniform(9.0, 28.0), rng.uniform(-90.0, 90.0)
        noise, blur = rng.uniform(0.005, 0.04), rng.uniform(0.8, 2.0)
        found = measured(ruler(rng, period, angle, shape=(240, 320), noise=noise, blur=blur))
        off.append((found.um_per_px * period / 10.0 - 1.0) / (found.u_um_per_px / found.um_per_px))
    return np.array(off)


def test_the_stated_uncertainty_covers() -> None:
    """40 images: within 95 % intervals in 90 to 100 %."""
    off = over_u(40)
    assert np.mean(np.abs(off) < 1.96) >= 0.9
    assert np.sqrt(np.mean(np.square(off))) < 1.2


@pytest.mark.evidence
def test_the_stated_uncertainty_covers_300_images() -> None:
    """Within 1.96 u in 95 %, to what 300 tell."""
    off = np.abs(over_u(300))
    print(
        f"within u {np.mean(off < 1):.3f}, within 1.96 u {np.mean(off < 1.96):.3f}, beyond 3 u {np.mean(off > 3):.3f}"
    )
    assert 0.935 <= np.mean(off < 1.96) <= 0.975


def test_bright_lines_and_a_certificate() -> None:
    dark = ruler(np.random.default_rng(2), 20.0, 5.0)
    plain, stated = measured(1.0 - dark), measured(1.0 - dark, u_spacing_mm=2e-5)
    assert plain.um_per_px == pytest.approx(0.5, rel=3e-4)
    assert stated.u_um_per_px == pytest.approx(np.hypot(plain.u_um_per_px, 2e-3 * plain.um_per_px), rel=1e-6)
    assert any("own uncertainty" in line for line in plain.warnings)
    assert not stated.warnings


def test_a_scale_that_changes_across_the_image_is_said() -> None:
    """Places s + 0.02 s²/w: the local scale changes by 4 % from side to side, and u holds that."""
    found = measured(ruler(np.random.default_rng(3), 18.0, 0.0, stretch=0.02))
    assert found.stretch_percent is not None
    assert abs(found.stretch_percent) == pytest.approx(4.0, rel=0.15)
    assert found.u_um_per_px / found.um_per_px == pytest.approx(0.04 / np.sqrt(12.0), rel=0.2)


@pytest.mark.parametrize("kind", ["noise", "even", "one line", "three lines"])
def test_what_is_no_micrometer_is_refused(kind: str) -> None:
    rng = np.random.default_rng(5)
    grey = {
        "noise": rng.uniform(0.0, 1.0, (200, 200)),
        "even": np.full((200, 200), 0.4),
        "one line": ruler(rng, 900.0, 0.0, width=0.01),
        "three lines": ruler(rng, 140.0, 0.0, width=0.05),
    }[kind]
    with pytest.raises(DataError, match=r"micrometer\.png"):
        measured(grey)


def test_the_command_writes_a_scale_that_others_take(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    grey = ruler(np.random.default_rng(6), 16.0, 3.0)
    Pillow.fromarray(np.rint(255 * grey).astype(np.uint8)).save("micrometer.png")
    said = answered(
        capfd, "print", "scale", "micrometer.png", "--spacing-mm", "0.01", "--objective", "10x", "--out", "s.toml"
    )
    found = read_scale(Path("s.toml"))
    assert (found.um_per_px, found.u_um_per_px) == (said["um_per_px"], said["u_um_per_px"])
    assert (found.objective, found.columns, found.rows) == ("10x", 420, 300)
    assert "micrometer.png" in found.source
    options = InspectOptions(scale=Path("s.toml"))
    image = read_image(Path("micrometer.png"), options.um_per_px, options.u_um_per_px)
    assert (image.scale.um_per_px, image.scale.u_um_per_px) == (found.um_per_px, found.u_um_per_px)
    assert read_plane(Path("micrometer.png"))[0].grey.shape == (300, 420)
    assert not any("rescaled" in line for line in read_image(Path("micrometer.png"), options=options).warnings)
    Pillow.open("micrometer.png").resize((210, 150)).save("half.png")
    assert any("rescaled" in line for line in read_image(Path("half.png"), options=options).warnings)
    with pytest.raises(SpecError, match="--um-per-px"):
        InspectOptions(scale=Path("s.toml"), um_per_px=1.0)
    Path("t.toml").write_text(scale_text(found).replace("um_per_px = ", "um_per_px = -", 1), encoding="utf-8")
    with pytest.raises(DataError, match=r"t\.toml"):
        InspectOptions(scale=Path("t.toml"))
