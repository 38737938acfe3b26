"""Images of 60 to 100 pixels: measured within their uncertainty, or refused for their number of pixels."""

import numpy as np
import pytest

from solen.errors import DataError
from solen.metrology import as_image, measure_lens
from tests.metrology.inspect_support import Shot, lens
from tests.metrology.render.optics import gaussian
from tests.metrology.render.shape import shipped

WIDTH_MM = 4.0


def rendered(across: float, light: str, seed: int) -> tuple[np.ndarray, float]:
    """A lens of so many pixels, sharp, seen as a whole; its grey values and the size of a pixel in µm."""
    um = 1e3 * WIDTH_MM / across
    shot = Shot(
        lens(), um_per_px=um, light=light, optics=gaussian(1.0), size_um=(6400.0, 4400.0), vertex_um=(3200.0, 3000.0)
    )
    grey = shot.taken(seed)
    return grey / float(np.iinfo(grey.dtype).max), um


@pytest.mark.parametrize("across", [60, 66, 75, 85, 100])
def test_a_small_image_is_measured_as_well_as_it_says(across: int) -> None:
    """A print without a fault: no overgrowth and no shape beyond their uncertainties, and few pixels said."""
    for seed in (1, 2):
        grey, um = rendered(across, "reflected", seed)
        assert min(grey.shape) < 120
        found = measure_lens(as_image(grey, um), shipped("solen-860"))
        assert abs(found.size.overgrowth_um) < 4.0 * found.size.u_overgrowth_um
        assert found.deviation.rms_um < 0.1 * um
        assert found.deviation.rms_um < 2.5 * found.deviation.u_rms_um
        assert any(f"{across} pixels wide" in line for line in found.warnings)


def test_two_edges_in_few_pixels_are_refused_for_their_pixels() -> None:
    """Lit from below, two faces 50 µm apart: three quarters of a pixel."""
    grey, um = rendered(60, "transmitted", 1)
    with pytest.raises(DataError) as refused:
        measure_lens(as_image(grey, um), shipped("solen-860"))
    assert "60 pixels wide" in str(refused.value)
    assert "20 µm per pixel or less" in str(refused.value)
    assert "--um-per-px" not in str(refused.value), "the scale is right"


def test_fewer_pixels_are_refused_before_anything_is_looked_for() -> None:
    grey, um = rendered(50, "reflected", 1)
    with pytest.raises(DataError, match="50 pixels wide; at least 60 are needed"):
        measure_lens(as_image(grey, um), shipped("solen-860"))


def test_a_lens_of_many_pixels_has_no_such_warning() -> None:
    grey, um = rendered(300, "reflected", 1)
    found = measure_lens(as_image(grey, um), shipped("solen-860"))
    assert not any("pixels wide" in line for line in found.warnings)
