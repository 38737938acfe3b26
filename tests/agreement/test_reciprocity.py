"""Reciprocity, for single rays and between two extended emitters.

By Snell's and Fresnel's laws the transmittance of a path between two points, in either polarisation, is the same in
both directions. For two lines in one medium that emit uniformly in the sine of the angle (and thus in étendue), the
étendue times the fraction that arrives at the other line is therefore the same in both directions.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import Arc, CartesianOval, Conic, Curve, Segment, Spline
from solen.plane import Point, along, left_of, minus, unit
from solen.scene import Interface, Rays, Region, Scene
from solen.scene.sources import Placed, Source
from solen.trace import Limits, Trace, trace, trace_reference
from solen.trace.result import DETECTED
from tests.agreement.compare_support import Key, segments_by_key
from tests.agreement.random_scene_support import many_bodies, motley_scene
from tests.agreement.scenes_support import AIR, glass

Tracer = Callable[..., Trace]
FORWARD, REVERSE = Limits(min_weight=3e-4, max_hits=14), Limits(min_weight=1e-5, max_hits=30)
START_MM = 1e-6
"""Distance from the receiver at which a path is reversed, at most half the length of the last segment."""
MAX_MISS_MM = 1e-7
"""Maximum distance between the start of a path and the reversed path; rounding errors grow at every interface."""


@dataclass(frozen=True)
class PathToSegment:
    """The path from the launch of a ray to the end of one of its segments, with the transmittances of s and p."""

    interfaces: tuple[int, ...]
    start: Point
    direction: Point
    end: Point
    end_direction: Point
    last_length_mm: float
    s: float
    p: float


def paths_by_ray(result: Trace) -> dict[int, list[PathToSegment]]:
    """Return the paths to all segments, keyed by ray."""
    assert result.segments is not None
    segments = dict(zip(segments_by_key(result), result.segments, strict=True))
    paths: dict[int, list[PathToSegment]] = {}
    for key, last in segments.items():
        chain = [last]
        current = key
        while current[-1] > 0:
            current = previous(current, segments)
            chain.insert(0, segments[current])
        first = chain[0]
        paths.setdefault(key[0], []).append(
            PathToSegment(
                tuple(int(segment["interface"]) for segment in chain),
                (float(first["x_mm"]), float(first["z_mm"])),
                (float(first["dx"]), float(first["dz"])),
                _end(last),
                (float(last["dx"]), float(last["dz"])),
                min(float(last["length_mm"]), 1e6),
                float(last["power_s"] * last["kept"] / first["power_s"]) if first["power_s"] > 0 else 0.0,
                float(last["power_p"] * last["kept"] / first["power_p"]) if first["power_p"] > 0 else 0.0,
            )
        )
    return paths


def previous(key: Key, segments: dict[Key, np.void]) -> Key:
    """Return the key of the previous segment of a branch, or of the branch from which it was split off."""
    branch, hit = key[:-1], key[-1] - 1
    return branch if len(branch) > 1 and branch[-1] == hit and branch in segments else (*branch, hit)


def detected_paths(result: Trace) -> list[PathToSegment]:
    """Return paths that end on a receiver after at least one other interface."""
    assert result.segments is not None
    paths = [path for _, group in sorted(paths_by_ray(result).items()) for path in group]
    assert len(paths) == len(result.segments)
    detected = np.flatnonzero(result.segments["fate"] == DETECTED).tolist()
    return [paths[i] for i in detected if len(paths[i].interfaces) > 1]


def miss_mm(path: PathToSegment, reverse: PathToSegment) -> float:
    """Return the distance between the start of a path and the line of the last segment of a reversed path."""
    offset = minus(path.start, along(reverse.end, reverse.end_direction, -1.0))
    return abs(offset[0] * reverse.end_direction[1] - offset[1] * reverse.end_direction[0])


def reversal_errors(scene: Scene, tracer: Tracer, max_rays: int, limits: Limits = FORWARD) -> FloatArray:
    """Return how far reversed paths miss their starts, and the relative deviations of their powers (N, 2)."""
    source = Rays(*_launches(scene, max_rays), s_share=0.5)
    forward = detected_paths(
        tracer(dataclasses.replace(scene, sources=(source,), monitors=()), "power", limits, segments=True)
    )
    forward = forward[:: max(len(forward) // 60, 1)]
    if not forward:
        return np.empty((0, 2))
    reversed_rays = Rays(
        tuple(along(path.end, path.end_direction, -min(START_MM, 0.5 * path.last_length_mm)) for path in forward),
        tuple(_opposite(path.end_direction) for path in forward),
    )
    result = tracer(dataclasses.replace(scene, sources=(reversed_rays,), monitors=()), "power", REVERSE, segments=True)
    reverse_paths = paths_by_ray(result)
    errors = []
    for ray, path in enumerate(forward):
        interfaces = path.interfaces[-2::-1]
        candidates = [
            reverse
            for reverse in reverse_paths[ray]
            if reverse.interfaces[:-1] == interfaces and miss_mm(path, reverse) < MAX_MISS_MM
        ]
        assert candidates, f"no reversed path for {path}"
        best = min(candidates, key=lambda reverse: math.dist(reverse.end_direction, _opposite(path.direction)))
        miss = max(miss_mm(path, best), math.dist(best.end_direction, _opposite(path.direction)))
        s, p = _transmittances(result, ray, best)
        errors.append((miss, max(abs(s / path.s - 1.0), abs(p / path.p - 1.0))))
    return np.array(errors)


def check(errors: FloatArray, min_paths: int) -> str:
    """Check that most paths are reversed exactly, with the same power, and the others nearly; return a summary."""
    miss, deviation = errors.T
    exact = miss < 1e-10
    line = (
        f"{len(errors)} paths reversed, {exact.mean():.1%} of them to 1e-10, with power deviations up to "
        f"{deviation[exact].max():.1e}; the others miss by up to {miss.max():.1e} mm, power {deviation.max():.1e}"
    )
    assert len(errors) >= min_paths, line
    assert exact.mean() > 0.9, line
    assert deviation[exact].max() < 1e-9, line
    assert np.all(deviation < 1e-9 + 10.0 * miss), line
    return line


def _opposite(direction: Point) -> Point:
    return (-direction[0], -direction[1])


def _transmittances(result: Trace, ray: int, path: PathToSegment) -> tuple[float, float]:
    """Return the transmittances of a reversed path to the start of its last segment, which passes its target."""
    assert result.segments is not None
    (segment,) = [
        segment
        for segment in result.segments[result.segments["ray"] == ray]
        if (segment["dx"], segment["dz"]) == path.end_direction and _end(segment) == path.end
    ]
    return float(2.0 * segment["power_s"] * result.rays), float(2.0 * segment["power_p"] * result.rays)


def _end(segment: np.void) -> Point:
    length = min(float(segment["length_mm"]), 1e6)
    return along((float(segment["x_mm"]), float(segment["z_mm"])), (float(segment["dx"]), float(segment["dz"])), length)


def _launches(scene: Scene, rays: int) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
    launches = [source.launch() for source in scene.sources]
    origins = [(float(x), float(z)) for launch in launches for x, z in zip(launch.x_mm, launch.z_mm, strict=True)]
    directions = [(float(x), float(z)) for launch in launches for x, z in zip(launch.dx, launch.dz, strict=True)]
    step = max(len(origins) // rays, 1)
    return tuple(origins[::step]), tuple(directions[::step])


def without_absorption(scene: Scene) -> Scene:
    """Return a scene without absorption, which would affect the reversed path beyond the start of the path."""
    regions = tuple(dataclasses.replace(region, absorption_per_mm=0.0) for region in scene.regions)
    return dataclasses.replace(scene, regions=regions)


def test_paths_are_reversible() -> None:
    scenes = [without_absorption(motley_scene(seed, 40)) for seed in (2, 4, 8, 10)]
    check(np.vstack([reversal_errors(scene, trace, 160) for scene in scenes]), 100)


def test_paths_of_the_reference_are_reversible() -> None:
    check(reversal_errors(without_absorption(motley_scene(2, 8)), trace_reference, 24), 10)


@pytest.mark.evidence
def test_paths_of_a_hundred_scenes_are_reversible() -> None:
    errors = [reversal_errors(without_absorption(motley_scene(seed, 100)), trace, 400) for seed in range(3000, 3200, 2)]
    few_hits = Limits(min_weight=3e-3, max_hits=7)  # paths between many bodies soon become chaotic
    errors.append(reversal_errors(without_absorption(many_bodies(7, 6, 6, 2000)), trace, 2000, few_hits))
    print(f"\n  reciprocity, 101 scenes: {check(np.vstack(errors), 5000)}")


@dataclass(frozen=True)
class LineEmitter(Source):
    """A line from ``start`` to ``end`` that emits to its left, uniformly in position and in the sine of the angle."""

    start: Point
    end: Point
    rays: int

    @property
    def shape_dimensions(self) -> int:
        return 2

    def place(self, u: FloatArray) -> Placed:
        tx, tz = unit(minus(self.end, self.start))
        nx, nz = left_of((tx, tz))
        sine, t = 2.0 * u[:, 0] - 1.0, u[:, 1]
        cosine = np.sqrt(1.0 - sine * sine)
        x, z = ((1.0 - t) * a + t * b + 1e-9 * n for a, b, n in zip(self.start, self.end, (nx, nz), strict=True))
        return x, z, sine * tx + cosine * nx, sine * tz + cosine * nz


LINES: dict[str, tuple[tuple[Point, Point], tuple[Point, Point]]] = {
    "equal lines": (((-1.0, -6.0), (1.0, -6.0)), ((2.5, 6.2), (0.7, 7.1))),
    "a short line and a long one": (((-0.4, -5.0), (-0.1, -5.2)), ((3.0, 6.0), (-1.5, 6.5))),
}


def outline(kind: str) -> list[Curve]:
    """Return the outline of a body."""
    if kind == "conics":
        front = Conic((0.0, -2.0), (0.0, 1.0), 0.2, -0.8, -3.0, 3.0)
        back = Conic((0.0, 2.0), (0.0, -1.0), 0.1, 1.0, -3.0, 3.0)
        return [front, Segment(front.end, back.start), back, Segment(back.end, front.start)]
    if kind == "oval":
        oval = CartesianOval((0.0, -2.0), (0.0, 1.0), 1.0, 1.5, 2.0, 20.0, 30.0, -30.0)
        return [oval, Spline.through([oval.end, (2.2, 1.0), (0.3, 2.0), (-2.2, 1.5), oval.start])]
    points = [(-3.0, -1.0), (0.0, -3.0), (2.5, -1.5), (3.0, 1.0), (0.0, 2.5), (-2.0, 1.5)]
    return [Spline.through(points, closed=True)]


def body_and_mirror(kind: str) -> tuple[tuple[Region, ...], tuple[Interface, ...]]:
    """Return the media and faces between the two lines."""
    curves = outline(kind)
    faces = tuple(Interface(f"c{i}", curve, "glass", "air") for i, curve in enumerate(curves))
    mirror = Interface("mirror", Arc((0.0, 0.0), 8.0, 130.0, 80.0), "air", "air", "mirror")
    return (AIR, glass(1.5, 0.05)), (*faces, mirror)


def exchanged(kind: str, lines: str, rays: int, mode: Literal["power", "roulette"]) -> tuple[float, float, float]:
    """Return the fraction from A to B, that from B to A times the étendue ratio B/A, and the combined error."""
    regions, faces = body_and_mirror(kind)
    a, b = LINES[lines]
    receivers = tuple(
        Interface(name, Segment(*line), "air", "air", "receiver", name) for name, line in (("a", a), ("b", b))
    )
    forward, back = (
        trace(
            Scene(regions, (*faces, *receivers), (LineEmitter(*line, rays),)),
            mode,
            Limits(min_weight=1e-4, max_hits=60),
            sampling="sobol",
            seed=seed,
        ).detectors[receiver]
        for seed, line, receiver in ((1, a, "b"), (2, b, "a"))
    )
    ratio = math.dist(*b) / math.dist(*a)
    return forward.power, ratio * back.power, math.hypot(forward.u_power, ratio * back.u_power)


@pytest.mark.parametrize("lines", LINES)
@pytest.mark.parametrize("kind", ["conics", "oval", "closed spline"])
@pytest.mark.parametrize("mode", ["power", "roulette"])
def test_exchange_between_lines_is_reciprocal(kind: str, lines: str, mode: Literal["power", "roulette"]) -> None:
    forward, back, u = exchanged(kind, lines, 2**14, mode)
    assert forward > 20 * u > 0.0
    assert abs(forward - back) < 4.0 * u


@pytest.mark.evidence
def test_exchange_between_lines_is_reciprocal_to_five_digits() -> None:
    for kind in ("conics", "oval", "closed spline"):
        for lines in LINES:
            forward, back, u = exchanged(kind, lines, 2**21, "power")
            print(f"\n  {kind}, {lines}: {forward:.6f} forward, {back:.6f} back, standard error {u:.1e}")
            assert abs(forward - back) < 4.0 * u
