"""The position of a lens in the pixels: equal in model and layers, and optimised for the shape."""

import numpy as np
import pytest

from solen.fabricate.layers import Job, Slicing, solid_of
from solen.fabricate.process import FlatImage, PrintOptions, as_designed, print_design, rings_of
from solen.sensor import Sensor
from tests.fabricate.print_support import settings
from tests.fabricate.solid_support import body_of, design, part_of
from tests.fabricate.test_layers import printer


def test_images_of_the_model_and_of_layers_agree() -> None:
    """The images of an outline on pixels of 60 µm agree pixel by pixel for several positions of the origin."""
    part, rings = part_of(design()), rings_of(as_designed(body_of(design())))
    process = settings(pixel_um=60.0, sigma_um=30.0, halo_um=30.0, halo_per_depth=0.0, halo_fraction=0.0)
    for phase in ((0.0, 0.0), (0.5, 0.25)):
        job = Job(solid_of(part, np.eye(3)), printer(60.0), Slicing(layer_um=1000.0, phase_px=phase))
        layer = job.copy_of_layer(0) / 255.0
        extent = np.array([(-2.0, -0.5), (2.0, 1.0)])
        image = FlatImage.of(rings, extent, process, 4, phase)
        corner = np.array(job.tile_from_mm) - job.solid.origin_mm
        column, row = np.rint((corner - 1e-3 * np.array(image.corner_um)) / 0.06).astype(int)
        assert (corner - 1e-3 * np.array(image.corner_um)) / 0.06 == pytest.approx([column, row], abs=1e-6)
        top, left = max(row, 0), max(column, 0)
        rows = min(image.light.shape[0], row + layer.shape[0]) - top
        columns = min(image.light.shape[1], column + layer.shape[1]) - left
        layer = layer[top - row : top - row + rows, left - column : left - column + columns]
        light = image.light[top : top + rows, left : left + columns]
        assert light.size > 2000
        assert np.abs(light - layer).max() <= 1.01 / 255.0


def test_optimises_the_position_in_the_pixel() -> None:
    """With pixels of 50 µm, the best position reduces the deviation of the worst by more than a sixth."""
    sensor = Sensor.of(design())
    options = PrintOptions(choose_phase=True, printer="generic")
    result = print_design(sensor, options, response=False)
    phase = result.phase
    assert phase is not None
    assert phase.shape_um <= phase.on_a_corner_um <= phase.worst_um
    assert phase.shape_um < 0.84 * phase.worst_um
    assert "position in the pixel" not in result.contributions_um, "the position is known"
    repeated = print_design(sensor, PrintOptions(phase_px=phase.phase_px, printer="generic"), response=False)
    assert repeated.deviation.rms_um == pytest.approx(result.deviation.rms_um, abs=1e-9)
