"""Sources: positions and powers of their rays, which are the same whether launched together or individually."""

import dataclasses
import math
import tempfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from solen.arrays import FloatArray, IntArray
from solen.plane import heading
from solen.scene import Ambient, Beam, Chip, CosinePower, Emitter, Fan, Launch, RayFile, Rays, Source
from solen.scene.json import SOURCES
from solen.scene.sources.points import COPIES
from tests.scene.rayfile_support import lambertian, zemax

FILE = zemax(Path(tempfile.mkdtemp()) / "rays.sdf", lambertian(57))
EVERY: dict[type[Source], Source] = {
    Fan: Fan((0.3, -1.0), 12.0, 95.0, 57, power=2.5, s_share=0.3),
    Chip: Chip((0.3, -1.0), 0.4, 12.0, 95.0, 57, power=2.5, s_share=0.3),
    Emitter: Emitter((0.3, -1.0), 12.0, 57, CosinePower(2.5), 95.0, 0.4, 0.2, 0.1, power=2.5, s_share=0.3),
    Beam: Beam((-1.0, -2.0), (1.5, -2.5), -5.0, 57, power=0.7, s_share=1.0),
    Ambient: Ambient((0.3, -1.0), 4.0, 57, 0.5, power=2.5, s_share=0.3),
    RayFile: RayFile(str(FILE), (0.3, -1.0), 12.0, 57, 0.1, power=2.5, s_share=0.3),
    Rays: Rays(((0.0, 0.0), (1.0, 2.0), (3.0, -1.0)), ((0.0, 2.0), (3.0, 4.0), (-1.0, 0.0)), power=3.0, s_share=0.0),
}
every_source = pytest.mark.parametrize("source", EVERY.values(), ids=lambda source: type(source).__name__)


SPECTRUM = ((850.0, 1.0), (620.0, 2.5), (940.0, 0.5))
COLOURED = [source.with_spectrum(SPECTRUM) for source in EVERY.values()]
every_coloured = pytest.mark.parametrize(
    "source", [*EVERY.values(), *COLOURED], ids=lambda source: f"{type(source).__name__}-{len(source.spectrum)}"
)


def columns(launch: Launch) -> list[FloatArray | IntArray]:
    return [column for field in dataclasses.fields(launch) if (column := getattr(launch, field.name)) is not None]


def angles_deg(launch: Launch) -> FloatArray:
    """Directions, counter-clockwise from +z."""
    return np.degrees(np.arctan2(-launch.dx, launch.dz))


def test_sources_cover_every_class() -> None:
    assert set(EVERY) == set(SOURCES.values())


@every_coloured
def test_powers_add_up_and_directions_are_unit(source: Source) -> None:
    launch = source.launch()
    assert len(launch) == source.rays
    assert math.fsum([*launch.power_s, *launch.power_p]) == pytest.approx(source.power, abs=1e-14)
    assert math.fsum(launch.power_s) == pytest.approx(source.power * source.s_share, abs=1e-14)
    assert np.ptp(launch.power_s + launch.power_p) < 1e-17
    assert np.hypot(launch.dx, launch.dz) == pytest.approx(1.0, abs=1e-15)


@every_coloured
@given(cuts=st.lists(st.integers(0, 57), max_size=5))
def test_chunks_together_equal_complete_launch(source: Source, cuts: list[int]) -> None:
    ends = sorted({0, source.rays, *(min(cut, source.rays) for cut in cuts)})
    chunks = [source.launch(np.arange(start, stop, dtype=float)) for start, stop in pairwise(ends)]
    for i, complete in enumerate(columns(source.launch())):
        assert np.array_equal(np.concatenate([columns(chunk)[i] for chunk in chunks]), complete)


@every_coloured
@given(numbers=st.lists(st.integers(0, 56), max_size=20))
def test_rays_by_number_equal_those_of_complete_launch(source: Source, numbers: list[int]) -> None:
    indices = np.array([number % source.rays for number in numbers], dtype=int)
    alone = source.launch(indices.astype(float))
    for column, complete in zip(columns(alone), columns(source.launch()), strict=True):
        assert np.array_equal(column, complete[indices])


@every_coloured
@pytest.mark.parametrize("in_space", [False, True])
def test_rays_by_number_equal_rays_at_even_points(source: Source, in_space: bool) -> None:
    """With up to two coordinates the first follows the midpoint rule, so a spectrum does not change a fan."""
    u = source.even_points(np.arange(source.rays, dtype=float), in_space)
    assert u.shape == (source.rays, source.dimensions(in_space))
    assert np.all((u >= 0.0) & (u < 1.0))
    assert source.copies(in_space) == (1 if source.dimensions(in_space) < 3 else COPIES)
    if source.copies(in_space) == 1:
        assert u[:, 0] == pytest.approx((np.arange(source.rays) + 0.5) / source.rays, abs=1e-15)
    launched, complete = source.launch_at(u, source.rays, in_space), source.launch(in_space=in_space)
    for column, same in zip(columns(launched), columns(complete), strict=True):
        assert np.array_equal(column, same)


@every_coloured
def test_ray_carries_power_divided_by_number_of_rays(source: Source) -> None:
    launch = source.launch_at(np.full((3, source.dimensions()), 0.25), 500)
    assert launch.power_s + launch.power_p == pytest.approx([source.power / 500] * 3, rel=1e-15)
    assert launch.power_s == pytest.approx([source.s_share * source.power / 500] * 3, rel=1e-15)


def test_fan_follows_midpoint_rule_from_right_to_left() -> None:
    launch = Fan((1.0, 2.0), 0.0, 120.0, 4).launch()
    angles = np.degrees(np.arctan2(-launch.dx, launch.dz))
    assert angles == pytest.approx([-45.0, -15.0, 15.0, 45.0], abs=1e-12)
    assert launch.dx[0] > 0
    assert set(launch.x_mm) == {1.0}
    assert set(launch.z_mm) == {2.0}


@given(rays=st.integers(1, 200), cone=st.floats(0.1, 360))
def test_fan_is_symmetric_about_axis(rays: int, cone: float) -> None:
    launch = Fan((0.0, 0.0), 0.0, cone, rays).launch()
    assert launch.dx == pytest.approx(-launch.dx[::-1], abs=1e-14)
    assert launch.dz == pytest.approx(launch.dz[::-1], abs=1e-14)
    widest = math.degrees(math.acos(min(1.0, launch.dz[0]))) if cone <= 180 else 0.0
    assert widest < cone / 2 + 1e-6


def test_fan_follows_axis() -> None:
    launch = Fan((0.0, 0.0), -3.0, 10.0, 1).launch()
    assert (launch.dx[0], launch.dz[0]) == pytest.approx((math.sin(math.radians(3)), math.cos(math.radians(3))))


def test_beam_is_parallel_and_evenly_spaced() -> None:
    launch = Beam((-1.0, 0.0), (1.0, 0.0), 0.0, 4).launch()
    assert launch.x_mm == pytest.approx([-0.75, -0.25, 0.25, 0.75])
    assert set(launch.dz) == {1.0}


def test_single_rays_keep_order_and_are_normalised() -> None:
    launch = EVERY[Rays].launch(np.array([1.0]))
    assert len(launch) == 1
    assert (launch.x_mm[0], launch.z_mm[0], launch.dx[0], launch.dz[0]) == pytest.approx((1.0, 2.0, 0.6, 0.8))


def test_single_rays_are_selected_uniformly() -> None:
    """Uniform points of the cube select each ray equally often."""
    source = EVERY[Rays]
    launch = source.launch_at(np.linspace(0.0, 1.0, 3000, endpoint=False)[:, None], 3000)
    assert [int(np.sum(launch.x_mm == x)) for x in (0.0, 1.0, 3.0)] == [1000] * 3


def test_chip_is_line_across_axis_from_right_to_left() -> None:
    """The corners of the unit square of angle and position; both run from right to left as seen along the axis."""
    corners = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0], [0.5, 0.5]])
    launch = Chip((1.0, 2.0), 0.6, 0.0, 80.0, 1).launch_at(corners, 5)
    assert launch.x_mm == pytest.approx([1.3, 0.7, 1.3, 0.7, 1.0], abs=1e-15)
    assert launch.z_mm == pytest.approx(2.0, abs=1e-15)
    assert angles_deg(launch) == pytest.approx([-40.0, -40.0, 40.0, 40.0, 0.0], abs=1e-12)


@given(axis=st.floats(-360, 360), width=st.floats(0, 10), cone=st.floats(0, 360))
def test_chip_turns_with_axis(axis: float, width: float, cone: float) -> None:
    launch = Chip((0.3, -0.7), width, axis, cone, 37).launch()
    (ux, uz), (nx, nz) = heading(axis), heading(axis + 90.0)
    x, z = launch.x_mm - 0.3, launch.z_mm + 0.7
    assert x * ux + z * uz == pytest.approx(0.0, abs=1e-14)
    assert np.all(np.abs(x * nx + z * nz) <= width / 2 + 1e-14)
    off = np.degrees(np.arctan2(launch.dx * nx + launch.dz * nz, launch.dx * ux + launch.dz * uz))
    assert np.all(np.abs(off) <= cone / 2 + 1e-9)


def test_chip_without_width_is_fan() -> None:
    fan = Fan((0.3, -0.7), 11.0, 77.0, 41, power=2.0, s_share=0.1)
    chip = Chip(fan.point, 0.0, fan.axis_deg, fan.cone_deg, fan.rays, power=fan.power, s_share=fan.s_share)
    for column, same in zip(columns(chip.launch()), columns(fan.launch()), strict=True):
        assert np.array_equal(column, same)


@pytest.mark.parametrize("rays", [1000, 4096, 30_000])
def test_chip_rays_are_uniform_in_angle_and_position(rays: int) -> None:
    """The number of rays in a corner of the square of angle and position is proportional to its area.

    The error of a golden-ratio lattice is about ln(N)/4 rays; that of independent rays would be about √N.
    """
    launch = Chip((0.0, 0.0), 2.0, 0.0, 90.0, rays).launch()
    shares = np.column_stack([(angles_deg(launch) + 45.0) / 90.0, (1.0 - launch.x_mm) / 2.0])
    for column in shares.T:
        assert stats.kstest(column, "uniform").statistic <= 4.0 / rays
    for a in np.linspace(0.1, 1.0, 10):
        for b in np.linspace(0.1, 1.0, 10):
            assert np.mean((shares[:, 0] < a) & (shares[:, 1] < b)) == pytest.approx(a * b, abs=4.0 / rays)


def test_mean_over_chip_equals_integral() -> None:
    """cos θ e^x over width 1.2 and ±50°: the product of 2 sin(50°)/100° and of 2 sinh(0.6)/1.2."""
    launch = Chip((0.0, 0.0), 1.2, 0.0, 100.0, 2**14).launch()
    exact = 2.0 * math.sin(math.radians(50.0)) / math.radians(100.0) * 2.0 * math.sinh(0.6) / 1.2
    assert np.mean(launch.dz * np.exp(launch.x_mm)) == pytest.approx(exact, abs=2.0 / 2**14)  # two of 2^14 rays


@every_source
def test_spectral_lines_are_drawn_by_weight(source: Source) -> None:
    """With N points uniform in the last coordinate, each line has its fraction of the rays."""
    coloured = source.with_spectrum(SPECTRUM)
    assert coloured.dimensions() == source.dimensions() + 1
    u = np.full((4000, coloured.dimensions()), 0.5)
    u[:, -1] = (np.arange(4000) + 0.5) / 4000
    line = coloured.launch_at(u, 4000).line
    assert line.dtype == np.int64
    assert np.all(np.diff(line) >= 0)
    assert np.bincount(line).tolist() == [1000, 2500, 500]


@every_source
def test_single_line_needs_no_coordinate(source: Source) -> None:
    for spectrum in ((), ((860.0, 7.0),)):
        other = source.with_spectrum(spectrum)
        assert other.dimensions() == source.dimensions()
        assert not np.any(other.launch().line)
        for column, same in zip(columns(other.launch()), columns(source.launch()), strict=True):
            assert np.array_equal(column, same)


@pytest.mark.parametrize(
    ("make", "position"),
    [
        (
            lambda rays: Fan((0.0, 0.0), 0.0, 90.0, rays, spectrum=SPECTRUM),
            lambda launch: angles_deg(launch) / 90.0 + 0.5,
        ),
        (lambda rays: Beam((0.0, 0.0), (1.0, 0.0), 0.0, rays, spectrum=SPECTRUM), lambda launch: launch.x_mm),
        (lambda rays: Chip((0.5, 0.0), 1.0, 0.0, 90.0, rays, spectrum=SPECTRUM), lambda launch: 1.0 - launch.x_mm),
    ],
    ids=["fan", "beam", "chip"],
)
def test_spectral_line_is_independent_of_position(
    make: Callable[[int], Source], position: Callable[[Launch], FloatArray]
) -> None:
    """In any part of the source, the fraction of rays of each line is its weight, to within a few rays."""
    rays = 8192
    launch = make(rays).launch()
    for index, (_, weight) in enumerate(SPECTRUM):
        for fraction in np.linspace(0.05, 1.0, 20):
            observed = np.mean((launch.line == index) & (position(launch) < fraction))
            assert observed == pytest.approx(weight / 4.0 * fraction, abs=6.0 / rays)


@every_coloured
def test_planar_source_stays_in_plane_in_space(source: Source) -> None:
    flat, deep = source.launch(), source.launch(in_space=True)
    assert flat.y_mm is None
    assert flat.dy is None
    assert deep.y_mm is not None
    assert deep.dy is not None
    if type(source).place_in_space is not Source.place_in_space:  # the source extends in space
        np.testing.assert_allclose(deep.dx**2 + deep.dy**2 + deep.dz**2, 1.0, atol=1e-12)
        return
    assert not np.any(deep.y_mm)
    assert not np.any(deep.dy)
    for name in ("x_mm", "z_mm", "dx", "dz", "power_s", "power_p", "line"):
        assert np.array_equal(getattr(flat, name), getattr(deep, name))


@every_source
def test_source_can_be_given_other_number_of_rays(source: Source) -> None:
    more = source.with_rays(101)
    assert more.rays == (source.rays if isinstance(source, Rays) else 101)
    assert more.with_rays(source.rays) == source
