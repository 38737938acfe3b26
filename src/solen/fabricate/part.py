"""Solid of a part: outlines of exact curves, extruded along the thickness and joined, minus cuts.

A `Part` lies on the build plate: its X and Y are x and z of the plane of the sensor, and its Z is the height above the
plate. The y of a sensor is measured from mid-thickness, away from a viewer who sees x to the right and z up; therefore
y = thickness / 2 − Z. `Prism` is the only building block. Joined prisms touch but never overlap, and a `Cut` has the
outline of the removed material, so volumes are exact. STEP files, meshes and layers are made from parts; this module
depends on neither files nor a CAD kernel.
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
"""Tolerance of the polylines with which overlaps are checked."""
SLIVER = 1e-4
"""Overlap that the checks ignore, as a fraction of the area, which is at least 1 mm² for this purpose."""
TOUCH_MM2 = 1e-9
"""Overlap of two touching cuts that is treated as a rounding error."""


@dataclass(frozen=True)
class Prism:
    """Closed outlines, with material on their left, extruded from ``from_mm`` to ``to_mm`` above the build plate."""

    name: str
    outlines: tuple[tuple[Face, ...], ...]
    from_mm: float
    to_mm: float

    def __post_init__(self) -> None:
        if not (np.isfinite([self.from_mm, self.to_mm]).all() and self.from_mm < self.to_mm):
            limit = f"must be above 0, but is from {self.from_mm} to {self.to_mm} mm"
            raise DesignError(f"{self.name} height", limit=limit, remedy="increase it")

    @property
    def height_mm(self) -> float:
        """Height in mm."""
        return self.to_mm - self.from_mm

    @cached_property
    def area_mm2(self) -> float:
        """Cross-sectional area."""
        return area_mm2(self.outlines)

    @cached_property
    def perimeter_mm(self) -> float:
        """Total length of the outlines."""
        return perimeter_mm(self.outlines)

    def rings(self, tolerance_mm: float) -> list[NDArray[np.float64]]:
        """Return the outlines as closed polylines (N, 2) within ``tolerance_mm``; the last point repeats the first."""
        return [polyline(outline, tolerance_mm) for outline in self.outlines]


@dataclass(frozen=True)
class Cut:
    """A cut: ``removed`` is the material that is removed, and ``tool`` extends beyond it so that no skin remains."""

    tool: Prism
    removed: Prism

    @property
    def name(self) -> str:
        """Name of the cut."""
        return self.tool.name

    @property
    def volume_mm3(self) -> float:
        """Removed volume."""
        return self.removed.area_mm2 * self.removed.height_mm


@dataclass(frozen=True)
class Part:
    """Prisms joined into one solid, minus cuts; checked when created.

    Raises
    ------
    DesignError
        If there is no prism, prisms or cuts overlap, or a cut extends beyond the part.
    """

    name: str
    prisms: tuple[Prism, ...]
    cuts: tuple[Cut, ...] = ()

    def __post_init__(self) -> None:
        if not self.prisms:
            raise DesignError(self.name, limit="has no outline")
        for first, second in combinations(self.prisms, 2):
            if _common_mm(first, second) > 0.0 and _overlap_mm2(first, second) > _negligible(first.area_mm2):
                raise DesignError(self.name, limit=f"{first.name} and {second.name} overlap")
        for first, second in combinations([cut.removed for cut in self.cuts], 2):
            if _common_mm(first, second) > 0.0 and _overlap_mm2(first, second) > TOUCH_MM2:
                remedy = "make the part thicker, or omit one of the cuts"
                raise DesignError(self.name, limit=f"{first.name} and {second.name} intersect", remedy=remedy)
        for cut in self.cuts:
            self._check_cut(cut)

    @property
    def volume_mm3(self) -> float:
        """Volume of the exact solid."""
        prisms = sum(prism.area_mm2 * prism.height_mm for prism in self.prisms)
        return prisms - sum(cut.volume_mm3 for cut in self.cuts)

    @property
    def wall_mm2(self) -> float:
        """Total area of the vertical walls; multiplied by the mesh tolerance, an upper bound for the volume error."""
        prisms = (*self.prisms, *(cut.tool for cut in self.cuts))
        return sum(prism.perimeter_mm * prism.height_mm for prism in prisms)

    def _check_cut(self, cut: Cut) -> None:
        """Raise `DesignError` if the tool of a cut does not remove exactly the volume of the cut from the part."""
        removed_mm3 = sum(_common_mm(cut.tool, prism) * _overlap_mm2(cut.tool, prism) for prism in self.prisms)
        if abs(removed_mm3 - cut.volume_mm3) <= _negligible(cut.removed.area_mm2) * cut.removed.height_mm:
            return
        limit = f"extends beyond the part: it would remove {removed_mm3:.4g} mm³ instead of {cut.volume_mm3:.4g} mm³"
        raise DesignError(cut.name, limit=limit, remedy="make the cut smaller, or the part wider or thicker")


def sensor_prism(body: Body, thickness_mm: float) -> Prism:
    """Return the prism of a body, without its separate objects in air, which are not printed.

    Raises
    ------
    DesignError
        If an outline is open or intersects itself or another, or if the thickness is not above 0.
    """
    body.check()
    return Prism("thickness", body.outlines, 0.0, float(thickness_mm))


def _negligible(area: float) -> float:
    return SLIVER * max(area, 1.0)


def _common_mm(first: Prism, second: Prism) -> float:
    """Return the length of the height range that two prisms have in common."""
    return max(0.0, min(first.to_mm, second.to_mm) - max(first.from_mm, second.from_mm))


def _overlap_mm2(first: Prism, second: Prism) -> float:
    """Return the area that the outlines of two prisms have in common."""
    regions = [filled(prism.rings(FLAT_MM)) for prism in (first, second)]
    return float(regions[0].intersection(regions[1]).area)
