"""Compensated drawing of a lens, which prints as the intended shape.

The error of the printed wall is subtracted from the drawing, and the print is modelled again, until the error no longer
decreases. The blur of a printer transmits slow variations of the drawing and suppresses fast ones. This fixed-point
iteration therefore converges for every shape that the printer can make, and errors remain only at details that it
cannot make, such as corners sharper than its blur. Corrections are smoothed to the width of the blur, because otherwise
the drawing would develop ripples that do not print. Other walls are moved by the growth of a straight wall, and the
drawing is enlarged to compensate shrinkage.

A `Printing` combines a body and the process that prints it; `compensated` and `Printing.corrected` return a
`Compensation`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import gaussian_filter1d

from solen.arrays import BoolArray, FloatArray
from solen.fabricate.process.drawing import DrawnFace, redrawn, rings_of
from solen.fabricate.process.flat import FlatPrint
from solen.fabricate.process.growth import straight_edge_um
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.target import Deviation, Target
from solen.geometry import Body
from solen.results import HIDDEN, reported

MAX_ROUNDS = 24
CONVERGED_UM = 0.02
"""Decrease of the RMS error in one round below which the iteration has converged."""
MIN_STEP = 0.1
"""Minimum fraction of a correction that is tried."""


@dataclass(frozen=True, eq=False)
class Compensation:
    """A compensated drawing and its predicted print.

    Attributes
    ----------
    outlines
        Outlines to be drawn, as lists of faces.
    drawn_um
        Displacement of the drawn lens from the designed lens, (N,) along its normals, before scaling.
    wall_um
        Outward displacement of the other walls; negative if inwards.
    scale
        Enlargement of the drawing about the centre of the lens.
    printed
        Deviation of the printed lens from the designed lens.
    rounds_um
        RMS deviation after each round.
    """

    outlines: list[list[DrawnFace]] = field(metadata=HIDDEN)
    drawn_um: FloatArray = field(metadata=HIDDEN)
    wall_um: float
    scale: float
    printed: Deviation
    rounds_um: tuple[float, ...]

    @property
    def drawing(self) -> "Drawing":
        """Displacements and scale of the compensated drawing."""
        return Drawing(self.drawn_um, self.wall_um, self.scale)

    @reported
    def drawn_range_um(self) -> tuple[float, float]:
        """Range of the displacement of the drawn lens from the designed lens."""
        return float(self.drawn_um.min()), float(self.drawn_um.max())


@dataclass(frozen=True, eq=False)
class Drawing:
    """Displacements of the drawn lens (N,) and of other walls (outwards), and the scale of the drawing."""

    drawn_um: FloatArray
    wall_um: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class Printing:
    """A body, the target shape of its lens, and the process that prints it flat.

    Attributes
    ----------
    height_um
        Height of the profile; None for the mean over the thickness.
    phase
        Position of the drawing origin in its pixel.
    """

    body: Body
    target: Target
    settings: Settings
    thickness_mm: float
    height_um: float | None = None
    phase: tuple[float, float] = (0.0, 0.0)

    def outlines(self, drawing: Drawing) -> list[list[DrawnFace]]:
        """Return the outlines to be drawn, as lists of faces."""
        lens = self.target.displaced(drawing.drawn_um)
        return redrawn(self.body, lens, drawing.wall_um, drawing.scale, self.target.centre)

    def deviation_um(self, outlines: Sequence[Sequence[DrawnFace]]) -> FloatArray:
        """Return the deviation (N,) of the lens printed from the outlines, along the normals of the designed lens."""
        printed = FlatPrint.of(rings_of(outlines), self.target, self.settings, self.thickness_mm, self.phase)
        return printed.profile_um(self.height_um)

    def corrected(self, start: Drawing, offset_um: FloatArray | float = 0.0) -> Compensation:
        """Return the drawing that prints as designed if real prints deviate by ``offset_um`` (N,) from the model.

        Walls and scale are those of ``start``.
        """
        drawn, step = start.drawn_um, 1.0
        best: Compensation | None = None
        rounds: list[float] = []
        for _ in range(MAX_ROUNDS):
            outlines = self.outlines(replace(start, drawn_um=drawn))
            deviation = Deviation(self.target, self.deviation_um(outlines) + offset_um)
            compensation = Compensation(outlines, drawn, start.wall_um, start.scale, deviation, ())
            gain = math.inf if best is None else self._inner_rms(best.printed.um) - self._inner_rms(deviation.um)
            best = compensation if best is None or gain > 0.0 else best
            rounds.append(best.printed.rms_um)
            step *= 1.0 if gain > 0.0 else 0.5  # halved if the last step was too large
            if gain < CONVERGED_UM and (gain > 0.0 or step < MIN_STEP):
                break
            drawn = best.drawn_um - step * self._smooth(best.printed.um)
        assert best is not None  # noqa: S101  there is at least one round
        return replace(best, rounds_um=tuple(rounds))

    @cached_property
    def _inner(self) -> BoolArray:
        """Mask (N,) of the points farther than the blur from the ends, whose corners cannot be printed."""
        along, reach = self.target.along_mm, 1e-3 * self.settings.edge_um
        return np.asarray((along > reach) & (along < along[-1] - reach))

    def _inner_rms(self, um: FloatArray) -> float:
        return float(np.sqrt(np.mean(um[self._inner] ** 2)))

    def _smooth(self, um: FloatArray) -> FloatArray:
        """Return a deviation (N,) smoothed to the width of the blur; the ends take the value of the nearest point."""
        along = self.target.along_mm
        continued = np.interp(along, along[self._inner], um[self._inner])
        width = 1e-3 * self.settings.edge_um / float(np.mean(np.diff(along)))
        return np.asarray(gaussian_filter1d(continued, width, mode="nearest"))


def compensated(printing: Printing) -> Compensation:
    """Return the drawing with which the lens of a body prints as its target, according to the model.

    Raises
    ------
    DataError, DesignError
        If nothing is printed, or a wall is too short for its displacement.
    """
    settings = printing.settings
    scale = 1.0 / (1.0 - 0.01 * settings.shrinkage_percent)
    layers = max(1, round(printing.thickness_mm * 1e3 / settings.layer_um))
    height_um = 0.5 * layers * settings.layer_um if printing.height_um is None else printing.height_um
    wall_um = -(straight_edge_um(settings, layers, height_um) / scale + settings.wash_um)
    return printing.corrected(Drawing(np.full(len(printing.target.points_mm), wall_um), wall_um, scale))
