"""A result of a search, traced again with a smaller tolerance, and by sampling independently of the integration.

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

TOLERANCE_FACTOR, NETWORK_TOLERANCE_FACTOR = 10.0, 2.5
"""Factors by which the tolerance is reduced when a result is traced again: for a sensor, and for a network.

The step between angles or states is also halved; a network is traced with another lattice.
"""
SIGNIFICANCE, SAMPLED_SIGNIFICANCE = 2.0, 3.0
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
        Evaluation during the search, and with finer tracing.
    """

    design: Design
    measure: Measure
    claimed: Evaluation
    evaluation: Evaluation

    @classmethod
    def of(cls, evaluator: Evaluator, design: Design) -> "Retraced":
        """Trace a design again; raise `SpecError` if it has no response with the smaller tolerance."""
        denser, is_network = evaluator.measure.denser(design), design.body.kind == "network"
        tolerance = evaluator.tolerance / (NETWORK_TOLERANCE_FACTOR if is_network else TOLERANCE_FACTOR)
        fine = Evaluator(evaluator.task, evaluator.store, tolerance, evaluator.base, lattice=int(is_network))
        evaluation = fine.required(denser, "result, traced with a smaller tolerance")
        return cls(denser, evaluator.measure, evaluator.required(design, "result"), evaluation)

    def warnings(self) -> Iterator[str]:
        """Yield warnings if the search exploited tracing errors, or if the result does not meet a condition."""
        yield from self.measure.warnings(self.claimed.points)
        remedy = "or use more steps in its motions" if self.design.body.kind == "network" else "or motion.step_deg"
        for fine, claimed in zip(self.evaluation.by_goal, self.claimed.by_goal, strict=True):
            # the uncertainty of the finer trace is neglected
            if abs(fine.goal - claimed.goal) > SIGNIFICANCE * claimed.u_goal:
                yield (
                    f"the goal was {claimed.goal:.4g} during the search and is {fine.goal:.4g} with "
                    f"finer tracing: the search exploited tracing errors; reduce --tolerance {remedy}"
                )
        for text, met in self.evaluation.meets.items():
            if not met:
                yield f"traced with a smaller tolerance, the result does not meet {text}"


class Sampled(NamedTuple):
    """Largest difference in contrast between integration and sampling at a few angles, and its uncertainty."""

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
        differences = []
        for k, angle in enumerate(angles.tolist()):
            sampled, u_sampled = sensor.sampled(angle)
            right, left = (sampled.detectors[side].power for side in ("right", "left"))
            difference = abs((right - left) / (right + left) - float(integrated.contrast[k]))
            u_difference = math.hypot(2.0 * u_sampled / (right + left), integrated.u_contrast[k])
            differences.append(cls(difference, u_difference))
        return max(differences, key=lambda sampled: sampled.difference / sampled.u_difference)

    def warnings(self) -> Iterator[str]:
        """Yield a warning if the difference is significant."""
        if self.difference > SAMPLED_SIGNIFICANCE * self.u_difference:
            ratio = self.difference / self.u_difference
            yield (
                f"the sampled contrast differs from the integrated contrast by {self.difference:.2g}, "
                f"which is {ratio:.1f} times the uncertainty of the difference; reduce --tolerance"
            )
