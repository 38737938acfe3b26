"""A result of a search, traced again: with a smaller tolerance, and by sampling, independently of the integration.

Public names: `Retraced` and `Sampled`.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from solen.explore.measures import Measure
from solen.explore.optimise.evaluation import Evaluation, Evaluator
from solen.sensor import Sensor
from solen.spec import Design

FINER, FINER_OF_NETWORK = 10.0, 2.5
"""Factor by which the tolerance is reduced, at twice as many angles; networks are sampled with another lattice."""
SURE, SURE_OF_FIVE = 2.0, 3.0
"""Significant difference, in units of its uncertainty: for one value, and for the largest of `SAMPLED_ANGLES`."""
SAMPLED_ANGLES = 5


class Retraced(NamedTuple):
    """A design traced again.

    Parameters
    ----------
    design
        The design with twice as many angles.
    measure
        Its merits.
    claimed, evaluation
        The evaluation of the search, and that of finer tracing.
    """

    design: Design
    measure: Measure
    claimed: Evaluation
    evaluation: Evaluation

    @classmethod
    def of(cls, evaluator: Evaluator, design: Design) -> "Retraced":
        """Trace a design again; raise `SpecError` if it has no response with the smaller tolerance."""
        denser, is_network = evaluator.measure.denser(design), design.body.kind == "network"
        tolerance = evaluator.tolerance / (FINER_OF_NETWORK if is_network else FINER)
        fine = Evaluator(evaluator.task, evaluator.store, tolerance, evaluator.base, lattice=int(is_network))
        evaluation = fine.needed(denser, "result, traced with a smaller tolerance")
        return cls(denser, evaluator.measure, evaluator.needed(design, "result"), evaluation)

    def warnings(self) -> Iterator[str]:
        """Return warnings if the search exploited errors of its tracing, or a condition is missed."""
        yield from self.measure.warnings(self.claimed.points)
        step = "the steps of its motions" if self.design.body.kind == "network" else "motion.step_deg"
        for now, was in zip(self.evaluation.by_goal, self.claimed.by_goal, strict=True):
            if abs(now.goal - was.goal) > SURE * was.u_goal:  # regardless of the finer trace's uncertainty
                yield (
                    f"the goal was {was.goal:.4g} during the search and is {now.goal:.4g} with "
                    "finer tracing: the search exploited tracing errors; lower --tolerance or "
                    f"{step}"
                )
        for text, met in self.evaluation.meets.items():
            if not met:
                yield f"traced with a smaller tolerance, the result does not meet {text}"


class Sampled(NamedTuple):
    """Largest difference in contrast between integration and sampling over some angles, and its uncertainty there."""

    difference: float
    u_difference: float

    @classmethod
    def of(cls, sensor: Sensor) -> "Sampled | None":
        """Return the largest difference for a sensor; None for a network."""
        if sensor.is_network:
            return None
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

    def warnings(self) -> Iterator[str]:
        """Return a warning if the difference exceeds its uncertainty."""
        if self.difference > SURE_OF_FIVE * self.u_difference:
            times = self.difference / self.u_difference
            yield (
                f"the sampled contrast differs from the integrated contrast by {self.difference:.2g}, "
                f"which is {times:.1f} times its uncertainty"
            )
