"""Equivalent descriptions of a scene give the same results."""

import dataclasses
import math

import numpy as np
import pytest

from solen.curve import Arc, Curve, Parabola, Segment
from solen.plane import Rigid, minus, unit
from solen.scene import Fan, Interface, Region, Scene, dumps, loads
from solen.trace import Limits, Mode, Trace, trace
from tests.agreement.random_scene_support import random_scene
from tests.agreement.scenes_support import AIR, body, box, check_same_readings, circle_arcs, glass, moved

FEW = Limits(min_weight=1e-3, max_hits=6)
MODES: list[Mode] = ["count", "power"]


def scene_without_corner_rays(seed: int) -> Scene:
    """Return a random scene without the rays that almost meet its corners."""
    scene = random_scene(seed, 20)
    return dataclasses.replace(scene, sources=scene.sources[:-1])


def in_box(regions: tuple[Region, ...], interfaces: tuple[Interface, ...]) -> Scene:
    """Return a body inside four receivers, with a fan from its left."""
    return Scene(regions, (*interfaces, *box(9.0)), (Fan((-6.0, 0.4), -90.0, 60.0, 200),))


def check_same_points(a: Trace, b: Trace, tolerance_mm: float) -> None:
    for path_a, path_b in zip(a.paths(), b.paths(), strict=True):
        np.testing.assert_allclose(path_a.points_mm, path_b.points_mm, rtol=0, atol=tolerance_mm)


@pytest.mark.parametrize("mode", MODES)
def test_circle_and_arcs(mode: Mode) -> None:
    regions = (AIR, glass(1.5, 0.01))
    circle = in_box(regions, body([Arc.circle((0.5, 0.0), 3.0)]))
    arcs = in_box(regions, body(circle_arcs((0.5, 0.0), 3.0, 13)))
    a, b = (trace(scene, mode, FEW, segments=True) for scene in (circle, arcs))
    check_same_readings(a, b, 1e-10)
    check_same_points(a, b, 1e-10)


@pytest.mark.parametrize("mode", MODES)
def test_segment_and_straight_parabola(mode: Mode) -> None:
    def straight(curve: Curve) -> Curve:
        if not isinstance(curve, Segment):
            return curve
        return Parabola(curve.a, unit(minus(curve.b, curve.a)), 0.0, 0.0, curve.length_mm)

    segments = scene_without_corner_rays(11)
    parabolas = dataclasses.replace(
        segments, interfaces=tuple(dataclasses.replace(i, curve=straight(i.curve)) for i in segments.interfaces)
    )
    assert segments != parabolas
    a, b = (trace(scene, mode, FEW, segments=True) for scene in (segments, parabolas))
    check_same_readings(a, b, 1e-10)
    check_same_points(a, b, 1e-8)


@pytest.mark.parametrize("mode", MODES)
def test_body_and_its_halves(mode: Mode) -> None:
    """A ball, and two half balls of the same index that touch."""
    north, south = Arc((0.0, 0.0), 3.0, 20.0, 180.0), Arc((0.0, 0.0), 3.0, 200.0, 180.0)
    ball = in_box((AIR, glass(1.5, 0.02)), body([north, south]))
    cut = Interface("cut", Segment(south.start, south.end), "upper", "lower")
    halves = (Interface("n", north, "upper", "air"), Interface("s", south, "lower", "air"), cut)
    if Segment(south.start, south.end).normal_at((0.0, 0.0))[1] < 0:
        halves = (*halves[:2], dataclasses.replace(cut, left="lower", right="upper"))
    two_halves = in_box((AIR, Region("upper", 1.5, 0.02), Region("lower", 1.5, 0.02)), halves)
    limits = Limits(min_weight=1e-9)  # no limit on hits, of which the cut adds some
    a, b = trace(ball, mode, limits), trace(two_halves, mode, limits)
    assert (a.undefined, b.undefined) == (0, 0)
    for name, reading in a.detectors.items():
        assert b.detectors[name].power == pytest.approx(reading.power, abs=1e-9)
    assert b.ledger.absorbed == pytest.approx(a.ledger.absorbed, abs=1e-9)


@pytest.mark.parametrize("seed", range(20, 26))
@pytest.mark.parametrize("mode", MODES)
def test_rigid_motion_of_the_scene(mode: Mode, seed: int) -> None:
    scene = scene_without_corner_rays(seed)
    motion = Rigid.about((3.0, -7.0), 37.0)
    check_same_readings(trace(scene, mode, FEW), trace(moved(scene, motion), mode, FEW), 1e-9)


@pytest.mark.parametrize("seed", range(30, 36))
@pytest.mark.parametrize("mode", MODES)
def test_reversed_curves(mode: Mode, seed: int) -> None:
    """Receivers are not reversed, because only their left side detects light."""
    scene = scene_without_corner_rays(seed)
    swapped = tuple(
        i if i.behaviour == "receiver" else dataclasses.replace(i, curve=i.curve.reversed(), left=i.right, right=i.left)
        for i in scene.interfaces
    )
    check_same_readings(trace(scene, mode, FEW), trace(dataclasses.replace(scene, interfaces=swapped), mode, FEW), 1e-9)


@pytest.mark.parametrize("mode", MODES)
def test_reversed_receiver_absorbs_light(mode: Mode) -> None:
    scene = in_box((AIR, glass(1.5)), body([Arc.circle((0.5, 0.0), 3.0)]))
    backs = tuple(
        dataclasses.replace(i, curve=i.curve.reversed()) if i.behaviour == "receiver" else i for i in scene.interfaces
    )
    front, back = trace(scene, mode), trace(dataclasses.replace(scene, interfaces=backs), mode)
    assert back.ledger.detected == 0.0
    assert back.ledger.absorbed == pytest.approx(front.ledger.detected, abs=1e-12)
    assert front.ledger.detected > 0.99


@pytest.mark.parametrize("seed", range(40, 50))
@pytest.mark.parametrize("mode", MODES)
def test_json_round_trip_changes_no_bit(mode: Mode, seed: int) -> None:
    scene = random_scene(seed, 20)
    loaded = loads(dumps(scene))
    assert loaded == scene
    a, b = trace(scene, mode, FEW, segments=True), trace(loaded, mode, FEW, segments=True)
    assert a.ledger == b.ledger
    assert a.segments is not None
    assert b.segments is not None
    np.testing.assert_array_equal(a.segments, b.segments)


def test_order_of_interfaces_and_sources() -> None:
    scene = scene_without_corner_rays(50)
    other = dataclasses.replace(scene, interfaces=scene.interfaces[::-1], sources=scene.sources[::-1])
    check_same_readings(trace(scene, "power", FEW), trace(other, "power", FEW), 1e-12)


def test_fan_two_halves_and_single_rays() -> None:
    scene = scene_without_corner_rays(51)
    fan = Fan((6.0, 6.2), 10.0, 120.0, 200)
    halves = (Fan((6.0, 6.2), 40.0, 60.0, 100, power=0.5), Fan((6.0, 6.2), -20.0, 60.0, 100, power=0.5))
    a, b = (trace(dataclasses.replace(scene, sources=sources), "power", FEW) for sources in ((fan,), halves))
    check_same_readings(a, b, 1e-9)
    rays = moved(dataclasses.replace(scene, sources=(fan,)), Rigid())
    check_same_readings(a, trace(rays, "power", FEW), 1e-12)
    assert math.isclose(rays.emitted, 1.0)


def test_monitor_its_halves_and_its_reverse() -> None:
    """The halves add up, and the sign changes if the monitor is reversed."""
    scene = scene_without_corner_rays(52)
    line = dataclasses.replace(scene.monitors[0], bins=8)
    (x, z), (u, w) = line.start, line.end
    middle = (0.5 * (x + u), 0.5 * (z + w))
    monitors = (
        line,
        dataclasses.replace(line, name="first", end=middle),
        dataclasses.replace(line, name="second", start=middle),
        dataclasses.replace(line, name="back", start=line.end, end=line.start),
    )
    crossed = trace(dataclasses.replace(scene, monitors=monitors), "power", FEW).monitors
    assert crossed[line.name].rays > 10
    assert crossed["first"].power + crossed["second"].power == pytest.approx(crossed[line.name].power, abs=1e-12)
    assert crossed["back"].power == pytest.approx(-crossed[line.name].power, abs=1e-12)
    np.testing.assert_allclose(crossed["back"].power_by_bin, -crossed[line.name].power_by_bin[::-1], atol=1e-12)
    assert crossed[line.name].power_by_bin.sum() == pytest.approx(crossed[line.name].power, abs=1e-12)
