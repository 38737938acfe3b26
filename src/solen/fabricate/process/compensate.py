"""Compensation of a lens's drawing, so that the printed lens has the wanted shape.

The idea: what prints too far out is drawn as much farther in, and printed again in the model until it is right. A
printer's blur answers a slow change of the drawing by the same change and a fast one hardly at all, so the iteration
(drawn minus printed error, a fixed point) converges for whatever the printer can make, and what it cannot, such as a
corner sharper than its blur, is left. Corrections are kept as slow as the blur, or the iteration would drive the
drawing into ripples that do not print. Other walls are moved by what a straight wall grows by, and all is enlarged
against shrinkage.

The interface: `compensated` gives a `Compensation`.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from solen.arrays import FloatArray
from solen.fabricate.process.drawing import DrawnFace, redrawn, rings_of
from solen.fabricate.process.flat import FlatPrint
from solen.fabricate.process.growth import straight_edge_um
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.target import Deviation, Target
from solen.geometry import Body
from solen.results import HIDDEN, reported

MOST_ROUNDS = 12
SETTLED_UM = 0.02
"""Change of the printed error's root mean square from round to round below which it has settled."""


@dataclass(frozen=True, eq=False)
class Compensation:
    """A compensated drawing and its predicted print.

    Attributes
    ----------
    outlines
        Outlines to draw, by face.
    drawn_um
        How far the lens is drawn beyond the wanted one, (N,) along its normals, before the scale.
    wall_um
        By how much other walls are drawn outwards; below 0 inwards.
    scale
        By what the drawing is enlarged, about the lens's middle.
    printed
        Deviation of the printed lens from the wanted one.
    rounds_um
        Root mean square of that, round by round.
    """

    outlines: list[list[DrawnFace]] = field(metadata=HIDDEN)
    drawn_um: FloatArray = field(metadata=HIDDEN)
    wall_um: float
    scale: float
    printed: Deviation
    rounds_um: tuple[float, ...]

    @reported
    def drawn_range_um(self) -> tuple[float, float]:
        """Least and most that the lens is drawn beyond the wanted one."""
        return float(self.drawn_um.min()), float(self.drawn_um.max())


def compensated(
    body: Body,
    target: Target,
    settings: Settings,
    thickness_mm: float,
    height_um: float | None,
    phase: tuple[float, float] = (0.0, 0.0),
) -> Compensation:
    """Drawing of a body whose lens prints as its target at a height, or on average over the thickness.

    Its origin stands at ``phase`` in its pixel.

    Raises
    ------
    DataError, DesignError
        Where nothing is printed, or the walls leave no body.
    """
    scale = 1.0 / (1.0 - 0.01 * settings.shrinkage_percent)
    layers = max(1, round(thickness_mm * 1e3 / settings.layer_um))
    at = 0.5 * layers * settings.layer_um if height_um is None else height_um
    wall_um = -(straight_edge_um(settings, layers, at) / scale + settings.wash_um)
    drawn = np.full(len(target.points_mm), wall_um)
    smooth = 1e-3 * settings.edge_um / float(np.mean(np.diff(target.along_mm)))
    best: Compensation | None = None
    rounds: list[float] = []
    for _ in range(MOST_ROUNDS):
        outlines = redrawn(body, target.moved_um(drawn), wall_um, scale, target.centre)
        printed = FlatPrint.of(rings_of(outlines), target, settings, thickness_mm, phase)
        deviation = Deviation(target, printed.profile_um(height_um))
        rounds.append(deviation.rms_um)
        if best is None or deviation.rms_um < best.printed.rms_um:
            best = Compensation(outlines, drawn, wall_um, scale, deviation, ())
        if len(rounds) > 1 and rounds[-2] - rounds[-1] < SETTLED_UM:
            break
        drawn = drawn - gaussian_filter1d(deviation.um, smooth, mode="nearest")
    assert best is not None  # noqa: S101  there is one round at least
    return replace(best, rounds_um=tuple(rounds))
