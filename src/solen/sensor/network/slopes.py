"""Derivatives of a network's powers with respect to its numbers, and the motions that readings distinguish.

Light from a chip in a network is divided at many faces. Its integral is not smooth to 1e-6, which the limit of a
derivative would require. A derivative is therefore a difference over a specified step, with both ends sampled by the
same rays. Its uncertainty is that of the two powers; curvature within the step is part of the value.

Voltages and their noise are those of the readout; `solen.sensor.network.motions` evaluates which motions they
determine.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SolenError, SpecError
from solen.progress import Progress, part_of, tracked
from solen.ranks import note, warning
from solen.results import Result
from solen.sensor.network.motions import Determination, Suggestion, determined, in_words
from solen.sensor.network.readings import readings_of, slopes_of
from solen.sensor.network.response import NetworkResponse, in_turn, response_of, unread_in
from solen.sensor.network.signals import Signals, network_signals
from solen.sensor.numbers import number, tolerance_of
from solen.spec import Design, value_at, with_values
from solen.spec.network import NamedMotion
from solen.spec.placed import state_of

SLOPE_TOLERANCE = 3e-4
"""Uncertainty of the powers that are subtracted."""


class NetworkSensitivities(Result):
    """Derivatives of a network's powers, by key, emitter and receiver.

    Attributes
    ----------
    name
        Name of the design.
    emitters, receivers, readings
        Names of the emitters, receivers and readings.
    keys
        Keys of the numbers; those of motions end in ``at_deg``.
    value, step
        Value (keys,) of each number, and half the difference between the two values at which powers are traced.
    slope, u_slope
        Derivative (keys, emitters, receivers) with respect to the number, per its unit, and its uncertainty.
    reading_slope, u_reading_slope
        Derivative (keys, readings) of each reading with respect to the number, per its unit, NaN if it does not exist,
        and a bound of its uncertainty.
    skipped
        Reasons why numbers were omitted, by key.
    signals
        Voltages and noise with the motions at rest, as one state; None without a motion among the keys.
    by_voltages
        Determination of the motions among the keys by all voltages; None without one.
    by_readings
        The same from the readings of ``[[network.reading]]`` alone; None without one.
    warnings
        Warnings about the numbers.
    suggestions
        Most useful places for another part, the best first, if requested.
    simulated
        Always true.
    """

    name: str
    emitters: tuple[str, ...]
    receivers: tuple[str, ...]
    readings: tuple[str, ...]
    keys: tuple[str, ...]
    value: FloatArray
    step: FloatArray
    slope: FloatArray
    u_slope: FloatArray
    reading_slope: FloatArray
    u_reading_slope: FloatArray
    skipped: dict[str, str]
    signals: Signals | None
    by_voltages: Determination | None
    by_readings: Determination | None
    warnings: tuple[str, ...]
    suggestions: tuple[Suggestion, ...] | None = None
    simulated: bool = True

    @property
    def change_by_noise(self) -> FloatArray | None:
        """Derivative (keys, emitters, receivers) of each voltage in standard deviations of its noise, per unit."""
        here = self.signals
        return None if here is None else np.asarray(self.slope * np.abs(here.slope_V[0]) / here.sd_V[0])


def network_sensitivities(
    design: Design,
    keys: Sequence[str] = (),
    tolerance: float = SLOPE_TOLERANCE,
    progress: Progress | None = None,
) -> NetworkSensitivities:
    """Return derivatives of a network's powers with respect to numbers, and how well motions are determined.

    Parameters
    ----------
    design
        The network, with its motions at rest.
    keys
        Dotted keys of numbers; default: the angles of its motions.
    tolerance
        Uncertainty of the powers whose differences are taken.
    progress
        Function called with the completed fraction, up to 1.

    Raises
    ------
    SpecError
        If a key is not that of a real number stated in the design, or there is no key.
    """
    sensors = in_turn(design)
    chosen = list(dict.fromkeys(keys)) or [f"network.motion[{i}].at_deg" for i in range(len(design.network.motion))]
    if not chosen:
        raise SpecError(
            "network.motion", limit="has no motions: name keys of the design", remedy="add [[network.motion]]"
        )
    for key in chosen:
        number(sensors[0], key)
    rows: list[_Slope] = []
    skipped: dict[str, str] = {}
    for key in tracked(chosen, part_of(progress, 0, len(chosen) + 1, len(chosen))):
        value = number(sensors[0], key)
        low, high = _ends(design, key, value, tolerance_of(sensors[0], key)[0])
        try:
            designs = [with_values(design, {key: end}) for end in (low, high)]
            ends = response_of(designs, tolerance)
        except SolenError as bad:
            skipped[key] = f"values on both sides of {value:g} are required, and one is impossible: {bad}"
        else:
            rows.append(_Slope(key, value, high - low, designs, ends))
    if not rows:
        key, why = next(iter(skipped.items()))
        raise SpecError(key, limit=why, remedy="name other keys")
    motions = {f"network.motion[{i}].at_deg": motion.name for i, motion in enumerate(design.network.motion)}
    moved = [(motions[row.key], row) for row in rows if row.key in motions]
    here, by_voltages, by_readings = _determined(design, moved, tolerance) if moved else (None, None, None)
    unread = dict.fromkeys(text for row in rows for text in unread_in(row.ends))
    unsure = [warning(text) for text in in_words(by_voltages)] if by_voltages else []
    unsure += [note(f"from network.reading alone: {text}") for text in in_words(by_readings)] if by_readings else []
    (slope, u_slope), (read_slope, u_read_slope) = (
        zip(*(row.slope(name) for row in rows), strict=True) for name in ("power", "reading")
    )
    rest = rows[0].ends
    return NetworkSensitivities(
        name=design.name,
        emitters=rest.emitters,
        receivers=rest.receivers,
        readings=rest.readings,
        keys=tuple(row.key for row in rows),
        value=np.array([row.value for row in rows]),
        step=np.array([0.5 * row.step for row in rows]),
        slope=np.array(slope),
        u_slope=np.array(u_slope),
        reading_slope=np.array(read_slope),
        u_reading_slope=np.array(u_read_slope),
        skipped=skipped,
        signals=here,
        by_voltages=by_voltages,
        by_readings=by_readings,
        warnings=(*dict.fromkeys(text for sensor in sensors for text in sensor.warnings), *unread, *unsure),
    )


def worst_sd_deg(
    design: Design, angles_deg: Sequence[Mapping[str, float]] = ({},), tolerance: float = SLOPE_TOLERANCE
) -> float:
    """Return the largest standard deviation of a network's motion from one reading of all, over states.

    It is infinite if the readings do not determine a motion in some state; states are those of `network_response`.
    Raises the errors of `network_sensitivities`.
    """
    found = (network_sensitivities(state_of(design, state), tolerance=tolerance) for state in angles_deg)
    return max(one.by_voltages.worst_sd_deg if one.by_voltages else math.inf for one in found)


@dataclass(frozen=True)
class _Slope:
    """A network at two values of a number."""

    key: str
    value: float
    step: float
    designs: Sequence[Design]
    ends: NetworkResponse

    def slope(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return the slope of an array of the response, with its uncertainty."""
        (low, high), u = getattr(self.ends, name), getattr(self.ends, f"u_{name}")
        return (high - low) / self.step, np.hypot(*u) / self.step


def _determined(
    design: Design, moved: Sequence[tuple[str, _Slope]], tolerance: float
) -> tuple[Signals, Determination, Determination | None]:
    """Return signals of a network at rest, and how well they and its readings determine the motions."""
    rest = response_of([design], tolerance)
    here = network_signals([design], rest.power, rest.u_power)
    names = [name for name, _ in moved]
    ends = [network_signals(row.designs, row.ends.power, row.ends.u_power) for _, row in moved]
    steps = np.array([row.step for _, row in moved])
    slopes = np.stack([np.diff(end.voltage_V, axis=0)[0] for end in ends], axis=-1) / steps
    u = np.stack([np.hypot(*end.u_voltage_V) for end in ends], axis=-1)
    count = slopes.size // len(names)
    covariance = here.covariance_V2()
    by_voltages = determined(names, slopes.reshape(count, -1), u.reshape(count, -1) / steps, covariance)
    if not design.network.reading:
        return here, by_voltages, None
    by_power = slopes_of(design.network, here.received[0]).reshape(-1, count) / here.slope_V[0].ravel()
    values = [
        readings_of(design.network, end.received, row.ends.u_power) for (_, row), end in zip(moved, ends, strict=True)
    ]
    read_slope = np.stack([np.diff(value, axis=0)[0] for value, _ in values], axis=-1) / steps
    u_read = np.stack([np.hypot(*u) for _, u in values], axis=-1) / steps
    noise = by_power @ covariance @ by_power.T
    exists = np.isfinite(read_slope).all(axis=1) & np.isfinite(noise).all(axis=1)
    by_readings = determined(names, read_slope[exists], u_read[exists], noise[np.ix_(exists, exists)])
    return here, by_voltages, by_readings


def _ends(design: Design, key: str, value: float, tolerance: float) -> tuple[float, float]:
    """Return values on either side of a number: ± its tolerance or, for a motion, ± half a step within its range."""
    holder, _, name = key.rpartition(".")
    motion = value_at(design, holder) if name == "at_deg" and holder.startswith("network.motion[") else None
    if not isinstance(motion, NamedMotion):
        return value - tolerance, value + tolerance
    half = 0.5 * (motion.to_deg - motion.from_deg) / motion.steps
    return max(motion.at_deg - half, motion.from_deg), min(motion.at_deg + half, motion.to_deg)
