"""A design of a search traced again: more finely, and by samples, which share nothing with the integration.

The interface: `Retraced.of` a design, `Sampled.of` a sensor.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from solen.explore.optimise.judge import Judge, Verdict
from solen.explore.sweep import too_wide_a_step
from solen.sensor import Sensor
from solen.spec import Design

FINER = 10.0
"""How much more closely than candidates, at twice as many angles."""
SURE, SURE_OF_FIVE = 2.0, 3.0
"""Difference in uncertainties that is none by chance, of one number and of the largest of `SAMPLED_ANGLES`."""
SAMPLED_ANGLES = 5


class Retraced(NamedTuple):
    """A design traced again.

    Parameters
    ----------
    design
        With twice as many angles.
    claimed, verdict
        What the search saw, and what finer tracing gives.
    """

    design: Design
    claimed: Verdict
    verdict: Verdict

    @classmethod
    def of(cls, judge: Judge, design: Design) -> "Retraced":
        """A design that a judge knows; `SpecError` where it has no response when traced more closely."""
        fine = Judge(judge.task, judge.store, judge.tolerance / FINER, judge.base)
        denser = design.set({"motion.step_deg": design.motion.step_deg / 2.0})
        verdict = fine.needed(denser, "result, traced more closely")
        return cls(denser, judge.needed(design, "result"), verdict)

    def doubts(self) -> Iterator[str]:
        """Warnings where the search exploited its tracing, or a condition is missed."""
        yield from too_wide_a_step(self.claimed.points)
        for now, was in zip(self.verdict.by_goal, self.claimed.by_goal, strict=True):
            if abs(now.goal - was.goal) > SURE * math.hypot(now.u_goal, was.u_goal):
                yield (
                    f"the search saw {was.goal:.4g}, and finer tracing gives {now.goal:.4g}: it exploited the "
                    "roughness of its tracing; lower --tolerance or motion.step_deg"
                )
        for text, met in self.verdict.meets.items():
            if not met:
                yield f"traced more closely, the result misses {text}"


class Sampled(NamedTuple):
    """Largest difference in contrast between integration and samples over some angles, and the uncertainty there."""

    difference: float
    u_difference: float

    @classmethod
    def of(cls, sensor: Sensor) -> "Sampled":
        """The same of a sensor."""
        motion = sensor.design.motion
        angles = np.linspace(motion.from_deg, motion.to_deg, SAMPLED_ANGLES)
        integrated = sensor.power(angles.tolist())
        found = []
        for place, angle in enumerate(angles.tolist()):
            sampled, u_sampled = sensor.sampled(angle)
            right, left = (sampled.detectors[side].power for side in ("right", "left"))
            difference = abs((right - left) / (right + left) - float(integrated.contrast[place]))
            found.append(cls(difference, math.hypot(2.0 * u_sampled / (right + left), integrated.u_contrast[place])))
        return max(found, key=lambda one: one.difference / one.u_difference)

    def doubts(self) -> Iterator[str]:
        """Warning where the difference exceeds its uncertainty."""
        if self.difference > SURE_OF_FIVE * self.u_difference:
            times = self.difference / self.u_difference
            yield f"samples differ from the integral by {self.difference:.2g} of contrast, {times:.1f} times its u"
