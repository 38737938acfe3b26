"""The compiled hits of cubic pieces, against the roots of their polynomials and against what must not happen."""

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
    """Simple pieces of cubics with random control points: bent at random, and run through at uneven speed."""
    rng = np.random.default_rng(seed)
    found: list[Control] = []
    while len(found) < curves:
        a, b, c, d = ((float(x), float(z)) for x, z in rng.uniform(-1, 1, (4, 2)))
        try:
            found += [piece.control for piece in simple_pieces((a, b, c, d))]
        except DesignError:
            continue
    return found


def searched(control: Control, origin: Point, direction: Point, without: float | None) -> float:
    """Distance of the nearest root ahead, by a general solver, without the one nearest to a parameter."""
    (x, z), (dx, dz) = origin, direction
    f = [dx * (pz - z) - dz * (px - x) for px, pz in control]
    polynomial = [f[0], 3 * (f[1] - f[0]), 3 * (f[2] - 2 * f[1] + f[0]), f[3] - 3 * f[2] + 3 * f[1] - f[0]]
    roots = [float(root.real) for root in np.roots(polynomial[::-1]) if abs(root.imag) < 1e-9]
    if without is not None:
        roots.remove(min(roots, key=lambda root: abs(root - without)))
    places = [point_at(control, root) for root in roots if -1e-12 <= root <= 1.0 + 1e-12]
    return min((t for px, pz in places if (t := (px - x) * dx + (pz - z) * dz) > 0.0), default=math.inf)


def both(control: Control, origin: Point, direction: Point, at: float | None) -> tuple[float, float]:
    """The compiled distance and the one searched."""
    numbers = [number for point in control for number in point]
    row = Cubic(*numbers, 0.0, 0.0, 0.0, 1.0)  # type: ignore[call-arg]  # eight numbers of four points
    found, _ = cubic_hit(K, row, *origin, *direction, at is not None, at or 0.0, 0.0)
    return found, searched(control, origin, direction, at)


@pytest.mark.parametrize("standing", [True, False])
def test_hits_of_simple_pieces_are_the_roots_of_their_polynomials(standing: bool) -> None:
    """A ray that stands on a piece knows one root; where the two others are complex, it meets the piece no more."""
    rng = np.random.default_rng(5)
    for control in random_pieces(1, 4000):
        turn, u = float(rng.uniform(0, math.tau)), float(rng.uniform(0.001, 0.999))
        direction = (math.cos(turn), math.sin(turn))
        x, z = point_at(control, u)
        back = 0.0 if standing else float(rng.uniform(0.01, 2.0))
        origin = (x - back * direction[0], z - back * direction[1])
        found, asked = both(control, origin, direction, u if standing else None)
        assert found == asked or found == pytest.approx(asked, abs=1e-7), control


@pytest.mark.parametrize("direction", [(1.0, 0.0), (-1.0, 0.0)])
def test_a_ray_along_a_straight_beginning_meets_the_rest(direction: Point) -> None:
    """The first three control points on one line: along it, what lies beside the ray has a triple root at the start."""
    curve = Bezier((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (3.0, 1.0))
    for way in (curve, curve.reversed()):
        face = Interface("face", way, "air", "air", "absorbing")
        scene = Scene((AIR,), (face,), (Rays(((1.5 - 9.0 * direction[0], 0.5),), (direction,)),))
        for tracer in (trace, trace_reference):
            assert tracer(scene).ledger.absorbed == 1.0


def test_pieces_continue_each_other_but_not_round_corners() -> None:
    """What stands on a joint stands on both pieces if the curve is smooth there; beside a corner it meets the other."""
    smooth = Spline.through([(0.0, 0.0), (3.0, 0.2), (3.3, 3.0), (0.1, 3.4)], closed=True)
    sharp = Spline(((0.0, 0.0), (1.0, 0.1), (2.0, 0.1), (3.0, 0.0), (3.1, 1.0), (2.9, 2.0), (3.0, 3.0)))
    for curve, corners in ((smooth, 0), (sharp, 1)):
        face = Interface("face", curve, "air", "air", "mirror")
        before = compile_scene(Scene((AIR,), (face,), (Fan((1.0, 1.0), 0.0, 10.0, 1),))).before
        ends = 0 if curve.closed else 1
        assert np.sum(before < 0) == corners + ends


@pytest.mark.parametrize("near_mm", [1e-12, 5e-12, 1e-11, 1e-9])
def test_a_ray_in_a_corner_of_one_spline_meets_both_sides(near_mm: float) -> None:
    """Two mirrors at a right angle, one curve: light goes back the way it came, however near to the corner."""
    sides = Spline(((0.0, 2.0), (0.0, 1.5), (0.0, 1.0), (0.0, 0.0), (1.0, 0.0), (1.5, 0.0), (2.0, 0.0)))
    face = Interface("corner", sides, "air", "air", "mirror")
    source = Rays(((1.0 + near_mm, 1.0), (1.0, 1.0 + near_mm)), ((-1.0, -1.0), (-1.0, -1.0)))
    for tracer in (trace, trace_reference):
        for path in tracer(Scene((AIR,), (face,), (source,)), legs=True).paths():
            assert path.exit_direction == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)), abs=1e-12)
            assert path.interfaces == (0, 0)


def test_in_roulette_what_leaves_into_an_absorbing_medium_for_ever_is_absorbed() -> None:
    smoke = Region("smoke", 1.0, 0.25)
    face = Interface("face", Bezier((-3.0, 0.0), (-1.0, 0.0), (1.0, 0.0), (3.0, 0.0)), "smoke", "air")
    scene = Scene((AIR, smoke), (face,), (Fan((0.0, -1.0), 0.0, 60.0, 7),), open_media=True)
    for tracer in (trace, trace_reference):
        assert tracer(scene, "roulette", Limits()).ledger.absorbed == pytest.approx(1.0, abs=1e-15)
