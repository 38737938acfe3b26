"""Uniform points: Sobol' nets compared with scipy's, their copies, and their integration error."""

import math

import numpy as np
import pytest
from scipy.stats import qmc

from solen.scene.sources.points import COPIES, DIGITS, MAX_DIMENSIONS, SCRAMBLED_DIGITS, copies, plain, points, sample


@pytest.mark.parametrize("dimensions", [3, 5, MAX_DIMENSIONS])
def test_net_equals_sobol_sequence_of_scipy(dimensions: int) -> None:
    """SciPy returns the same points in Gray-code order; the last of these numbers has three bytes."""
    index = np.arange(70_000)
    ours = plain(dimensions, DIGITS).at(index ^ (index >> 1)) * 2.0**-DIGITS
    assert np.array_equal(ours, qmc.Sobol(dimensions, scramble=False, bits=DIGITS).random(2**17)[: len(index)])


@pytest.mark.parametrize("dimensions", [1, 2, 4, MAX_DIMENSIONS])
def test_sample_is_identical_to_scipys(dimensions: int) -> None:
    """So a seed always gives the same points, whether drawn in parts or all at once."""
    ours, scipys = sample(dimensions, (7, 1, 5)), qmc.Sobol(dimensions, rng=np.random.default_rng((7, 1, 5)))
    expected = scipys.random(2**17)
    assert np.array_equal(ours(0, 2**17), expected)
    assert np.array_equal(np.vstack([ours(0, 1), ours(1, 700), ours(700, 1024)]), expected[:1024])
    assert 2**SCRAMBLED_DIGITS * 16 > 1e9, "more rays than a design may specify"


def test_large_numbers_have_distinct_points() -> None:
    """Ray 2^40 of a net has its own point, and the digits do not overflow."""
    large = plain(4, DIGITS).at(np.array([2**39, 2**39 + 1, 2**DIGITS - 1]))
    assert np.all((large > 0) & (large < 2**DIGITS))
    assert large[0, 0] == 2 ** (DIGITS - 40)
    assert len(np.unique(large[:, 1])) == 3


@pytest.mark.parametrize("dimensions", [3, 4, 5])
def test_each_copy_is_stratified_and_distinct(dimensions: int) -> None:
    """Of 2^k points, each of the 2^k equal intervals of every coordinate contains one, and all copies differ."""
    all_points = points(np.arange(COPIES * 256.0), COPIES * 256, dimensions)
    nets = [all_points[copy::COPIES] for copy in range(COPIES)]
    for net in nets:
        assert np.array_equal(np.sort((net * 256).astype(int), axis=0), np.tile(np.arange(256)[:, None], dimensions))
    assert len({tuple(net[0]) for net in nets}) == COPIES
    assert (copies(1), copies(2), copies(dimensions)) == (1, 1, COPIES)


@pytest.mark.parametrize("dimensions", [3, 4, 5])
def test_fraction_of_points_in_ball_is_its_volume(dimensions: int) -> None:
    """The discontinuity at its surface is not parallel to any axis; the error is relative to that of random points."""
    volume = math.pi ** (dimensions / 2.0) / math.gamma(dimensions / 2.0 + 1.0) * 0.45**dimensions
    deviations = []
    for count in (5000, 20_000, 65_536, 100_000):
        inside = np.sum((points(np.arange(float(count)), count, dimensions) - 0.5) ** 2, axis=1) < 0.45**2
        deviations.append((np.mean(inside) - volume) * math.sqrt(count / (volume * (1.0 - volume))))
    assert math.sqrt(np.mean(np.square(deviations))) < 0.5
