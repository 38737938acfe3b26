"""Light finds its way back: ray by ray, and in sum between two extended emitters.

Snell's and Fresnel's laws do not tell the two ways apart: what is left of a ray's power between two points, in either
polarisation, is the same from either end. In sum that means, between two lines in one medium that both emit evenly in
the sine of the angle (so evenly in étendue), that the étendue times the share that arrives is the same both ways.
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
from solen.plane import Point, Rigid, along, left_of, minus, unit
from solen.scene import Interface, Rays, Region, Scene
from solen.scene.sources import Placed, Source
from solen.trace import Limits, Trace, trace, trace_reference
from solen.trace.result import DETECTED
from tests.agreement.compare_support import Key, stretches
from tests.agreement.random_scene_support import many_bodies, motley_scene
from tests.agreement.scenes_support import AIR, glass

Tracer = Callable[..., Trace]
THERE, BACK = Limits(min_weight=3e-4, max_hits=14), Limits(min_weight=1e-5, max_hits=30)
ENDS_MM = 1e-6
"""How far before its end on a receiver a way is turned round, or halfway along its last stretch."""
ARRIVES_MM = 1e-7
"""How near to its start a way must come back: rounding grows at every interface."""


@dataclass(frozen=True)
class Way:
    """Interfaces met, start and direction of the first straight stretch, end, direction and length of the last one, and
    the shares of s and p that are left."""

    interfaces: tuple[int, ...]
    start: Point
    direction: Point
    end: Point
    arriving: Point
    length_mm: float
    s: float
    p: float


def ways(result: Trace) -> dict[int, list[Way]]:
    """Every way from a launch to the end of any stretch, by ray."""
    assert result.legs is not None
    legs = dict(zip(stretches(result), result.legs, strict=True))
    found: dict[int, list[Way]] = {}
    for key, leg in legs.items():
        chain = [leg]
        at = key
        while at[-1] > 0:
            at = before(at, legs)
            chain.insert(0, legs[at])
        first = chain[0]
        length = min(float(leg["length_mm"]), 1e6)
        arriving = (float(leg["dx"]), float(leg["dz"]))
        found.setdefault(key[0], []).append(
            Way(
                tuple(int(part["interface"]) for part in chain),
                (float(first["x_mm"]), float(first["z_mm"])),
                (float(first["dx"]), float(first["dz"])),
                along((float(leg["x_mm"]), float(leg["z_mm"])), arriving, length),
                arriving,
                length,
                float(leg["power_s"] * leg["kept"] / first["power_s"]) if first["power_s"] > 0 else 0.0,
                float(leg["power_p"] * leg["kept"] / first["power_p"]) if first["power_p"] > 0 else 0.0,
            )
        )
    return found


def before(key: Key, legs: dict[Key, np.void]) -> Key:
    """The stretch before one: of the same branch, or of the one that it was split off."""
    above, hit = key[:-1], key[-1] - 1
    return above if len(above) > 1 and above[-1] == hit and above in legs else (*above, hit)


def received(result: Trace) -> list[Way]:
    """Ways that end on a receiver after at least one other interface."""
    assert result.legs is not None
    detected = {i for i in range(len(result.legs)) if result.legs["fate"][i] == DETECTED}
    order = [way for _, group in sorted(ways(result).items()) for way in group]
    assert len(order) == len(result.legs)
    return [order[i] for i in sorted(detected) if len(order[i].interfaces) > 1]


def passing(way: Way, back: Way) -> float:
    """How near a way back, whose last stretch leads on from the first interface of a way, comes to its start."""
    offset = minus(way.start, along(back.end, back.arriving, -1.0))
    return abs(offset[0] * back.arriving[1] - offset[1] * back.arriving[0])


def reciprocal(scene: Scene, tracer: Tracer, most: int, limits: Limits = THERE) -> FloatArray:
    """Of the ways to receivers (N, 2): how far the way back misses, and how far the powers deviate."""
    source = Rays(*_fan(scene, most), s_share=0.5)
    there = received(tracer(dataclasses.replace(scene, sources=(source,), monitors=()), "power", limits, legs=True))
    there = there[:: max(len(there) // 60, 1)]
    if not there:
        return np.empty((0, 2))
    turned = Rays(
        tuple(along(way.end, way.arriving, -min(ENDS_MM, 0.5 * way.length_mm)) for way in there),
        tuple((-way.arriving[0], -way.arriving[1]) for way in there),
    )
    result = tracer(dataclasses.replace(scene, sources=(turned,), monitors=()), "power", BACK, legs=True)
    back = ways(result)
    found = []
    for ray, way in enumerate(there):
        wanted = way.interfaces[-2::-1]
        candidates = [
            other for other in back[ray] if other.interfaces[:-1] == wanted and passing(way, other) < ARRIVES_MM
        ]
        assert candidates, f"no way back along {way}"
        best = min(candidates, key=lambda other: math.dist(other.arriving, _against(way.direction)))
        missed = max(passing(way, best), math.dist(best.arriving, _against(way.direction)))
        lossless = _before_last(result, ray, best)
        found.append((missed, max(abs(lossless[0] / way.s - 1.0), abs(lossless[1] / way.p - 1.0))))
    return np.array(found)


def judged(found: FloatArray, least: int) -> str:
    """Nearly all ways come back to rounding, and then with the same power; the others as far as they do."""
    missed, deviation = found.T
    exact = missed < 1e-10
    line = (
        f"{len(found)} ways lead back, {exact.mean():.1%} of them to 1e-10, with powers off by at most "
        f"{deviation[exact].max():.1e}; the others miss by at most {missed.max():.1e} mm, powers {deviation.max():.1e}"
    )
    assert len(found) >= least, line
    assert exact.mean() > 0.9, line
    assert deviation[exact].max() < 1e-9, line
    assert np.all(deviation < 1e-9 + 10.0 * missed), line
    return line


def _against(direction: Point) -> Point:
    return (-direction[0], -direction[1])


def _before_last(result: Trace, ray: int, way: Way) -> tuple[float, float]:
    """Shares of power at the beginning of the last stretch of a way back: it ends beyond where the way began."""
    assert result.legs is not None
    mine = result.legs[result.legs["ray"] == ray]
    (leg,) = [leg for leg in mine if (leg["dx"], leg["dz"]) == way.arriving and _ends(leg) == way.end]
    return float(2.0 * leg["power_s"] * result.rays), float(2.0 * leg["power_p"] * result.rays)


def _ends(leg: np.void) -> Point:
    length = min(float(leg["length_mm"]), 1e6)
    return along((float(leg["x_mm"]), float(leg["z_mm"])), (float(leg["dx"]), float(leg["dz"])), length)


def _fan(scene: Scene, rays: int) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
    launches = [source.launch() for source in scene.sources]
    origins = [(float(x), float(z)) for launch in launches for x, z in zip(launch.x_mm, launch.z_mm, strict=True)]
    directions = [(float(x), float(z)) for launch in launches for x, z in zip(launch.dx, launch.dz, strict=True)]
    step = max(len(origins) // rays, 1)
    return tuple(origins[::step]), tuple(directions[::step])


def clear(scene: Scene) -> Scene:
    """Without absorption: the way back runs on beyond the start, and what a medium takes there is not of interest."""
    regions = tuple(dataclasses.replace(region, absorption_per_mm=0.0) for region in scene.regions)
    return dataclasses.replace(scene, regions=regions)


def test_every_way_to_a_receiver_leads_back_with_the_same_power() -> None:
    judged(np.vstack([reciprocal(clear(motley_scene(seed, 40)), trace, 160) for seed in (2, 4, 8, 10)]), 100)


def test_every_way_to_a_receiver_leads_back_in_the_reference_too() -> None:
    judged(reciprocal(clear(motley_scene(2, 8)), trace_reference, 24), 10)


@pytest.mark.evidence
def test_ways_of_a_hundred_scenes_lead_back_with_the_same_power() -> None:
    found = [reciprocal(clear(motley_scene(seed, 100)), trace, 400) for seed in range(3000, 3200, 2)]
    few_hits = Limits(min_weight=3e-3, max_hits=7)  # on its way through a field light soon is chaotic
    found.append(reciprocal(clear(many_bodies(7, 6, 6, 2000)), trace, 2000, few_hits))
    print(f"\n  reciprocity, 101 scenes: {judged(np.vstack(found), 5000)}")


@dataclass(frozen=True)
class Glow(Source):
    """Line from ``start`` to ``end`` that emits to its left, evenly in place and in the sine of the angle."""

    start: Point
    end: Point
    rays: int

    @property
    def shape_dimensions(self) -> int:
        return 2

    def place(self, u: FloatArray) -> Placed:
        (tx, tz), (nx, nz) = (turn(unit(minus(self.end, self.start))) for turn in (Rigid().vector, left_of))
        sine, share = 2.0 * u[:, 0] - 1.0, u[:, 1]
        cosine = np.sqrt(1.0 - sine * sine)
        x, z = (
            (1.0 - share) * a + share * b + 1e-9 * n for a, b, n in zip(self.start, self.end, (nx, nz), strict=True)
        )
        return x, z, sine * tx + cosine * nx, sine * tz + cosine * nz


LINES: dict[str, tuple[tuple[Point, Point], tuple[Point, Point]]] = {
    "equal lines": (((-1.0, -6.0), (1.0, -6.0)), ((2.5, 6.2), (0.7, 7.1))),
    "a short line and a long one": (((-0.4, -5.0), (-0.1, -5.2)), ((3.0, 6.0), (-1.5, 6.5))),
}


def between(kind: str) -> tuple[tuple[Region, ...], tuple[Interface, ...]]:
    """Something to refract and reflect between two lines."""
    outlines: dict[str, list[Curve]] = {
        "conics": [
            Conic((0.0, -2.0), (0.0, 1.0), 0.2, -0.8, -3.0, 3.0),
            Conic((0.0, 2.0), (0.0, -1.0), 0.1, 1.0, -3.0, 3.0),
        ],
        "an oval": [CartesianOval((0.0, -2.0), (0.0, 1.0), 1.0, 1.5, 2.0, 20.0, 30.0, -30.0)],
        "a closed spline": [
            Spline.through([(-3.0, -1.0), (0.0, -3.0), (2.5, -1.5), (3.0, 1.0), (0.0, 2.5), (-2.0, 1.5)], closed=True)
        ],
    }
    curves = outlines[kind]
    if kind == "conics":
        front, back = curves
        curves = [front, Segment(front.end, back.start), back, Segment(back.end, front.start)]
    elif kind == "an oval":
        (oval,) = curves
        curves = [oval, Spline.through([oval.end, (2.2, 1.0), (0.3, 2.0), (-2.2, 1.5), oval.start])]
    faces = tuple(Interface(f"c{i}", curve, "glass", "air") for i, curve in enumerate(curves))
    mirror = Interface("mirror", Arc((0.0, 0.0), 8.0, 130.0, 80.0), "air", "air", "mirror")
    return (AIR, glass(1.5, 0.05)), (*faces, mirror)


def exchanged(kind: str, lines: str, rays: int, mode: Literal["power", "roulette"]) -> tuple[float, float, float]:
    """Share from A to B, that from B to A times the étendue of B over that of A, and the standard error of both."""
    regions, faces = between(kind)
    a, b = LINES[lines]
    eyes = tuple(Interface(name, Segment(*line), "air", "air", "receiver", name) for name, line in (("a", a), ("b", b)))
    found = [
        trace(
            Scene(regions, (*faces, *eyes), (Glow(*line, rays),)),
            mode,
            Limits(min_weight=1e-4, max_hits=60),
            sampling="sobol",
            seed=seed,
        ).detectors[to]
        for seed, line, to in ((1, a, "b"), (2, b, "a"))
    ]
    share = math.dist(*b) / math.dist(*a)
    return found[0].power, share * found[1].power, math.hypot(found[0].u_power, share * found[1].u_power)


@pytest.mark.parametrize("lines", LINES)
@pytest.mark.parametrize("kind", ["conics", "an oval", "a closed spline"])
@pytest.mark.parametrize("mode", ["power", "roulette"])
def test_as_much_goes_from_a_to_b_as_from_b_to_a(kind: str, lines: str, mode: Literal["power", "roulette"]) -> None:
    there, back, u = exchanged(kind, lines, 2**14, mode)
    assert there > 20 * u > 0.0
    assert abs(there - back) < 4.0 * u


@pytest.mark.evidence
def test_as_much_goes_either_way_to_five_digits() -> None:
    for kind in ("conics", "an oval", "a closed spline"):
        for lines in LINES:
            there, back, u = exchanged(kind, lines, 2**21, "power")
            print(f"\n  {kind}, {lines}: {there:.6f} there, {back:.6f} back, standard error {u:.1e}")
            assert abs(there - back) < 4.0 * u
