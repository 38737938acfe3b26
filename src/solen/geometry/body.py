"""A body: one closed outline of named exact curves, and where its emitter stands.

Geometry knows no optics. The outline is walked counter-clockwise, so that the material lies on the left of every face.
:meth:`Body.check` proves that it is closed, simple and so oriented, and names the place where it is not.
"""

import math
import re
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solen.curve import END_TOLERANCE_MM, Curve
from solen.errors import DesignError
from solen.plane import Point

GAP_MM = END_TOLERANCE_MM
"""Two faces share a corner when their ends are this near: curves reach that far beyond their ends."""


@dataclass(frozen=True)
class Face:
    """A named piece of the outline."""

    name: str
    curve: Curve


@dataclass(frozen=True)
class Pose:
    """Where something stands and which way it looks: ``axis_deg`` counter-clockwise from +z."""

    point: Point
    axis_deg: float


@dataclass(frozen=True)
class Body:
    """A closed outline, its emitter and its named points (``marks``: the fork's two corners, the crotch)."""

    faces: tuple[Face, ...]
    emitter: Pose
    marks: dict[str, Point]

    def face(self, name: str) -> Face:
        """The face of that name; `KeyError` where there is none."""
        return {face.name: face for face in self.faces}[name]

    def outline(self, tolerance_mm: float = 1e-3) -> NDArray[np.float64]:
        """Closed polyline (N, 2) within ``tolerance_mm`` of the outline; its last point repeats the first."""
        pieces = [face.curve.flattened(tolerance_mm)[:-1] for face in self.faces]
        return np.vstack([*pieces, pieces[0][:1]])

    def area_mm2(self) -> float:
        """Enclosed area, of a polyline within 1 µm of the outline; positive for a counter-clockwise one."""
        return _area(self.outline())

    def check(self) -> "Body":
        """The body itself, or `DesignError` with the faces and the place where it is open, crossing or inside out."""
        if not self.faces:
            raise DesignError("body outline", value="no faces", limit="must be closed")
        for face, following in pairwise((*self.faces, self.faces[0])):
            gap_mm = math.dist(face.curve.end, following.curve.start)
            if not gap_mm <= GAP_MM:
                raise DesignError(
                    "body outline",
                    value=f"open between {face.name} and {following.name}",
                    limit=f"a gap of {gap_mm:.3g} mm at {_place(face.curve.end)}",
                )
        outline = self.outline(1e-4)
        self._check_simple(outline)
        if _area(outline) <= 0.0:
            raise DesignError(
                "body outline", value="clockwise", limit="must run counter-clockwise, material on its left"
            )
        return self

    def _check_simple(self, outline: NDArray[np.float64]) -> None:
        import shapely

        polygon = shapely.Polygon(outline)
        if not polygon.is_valid:
            place = self._crossing(shapely.is_valid_reason(polygon))
            raise DesignError(
                "body outline",
                value="crosses itself",
                limit=place,
                remedy="check stem, arm and lens lengths, the arm's angle and width, and the motion's angles",
            )
        if polygon.intersects(shapely.Point(self.emitter.point)):
            raise DesignError(
                "emitter",
                value=f"inside the body at {_place(self.emitter.point)}",
                limit="must stand before the lens",
                remedy="raise emitter.distance_mm or turn by less",
            )

    def _crossing(self, reason: str) -> str:
        """Which faces cross and where, from shapely's words for it."""
        numbers = re.findall(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", reason)
        if len(numbers) < 2:
            return reason
        place = (float(numbers[-2]), float(numbers[-1]))
        distances = {face.name: _distance(face.curve, place) for face in self.faces}
        near = [name for name, distance_mm in distances.items() if distance_mm < 1e-2]
        return f"at {_place(place)}" + (f", where {' and '.join(near)} meet" if near else "")


def _area(outline: NDArray[np.float64]) -> float:
    """Area of a closed polyline, positive for a counter-clockwise one."""
    x, z = outline.T
    return float(np.sum(x[:-1] * z[1:] - x[1:] * z[:-1]) / 2)


def _distance(curve: Curve, point: Point) -> float:
    offset = curve.flattened() - np.asarray(point)
    chord, to_point = offset[1:] - offset[:-1], -offset[:-1]
    share = np.clip(np.sum(chord * to_point, axis=1) / np.maximum(np.sum(chord**2, axis=1), 1e-300), 0, 1)
    return float(np.min(np.hypot(*(to_point - share[:, None] * chord).T)))


def _place(point: Point) -> str:
    return f"x = {point[0]:.4g}, z = {point[1]:.4g} mm"
