"""Evenly spread points: Sobol' nets against another program's, their copies, and how well they add up."""

import math

import numpy as np
import pytest
from scipy.stats import qmc

from solen.scene.sources.points import COPIES, DIGITS, MAX_DIMENSIONS, SCRAMBLED_DIGITS, copies, plain, points, sample


@pytest.mark.parametrize("dimensions", [3, 5, MAX_DIMENSIONS])
def test_a_net_is_the_sequence_of_sobol(dimensions: int) -> None:
    """SciPy numbers the same points in the order of a Gray code; the last of these needs three bytes."""
    index = np.arange(70_000)
    mine = plain(dimensions, DIGITS).at(index ^ (index >> 1)) * 2.0**-DIGITS
    assert np.array_equal(mine, qmc.Sobol(dimensions, scramble=False, bits=DIGITS).random(2**17)[: len(index)])


@pytest.mark.parametrize("dimensions", [1, 2, 4, MAX_DIMENSIONS])
def test_a_sample_is_scipy_s_to_the_last_bit(dimensions: int) -> None:
    """So it was drawn, and so a seed keeps its meaning; in stretches as in one."""
    mine, theirs = sample(dimensions, (7, 1, 5)), qmc.Sobol(dimensions, rng=np.random.default_rng((7, 1, 5)))
    whole = theirs.random(2**17)
    assert np.array_equal(mine(0, 2**17), whole)
    assert np.array_equal(np.vstack([mine(0, 1), mine(1, 700), mine(700, 1024)]), whole[:1024])
    assert 2**SCRAMBLED_DIGITS * 16 > 1e9, "more rays than a design may ask for"


def test_far_numbers_have_points_too() -> None:
    """Ray 2^40 of a net is its own point, and no number of digits runs over."""
    far = plain(4, DIGITS).at(np.array([2**39, 2**39 + 1, 2**DIGITS - 1]))
    assert np.all((far > 0) & (far < 2**DIGITS))
    assert far[0, 0] == 2 ** (DIGITS - 40)
    assert len(np.unique(far[:, 1])) == 3


@pytest.mark.parametrize("dimensions", [3, 4, 5])
def test_each_copy_is_a_net_of_its_own(dimensions: int) -> None:
    """Of 2^k points each of the 2^k equal parts of every coordinate holds one, and no two copies are alike."""
    all_points = points(np.arange(COPIES * 256.0), COPIES * 256, dimensions)
    parts = [all_points[copy::COPIES] for copy in range(COPIES)]
    for part in parts:
        assert np.array_equal(np.sort((part * 256).astype(int), axis=0), np.tile(np.arange(256)[:, None], dimensions))
    assert len({tuple(part[0]) for part in parts}) == COPIES
    assert (copies(1), copies(2), copies(dimensions)) == (1, 1, COPIES)


@pytest.mark.parametrize("dimensions", [3, 4, 5])
def test_a_ball_holds_its_share_of_the_points(dimensions: int) -> None:
    """Its jump runs along no axis; in units of the standard error of as many random points."""
    volume = math.pi ** (dimensions / 2.0) / math.gamma(dimensions / 2.0 + 1.0) * 0.45**dimensions
    off = []
    for many in (5000, 20_000, 65_536, 100_000):
        inside = np.sum((points(np.arange(float(many)), many, dimensions) - 0.5) ** 2, axis=1) < 0.45**2
        off.append((np.mean(inside) - volume) * math.sqrt(many / (volume * (1.0 - volume))))
    assert math.sqrt(np.mean(np.square(off))) < 0.5
