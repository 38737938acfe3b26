"""What the compiled engine adds: threads, chunks, progress, interruption, and a limit on what it knows."""

import dataclasses
import functools

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import Arc, Curve, Segment
from solen.errors import DesignError
from solen.plane import heading
from solen.scene import Fan, Interface, Monitor, Rays, Region, Scene
from solen.trace import Limits, Trace, trace, trace_reference
from solen.trace.engine import CHUNK
from solen.trace.kernel.buffers import BLOCK
from tests.agreement.bits_support import bits
from tests.agreement.random_scene_support import motley_scene
from tests.agreement.scenes_support import same_readings

REGIONS = (Region("air", 1.0), Region("glass", 1.5, 0.1))


def ball(rays: int, second: int = 0) -> Scene:
    interfaces = (
        Interface("ball", Arc.circle((0.0, 0.0), 1.0), "glass", "air"),
        Interface("eye", Segment((2.0, 2.0), (-2.0, 2.0)), "air", "air", "receiver", "eye"),
    )
    sources = [Fan((0.0, -2.0), 0.0, 50.0, rays)] + ([Fan((0.5, -2.0), 5.0, 50.0, second)] if second else [])
    return Scene(REGIONS, interfaces, tuple(sources), (Monitor("m", (-1.0, 0.1), (1.0, 0.1), 10),))


def same(a: Trace, b: Trace) -> bool:
    """Whether two results are equal to the last bit, but for the legs that they keep."""
    return bool(bits(dataclasses.replace(a, legs=None)) == bits(dataclasses.replace(b, legs=None)))


@pytest.mark.parametrize("mode", ["count", "power"])
def test_the_number_of_threads_changes_no_bit(mode: str) -> None:
    made = ball(2 * CHUNK + 17, CHUNK + 1)
    one = trace(made, mode, Limits(min_weight=1e-3), threads=1)  # type: ignore[arg-type]
    assert one.rays == 3 * CHUNK + 18
    for threads in (2, 5, None):
        assert same(trace(made, mode, Limits(min_weight=1e-3), threads=threads), one)  # type: ignore[arg-type]


def test_legs_are_the_same_whatever_the_threads() -> None:
    made = ball(CHUNK + 50)
    one, two = trace(made, legs=True, threads=1), trace(made, legs=True, threads=2)
    assert one.legs is not None
    assert two.legs is not None
    assert np.array_equal(one.legs, two.legs)
    assert np.array_equal(np.unique(one.legs["ray"]), np.arange(CHUNK + 50))


def test_keeping_legs_changes_no_reading() -> None:
    assert same(trace(ball(300), "power", legs=True), trace(ball(300), "power"))


def test_legs_beyond_the_first_guess_are_all_kept() -> None:
    """A mirror box gives each ray more stretches than the room first set aside."""
    sides = [((0.0, 0.0), (1.0, 0.0)), ((1.0, 0.0), (1.0, 1.0)), ((1.0, 1.0), (0.0, 1.0)), ((0.0, 1.0), (0.0, 0.0))]
    mirrors = tuple(Interface(f"s{i}", Segment(a, b), "air", "air", "mirror") for i, (a, b) in enumerate(sides))
    made = Scene(REGIONS, mirrors, (Fan((0.3, 0.4), 0.0, 77.0, 3),))
    result = trace(made, limits=Limits(max_hits=500), legs=True)
    assert result.legs is not None
    assert len(result.legs) == 1500
    assert [len(path.points_mm) for path in result.paths()] == [501] * 3


def test_progress_is_reported_after_every_chunk() -> None:
    """Chunks are of one source, and of one half of its fan: the rays of even numbers, then those of odd ones."""
    told: list[int] = []
    trace(ball(2 * CHUNK + 5, 7), progress=told.append)
    even, odd = CHUNK + 3, CHUNK + 2
    halves = [CHUNK, even, even + CHUNK, even + odd, even + odd + 4, even + odd + 7]
    assert told == halves
    assert halves[-1] == 2 * CHUNK + 12


@pytest.mark.parametrize("threads", [1, 2])
def test_a_trace_can_be_interrupted_between_chunks(threads: int) -> None:
    told: list[int] = []

    def interrupt(done: int) -> None:
        told.append(done)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        trace(ball(20 * CHUNK), threads=threads, progress=interrupt)
    assert told == [CHUNK]


@dataclasses.dataclass(frozen=True)
class Bent(Segment):
    """A curve of somebody's own."""


def test_a_curve_it_does_not_know_is_refused_and_the_reference_takes_it() -> None:
    curve: Curve = Bent((-1.0, 0.0), (1.0, 0.0))
    made = Scene(REGIONS, (Interface("i", curve, "air", "air", "absorbing"),), (Fan((0.0, -1.0), 0.0, 10.0, 3),))
    with pytest.raises(DesignError, match="curve Bent; must be one of Segment, Arc") as refusal:
        trace(made)
    assert len(str(refusal.value).splitlines()) == 1
    assert trace_reference(made).ledger.absorbed == pytest.approx(1.0, abs=1e-15)


def test_a_negative_number_of_threads_is_refused() -> None:
    for threads in (-1, 0):
        with pytest.raises(DesignError, match=f"threads = {threads}; must be an integer"):
            trace(ball(CHUNK + 1), threads=threads)


EDGES = [1, BLOCK - 1, BLOCK, BLOCK + 1, CHUNK - 1, CHUNK, CHUNK + 1]
"""Ray counts at which a block or a chunk is just not full, full, and one too many."""


def first_of_many(rays: int) -> Scene:
    """The ball and its receiver under the first rays of one list, whose neighbours in it differ."""
    turn = 180.0 * np.modf(np.arange(rays) * 0.6180339887498949)[0] - 90.0
    source = Rays(((0.0, -2.0),) * rays, tuple(heading(float(angle)) for angle in turn), power=float(rays))
    made = ball(1)
    return Scene(made.regions, made.interfaces, (source,), made.monitors)


def by_ray(result: Trace, rays: int) -> FloatArray:
    """Of each ray: power by fate, stretches, and hits of the ball and of the receiver; times the emitted power."""
    assert result.legs is not None
    legs = result.legs
    table = np.zeros((rays, 8))
    ends = legs[legs["fate"] != 0]
    np.add.at(table, (ends["ray"], ends["fate"]), (ends["power_s"] + ends["power_p"]) * rays)
    table[:, 5] = np.bincount(legs["ray"], minlength=rays)
    for interface in (0, 1):
        table[:, 6 + interface] = np.bincount(legs["ray"][legs["interface"] == interface], minlength=rays)
    return table


@functools.cache
def reference_by_ray() -> FloatArray:
    return by_ray(trace_reference(first_of_many(max(EDGES)), legs=True), max(EDGES))


@functools.cache
def engine_by_ray_in_small_pieces() -> FloatArray:
    """Fates of power of all the rays, traced a hundred at a time."""
    made = first_of_many(max(EDGES))
    (source,) = made.sources
    assert isinstance(source, Rays)
    pieces = []
    for start in range(0, max(EDGES), 100):
        part = slice(start, start + 100)
        rays = Rays(source.origins[part], source.directions[part], power=float(len(source.origins[part])))
        result = trace(Scene(made.regions, made.interfaces, (rays,)), "power", Limits(min_weight=1e-3), legs=True)
        pieces.append(by_ray(result, rays.rays))
    return np.vstack(pieces)


@pytest.mark.parametrize("rays", EDGES)
def test_every_ray_ends_as_in_the_reference_however_full_the_blocks_are(rays: int) -> None:
    result = trace(first_of_many(rays), legs=True)
    assert by_ray(result, rays) == pytest.approx(reference_by_ray()[:rays], abs=1e-9)
    assert result.rays == rays
    assert result.undefined == 0
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert result.hits == by_ray(result, rays)[:, 6:].sum()


@pytest.mark.parametrize("rays", EDGES)
def test_every_ray_splits_as_in_a_smaller_trace_however_full_the_blocks_are(rays: int) -> None:
    result = trace(first_of_many(rays), "power", Limits(min_weight=1e-3), legs=True)
    assert by_ray(result, rays) == pytest.approx(engine_by_ray_in_small_pieces()[:rays], abs=1e-9)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    small = min(rays, BLOCK + 1)
    truth = trace_reference(first_of_many(small), "power", Limits(min_weight=1e-3), legs=True)
    assert by_ray(result, rays)[:small] == pytest.approx(by_ray(truth, small), abs=1e-9)


@pytest.mark.parametrize("mode", ["count", "power"])
def test_it_gives_the_references_paths(mode: str) -> None:
    engine = trace(ball(40), mode, Limits(min_weight=1e-4), legs=True)  # type: ignore[arg-type]
    truth = trace_reference(ball(40), mode, Limits(min_weight=1e-4), legs=True)  # type: ignore[arg-type]
    assert len(engine.paths()) == len(truth.paths()) >= 40
    for mine, its in zip(engine.paths(), truth.paths(), strict=True):
        assert (mine.ray, mine.branch, mine.parent) == (its.ray, its.branch, its.parent)
        assert (mine.interfaces, mine.fate) == (its.interfaces, its.fate)
        assert mine.points_mm == pytest.approx(its.points_mm, abs=1e-9)
        assert mine.power == pytest.approx(its.power, abs=1e-12)
    assert engine.monitors["m"].power_by_bin == pytest.approx(truth.monitors["m"].power_by_bin, abs=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_counting_side_by_side_is_counting_ray_by_ray(seed: int) -> None:
    """Rays that are counted are taken through surfaces in blocks; where angles are asked for, one by one."""
    scene, limits = dataclasses.replace(motley_scene(seed, 300), monitors=()), Limits(max_hits=12)
    together, apart = (trace(scene, "count", limits, angle_bins=bins) for bins in (0, 1))
    same_readings(together, apart, 1e-12)
    assert together.hits == apart.hits


@pytest.mark.parametrize("max_hits", [3, 20])
def test_no_ray_passes_one_surface_twice(max_hits: int) -> None:
    """Rays that a block leaves aside at a surface do not send the others through it again: nothing leaves the box."""
    corners = [(-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0)]
    walls = [Segment(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    mirrors = [Interface(f"wall-{i}", walls[i], "air", "air", "mirror") for i in (0, 1, 3)]
    lid = Interface("lid", walls[2], "air", "air", "receiver", "lid")
    glass = Interface("ball", Arc.circle((0.0, 0.0), 1.0), "glass", "air")
    scene = Scene(REGIONS, (*mirrors, lid, glass), (Fan((0.3, -2.0), 0.0, 85.0, 5001),))
    together = trace(scene, "count", Limits(max_hits=max_hits))
    apart = trace(scene, "count", Limits(max_hits=max_hits), angle_bins=1)
    assert together.ledger.escaped == 0.0
    same_readings(together, apart, 1e-12)
