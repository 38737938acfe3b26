"""Sources: where their rays stand, that powers add up, and that chunks are the whole."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solen.scene import Beam, Fan, Launch, Rays, Source
from solen.scene.json import SOURCES

EVERY: dict[type[Source], Source] = {
    Fan: Fan((0.3, -1.0), 12.0, 95.0, 57, 2.5, 0.3),
    Beam: Beam((-1.0, -2.0), (1.5, -2.5), -5.0, 57, 0.7, 1.0),
    Rays: Rays(((0.0, 0.0), (1.0, 2.0), (3.0, -1.0)), ((0.0, 2.0), (3.0, 4.0), (-1.0, 0.0)), 3.0, 0.0),
}
every_source = pytest.mark.parametrize("source", EVERY.values(), ids=lambda source: type(source).__name__)


def columns(launch: Launch) -> list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    return [launch.x_mm, launch.z_mm, launch.dx, launch.dz, launch.power_s, launch.power_p]


def test_every_source_is_here() -> None:
    assert set(EVERY) == set(SOURCES.values())


@every_source
def test_powers_add_up_and_directions_are_unit(source: Source) -> None:
    launch = source.launch()
    assert len(launch) == source.rays
    assert math.fsum([*launch.power_s, *launch.power_p]) == pytest.approx(source.power, abs=1e-14)
    assert math.fsum(launch.power_s) == pytest.approx(source.power * source.s_share, abs=1e-14)
    assert np.ptp(launch.power_s + launch.power_p) < 1e-17
    assert np.hypot(launch.dx, launch.dz) == pytest.approx(1.0, abs=1e-15)


@every_source
@given(cuts=st.lists(st.integers(0, 57), max_size=5))
def test_chunks_are_the_whole(source: Source, cuts: list[int]) -> None:
    ends = sorted({0, source.rays, *(min(cut, source.rays) for cut in cuts)})
    chunks = [source.launch(start, stop) for start, stop in pairwise(ends)]
    for i, whole in enumerate(columns(source.launch())):
        assert np.array_equal(np.concatenate([columns(chunk)[i] for chunk in chunks]), whole)


def test_a_fan_stands_in_the_middle_of_equal_shares_from_right_to_left() -> None:
    launch = Fan((1.0, 2.0), 0.0, 120.0, 4).launch()
    angles = np.degrees(np.arctan2(-launch.dx, launch.dz))
    assert angles == pytest.approx([-45.0, -15.0, 15.0, 45.0], abs=1e-12)
    assert launch.dx[0] > 0
    assert set(launch.x_mm) == {1.0}
    assert set(launch.z_mm) == {2.0}


@given(rays=st.integers(1, 200), cone=st.floats(0.1, 360))
def test_a_fan_is_symmetric_about_its_axis(rays: int, cone: float) -> None:
    launch = Fan((0.0, 0.0), 0.0, cone, rays).launch()
    assert launch.dx == pytest.approx(-launch.dx[::-1], abs=1e-14)
    assert launch.dz == pytest.approx(launch.dz[::-1], abs=1e-14)
    widest = math.degrees(math.acos(min(1.0, launch.dz[0]))) if cone <= 180 else 0.0
    assert widest < cone / 2 + 1e-6


def test_a_fan_leans_with_its_axis() -> None:
    launch = Fan((0.0, 0.0), -3.0, 10.0, 1).launch()
    assert (launch.dx[0], launch.dz[0]) == pytest.approx((math.sin(math.radians(3)), math.cos(math.radians(3))))


def test_a_beam_is_parallel_and_evenly_spaced() -> None:
    launch = Beam((-1.0, 0.0), (1.0, 0.0), 0.0, 4).launch()
    assert launch.x_mm == pytest.approx([-0.75, -0.25, 0.25, 0.75])
    assert set(launch.dz) == {1.0}


def test_single_rays_keep_their_order_and_are_made_unit() -> None:
    launch = EVERY[Rays].launch(1, 2)
    assert (launch.x_mm[0], launch.z_mm[0], launch.dx[0], launch.dz[0]) == pytest.approx((1.0, 2.0, 0.6, 0.8))
