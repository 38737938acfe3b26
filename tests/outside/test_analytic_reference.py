"""Every row of ``raytrace/analytic_reference.csv``, reproduced by tracing: single rays to 1e-9, fan fractions to 2/N.

Each quantity is determined from rays alone: the critical angle, the edge of a lens and the Brewster angle by bisection
of the launch angle, the paraxial focus by extrapolation from two heights.
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
from solen.trace import Path as RayPath

AIR = Region("air", 1.0)
LIMITS = Limits(min_weight=1e-15)
RAYS = 20_000
FAN_TOLERANCE = 2 / RAYS
RAY_TOLERANCE = 1e-9


def ray(origin: Point, angle_deg: float, s_share: float = 0.5) -> Rays:
    angle = math.radians(angle_deg)
    return Rays((origin,), ((-math.sin(angle), math.cos(angle)),), s_share=s_share)


def half_space(n: float, source: Source, *, from_glass: bool = False) -> Scene:
    """Return a flat surface at z = 0, with glass above it (below with ``from_glass``) and a monitor behind it."""
    sides = ("air", "glass") if from_glass else ("glass", "air")
    surface = Interface("surface", Segment((-1e3, 0.0), (1e3, 0.0)), *sides)
    monitor = Monitor("beyond", (-1e3, 1e-3), (1e3, 1e-3))
    return Scene((AIR, Region("glass", n)), (surface,), (source,), (monitor,), open_media=True)


def last_on_low_side(low: float, high: float, is_low: Callable[[float], bool]) -> float:
    """Return the limit up to which ``is_low`` is true, by bisection."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_low(middle) else (low, middle)
    return low


def only_path_of(scene: Scene) -> RayPath:
    (path,) = trace(scene, "count", segments=True).paths()
    return path


def exit_direction(path: RayPath) -> Point:
    assert path.exit_direction is not None
    return path.exit_direction


def critical_deg(n: float) -> float:
    """Return the largest angle in glass at which a ray leaves."""

    def leaves(angle_deg: float) -> bool:
        return exit_direction(only_path_of(half_space(n, ray((0.0, -1.0), angle_deg), from_glass=True)))[1] > 0

    return last_on_low_side(1.0, 89.0, leaves)


def transmittance(n: float, angle_deg: float, s_share: float) -> float:
    return trace(half_space(n, ray((0.0, -1.0), angle_deg, s_share)), "power", LIMITS).monitors["beyond"].power


def brewster_deg(n: float) -> float:
    """Return the angle at which the reflected and the refracted ray are perpendicular."""

    def is_obtuse(angle_deg: float) -> bool:
        paths = trace(half_space(n, ray((0.0, -1.0), angle_deg, 1.0)), "power", LIMITS, segments=True).paths()
        first, second = (exit_direction(path) for path in paths)
        return dot(first, second) < 0

    angle_deg = last_on_low_side(30.0, 80.0, is_obtuse)
    assert transmittance(n, angle_deg, 0.0) == pytest.approx(1.0, abs=1e-12)
    return angle_deg


def prism_deviation_deg(n: float) -> float:
    """Return the deviation of the ray that passes a 60° prism symmetrically; neighbouring rays are deviated more."""
    apex, left, right = (0.0, math.sqrt(3.0)), (-1.0, 0.0), (1.0, 0.0)
    sides = ((left, right), (right, apex), (apex, left))
    faces = tuple(Interface(f"face-{i}", Segment(a, b), "glass", "air") for i, (a, b) in enumerate(sides))

    def deviation(incidence: float) -> float:
        direction = (math.cos(incidence - math.pi / 6), math.sin(incidence - math.pi / 6))
        source = Rays((along((-0.5, 0.5 * math.sqrt(3.0)), direction, -1.0),), (direction,))
        outgoing = exit_direction(only_path_of(Scene((AIR, Region("glass", n)), faces, (source,))))
        return math.degrees(math.atan2(abs(cross(direction, outgoing)), dot(direction, outgoing)))

    symmetric = math.asin(n / 2)
    assert min(deviation(symmetric - 0.01), deviation(symmetric + 0.01)) > deviation(symmetric)
    return deviation(symmetric)


def back_focal_length(n: float) -> float:
    """Return the back focal length of a ball of diameter 1, extrapolated to the axis from two heights."""
    ball = (Interface("ball", Arc.circle((0.0, 0.0), 0.5), "glass", "air"),)

    def focus(height: float) -> float:
        path = only_path_of(Scene((AIR, Region("glass", n)), ball, (ray((height, -2.0), 0.0),)))
        (x, z), (dx, dz) = path.points_mm[-1], exit_direction(path)
        return float(z - x * dz / dx - 0.5)

    return (4 * focus(1e-3) - focus(2e-3)) / 3


def slab(n: float, source: Source) -> Scene:
    corners = [(-1e3, 0.0), (1e3, 0.0), (1e3, 1.0), (-1e3, 1.0)]
    faces = tuple(Interface(f"face-{i}", Segment(corners[i - 1], corners[i]), "glass", "air") for i in range(4))
    return Scene((AIR, Region("glass", n)), faces, (source,), (Monitor("behind", (-1e3, 2.0), (1e3, 2.0)),))


def slab_transmittance(n: float) -> float:
    return trace(slab(n, ray((0.0, -1.0), 0.0)), "power", LIMITS).monitors["behind"].power


def escape_fraction_2d(n: float) -> float:
    """Return the fraction of a full fan in glass that leaves through one face."""
    source = Fan((0.0, -0.4), 0.0, 360.0, RAYS)
    return trace(half_space(n, source, from_glass=True), "count").monitors["beyond"].power


def escape_fraction_3d(n: float) -> float:
    """Return the same fraction in space, from the cone of the traced critical angle."""
    return (1 - math.cos(math.radians(critical_deg(n)))) / 2


def numerical_aperture(n: float) -> float:
    """Return the NA of a guide whose walls reflect totally beyond the traced critical angle."""
    return n * math.cos(math.radians(critical_deg(n)))


def lens(n: float, source: Source) -> Scene:
    """Return the oval alone, in front of a black back that receives the light that enters."""
    front = OvalLens(1.0, 20.0, 2.0, n).front
    back = Interface("back", Segment(front.end, front.start), "glass", "air", "receiver", "inside")
    return Scene((AIR, Region("glass", n)), (Interface("front", front, "glass", "air"), back), (source,))


def edge_angle_deg(n: float) -> float:
    """Return the largest launch angle at which a ray is incident on the front of the lens."""

    def meets(angle_deg: float) -> bool:
        interfaces = only_path_of(lens(n, ray((0.0, -1.0), angle_deg))).interfaces
        return bool(interfaces) and interfaces[0] == 0

    return last_on_low_side(10.0, 60.0, meets)


def edge_transmittance(n: float) -> float:
    scene = lens(n, ray((0.0, -1.0), edge_angle_deg(n) - 1e-9))
    return trace(scene, "power", LIMITS).detectors["inside"].power


def entering_fraction(n: float) -> float:
    return trace(lens(n, Fan((0.0, -1.0), 0.0, 120.0, RAYS)), "count").detectors["inside"].power


def entering_power_fraction(n: float) -> float:
    return trace(lens(n, Fan((0.0, -1.0), 0.0, 120.0, RAYS)), "power").detectors["inside"].power


QUANTITIES: tuple[tuple[str, Callable[[float], float], float], ...] = (
    ("critical angle deg", critical_deg, RAY_TOLERANCE),
    ("Fresnel T normal", lambda n: transmittance(n, 0.0, 0.5), RAY_TOLERANCE),
    ("Fresnel T 45deg s", lambda n: transmittance(n, 45.0, 1.0), RAY_TOLERANCE),
    ("Fresnel T 45deg p", lambda n: transmittance(n, 45.0, 0.0), RAY_TOLERANCE),
    ("3D escape-cone fraction", escape_fraction_3d, RAY_TOLERANCE),
    ("2D escape-cone fraction", escape_fraction_2d, FAN_TOLERANCE),
    ("slab guide NA", numerical_aperture, RAY_TOLERANCE),
    ("Brewster deg", brewster_deg, RAY_TOLERANCE),
    ("prism 60deg minimum deviation", prism_deviation_deg, RAY_TOLERANCE),
    ("ball lens D=1 BFL", back_focal_length, RAY_TOLERANCE),
    ("incoherent slab T", slab_transmittance, RAY_TOLERANCE),
    ("edge ray angle deg", edge_angle_deg, RAY_TOLERANCE),
    ("fraction of a uniform 2D", entering_fraction, FAN_TOLERANCE),
    ("same, unpolarised Fresnel-weighted", entering_power_fraction, FAN_TOLERANCE),
    ("unpolarised Fresnel T at the edge", edge_transmittance, RAY_TOLERANCE),
)


def traced_value(quantity: str) -> tuple[float, float]:
    """Return the traced value of a row and its tolerance; each row must match exactly one quantity."""
    (matches,) = [(quantity_of, tolerance) for text, quantity_of, tolerance in QUANTITIES if text in quantity]
    index = re.search(r"n=(\d\.\d+)", quantity)
    assert index is not None, quantity
    return matches[0](float(index[1])), matches[1]


def test_traced_values_agree_with_every_row(outside: Path) -> None:
    with (outside / "raytrace" / "analytic_reference.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= 56
    deviations = []
    for row in rows:
        traced, tolerance = traced_value(row["quantity"])
        if not abs(traced - float(row["value"])) <= tolerance:
            deviations.append(f"{row['quantity']}: traced {traced!r}, listed {row['value']}")
    assert not deviations, "\n".join(deviations)
