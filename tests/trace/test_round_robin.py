"""Rays in turns: the same light as the plain reference where nothing is weak, and the same mean where something is."""

import math

import numpy as np
import pytest

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.scene import Beam, Interface, Monitor, Region, Scene, Surface
from solen.trace import Limits, RoundRobin, trace_reference, trace_round_robin

AIR, GLASS = Region("air", 1.0), Region("glass", 1.5)
BALL = Interface("ball.1", Arc.circle((0.0, 0.0), 5.0), "glass", "air")
BEHIND = Monitor("behind", (9.0, -6.0), (9.0, 6.0), 12)


def ball(rays: int, power: float, *more: Interface) -> Scene:
    return Scene((AIR, GLASS), (BALL, *more), (Beam((-9.0, -4.9), (-9.0, 4.9), -90.0, rays, power=power),), (BEHIND,))


def test_with_nothing_weak_it_is_the_reference() -> None:
    splitter = Interface(
        "splitter.1", Segment((7.0, -3.0), (8.0, 3.0)), "air", "air", "splitter", surface=Surface(transmitted=0.3)
    )
    scene = ball(40, 40.0, splitter)
    turns = trace_round_robin(scene, RoundRobin(weak=1e-9, weakest=0.0))
    plain = trace_reference(scene, "power", Limits(1e-12))
    np.testing.assert_allclose(turns.monitors["behind"].power_by_bin, plain.monitors["behind"].power_by_bin, atol=1e-9)
    assert turns.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert turns.ledger.escaped == pytest.approx(plain.ledger.escaped, abs=1e-8)


def test_weak_parts_stand_for_one_another() -> None:
    """Of the weak parts of many alike rays every k-th goes on with k times its power: the total stays."""
    scene = ball(3001, 0.2 * 3001)
    exact = trace_reference(scene, "power", Limits(1e-12)).monitors["behind"].power
    thinned, cut = (trace_round_robin(scene, RoundRobin(fresh=(way,) * 3001)) for way in (False, True))
    assert abs(thinned.monitors["behind"].power - exact) < 0.2 * abs(cut.monitors["behind"].power - exact)
    assert thinned.hits < trace_reference(scene, "power", Limits(1e-6)).hits / 2
    assert thinned.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert cut.ledger.truncated > 1e-3


def test_rays_that_stand_alone_lose_what_is_weak() -> None:
    """At normal incidence 4 % go back; below the weight they are dropped."""
    plate = [
        Interface("plate.1", Segment((0.0, -9.0), (0.0, 9.0)), "air", "glass"),
        Interface("plate.2", Segment((1.0, -9.0), (1.0, 9.0)), "glass", "air"),
    ]
    source = Beam((-9.0, -1.0), (-9.0, 1.0), -90.0, 1, power=0.2)
    scene = Scene((AIR, GLASS), tuple(plate), (source,), (BEHIND,), open_media=True)
    result = trace_round_robin(scene, RoundRobin(fresh=(True,)))
    assert abs(result.monitors["behind"].power) == pytest.approx(0.96**2)
    assert result.ledger.truncated == pytest.approx(0.04 + 0.96 * 0.04)


def test_a_detector_takes_a_turn_and_the_number_of_turns_is_limited() -> None:
    scene = ball(5, 5.0)
    assert trace_round_robin(scene, RoundRobin(max_hits=3)).ledger.truncated < 0.2
    nothing = trace_round_robin(scene, RoundRobin(max_hits=0))
    assert nothing.ledger.truncated == pytest.approx(1.0)
    assert nothing.hits == 0


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(DesignError, match="one entry for each of 5 rays"):
        trace_round_robin(ball(5, 5.0), RoundRobin(fresh=(True,)))
    with pytest.raises(DesignError, match="at least 0"):
        RoundRobin(weak=-1.0)
    with pytest.raises(DesignError, match="finite"):
        RoundRobin(weakest=math.nan)
