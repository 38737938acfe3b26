"""Mixtures by weight: masses, readings, the balance's steps, and the estimate of the index."""

import math
from itertools import product

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from solen.errors import SpecError
from solen.material.mix import Component, MixOptions, check_components, of_whole, on_base, weighed, with_properties

PAPER = (Component("RA-139", 75.0), Component("lauryl acrylate", 25.0))


def test_a_quarter_of_the_whole_is_a_third_of_the_base() -> None:
    base, additive = weighed(of_whole(PAPER), MixOptions(total_g=50.0)).components
    assert (base.weighed_g, additive.weighed_g) == (37.5, 12.5)
    assert (base.phr, additive.phr) == pytest.approx((100.0, 100.0 / 3.0))
    assert additive.weighed_wt_percent == 25.0


def test_a_quarter_on_the_base_is_a_fifth_of_the_whole() -> None:
    base, additive = weighed(on_base(PAPER), MixOptions(total_g=50.0)).components
    assert (base.weighed_g, additive.weighed_g) == (40.0, 10.0)
    assert (additive.wt_percent, additive.phr) == pytest.approx((20.0, 25.0))


def test_what_to_add_to_a_base_that_is_there() -> None:
    base, additive = weighed(of_whole(PAPER), MixOptions(base_g=41.27)).components
    assert base.weighed_g == 41.27
    assert additive.exact_g == pytest.approx(41.27 / 3.0)
    assert additive.weighed_g == 13.76


def test_a_coarse_balance_leaves_an_error_and_says_it() -> None:
    found = weighed(of_whole(PAPER), MixOptions(base_g=40.0, resolution_g=0.1))
    _, additive = found.components
    assert (additive.weighed_g, found.total_g) == pytest.approx((13.3, 53.3))
    assert additive.error_wt_percent == pytest.approx(100.0 * 13.3 / 53.3 - 25.0)


@given(
    shares=st.lists(st.floats(1.0, 50.0), min_size=2, max_size=5),
    total_g=st.floats(5.0, 500.0),
    resolution_g=st.sampled_from([0.001, 0.01, 0.1]),
)
def test_masses_are_whole_steps_and_shares_are_within_their_bound(
    shares: list[float], total_g: float, resolution_g: float
) -> None:
    assume(min(shares) / math.fsum(shares) * total_g > resolution_g)
    parts = [Component(str(i), 100.0 * one / math.fsum(shares)) for i, one in enumerate(shares)]
    found = weighed(of_whole(parts), MixOptions(total_g=total_g, resolution_g=resolution_g))
    assert math.fsum(one.weighed_wt_percent for one in found.components) == pytest.approx(100.0)
    assert abs(found.total_g - total_g) <= len(parts) * resolution_g / 2 + 1e-9
    for one in found.components:
        steps = one.weighed_g / resolution_g
        assert steps == pytest.approx(round(steps), abs=1e-6)
        assert len(repr(one.weighed_g)) < 9  # no digits that the balance does not have
        second_order = 1.0 + 2.0 * len(parts) * resolution_g / total_g
        assert abs(one.error_wt_percent) <= one.worst_wt_percent * second_order + 1e-9


def test_the_worst_share_is_that_of_all_half_steps() -> None:
    found = weighed(of_whole(PAPER), MixOptions(total_g=20.0, resolution_g=0.1))
    masses = [one.weighed_g for one in found.components]
    offs = []
    for signs in product((-1, 0, 1), repeat=2):
        moved = [mass + 0.05 * sign for mass, sign in zip(masses, signs, strict=True)]
        offs.append(abs(100.0 * moved[1] / sum(moved) - found.components[1].weighed_wt_percent))
    assert found.components[1].worst_wt_percent == pytest.approx(max(offs), rel=0.01)  # it is of first order


def test_volumes_and_the_index_follow_from_densities() -> None:
    known = with_properties(PAPER, {"RA-139": 1.10, "lauryl acrylate": 0.88}, {"RA-139": 1.48, "lauryl acrylate": 1.44})
    found = weighed(of_whole(known), MixOptions(total_g=100.0))
    base, additive = found.components
    assert base.volume_mL == pytest.approx(75.0 / 1.10)
    assert additive.volume_percent == pytest.approx(100.0 * (25.0 / 0.88) / (75.0 / 1.10 + 25.0 / 0.88))
    share = 0.01 * (additive.volume_percent or 0.0)
    refraction = (1 - share) * (1.48**2 - 1) / (1.48**2 + 2) + share * (1.44**2 - 1) / (1.44**2 + 2)
    n = found.index_estimate
    assert n is not None
    assert (n**2 - 1) / (n**2 + 2) == pytest.approx(refraction)


def test_an_index_is_estimated_from_all_or_from_none() -> None:
    known = with_properties(PAPER, {"lauryl acrylate": 0.88}, {"RA-139": 1.48, "lauryl acrylate": 1.44})
    found = weighed(of_whole(known), MixOptions(total_g=100.0))
    assert found.index_estimate is None
    assert [one.volume_mL is None for one in found.components] == [True, False]
    assert [one.volume_percent for one in found.components] == [None, None]
    same = with_properties(PAPER, {"RA-139": 1.1, "lauryl acrylate": 0.9}, {"RA-139": 1.5, "lauryl acrylate": 1.5})
    assert weighed(of_whole(same), MixOptions(total_g=1.0)).index_estimate == pytest.approx(1.5)


def test_shares_that_rounding_leaves_short_are_scaled() -> None:
    thirds = of_whole([Component(name, 33.33) for name in "abc"])
    assert [one.percent for one in thirds] == pytest.approx([100.0 / 3.0] * 3)


def told(call: object) -> str:
    assert callable(call)
    with pytest.raises(SpecError) as refusal:
        call()
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    return line


def test_what_is_no_mixture_is_reported() -> None:
    part = Component
    assert told(lambda: of_whole([part("a", 70.0), part("b", 20.0)])) == (
        "mixture = '90 %'; the fractions must add up to 100 %, to within 0.1 %; "
        "in this ratio, the parts are a:77.78, b:22.22"
    )
    assert "at least 2 components" in told(lambda: check_components([part("a", 100.0)]))
    assert "named twice" in told(lambda: check_components([part("a", 50.0), part("a", 50.0)]))
    assert "share of b = -1.0; must be above 0" in told(lambda: check_components([part("a", 50.0), part("b", -1.0)]))
    assert "density of a" in told(lambda: check_components([part("a", 50.0, 0.0), part("b", 50.0)]))
    assert "index of b = 0.9" in told(lambda: check_components([part("a", 50.0), part("b", 50.0, None, 0.9)]))
    assert "density of LA; is not a component" in told(lambda: with_properties(PAPER, {"LA": 0.9}, {}))
    assert "did you mean RA-139?" in told(lambda: with_properties(PAPER, {}, {"RA139": 1.5}))


@pytest.mark.parametrize(
    ("masses", "line"),
    [
        ({"total_g": 50.0, "base_g": 10.0}, "total mass or the mass of the base"),
        ({"total_g": -1.0}, "total_g = -1.0; must be greater than 0"),
        ({"base_g": math.nan}, "base_g = nan; must be"),
        ({"total_g": 50.0, "resolution_g": 0.0}, "resolution_g = 0.0; must be at least 1e-06"),
        ({"total_g": 1.0, "resolution_g": 0.8}, "mass of lauryl acrylate = '0.25 g'; is less than half a step"),
    ],
)
def test_masses_that_cannot_be_are_reported(masses: dict[str, float], line: str) -> None:
    assert line in told(lambda: weighed(of_whole(PAPER), MixOptions(**masses)))
