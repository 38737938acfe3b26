"""Doses of the print model agree with Jacobs' law for slabs and with direct sums."""

import math

import numpy as np
import pytest

from solen.errors import DataError
from solen.fabricate.process import FlatImage, dose_map, straight_edge_um, terms_at
from solen.fabricate.process.growth import growth_um, with_growth
from solen.material.cure import cure_depth_um, stack_dose, stack_print_through_um
from tests.fabricate.direct_dose import cured_um, dose_at
from tests.fabricate.print_support import settings

SMALL = {"halo_um": 40.0, "halo_per_depth": 0.1}
"""A halo that fits into a small image."""


@pytest.mark.parametrize(("Dp", "Ec", "seconds"), [(100.0, 5.0, 2.0), (60.0, 11.0, 1.0), (250.0, 0.7, 5.0)])
def test_the_cure_depth_of_a_slab_follows_jacobs(Dp: float, Ec: float, seconds: float) -> None:
    process = settings(Dp_um=Dp, Ec_mJ_per_cm2=Ec, exposure_s=seconds, burn_in_layers=0)
    assert cured_um(process) == pytest.approx(float(cure_depth_um(13.0 * seconds, Dp, Ec)), abs=1e-9)


def test_the_print_through_of_many_layers_is_that_of_their_total_dose() -> None:
    process = settings(burn_in_layers=0)
    # 400 layers of 25 µm are 100 penetration depths: later layers would add a fraction of 1e-44
    below_first_layer = cured_um(process, 400) - process.layer_um
    assert below_first_layer == pytest.approx(stack_print_through_um(26.0, 25.0, 100.0, 5.0), abs=1e-9)


def test_the_dose_of_a_slab_is_that_of_a_stack_of_layers() -> None:
    process = settings()
    stack = stack_dose(process.Dp_um, process.layer_um, process.exposures(30))
    images = FlatImage(np.ones((8, 12)), 30)
    for height in (0.0, 3.0, 25.0, 140.0, 151.0, 500.0, 749.0):
        dose = dose_map(images, process, height).dose
        assert np.allclose(dose, stack.at(height), rtol=1e-8)  # contributions below 1e-9 are omitted


@pytest.mark.parametrize("pixels", [{}, {"pixel_y_um": 19.0}, {"pixel_um": 14.0, "pixel_y_um": 27.0}])
def test_the_dose_agrees_with_direct_sums(pixels: dict[str, float]) -> None:
    """For square and rectangular pixels."""
    process = settings(**SMALL, **pixels)
    rng = np.random.default_rng(7)
    image = np.zeros((40, 36))
    image[14:24, 14:22] = rng.random((10, 8))
    images = np.repeat(image[None], 5, axis=0)
    for height in (10.0, 30.0, 112.5):
        dose = dose_map(FlatImage(image, 5), process, height)
        rows, columns = rng.integers(50, 100, (2, 60))
        nodes = np.column_stack([columns, rows]) * dose.step_um + dose.first_um
        assert np.allclose(dose.dose[rows, columns], dose_at(images, process, nodes, height), rtol=1e-9)
        points = rng.uniform(14.0, 24.0, (60, 2)) * process.pixels_um
        expected = np.log(dose_at(images, process, points, height) / process.Ec_mJ_per_cm2)
        assert np.allclose(dose.log_excess(points), expected, atol=1e-3), "interpolated by a spline"


def test_the_grid_is_finer_for_a_smaller_blur() -> None:
    assert settings().pixel_light.fine == 4
    sharp = settings(sigma_um=5.0)
    assert sharp.pixel_light.fine > 8
    image = np.zeros((30, 30))
    image[10:20, 10:20] = 1.0
    dose = dose_map(FlatImage(image, 2), sharp, 40.0)
    points = np.array([[290.0, 400.0], [265.0, 400.0], [400.0, 545.0]])
    expected = np.log(dose_at(np.array([image, image]), sharp, points, 40.0) / sharp.Ec_mJ_per_cm2)
    assert np.allclose(dose.log_excess(points), expected, atol=2e-2)
    with pytest.raises(DataError, match=r"process\.sigma_um = 1\.0; must be at least .* for pixels of 27 µm"):
        _ = settings(sigma_um=1.0).pixel_light.fine


def test_a_straight_wall_agrees_with_direct_sums() -> None:
    process = settings(pixel_um=3.0, **SMALL)
    images = np.zeros((12, 500, 300))
    images[:, :, :150] = 1.0
    wall = np.array([[450.0 + straight_edge_um(process, 12, 110.0), 750.0]])
    # the closed form includes the variance of the position in a pixel, 0.75 of 227 µm², which is absent here
    assert float(dose_at(images, process, wall, 110.0)[0]) == pytest.approx(5.0, rel=0.01)


def test_a_height_receives_light_of_its_own_and_later_layers() -> None:
    process = settings()
    assert set(terms_at(process, 20, 300.0).layer.tolist()) == set(range(12, 20))
    assert terms_at(process, 20, 500.0).total == pytest.approx(26.0)
    with pytest.raises(DataError, match="500 µm"):
        terms_at(process, 20, 501.0)


def test_with_growth_sets_the_growth() -> None:
    process = settings(wash_um=3.0)
    for growth in (-10.0, 20.0, 60.0):
        assert growth_um(with_growth(process, growth)) == pytest.approx(growth, abs=1e-6)
    # the growth is defined on the window side of a layer far inside, where groups of halos cause an error of 0.2 µm
    exact = straight_edge_um(process, 200, 2525.0 * (1 - 1e-12)) + 3.0
    assert growth_um(process) == pytest.approx(exact, abs=0.2)


def test_growth_increases_with_dose_and_blur() -> None:
    base = growth_um(settings())
    assert growth_um(settings(exposure_s=3.0)) > base
    assert growth_um(settings(sigma_um=25.0)) > base
    assert growth_um(settings(halo_fraction=0.2)) > base
    assert growth_um(settings(Ec_mJ_per_cm2=10.0)) < base


def test_the_halo_widens_with_depth() -> None:
    terms = terms_at(settings(halo_per_depth=0.5), 20, 260.0)
    halo = terms.sigma_um[len(terms.sigma_um) // 2 :]
    depth = (terms.layer[len(terms.layer) // 2 :] + 1) * 25.0 - 260.0
    assert np.allclose(halo, np.hypot(60.0, 0.5 * depth))
    assert math.isclose(float(terms.dose[: len(halo)].sum() / terms.total), 0.95)


LINES = ((0.3, 1.9), (0.4, 0.85), (0.3, 0.3 / 0.9))
"""Fractions and absorptions of the lines of a lamp; the last penetrates six times as deep as the first."""
MEAN = sum(fraction * absorption for fraction, absorption in LINES)
LAMP = tuple((fraction, absorption / MEAN) for fraction, absorption in LINES)


def sum_over_lines(height_um: float, images: np.ndarray, points_um: np.ndarray) -> np.ndarray:
    """Return the sum of the doses of the separate lines."""
    total = np.zeros(len(points_um))
    for fraction, absorption in LAMP:
        line = settings(**SMALL, Dp_um=100.0 / absorption, irradiance_mW_per_cm2=13.0 * fraction, Ec_mJ_per_cm2=0.1)
        total += dose_at(images, line, points_um, height_um)
    return total


def test_the_dose_of_a_lamp_is_the_sum_over_its_lines() -> None:
    process = settings(**SMALL, lamp=LAMP)
    rng = np.random.default_rng(5)
    image = np.zeros((40, 36))
    image[14:24, 14:22] = rng.random((10, 8))
    images = np.repeat(image[None], 6, axis=0)
    for height in (10.0, 62.0, 112.5):
        dose = dose_map(FlatImage(image, 6), process, height)
        rows, columns = rng.integers(50, 100, (2, 40))
        nodes = np.column_stack([columns, rows]) * dose.step_um + dose.first_um
        assert np.allclose(dose.dose[rows, columns], sum_over_lines(height, images, nodes), rtol=1e-9)


def test_a_lamp_increases_cure_depth_and_growth() -> None:
    with_lamp, without = (settings(burn_in_layers=0, lamp=lines) for lines in (LAMP, ()))
    depth_um = with_lamp.cure_depth_um
    transmitted = sum(fraction * math.exp(-depth_um * absorption / 100.0) for fraction, absorption in LAMP)
    assert with_lamp.dose_mJ_per_cm2 * transmitted == pytest.approx(with_lamp.Ec_mJ_per_cm2, rel=1e-9)
    assert depth_um > 1.1 * without.cure_depth_um
    assert growth_um(with_lamp) > growth_um(without)
    slab = FlatImage(np.ones((4, 4)), 400)
    heights_um = 25.0 * 60 + np.linspace(0.5, 24.5, 25)
    mean = np.mean([dose_map(slab, with_lamp, height).dose.mean() for height in heights_um.tolist()])
    assert with_lamp.inside_mJ_per_cm2() == pytest.approx(float(mean), rel=2e-3)


def test_equal_lines_are_a_single_wavelength() -> None:
    lines, single = settings(lamp=((0.25, 1.0), (0.75, 1.0))), settings()
    assert growth_um(lines) == pytest.approx(growth_um(single), rel=1e-12)
    assert lines.inside_mJ_per_cm2() == pytest.approx(single.inside_mJ_per_cm2(), rel=1e-12)


def test_refuses_fractions_of_a_lamp_that_do_not_sum_to_1() -> None:
    with pytest.raises(DataError, match=r"lamp.*0\.8"):
        settings(lamp=((0.5, 1.0), (0.3, 1.0)))
