"""Scenes with closed-form solutions."""

import math

import numpy as np
import pytest

from solen.curve import Arc, CartesianOval, Parabola, Segment
from solen.plane import along, cross, minus
from solen.refraction import fresnel
from solen.scene import Beam, Fan, Interface, Rays, Scene
from solen.scene.model import Behaviour
from solen.trace import Limits, trace
from tests.agreement.scenes_support import AIR, FINE, body, box, glass, one_ray, only_path, slab

INDICES = [1.2, 1.44, 1.54, 2.0]


@pytest.mark.parametrize("index", INDICES)
def test_slab_transmits_2n_over_n2_plus_1(index: float) -> None:
    result = trace(slab(Beam((-1.0, -3.0), (1.0, -3.0), 0.0, 7), index, 2.0), "power", FINE)
    assert result.monitors["behind"].power == pytest.approx(2 * index / (index**2 + 1), abs=1e-12)
    assert result.ledger.escaped == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("s_share", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 55.0, 80.0])
def test_absorbing_slab_at_any_angle(angle_deg: float, s_share: float) -> None:
    """T = (1−R)² τ / (1 − R² τ²) is transmitted and R + R τ T reflected, for each polarisation."""
    index, loss, thickness = 1.5, 0.13, 2.5
    cos_in = math.cos(math.radians(angle_deg))
    cos_out = math.sqrt(1 - (1 - cos_in**2) / index**2)
    tau = math.exp(-loss * thickness / cos_out)
    transmitted = reflected = 0.0
    for fraction, r in zip((s_share, 1 - s_share), fresnel(cos_in, 1.0, index), strict=True):
        t = (1 - r) ** 2 * tau / (1 - r**2 * tau**2)
        transmitted += fraction * t
        reflected += fraction * (r + r * tau * t)
    result = trace(slab(one_ray((0.0, -1.0), angle_deg, s_share), index, thickness, loss), "power", FINE)
    assert result.monitors["behind"].power == pytest.approx(transmitted, abs=1e-12)
    assert result.ledger.escaped == pytest.approx(transmitted + reflected, abs=1e-12)
    assert result.ledger.absorbed == pytest.approx(1 - transmitted - reflected, abs=1e-12)


@pytest.mark.parametrize("index", INDICES)
def test_no_reflection_at_brewster_angle(index: float) -> None:
    scene = slab(one_ray((0.0, -1.0), math.degrees(math.atan(index)), s_share=0.0), index, 2.0)
    result = trace(scene, "power", FINE, segments=True)
    assert result.monitors["behind"].power == pytest.approx(1.0, abs=1e-14)
    assert len(result.paths()) == 1
    tilted = slab(one_ray((0.0, -1.0), math.degrees(math.atan(index)) + 1, s_share=0.0), index, 2.0)
    assert len(trace(tilted, "power", FINE, segments=True).paths()) > 1


@pytest.mark.parametrize("incidence_deg", [36.0, 48.59, 60.0, 75.0])
@pytest.mark.parametrize("index", [1.44, 1.5])
def test_prism_deviation(index: float, incidence_deg: float) -> None:
    half = math.radians(30.0)
    apex, left, right = (0.0, 10.0), (-10 * math.tan(half), 0.0), (10 * math.tan(half), 0.0)
    faces = [Segment(left, right), Segment(right, apex), Segment(apex, left)]
    inside = math.asin(math.sin(math.radians(incidence_deg)) / index)
    out = math.asin(index * math.sin(2 * half - inside))
    deviation = math.radians(incidence_deg) + out - 2 * half
    upwards = math.radians(incidence_deg - 30.0)  # from the normal of the left face, towards the base
    direction = (math.cos(upwards), math.sin(upwards))
    middle = (0.5 * (apex[0] + left[0]), 0.5 * (apex[1] + left[1]))
    source = Rays((along(middle, direction, -3.0),), (direction,))
    path = only_path(Scene((AIR, glass(index)), body([*faces]), (source,)))
    assert path.exit_direction is not None
    assert math.asin(abs(cross(direction, path.exit_direction))) == pytest.approx(deviation, abs=1e-12)


@pytest.mark.parametrize("index", [1.3, 1.44, 1.8])
def test_ball_lens_focus(index: float) -> None:
    """The back focal length is nD/(4(n−1)) − D/2 for paraxial rays."""
    height = 1e-5
    ball = body([Arc.circle((0.0, 0.0), 0.5)])
    path = only_path(Scene((AIR, glass(index)), ball, (one_ray((height, -3.0), 0.0),)))
    assert path.exit_direction is not None
    x, z = path.points_mm[-1]
    focus = z - x * path.exit_direction[1] / path.exit_direction[0]
    assert focus - 0.5 == pytest.approx(index / (4 * (index - 1)) - 0.5, abs=1e-8)


@pytest.mark.parametrize("index", [1.2, 1.44, 1.54])
def test_escape_cone_of_a_slab(index: float) -> None:
    """Of a fan uniform in angle, the fraction θc/π leaves through each face; the rest is guided to the ends."""
    rays = 20_000
    result = trace(slab(Fan((0.0, 0.7), 0.0, 360.0, rays), index, 2.0), "count")
    cone = math.asin(1 / index) / math.pi
    assert result.monitors["behind"].power == pytest.approx(cone, abs=2 / rays)
    assert result.ledger.escaped == pytest.approx(2 * cone, abs=4 / rays)
    assert result.ledger.absorbed == pytest.approx(1 - 2 * cone, abs=4 / rays)


def test_light_from_the_centre_of_an_absorbing_ball() -> None:
    """The fraction (1−R) τ / (1 − R τ²) escapes, as every reflected ray returns through the centre."""
    index, loss, radius = 1.6, 0.2, 3.0
    scene = Scene(
        (AIR, glass(index, loss)), body([Arc.circle((1.0, -2.0), radius)]), (Fan((1.0, -2.0), 0.0, 360.0, 11),)
    )
    result = trace(scene, "power", FINE)
    r, tau = ((index - 1) / (index + 1)) ** 2, math.exp(-loss * radius)
    expected = (1 - r) * tau / (1 - r * tau**2)
    assert result.ledger.escaped == pytest.approx(expected, abs=1e-10)
    assert result.ledger.absorbed == pytest.approx(1 - expected, abs=1e-10)


@pytest.mark.parametrize(("behaviour", "index"), [("mirror", 1.0), ("refracting", 1.5)])
def test_chords_of_a_circle_have_the_same_distance_from_the_centre(behaviour: Behaviour, index: float) -> None:
    """Inside a circular mirror or a totally reflecting circle (whispering gallery), for 500 reflections."""
    circle = Interface("circle", Arc.circle((0.0, 0.0), 2.0), "glass", "air", behaviour)
    scene = Scene((AIR, glass(index)), (circle,), (one_ray((1.9, 0.1), 3.0),))
    result = trace(scene, "count", Limits(max_hits=500), segments=True)
    (path,) = result.paths()
    assert (result.hits, path.fate, result.ledger.truncated) == (500, "truncated", 1.0)
    chords = np.diff(path.points_mm, axis=0)
    chords /= np.hypot(*chords.T)[:, None]
    starts = path.points_mm[:-1]
    distance = starts[:, 0] * chords[:, 1] - starts[:, 1] * chords[:, 0]
    np.testing.assert_allclose(distance, distance[0], atol=1e-12)
    np.testing.assert_allclose(np.hypot(*path.points_mm[1:].T), 2.0, atol=1e-12)


def test_parabolic_mirror_focuses_a_beam() -> None:
    """The focus of x = c z² is at a distance of 1/(4c) from the vertex."""
    curve = Parabola((5.0, 0.0), (0.0, 1.0), -0.1, -4.0, 4.0)
    scene = Scene(
        (AIR,), (Interface("mirror", curve, "air", "air", "mirror"),), (Beam((0.0, -3.0), (0.0, 3.0), -90.0, 9),)
    )
    for path in trace(scene, "count", segments=True).paths():
        assert path.exit_direction is not None
        x, z = path.points_mm[-1]
        assert cross(path.exit_direction, minus((5.0 - 2.5, 0.0), (float(x), float(z)))) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("index", "image_mm"), [(1.44, 20.0), (1.8, 5.0)])
def test_oval_focuses_a_fan(index: float, image_mm: float) -> None:
    oval = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, index, 1.0, image_mm, 30.0, -30.0)
    closing = Segment(oval.end, oval.start)
    lens = (Interface("front", oval, "glass", "air"), Interface("back", closing, "glass", "glass"))
    scene = Scene(
        (AIR, glass(index)), lens, (Fan((0.0, -1.0), 0.0, 58.0, 20),), open_media=True
    )  # the glass is unbounded
    for path in trace(scene, "count", segments=True).paths():
        assert path.exit_direction is not None
        x, z = path.points_mm[1]
        offset = cross(path.exit_direction, minus((0.0, image_mm), (float(x), float(z))))
        assert offset == pytest.approx(0, abs=1e-12)


def test_each_side_of_a_square_receives_a_quarter() -> None:
    result = trace(Scene((AIR,), box(2.0), (Fan((0.0, 0.0), 0.0, 360.0, 1001),)), "count")
    assert sum(reading.rays for reading in result.detectors.values()) == 1001
    for reading in result.detectors.values():
        assert reading.power == pytest.approx(0.25, abs=1 / 1001)
