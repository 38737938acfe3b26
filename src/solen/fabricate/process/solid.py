"""Printed solid of a flat part: its outline at every height.

All layers have the same image, and the growth of walls changes with height only near the first and the last layers.
The part is therefore divided into slabs within which a straight wall moves by less than a tolerance; the outline of
each slab is the line of critical dose at its mid-height, after shrinkage and washing as for a lens. The ripple within
layers is omitted: slabs are evaluated at mid-height of a layer.

`slabs` divides the height, `outlines` returns the outlines at one height, and `printed_solid` returns the solid of
drawn rings.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.mesh import Mesh, closed_mesh
from solen.fabricate.process.field import FlatImage, dose_map
from solen.fabricate.process.flat import wash_and_taper_um
from solen.fabricate.process.growth import straight_edge_um
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.terms import terms_at

SLAB_UM = 1.0
"""Maximum displacement of a straight wall within a slab."""
TOLERANCE_UM = 1.0
"""Maximum deviation of outlines from the line of critical dose, due to the grid and to simplification."""
OVERLAP_MM = 1e-4
"""Overlap between a slab and the slab below, which joins them."""
_SIMPLIFY_UM = 0.2


@dataclass(frozen=True)
class Slab:
    """Layers ``first`` to ``last``, inclusive, with equal growth of walls, ``edge_um`` at mid-height of the slab."""

    first: int
    last: int
    edge_um: float

    @property
    def middle(self) -> int:
        """Index of the layer in the middle of the slab."""
        return (self.first + self.last) // 2


def slabs(settings: Settings, layers: int) -> tuple[Slab, ...]:
    """Return the slabs of a part from the first layer upwards.

    Raises
    ------
    DataError
        If no resin cures at mid-height of a layer.
    """
    edges = [straight_edge_um(settings, layers, _middle_um(settings, layer)) for layer in range(layers)]
    parts, first = [], 0
    for layer in range(1, layers + 1):
        if layer == layers or np.ptp(edges[first : layer + 1]) > SLAB_UM:
            parts.append(Slab(first, layer - 1, edges[(first + layer - 1) // 2]))
            first = layer
    return tuple(parts)


def outlines(
    rings: Sequence[FloatArray],
    settings: Settings,
    layers: int,
    layer: int,
    centre: FloatArray,
    phase: tuple[float, float] = (0.0, 0.0),
) -> list[FloatArray]:
    """Return the outlines (N, 2) in mm of the part at mid-height of a layer, after shrinkage, washing and taper.

    Holes are defined by the even-odd rule.
    """
    image = FlatImage.of(rings, np.vstack(rings), settings, layers, phase)
    height_um = _middle_um(settings, layer)
    if terms_at(settings, layers, height_um).total <= settings.Ec_mJ_per_cm2:
        limit = "cures no resin"
        raise DataError("process.exposure_s", value=settings.exposure_s, limit=limit, remedy="expose for longer")
    scale = 1.0 - 0.01 * settings.shrinkage_percent
    lines = [centre + (line - centre) * scale for line in _critical_lines(image, settings, height_um)]
    return _offset(lines, 1e-3 * float(wash_and_taper_um(settings, height_um, layers * settings.layer_um)))


def printed_solid(
    rings: Sequence[FloatArray],
    settings: Settings,
    thickness_mm: float,
    centre_mm: tuple[float, float],
    name: str,
    phase: tuple[float, float] = (0.0, 0.0),
) -> tuple[Mesh, tuple[Slab, ...]]:
    """Return the printed solid of closed polylines (N, 2) in mm, with X and Y as drawn and Z above the plate.

    Parameters
    ----------
    rings
        Drawn outlines: outer ones counter-clockwise, holes clockwise.
    settings
        The process.
    thickness_mm
        Thickness of the part, which is printed as an integer number of layers.
    centre_mm
        Centre of the shrinkage: the centre of the lens.
    name
        Name of the part, for error messages.
    phase
        Position of the origin of the drawing in its pixel.

    Raises
    ------
    DataError, DesignError
        If no resin cures, there are too many pixels, or the cured resin is not a closed solid.
    """
    from manifold3d import CrossSection, FillRule, Manifold, OpType

    layers = max(1, round(1e3 * thickness_mm / settings.layer_um))
    parts, centre = slabs(settings, layers), np.asarray(centre_mm)
    layer_mm = 1e-3 * settings.layer_um * (1.0 - 0.01 * settings.shrinkage_z_percent)
    solids = []
    for slab in parts:
        lines = outlines(rings, settings, layers, slab.middle, centre, phase)
        section = CrossSection([line.tolist() for line in lines], FillRule.EvenOdd).simplify(1e-3 * _SIMPLIFY_UM)
        low = slab.first * layer_mm - (OVERLAP_MM if slab.first else 0.0)
        solids.append(section.extrude((slab.last + 1) * layer_mm - low).translate((0.0, 0.0, low)))
    return closed_mesh(Manifold.batch_boolean(solids, OpType.Add), 1e-3 * TOLERANCE_UM, name), parts


def _middle_um(settings: Settings, layer: int) -> float:
    return (layer + 0.5) * settings.layer_um


def _critical_lines(image: FlatImage, settings: Settings, height_um: float) -> list[FloatArray]:
    """Return the closed lines of critical dose, in mm."""
    from contourpy import contour_generator

    dose = dose_map(image, settings, height_um)
    floor = 1e-12 * float(dose.dose.max())
    excess = np.log(np.maximum(dose.dose, floor) / settings.Ec_mJ_per_cm2)
    lines: list[NDArray[np.float64]] = contour_generator(z=excess).lines(0.0)  # type: ignore[assignment]  # the default line type
    return [
        1e-3 * (np.asarray(dose.first_um) + np.asarray(dose.step_um) * line[:-1]) for line in lines if len(line) > 3
    ]


def _offset(lines: list[FloatArray], by_mm: float) -> list[FloatArray]:
    """Return the offset curves of closed lines, outwards for positive values."""
    if by_mm == 0.0:
        return lines
    from manifold3d import CrossSection, FillRule, JoinType

    section = CrossSection([line.tolist() for line in lines], FillRule.EvenOdd)
    return [np.asarray(line) for line in section.offset(by_mm, JoinType.Miter, 2.0).to_polygons()]
