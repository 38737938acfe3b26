"""Threads, chunks, blocks, progress and interruption of the compiled engine."""

import dataclasses
import functools

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import Arc, Curve, Segment
from solen.errors import DesignError
from solen.plane import heading
from solen.scene import Fan, Interface, Monitor, Rays, Region, Scene
from solen.trace import Limits, Mode, Trace, trace, trace_reference
from solen.trace.engine import CHUNK
from solen.trace.kernel.buffers import BLOCK
from tests.agreement.bits_support import bits
from tests.agreement.random_scene_support import motley_scene
from tests.agreement.scenes_support import check_same_readings

REGIONS = (Region("air", 1.0), Region("glass", 1.5, 0.1))


def ball(rays: int, second: int = 0) -> Scene:
    interfaces = (
        Interface("ball", Arc.circle((0.0, 0.0), 1.0), "glass", "air"),
        Interface("eye", Segment((2.0, 2.0), (-2.0, 2.0)), "air", "air", "receiver", "eye"),
    )
    sources = [Fan((0.0, -2.0), 0.0, 50.0, rays)] + ([Fan((0.5, -2.0), 5.0, 50.0, second)] if second else [])
    return Scene(REGIONS, interfaces, tuple(sources), (Monitor("m", (-1.0, 0.1), (1.0, 0.1), 10),))


def same_bits(a: Trace, b: Trace) -> bool:
    """Return whether two results are equal to the last bit, except for their segments."""
    return bool(bits(dataclasses.replace(a, segments=None)) == bits(dataclasses.replace(b, segments=None)))


@pytest.mark.parametrize("mode", ["count", "power"])
def test_result_is_independent_of_threads(mode: Mode) -> None:
    scene = ball(2 * CHUNK + 17, CHUNK + 1)
    single = trace(scene, mode, Limits(min_weight=1e-3), threads=1)
    assert single.rays == 3 * CHUNK + 18
    for threads in (2, 5, None):
        assert same_bits(trace(scene, mode, Limits(min_weight=1e-3), threads=threads), single)


def test_segments_are_independent_of_threads() -> None:
    scene = ball(CHUNK + 50)
    single, two = trace(scene, segments=True, threads=1), trace(scene, segments=True, threads=2)
    assert single.segments is not None
    assert two.segments is not None
    assert np.array_equal(single.segments, two.segments)
    assert np.array_equal(np.unique(single.segments["ray"]), np.arange(CHUNK + 50))


def test_storing_segments_changes_no_reading() -> None:
    assert same_bits(trace(ball(300), "power", segments=True), trace(ball(300), "power"))


def test_more_segments_than_initially_allocated() -> None:
    """In a box of mirrors, each ray has more segments than are initially allocated."""
    sides = [((0.0, 0.0), (1.0, 0.0)), ((1.0, 0.0), (1.0, 1.0)), ((1.0, 1.0), (0.0, 1.0)), ((0.0, 1.0), (0.0, 0.0))]
    mirrors = tuple(Interface(f"s{i}", Segment(a, b), "air", "air", "mirror") for i, (a, b) in enumerate(sides))
    scene = Scene(REGIONS, mirrors, (Fan((0.3, 0.4), 0.0, 77.0, 3),))
    result = trace(scene, limits=Limits(max_hits=500), segments=True)
    assert result.segments is not None
    assert len(result.segments) == 1500
    assert [len(path.points_mm) for path in result.paths()] == [501] * 3


def test_progress_is_reported_after_every_chunk() -> None:
    """A chunk contains rays of one source, either those with even numbers or those with odd numbers."""
    reports: list[int] = []
    trace(ball(2 * CHUNK + 5, 7), progress=reports.append)
    even, odd = CHUNK + 3, CHUNK + 2
    assert reports == [CHUNK, even, even + CHUNK, even + odd, even + odd + 4, even + odd + 7]


@pytest.mark.parametrize("threads", [1, 2])
def test_trace_can_be_interrupted_between_chunks(threads: int) -> None:
    reports: list[int] = []

    def interrupt(rays: int) -> None:
        reports.append(rays)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        trace(ball(20 * CHUNK), threads=threads, progress=interrupt)
    assert reports == [CHUNK]


@dataclasses.dataclass(frozen=True)
class OtherCurve(Segment):
    """A curve that the compiled engine does not support."""


def test_refuses_unsupported_curve_that_the_reference_traces() -> None:
    curve: Curve = OtherCurve((-1.0, 0.0), (1.0, 0.0))
    scene = Scene(REGIONS, (Interface("i", curve, "air", "air", "absorbing"),), (Fan((0.0, -1.0), 0.0, 10.0, 3),))
    with pytest.raises(DesignError, match=r"OtherCurve.*Segment, Arc") as error:
        trace(scene)
    assert len(str(error.value).splitlines()) == 1
    assert trace_reference(scene).ledger.absorbed == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("threads", [-1, 0])
def test_refuses_invalid_number_of_threads(threads: int) -> None:
    with pytest.raises(DesignError, match=f"threads = {threads}; must be an integer"):
        trace(ball(CHUNK + 1), threads=threads)


RAY_COUNTS = [1, BLOCK - 1, BLOCK, BLOCK + 1, CHUNK - 1, CHUNK, CHUNK + 1]
"""Ray counts just below, at and just above the size of a block and of a chunk."""


def ball_with_rays(rays: int) -> Scene:
    """Return the ball under the first of a sequence of rays whose directions differ from ray to ray."""
    angles = 180.0 * np.modf(np.arange(rays) * 0.6180339887498949)[0] - 90.0
    source = Rays(((0.0, -2.0),) * rays, tuple(heading(float(angle)) for angle in angles), power=float(rays))
    return dataclasses.replace(ball(1), sources=(source,))


def by_ray(result: Trace, rays: int) -> FloatArray:
    """Return the powers of each ray by fate, its number of segments, and of hits on the ball and on the receiver."""
    assert result.segments is not None
    segments = result.segments
    table = np.zeros((rays, 8))
    ends = segments[segments["fate"] != 0]
    np.add.at(table, (ends["ray"], ends["fate"]), (ends["power_s"] + ends["power_p"]) * rays)
    table[:, 5] = np.bincount(segments["ray"], minlength=rays)
    for interface in (0, 1):
        table[:, 6 + interface] = np.bincount(segments["ray"][segments["interface"] == interface], minlength=rays)
    return table


@functools.cache
def reference_by_ray() -> FloatArray:
    return by_ray(trace_reference(ball_with_rays(max(RAY_COUNTS)), segments=True), max(RAY_COUNTS))


@functools.cache
def by_ray_in_small_traces() -> FloatArray:
    """Return the table for all rays in power mode, traced a hundred at a time."""
    scene = ball_with_rays(max(RAY_COUNTS))
    (source,) = scene.sources
    assert isinstance(source, Rays)
    tables = []
    for start in range(0, max(RAY_COUNTS), 100):
        part = slice(start, start + 100)
        rays = Rays(source.origins[part], source.directions[part], power=float(len(source.origins[part])))
        small = dataclasses.replace(scene, sources=(rays,), monitors=())
        tables.append(by_ray(trace(small, "power", Limits(min_weight=1e-3), segments=True), rays.rays))
    return np.vstack(tables)


@pytest.mark.parametrize("rays", RAY_COUNTS)
def test_rays_end_as_in_the_reference_for_all_block_sizes(rays: int) -> None:
    result = trace(ball_with_rays(rays), segments=True)
    assert by_ray(result, rays) == pytest.approx(reference_by_ray()[:rays], abs=1e-9)
    assert result.rays == rays
    assert result.undefined == 0
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert result.hits == by_ray(result, rays)[:, 6:].sum()


@pytest.mark.parametrize("rays", RAY_COUNTS)
def test_rays_split_as_in_small_traces_for_all_block_sizes(rays: int) -> None:
    result = trace(ball_with_rays(rays), "power", Limits(min_weight=1e-3), segments=True)
    assert by_ray(result, rays) == pytest.approx(by_ray_in_small_traces()[:rays], abs=1e-9)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    few = min(rays, 200)
    reference = trace_reference(ball_with_rays(few), "power", Limits(min_weight=1e-3), segments=True)
    assert by_ray(result, rays)[:few] == pytest.approx(by_ray(reference, few), abs=1e-9)


@pytest.mark.parametrize("mode", ["count", "power"])
def test_paths_agree_with_the_reference(mode: Mode) -> None:
    engine = trace(ball(40), mode, Limits(min_weight=1e-4), segments=True)
    reference = trace_reference(ball(40), mode, Limits(min_weight=1e-4), segments=True)
    assert len(engine.paths()) == len(reference.paths()) >= 40
    for path, expected in zip(engine.paths(), reference.paths(), strict=True):
        assert (path.ray, path.branch, path.parent) == (expected.ray, expected.branch, expected.parent)
        assert (path.interfaces, path.fate) == (expected.interfaces, expected.fate)
        assert path.points_mm == pytest.approx(expected.points_mm, abs=1e-9)
        assert path.power == pytest.approx(expected.power, abs=1e-12)
    assert engine.monitors["m"].power_by_bin == pytest.approx(reference.monitors["m"].power_by_bin, abs=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_counting_in_blocks_agrees_with_single_rays(seed: int) -> None:
    """In counting mode, surfaces are applied to blocks of rays; with angle bins, to single rays."""
    scene, limits = dataclasses.replace(motley_scene(seed, 300), monitors=()), Limits(max_hits=12)
    blocks, single = (trace(scene, "count", limits, angle_bins=bins) for bins in (0, 1))
    check_same_readings(blocks, single, 1e-12)
    assert blocks.hits == single.hits


@pytest.mark.parametrize("max_hits", [3, 20])
def test_surface_is_applied_once_to_each_ray_of_a_block(max_hits: int) -> None:
    """If some rays of a block are treated separately, the surface is not applied to the others twice."""
    corners = [(-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0)]
    walls = [Segment(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    mirrors = [Interface(f"wall-{i}", walls[i], "air", "air", "mirror") for i in (0, 1, 3)]
    lid = Interface("lid", walls[2], "air", "air", "receiver", "lid")
    glass = Interface("ball", Arc.circle((0.0, 0.0), 1.0), "glass", "air")
    scene = Scene(REGIONS, (*mirrors, lid, glass), (Fan((0.3, -2.0), 0.0, 85.0, 5001),))
    blocks, single = (trace(scene, "count", Limits(max_hits=max_hits), angle_bins=bins) for bins in (0, 1))
    assert blocks.ledger.escaped == 0.0
    check_same_readings(blocks, single, 1e-12)
