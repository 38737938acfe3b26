"""Quick estimate of the effect of each tolerance: each number deviates by its tolerance in the compiled batch.

`solen.sensor.effects` integrates the same effects for a report. Here few rays are traced several times with different
lattice shifts, the same for both sides of a number; the scatter of the differences is their uncertainty.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SolenError
from solen.results import Result, reported
from solen.sensor import Sensor, respond, tolerance_of, why_inert, why_not_batched
from solen.sensor.effects import KEYS, with_deviations
from solen.sensor.numbers import MATERIAL_KEYS
from solen.sensor.practice import MAX_ANGLES, subsample

SEEDS, RAYS = 4, 2**12
WIDENED = 1.2
"""Factor on a standard error of four values: 68 % of Student's t with three degrees of freedom is within it."""


class ToleranceEffect(Result):
    """Change of the contrast when one number exceeds its value by its tolerance: half the difference of high and low.

    Attributes
    ----------
    key, tolerance
        The number and its deviation.
    angle_deg
        (A,) angles.
    contrast, u_contrast
        (A,) change of the contrast and its uncertainty.
    """

    key: str
    tolerance: float
    angle_deg: FloatArray
    contrast: FloatArray
    u_contrast: FloatArray

    @property
    def place(self) -> int:
        """Index of the largest change."""
        return int(np.argmax(np.abs(np.nan_to_num(self.contrast))))

    @reported
    def largest(self) -> float:
        """Largest absolute change of the contrast."""
        return float(abs(self.contrast[self.place]))

    @reported
    def u_largest(self) -> float:
        """Standard uncertainty of the largest change."""
        return float(self.u_contrast[self.place])

    @reported
    def at_deg(self) -> float:
        """Angle of the largest change."""
        return float(self.angle_deg[self.place])


def tolerance_effects(sensor: Sensor, stop: Callable[[], bool] = lambda: False) -> Iterator[ToleranceEffect]:
    """Yield the change of contrast due to the tolerance of each number as it is traced, until ``stop`` is true.

    Numbers that the batch does not support are omitted; a number at its limit is compared on one side only.
    """
    if why_not_batched(sensor):
        return
    angles = subsample(sensor.design.motion.angles_deg(), MAX_ANGLES)
    for key in KEYS:
        if stop():
            return
        if key in MATERIAL_KEYS or not why_inert(sensor, key):
            found = _of(sensor, key, angles)
            if found is not None:
                yield found


def combined_change(found: Sequence[ToleranceEffect]) -> FloatArray:
    """Return the combined change (A,) if all numbers vary independently: the root of the sum of squares."""
    return np.asarray(np.sqrt(np.sum([one.contrast**2 for one in found], axis=0)))


def _of(sensor: Sensor, key: str, angles: Sequence[float]) -> ToleranceEffect | None:
    """Return the change of the contrast due to one number; None if the number cannot deviate to either side."""
    tolerance, _ = tolerance_of(sensor, key)
    ends, steps = [], []
    for step in (-tolerance, tolerance):
        try:
            other = with_deviations(sensor, {key: step})
            for angle in (angles[0], angles[-1]):
                other.body(angle)
        except SolenError:
            other, step = sensor, 0.0
        ends.append(other)
        steps.append(step)
    if steps[1] == steps[0]:
        return None
    changes = []
    for seed in range(SEEDS):
        low, high = respond(ends, angles, rays=RAYS, seed=seed).contrast[:, 0]
        changes.append((high - low) * tolerance / (steps[1] - steps[0]))
    mean, sd = np.mean(changes, axis=0), np.std(changes, axis=0, ddof=1)
    return ToleranceEffect(key, tolerance, np.array(angles), mean, WIDENED * sd / np.sqrt(SEEDS))
