"""Lenses that cannot work are rejected in one line that names the value and the limit."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from solen.errors import DesignError, SpecError
from solen.lens import FlatFace, OvalLens, lens_of
from solen.spec import Design, with_values

NAN, INF = math.nan, math.inf

REFUSED = [  # distance, focus, half width, design index; part of the message
    ((1.0, 20.0, 2.94, 1.44), "lens.half_width_mm = 2.94; must be below 2.932 mm"),
    ((1.0, 20.0, 3.06, 1.49), "lens.half_width_mm = 3.06; must be below 3.0"),
    ((1.0, 20.0, 0.0, 1.44), "lens.half_width_mm = 0.0; must be above 0"),
    ((1.0, 20.0, -2.0, 1.44), "lens.half_width_mm = -2.0; must be above 0"),
    ((1.0, 20.0, NAN, 1.44), "lens.half_width_mm = 'nan'; must be a finite number"),
    ((0.0, 20.0, 2.0, 1.44), "emitter.distance_mm = 0.0; must be above 0"),
    ((-1.0, 20.0, 2.0, 1.44), "emitter.distance_mm = -1.0; must be above 0"),
    ((NAN, 20.0, 2.0, 1.44), "emitter.distance_mm = 'nan'; must be a finite number"),
    ((1.0, 0.0, 2.0, 1.44), "lens.focus_mm = 0.0; must be above 0"),
    ((1.0, -20.0, 2.0, 1.44), "lens.focus_mm = -20.0; must be above 0"),
    ((1.0, NAN, 2.0, 1.44), "lens.focus_mm = 'nan'; must be a finite number"),
    ((1.0, 1.5, 2.0, 1.44), "lens.focus_mm = 1.5; must be behind the lens"),
    ((1.0, 20.0, 2.0, 1.0), "lens.design_index = 1.0; must be above 1"),
    ((1.0, 20.0, 2.0, 0.9), "lens.design_index = 0.9; must be above 1"),
    ((1.0, 20.0, 2.0, NAN), "lens.design_index = 'nan'; must be a finite number"),
]


@pytest.mark.parametrize(("values", "message"), REFUSED)
def test_a_refusal_names_value_and_limit(values: tuple[float, float, float, float], message: str) -> None:
    with pytest.raises(DesignError) as refusal:
        OvalLens(*values)
    line = str(refusal.value)
    assert message in line
    assert len(line.splitlines()) == 1


def test_the_remedy_of_a_refusal_works() -> None:
    with pytest.raises(DesignError, match=r"lens\.focus_mm above \d+\.\d+") as refusal:
        OvalLens(1.0, 8.0, 2.0, 1.44)
    nearest = float(str(refusal.value).split("lens.focus_mm above ")[1].split()[0])
    assert OvalLens(1.0, nearest + 0.01, 2.0, 1.44).depth_mm > 0
    with pytest.raises(DesignError):
        OvalLens(1.0, nearest - 0.01, 2.0, 1.44)


def test_a_width_just_below_the_limit_works() -> None:
    assert OvalLens(1.0, 20.0, 2.931, 1.44).depth_mm == pytest.approx(2.98, abs=0.05)


def test_refuses_equal_indices() -> None:
    with pytest.raises(DesignError, match=r"must be above 1\.5"):
        OvalLens(1.0, 20.0, 2.0, 1.5, outside_index=1.5)


def test_refuses_a_lens_of_air() -> None:
    design = Design.model_validate({"name": "a", "material": {"index": 1.0}})
    with pytest.raises(DesignError, match=r"the material's index = 1\.0; must be above 1"):
        lens_of(design, 1.0)


@pytest.mark.parametrize("x", [2.0000001, -2.5, math.inf])
def test_refuses_the_profile_outside_the_lens(x: float) -> None:
    with pytest.raises(DesignError, match=r"must be within 2\.0 mm of the axis"):
        OvalLens(1.0, 20.0, 2.0, 1.44).z_mm([0.0, x])


lengths = st.floats(-6, 6).map(lambda exponent: 10.0**exponent)
"""Lengths that a design file may specify, in mm."""


@given(
    s=lengths,
    f=lengths,
    half_width=lengths,
    n2=st.one_of(st.floats(1.01, 4.99), st.floats(1.000001, 1.01)),
)
def test_every_lens_is_built_or_refused_in_one_line(s: float, f: float, half_width: float, n2: float) -> None:
    assume(max(s, f, half_width) < 1e6 * min(s, f, half_width))  # otherwise rounding matters
    try:
        lens = OvalLens(s, f, half_width, n2)
    except DesignError as error:
        line = str(error)
    else:
        assert lens.depth_mm >= 0
        assert 0 < lens.acceptance_deg < 90
        return
    assert len(line.splitlines()) == 1


INVALID = [
    (1.0, 20.0, INF, 1.44),
    (1.0, INF, 2.0, 1.44),
    (INF, 20.0, 2.0, 1.44),
    (1.0, 20.0, 2.0, INF),
    (295754.0, 0.125, 1.0, 1.001),
]


@pytest.mark.parametrize("values", INVALID)
def test_refuses_infinite_lengths_and_a_focus_inside_the_lens(values: tuple[float, float, float, float]) -> None:
    with pytest.raises(DesignError):
        OvalLens(*values)


@pytest.mark.parametrize("key", ["lens.half_width_mm", "lens.focus_mm", "emitter.distance_mm"])
@pytest.mark.parametrize("length_mm", [1e200, 1.000001e6, 0.999999e-6, 1e-200])
def test_refuses_lengths_above_a_kilometre_or_below_a_nanometre(key: str, length_mm: float) -> None:
    design = Design.model_validate({"name": "a", "material": {"index": 1.44}})
    with pytest.raises(SpecError, match=key) as refusal:
        with_values(design, {key: length_mm})
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("outside", [0.0, -1.0, 0.999, NAN, INF])
def test_refuses_an_unphysical_index_outside(outside: float) -> None:
    with pytest.raises(DesignError):
        OvalLens(1.0, 20.0, 1.0, 1.44, outside)


@pytest.mark.parametrize("values", [(1.0, -2.0), (1.0, 0.0), (0.0, 2.0), (NAN, 2.0), (1.0, NAN)])
def test_a_flat_face_is_checked_like_a_lens(values: tuple[float, float]) -> None:
    with pytest.raises(DesignError):
        FlatFace(*values)


def test_refuses_the_profile_at_nan() -> None:
    with pytest.raises(DesignError):
        OvalLens(1.0, 20.0, 2.0, 1.44).z_mm(NAN)
