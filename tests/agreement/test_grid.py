"""A grid over many curves changes what is looked at, and nothing that is found."""

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
from tests.agreement.compare_support import TURN_RAD, compared, turned
from tests.agreement.random_scene_support import many_bodies
from tests.agreement.scenes_support import AIR, glass

LIMITS = Limits(min_weight=1e-2, max_hits=40)
NEVER = 10**9


@pytest.fixture
def no_grid(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """What takes the grid away, see `without`."""
    return monkeypatch


def without(patch: pytest.MonkeyPatch, scene: Scene, mode: Mode, limits: Limits = LIMITS) -> Trace:
    """The trace that looks at all curves."""
    with patch.context() as patched:
        patched.setattr(grid, "MIN_PIECES", NEVER)
        assert len(compile_scene(scene).grid_item) == 0
        return trace(scene, mode, limits, legs=True)


def check(patch: pytest.MonkeyPatch, scene: Scene, mode: Mode, most_left_out: float) -> None:
    """Every stretch is the same, as far as a scene lets itself be computed at all; see `compare_support`."""
    assert len(compile_scene(scene).grid_item) > 0
    truth, more, less = (
        without(patch, turned(scene, angle) if angle else scene, mode) for angle in (0.0, TURN_RAD, -TURN_RAD)
    )
    found = trace(scene, mode, LIMITS, legs=True)
    comparison = compared(truth, (more, less), found)
    assert comparison.deviation_power < 1e-9
    assert comparison.left_out <= most_left_out * comparison.stretches
    assert (truth.undefined, found.undefined) == (0, 0)
    assert found.ledger.total == pytest.approx(1.0, abs=1e-12)


def outline(sides: int, seed: int, kind: str) -> list[Curve]:
    """A wavy closed line about the origin, 8 to 12 mm away: of segments, or one spline."""
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
    """Such a body in a ring that receives all, a source within and one outside."""
    body = [Interface(f"side-{i}", curve, "glass", "air") for i, curve in enumerate(outline(sides, seed, kind))]
    ring = Interface("ring", Arc.circle((0.0, 0.0), 15.0), "air", "air", "receiver", "ring")
    fans = (Fan((1.0, 2.0), 0.0, 360.0, rays // 2), Fan((-13.5, 1.0), -90.0, 120.0, rays - rays // 2))
    return Scene((AIR, glass(1.5, 0.01)), (*body, ring), fans)


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize(("sides", "kind"), [(120, "polygon"), (1000, "polygon"), (60, "spline"), (300, "spline")])
def test_a_body_of_many_sides_is_traced_the_same(
    no_grid: pytest.MonkeyPatch, sides: int, kind: str, mode: Mode
) -> None:
    rays = 60 if mode == "power" else 600
    check(no_grid, many_sided(sides, sides, kind, rays), mode, 0.4)


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_field_of_bodies_of_every_kind_is_traced_the_same(no_grid: pytest.MonkeyPatch, seed: int, mode: Mode) -> None:
    check(no_grid, many_bodies(seed, 7, 9, 60 if mode == "power" else 400), mode, 0.5)


def test_far_away_long_and_thin_scenes_are_traced_the_same(no_grid: pytest.MonkeyPatch) -> None:
    """Sources outside the grid, cells far from square, a wide screen over tiny bodies, and rays along the axes."""
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
        check(no_grid, scene, "count", 0.5)  # from 14 m away a turn by 1e-13 is more than a nanometre
        on_its_side = Rigid.about((0.0, 0.0), 90.0)
        moved = tuple(dataclasses.replace(face, curve=face.curve.moved(on_its_side)) for face in faces)
        check(no_grid, dataclasses.replace(scene, interfaces=moved), "count", 0.5)


def test_one_curve_over_and_over_finds_the_nearest(no_grid: pytest.MonkeyPatch) -> None:
    """A pile of mirrors: a ray must find the first of thousands that stand behind each other, whatever the cells."""
    pile = tuple(
        Interface(f"m{i}", Segment((-5.0, 0.003 * i), (5.0, 0.003 * i)), "air", "air", "mirror") for i in range(2000)
    )
    beams = (Beam((-5.5, -1.0), (5.5, -1.0), 0.0, 500), Beam((-5.5, 7.0), (5.5, 7.0), 180.0, 500))
    scene = Scene((AIR,), pile, (*beams, Fan((0.0, 3.0015), 0.0, 360.0, 500)))
    found, truth = trace(scene, legs=True, limits=LIMITS), without(no_grid, scene, "count")
    assert found.legs is not None
    assert truth.legs is not None
    np.testing.assert_array_equal(found.legs["interface"], truth.legs["interface"])
    hits = found.legs[found.legs["hit"] == 0]
    assert set(hits["interface"][:500].tolist()) == {0, -1}
    assert set(hits["interface"][500:1000].tolist()) == {1999, -1}


def timed(patch: pytest.MonkeyPatch, scene: Scene, fewest: int) -> tuple[float, float, Trace]:
    """Seconds to compile a scene, microseconds per hit, and the trace."""
    with patch.context() as patched:
        patched.setattr(grid, "MIN_PIECES", fewest)
        start = time.perf_counter()
        tables = compile_scene(scene)
        compiled = time.perf_counter()
        patched.setattr(engine, "compile_scene", lambda *_: tables)
        found = trace(scene, "roulette", LIMITS, threads=1)
        return compiled - start, 1e6 * (time.perf_counter() - compiled) / found.hits, found


@pytest.mark.evidence
@pytest.mark.parametrize("kind", ["polygon", "spline", "field"])
def test_five_thousand_curves_are_traced_the_same_and_much_faster(no_grid: pytest.MonkeyPatch, kind: str) -> None:
    few, less, many = (
        many_bodies(5, 32, 32, rays) if kind == "field" else many_sided(5000, 5, kind, rays)
        for rays in (400, 4000, 200_000)
    )
    check(no_grid, few, "roulette", 0.6)
    compiling, fast, found = timed(no_grid, many, grid.MIN_PIECES)
    _, slow, truth = timed(no_grid, less, NEVER)
    pieces = len(compile_scene(few).kind)
    print(
        f"\n  grid, {kind}: {len(few.interfaces)} curves in {pieces} pieces: {fast:.2f} µs per hit with a grid, "
        f"{slow:.0f} without, {slow / fast:.0f} times as fast; compiled in {compiling:.1f} s"
    )
    assert pieces >= 4000
    assert fast < 0.5 * slow
    for name, reading in truth.detectors.items():
        assert found.detectors[name].power == pytest.approx(reading.power, abs=4 * math.hypot(reading.u_power, 1e-4))


def test_few_curves_need_no_grid_and_many_have_one() -> None:
    assert len(compile_scene(many_sided(grid.MIN_PIECES - 2, 1, "polygon", 2)).grid_item) == 0
    assert len(compile_scene(many_sided(grid.MIN_PIECES - 1, 1, "polygon", 2)).grid_item) > 0
    nothing = Scene((AIR,), (), (Fan((0.0, 0.0), 0.0, 360.0, 3),))
    assert trace(nothing).ledger.escaped == pytest.approx(1.0)
