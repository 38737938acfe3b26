"""Snell and Fresnel against closed forms, energy, and the reversibility of light."""

import math
import sys

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from solen.interface import cos_refracted, fresnel, reflected, refracted
from solen.plane import cross, dot, heading

index = st.floats(1.0, 4.0)
incidence_deg = st.floats(0.0, 89.0)
UP, DOWN = (0.0, 1.0), (0.0, -1.0)


def cosine(angle_deg: float) -> float:
    return math.cos(math.radians(angle_deg))


@pytest.mark.parametrize(("n", "critical_deg"), [(1.44, 43.98), (1.49, 42.16), (1.54, 40.49)])
def test_critical_angles_of_the_papers_resins(n: float, critical_deg: float) -> None:
    exact_deg = math.degrees(math.asin(1 / n))
    assert exact_deg == pytest.approx(critical_deg, abs=0.005)
    assert cos_refracted(cosine(exact_deg + 1e-6), n, 1.0) is None
    assert cos_refracted(cosine(exact_deg - 1e-6), n, 1.0) is not None
    assert cos_refracted(cosine(90.0), 1.0, n) is not None


@given(n1=index, n2=index, angle=incidence_deg)
def test_refraction_obeys_snell_and_stays_in_its_half_plane(n1: float, n2: float, angle: float) -> None:
    direction = heading(angle)
    out = refracted(direction, DOWN, n1, n2)
    if out is None:
        assert n1 * math.sin(math.radians(angle)) >= n2 * (1 - 1e-12)
        return
    assert math.hypot(*out) == pytest.approx(1.0, abs=1e-15)
    assert n2 * cross(UP, out) == pytest.approx(n1 * cross(UP, direction), abs=1e-14 * n1 * n2 + 1e-14)
    assert dot(out, UP) >= 0


@given(n1=index, n2=index, angle=incidence_deg)
def test_light_finds_its_way_back(n1: float, n2: float, angle: float) -> None:
    direction = heading(angle)
    out = refracted(direction, DOWN, n1, n2)
    assume(out is not None and out[1] > 1e-3)
    assert out is not None
    back = refracted((-out[0], -out[1]), UP, n2, n1)
    assert back is not None
    assert math.dist(back, (-direction[0], -direction[1])) < 1e-11
    there, again = fresnel(direction[1], n1, n2), fresnel(out[1], n2, n1)
    assert again.s == pytest.approx(there.s, abs=1e-11)
    assert again.p == pytest.approx(there.p, abs=1e-11)


@given(n1=index, n2=index)
def test_normal_incidence_is_the_square_of_the_contrast(n1: float, n2: float) -> None:
    share = fresnel(1.0, n1, n2)
    assert share.s == pytest.approx(((n1 - n2) / (n1 + n2)) ** 2, abs=1e-15)
    assert share.p == pytest.approx(share.s, abs=1e-15)


@given(n1=index, n2=index)
def test_at_45_degrees_p_is_the_square_of_s(n1: float, n2: float) -> None:
    assume(n1 * math.sqrt(0.5) < n2 * (1 - 1e-9))
    share = fresnel(math.sqrt(0.5), n1, n2)
    assert share.p == pytest.approx(share.s**2, abs=1e-13)


@given(n1=index, n2=index)
def test_at_brewsters_angle_no_p_comes_back(n1: float, n2: float) -> None:
    angle = math.atan2(n2, n1)
    share = fresnel(math.cos(angle), n1, n2)
    steep = (max(n1, n2) / min(n1, n2)) ** 2  # how much rounding of the angle moves the amplitude
    assert math.sqrt(share.p) < 10.0 * sys.float_info.epsilon * steep
    assert share.s == pytest.approx(((n1**2 - n2**2) / (n1**2 + n2**2)) ** 2, abs=1e-14)


@given(n1=index, n2=index, angle=incidence_deg)
def test_what_does_not_come_back_goes_through(n1: float, n2: float, angle: float) -> None:
    """Transmittance from its own amplitude formulas (Born & Wolf, 1.5.2), not as 1 − R."""
    c1 = cosine(angle)
    share, c2 = fresnel(c1, n1, n2), cos_refracted(c1, n1, n2)
    if c2 is None:
        assert share == (1.0, 1.0)
        return
    flux = n2 * c2 / (n1 * c1)
    t_s, t_p = 2 * n1 * c1 / (n1 * c1 + n2 * c2), 2 * n1 * c1 / (n2 * c1 + n1 * c2)
    assert share.s + flux * t_s**2 == pytest.approx(1.0, abs=1e-12)
    assert share.p + flux * t_p**2 == pytest.approx(1.0, abs=1e-12)
    assert 0 <= share.s <= 1
    assert 0 <= share.p <= 1


@pytest.mark.parametrize("n", [1.44, 1.49, 1.54])
def test_at_the_critical_angle_reflection_becomes_total_without_a_jump(n: float) -> None:
    critical = math.degrees(math.asin(1 / n))
    assert fresnel(cosine(critical + 1e-9), n, 1.0) == (1.0, 1.0)
    below = fresnel(cosine(critical - 1e-9), n, 1.0)
    assert 0.99 < below.s < 1.0
    assert 0.99 < below.p < 1.0


@given(angle=st.floats(-89, 89), tilt=st.floats(-180, 180))
def test_a_mirror_keeps_the_angle_and_the_tangential_part(angle: float, tilt: float) -> None:
    normal = heading(tilt)
    direction = heading(tilt + 180 + angle)
    out = reflected(direction, normal)
    assert math.hypot(*out) == pytest.approx(1.0, abs=1e-14)
    assert dot(out, normal) == pytest.approx(-dot(direction, normal), abs=1e-14)
    assert cross(normal, out) == pytest.approx(cross(normal, direction), abs=1e-14)


@given(n=index, angle=incidence_deg)
def test_an_index_matched_interface_does_nothing(n: float, angle: float) -> None:
    direction = heading(angle)
    out = refracted(direction, DOWN, n, n)
    assert out is not None
    assert math.dist(out, direction) < 1e-13
    assert max(fresnel(direction[1], n, n)) < 1e-24


@pytest.mark.parametrize("n", [1.0, 1.44, 1.5, 1.7])
@pytest.mark.parametrize("cos_in", [1e-3, 1e-6, 1e-8, 1e-9, 1e-15, 1e-100])
def test_an_index_matched_interface_does_nothing_to_a_grazing_ray(n: float, cos_in: float) -> None:
    assert max(fresnel(cos_in, n, n)) < 1e-30
    assert cos_refracted(cos_in, n, n) == pytest.approx(cos_in, rel=1e-15)
    direction = (math.sqrt((1 - cos_in) * (1 + cos_in)), cos_in)
    out = refracted(direction, DOWN, n, n)
    assert out is not None
    assert math.dist(out, direction) < 3e-16
    assert out[1] == pytest.approx(cos_in, rel=1e-14)
