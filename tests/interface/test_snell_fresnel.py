"""Snell's law and Fresnel's equations compared with closed forms, conservation of energy, and reversibility."""

import math
import sys

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from solen.plane import cross, dot, heading
from solen.refraction import cos_refracted, fresnel, reflected, refracted

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
def test_refraction_obeys_snell_s_law(n1: float, n2: float, angle: float) -> None:
    direction = heading(angle)
    out = refracted(direction, DOWN, n1, n2)
    if out is None:
        assert n1 * math.sin(math.radians(angle)) >= n2 * (1 - 1e-12)
        return
    assert math.hypot(*out) == pytest.approx(1.0, abs=1e-15)
    assert n2 * cross(UP, out) == pytest.approx(n1 * cross(UP, direction), abs=1e-14 * n1 * n2 + 1e-14)
    assert dot(out, UP) >= 0


@given(n1=index, n2=index, angle=incidence_deg)
def test_light_paths_are_reversible(n1: float, n2: float, angle: float) -> None:
    direction = heading(angle)
    out = refracted(direction, DOWN, n1, n2)
    assume(out is not None and out[1] > 1e-3)
    assert out is not None
    back = refracted((-out[0], -out[1]), UP, n2, n1)
    assert back is not None
    assert math.dist(back, (-direction[0], -direction[1])) < 1e-11
    forwards, backwards = fresnel(direction[1], n1, n2), fresnel(out[1], n2, n1)
    assert backwards.s == pytest.approx(forwards.s, abs=1e-11)
    assert backwards.p == pytest.approx(forwards.p, abs=1e-11)


@given(n1=index, n2=index)
def test_reflectance_at_normal_incidence(n1: float, n2: float) -> None:
    reflected_power = fresnel(1.0, n1, n2)
    assert reflected_power.s == pytest.approx(((n1 - n2) / (n1 + n2)) ** 2, abs=1e-15)
    assert reflected_power.p == pytest.approx(reflected_power.s, abs=1e-15)


@given(n1=index, n2=index)
def test_at_45_degrees_p_is_the_square_of_s(n1: float, n2: float) -> None:
    assume(n1 * math.sqrt(0.5) < n2 * (1 - 1e-9))
    reflected_power = fresnel(math.sqrt(0.5), n1, n2)
    assert reflected_power.p == pytest.approx(reflected_power.s**2, abs=1e-13)


@given(n1=index, n2=index)
def test_no_p_light_is_reflected_at_brewsters_angle(n1: float, n2: float) -> None:
    angle = math.atan2(n2, n1)
    reflected_power = fresnel(math.cos(angle), n1, n2)
    steep = (max(n1, n2) / min(n1, n2)) ** 2  # factor from the rounding of the angle to that of the amplitude
    assert math.sqrt(reflected_power.p) < 10.0 * sys.float_info.epsilon * steep
    assert reflected_power.s == pytest.approx(((n1**2 - n2**2) / (n1**2 + n2**2)) ** 2, abs=1e-14)


@given(n1=index, n2=index, angle=incidence_deg)
def test_reflectance_and_transmittance_add_up_to_one(n1: float, n2: float, angle: float) -> None:
    """Transmittance from its own amplitude formulas (Born & Wolf, 1.5.2), not as 1 − R."""
    c1 = cosine(angle)
    reflected_power, c2 = fresnel(c1, n1, n2), cos_refracted(c1, n1, n2)
    if c2 is None:
        assert reflected_power == (1.0, 1.0)
        return
    flux = n2 * c2 / (n1 * c1)
    t_s, t_p = 2 * n1 * c1 / (n1 * c1 + n2 * c2), 2 * n1 * c1 / (n2 * c1 + n1 * c2)
    assert reflected_power.s + flux * t_s**2 == pytest.approx(1.0, abs=1e-12)
    assert reflected_power.p + flux * t_p**2 == pytest.approx(1.0, abs=1e-12)
    assert 0 <= reflected_power.s <= 1
    assert 0 <= reflected_power.p <= 1


@pytest.mark.parametrize("n", [1.44, 1.49, 1.54])
def test_at_the_critical_angle_reflection_becomes_total_without_a_jump(n: float) -> None:
    critical = math.degrees(math.asin(1 / n))
    assert fresnel(cosine(critical + 1e-9), n, 1.0) == (1.0, 1.0)
    below = fresnel(cosine(critical - 1e-9), n, 1.0)
    assert 0.99 < below.s < 1.0
    assert 0.99 < below.p < 1.0


@given(angle=st.floats(-89, 89), tilt=st.floats(-180, 180))
def test_a_mirror_preserves_the_tangential_component(angle: float, tilt: float) -> None:
    normal = heading(tilt)
    direction = heading(tilt + 180 + angle)
    out = reflected(direction, normal)
    assert math.hypot(*out) == pytest.approx(1.0, abs=1e-14)
    assert dot(out, normal) == pytest.approx(-dot(direction, normal), abs=1e-14)
    assert cross(normal, out) == pytest.approx(cross(normal, direction), abs=1e-14)


@given(n=index, angle=incidence_deg)
def test_an_index_matched_interface_has_no_effect(n: float, angle: float) -> None:
    direction = heading(angle)
    out = refracted(direction, DOWN, n, n)
    assert out is not None
    assert math.dist(out, direction) < 1e-13
    assert max(fresnel(direction[1], n, n)) < 1e-24


@pytest.mark.parametrize("n", [1.0, 1.44, 1.5, 1.7])
@pytest.mark.parametrize("cos_in", [1e-3, 1e-6, 1e-8, 1e-9, 1e-15, 1e-100])
def test_an_index_matched_interface_has_no_effect_at_grazing_incidence(n: float, cos_in: float) -> None:
    assert max(fresnel(cos_in, n, n)) < 1e-30
    assert cos_refracted(cos_in, n, n) == pytest.approx(cos_in, rel=1e-15)
    direction = (math.sqrt((1 - cos_in) * (1 + cos_in)), cos_in)
    out = refracted(direction, DOWN, n, n)
    assert out is not None
    assert math.dist(out, direction) < 3e-16
    assert out[1] == pytest.approx(cos_in, rel=1e-14)
