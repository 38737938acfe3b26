"""Dose of the print model: Jacobs' slab, direct sums, and the fast field that must meet them."""

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
"""A halo that ends within a small image."""


@pytest.mark.parametrize(("Dp", "Ec", "seconds"), [(100.0, 5.0, 2.0), (60.0, 11.0, 1.0), (250.0, 0.7, 5.0)])
def test_a_flat_slab_cures_as_deep_as_jacobs_says(Dp: float, Ec: float, seconds: float) -> None:
    one = settings(Dp_um=Dp, Ec_mJ_per_cm2=Ec, exposure_s=seconds, burn_in_layers=0)
    assert cured_um(one) == pytest.approx(float(cure_depth_um(13.0 * seconds, Dp, Ec)), abs=1e-9)


def test_many_flat_layers_print_through_as_their_doses_add_up() -> None:
    one = settings(burn_in_layers=0)
    # 400 layers of 25 um are 100 penetration depths: those beyond add 1e-44 of the dose
    below_first_layer = cured_um(one, 400) - one.layer_um
    assert below_first_layer == pytest.approx(stack_print_through_um(26.0, 25.0, 100.0, 5.0), abs=1e-9)


def test_the_fast_dose_of_a_slab_is_that_of_the_stack_of_layers() -> None:
    one = settings()
    stack = stack_dose(one.Dp_um, one.layer_um, one.exposures(30))
    images = FlatImage(np.ones((8, 12)), 30)
    for height in (0.0, 3.0, 25.0, 140.0, 151.0, 500.0, 749.0):
        dose = dose_map(images, one, height).dose
        assert np.allclose(dose, stack.at(height), rtol=1e-8)  # layers fainter than 1e-9 are left out


@pytest.mark.parametrize("sides", [{}, {"pixel_y_um": 19.0}, {"pixel_um": 14.0, "pixel_y_um": 27.0}])
def test_the_fast_dose_is_that_of_direct_sums(sides: dict[str, float]) -> None:
    """Of pixels that are squares, and of pixels that are not."""
    one = settings(**SMALL, **sides)
    rng = np.random.default_rng(7)
    image = np.zeros((40, 36))
    image[14:24, 14:22] = rng.random((10, 8))
    images = np.repeat(image[None], 5, axis=0)
    for height in (10.0, 30.0, 112.5):
        found = dose_map(FlatImage(image, 5), one, height)
        rows, columns = rng.integers(50, 100, (2, 60))
        places = np.column_stack([columns, rows]) * found.step_um + found.first_um
        wanted = dose_at(images, one, places, height)
        assert np.allclose(found.dose[rows, columns], wanted, rtol=1e-9)
        # between the points of the grid a spline: 4e-4 of the dose is 0.005 of a blur of 15 um over 5
        between = rng.uniform(14.0, 24.0, (60, 2)) * one.pixels_um
        wanted = np.log(dose_at(images, one, between, height) / one.Ec_mJ_per_cm2)
        assert np.allclose(found.log_excess(between), wanted, atol=1e-3)


def test_the_grid_is_as_fine_as_a_sharp_projector_needs() -> None:
    assert settings().pixel_light.fine == 4
    sharp = settings(sigma_um=5.0)
    assert sharp.pixel_light.fine > 8
    image = np.zeros((30, 30))
    image[10:20, 10:20] = 1.0
    found = dose_map(FlatImage(image, 2), sharp, 40.0)
    places = np.array([[290.0, 400.0], [265.0, 400.0], [400.0, 545.0]])
    wanted = np.log(dose_at(np.array([image, image]), sharp, places, 40.0) / sharp.Ec_mJ_per_cm2)
    assert np.allclose(found.log_excess(places), wanted, atol=2e-2)
    with pytest.raises(DataError, match=r"process\.sigma_um = 1\.0; must be at least .* for pixels of 27 µm"):
        _ = settings(sigma_um=1.0).pixel_light.fine


def test_a_straight_wall_stands_where_direct_sums_have_it() -> None:
    one = settings(pixel_um=3.0, **SMALL)
    images = np.zeros((12, 500, 300))
    images[:, :, :150] = 1.0
    edge = straight_edge_um(one, 12, 110.0)
    place = np.array([[450.0 + edge, 750.0]])
    # the wall is on the pixels' edge: of the two pixels' spreads in edge_um only one is there, 0.75 um² of 227
    assert float(dose_at(images, one, place, 110.0)[0]) == pytest.approx(5.0, rel=0.01)


def test_light_comes_from_later_layers_only() -> None:
    one = settings()
    assert set(terms_at(one, 20, 300.0).layer.tolist()) == set(range(12, 20))
    assert terms_at(one, 20, 500.0).total == pytest.approx(26.0)
    with pytest.raises(DataError, match="the part ends at 500 µm"):
        terms_at(one, 20, 501.0)


def test_the_critical_dose_of_a_growth_makes_that_growth() -> None:
    one = settings(wash_um=3.0)
    for growth in (-10.0, 20.0, 60.0):
        assert growth_um(with_growth(one, growth)) == pytest.approx(growth, abs=1e-6)
    # on the window side of a layer far inside, as the growth is defined; the halo is in groups there: 0.2 um
    exact = straight_edge_um(one, 200, 2525.0 * (1 - 1e-12)) + 3.0
    assert growth_um(one) == pytest.approx(exact, abs=0.2)


def test_more_light_and_more_blur_make_walls_grow() -> None:
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


LAMP = ((0.3, 1.9), (0.4, 0.85), (0.3, 0.3 / 0.9))
"""Lines of a lamp, the last of which goes six times as deep as the first; shares times absorption add up to 1.01."""


def lamp() -> tuple[tuple[float, float], ...]:
    """The lines with their absorption over the mean."""
    mean = sum(share * absorption for share, absorption in LAMP)
    return tuple((share, absorption / mean) for share, absorption in LAMP)


def of_each_line(height_um: float, images: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Dose as the sum of what each line alone would give."""
    total = np.zeros(len(places))
    for share, absorption in lamp():
        alone = settings(**SMALL, Dp_um=100.0 / absorption, irradiance_mW_per_cm2=13.0 * share, Ec_mJ_per_cm2=0.1)
        total += dose_at(images, alone, places, height_um)
    return total


def test_the_dose_of_a_lamp_is_the_sum_of_its_lines() -> None:
    one = settings(**SMALL, lamp=lamp())
    rng = np.random.default_rng(5)
    image = np.zeros((40, 36))
    image[14:24, 14:22] = rng.random((10, 8))
    images = np.repeat(image[None], 6, axis=0)
    for height in (10.0, 62.0, 112.5):
        found = dose_map(FlatImage(image, 6), one, height)
        rows, columns = rng.integers(50, 100, (2, 40))
        places = np.column_stack([columns, rows]) * found.step_um + found.first_um
        assert np.allclose(found.dose[rows, columns], of_each_line(height, images, places), rtol=1e-9)


def test_a_lamp_cures_deeper_and_grows_walls_more_than_its_dp_at_the_surface() -> None:
    with_lamp, without = (settings(burn_in_layers=0, lamp=lines) for lines in (lamp(), ()))
    deep = with_lamp.cure_depth_um
    left = sum(share * math.exp(-deep * absorption / 100.0) for share, absorption in lamp())
    assert with_lamp.dose_mJ_per_cm2 * left == pytest.approx(with_lamp.Ec_mJ_per_cm2, rel=1e-9)
    assert deep > 1.1 * without.cure_depth_um
    assert growth_um(with_lamp) > growth_um(without)
    slab = FlatImage(np.ones((4, 4)), 400)
    inside = np.mean([dose_map(slab, with_lamp, 25.0 * 60 + s).dose.mean() for s in np.linspace(0.5, 24.5, 25)])
    assert with_lamp.inside_mJ_per_cm2() == pytest.approx(float(inside), rel=2e-3)


def test_two_like_lines_are_one_wavelength() -> None:
    two, one = settings(lamp=((0.25, 1.0), (0.75, 1.0))), settings()
    assert growth_um(two) == pytest.approx(growth_um(one), rel=1e-12)
    assert two.inside_mJ_per_cm2() == pytest.approx(one.inside_mJ_per_cm2(), rel=1e-12)


def test_shares_of_a_lamp_that_are_not_all_of_its_light_are_refused() -> None:
    with pytest.raises(DataError, match=r"lamp.*0\.8"):
        settings(lamp=((0.5, 1.0), (0.3, 1.0)))
