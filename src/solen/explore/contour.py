"""The front of a lens and its walls as one contour, and the deviation along it of a print in an image.

Left wall, front and right wall form one contour. Lengths along it are measured from the left end of the front. The
thousand or so edge points of an image are averaged over short pieces with known noise. The mean of each piece is the
local deviation of the registered print from the design, with the errors of size and overgrowth still included.

Public names: `Contour` and `ContourDeviations`.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solen.arrays import FloatArray
from solen.metrology import LensInspection
from solen.metrology.nominal import END_MM, NominalFront, arc_lengths, interpolated, outward
from solen.metrology.print_fit import EDGE_BIAS_PX, registered

FRONT_PIECES, WALL_PIECES = 100, 8
SHARED_LINES = 2.0
"""Number of neighbouring edge points that share grey values and are therefore treated as one."""


@dataclass(frozen=True, eq=False)
class Contour:
    """The left wall, the front and the right wall of a design as one line."""

    nominal: NominalFront

    @property
    def length_mm(self) -> float:
        """Length of the front in mm."""
        return float(self.nominal.arc_mm[-1])

    @property
    def centre_mm(self) -> FloatArray:
        """Centre (2,) of the front, about which a print shrinks, in mm."""
        return np.asarray(self.nominal.at(np.array([0.5 * self.length_mm]))[0][0])

    @cached_property
    def _line(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Lengths (M,) from the front's left end, points (M, 2) and outward normals (M, 2)."""
        front, left, right = self.nominal.front_mm, self.nominal.left_mm[::-1], self.nominal.right_mm
        arcs = [arc_lengths(left) - arc_lengths(left)[-1]] if len(left) else []
        arcs += [self.nominal.arc_mm] + ([self.length_mm + arc_lengths(right)] if len(right) else [])
        pieces = [piece for piece in (left, front, right) if len(piece)]
        return np.concatenate(arcs), np.vstack(pieces), np.vstack([outward(piece) for piece in pieces])

    def by_rigid(self, arc_mm: FloatArray) -> FloatArray:
        """Return the derivatives (N, 3) of deviations with respect to rotation and to shifts along x and z."""
        points, normals = self.at(arc_mm)
        by_rotation = normals[:, 1] * points[:, 0] - normals[:, 0] * points[:, 1]
        return np.column_stack([by_rotation, normals])

    def by_size(self, arc_mm: FloatArray) -> FloatArray:
        """Return the derivatives (N,) of deviations, in mm, with respect to relative size, about the front's centre."""
        points, normals = self.at(arc_mm)
        return np.asarray(np.sum((points - self.centre_mm) * normals, axis=1))

    def at(self, arc_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points (N, 2) and outward normals (N, 2) at lengths along the contour."""
        arc, points, normals = self._line
        return interpolated(arc_mm, arc, points), interpolated(arc_mm, arc, normals)


@dataclass(frozen=True, eq=False)
class ContourDeviations:
    """Deviations of a print in N pieces along a contour.

    Attributes
    ----------
    arc_mm
        Lengths (N,) along the contour; those of the walls are negative or exceed the front's length.
    deviation_um, u_um
        Deviation of the print at the scale of its image, and its standard uncertainty from noise (N,).
    um_per_px, u_um_per_px
        Scale of the image, and its standard uncertainty, or None if that is not specified.
    """

    arc_mm: FloatArray
    deviation_um: FloatArray
    u_um: FloatArray
    um_per_px: float
    u_um_per_px: float | None

    @classmethod
    def of(cls, inspection: LensInspection) -> "ContourDeviations":
        """Return the deviations of the chosen edge and of the walls behind it."""
        chosen, nominal = inspection.outline.chosen, inspection.nominal
        front, walls = registered(chosen.traced, nominal, chosen.size)
        u_um = chosen.edge.measured[1] * inspection.image.um_per_px
        nearest = nominal.nearest(front)
        inner = (nearest.arc_mm > END_MM) & (nearest.arc_mm < corner_arc_mm(nominal))
        inner &= ~nearest.beyond & chosen.size.on_front
        parts = [_pieces(nearest.arc_mm[inner], nearest.deviation_mm[inner], u_um[inner], FRONT_PIECES)]
        nominal_walls = iter(nominal.walls)
        starts = (-arc_lengths(nominal.left_mm)[-1:], corner_arc_mm(nominal) + END_MM + np.zeros(1))
        for side, (points, line) in enumerate(zip(walls, (nominal.left_mm, nominal.right_mm), strict=True)):
            if len(line) < 2:
                continue
            wall = next(nominal_walls)
            if points is None:
                continue
            nearest = wall.nearest(points)
            omitted = 0.0 if side == 0 else float(arc_lengths(line)[-1] - wall.arc_mm[-1])
            on = ~nearest.beyond
            along = float(starts[side][0]) + omitted + nearest.arc_mm[on]
            parts.append(_pieces(along, nearest.deviation_mm[on], np.full(int(on.sum()), np.median(u_um)), WALL_PIECES))
        arc, deviation, u = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        scale = inspection.scale
        return cls(arc, 1e3 * deviation, u, scale.um_per_px, scale.u_um_per_px)

    @property
    def bias_um(self) -> float:
        """Standard uncertainty of a common shift of all edges, which uneven light may cause, in µm."""
        return EDGE_BIAS_PX * self.um_per_px


def corner_arc_mm(nominal: NominalFront) -> float:
    """Return the length along the front at which its right corner begins."""
    return float(nominal.arc_mm[-1]) - END_MM


def _pieces(
    arc: FloatArray, deviation: FloatArray, u: FloatArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the mean position and the mean deviation of equally long pieces, and the noise of the mean deviation."""
    if not len(arc):
        return np.zeros(0), np.zeros(0), np.zeros(0)
    edges = np.linspace(arc.min(), arc.max(), count + 1)[1:-1]
    piece = np.digitize(arc, edges)
    points = np.bincount(piece, minlength=count)
    filled = points > 0
    points = points[filled]
    mean_arc, mean = (np.bincount(piece, values, count)[filled] / points for values in (arc, deviation))
    square = np.bincount(piece, u**2, count)[filled] / points
    return mean_arc, mean, np.sqrt(square * SHARED_LINES / np.maximum(points, SHARED_LINES))
