"""Round-robin tracing agrees with the reference if no part is weak, and in the mean if parts are weak."""

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


def test_agrees_with_reference_without_weak_parts() -> None:
    splitter = Interface(
        "splitter.1", Segment((7.0, -3.0), (8.0, 3.0)), "air", "air", "splitter", surface=Surface(transmitted=0.3)
    )
    scene = ball(40, 40.0, splitter)
    result = trace_round_robin(scene, RoundRobin(min_split_power=1e-9, min_power=0.0))
    reference = trace_reference(scene, "power", Limits(1e-12))
    expected = reference.monitors["behind"].power_by_bin
    np.testing.assert_allclose(result.monitors["behind"].power_by_bin, expected, atol=1e-9)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert result.ledger.escaped == pytest.approx(reference.ledger.escaped, abs=1e-8)


def test_weak_parts_represent_one_another() -> None:
    """Of the weak parts of many similar rays, every k-th continues with k times its power, which preserves the sum."""
    rays = 1501
    scene = ball(rays, 0.2 * rays)
    exact = trace_reference(scene, "power", Limits(1e-12)).monitors["behind"].power
    sequence, single = (trace_round_robin(scene, RoundRobin(starts_sequence=(s,) * rays)) for s in (False, True))
    assert abs(sequence.monitors["behind"].power - exact) < 0.2 * abs(single.monitors["behind"].power - exact)
    assert sequence.hits < trace_reference(scene, "power", Limits(1e-6)).hits / 2
    assert sequence.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert single.ledger.truncated > 1e-3


def test_weak_parts_of_single_rays_are_dropped() -> None:
    """At normal incidence 4 % is reflected, which is below the minimum power."""
    plate = [
        Interface("plate.1", Segment((0.0, -9.0), (0.0, 9.0)), "air", "glass"),
        Interface("plate.2", Segment((1.0, -9.0), (1.0, 9.0)), "glass", "air"),
    ]
    source = Beam((-9.0, -1.0), (-9.0, 1.0), -90.0, 1, power=0.2)
    scene = Scene((AIR, GLASS), tuple(plate), (source,), (BEHIND,), open_media=True)
    result = trace_round_robin(scene, RoundRobin(starts_sequence=(True,)))
    assert abs(result.monitors["behind"].power) == pytest.approx(0.96**2)
    assert result.ledger.truncated == pytest.approx(0.04 + 0.96 * 0.04)


def test_max_hits_includes_detectors() -> None:
    scene = ball(5, 5.0)
    assert trace_round_robin(scene, RoundRobin(max_hits=3)).ledger.truncated < 0.2
    none = trace_round_robin(scene, RoundRobin(max_hits=0))
    assert none.ledger.truncated == pytest.approx(1.0)
    assert none.hits == 0


def test_refuses_invalid_rules() -> None:
    with pytest.raises(DesignError, match="one entry for each of 5 rays"):
        trace_round_robin(ball(5, 5.0), RoundRobin(starts_sequence=(True,)))
    with pytest.raises(DesignError, match="at least 0"):
        RoundRobin(min_split_power=-1.0)
    with pytest.raises(DesignError, match="finite"):
        RoundRobin(min_power=math.nan)
