"""Values of traced and of recorded sensors for comparison with the paper, each with its standard uncertainty."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from solen.analysis import Study
from solen.analysis.run import Run
from solen.metrology import FacesInspection, LensInspection
from solen.sensor import Sensor
from solen.sensor.check import foci_of
from solen.sensor.network import NetworkTrace
from solen.spec import loads, template

SIDE_DEG = 3.0
"""Rotation to each side in the paper's test."""
LED, POINT = "solen-860", "paper-860"
"""Shipped designs: an LED with its chip, in space, and the paper's point source in the plane."""


class Contrasts(NamedTuple):
    """Contrasts of a sensor at −3°, 0° and +3°, and their standard uncertainties."""

    contrast: tuple[float, ...]
    u_contrast: tuple[float, ...]

    @property
    def separation(self) -> tuple[float, float]:
        """Contrast at −3° minus contrast at +3°."""
        return self.contrast[0] - self.contrast[-1], float(np.hypot(self.u_contrast[0], self.u_contrast[-1]))


def shipped(name: str) -> Sensor:
    """Return the sensor of a shipped design."""
    return Sensor.of(loads(template(name)))


def contrasts(sensor: Sensor) -> Contrasts:
    """Return the contrasts of a sensor at the three angles of the paper."""
    power = sensor.power([-SIDE_DEG, 0.0, SIDE_DEG])
    return Contrasts(tuple(power.contrast.tolist()), tuple(power.u_contrast.tolist()))


def saturation_deg(sensor: Sensor) -> float | None:
    """Return the angle from the null beyond which the contrast is saturated."""
    return sensor.refined(sensor.power()).saturation_deg()


def ratio(part: tuple[float, float], total: tuple[float, float]) -> tuple[float, float]:
    """Return the quotient of two values with independent uncertainties, and its uncertainty."""
    value = part[0] / total[0]
    return value, float(np.hypot(part[1], value * total[1])) / abs(total[0])


def percent_without_lens(point: Sensor, with_lens: Contrasts) -> tuple[float, float]:
    """Return the separation of the contrasts without the lens, as a percentage of that with the lens."""
    value, u = ratio(contrasts(point.without_lens).separation, with_lens.separation)
    return 100.0 * value, 100.0 * u


def focus_mm(sensor: Sensor) -> float | None:
    """Return the distance between the lens vertex and the smallest spot behind it."""
    return next(focus.best_focus_mm for focus in foci_of(sensor) if focus.step == 0.0)


def mean_slope(study: Study, side: str) -> tuple[float, float]:
    """Return the slope of one receiver's voltage, averaged over the sensors with a lens, and its uncertainty."""
    slopes = [
        sensor.receivers[side].sensitivity_V_per_deg for sensor in study.sensors.values() if sensor.lens is not False
    ]
    return float(np.mean(slopes)), float(np.std(slopes, ddof=1) / np.sqrt(len(slopes)))


def control_percent(study: Study) -> tuple[float, float]:
    """Return the swing without a lens as a percentage of that with a lens, averaged over both receivers.

    The uncertainty is obtained from the scatter between sensors.
    """
    lens, comparisons = study.mean_of_sensors, study.lens_beside_none
    if lens is None or comparisons is None:
        raise ValueError("the recording contains no sensor without a lens")
    percents = [comparison.without_lens_percent for comparison in comparisons.values()]
    scatter = [abs(lens.receivers[side].sd_swing_V / lens.receivers[side].swing_V) for side in comparisons]
    mean = float(np.mean(percents))
    return mean, mean * float(np.mean(scatter)) / float(np.sqrt(lens.n))


def rig_numbers(study: Study) -> dict[str, float]:
    """Return the number of sensors with a lens in a recording, and the number of readings per second."""
    times = _first_run(study).signals.time_s
    with_lens = sum(sensor.lens is not False for sensor in study.sensors.values())
    return {"sensors": float(with_lens), "modulation": 1.0 / float(np.median(np.diff(times)))}


def _first_run(study: Study) -> Run:
    return next(iter(study.sensors.values())).runs[0]


def _hold_s(run: Run) -> tuple[float, float]:
    """Return the mean duration of the holds at ±3°, with an uncertainty from the scatter and the reading period."""
    signals, motion = run.signals, run.motion
    holds_s = [
        float(np.ptp(signals.time_s[start:stop]))
        for start, stop in motion.holds
        if stop > start and abs(float(np.median(signals.angle_deg[start:stop])) - motion.rest_deg) > 0.5 * SIDE_DEG
    ]
    period_s = float(np.median(np.diff(signals.time_s)))  # both ends of a hold are known to one period
    return float(np.mean(holds_s)), float(
        np.hypot(np.std(holds_s, ddof=1) / np.sqrt(len(holds_s)), period_s / np.sqrt(6.0))
    )


def protocol_numbers(study: Study) -> dict[str, tuple[float, float]]:
    """Return the cycles, the cycles used, the speed, half of the range and the hold time, each with its uncertainty."""
    response, run = next(iter(study.sensors.values())), _first_run(study)
    motion = run.motion
    return {
        "cycles": (float(len(motion.cycles)), 0.0),
        "cycles-used": (float(response.cycles_used), 0.0),
        "speed": (motion.speed_deg_per_s, 0.0),
        "reach": (0.5 * (motion.high_deg - motion.low_deg), motion.noise_deg),
        "hold": _hold_s(run),
    }


def deviation_um(inspected: LensInspection | FacesInspection) -> tuple[float, float, float]:
    """Return the RMS deviation of a lens from its design with its u, and from the nearest other design, in µm."""
    inspection = inspected.last_layer if isinstance(inspected, FacesInspection) else inspected
    other_rms_um = sorted(design.rms_um for design in inspection.designs.values())
    return inspection.deviation.rms_um, inspection.deviation.u_rms_um, other_rms_um[1]


def received_percent(traced: NetworkTrace) -> tuple[float, float]:
    """Return the percentage of an emitter's light that reaches the receivers, averaged over the emitters."""
    percents: Sequence[float] = traced.power[0].sum(axis=1)
    u = np.sqrt((traced.u_power[0] ** 2).sum()) / len(percents)
    return 100.0 * float(np.mean(percents)), 100.0 * float(u)
