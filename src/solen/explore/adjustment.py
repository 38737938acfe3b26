"""Adjustment of each print on the bench: a parameter is changed until the contrast at the design's null is zero.

The person who mounts an emitter shifts it until both receivers give equal readings. The contrast at the design's null,
as a function of that parameter, gives the adjustment that each print needs, up to a limit. Each print is then traced
again with its adjustment.

Public name: `Adjustment`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.errors import SpecError
from solen.explore.store import Point
from solen.explore.variations import parse_deviation
from solen.sensor import Sensor

STEPS = 9
"""Number of values, from one limit to the other, at which the design is traced."""
OPTION = "--adjust"


@dataclass(frozen=True)
class Adjustment:
    """A parameter of the design and the largest adjustment of it in either direction."""

    key: str
    limit: float

    @classmethod
    def parse(cls, text: str, sensor: Sensor) -> Self:
        """Parse an adjustment, ``emitter.offset_mm=0.05``; raise `SpecError` for a malformed one or a network."""
        if sensor.is_network:
            limit = "adjusts a parameter until two receivers give equal readings, and does not apply to a network"
            raise SpecError(OPTION, value=text, limit=limit, remedy=f"omit {OPTION}")
        return cls(*parse_deviation(text, sensor, OPTION))

    @property
    def steps(self) -> list[float]:
        """Deviations at which the design is traced."""
        steps: list[float] = np.linspace(-self.limit, self.limit, STEPS).tolist()
        return steps

    def applied(
        self,
        angle_deg: FloatArray,
        null_deg: float,
        design_points: Sequence[Point],
        prints: Sequence[Point],
        deviations: Sequence[Mapping[str, float]],
    ) -> list[dict[str, float]]:
        """Return the deviations of the prints after the adjustment.

        Parameters
        ----------
        angle_deg, null_deg
            Angles of all responses, and the design's null.
        design_points
            The design traced at `steps`.
        prints, deviations
            The prints and their deviations. A print without a response is not adjusted.

        Raises
        ------
        SpecError
            If the design has no null, or the contrast there is not a monotonic function of the parameter.
        """
        if np.isnan(null_deg):
            limit = "the design has no null to which prints could be adjusted"
            raise SpecError(OPTION, value=self.key, limit=limit, remedy="omit the option")
        by_step = np.array([_contrast(angle_deg, point, null_deg) for point in design_points])
        rises = np.diff(by_step) * np.sign(by_step[-1] - by_step[0])
        if not (rises > 0.0).all():
            limit = (
                f"the contrast at the design's null is not a monotonic function of this parameter over ± {self.limit:g}"
            )
            raise SpecError(OPTION, value=self.key, limit=limit, remedy="specify another parameter or a smaller limit")
        order = np.argsort(by_step)
        steps = [-self._step_at(_contrast(angle_deg, point, null_deg), by_step, order) for point in prints]
        return [
            {**deviation, self.key: deviation.get(self.key, 0.0) + step}
            for deviation, step in zip(deviations, steps, strict=True)
        ]

    def _step_at(self, contrast: float, by_step: FloatArray, order: IntArray) -> float:
        """Return the deviation at which the design has the given contrast; 0 if the contrast is NaN."""
        if np.isnan(contrast):
            return 0.0
        return float(np.interp(contrast, by_step[order], np.array(self.steps)[order]))


def _contrast(angle_deg: FloatArray, point: Point, at_deg: float) -> float:
    """Return the contrast of a point at an angle; NaN without a response or without light."""
    return float(np.interp(at_deg, angle_deg, point.response(angle_deg).contrast)) if point.is_traced else np.nan
