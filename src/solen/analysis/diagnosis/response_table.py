"""The traced response of a design for an emitter at any position and of any width, as one table.

The points of a chip emit incoherently, so the response of a chip is the mean of the responses of its points. These
responses are traced on a grid of motion angles and positions of a point emitter, and integrated once over position. The
light from a chip of any decentre and width is then the difference between two values of this integral. Positions are
traced more densely where the response is curved. Positions are measured from the edge, i.e. the position at which the
light passes from one receiver to the other; the edge moves with the angle, but the response relative to the edge
changes slowly, so a few angles are sufficient. Directional receivers detect less light from each point, as described in
`solen.sensor.readings`.

Public names: `Table` and `angles_deg`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solen.analysis.diagnosis.light_by_position import PositionIntegral, light_by_position
from solen.arrays import FloatArray, IndexArray
from solen.geometry import are_mirrored
from solen.progress import Progress, on_threads
from solen.sensor import Sensor
from solen.spec import with_values

REACH_MM = 0.6
"""Range of traced positions on each side, in addition to the design's decentre and half of its chip width."""
STEP_MM = 0.002
"""Step of the integral over position."""
STEP_DEG, STEP_IN_SPACE_DEG, MAX_ANGLES = 0.125, 0.25, 81
"""Spacing of the traced angles in the plane and in space, and the maximum number of angles."""
EDGE_STEP_MM, MAX_EDGE_DEVIATION_MM = 0.005, 0.05
"""Step of the positions at which the edge is sought, and largest deviation of the edge from a straight line."""
POINT_MM = 0.004
"""Width below which a chip is treated as a point."""
_PAD = 12


@dataclass(frozen=True, eq=False)
class Table:
    """Integral of the response of a point emitter over its position.

    Attributes
    ----------
    angle_deg
        Traced angles, (a,).
    position_mm
        Positions relative to the edge, (p,).
    edge
        Polynomial of the edge position in mm against the angle, in the form used by `numpy.polyval`.
    total_mm
        Integral up to each position, right and left, (2, a, p).
    rows
        Integral over position at each traced angle, from which similar tables are traced as differences; () if the
        table was not traced.
    """

    angle_deg: FloatArray
    position_mm: FloatArray
    edge: FloatArray
    total_mm: FloatArray
    rows: tuple[PositionIntegral, ...] = ()

    @classmethod
    def of(
        cls, sensor: Sensor, angle_deg: FloatArray, like: "Table | None" = None, progress: Progress | None = None
    ) -> "Table":
        """Trace the table of a design at angles (a,), at least four.

        ``like`` is the table of a similar design that includes these angles.

        Raises
        ------
        DesignError
            If light is scattered or comes from a ray file, or if a planar emission pattern is used in space.
        """
        wide, reach_mm = _with_wide_chip(sensor)
        wide.check_pair()
        similar = [None] * len(angle_deg) if like is None else [like.rows[row] for row in like.indices(angle_deg)]
        rows = _traced(wide, angle_deg, reach_mm, similar, progress)
        edge = _edge(angle_deg, rows, reach_mm) if like is None else like.edge
        edge_mm = np.polyval(edge, angle_deg)
        end = reach_mm - np.abs(edge_mm[[0, -1]]).max()
        grid = np.linspace(-end, end, 1 + 2 * math.ceil(end / STEP_MM)) if like is None else like.position_mm
        totals = [
            (row.integral_to(grid + shift) - row.integral_to(grid[:1] + shift)).T
            for row, shift in zip(rows, edge_mm, strict=True)
        ]
        return cls(angle_deg, grid, edge, np.stack(totals, 1), rows)

    def indices(self, angle_deg: FloatArray) -> IndexArray:
        """Return the indices of the given angles (n,), each of which must be a traced angle."""
        return np.searchsorted(self.angle_deg, angle_deg - 1e-9)

    def minus(self, other: "Table") -> "Table":
        """Return this table minus another one that has the same positions and edge, and at least the same angles."""
        return replace(self, total_mm=self.total_mm - other.total_mm[:, other.indices(self.angle_deg)])

    @cached_property
    def _coefficients(self) -> tuple[FloatArray, ...]:
        """Cubic spline coefficients for both receivers; the table is extended by odd reflection at its ends."""
        from scipy.ndimage import spline_filter

        padded = np.pad(self.total_mm, ((0, 0), (_PAD, _PAD), (_PAD, _PAD)), mode="reflect", reflect_type="odd")
        return tuple(spline_filter(receiver, mode="mirror") for receiver in padded)

    @property
    def reach_mm(self) -> float:
        """Largest distance between a chip edge and the axis that is possible at every angle."""
        return float(self.position_mm[-1] - np.abs(np.polyval(self.edge, self.angle_deg[[0, -1]])).max())

    def chip(self, angle_deg: FloatArray, offset_mm: float, width_mm: float) -> FloatArray:
        """Return the fractions of the emitted power (n, 2), right and left, at angles (n,), for a decentred chip."""
        from scipy.ndimage import map_coordinates

        half = 0.5 * max(width_mm, POINT_MM)
        row = (angle_deg - self.angle_deg[0]) / (self.angle_deg[1] - self.angle_deg[0]) + _PAD
        centre = offset_mm - np.polyval(self.edge, angle_deg) - self.position_mm[0]
        ends = np.concatenate([centre - half, centre + half]) / (self.position_mm[1] - self.position_mm[0]) + _PAD
        coordinates = np.stack([np.concatenate([row, row]), ends])
        totals = [
            map_coordinates(coefficients, coordinates, prefilter=False, mode="nearest")
            for coefficients in self._coefficients
        ]
        n = angle_deg.size
        return np.column_stack([(total[n:] - total[:n]) / (2.0 * half) for total in totals])


def angles_deg(low_deg: float, high_deg: float, step_deg: float = STEP_DEG) -> FloatArray:
    """Return the angles at which a response is traced: an odd number, so that every second angle includes both ends."""
    half = int(np.clip(math.ceil(0.5 * (high_deg - low_deg) / step_deg), 4, MAX_ANGLES // 2))
    return np.linspace(low_deg, high_deg, 2 * half + 1)


def _traced(
    wide: Sensor,
    angle_deg: FloatArray,
    reach_mm: float,
    similar: Sequence[PositionIntegral | None],
    progress: Progress | None,
) -> tuple[PositionIntegral, ...]:
    """Trace the light at every angle, on all cores; for a symmetric sensor only at non-negative angles."""
    symmetric = np.allclose(angle_deg, -angle_deg[::-1], rtol=0.0, atol=1e-9)
    symmetric = symmetric and are_mirrored(*(wide.body(float(angle)) for angle in angle_deg[[0, -1]]))
    first = len(angle_deg) // 2 if symmetric else 0
    pairs = list(zip(angle_deg[first:].tolist(), similar[first:], strict=True))
    rows = on_threads(lambda pair: light_by_position(wide, pair[0], reach_mm, pair[1]), pairs, progress)
    opposite = rows[len(angle_deg) % 2 :] if symmetric else []
    return (*(row.mirrored() for row in reversed(opposite)), *rows)


def _with_wide_chip(sensor: Sensor) -> tuple[Sensor, float]:
    """Return the sensor with a chip that covers all positions, and the half-width of this chip."""
    emitter = sensor.design.emitter
    reach_mm = REACH_MM + abs(emitter.offset_mm) + 0.5 * sensor.light.width_mm
    wide = Sensor.of(with_values(sensor.design, {"emitter.offset_mm": 0.0, "emitter.width_mm": 2.0 * reach_mm}))
    return replace(wide, cut=sensor.cut), reach_mm


def _edge(angles: FloatArray, rows: Sequence[PositionIntegral], reach_mm: float) -> FloatArray:
    """Return the line through the positions of steepest transition, or a constant 0 if they are not on a line."""
    grid = np.linspace(-reach_mm, reach_mm, 1 + 2 * math.ceil(reach_mm / EDGE_STEP_MM))
    right_minus_left = (row.integral_to(grid) @ np.array([1.0, -1.0]) for row in rows)
    # an emitter on the right illuminates the left receiver, so the difference falls at the edge
    steepest = grid[1:-1][[int(np.argmin(np.diff(total, 2))) for total in right_minus_left]]
    line = np.polyfit(angles, steepest, 1)
    deviation = np.abs(np.polyval(line, angles) - steepest).max()
    return line if deviation < MAX_EDGE_DEVIATION_MM else np.zeros(1)
