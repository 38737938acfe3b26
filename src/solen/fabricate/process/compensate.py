"""Compensation of a lens's drawing, so that the printed lens has the intended shape.

The idea: what prints too far out is drawn as much farther in, and printed again in the model until it is right. A
printer's blur answers a slow change of the drawing by the same change and a fast one hardly at all, so the iteration
(drawn minus printed error, a fixed point) converges for whatever the printer can make, and what it cannot, such as a
corner sharper than its blur, is left. Corrections are kept as slow as the blur, or the iteration would drive the
drawing into ripples that do not print. Other walls are moved by what a straight wall grows by, and all is enlarged
against shrinkage.

The interface: `Printing` is a body with what prints it; `compensated` and `Printing.against` give a `Compensation`.
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

MOST_ROUNDS = 24
SETTLED_UM = 0.02
"""Change of the printed error's root mean square from round to round below which it has settled."""
LEAST_SHARE = 0.1
"""Share of a correction below which a smaller one is not tried."""


@dataclass(frozen=True, eq=False)
class Compensation:
    """A compensated drawing and its predicted print.

    Attributes
    ----------
    outlines
        Outlines to draw, by face.
    drawn_um
        How far the lens is drawn beyond the designed one, (N,) along its normals, before the scale.
    wall_um
        By how much other walls are drawn outwards; below 0 inwards.
    scale
        By what the drawing is enlarged, about the lens's middle.
    printed
        Deviation of the printed lens from the designed one.
    rounds_um
        Root mean square of that, round by round.
    """

    outlines: list[list[DrawnFace]] = field(metadata=HIDDEN)
    drawn_um: FloatArray = field(metadata=HIDDEN)
    wall_um: float
    scale: float
    printed: Deviation
    rounds_um: tuple[float, ...]

    @property
    def drawing(self) -> "Drawing":
        """Its drawing."""
        return Drawing(self.drawn_um, self.wall_um, self.scale)

    @reported
    def drawn_range_um(self) -> tuple[float, float]:
        """Least and most that the lens is drawn beyond the designed one."""
        return float(self.drawn_um.min()), float(self.drawn_um.max())


@dataclass(frozen=True, eq=False)
class Drawing:
    """How a body is drawn: its lens (N,) beyond the designed one, other walls outwards, and by what all is enlarged."""

    drawn_um: FloatArray
    wall_um: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class Printing:
    """A body whose lens is to be printed as its target, and the process that prints it flat.

    Attributes
    ----------
    height_um
        Height of the profile; None for the mean over the thickness.
    phase
        Where the drawing's origin stands in its pixel.
    """

    body: Body
    target: Target
    settings: Settings
    thickness_mm: float
    height_um: float | None = None
    phase: tuple[float, float] = (0.0, 0.0)

    def outlines(self, drawing: Drawing) -> list[list[DrawnFace]]:
        """Outlines to draw, by face."""
        lens = self.target.moved_um(drawing.drawn_um)
        return redrawn(self.body, lens, drawing.wall_um, drawing.scale, self.target.centre)

    def deviation_um(self, outlines: Sequence[Sequence[DrawnFace]]) -> FloatArray:
        """How far the lens that some outlines print stands beyond the designed one, (N,) along its normals."""
        printed = FlatPrint.of(rings_of(outlines), self.target, self.settings, self.thickness_mm, self.phase)
        return printed.profile_um(self.height_um)

    def against(self, start: Drawing, besides_um: FloatArray | float = 0.0) -> Compensation:
        """Drawing whose print is the designed lens where prints stand ``besides_um`` (N,) beyond the model's.

        Walls and scale stay as they start.
        """
        drawn, share = start.drawn_um, 1.0
        best: Compensation | None = None
        rounds: list[float] = []
        for _ in range(MOST_ROUNDS):
            outlines = self.outlines(replace(start, drawn_um=drawn))
            deviation = Deviation(self.target, self.deviation_um(outlines) + besides_um)
            made = Compensation(outlines, drawn, start.wall_um, start.scale, deviation, ())
            gained = math.inf if best is None else self._inner_rms(best.printed.um) - self._inner_rms(deviation.um)
            best = made if best is None or gained > 0.0 else best
            rounds.append(best.printed.rms_um)
            share *= 1.0 if gained > 0.0 else 0.5  # where a pixel answers too strongly, half as far
            if gained < SETTLED_UM and (gained > 0.0 or share < LEAST_SHARE):
                break
            drawn = best.drawn_um - share * self._smooth(best.printed.um)
        assert best is not None  # noqa: S101  there is one round at least
        return replace(best, rounds_um=tuple(rounds))

    @cached_property
    def _inner(self) -> BoolArray:
        """Which points (N,) lie farther than the blur from an end: a sharper corner cannot be printed."""
        along, reach = self.target.along_mm, 1e-3 * self.settings.edge_um
        return np.asarray((along > reach) & (along < along[-1] - reach))

    def _inner_rms(self, um: FloatArray) -> float:
        return float(np.sqrt(np.mean(um[self._inner] ** 2)))

    def _smooth(self, um: FloatArray) -> FloatArray:
        """A deviation as slow as the blur, at the corners that of the lens beside them."""
        along = self.target.along_mm
        steady = np.interp(along, along[self._inner], um[self._inner])
        width = 1e-3 * self.settings.edge_um / float(np.mean(np.diff(along)))
        return np.asarray(gaussian_filter1d(steady, width, mode="nearest"))


def compensated(printing: Printing) -> Compensation:
    """Drawing of a body whose lens prints as its target, by the process alone.

    Raises
    ------
    DataError, DesignError
        If nothing is printed, or the walls leave no body.
    """
    settings = printing.settings
    scale = 1.0 / (1.0 - 0.01 * settings.shrinkage_percent)
    layers = max(1, round(printing.thickness_mm * 1e3 / settings.layer_um))
    at = 0.5 * layers * settings.layer_um if printing.height_um is None else printing.height_um
    wall_um = -(straight_edge_um(settings, layers, at) / scale + settings.wash_um)
    return printing.against(Drawing(np.full(len(printing.target.points_mm), wall_um), wall_um, scale))
