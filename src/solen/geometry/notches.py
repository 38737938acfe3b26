"""Notches closed by a load: two walls that overlap near their common corner are joined at their intersection.

When a body is compressed, a sharp notch closes from its corner. The contact between its walls is not modelled, so they
overlap by micrometres. Up to an overlap of `MAX_DEPTH_MM`, the outline is joined at the intersection, as for soft walls
in full contact. If the overlap is larger, or if the walls meet away from their corner and enclose air, the outline
still intersects itself and is rejected.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from solen.arrays import FloatArray
from solen.curve import ArcLength, Curve, Spline
from solen.geometry.body import area
from solen.plane import Point

if TYPE_CHECKING:
    import shapely

MAX_DEPTH_MM = 0.02
"""Maximum overlap of the walls of a closed notch."""
MIN_LENGTH_MM = 1e-6
"""An intersection closer to the corner than this is treated as the corner."""
FLAT_MM = 1e-6
MAX_STEPS = 20


@dataclass(frozen=True)
class ClosedNotch:
    """A notch that has closed.

    Attributes
    ----------
    faces
        Names of the two walls, in the order of the outline.
    at_mm
        Position at which the notch begins after closing.
    length_mm
        Length of the closed part of the first wall, from the corner.
    overlap_mm
        Depth by which the walls would overlap.
    """

    faces: tuple[str, str]
    at_mm: Point
    length_mm: float
    overlap_mm: float


def close_notch(names: tuple[str, str], before: Curve, after: Curve) -> tuple[Spline, Spline, ClosedNotch] | None:
    """Return two walls cut at their intersection near a corner, and the notch; None if no notch has closed."""
    import shapely

    if not (isinstance(before, Spline) and isinstance(after, Spline)):
        return None
    lines = shapely.LineString(before.flattened(FLAT_MM)[::-1]), shapely.LineString(after.flattened(FLAT_MM))
    lengths = _crossing(*lines)
    if lengths is None:
        return None
    first, second = (_first_part(line, length) for line, length in zip(lines, lengths, strict=True))
    overlap_mm = float(shapely.hausdorff_distance(shapely.LineString(first), shapely.LineString(second)))
    if area(np.vstack([first[::-1], second[1:]])) <= 0.0 or overlap_mm > MAX_DEPTH_MM:
        return None
    u, v = _refined(before, after, ArcLength(before).length_mm - lengths[0], lengths[1])
    point = before.point_at(u)
    *cubics_before, last = before.part(0.0, u).controls
    first_cubic, *cubics_after = after.part(v, 1.0).controls
    before_cut = Spline.of([*cubics_before, (*last[:-1], point)])
    after_cut = Spline.of([(point, *first_cubic[1:]), *cubics_after])
    return before_cut, after_cut, ClosedNotch(names, point, lengths[0], overlap_mm)


def _crossing(first: "shapely.LineString", second: "shapely.LineString") -> tuple[float, float] | None:
    """Return the lengths from the common corner at which two lines intersect; None unless there is one intersection."""
    intersection = first.intersection(second)
    points = [p for p in getattr(intersection, "geoms", [intersection]) if first.project(p) > MIN_LENGTH_MM]
    return (first.project(points[0]), second.project(points[0])) if len(points) == 1 else None


def _first_part(line: "shapely.LineString", length_mm: float) -> FloatArray:
    """Return points (N, 2) on the first part of a line."""
    from shapely.ops import substring

    return np.asarray(substring(line, 0.0, length_mm).coords)


def _refined(before: Spline, after: Spline, before_mm: float, after_mm: float) -> tuple[float, float]:
    """Return the parameters at which two curves intersect, by Newton's method from lengths along the curves."""
    parameters = np.array([ArcLength(before).u_at(before_mm), ArcLength(after).u_at(after_mm)])
    for _ in range(MAX_STEPS):
        difference = np.subtract(before.point_at(parameters[0]), after.point_at(parameters[1]))
        slopes = np.column_stack([before.velocity_at(parameters[0]), np.negative(after.velocity_at(parameters[1]))])
        step = np.linalg.solve(slopes, difference)
        parameters = parameters - step
        if np.abs(step).max() < 1e-14:
            break
    return float(parameters[0]), float(parameters[1])
