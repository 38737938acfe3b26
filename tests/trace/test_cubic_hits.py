"""Compiled hits of cubic pieces agree with the roots of their polynomials, and joints and corners are met once."""

import math

import numpy as np
import pytest

from solen.curve import Bezier, Spline
from solen.curve.cubic import Control, point_at, simple_pieces
from solen.errors import DesignError
from solen.plane import Point
from solen.scene import Fan, Interface, Rays, Region, Scene
from solen.trace import Limits, trace, trace_reference
from solen.trace.kernel.hits import cubic_hit
from solen.trace.kernel.rows import Cubic, Precision
from solen.trace.tables import compile_scene

K = Precision.of(np.float64)
AIR = Region("air", 1.0)


def random_pieces(seed: int, curves: int) -> list[Control]:
    """Return the simple pieces of cubics with random control points."""
    rng = np.random.default_rng(seed)
    pieces: list[Control] = []
    while len(pieces) < curves:
        a, b, c, d = ((float(x), float(z)) for x, z in rng.uniform(-1, 1, (4, 2)))
        try:
            pieces += [piece.control for piece in simple_pieces((a, b, c, d))]
        except DesignError:
            continue
    return pieces


def expected_hit(control: Control, origin: Point, direction: Point, start_u: float | None) -> float:
    """Return the distance of the nearest root, from a general solver; the root nearest to ``start_u`` is omitted."""
    (x, z), (dx, dz) = origin, direction
    f = [dx * (pz - z) - dz * (px - x) for px, pz in control]
    polynomial = [f[0], 3 * (f[1] - f[0]), 3 * (f[2] - 2 * f[1] + f[0]), f[3] - 3 * f[2] + 3 * f[1] - f[0]]
    roots = [float(root.real) for root in np.roots(polynomial[::-1]) if abs(root.imag) < 1e-9]
    if start_u is not None:
        roots.remove(min(roots, key=lambda root: abs(root - start_u)))
    points = [point_at(control, root) for root in roots if -1e-12 <= root <= 1.0 + 1e-12]
    return min((t for px, pz in points if (t := (px - x) * dx + (pz - z) * dz) > 0.0), default=math.inf)


def compiled_hit(control: Control, origin: Point, direction: Point, start_u: float | None) -> float:
    """Return the distance from the compiled function."""
    numbers = [number for point in control for number in point]
    row = Cubic(*numbers, 0.0, 0.0, 0.0, 1.0)  # type: ignore[call-arg]  # eight numbers of four points
    return float(cubic_hit(K, row, *origin, *direction, start_u is not None, start_u or 0.0, 0.0)[0])


@pytest.mark.parametrize("starts_on_piece", [True, False])
def test_hits_are_the_roots_of_the_polynomial(starts_on_piece: bool) -> None:
    """For a ray that starts on a piece, one root is known; if the other two are complex, there is no hit."""
    rng = np.random.default_rng(5)
    for control in random_pieces(1, 2000):
        angle, u = float(rng.uniform(0, math.tau)), float(rng.uniform(0.001, 0.999))
        direction = (math.cos(angle), math.sin(angle))
        x, z = point_at(control, u)
        distance = 0.0 if starts_on_piece else float(rng.uniform(0.01, 2.0))
        ray = (x - distance * direction[0], z - distance * direction[1]), direction, u if starts_on_piece else None
        actual, expected = compiled_hit(control, *ray), expected_hit(control, *ray)
        assert actual == expected or actual == pytest.approx(expected, abs=1e-7), control


@pytest.mark.parametrize("direction", [(1.0, 0.0), (-1.0, 0.0)])
def test_ray_parallel_to_a_straight_start(direction: Point) -> None:
    """The first three control points are on a line, so that the polynomial for its direction has a triple root."""
    spline = Bezier((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (3.0, 1.0))
    for curve in (spline, spline.reversed()):
        face = Interface("face", curve, "air", "air", "absorbing")
        scene = Scene((AIR,), (face,), (Rays(((1.5 - 9.0 * direction[0], 0.5),), (direction,)),))
        for tracer in (trace, trace_reference):
            assert tracer(scene).ledger.absorbed == 1.0


def test_pieces_continue_at_smooth_joints_but_not_at_corners() -> None:
    smooth = Spline.through([(0.0, 0.0), (3.0, 0.2), (3.3, 3.0), (0.1, 3.4)], closed=True)
    sharp = Spline(((0.0, 0.0), (1.0, 0.1), (2.0, 0.1), (3.0, 0.0), (3.1, 1.0), (2.9, 2.0), (3.0, 3.0)))
    for curve, corners in ((smooth, 0), (sharp, 1)):
        face = Interface("face", curve, "air", "air", "mirror")
        previous = compile_scene(Scene((AIR,), (face,), (Fan((1.0, 1.0), 0.0, 10.0, 1),))).previous
        ends = 0 if curve.closed else 1
        assert np.sum(previous < 0) == corners + ends


@pytest.mark.parametrize("distance_mm", [1e-12, 5e-12, 1e-11, 1e-9])
def test_ray_in_a_corner_of_a_spline_meets_both_sides(distance_mm: float) -> None:
    """Two mirrors at a right angle return light in the opposite direction, even next to the corner."""
    sides = Spline(((0.0, 2.0), (0.0, 1.5), (0.0, 1.0), (0.0, 0.0), (1.0, 0.0), (1.5, 0.0), (2.0, 0.0)))
    face = Interface("corner", sides, "air", "air", "mirror")
    source = Rays(((1.0 + distance_mm, 1.0), (1.0, 1.0 + distance_mm)), ((-1.0, -1.0), (-1.0, -1.0)))
    for tracer in (trace, trace_reference):
        for path in tracer(Scene((AIR,), (face,), (source,)), segments=True).paths():
            assert path.exit_direction == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)), abs=1e-12)
            assert path.interfaces == (0, 0)


def test_light_in_an_unbounded_absorbing_medium_is_absorbed_in_roulette() -> None:
    smoke = Region("smoke", 1.0, 0.25)
    face = Interface("face", Bezier((-3.0, 0.0), (-1.0, 0.0), (1.0, 0.0), (3.0, 0.0)), "smoke", "air")
    scene = Scene((AIR, smoke), (face,), (Fan((0.0, -1.0), 0.0, 60.0, 7),), open_media=True)
    for tracer in (trace, trace_reference):
        assert tracer(scene, "roulette", Limits()).ledger.absorbed == pytest.approx(1.0, abs=1e-15)
