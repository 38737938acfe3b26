"""Adaptive integration against closed forms, against dense fans, and against slivers that a plain one would miss."""

import math

import pytest

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.scene import Beam, Fan, Interface, Region, Scene
from solen.sensor import Sensor
from solen.spec import Design, Material
from solen.trace import Limits, Mode, integrate, trace
from tests.agreement.random_scene_support import random_scene
from tests.agreement.scenes_support import guide, guided_share

AIR = Region("air", 1.0)


def sensor(angle_deg: float, **design: object) -> Scene:
    return Sensor.of(Design(name="paper", material=Material(index=1.44), **design)).scene(angle_deg)


def test_a_slab_passes_the_closed_form() -> None:
    found = integrate(guide(5.0), tolerance=1e-5, limits=Limits(min_weight=1e-6), most_legs=10**7)
    assert found.reached
    assert found.detectors["screen"].power == pytest.approx(guided_share(), abs=1e-5)
    assert guided_share() == pytest.approx(0.925572, abs=5e-7)


@pytest.mark.evidence
@pytest.mark.parametrize(("gap_mm", "share"), [(None, 0.925572), (0.1, 0.914264)])
def test_a_long_slab_passes_the_closed_form(gap_mm: float | None, share: float) -> None:
    found = integrate(guide(100.0, gap_mm), tolerance=1e-5, most_legs=10**8)
    power = found.detectors["screen"].power
    print(f"\n  slab of 100 x 5 mm, receiver {gap_mm} mm behind it: {power:.6f}, asked {share}")
    assert power == pytest.approx(share, abs=1e-5)


@pytest.mark.parametrize("mode", ["count", "power"])
@pytest.mark.parametrize("angle_deg", [-3.0, 0.0, 0.2])
@pytest.mark.parametrize("shape", ["cartesian-oval", "none"])
def test_the_sensor_agrees_with_a_dense_fan(mode: Mode, angle_deg: float, shape: str) -> None:
    scene = sensor(angle_deg, lens={"shape": shape})
    found = integrate(scene, mode, 1e-6)
    assert found.reached
    assert found.u_power <= 1e-6
    rays = 300_000
    dense = trace(
        Sensor.of(Design(name="paper", material=Material(index=1.44), lens={"shape": shape})).scene(angle_deg, rays),
        mode,
    )
    for name, reading in dense.detectors.items():
        assert found.detectors[name].power == pytest.approx(reading.power, abs=20.0 / rays)
    assert found.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert abs(found.ledger.truncated) <= 1e-6


def test_the_accepted_share_is_the_edge_angle() -> None:
    """The oval takes everything up to atan(2/(z(2) + 1)); both halves are equal at rest."""
    found = integrate(sensor(0.0), "count", 1e-9)
    edge_deg = math.degrees(math.atan2(2.0, 1.0 + 1.8108521422303))
    right, left = found.detectors["right"].power, found.detectors["left"].power
    assert right + left == pytest.approx(edge_deg / 60.0, abs=1e-9)
    assert left == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize("size_mm", [1e-2, 1e-4, 1e-6])
def test_a_sliver_between_two_rays_is_found(size_mm: float) -> None:
    """A tiny black disc far from the first samples shades 2 asin(r/d)/cone; the wall behind takes all the rest."""
    disc = Interface("disc", Arc.circle((0.123, 10.0), size_mm / 2), "air", "air", "absorbing")
    wall = Interface("wall", Segment((50.0, 20.0), (-50.0, 20.0)), "air", "air", "receiver", "wall")
    found = integrate(Scene((AIR,), (disc, wall), (Fan((0.0, 0.0), 0.0, 90.0, 1),)), "count", 1e-9)
    shade = 2.0 * math.degrees(math.asin(size_mm / 2 / math.hypot(0.123, 10.0))) / 90.0
    assert found.reached
    assert 1.0 - found.detectors["wall"].power == pytest.approx(shade, abs=1e-9)


@pytest.mark.parametrize("height_mm", [2e-6, 1e-4, 5e-4])
def test_a_receiver_close_to_a_concave_mirror_is_found(height_mm: float) -> None:
    """Between a chord of the mirror and the mirror itself: no leg of the first rays passes on both sides of it."""
    mirror = Interface("mirror", Arc((0.0, 0.0), 10.0, 40.0, 100.0), "air", "air", "mirror")
    x, z = 10.0 * math.sin(math.radians(7.3)), 10.0 * math.cos(math.radians(7.3))
    near = 1.0 - 1e-5
    low, high = (x * near - height_mm, z * near), (x * near + height_mm, z * near)
    receiver = Interface("dot", Segment(high, low), "air", "air", "receiver", "dot")
    found = integrate(Scene((AIR,), (mirror, receiver), (Fan((0.0, 0.0), 0.0, 60.0, 1),)), "count", 1e-8)
    seen = [math.degrees(math.atan2(x * near + side * height_mm, z * near)) for side in (-1, 1)]
    assert found.detectors["dot"].power == pytest.approx((seen[1] - seen[0]) / 60.0, abs=2e-8)


@pytest.mark.parametrize("mode", ["count", "power"])
def test_random_scenes_agree_with_a_dense_fan_within_the_bound(mode: Mode) -> None:
    """Light trapped in random bodies is chaotic: the bound then says so, and still holds."""
    limits, bounds = Limits(min_weight=1e-3, max_hits=30), []
    for seed in (0, 1, 3, 4, 6, 7):
        base = random_scene(seed, 1)
        scene = Scene(base.regions, base.interfaces, (Fan((0.31, 0.17), 20.0, 40.0, 4_000),))
        found = integrate(scene, mode, 1e-4, limits, most_legs=60_000)
        assert found.reached or "rays" in found.why
        for name, reading in trace(scene, mode, limits).detectors.items():
            assert found.detectors[name].power == pytest.approx(reading.power, abs=found.u_power + 5e-3), seed
        if found.detectors:  # without a receiver there is no power to be off
            assert found.reached == (found.u_power <= 1e-4)
            bounds.append(found.u_power)
    assert len(bounds) >= 4
    assert mode == "power" or min(bounds) < 0.1  # a bound that is always large would be no use


def test_what_it_cannot_integrate_is_refused() -> None:
    beam = Scene((AIR,), (), (Beam((0.0, 0.0), (1.0, 0.0), 0.0, 2),))
    with pytest.raises(DesignError, match="sources made of points"):
        integrate(beam)
    with pytest.raises(DesignError, match="tolerance = 0"):
        integrate(sensor(0.0), tolerance=0.0)
    with pytest.raises(DesignError, match="mode"):
        integrate(sensor(0.0), "bogus")  # type: ignore[arg-type]  # what a caller without a checker may pass


def test_it_ends_after_so_many_legs() -> None:
    found = integrate(sensor(0.2), "power", 1e-9, most_legs=100)
    assert not found.reached
    assert found.u_power > 1e-9
    assert "rays" in found.why
