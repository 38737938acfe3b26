"""Quick estimate of the effect of each tolerance: each parameter deviates by its tolerance in the compiled batch.

`solen.sensor.effects` integrates the same effects for a report. This module traces few rays several times with
different lattice shifts, the same for both signs of a deviation; the scatter of the differences is their uncertainty.
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
STUDENT_FACTOR = 1.2
"""Factor on the standard error of four values: 68 % quantile of Student's t with three degrees of freedom."""


class ToleranceEffect(Result):
    """Change of the contrast when a parameter deviates by its tolerance: half the difference between plus and minus.

    Attributes
    ----------
    key, tolerance
        The parameter and its deviation.
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
    def index(self) -> int:
        """Index of the largest change."""
        return int(np.argmax(np.abs(np.nan_to_num(self.contrast))))

    @reported
    def largest(self) -> float:
        """Largest absolute change of the contrast."""
        return float(abs(self.contrast[self.index]))

    @reported
    def u_largest(self) -> float:
        """Standard uncertainty of the largest change."""
        return float(self.u_contrast[self.index])

    @reported
    def at_deg(self) -> float:
        """Angle of the largest change."""
        return float(self.angle_deg[self.index])


def tolerance_effects(sensor: Sensor, stop: Callable[[], bool] = lambda: False) -> Iterator[ToleranceEffect]:
    """Yield the change of contrast due to the tolerance of each parameter as it is traced, until ``stop`` is true.

    Parameters that the batch does not support are omitted; a parameter at its limit deviates in one direction only.
    """
    if why_not_batched(sensor):
        return
    angles = subsample(sensor.design.motion.angles_deg(), MAX_ANGLES)
    for key in KEYS:
        if stop():
            return
        if key in MATERIAL_KEYS or not why_inert(sensor, key):
            effect = _effect(sensor, key, angles)
            if effect is not None:
                yield effect


def combined_change(effects: Sequence[ToleranceEffect]) -> FloatArray:
    """Return the combined change (A,) if all parameters vary independently: the root of the sum of squares."""
    return np.asarray(np.sqrt(np.sum([effect.contrast**2 for effect in effects], axis=0)))


def _effect(sensor: Sensor, key: str, angles: Sequence[float]) -> ToleranceEffect | None:
    """Return the change of the contrast due to a parameter; None if it cannot deviate in either direction."""
    tolerance, _ = tolerance_of(sensor, key)
    sensors, steps = [], []
    for step in (-tolerance, tolerance):
        try:
            built = with_deviations(sensor, {key: step})
            for angle in (angles[0], angles[-1]):
                built.body(angle)
        except SolenError:
            built, step = sensor, 0.0
        sensors.append(built)
        steps.append(step)
    if steps[1] == steps[0]:
        return None
    changes = []
    for seed in range(SEEDS):
        low, high = respond(sensors, angles, rays=RAYS, seed=seed).contrast[:, 0]
        changes.append((high - low) * tolerance / (steps[1] - steps[0]))
    mean, sd = np.mean(changes, axis=0), np.std(changes, axis=0, ddof=1)
    return ToleranceEffect(key, tolerance, np.array(angles), mean, STUDENT_FACTOR * sd / np.sqrt(SEEDS))
