"""Mixtures by weight: masses, readings, the readability of the balance, and the estimate of the index."""

import math
from collections.abc import Callable
from itertools import product

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from solen.errors import SpecError
from solen.material.mix import Component, MixOptions, check_components, of_whole, on_base, weighed, with_properties

PAPER = (Component("RA-139", 75.0), Component("lauryl acrylate", 25.0))


def test_a_quarter_of_the_mixture_is_a_third_of_the_base() -> None:
    base, additive = weighed(of_whole(PAPER), MixOptions(total_g=50.0)).components
    assert (base.weighed_g, additive.weighed_g) == (37.5, 12.5)
    assert (base.phr, additive.phr) == pytest.approx((100.0, 100.0 / 3.0))
    assert additive.weighed_wt_percent == 25.0


def test_a_quarter_of_the_base_is_a_fifth_of_the_mixture() -> None:
    base, additive = weighed(on_base(PAPER), MixOptions(total_g=50.0)).components
    assert (base.weighed_g, additive.weighed_g) == (40.0, 10.0)
    assert (additive.wt_percent, additive.phr) == pytest.approx((20.0, 25.0))


def test_additive_follows_from_a_weighed_base() -> None:
    base, additive = weighed(of_whole(PAPER), MixOptions(base_g=41.27)).components
    assert base.weighed_g == 41.27
    assert additive.exact_g == pytest.approx(41.27 / 3.0)
    assert additive.weighed_g == 13.76


def test_a_coarse_balance_leaves_a_reported_error() -> None:
    mixture = weighed(of_whole(PAPER), MixOptions(base_g=40.0, resolution_g=0.1))
    _, additive = mixture.components
    assert (additive.weighed_g, mixture.total_g) == pytest.approx((13.3, 53.3))
    assert additive.error_wt_percent == pytest.approx(100.0 * 13.3 / 53.3 - 25.0)


@given(
    ratios=st.lists(st.floats(1.0, 50.0), min_size=2, max_size=5),
    total_g=st.floats(5.0, 500.0),
    resolution_g=st.sampled_from([0.001, 0.01, 0.1]),
)
def test_masses_are_readable_and_errors_are_within_their_bound(
    ratios: list[float], total_g: float, resolution_g: float
) -> None:
    assume(min(ratios) / math.fsum(ratios) * total_g > resolution_g)
    parts = [Component(str(i), 100.0 * ratio / math.fsum(ratios)) for i, ratio in enumerate(ratios)]
    mixture = weighed(of_whole(parts), MixOptions(total_g=total_g, resolution_g=resolution_g))
    assert math.fsum(part.weighed_wt_percent for part in mixture.components) == pytest.approx(100.0)
    assert abs(mixture.total_g - total_g) <= len(parts) * resolution_g / 2 + 1e-9
    for part in mixture.components:
        steps = part.weighed_g / resolution_g
        assert steps == pytest.approx(round(steps), abs=1e-6)
        assert len(repr(part.weighed_g)) < 9  # no digits that the balance does not show
        second_order = 1.0 + 2.0 * len(parts) * resolution_g / total_g
        assert abs(part.error_wt_percent) <= part.worst_wt_percent * second_order + 1e-9


def test_worst_error_is_the_largest_over_all_rounding_errors() -> None:
    mixture = weighed(of_whole(PAPER), MixOptions(total_g=20.0, resolution_g=0.1))
    masses = [part.weighed_g for part in mixture.components]
    errors = []
    for signs in product((-1, 0, 1), repeat=2):
        true_masses = [mass + 0.05 * sign for mass, sign in zip(masses, signs, strict=True)]
        errors.append(abs(100.0 * true_masses[1] / sum(true_masses) - mixture.components[1].weighed_wt_percent))
    assert mixture.components[1].worst_wt_percent == pytest.approx(max(errors), rel=0.01)  # to first order


def test_volumes_and_index_follow_from_densities() -> None:
    known = with_properties(PAPER, {"RA-139": 1.10, "lauryl acrylate": 0.88}, {"RA-139": 1.48, "lauryl acrylate": 1.44})
    mixture = weighed(of_whole(known), MixOptions(total_g=100.0))
    base, additive = mixture.components
    assert base.volume_mL == pytest.approx(75.0 / 1.10)
    assert additive.volume_percent == pytest.approx(100.0 * (25.0 / 0.88) / (75.0 / 1.10 + 25.0 / 0.88))
    fraction = 0.01 * (additive.volume_percent or 0.0)
    refraction = (1 - fraction) * (1.48**2 - 1) / (1.48**2 + 2) + fraction * (1.44**2 - 1) / (1.44**2 + 2)
    n = mixture.index_estimate
    assert n is not None
    assert (n**2 - 1) / (n**2 + 2) == pytest.approx(refraction)


def test_index_requires_the_properties_of_all_components() -> None:
    known = with_properties(PAPER, {"lauryl acrylate": 0.88}, {"RA-139": 1.48, "lauryl acrylate": 1.44})
    mixture = weighed(of_whole(known), MixOptions(total_g=100.0))
    assert mixture.index_estimate is None
    assert [part.volume_mL is None for part in mixture.components] == [True, False]
    assert [part.volume_percent for part in mixture.components] == [None, None]
    same = with_properties(PAPER, {"RA-139": 1.1, "lauryl acrylate": 0.9}, {"RA-139": 1.5, "lauryl acrylate": 1.5})
    assert weighed(of_whole(same), MixOptions(total_g=1.0)).index_estimate == pytest.approx(1.5)


def test_rounded_fractions_are_scaled_to_100_percent() -> None:
    thirds = of_whole([Component(name, 33.33) for name in "abc"])
    assert [part.percent for part in thirds] == pytest.approx([100.0 / 3.0] * 3)


def error_line(call: Callable[[], object]) -> str:
    with pytest.raises(SpecError) as error:
        call()
    line = str(error.value)
    assert len(line.splitlines()) == 1
    return line


def test_refuses_invalid_mixtures() -> None:
    part = Component
    line = error_line(lambda: of_whole([part("a", 70.0), part("b", 20.0)]))
    assert line.startswith("mixture = '90 %'; ")
    assert line.endswith('"a:77.78" "b:22.22"')
    assert "at least 2 components" in error_line(lambda: check_components([part("a", 100.0)]))
    assert "named twice" in error_line(lambda: check_components([part("a", 50.0), part("a", 50.0)]))
    negative = error_line(lambda: check_components([part("a", 50.0), part("b", -1.0)]))
    assert "fraction of b = -1.0; must be above 0" in negative
    assert "density of a" in error_line(lambda: check_components([part("a", 50.0, 0.0), part("b", 50.0)]))
    assert "index of b = 0.9" in error_line(lambda: check_components([part("a", 50.0), part("b", 50.0, None, 0.9)]))
    assert "--density = 'LA'; is not a component" in error_line(lambda: with_properties(PAPER, {"LA": 0.9}, {}))
    assert "did you mean RA-139?" in error_line(lambda: with_properties(PAPER, {}, {"RA139": 1.5}))


@pytest.mark.parametrize(
    ("masses", "line"),
    [
        ({"total_g": 50.0, "base_g": 10.0}, "base_g; cannot be combined with --total-g"),
        ({"total_g": -1.0}, "total_g = -1.0; must be greater than 0"),
        ({"base_g": math.nan}, "base_g = nan; must be"),
        ({"total_g": 50.0, "resolution_g": 0.0}, "resolution_g = 0.0; must be at least 1e-06"),
        (
            {"total_g": 1.0, "resolution_g": 0.8},
            "mass of lauryl acrylate = '0.25 g'; is less than half the readability",
        ),
    ],
)
def test_refuses_invalid_masses(masses: dict[str, float], line: str) -> None:
    assert line in error_line(lambda: weighed(of_whole(PAPER), MixOptions(**masses)))
