"""No ray is lost at closed bodies: no leak through an outline, no undefined ray, a complete ledger.

Every body is inside a circular receiver with air on both sides. A ray that leaks out of a body would meet the receiver
from a medium other than its own, and a ray that leaks through the receiver would escape. A ray that leaks into a body
would meet its far side from a medium other than its own, because a circle in front of the source makes the medium of
the ray known.
"""

import dataclasses
import math
import time
from collections.abc import Callable

import numpy as np
import pytest

from solen.curve import Arc, Bezier, Conic, Curve, Parabola, Segment, Spline
from solen.plane import Point, Rigid, along, dot, left_of, minus, unit
from solen.refraction import reflected
from solen.scene import Fan, Interface, Rays, Scene
from solen.trace import Limits, Mode, Trace, trace, trace_reference
from tests.agreement.random_scene_support import curtains, one_body, polygon, ring, side
from tests.agreement.scenes_support import AIR, glass

LIMITS = Limits(max_hits=300)


def check_nothing_lost(result: Trace, title: str) -> None:
    assert (result.undefined, result.undefined_at_mm) == (0, ()), title
    assert result.ledger.escaped == 0.0, title
    assert result.ledger.absorbed == 0.0, title
    assert result.ledger.total == pytest.approx(1.0, abs=1e-9), title
    assert result.ledger.truncated == pytest.approx(result.truncated / result.rays, rel=1e-6), title


@pytest.mark.parametrize("mode", ["count", "roulette"])
def test_a_hundred_bodies(mode: Mode) -> None:
    for seed in range(100):
        check_nothing_lost(trace(one_body(seed, 1000), mode, LIMITS, seed=seed), f"body {seed}")


@pytest.mark.evidence
def test_a_hundred_million_rays_through_a_hundred_bodies() -> None:
    start, hits, rays, trapped = time.perf_counter(), 0, 0, 0
    for seed in range(100):
        result = trace(one_body(seed, 1_000_000), "roulette", LIMITS, seed=seed)
        check_nothing_lost(result, f"body {seed}")
        hits, rays, trapped = hits + result.hits, rays + result.rays, trapped + result.truncated
    seconds = time.perf_counter() - start
    print(
        f"\n  closed bodies: {rays:,} rays through 100 bodies, {hits:,} hits, none undefined or lost; {trapped} still "
        f"trapped after {LIMITS.max_hits} hits; {seconds:.0f} s, {hits / seconds / 1e6:.1f} million hits/s"
    )
    assert rays == 10**8


@pytest.mark.parametrize("mode", ["count", "roulette"])
def test_splitting_and_absorbing_bodies(mode: Mode) -> None:
    for seed in range(30):
        scene = one_body(seed, 60)
        split = trace(scene, "power", Limits(min_weight=1e-4, max_hits=300))
        assert (split.undefined, split.ledger.escaped) == (0, 0.0)
        assert split.ledger.total == pytest.approx(1.0, abs=1e-12)
        grey = tuple(dataclasses.replace(region, absorption_per_mm=0.05) for region in scene.regions[1:])
        result = trace(dataclasses.replace(scene, regions=(scene.regions[0], *grey)), mode, LIMITS)
        assert (result.undefined, result.ledger.escaped) == (0, 0.0)
        assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
        assert (result.ledger.absorbed > 0.0) == (mode == "roulette")


def test_few_rays_are_undefined_in_single_precision() -> None:
    """Curves extend 1e-5 mm beyond their ends, so a ray that starts that close to a corner may be undefined."""
    undefined = rays = 0
    for seed in range(20):
        result = trace(one_body(seed, 10_000), "roulette", LIMITS, seed=seed, precision="single")
        assert result.ledger.escaped == 0.0
        assert result.ledger.total == pytest.approx(1.0, abs=1e-6)
        undefined, rays = undefined + result.undefined, rays + result.rays
    assert undefined <= 1e-5 * rays


def closed_spline(seed: int, *, smooth: bool) -> Spline:
    """Return a closed spline, smooth or with corners between Bézier pieces."""
    rng = np.random.default_rng(seed)
    corners = polygon(rng, (0.0, 0.0), 5.0)
    if smooth:
        return Spline.through(corners, closed=True)
    curves = [side(rng, a, b, ("bezier",)) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
    points = [point for curve in curves if isinstance(curve, Bezier) for point in curve.controls[0][1:]]
    return Spline((corners[0], *points))


def in_ring(curve: Curve, rays: Rays | Fan) -> Scene:
    """Return a body in a receiver; rays may start within 0.6 mm of the centre, or outside at 6.5 mm or more."""
    return Scene(
        (AIR, glass(1.5)), (Interface("body", curve, "glass", "air"), *curtains(0.6, "glass"), ring()), (rays,)
    )


def aimed(seed: int, targets: list[Point], miss_mm: float, rays: int) -> Rays:
    """Return rays from inside and outside a body that miss targets by a distance."""
    rng = np.random.default_rng(seed)
    origins, directions = [], []
    for i in range(rays):
        target = targets[int(rng.integers(len(targets)))]
        angle = float(rng.uniform(0, 2 * math.pi))
        distance = 7.0 if i % 2 else 0.5
        origin = (distance * math.cos(angle), distance * math.sin(angle))
        across = left_of(unit(minus(target, origin)))
        origins.append(origin)
        directions.append(minus(along(target, across, miss_mm * float(rng.choice([-1, 1]))), origin))
    return Rays(tuple(origins), tuple(directions))


@pytest.mark.parametrize("mode", ["count", "roulette"])
@pytest.mark.parametrize("miss_mm", [0.0, 1e-15, 1e-13, 1e-12, 1e-11, 1e-9, 1e-6])
def test_joints_of_a_smooth_spline(miss_mm: float, mode: Mode) -> None:
    for seed in range(5):
        curve = closed_spline(seed, smooth=True)
        rays = aimed(seed, [piece.control[0] for piece in curve.pieces], miss_mm, 1000)
        check_nothing_lost(trace(in_ring(curve, rays), mode, LIMITS), f"{seed}")


@pytest.mark.parametrize("mode", ["count", "roulette"])
def test_joints_with_round_coordinates(mode: Mode) -> None:
    """Products cancel there, and the sign of the rounding error must be the same for both pieces at a joint."""
    points = [(4.0, 0.0), (3.0, 2.5), (0.5, 4.0), (-2.0, 3.5), (-4.0, 1.0), (-3.0, -2.0), (-0.5, -4.0), (2.5, -3.0)]
    curve = Spline.through(points, closed=True)
    starts = [(0.1 * i, 0.1 * j) for i in range(-76, 77, 4) for j in range(-76, 77, 4) if 66 < math.hypot(i, j) < 79]
    starts += [(0.1 * i, 0.1 * j) for i in range(-4, 5) for j in range(-4, 5) if math.hypot(i, j) < 5.9]
    pairs = [(start, point) for start in starts for point in points if start != point]
    rays = Rays(tuple(a for a, _ in pairs), tuple(minus(b, a) for a, b in pairs))
    check_nothing_lost(trace(in_ring(curve, rays), mode, LIMITS), "round coordinates")
    few = Rays(rays.origins[::16], rays.directions[::16])
    check_nothing_lost(trace_reference(in_ring(curve, few), mode, LIMITS), "round coordinates")


@pytest.mark.parametrize("tracer", [trace, trace_reference], ids=["engine", "reference"])
def test_reflection_from_joint_to_joint(tracer: Callable[..., Trace]) -> None:
    """Inside a closed mirror, every ray is reflected at one joint so that it meets another."""
    lost = []
    for seed in range(6):
        curve = closed_spline(seed, smooth=True)
        joints = [piece.control[0] for piece in curve.pieces]
        origins, directions = [], []
        for first in joints:
            normal = curve.normal_at(first)
            for second in joints:
                if second != first and dot(minus(second, first), normal) > 0.0:
                    incident = reflected(unit(minus(second, first)), normal)
                    origins.append(along(first, incident, -1e-3))
                    directions.append(incident)
        face = Interface("mirror", curve, "air", "air", "mirror")
        scene = Scene((AIR,), (face,), (Rays(tuple(origins), tuple(directions)),))
        result = tracer(scene, limits=Limits(max_hits=12))
        assert result.rays > 10
        lost.append(round(result.ledger.escaped * result.rays))
    assert lost == [0] * 6


@pytest.mark.parametrize("miss_mm", [1e-13, 1e-12, 5e-12, 1e-11, 1e-9])
def test_corners_of_a_spline(miss_mm: float) -> None:
    """The pieces share their corners exactly and do not extend beyond them, in both tracers."""
    for seed in range(5):
        curve = closed_spline(seed, smooth=False)
        corners = [control[0] for control in curve.controls]
        many, few = (in_ring(curve, aimed(seed, corners, miss_mm, rays)) for rays in (2000, 20))
        check_nothing_lost(trace(many, "count", LIMITS), f"{seed}")
        check_nothing_lost(trace_reference(few, "count", Limits(max_hits=20)), f"{seed}")


@pytest.mark.parametrize("mode", ["count", "roulette"])
def test_grazing_rays(mode: Mode) -> None:
    """Rays start next to the body along its tangents, with deviations of 1e-3 down to rounding errors."""
    u = np.linspace(0.0, 1.0, 400, endpoint=False)
    for seed in range(3):
        curve = closed_spline(seed, smooth=True)
        rng = np.random.default_rng(seed)
        points, ahead = curve.points(u), curve.points(u + 1e-7)
        origins, directions = [], []
        for (x, z), (next_x, next_z) in zip(points.tolist(), ahead.tolist(), strict=True):
            tangent = unit(minus((next_x, next_z), (x, z)))
            offset, angle = (float(rng.choice([-1, 1]) * 10 ** rng.uniform(-15, -3)) for _ in range(2))
            origins.append(along((x, z), left_of(tangent), offset))
            directions.append(Rigid.about((0.0, 0.0), math.degrees(angle)).vector(tangent))
        rays = Rays(tuple(origins), tuple(directions))
        check_nothing_lost(trace(in_ring(curve, rays), mode, Limits(max_hits=2000)), f"{seed}")


TANGENT_BODIES: dict[str, list[Curve]] = {
    "circle": [Arc.circle((0.0, 0.0), 3.0)],
    "two arcs": [Arc((0.0, 0.0), 3.0, -90.0, 180.0), Arc((0.0, 0.0), 3.0, 90.0, 180.0)],
    "parabola": [Conic((3.0, 0.0), (-1.0, 0.0), 0.5, -1.0, -1.5, 1.5), Segment((2.4375, 1.5), (2.4375, -1.5))],
    "bent line": [Parabola((3.0, 0.0), (0.0, 1.0), -0.25, -1.5, 1.5), Segment((2.4375, 1.5), (2.4375, -1.5))],
    "ellipse": [Conic((3.0, 0.0), (-1.0, 0.0), 0.5, -0.75, -2.0, 2.0)],
    "Bézier curve": [Bezier((2.0, -2.0), (3.5, -1.0), (3.5, 1.0), (2.0, 2.0)), Segment((2.0, 2.0), (2.0, -2.0))],
    "spline": [Spline.through([(3.0, 0.0), (0.0, 2.0), (-3.0, 0.0), (0.0, -2.0)], closed=True)],
}


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize("kind", TANGENT_BODIES)
@pytest.mark.parametrize("tracer", [trace, trace_reference], ids=["engine", "reference"])
def test_tangent_ray_continues(tracer: Callable[..., Trace], kind: str, mode: Mode) -> None:
    """The coordinates are exact, so that the two roots along the tangent coincide, and the curve is not crossed."""
    curves = TANGENT_BODIES[kind]
    if kind == "ellipse":
        curves = [*curves, Segment(curves[0].end, curves[0].start)]
    body = [Interface(f"c{i}", curve, "glass", "air") for i, curve in enumerate(curves)]
    tangent_x = max(curves[0].points(np.linspace(0.0, 1.0, 9))[:, 0].tolist())
    rays = Rays(((tangent_x, -7.0), (tangent_x, 7.0)), ((0.0, 1.0), (0.0, -1.0)))
    result = tracer(Scene((AIR, glass(1.5)), (*body, *curtains(0.2, "glass"), ring()), (rays,)), mode)
    assert result.undefined == 0
    assert result.ledger.detected == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("seed", range(3))
def test_ten_thousand_reflections_inside_a_closed_spline(seed: int, precision: str) -> None:
    """Every ray stays inside the mirror, even if it is almost parallel to it."""
    curve = closed_spline(seed, smooth=True)
    face = Interface("mirror", curve, "air", "air", "mirror")
    angles = np.linspace(0.0, 360.0, 25, endpoint=False).tolist()
    starts = curve.points(np.linspace(0.01, 0.99, 25)) * 0.999
    rays = Rays(tuple((x, z) for x, z in starts.tolist()), tuple((math.cos(a), math.sin(a)) for a in angles))
    result = trace(Scene((AIR,), (face,), (rays,)), limits=Limits(max_hits=10_000), precision=precision)  # type: ignore[arg-type]
    assert (result.hits, result.truncated) == (25 * 10_000, 25)
    assert result.ledger.escaped == 0.0


@pytest.mark.parametrize(("far_mm", "precision"), [(1e3, "single"), (1e4, "single"), (1e6, "double")])
def test_rays_in_corners_far_from_the_origin_end(far_mm: float, precision: str) -> None:
    """A ray at a corner must advance even if the rounding error of its position exceeds the usual step."""
    rng = np.random.default_rng(3)
    corners = polygon(rng, (0.0, 0.0), 5.0)
    shift = Rigid(shift=(far_mm, 0.7 * far_mm))
    faces = tuple(
        Interface(f"i{i}", side(rng, a, b).moved(shift), "glass", "air")
        for i, (a, b) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True))
    )
    rays = aimed(1, corners, 0.0, 3000)
    rays = dataclasses.replace(rays, origins=tuple(shift.point(origin) for origin in rays.origins))
    scene = Scene((AIR, glass(1.5)), faces, (rays,), open_media=True)
    result = trace(scene, limits=Limits(max_hits=50), precision=precision)  # type: ignore[arg-type]
    assert result.ledger.total == pytest.approx(1.0, abs=1e-5)
    assert result.undefined < 0.2 * result.rays
