"""The numbers do not depend on threads, nor on whether ways are kept, nor on how the rays were split over sources."""

import dataclasses

import numpy as np
import pytest

from solen.scene import Scene
from solen.trace import Limits, Mode, Trace, trace
from tests.agreement.bits_support import bits
from tests.agreement.random_scene_support import random_scene

LIMITS = Limits(min_weight=1e-3, max_hits=100)


def same_bits(a: Trace, b: Trace) -> None:
    assert bits(dataclasses.replace(a, legs=None)) == bits(dataclasses.replace(b, legs=None))


def crowded(seed: int) -> Scene:
    """A random scene with more rays than one chunk in each of its fans."""
    return random_scene(seed, 9_000)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("mode", ["count", "power"])
def test_threads_do_not_change_a_bit(mode: Mode, seed: int) -> None:
    one = trace(crowded(seed), mode, LIMITS, threads=1)
    for threads in (2, 3, None):
        same_bits(one, trace(crowded(seed), mode, LIMITS, threads=threads))


@pytest.mark.parametrize("mode", ["count", "power"])
def test_keeping_ways_does_not_change_a_bit(mode: Mode) -> None:
    scene = random_scene(3, 3_000)
    without, kept = trace(scene, mode, LIMITS), trace(scene, mode, LIMITS, legs=True)
    same_bits(without, kept)
    assert kept.legs is not None
    assert without.paths() == []
    assert int(np.sum(kept.legs["interface"] >= 0)) == kept.hits


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("mode", ["count", "power"])
def test_rays_side_by_side_end_as_they_do_one_by_one(mode: Mode, seed: int) -> None:
    """Rays whose ways are kept are followed one by one."""
    scene = dataclasses.replace(random_scene(seed, 3_000), monitors=())
    together, apart = trace(scene, mode, LIMITS), trace(scene, mode, LIMITS, legs=True)
    assert (together.hits, together.truncated) == (apart.hits, apart.truncated)
    assert together.undefined == apart.undefined
    for name, one in together.detectors.items():
        other = apart.detectors[name]
        assert one.rays == other.rays
        assert one.power == pytest.approx(other.power, rel=1e-12, abs=1e-14)
        assert one.optical_path_mm == pytest.approx(other.optical_path_mm, rel=1e-9, nan_ok=True)
    for fate in ("detected", "escaped", "absorbed", "truncated"):
        assert getattr(together.ledger, fate) == pytest.approx(getattr(apart.ledger, fate), abs=1e-10)


def test_ways_are_the_same_on_one_thread_and_two() -> None:
    one, two = (trace(random_scene(4, 9_000), "count", LIMITS, legs=True, threads=threads) for threads in (1, 2))
    assert one.legs is not None
    assert two.legs is not None
    np.testing.assert_array_equal(one.legs, two.legs)


@pytest.mark.parametrize("mode", ["count", "power"])
def test_ways_carry_what_the_ledger_says(mode: Mode) -> None:
    scene = dataclasses.replace(random_scene(5, 500), monitors=())
    result = trace(scene, mode, LIMITS, legs=True)
    ended = dict.fromkeys(("detected", "escaped"), 0)
    for way in result.paths():
        if way.fate in ended:
            ended[way.fate] += 1
    assert ended["detected"] == sum(reading.rays for reading in result.detectors.values())
    if mode == "count":
        weights = sum(way.power for way in result.paths() if way.fate == "escaped")
        assert weights == pytest.approx(result.ledger.escaped, abs=1e-12)
