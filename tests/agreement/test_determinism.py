"""Results depend neither on the number of threads nor on whether segments are stored."""

import dataclasses

import numpy as np
import pytest

from solen.scene import Scene
from solen.trace import Limits, Mode, Trace, trace
from tests.agreement.bits_support import bits
from tests.agreement.random_scene_support import random_scene

LIMITS = Limits(min_weight=1e-3, max_hits=100)


def check_same_bits(a: Trace, b: Trace) -> None:
    assert bits(dataclasses.replace(a, segments=None)) == bits(dataclasses.replace(b, segments=None))


def several_chunks(seed: int) -> Scene:
    """Return a random scene in which each source has more rays than one chunk."""
    return random_scene(seed, 9_000)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("mode", ["count", "power"])
def test_result_is_independent_of_threads(mode: Mode, seed: int) -> None:
    single = trace(several_chunks(seed), mode, LIMITS, threads=1)
    for threads in (2, 3, None):
        check_same_bits(single, trace(several_chunks(seed), mode, LIMITS, threads=threads))


@pytest.mark.parametrize("mode", ["count", "power"])
def test_storing_segments_does_not_change_the_result(mode: Mode) -> None:
    scene = random_scene(3, 3_000)
    without, stored = trace(scene, mode, LIMITS), trace(scene, mode, LIMITS, segments=True)
    check_same_bits(without, stored)
    assert stored.segments is not None
    assert without.paths() == []
    assert int(np.sum(stored.segments["interface"] >= 0)) == stored.hits


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("mode", ["count", "power"])
def test_rays_in_blocks_end_like_single_rays(mode: Mode, seed: int) -> None:
    """Rays whose segments are stored are traced one by one."""
    scene = dataclasses.replace(random_scene(seed, 3_000), monitors=())
    block, single = trace(scene, mode, LIMITS), trace(scene, mode, LIMITS, segments=True)
    assert (block.hits, block.truncated) == (single.hits, single.truncated)
    assert block.undefined == single.undefined
    for name, reading in block.detectors.items():
        expected = single.detectors[name]
        assert reading.rays == expected.rays
        assert reading.power == pytest.approx(expected.power, rel=1e-12, abs=1e-14)
        assert reading.optical_path_mm == pytest.approx(expected.optical_path_mm, rel=1e-9, nan_ok=True)
    for fate in ("detected", "escaped", "absorbed", "truncated"):
        assert getattr(block.ledger, fate) == pytest.approx(getattr(single.ledger, fate), abs=1e-10)


def test_segments_are_independent_of_threads() -> None:
    single, two = (trace(random_scene(4, 9_000), "count", LIMITS, segments=True, threads=threads) for threads in (1, 2))
    assert single.segments is not None
    assert two.segments is not None
    np.testing.assert_array_equal(single.segments, two.segments)


@pytest.mark.parametrize("mode", ["count", "power"])
def test_paths_agree_with_the_ledger(mode: Mode) -> None:
    scene = dataclasses.replace(random_scene(5, 500), monitors=())
    result = trace(scene, mode, LIMITS, segments=True)
    paths = result.paths()
    detected = sum(path.fate == "detected" for path in paths)
    assert detected == sum(reading.rays for reading in result.detectors.values())
    if mode == "count":
        escaped = sum(path.power for path in paths if path.fate == "escaped")
        assert escaped == pytest.approx(result.ledger.escaped, abs=1e-12)
