"""A grid over many curves reduces the number of tested curves and does not change the result."""

import dataclasses
import math
import time

import numpy as np
import pytest

from solen.curve import Arc, Curve, Segment, Spline
from solen.plane import Point, Rigid
from solen.scene import Beam, Fan, Interface, Rays, Scene
from solen.trace import Limits, Mode, Trace, engine, grid, trace
from solen.trace.tables import compile_scene
from tests.agreement.compare_support import ROTATION_RAD, compare, with_rotated_rays
from tests.agreement.random_scene_support import many_bodies
from tests.agreement.scenes_support import AIR, glass

LIMITS = Limits(min_weight=1e-2, max_hits=40)
NO_GRID = 10**9


def trace_without_grid(patch: pytest.MonkeyPatch, scene: Scene, mode: Mode) -> Trace:
    """Trace a scene by testing all curves."""
    with patch.context() as patched:
        patched.setattr(grid, "MIN_PIECES", NO_GRID)
        assert len(compile_scene(scene).grid_item) == 0
        return trace(scene, mode, LIMITS, segments=True)


def check(patch: pytest.MonkeyPatch, scene: Scene, mode: Mode, max_excluded: float) -> None:
    """Check that all segments are the same with and without the grid, where rounding permits a comparison."""
    assert len(compile_scene(scene).grid_item) > 0
    reference, *rotated = (
        trace_without_grid(patch, with_rotated_rays(scene, angle) if angle else scene, mode)
        for angle in (0.0, ROTATION_RAD, -ROTATION_RAD)
    )
    result = trace(scene, mode, LIMITS, segments=True)
    comparison = compare(reference, tuple(rotated), result)
    assert comparison.deviation_power < 1e-9
    assert comparison.excluded <= max_excluded * comparison.segments
    assert (reference.undefined, result.undefined) == (0, 0)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)


def outline(sides: int, seed: int, kind: str) -> list[Curve]:
    """Return a wavy closed curve 8 to 12 mm from the origin, as segments or as one spline."""
    rng = np.random.default_rng(seed)
    angles = np.arange(sides) * 2.0 * math.pi / sides
    waves = np.arange(2, 9)
    radii = 10.0 + (rng.uniform(-0.5, 0.5, 7) / waves) @ np.cos(np.outer(waves, angles) + rng.uniform(0, 6, 7)[:, None])
    radii += rng.uniform(-0.2, 0.2, sides) * 10.0 * 2.0 * math.pi / sides
    corners: list[Point] = [
        (r * math.cos(a), r * math.sin(a)) for r, a in zip(radii.tolist(), angles.tolist(), strict=True)
    ]
    if kind == "spline":
        return [Spline.through(corners, closed=True)]
    return [Segment(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]


def many_sided(sides: int, seed: int, kind: str, rays: int) -> Scene:
    """Return a body with such an outline in a circular receiver, with a source inside the body and one outside."""
    body = [Interface(f"side-{i}", curve, "glass", "air") for i, curve in enumerate(outline(sides, seed, kind))]
    ring = Interface("ring", Arc.circle((0.0, 0.0), 15.0), "air", "air", "receiver", "ring")
    fans = (Fan((1.0, 2.0), 0.0, 360.0, rays // 2), Fan((-13.5, 1.0), -90.0, 120.0, rays - rays // 2))
    return Scene((AIR, glass(1.5, 0.01)), (*body, ring), fans)


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize(("sides", "kind"), [(120, "polygon"), (1000, "polygon"), (60, "spline"), (300, "spline")])
def test_body_with_many_sides(monkeypatch: pytest.MonkeyPatch, sides: int, kind: str, mode: Mode) -> None:
    rays = 60 if mode == "power" else 600
    check(monkeypatch, many_sided(sides, sides, kind, rays), mode, 0.4)


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize("seed", [1, 2])
def test_many_bodies(monkeypatch: pytest.MonkeyPatch, seed: int, mode: Mode) -> None:
    check(monkeypatch, many_bodies(seed, 7, 9, 60 if mode == "power" else 400), mode, 0.5)


def test_extreme_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sources far outside the grid, elongated cells, a wide screen behind small bodies, and rays along the axes."""
    bodies = [
        Interface(f"{kind}{i}", curve, "glass", "air")
        for i in range(25)
        for kind, curve in (
            ("ball", Arc.circle((3.0 * i, 0.2), 0.7)),
            ("spot", Spline.through([(3.0 * i + 1.0, 0.0), (3.0 * i + 2.0, -0.3), (3.0 * i + 1.5, 0.8)], closed=True)),
        )
    ]
    screen = Interface("screen", Segment((1e4, 50.0), (-1e4, 50.0)), "air", "air", "receiver", "screen")
    sources = (
        Beam((-1.0, -1000.0), (75.0, -1000.0), 0.0, 301),
        Beam((-300.0, -1.0), (-300.0, 1.5), -90.0, 301),
        Beam((90.0, -1.0), (90.0, 1.5), 90.0, 301),
        Fan((1e4, -1e4), 45.0, 0.5, 301),
        Rays(((0.0, 0.0), (3.0, -9.0), (1.5, 30.0)), ((1.0, 0.0), (0.0, 1.0), (0.0, -1.0))),
    )
    for faces in (bodies, [*bodies, screen]):
        scene = Scene((AIR, glass(1.5)), tuple(faces), sources)
        check(monkeypatch, scene, "count", 0.5)  # 14 m away, a rotation by 1e-13 rad is more than a nanometre
        rotation = Rigid.about((0.0, 0.0), 90.0)
        rotated = tuple(dataclasses.replace(face, curve=face.curve.moved(rotation)) for face in faces)
        check(monkeypatch, dataclasses.replace(scene, interfaces=rotated), "count", 0.5)


def test_nearest_of_many_parallel_mirrors(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ray must meet the first of thousands of mirrors that are behind one another in the same cells."""
    stack = tuple(
        Interface(f"m{i}", Segment((-5.0, 0.003 * i), (5.0, 0.003 * i)), "air", "air", "mirror") for i in range(2000)
    )
    beams = (Beam((-5.5, -1.0), (5.5, -1.0), 0.0, 500), Beam((-5.5, 7.0), (5.5, 7.0), 180.0, 500))
    scene = Scene((AIR,), stack, (*beams, Fan((0.0, 3.0015), 0.0, 360.0, 500)))
    result, reference = trace(scene, segments=True, limits=LIMITS), trace_without_grid(monkeypatch, scene, "count")
    assert result.segments is not None
    assert reference.segments is not None
    np.testing.assert_array_equal(result.segments["interface"], reference.segments["interface"])
    first = result.segments[result.segments["hit"] == 0]
    assert set(first["interface"][:500].tolist()) == {0, -1}
    assert set(first["interface"][500:1000].tolist()) == {1999, -1}


def timed_trace(patch: pytest.MonkeyPatch, scene: Scene, min_pieces: int) -> tuple[float, float, Trace]:
    """Return the compilation time of a scene in s, the tracing time per hit in µs, and the trace."""
    with patch.context() as patched:
        patched.setattr(grid, "MIN_PIECES", min_pieces)
        start = time.perf_counter()
        tables = compile_scene(scene)
        compiled = time.perf_counter()
        patched.setattr(engine, "compile_scene", lambda *_: tables)
        result = trace(scene, "roulette", LIMITS, threads=1)
        return compiled - start, 1e6 * (time.perf_counter() - compiled) / result.hits, result


@pytest.mark.evidence
@pytest.mark.parametrize("kind", ["polygon", "spline", "bodies"])
def test_five_thousand_curves_are_faster_with_grid(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    small, medium, large = (
        many_bodies(5, 32, 32, rays) if kind == "bodies" else many_sided(5000, 5, kind, rays)
        for rays in (400, 4000, 200_000)
    )
    check(monkeypatch, small, "roulette", 0.6)
    compile_s, fast, result = timed_trace(monkeypatch, large, grid.MIN_PIECES)
    _, slow, reference = timed_trace(monkeypatch, medium, NO_GRID)
    pieces = len(compile_scene(small).kind)
    print(
        f"\n  grid, {kind}: {len(small.interfaces)} curves in {pieces} pieces: {fast:.2f} µs per hit with a grid, "
        f"{slow:.0f} without, {slow / fast:.0f} times as fast; compiled in {compile_s:.1f} s"
    )
    assert pieces >= 4000
    assert fast < 0.5 * slow
    for name, reading in reference.detectors.items():
        assert result.detectors[name].power == pytest.approx(reading.power, abs=4 * math.hypot(reading.u_power, 1e-4))


def test_only_many_curves_have_a_grid() -> None:
    assert len(compile_scene(many_sided(grid.MIN_PIECES - 2, 1, "polygon", 2)).grid_item) == 0
    assert len(compile_scene(many_sided(grid.MIN_PIECES - 1, 1, "polygon", 2)).grid_item) > 0
    empty = Scene((AIR,), (), (Fan((0.0, 0.0), 0.0, 360.0, 3),))
    assert trace(empty).ledger.escaped == pytest.approx(1.0)
