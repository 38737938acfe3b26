"""Solid of a part: outlines of exact curves, extruded along the thickness and joined, minus cuts.

A `Part` lies on the build plate: X and Y of its solid are x and z of the plane, and Z is the height above the plate.
The y of a sensor is measured from mid-thickness, away from a viewer who sees x to the right and z up; therefore y =
thickness / 2 − Z. `Prism` is the only building block. Joined prisms touch and never overlap, and a `Cut` has the
outline of the removed material, so volumes follow the exact curves. Solids, meshes and drawings are made from parts;
this module does not depend on a file or a CAD kernel.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from solen.errors import DesignError
from solen.geometry import Body, Face
from solen.geometry.body import filled, polyline
from solen.geometry.measures import area_mm2, perimeter_mm

FLAT_MM = 1e-5
"""Tolerance of outlines in containment checks."""
SLIVER = 1e-4
"""Overlap ignored by the checks, which use polylines, as a fraction of an area (or in mm² below 1 mm²)."""


TOUCH_MM2 = 1e-9
"""Common volume of two touching cuts that counts as rounding."""


@dataclass(frozen=True)
class Prism:
    """Closed outlines, with material on their left, extruded from ``from_mm`` to ``to_mm`` above the build plate."""

    name: str
    outlines: tuple[tuple[Face, ...], ...]
    from_mm: float
    to_mm: float

    def __post_init__(self) -> None:
        if not (np.isfinite([self.from_mm, self.to_mm]).all() and self.from_mm < self.to_mm):
            heights = f"from {self.from_mm} to {self.to_mm} mm"
            raise DesignError(f"{self.name} height", value=heights, limit="must be above 0", remedy="increase it")

    @property
    def height_mm(self) -> float:
        """Height in mm."""
        return self.to_mm - self.from_mm

    @cached_property
    def area_mm2(self) -> float:
        """Area within the outlines of the prism."""
        return area_mm2(self.outlines)

    @cached_property
    def perimeter_mm(self) -> float:
        """Total length of the outlines."""
        return perimeter_mm(self.outlines)

    def rings(self, tolerance_mm: float) -> list[NDArray[np.float64]]:
        """Return closed polylines (N, 2) within ``tolerance_mm`` of the outlines; the last point repeats the first."""
        return [polyline(outline, tolerance_mm) for outline in self.outlines]


@dataclass(frozen=True)
class Cut:
    """A cut: ``takes`` is the volume removed from the part, and ``tool`` extends beyond it so that no skin remains."""

    tool: Prism
    takes: Prism

    @property
    def name(self) -> str:
        """Name of the cut."""
        return self.tool.name

    @property
    def volume_mm3(self) -> float:
        """Volume removed."""
        return self.takes.area_mm2 * self.takes.height_mm


@dataclass(frozen=True)
class Part:
    """Prisms joined to one solid, minus cuts; checked when created.

    Raises
    ------
    DesignError
        If prisms overlap, a cut extends beyond the part or its allowed range, or two cuts touch.
    """

    name: str
    prisms: tuple[Prism, ...]
    cuts: tuple[Cut, ...] = ()

    def __post_init__(self) -> None:
        if not self.prisms:
            raise DesignError(self.name, value="no outline", limit="a part requires at least one")
        for first, other in combinations(self.prisms, 2):
            if _shared_mm(first, other) > 0.0 and _overlap_mm2(first, other) > _negligible(first.area_mm2):
                raise DesignError(self.name, value=f"{first.name} and {other.name}", limit="overlap")
        for one_cut, other_cut in combinations(self.cuts, 2):
            if (
                _shared_mm(one_cut.takes, other_cut.takes) > 0.0
                and _overlap_mm2(one_cut.takes, other_cut.takes) > TOUCH_MM2
            ):
                remedy = "make the part thicker, or omit one of the cuts"
                raise DesignError(
                    self.name, value=f"{one_cut.name} and {other_cut.name}", limit="intersect", remedy=remedy
                )
        for cut in self.cuts:
            self._check_cut(cut)

    @property
    def volume_mm3(self) -> float:
        """Volume of the solid within the exact curves."""
        prisms = sum(prism.area_mm2 * prism.height_mm for prism in self.prisms)
        return prisms - sum(cut.volume_mm3 for cut in self.cuts)

    @property
    def wall_mm2(self) -> float:
        """Total area of the vertical walls; a mesh has a volume error of at most this times the mesh tolerance."""
        prisms = (*self.prisms, *(cut.tool for cut in self.cuts))
        return sum(prism.perimeter_mm * prism.height_mm for prism in prisms)

    def _check_cut(self, cut: Cut) -> None:
        """Raise `DesignError` if a cut does not remove exactly its specified volume from the part."""
        taken = sum(_shared_mm(cut.tool, prism) * _overlap_mm2(cut.tool, prism) for prism in self.prisms)
        if abs(taken - cut.volume_mm3) <= _negligible(cut.takes.area_mm2) * cut.takes.height_mm:
            return
        limit = (
            f"would remove {taken:.4g} mm³ instead of {cut.volume_mm3:.4g} mm³, because it extends past the part's edge"
        )
        raise DesignError(cut.name, limit=limit, remedy="make the cut smaller, or the part wider or thicker")


def sensor_prism(body: Body, thickness_mm: float) -> Prism:
    """Return the checked prism of the printed body; separate elements in air are not printed.

    Raises
    ------
    DesignError
        If an outline is open or intersects itself or another, or if the thickness is not above 0.
    """
    body.check()
    return Prism("thickness", body.outlines, 0.0, float(thickness_mm))


def _negligible(area: float) -> float:
    return SLIVER * max(area, 1.0)


def _shared_mm(first: Prism, other: Prism) -> float:
    """Return the height range common to two prisms, in mm."""
    return max(0.0, min(first.to_mm, other.to_mm) - max(first.from_mm, other.from_mm))


def _overlap_mm2(first: Prism, other: Prism) -> float:
    """Return the area common to the outlines of two prisms."""
    regions = [filled(prism.rings(FLAT_MM)) for prism in (first, other)]
    return float(regions[0].intersection(regions[1]).area)
