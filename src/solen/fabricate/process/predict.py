"""The lens that a process prints, and the uncertainty of its shape due to the process.

The method is the same for all orientations. For each uncertain parameter of the process, the printed face is computed
with the parameter increased and decreased by its standard uncertainty; half the difference is the contribution of the
parameter at each point along the lens. If the position of the lens within a pixel is not specified, it is a further
contribution. Parameters from the same calibration are combined with their covariance.

`predicted` returns a `Prediction`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.process.flat import FlatPrint
from solen.fabricate.process.growth import growth_um, with_growth
from solen.fabricate.process.process_file import GROWTH, Process
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.side_print import Side, SidePrint
from solen.fabricate.process.target import Deviation, Target
from solen.progress import Progress

Orientation = Literal["flat", "upright", "upright-lens-first", "on-edge"]
PHASE = "position in the pixel"
FLAT_POINTS, SIDE_POINTS = 601, 1501
"""Number of points along a lens: for a flat print, and for a print in which layers must be resolved."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """A printed lens.

    Attributes
    ----------
    deviation
        Deviation from the designed face; without the ripple of layer steps.
    u_um
        Standard uncertainty of the deviation at each point, (N,).
    ripple_um
        Ripple of the layer steps along the face, (N,); 0 for a flat print.
    ripple_through_um
        For a flat print, peak-to-valley ripple of a wall along the thickness, within a layer; otherwise 0.
    contributions_um
        Contribution of each uncertain parameter, RMS along the face, in descending order.
    """

    deviation: Deviation
    u_um: FloatArray
    ripple_um: FloatArray
    ripple_through_um: float
    contributions_um: dict[str, float]


def points_for(orientation: Orientation) -> int:
    """Return the number of points along a lens that is printed in an orientation."""
    return FLAT_POINTS if orientation == "flat" else SIDE_POINTS


def predicted(
    rings: Sequence[FloatArray],
    target: Target,
    process: Process,
    thickness_mm: float,
    orientation: Orientation = "flat",
    height_um: float | None = None,
    progress: Progress | None = None,
    *,
    phase: tuple[float, float] | None = None,
) -> Prediction:
    """Return the lens that a process prints.

    Parameters
    ----------
    rings
        Drawn outlines: closed polylines (N, 2) in mm.
    target
        The designed face.
    process
        The process with its uncertainties.
    thickness_mm
        Thickness of the part.
    orientation
        Orientation in the printer.
    height_um
        Height of the profile, for a part printed flat; None for the mean over its thickness.
    progress
        Called with the completed fraction, up to 1.
    phase
        Position of the origin of the drawing in its pixel, for a part printed flat; None if it is not specified, which
        adds an uncertainty.

    Raises
    ------
    DataError
        If pixels or layers are too coarse, or nothing is printed.
    """
    if orientation == "flat":
        position = phase or (0.0, 0.0)
        smooth, ripple, through, printed = _flat(rings, target, process.process, thickness_mm, height_um, position)
    else:
        smooth, ripple, through, printed = _side_view(rings, target, process.process, orientation)
    keys, covariance = process.covariance()
    scale = np.sqrt(np.diag(covariance))
    halves = []
    for count, (key, u) in enumerate(zip(keys, scale.tolist(), strict=True), start=1):
        halves.append(half_difference(process, key, u, printed))
        if progress is not None:
            progress(count / (len(keys) + 1))
    correlation = covariance / np.outer(scale, scale)
    jacobian = np.array(halves).reshape(len(keys), len(smooth))
    variance = np.einsum("in,ij,jn->n", jacobian, correlation, jacobian)
    contributions = {key: float(np.sqrt(np.mean(half**2))) for key, half in zip(keys, halves, strict=True)}
    if orientation == "flat" and phase is None:
        change = (printed(process.process, (0.5, 0.5)) - printed(process.process)) / np.sqrt(3.0)
        variance = variance + float(np.mean(change**2))
        contributions[PHASE] = float(np.sqrt(np.mean(change**2)))
    ordered = dict(sorted(contributions.items(), key=lambda item: -item[1]))
    return Prediction(Deviation(target, smooth), np.sqrt(np.maximum(variance, 0.0)), ripple, through, ordered)


_Lens = tuple[FloatArray, FloatArray, float, Callable[..., FloatArray]]
"""Offsets and their ripple (N,), ripple along the thickness, and a function that returns offsets for other settings."""


def _flat(
    rings: Sequence[FloatArray],
    target: Target,
    settings: Settings,
    thickness_mm: float,
    height_um: float | None,
    position: tuple[float, float],
) -> _Lens:
    flat = FlatPrint.of(rings, target, settings, thickness_mm, position)
    profile_height_um = 0.5 * flat.thickness_um if height_um is None else height_um
    middle_um = (flat.layer_at(profile_height_um) + 0.5) * settings.layer_um  # one height suffices for differences

    def printed(other: Settings, phase: tuple[float, float] = position) -> FloatArray:
        return FlatPrint.of(rings, target, other, thickness_mm, phase).offsets_um(middle_um)

    smooth = flat.profile_um(height_um)
    return smooth, np.zeros_like(smooth), flat.ripple_um(profile_height_um), printed


@dataclass(frozen=True)
class Phase:
    """Best position of a lens in its pixel.

    Attributes
    ----------
    phase_px
        The position along x and z, in pixels.
    shape_um, on_a_corner_um, worst_um
        RMS deviation of the lens after the best translation along z: at the best position, at a corner of the pixel,
        and at the worst position.
    """

    phase_px: tuple[float, float]
    shape_um: float
    on_a_corner_um: float
    worst_um: float


def best_phase(
    rings: Sequence[FloatArray], target: Target, settings: Settings, thickness_mm: float, height_um: float | None
) -> Phase:
    """Return the position of the drawing in its pixel that minimises the deviation of the shape of a flat print.

    A lens that is symmetric about x = 0 stays symmetric only at a corner or the centre of a pixel. Only these two
    positions are therefore tried along x; along z, multiples of an eighth of a pixel are tried.
    """
    flat = FlatPrint.of(rings, target, settings, thickness_mm)
    profile_height_um = 0.5 * flat.thickness_um if height_um is None else height_um
    middle_um = (flat.layer_at(profile_height_um) + 0.5) * settings.layer_um

    def shape_um(phase: tuple[float, float]) -> float:
        offsets = FlatPrint.of(rings, target, settings, thickness_mm, phase).offsets_um(middle_um)
        return Deviation(target, offsets).shifted[1].rms_um

    shapes_um = {(x, z / 8): shape_um((x, z / 8)) for x in (0.0, 0.5) for z in range(8)}
    best = min(shapes_um, key=lambda phase: shapes_um[phase])
    return Phase(best, shapes_um[best], shapes_um[0.0, 0.0], max(shapes_um.values()))


def _side_view(rings: Sequence[FloatArray], target: Target, settings: Settings, side: Side) -> _Lens:
    def printed(other: Settings) -> FloatArray:
        return SidePrint.of(rings, target, other, side).profile_um()

    side_print = SidePrint.of(rings, target, settings, side)
    return *side_print.steps(side_print.profile_um()), 0.0, printed


def half_difference(process: Process, key: str, u: float, printed: Callable[[Settings], FloatArray]) -> FloatArray:
    """Return half the difference between prints with a parameter increased and decreased by its uncertainty.

    If only one of the two can be printed, its difference from the print with the unchanged parameter is returned.
    """

    def varied(change: float) -> FloatArray | None:
        try:
            return printed(_varied(process, key, change))
        except DataError:
            return None

    more, less = varied(u), varied(-u)
    if more is not None and less is not None:
        return 0.5 * (more - less)
    if more is None and less is None:
        limit = f"is too large: no lens is printed if {key} changes by this uncertainty in either direction"
        raise DataError(f"uncertainty.{key}", value=u, limit=limit, remedy="specify a smaller uncertainty")
    base = printed(process.process)
    return more - base if more is not None else base - np.asarray(less)


def _varied(process: Process, key: str, change: float) -> Settings:
    """Return settings with one parameter changed; the critical dose is adjusted if the growth of walls is known."""
    settings = process.process
    if key == GROWTH:
        return with_growth(settings, growth_um(settings) + change)
    varied = Settings(**(settings.model_dump() | {key: getattr(settings, key) + change}))
    return with_growth(varied, growth_um(settings)) if process.keeps_growth else varied
