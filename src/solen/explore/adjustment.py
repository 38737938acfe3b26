"""An adjustment of each print on the bench: a number moved until the contrast at rest is that of the design.

The idea: the person who mounts an emitter moves it until both receivers read alike. How the design's contrast at its
null follows that number says how far each print must be moved, within a limit; then the print is traced again, as
moved.

The interface: `Adjustment.parse` a text, ``of`` prints.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.errors import SpecError
from solen.explore.store import Point
from solen.explore.variations import deviation_of
from solen.sensor import Sensor

STEPS = 9
"""Values of the number, from one limit to the other, at which the design is traced."""
OPTION = "--adjust"


@dataclass(frozen=True)
class Adjustment:
    """A number of the design and how far it can be moved to either side."""

    key: str
    limit: float

    @classmethod
    def parse(cls, text: str, sensor: Sensor) -> Self:
        """Adjustment of a text, ``emitter.offset_mm=0.05``; `SpecError` where it is malformed, or of a network."""
        if sensor.is_network:
            limit = "moves a number until two receivers read alike; a network has other readings"
            raise SpecError(OPTION, value=text, limit=limit, remedy="leave it out")
        return cls(*deviation_of(text, sensor, OPTION))

    @property
    def steps(self) -> list[float]:
        """Deviations at which the design is traced."""
        steps: list[float] = np.linspace(-self.limit, self.limit, STEPS).tolist()
        return steps

    def of(
        self,
        angle_deg: FloatArray,
        null_deg: float,
        alone: Sequence[Point],
        prints: Sequence[Point],
        off: Sequence[Mapping[str, float]],
    ) -> list[dict[str, float]]:
        """Deviations of prints once adjusted.

        Parameters
        ----------
        angle_deg, null_deg
            Angles of all responses, and the design's null.
        alone
            The design at `steps`.
        prints, off
            The prints, and their deviations; a print without a response stays as it is.

        Raises
        ------
        SpecError
            Where the contrast at the null does not rise or fall with the number.
        """
        if np.isnan(null_deg):
            raise SpecError(OPTION, value=self.key, limit="the design has no null to adjust prints to")
        by_step = np.array([_contrast(angle_deg, point, null_deg) for point in alone])
        rises = np.diff(by_step) * np.sign(by_step[-1] - by_step[0])
        if not (rises > 0.0).all():
            limit = f"the contrast at the design's null does not rise or fall with it over ± {self.limit:g}"
            raise SpecError(OPTION, value=self.key, limit=limit, remedy="name another number, or a smaller limit")
        order = np.argsort(by_step)
        moved = [-self._equal(_contrast(angle_deg, point, null_deg), by_step, order) for point in prints]
        return [{**one, self.key: one.get(self.key, 0.0) + step} for one, step in zip(off, moved, strict=True)]

    def _equal(self, contrast: float, by_step: FloatArray, order: IntArray) -> float:
        """Deviation at which the design has a contrast; 0 for a print that has none."""
        if np.isnan(contrast):
            return 0.0
        return float(np.interp(contrast, by_step[order], np.array(self.steps)[order]))


def _contrast(angle_deg: FloatArray, point: Point, at_deg: float) -> float:
    """Contrast of a point at an angle; NaN without a response or in the dark."""
    return float(np.interp(at_deg, angle_deg, point.response(angle_deg).contrast)) if point.is_traced else np.nan
