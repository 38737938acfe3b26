"""Adaptive integration agrees with closed forms and dense fans, and finds narrow features between its first rays."""

import math

import pytest

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.scene import Beam, Fan, Interface, Region, Scene
from solen.sensor import Sensor
from solen.spec import Design, Material
from solen.trace import Limits, Mode, integrate, trace
from tests.agreement.random_scene_support import random_scene
from tests.agreement.scenes_support import guide, guided_fraction

AIR = Region("air", 1.0)


def sensor_scene(angle_deg: float, shape: str = "cartesian-oval", rays: int | None = None) -> Scene:
    design = Design(name="paper", material=Material(index=1.44), lens={"shape": shape})
    return Sensor.of(design).scene(angle_deg, rays)


def test_short_guide() -> None:
    integral = integrate(guide(5.0), tolerance=1e-5, limits=Limits(min_weight=1e-6), max_segments=10**7)
    assert integral.reached
    assert integral.detectors["screen"].power == pytest.approx(guided_fraction(), abs=1e-5)
    assert guided_fraction() == pytest.approx(0.925572, abs=5e-7)


@pytest.mark.evidence
@pytest.mark.parametrize(("gap_mm", "expected"), [(None, 0.925572), (0.1, 0.914264)])
def test_long_guide(gap_mm: float | None, expected: float) -> None:
    integral = integrate(guide(100.0, gap_mm), tolerance=1e-5, max_segments=10**8)
    power = integral.detectors["screen"].power
    print(f"\n  slab of 100 x 5 mm, receiver {gap_mm} mm behind it: {power:.6f}, expected {expected}")
    assert power == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("mode", ["count", "power"])
@pytest.mark.parametrize("angle_deg", [-3.0, 0.0, 0.2])
@pytest.mark.parametrize("shape", ["cartesian-oval", "none"])
def test_sensor_agrees_with_dense_fan(mode: Mode, angle_deg: float, shape: str) -> None:
    integral = integrate(sensor_scene(angle_deg, shape), mode, 1e-6)
    assert integral.reached
    assert integral.u_power <= 1e-6
    rays = 300_000
    dense = trace(sensor_scene(angle_deg, shape, rays), mode)
    for name, reading in dense.detectors.items():
        assert integral.detectors[name].power == pytest.approx(reading.power, abs=20.0 / rays)
    assert integral.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert abs(integral.ledger.truncated) <= 1e-6


def test_lens_accepts_light_up_to_its_edge() -> None:
    """The angle of the edge is atan(2/(z(2) + 1)); both receivers get half of the light at rest."""
    integral = integrate(sensor_scene(0.0), "count", 1e-9)
    edge_deg = math.degrees(math.atan2(2.0, 1.0 + 1.8108521422303))
    right, left = integral.detectors["right"].power, integral.detectors["left"].power
    assert right + left == pytest.approx(edge_deg / 60.0, abs=1e-9)
    assert left == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize("size_mm", [1e-2, 1e-4, 1e-6])
def test_finds_a_shadow_between_two_rays(size_mm: float) -> None:
    """A small absorbing disc between the first samples shades the fraction 2 asin(r/d)/cone of the wall behind it."""
    disc = Interface("disc", Arc.circle((0.123, 10.0), size_mm / 2), "air", "air", "absorbing")
    wall = Interface("wall", Segment((50.0, 20.0), (-50.0, 20.0)), "air", "air", "receiver", "wall")
    integral = integrate(Scene((AIR,), (disc, wall), (Fan((0.0, 0.0), 0.0, 90.0, 1),)), "count", 1e-9)
    shadow = 2.0 * math.degrees(math.asin(size_mm / 2 / math.hypot(0.123, 10.0))) / 90.0
    assert integral.reached
    assert 1.0 - integral.detectors["wall"].power == pytest.approx(shadow, abs=1e-9)


@pytest.mark.parametrize("height_mm", [2e-6, 1e-4, 5e-4])
def test_finds_a_receiver_close_to_a_concave_mirror(height_mm: float) -> None:
    """The receiver is between the mirror and a chord, so that no first rays pass on both sides of it."""
    mirror = Interface("mirror", Arc((0.0, 0.0), 10.0, 40.0, 100.0), "air", "air", "mirror")
    x, z = 10.0 * math.sin(math.radians(7.3)), 10.0 * math.cos(math.radians(7.3))
    scale = 1.0 - 1e-5
    low, high = (x * scale - height_mm, z * scale), (x * scale + height_mm, z * scale)
    receiver = Interface("dot", Segment(high, low), "air", "air", "receiver", "dot")
    integral = integrate(Scene((AIR,), (mirror, receiver), (Fan((0.0, 0.0), 0.0, 60.0, 1),)), "count", 1e-8)
    low_deg, high_deg = (math.degrees(math.atan2(x * scale + side * height_mm, z * scale)) for side in (-1, 1))
    assert integral.detectors["dot"].power == pytest.approx((high_deg - low_deg) / 60.0, abs=2e-8)


@pytest.mark.parametrize("mode", ["count", "power"])
def test_uncertainty_covers_dense_fan_in_random_scenes(mode: Mode) -> None:
    """The paths of light trapped in random bodies are chaotic, so that the uncertainty is large but still valid."""
    limits, bounds = Limits(min_weight=1e-3, max_hits=30), []
    for seed in (0, 1, 3, 4, 6, 7):
        base = random_scene(seed, 1)
        scene = Scene(base.regions, base.interfaces, (Fan((0.31, 0.17), 20.0, 40.0, 4_000),))
        integral = integrate(scene, mode, 1e-3, limits, max_segments=60_000)
        assert integral.reached or "rays" in integral.why
        for name, reading in trace(scene, mode, limits).detectors.items():
            assert integral.detectors[name].power == pytest.approx(reading.power, abs=integral.u_power + 5e-3), seed
        if integral.detectors:
            assert integral.reached == (integral.u_power <= 1e-3)
            bounds.append(integral.u_power)
    assert len(bounds) >= 4
    assert mode == "power" or min(bounds) < 0.1  # an uncertainty that is always large would be useless


def test_refuses_beams_and_invalid_options() -> None:
    beam = Scene((AIR,), (), (Beam((0.0, 0.0), (1.0, 0.0), 0.0, 2),))
    with pytest.raises(DesignError, match="source of type Beam"):
        integrate(beam)
    with pytest.raises(DesignError, match="tolerance = 0"):
        integrate(sensor_scene(0.0), tolerance=0.0)
    with pytest.raises(DesignError, match="mode"):
        integrate(sensor_scene(0.0), "bogus")  # type: ignore[arg-type]  # invalid on purpose


def test_ends_after_max_segments() -> None:
    integral = integrate(sensor_scene(0.2), "power", 1e-9, max_segments=100)
    assert not integral.reached
    assert integral.u_power > 1e-9
    assert "rays" in integral.why
