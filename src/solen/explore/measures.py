"""Measures for comparing designs: the merits of their points, for a contrast over one motion or for a network.

The interface: `measure_of` a design is a `Measure`; `merits_of_points` by it.
"""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.explore.merits import LEAST_ANGLES, MERITS, NAMES, merits_of, unresolved_change
from solen.explore.network_merits import NetworkMerits
from solen.explore.store import Point
from solen.spec import Design


class Measure(Protocol):
    """Merits of points of one design and of others with the same states.

    Attributes
    ----------
    names
        Its merits.
    calibrated
        Those that a calibration of each sensor makes known, so that they count as those of the design.
    angle_deg
        (A,) angles of all points; of a network (A, M) of M motions in A states.
    labels
        For a network, the names of its motions, emitters and receivers.
    """

    angle_deg: FloatArray
    labels: Mapping[str, tuple[str, ...]]
    names: tuple[str, ...]
    calibrated: tuple[str, ...]

    def merits(self, point: Point) -> Mapping[str, float]:
        """Merits of a traced point with their uncertainties, ``u_`` and the name; NaN where one does not exist."""

    def warnings(self, points: Sequence[Point]) -> Iterator[str]:
        """Warnings about points whose states do not show their course."""

    def denser(self, design: Design) -> Design:
        """A design with half the step between states."""


class ContrastMerits:
    """Merits of the contrast of two receivers over one motion: `solen.explore.merits`."""

    names: tuple[str, ...] = MERITS
    calibrated: tuple[str, ...] = ("null_deg", "slope_per_deg")
    labels: Mapping[str, tuple[str, ...]] = MappingProxyType({})

    def __init__(self, design: Design) -> None:
        """Measure of a design; `SpecError` where it has too few angles."""
        self.angle_deg = np.array(design.motion.angles_deg())
        if self.angle_deg.size < LEAST_ANGLES:
            limit, remedy = f"merits need {LEAST_ANGLES}", "take a smaller motion.step_deg"
            raise SpecError("motion", value=f"{self.angle_deg.size} angles", limit=limit, remedy=remedy)

    def merits(self, point: Point) -> dict[str, float]:
        """See `Measure`."""
        ((resolution, u),) = point.sd_deg.tolist()
        found = merits_of(point.response(self.angle_deg), (resolution, u))
        return {name: getattr(found, name) for name in NAMES}

    def warnings(self, points: Sequence[Point]) -> Iterator[str]:
        """See `Measure`."""
        traced = [one for one in points if one.is_traced]
        changes = [unresolved_change(one.response(self.angle_deg[: len(one.power)])) for one in traced]
        if wide := sum(change > 0.0 for change in changes):
            of = f" at {wide} of {len(points)} points" if len(points) > 1 else ""
            yield (
                f"the contrast changes by up to {max(changes):.2g} within one step of motion.step_deg{of}, and the "
                "angles do not show how: slope, linearity and resolution are unknown there; take a smaller step"
            )

    def denser(self, design: Design) -> Design:
        """See `Measure`."""
        return design.set({"motion.step_deg": design.motion.step_deg / 2.0})


def measure_of(design: Design) -> Measure:
    """Measure for comparing a design; `SpecError` where it has too few states."""
    return NetworkMerits(design) if design.body.kind == "network" else ContrastMerits(design)


def merits_of_points(measure: Measure, points: Sequence[Point]) -> dict[str, FloatArray]:
    """Merits of P points by name, and their uncertainties, each (P,); NaN where a point has no response."""
    names = [each for name in measure.names for each in (name, f"u_{name}")]
    rows = [measure.merits(point) if point.is_traced else {} for point in points]
    return {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}
