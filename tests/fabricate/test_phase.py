"""The place of a lens in its pixels: the same in the model as in the layers, and chosen for its shape."""

import numpy as np
import pytest

from solen.fabricate.layers import Job, Slicing, solid_of
from solen.fabricate.process import FlatImage, PrintOptions, as_designed, print_design, rings_of
from solen.sensor import Sensor
from tests.fabricate.print_support import settings
from tests.fabricate.solid_support import body_of, design, part_of
from tests.fabricate.test_layers import printer


def test_the_place_in_the_pixel_is_the_one_that_layers_draw() -> None:
    """One outline on pixels of 60 µm: the model's image is the layers', pixel by pixel, wherever the origin stands."""
    part, rings = part_of(design()), rings_of(as_designed(body_of(design())))
    one = settings(pixel_um=60.0, sigma_um=30.0, halo_um=30.0, halo_per_depth=0.0, halo_fraction=0.0)
    for phase in ((0.0, 0.0), (0.5, 0.25)):
        job = Job(solid_of(part, np.eye(3)), printer(60.0), Slicing(layer_um=1000.0, phase_px=phase))
        drawn = job.copy_of_layer(0) / 255.0
        extent = np.array([(-2.0, -0.5), (2.0, 1.0)])
        image = FlatImage.of(rings, extent, one, 4, phase)
        corner = np.array(job.tile_from_mm) - job.solid.origin_mm
        column, row = np.rint((corner - 1e-3 * np.array(image.corner_um)) / 0.06).astype(int)
        assert (corner - 1e-3 * np.array(image.corner_um)) / 0.06 == pytest.approx([column, row], abs=1e-6)
        top, left = max(row, 0), max(column, 0)
        rows = min(image.shares.shape[0], row + drawn.shape[0]) - top
        columns = min(image.shares.shape[1], column + drawn.shape[1]) - left
        theirs = drawn[top - row : top - row + rows, left - column : left - column + columns]
        ours = image.shares[top : top + rows, left : left + columns]
        assert ours.size > 2000
        assert np.abs(ours - theirs).max() <= 1.01 / 255.0


def test_a_chosen_place_in_the_pixel_is_no_worse_than_any_tried() -> None:
    """Pixels of 50 µm: at the best place the shape is off by a sixth less than at the worst, at least."""
    sensor = Sensor.of(design())
    options = PrintOptions(choose_phase=True, printer="generic")
    found = print_design(sensor, options, response=False)
    assert found.phase is not None
    assert found.phase.shape_um <= found.phase.on_a_corner_um <= found.phase.worst_um
    assert found.phase.shape_um < 0.84 * found.phase.worst_um
    assert "place in the pixel" not in found.contributions_um, "it is known then"
    again = print_design(sensor, PrintOptions(phase_px=found.phase.phase_px, printer="generic"), response=False)
    assert again.deviation.rms_um == pytest.approx(found.deviation.rms_um, abs=1e-9)
