"""Two descriptions of one physics must agree."""

import dataclasses
import math

import numpy as np
import pytest

from solen.curve import Arc, Curve, Parabola, Segment
from solen.plane import Rigid, minus, unit
from solen.scene import Fan, Interface, Region, Scene, dumps, loads
from solen.trace import Limits, Mode, Trace, trace
from tests.agreement.random_scene_support import random_scene
from tests.agreement.scenes_support import AIR, body, box, circle_arcs, glass, moved, same_readings

FEW = Limits(min_weight=1e-3, max_hits=6)
MODES: list[Mode] = ["count", "power"]


def rigid() -> Rigid:
    return Rigid.about((3.0, -7.0), 37.0)


def smooth(seed: int) -> Scene:
    """A random scene without the rays that are aimed at its corners."""
    scene = random_scene(seed, 20)
    return dataclasses.replace(scene, sources=scene.sources[:-1])


def in_box(regions: tuple[Region, ...], interfaces: tuple[Interface, ...]) -> Scene:
    """A fan from the left of a body, all of it caught by four receivers."""
    return Scene(regions, (*interfaces, *box(9.0)), (Fan((-6.0, 0.4), -90.0, 60.0, 200),))


def same_corners(a: Trace, b: Trace, tolerance_mm: float) -> None:
    for one, other in zip(a.paths(), b.paths(), strict=True):
        np.testing.assert_allclose(one.points_mm, other.points_mm, rtol=0, atol=tolerance_mm)


@pytest.mark.parametrize("mode", MODES)
def test_a_circle_and_its_arcs(mode: Mode) -> None:
    regions = (AIR, glass(1.5, 0.01))
    whole = in_box(regions, body([Arc.circle((0.5, 0.0), 3.0)]))
    pieces = in_box(regions, body(circle_arcs((0.5, 0.0), 3.0, 13)))
    a, b = (trace(scene, mode, FEW, legs=True) for scene in (whole, pieces))
    same_readings(a, b, 1e-10)
    same_corners(a, b, 1e-10)


@pytest.mark.parametrize("mode", MODES)
def test_a_straight_parabola_is_a_segment(mode: Mode) -> None:
    def flat(curve: Curve) -> Curve:
        if not isinstance(curve, Segment):
            return curve
        return Parabola(curve.a, unit(minus(curve.b, curve.a)), 0.0, 0.0, curve.length_mm)

    segments = smooth(11)
    parabolas = dataclasses.replace(
        segments, interfaces=tuple(dataclasses.replace(i, curve=flat(i.curve)) for i in segments.interfaces)
    )
    assert segments != parabolas
    a, b = (trace(scene, mode, FEW, legs=True) for scene in (segments, parabolas))
    same_readings(a, b, 1e-10)
    same_corners(a, b, 1e-8)


@pytest.mark.parametrize("mode", MODES)
def test_one_body_or_two_that_touch(mode: Mode) -> None:
    """A ball, or its two halves of one index with a surface between them that nobody sees."""
    north, south = Arc((0.0, 0.0), 3.0, 20.0, 180.0), Arc((0.0, 0.0), 3.0, 200.0, 180.0)
    one = in_box((AIR, glass(1.5, 0.02)), body([north, south]))
    cut = Interface("cut", Segment(south.start, south.end), "upper", "lower")
    halves = (Interface("n", north, "upper", "air"), Interface("s", south, "lower", "air"), cut)
    if Segment(south.start, south.end).normal_at((0.0, 0.0))[1] < 0:
        halves = (*halves[:2], dataclasses.replace(cut, left="lower", right="upper"))
    two = in_box((AIR, Region("upper", 1.5, 0.02), Region("lower", 1.5, 0.02)), halves)
    limits = Limits(min_weight=1e-9)  # the cut is one hit more, so no hit may be counted
    a, b = trace(one, mode, limits), trace(two, mode, limits)
    assert (a.undefined, b.undefined) == (0, 0)
    for name, reading in a.detectors.items():
        assert b.detectors[name].power == pytest.approx(reading.power, abs=1e-9)
    assert b.ledger.absorbed == pytest.approx(a.ledger.absorbed, abs=1e-9)


@pytest.mark.parametrize("seed", range(20, 26))
@pytest.mark.parametrize("mode", MODES)
def test_a_scene_may_be_turned_and_shifted(mode: Mode, seed: int) -> None:
    here = smooth(seed)
    same_readings(trace(here, mode, FEW), trace(moved(here, rigid()), mode, FEW), 1e-9)


@pytest.mark.parametrize("seed", range(30, 36))
@pytest.mark.parametrize("mode", MODES)
def test_curves_may_be_walked_either_way(mode: Mode, seed: int) -> None:
    """All but receivers: the left of a receiver is its face."""
    scene = smooth(seed)
    swapped = tuple(
        i if i.behaviour == "receiver" else dataclasses.replace(i, curve=i.curve.reversed(), left=i.right, right=i.left)
        for i in scene.interfaces
    )
    same_readings(trace(scene, mode, FEW), trace(dataclasses.replace(scene, interfaces=swapped), mode, FEW), 1e-9)


@pytest.mark.parametrize("mode", MODES)
def test_a_receiver_turned_round_absorbs_what_it_detected(mode: Mode) -> None:
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
def test_a_scene_read_back_from_json_gives_the_same_bits(mode: Mode, seed: int) -> None:
    scene = random_scene(seed, 20)
    again = loads(dumps(scene))
    assert again == scene
    a, b = trace(scene, mode, FEW, legs=True), trace(again, mode, FEW, legs=True)
    assert a.ledger == b.ledger
    assert a.legs is not None
    assert b.legs is not None
    np.testing.assert_array_equal(a.legs, b.legs)


def test_the_order_of_interfaces_and_sources_does_not_matter() -> None:
    scene = smooth(50)
    other = dataclasses.replace(scene, interfaces=scene.interfaces[::-1], sources=scene.sources[::-1])
    same_readings(trace(scene, "power", FEW), trace(other, "power", FEW), 1e-12)


def test_a_fan_may_be_given_ray_by_ray_or_in_two_halves() -> None:
    scene = smooth(51)
    whole = Fan((6.0, 6.2), 10.0, 120.0, 200)
    halves = (Fan((6.0, 6.2), 40.0, 60.0, 100, power=0.5), Fan((6.0, 6.2), -20.0, 60.0, 100, power=0.5))
    a, b = (trace(dataclasses.replace(scene, sources=sources), "power", FEW) for sources in ((whole,), halves))
    same_readings(a, b, 1e-9)
    listed = moved(dataclasses.replace(scene, sources=(whole,)), Rigid())
    same_readings(a, trace(listed, "power", FEW), 1e-12)
    assert math.isclose(listed.emitted, 1.0)


def test_a_monitor_counts_what_crosses_it_whatever_else_is_there() -> None:
    """Net power towards the left; split in two, the halves add up; turned round, the sign changes."""
    scene = smooth(52)
    line = dataclasses.replace(scene.monitors[0], bins=8)
    (x, z), (u, w) = line.start, line.end
    middle = (0.5 * (x + u), 0.5 * (z + w))
    parts = (
        line,
        dataclasses.replace(line, name="first", end=middle),
        dataclasses.replace(line, name="second", start=middle),
        dataclasses.replace(line, name="back", start=line.end, end=line.start),
    )
    seen = trace(dataclasses.replace(scene, monitors=parts), "power", FEW).monitors
    assert seen[line.name].rays > 10
    assert seen["first"].power + seen["second"].power == pytest.approx(seen[line.name].power, abs=1e-12)
    assert seen["back"].power == pytest.approx(-seen[line.name].power, abs=1e-12)
    np.testing.assert_allclose(seen["back"].power_by_bin, -seen[line.name].power_by_bin[::-1], atol=1e-12)
    assert seen[line.name].power_by_bin.sum() == pytest.approx(seen[line.name].power, abs=1e-12)
