"""Every row of ``raytrace/analytic_reference.csv``, answered by tracing: single rays to 1e-9, fan fractions to 2/N.

What a row asks for is found by rays alone: a critical angle, a lens's edge and Brewster's angle by bisection over the
launch angle, a paraxial focus by extrapolation of two heights.
"""

import csv
import math
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from solen.curve import Arc, Segment
from solen.lens.optics import OvalLens
from solen.plane import Point, along, cross, dot
from solen.scene import Fan, Interface, Monitor, Rays, Region, Scene
from solen.scene.sources import Source
from solen.trace import Limits, trace
from solen.trace import Path as Way

AIR = Region("air", 1.0)
FINE = Limits(min_weight=1e-15)
RAYS = 20_000
FAN = 2 / RAYS
SINGLE = 1e-9


def aimed(origin: Point, angle_deg: float, s_share: float = 0.5) -> Rays:
    angle = math.radians(angle_deg)
    return Rays((origin,), ((-math.sin(angle), math.cos(angle)),), s_share=s_share)


def half_space(n: float, source: Source, *, from_glass: bool = False) -> Scene:
    """A flat surface at z = 0, glass above it or (``from_glass``) below; a monitor beyond it."""
    sides = ("air", "glass") if from_glass else ("glass", "air")
    surface = Interface("surface", Segment((-1e3, 0.0), (1e3, 0.0)), *sides)
    beyond = Monitor("beyond", (-1e3, 1e-3), (1e3, 1e-3))
    return Scene((AIR, Region("glass", n)), (surface,), (source,), (beyond,), open_media=True)


def bisected(low: float, high: float, is_low: Callable[[float], bool]) -> float:
    """Last value on the low side."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_low(middle) else (low, middle)
    return low


def only(scene: Scene) -> Way:
    (way,) = trace(scene, "count", legs=True).paths()
    return way


def exit_of(way: Way) -> Point:
    assert way.exit_direction is not None
    return way.exit_direction


def critical_deg(n: float) -> float:
    """Largest angle in glass at which a ray gets out."""

    def leaves(angle_deg: float) -> bool:
        return exit_of(only(half_space(n, aimed((0.0, -1.0), angle_deg), from_glass=True)))[1] > 0

    return bisected(1.0, 89.0, leaves)


def transmitted(n: float, angle_deg: float, s_share: float) -> float:
    return trace(half_space(n, aimed((0.0, -1.0), angle_deg, s_share)), "power", FINE).monitors["beyond"].power


def brewster_deg(n: float) -> float:
    """Where the reflected and the refracted ray are at right angles."""

    def obtuse(angle_deg: float) -> bool:
        ways = trace(half_space(n, aimed((0.0, -1.0), angle_deg, 1.0)), "power", FINE, legs=True).paths()
        first, second = (exit_of(way) for way in ways)
        return dot(first, second) < 0

    angle_deg = bisected(30.0, 80.0, obtuse)
    assert transmitted(n, angle_deg, 0.0) == pytest.approx(1.0, abs=1e-12)
    return angle_deg


def prism_deg(n: float) -> float:
    """Deviation of the ray that passes a 60 degree prism symmetrically; its neighbours are deviated more."""
    apex, left, right = (0.0, math.sqrt(3.0)), (-1.0, 0.0), (1.0, 0.0)
    sides = ((left, right), (right, apex), (apex, left))
    faces = tuple(Interface(f"face-{i}", Segment(a, b), "glass", "air") for i, (a, b) in enumerate(sides))

    def deviation(incidence: float) -> float:
        direction = (math.cos(incidence - math.pi / 6), math.sin(incidence - math.pi / 6))
        source = Rays((along((-0.5, 0.5 * math.sqrt(3.0)), direction, -1.0),), (direction,))
        out = exit_of(only(Scene((AIR, Region("glass", n)), faces, (source,))))
        return math.degrees(math.atan2(abs(cross(direction, out)), dot(direction, out)))

    symmetric = math.asin(n / 2)
    assert min(deviation(symmetric - 0.01), deviation(symmetric + 0.01)) > deviation(symmetric)
    return deviation(symmetric)


def back_focus(n: float) -> float:
    """Of a ball of diameter 1, extrapolated to the axis from two heights."""
    ball = (Interface("ball", Arc.circle((0.0, 0.0), 0.5), "glass", "air"),)

    def focus(height: float) -> float:
        way = only(Scene((AIR, Region("glass", n)), ball, (aimed((height, -2.0), 0.0),)))
        (x, z), (dx, dz) = way.points_mm[-1], exit_of(way)
        return float(z - x * dz / dx - 0.5)

    return (4 * focus(1e-3) - focus(2e-3)) / 3


def slab(n: float, source: Source) -> Scene:
    corners = [(-1e3, 0.0), (1e3, 0.0), (1e3, 1.0), (-1e3, 1.0)]
    faces = tuple(Interface(f"face-{i}", Segment(corners[i - 1], corners[i]), "glass", "air") for i in range(4))
    return Scene((AIR, Region("glass", n)), faces, (source,), (Monitor("behind", (-1e3, 2.0), (1e3, 2.0)),))


def slab_transmittance(n: float) -> float:
    return trace(slab(n, aimed((0.0, -1.0), 0.0)), "power", FINE).monitors["behind"].power


def one_face(n: float) -> float:
    """Of a fan all round in the glass, the share that leaves by one face."""
    source = Fan((0.0, -0.4), 0.0, 360.0, RAYS)
    return trace(half_space(n, source, from_glass=True), "count").monitors["beyond"].power


def solid_share(n: float) -> float:
    """The same in space, of the cone that the traced critical angle spans."""
    return (1 - math.cos(math.radians(critical_deg(n)))) / 2


def aperture(n: float) -> float:
    """NA of a guide whose walls reflect totally from the traced critical angle on."""
    return n * math.cos(math.radians(critical_deg(n)))


def lens(n: float, source: Source) -> Scene:
    """The oval alone before a black back that receives what enters."""
    front = OvalLens(1.0, 20.0, 2.0, n).front
    back = Interface("back", Segment(front.end, front.start), "glass", "air", "receiver", "inside")
    return Scene((AIR, Region("glass", n)), (Interface("front", front, "glass", "air"), back), (source,))


def edge_deg(n: float) -> float:
    """Largest launch angle that still meets the lens from before it."""

    def meets(angle_deg: float) -> bool:
        interfaces = only(lens(n, aimed((0.0, -1.0), angle_deg))).interfaces
        return bool(interfaces) and interfaces[0] == 0

    return bisected(10.0, 60.0, meets)


def edge_transmittance(n: float) -> float:
    scene = lens(n, aimed((0.0, -1.0), edge_deg(n) - 1e-9))
    return trace(scene, "power", FINE).detectors["inside"].power


def entering(n: float) -> float:
    return trace(lens(n, Fan((0.0, -1.0), 0.0, 120.0, RAYS)), "count").detectors["inside"].power


def entering_power(n: float) -> float:
    return trace(lens(n, Fan((0.0, -1.0), 0.0, 120.0, RAYS)), "power").detectors["inside"].power


QUANTITIES: tuple[tuple[str, Callable[[float], float], float], ...] = (
    ("critical angle deg", critical_deg, SINGLE),
    ("Fresnel T normal", lambda n: transmitted(n, 0.0, 0.5), SINGLE),
    ("Fresnel T 45deg s", lambda n: transmitted(n, 45.0, 1.0), SINGLE),
    ("Fresnel T 45deg p", lambda n: transmitted(n, 45.0, 0.0), SINGLE),
    ("3D escape-cone fraction", solid_share, SINGLE),
    ("2D escape-cone fraction", one_face, FAN),
    ("slab guide NA", aperture, SINGLE),
    ("Brewster deg", brewster_deg, SINGLE),
    ("prism 60deg minimum deviation", prism_deg, SINGLE),
    ("ball lens D=1 BFL", back_focus, SINGLE),
    ("incoherent slab T", slab_transmittance, SINGLE),
    ("edge ray angle deg", edge_deg, SINGLE),
    ("fraction of a uniform 2D", entering, FAN),
    ("same, unpolarised Fresnel-weighted", entering_power, FAN),
    ("unpolarised Fresnel T at the edge", edge_transmittance, SINGLE),
)


def answer(quantity: str) -> tuple[float, float]:
    """What solen traces for a row, and the tolerance; every row has exactly one answer."""
    (found,) = [(trace_it, tolerance) for text, trace_it, tolerance in QUANTITIES if text in quantity]
    index = re.search(r"n=(\d\.\d+)", quantity)
    assert index is not None, quantity
    return found[0](float(index[1])), found[1]


def test_every_row(outside: Path) -> None:
    with (outside / "raytrace" / "analytic_reference.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= 56
    off = []
    for row in rows:
        traced, tolerance = answer(row["quantity"])
        if not abs(traced - float(row["value"])) <= tolerance:
            off.append(f"{row['quantity']}: traced {traced!r}, listed {row['value']}")
    assert not off, "\n".join(off)
