"""In closed bodies no ray is lost, whatever they are made of: none slips out, none is undefined, the ledger closes.

Around every body stands a ring that receives all and has air on both sides. A ray that slipped out of a body unseen
would meet the ring from a medium that it is not in; one that slipped through the ring would escape. What slipped into
a body unseen would meet its far side from a medium that it is not in, as a curtain before the source tells it its own.
"""

import dataclasses
import math
import time
from collections.abc import Callable

import numpy as np
import pytest

from solen.curve import Arc, Bezier, Conic, Curve, Parabola, Segment, Spline
from solen.interface import reflected
from solen.plane import Point, Rigid, along, dot, left_of, minus, unit
from solen.scene import Fan, Interface, Rays, Scene
from solen.trace import Limits, Mode, Trace, trace, trace_reference
from tests.agreement.random_scene_support import curtains, one_body, polygon, ring, side
from tests.agreement.scenes_support import AIR, glass

LIMITS = Limits(max_hits=300)


def nothing_lost(result: Trace, what: str) -> None:
    assert (result.undefined, result.undefined_at_mm) == (0, ()), what
    assert result.ledger.escaped == 0.0, what
    assert result.ledger.absorbed == 0.0, what
    assert result.ledger.total == pytest.approx(1.0, abs=1e-9), what
    assert result.ledger.truncated == pytest.approx(result.truncated / result.rays, rel=1e-6), what


@pytest.mark.parametrize("mode", ["count", "roulette"])
def test_a_hundred_bodies_of_every_curve_lose_no_ray(mode: Mode) -> None:
    for seed in range(100):
        nothing_lost(trace(one_body(seed, 1000), mode, LIMITS, seed=seed), f"body {seed}")


@pytest.mark.evidence
def test_a_hundred_million_rays_through_a_hundred_bodies_lose_none() -> None:
    start, hits, rays, kept = time.perf_counter(), 0, 0, 0.0
    for seed in range(100):
        result = trace(one_body(seed, 1_000_000), "roulette", LIMITS, seed=seed)
        nothing_lost(result, f"body {seed}")
        hits, rays, kept = hits + result.hits, rays + result.rays, kept + result.truncated
    seconds = time.perf_counter() - start
    print(
        f"\n  closed bodies: {rays:,} rays through 100 bodies, {hits:,} hits, none undefined or lost; {kept:.0f} still "
        f"trapped after {LIMITS.max_hits} hits; {seconds:.0f} s, {hits / seconds / 1e6:.1f} million hits/s"
    )
    assert rays == 10**8


@pytest.mark.parametrize("mode", ["count", "roulette"])
def test_splitting_and_absorbing_bodies_lose_none_either(mode: Mode) -> None:
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


def test_single_precision_loses_less_than_one_ray_in_a_hundred_thousand() -> None:
    """There curves reach 1e-5 mm beyond their ends, and what starts within that of a corner may be undefined."""
    lost = rays = 0
    for seed in range(60):
        result = trace(one_body(seed, 10_000), "roulette", LIMITS, seed=seed, precision="single")
        assert result.ledger.escaped == 0.0
        assert result.ledger.total == pytest.approx(1.0, abs=1e-6)
        lost, rays = lost + result.undefined, rays + result.rays
    assert lost <= 1e-5 * rays


def blob(seed: int, *, smooth: bool) -> Spline:
    """A closed spline: through some points, or of Bézier pieces with corners between them."""
    rng = np.random.default_rng(seed)
    corners = polygon(rng, (0.0, 0.0), 5.0)
    if smooth:
        return Spline.through(corners, closed=True)
    curves = [side(rng, a, b, ("bezier",)) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
    points = [point for curve in curves if isinstance(curve, Bezier) for point in curve.controls[0][1:]]
    return Spline((corners[0], *points))


def in_ring(curve: Curve, rays: Rays | Fan) -> Scene:
    """A body; rays that start less than 0.6 mm from the middle are inside, those from 6.5 mm on outside."""
    return Scene(
        (AIR, glass(1.5)), (Interface("body", curve, "glass", "air"), *curtains(0.6, "glass"), ring()), (rays,)
    )


def aimed(seed: int, targets: list[Point], miss_mm: float, rays: int) -> Rays:
    """Rays from within and from outside that pass targets by so much."""
    rng = np.random.default_rng(seed)
    origins, directions = [], []
    for i in range(rays):
        target = targets[int(rng.integers(len(targets)))]
        turn = float(rng.uniform(0, 2 * math.pi))
        distance = 7.0 if i % 2 else 0.5
        origin = (distance * math.cos(turn), distance * math.sin(turn))
        sideways = left_of(unit(minus(target, origin)))
        origins.append(origin)
        directions.append(minus(along(target, sideways, miss_mm * float(rng.choice([-1, 1]))), origin))
    return Rays(tuple(origins), tuple(directions))


@pytest.mark.parametrize("mode", ["count", "roulette"])
@pytest.mark.parametrize("miss_mm", [0.0, 1e-15, 1e-13, 1e-12, 1e-11, 1e-9, 1e-6])
def test_no_ray_is_lost_at_the_joints_of_a_smooth_spline(miss_mm: float, mode: Mode) -> None:
    for seed in range(5):
        curve = blob(seed, smooth=True)
        rays = aimed(seed, [piece.control[0] for piece in curve.pieces], miss_mm, 2000)
        nothing_lost(trace(in_ring(curve, rays), mode, LIMITS), f"{seed}")


@pytest.mark.parametrize("mode", ["count", "roulette"])
def test_no_ray_is_lost_at_joints_whose_coordinates_are_round_numbers(mode: Mode) -> None:
    """There products cancel, and what is left of them has the sign of its rounding: one for both pieces of a joint."""
    points = [(4.0, 0.0), (3.0, 2.5), (0.5, 4.0), (-2.0, 3.5), (-4.0, 1.0), (-3.0, -2.0), (-0.5, -4.0), (2.5, -3.0)]
    curve = Spline.through(points, closed=True)
    starts = [(0.1 * i, 0.1 * j) for i in range(-76, 77, 4) for j in range(-76, 77, 4) if 66 < math.hypot(i, j) < 79]
    starts += [(0.1 * i, 0.1 * j) for i in range(-4, 5) for j in range(-4, 5) if math.hypot(i, j) < 5.9]
    pairs = [(start, point) for start in starts for point in points if start != point]
    rays = Rays(tuple(a for a, _ in pairs), tuple(minus(b, a) for a, b in pairs))
    nothing_lost(trace(in_ring(curve, rays), mode, LIMITS), "round numbers")
    few = Rays(rays.origins[::16], rays.directions[::16])
    nothing_lost(trace_reference(in_ring(curve, few), mode, LIMITS), "round numbers")


@pytest.mark.parametrize("tracer", [trace, trace_reference], ids=["engine", "reference"])
def test_no_ray_is_lost_on_its_way_from_joint_to_joint(tracer: Callable[..., Trace]) -> None:
    """Inside a mirror: from wherever it comes, a ray is reflected in one joint so that it meets another one."""
    lost = []
    for seed in range(6):
        curve = blob(seed, smooth=True)
        joints = [piece.control[0] for piece in curve.pieces]
        origins, directions = [], []
        for first in joints:
            normal = curve.normal_at(first)
            for second in joints:
                if second != first and dot(minus(second, first), normal) > 0.0:
                    backwards = reflected(unit(minus(second, first)), normal)
                    origins.append(along(first, backwards, -1e-3))
                    directions.append(backwards)
        face = Interface("mirror", curve, "air", "air", "mirror")
        scene = Scene((AIR,), (face,), (Rays(tuple(origins), tuple(directions)),))
        result = tracer(scene, limits=Limits(max_hits=12))
        assert result.rays > 10
        lost.append(round(result.ledger.escaped * result.rays))
    assert lost == [0] * 6


@pytest.mark.parametrize("miss_mm", [1e-13, 1e-12, 5e-12, 1e-11, 1e-9])
def test_no_ray_is_lost_beside_the_corners_of_a_spline(miss_mm: float) -> None:
    """Its pieces share their corner exactly and reach nowhere beyond it; in both tracers."""
    for seed in range(5):
        curve = blob(seed, smooth=False)
        corners = [control[0] for control in curve.controls]
        nothing_lost(trace(in_ring(curve, aimed(seed, corners, miss_mm, 2000)), "count", LIMITS), f"{seed}")
        few = in_ring(curve, aimed(seed, corners, miss_mm, 20))
        nothing_lost(trace_reference(few, "count", Limits(max_hits=20)), f"{seed}")


@pytest.mark.parametrize("mode", ["count", "roulette"])
def test_no_ray_is_lost_that_grazes(mode: Mode) -> None:
    """Rays along tangents of the body, off by any power of ten down to rounding, from points next to it."""
    u = np.linspace(0.0, 1.0, 400, endpoint=False)
    for seed in range(5):
        curve = blob(seed, smooth=True)
        rng = np.random.default_rng(seed)
        places, ahead = curve.points(u), curve.points(u + 1e-7)
        origins, directions = [], []
        for place, next_one in zip(places.tolist(), ahead.tolist(), strict=True):
            tangent = unit(minus((next_one[0], next_one[1]), (place[0], place[1])))
            off, turn = (float(rng.choice([-1, 1]) * 10 ** rng.uniform(-15, -3)) for _ in range(2))
            origins.append(along((place[0], place[1]), left_of(tangent), off))
            directions.append(Rigid.about((0.0, 0.0), math.degrees(turn)).vector(tangent))
        rays = Rays(tuple(origins), tuple(directions))
        nothing_lost(trace(in_ring(curve, rays), mode, Limits(max_hits=2000)), f"{seed}")


TOUCHED: dict[str, list[Curve]] = {
    "circle": [Arc.circle((0.0, 0.0), 3.0)],
    "two arcs": [Arc((0.0, 0.0), 3.0, -90.0, 180.0), Arc((0.0, 0.0), 3.0, 90.0, 180.0)],
    "parabola": [Conic((3.0, 0.0), (-1.0, 0.0), 0.5, -1.0, -1.5, 1.5), Segment((2.4375, 1.5), (2.4375, -1.5))],
    "bent line": [Parabola((3.0, 0.0), (0.0, 1.0), -0.25, -1.5, 1.5), Segment((2.4375, 1.5), (2.4375, -1.5))],
    "ellipse": [Conic((3.0, 0.0), (-1.0, 0.0), 0.5, -0.75, -2.0, 2.0)],
    "Bézier curve": [Bezier((2.0, -2.0), (3.5, -1.0), (3.5, 1.0), (2.0, 2.0)), Segment((2.0, 2.0), (2.0, -2.0))],
    "spline": [Spline.through([(3.0, 0.0), (0.0, 2.0), (-3.0, 0.0), (0.0, -2.0)], closed=True)],
}


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize("kind", TOUCHED)
@pytest.mark.parametrize("tracer", [trace, trace_reference], ids=["engine", "reference"])
def test_a_ray_that_only_touches_a_body_goes_on(tracer: Callable[..., Trace], kind: str, mode: Mode) -> None:
    """In numbers that leave no rounding: along the tangent the two roots are one, and nothing is crossed."""
    curves = TOUCHED[kind]
    if kind == "ellipse":
        curves = [*curves, Segment(curves[0].end, curves[0].start)]
    body = [Interface(f"c{i}", curve, "glass", "air") for i, curve in enumerate(curves)]
    touches = max(curves[0].points(np.linspace(0.0, 1.0, 9))[:, 0].tolist())
    rays = Rays(((touches, -7.0), (touches, 7.0)), ((0.0, 1.0), (0.0, -1.0)))
    result = tracer(Scene((AIR, glass(1.5)), (*body, *curtains(0.2, "glass"), ring()), (rays,)), mode)
    assert result.undefined == 0
    assert result.ledger.detected == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("seed", range(3))
def test_ten_thousand_total_reflections_keep_rays_in_a_spline(seed: int, precision: str) -> None:
    """Mirrored: every ray stays inside for as long as it is followed, however it creeps along the outline."""
    face = Interface("mirror", blob(seed, smooth=True), "air", "air", "mirror")
    turns = np.linspace(0.0, 360.0, 50, endpoint=False).tolist()
    starts = blob(seed, smooth=True).points(np.linspace(0.01, 0.99, 50)) * 0.999
    rays = Rays(tuple((x, z) for x, z in starts.tolist()), tuple((math.cos(t), math.sin(t)) for t in turns))
    result = trace(Scene((AIR,), (face,), (rays,)), limits=Limits(max_hits=10_000), precision=precision)  # type: ignore[arg-type]
    assert (result.hits, result.truncated) == (50 * 10_000, 50)
    assert result.ledger.escaped == 0.0


@pytest.mark.parametrize(("far_mm", "precision"), [(1e3, "single"), (1e4, "single"), (1e6, "double")])
def test_rays_in_corners_far_from_the_origin_come_to_an_end(far_mm: float, precision: str) -> None:
    """Where rounding is coarser than what a ray in a corner is carried on by, it must still move."""
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
