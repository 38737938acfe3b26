"""Measures for comparing designs: figures of merit of a contrast over one motion, or of a network.

Public names: `measure_of`, `Measure` and `merits_of_points`.
"""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.explore.merits import MERITS, MIN_ANGLES, NAMES, merits_of, unresolved_change
from solen.explore.network_merits import NetworkMerits
from solen.explore.store import Point
from solen.spec import Design


class Measure(Protocol):
    """Figures of merit for points of designs with the same states.

    Attributes
    ----------
    names
        Names of the merits.
    calibrated
        Merits that a calibration of each sensor makes equal to those of the design.
    angle_deg
        (A,) angles of all points; for a network (A, M), the positions of M motions in A states.
    labels
        For a network, the names of its motions, emitters and receivers.
    """

    angle_deg: FloatArray
    labels: Mapping[str, tuple[str, ...]]
    names: tuple[str, ...]
    calibrated: tuple[str, ...]

    def merits(self, point: Point) -> Mapping[str, float]:
        """Return the merits of a traced point and, prefixed by ``u_``, their uncertainties; NaN if missing."""

    def warnings(self, points: Sequence[Point]) -> Iterator[str]:
        """Yield warnings about points whose states are too coarse to resolve the curve between them."""

    def denser(self, design: Design) -> Design:
        """Return the design with half the step between states."""


class ContrastMerits:
    """Merits of the contrast between two receivers over one motion: `solen.explore.merits`."""

    names: tuple[str, ...] = MERITS
    calibrated: tuple[str, ...] = ("null_deg", "slope_per_deg")
    labels: Mapping[str, tuple[str, ...]] = MappingProxyType({})

    def __init__(self, design: Design) -> None:
        """Create the measure of a design; raise `SpecError` if it has too few angles."""
        self.angle_deg = np.array(design.motion.angles_deg())
        if self.angle_deg.size < MIN_ANGLES:
            limit, remedy = f"merits require at least {MIN_ANGLES}", "use a smaller motion.step_deg"
            raise SpecError("motion", value=f"{self.angle_deg.size} angles", limit=limit, remedy=remedy)

    def merits(self, point: Point) -> dict[str, float]:
        """See `Measure`."""
        ((resolution, u),) = point.sd_deg.tolist()
        merits = merits_of(point.response(self.angle_deg), (resolution, u))
        return {name: getattr(merits, name) for name in NAMES}

    def warnings(self, points: Sequence[Point]) -> Iterator[str]:
        """See `Measure`."""
        traced = [point for point in points if point.is_traced]
        changes = [unresolved_change(point.response(self.angle_deg[: len(point.power)])) for point in traced]
        if affected := sum(change > 0.0 for change in changes):
            fraction = f" at {affected} of {len(points)} points" if len(points) > 1 else ""
            yield (
                f"the contrast changes by up to {max(changes):.2g} within one step of motion.step_deg{fraction}, "
                "and the angles are too coarse to resolve the change, so slope, linearity and resolution "
                "are unknown; use a smaller motion.step_deg"
            )

    def denser(self, design: Design) -> Design:
        """See `Measure`."""
        return design.set({"motion.step_deg": design.motion.step_deg / 2.0})


def measure_of(design: Design) -> Measure:
    """Return the measure of a design; raise `SpecError` if it has too few states."""
    return NetworkMerits(design) if design.body.kind == "network" else ContrastMerits(design)


def merits_of_points(measure: Measure, points: Sequence[Point]) -> dict[str, FloatArray]:
    """Return the merits (P,) of points and their uncertainties, keyed by name; NaN for a point without a response."""
    names = [name for merit in measure.names for name in (merit, f"u_{merit}")]
    rows = [measure.merits(point) if point.is_traced else {} for point in points]
    return {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}
