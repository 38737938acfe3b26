"""Lenses of 60 to 100 pixels: measured within their uncertainty, or rejected for lack of pixels."""

import numpy as np
import pytest

from solen.errors import DataError
from solen.metrology import as_image, measure_lens
from tests.metrology.inspect_support import Shot, lens
from tests.metrology.render.optics import gaussian
from tests.metrology.render.shape import shipped

WIDTH_MM = 4.0


def rendered(across: float, light: str, seed: int) -> tuple[np.ndarray, float]:
    """Return a sharp image of an entire lens of a width in pixels, and the pixel size in µm."""
    um_per_px = 1e3 * WIDTH_MM / across
    shot = Shot(
        lens(),
        um_per_px=um_per_px,
        light=light,
        optics=gaussian(1.0),
        size_um=(6400.0, 4400.0),
        vertex_um=(3200.0, 3000.0),
    )
    grey = shot.taken(seed)
    return grey / float(np.iinfo(grey.dtype).max), um_per_px


@pytest.mark.parametrize("across", [60, 66, 75, 85, 100])
def test_small_image_is_measured_within_uncertainty(across: int) -> None:
    """Overgrowth and form of a perfect print are 0 within their uncertainties, and a warning names the pixels."""
    for seed in (1, 2):
        grey, um_per_px = rendered(across, "reflected", seed)
        assert min(grey.shape) < 120
        inspection = measure_lens(as_image(grey, um_per_px), shipped("solen-860"))
        assert abs(inspection.size.overgrowth_um) < 4.0 * inspection.size.u_overgrowth_um
        assert inspection.deviation.rms_um < 0.1 * um_per_px
        assert inspection.deviation.rms_um < 2.5 * inspection.deviation.u_rms_um
        assert any(f"{across} pixels wide" in line for line in inspection.warnings)


def test_rejects_unresolved_edges_for_lack_of_pixels() -> None:
    """In transmitted light, two faces are 50 µm, or three quarters of a pixel, apart."""
    grey, um_per_px = rendered(60, "transmitted", 1)
    with pytest.raises(DataError) as error:
        measure_lens(as_image(grey, um_per_px), shipped("solen-860"))
    assert "60 pixels wide" in str(error.value)
    assert "a pixel covers at most 20 µm" in str(error.value)
    assert "--um-per-px" not in str(error.value), "the scale is correct"


def test_rejects_too_few_pixels() -> None:
    grey, um_per_px = rendered(50, "reflected", 1)
    with pytest.raises(DataError, match="50 pixels wide; at least 60 are needed"):
        measure_lens(as_image(grey, um_per_px), shipped("solen-860"))


def test_lens_of_many_pixels_has_no_warning() -> None:
    grey, um_per_px = rendered(300, "reflected", 1)
    inspection = measure_lens(as_image(grey, um_per_px), shipped("solen-860"))
    assert not any("pixels wide" in line for line in inspection.warnings)
