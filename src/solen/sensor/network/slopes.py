"""Derivatives of a network's powers with respect to its numbers, and the motions that readings distinguish.

Light from a chip in a network is split at many faces, and its integral is not smooth to 1e-6, as an exact derivative
would require. A derivative is therefore a difference over a finite step, with the same rays at both ends. Its
uncertainty is that of the two powers; the curvature within the step is part of the value.

Voltages and their noise are those of the readout; `solen.sensor.network.motions` computes which motions they determine.

Public names: `network_sensitivities`, `NetworkSensitivities` and `worst_sd_deg`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SolenError, SpecError
from solen.progress import Progress, part_of, tracked
from solen.ranks import Caution, note, warning
from solen.results import Result
from solen.sensor.network.motions import Determination, Suggestion, determined, undetermined_sentences
from solen.sensor.network.readings import readings_of, slopes_of
from solen.sensor.network.response import NetworkResponse, emitter_sensors, reading_warnings, response_of
from solen.sensor.network.signals import Signals, network_signals
from solen.sensor.numbers import number, tolerance_of
from solen.spec import Design, value_at, with_values
from solen.spec.network import NamedMotion
from solen.spec.placed import state_of

SLOPE_TOLERANCE = 3e-4
"""Uncertainty of the powers that are subtracted."""


class NetworkSensitivities(Result):
    """Derivatives of a network's powers and readings with respect to its numbers.

    Attributes
    ----------
    name
        Name of the design.
    emitters, receivers, readings
        Names of the emitters, receivers and readings.
    keys
        Keys of the numbers; those of motions end in ``at_deg``.
    value, step
        Value (keys,) of each number, and half the difference of the two values at which powers are traced.
    slope, u_slope
        Derivative (keys, emitters, receivers) with respect to the number, per its unit, and its uncertainty.
    reading_slope, u_reading_slope
        Derivative (keys, readings) of each reading with respect to the number, per its unit, NaN if undefined, and an
        upper bound of its uncertainty.
    skipped
        Reasons why numbers were omitted, keyed by number.
    signals
        Voltages and noise with the motions at rest, as one state; None without a motion among the keys.
    by_voltages
        Determination of the motions among the keys by all voltages; None if there are none.
    by_readings
        Determination of these motions by the readings of ``[[network.reading]]`` alone; None if there are none.
    warnings
        Warnings about the numbers.
    suggestions
        Most useful positions for another part, the best first, if requested.
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
        signals = self.signals
        return None if signals is None else np.asarray(self.slope * np.abs(signals.slope_V[0]) / signals.sd_V[0])


def network_sensitivities(
    design: Design,
    keys: Sequence[str] = (),
    tolerance: float = SLOPE_TOLERANCE,
    progress: Progress | None = None,
) -> NetworkSensitivities:
    """Return the derivatives of a network's powers with respect to numbers, and how well motions are determined.

    Parameters
    ----------
    design
        The network, with its motions at rest.
    keys
        Dotted keys of numbers; default: the angles of its motions.
    tolerance
        Uncertainty of the powers at both ends of a step.
    progress
        Function called with the completed fraction, up to 1.

    Raises
    ------
    SpecError
        If a key is not that of a real number with a value in the design, or there are neither keys nor motions.
    """
    sensors = emitter_sensors(design)
    selected = list(dict.fromkeys(keys)) or [f"network.motion[{i}].at_deg" for i in range(len(design.network.motion))]
    if not selected:
        limit, remedy = "is missing, and no keys are named", "name keys of the design, or add [[network.motion]]"
        raise SpecError("network.motion", limit=limit, remedy=remedy)
    for key in selected:
        number(sensors[0], key)
    rows: list[_Slope] = []
    skipped: dict[str, str] = {}
    for key in tracked(selected, part_of(progress, 0, len(selected) + 1, len(selected))):
        value = number(sensors[0], key)
        low, high = _ends(design, key, value, tolerance_of(sensors[0], key)[0])
        try:
            designs = [with_values(design, {key: end}) for end in (low, high)]
            ends = response_of(designs, tolerance)
        except SolenError as error:
            skipped[key] = f"values on both sides of {value:g} are required, and one is impossible: {error}"
        else:
            rows.append(_Slope(key, value, high - low, designs, ends))
    if not rows:
        key, reason = next(iter(skipped.items()))
        raise SpecError(key, limit=reason, remedy="name other keys")
    motions = {f"network.motion[{i}].at_deg": motion.name for i, motion in enumerate(design.network.motion)}
    motion_rows = [(motions[row.key], row) for row in rows if row.key in motions]
    signals, by_voltages, by_readings = (
        _determined(design, motion_rows, tolerance) if motion_rows else (None, None, None)
    )
    (slope, u_slope), (read_slope, u_read_slope) = (
        zip(*(row.slope(name) for row in rows), strict=True) for name in ("power", "reading")
    )
    response = rows[0].ends
    return NetworkSensitivities(
        name=design.name,
        emitters=response.emitters,
        receivers=response.receivers,
        readings=response.readings,
        keys=tuple(row.key for row in rows),
        value=np.array([row.value for row in rows]),
        step=np.array([0.5 * row.step for row in rows]),
        slope=np.array(slope),
        u_slope=np.array(u_slope),
        reading_slope=np.array(read_slope),
        u_reading_slope=np.array(u_read_slope),
        skipped=skipped,
        signals=signals,
        by_voltages=by_voltages,
        by_readings=by_readings,
        warnings=(
            *dict.fromkeys(text for sensor in sensors for text in sensor.warnings),
            *dict.fromkeys(text for row in rows for text in reading_warnings(row.ends)),
            *_undetermined_warnings(by_voltages, by_readings),
        ),
    )


def _undetermined_warnings(by_voltages: Determination | None, by_readings: Determination | None) -> Iterator[Caution]:
    """Yield warnings about motions that the voltages, or the readings alone, do not determine."""
    if by_voltages is not None:
        yield from map(warning, undetermined_sentences(by_voltages))
    if by_readings is not None:
        for text in undetermined_sentences(by_readings):
            yield note(f"from network.reading alone: {text}")


def worst_sd_deg(
    design: Design, angles_deg: Sequence[Mapping[str, float]] = ({},), tolerance: float = SLOPE_TOLERANCE
) -> float:
    """Return the largest standard deviation of any motion of a network in any state, from one reading of all receivers.

    It is infinite if the readings do not determine a motion in some state; ``angles_deg`` is as in `network_response`.
    Raise the errors of `network_sensitivities`.
    """
    results = (network_sensitivities(state_of(design, state), tolerance=tolerance) for state in angles_deg)
    return max(result.by_voltages.worst_sd_deg if result.by_voltages else math.inf for result in results)


@dataclass(frozen=True)
class _Slope:
    """A network at two values of a number."""

    key: str
    value: float
    step: float
    designs: Sequence[Design]
    ends: NetworkResponse

    def slope(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return the derivative of an array of the response, with its uncertainty."""
        (low, high), u = getattr(self.ends, name), getattr(self.ends, f"u_{name}")
        return (high - low) / self.step, np.hypot(*u) / self.step


def _determined(
    design: Design, motion_rows: Sequence[tuple[str, _Slope]], tolerance: float
) -> tuple[Signals, Determination, Determination | None]:
    """Return the signals of a network at rest, and how well they and its readings determine the motions."""
    rest = response_of([design], tolerance)
    signals = network_signals([design], rest.power, rest.u_power)
    names = [name for name, _ in motion_rows]
    ends = [network_signals(row.designs, row.ends.power, row.ends.u_power) for _, row in motion_rows]
    steps = np.array([row.step for _, row in motion_rows])
    slopes = np.stack([np.diff(end.voltage_V, axis=0)[0] for end in ends], axis=-1) / steps
    u = np.stack([np.hypot(*end.u_voltage_V) for end in ends], axis=-1)
    count = slopes.size // len(names)
    covariance = signals.covariance_V2()
    by_voltages = determined(names, slopes.reshape(count, -1), u.reshape(count, -1) / steps, covariance)
    if not design.network.reading:
        return signals, by_voltages, None
    by_power = slopes_of(design.network, signals.received[0]).reshape(-1, count) / signals.slope_V[0].ravel()
    values = [
        readings_of(design.network, end.received, row.ends.u_power)
        for (_, row), end in zip(motion_rows, ends, strict=True)
    ]
    read_slope = np.stack([np.diff(value, axis=0)[0] for value, _ in values], axis=-1) / steps
    u_read_slope = np.stack([np.hypot(*u) for _, u in values], axis=-1) / steps
    noise = by_power @ covariance @ by_power.T
    exists = np.isfinite(read_slope).all(axis=1) & np.isfinite(noise).all(axis=1)
    by_readings = determined(names, read_slope[exists], u_read_slope[exists], noise[np.ix_(exists, exists)])
    return signals, by_voltages, by_readings


def _ends(design: Design, key: str, value: float, tolerance: float) -> tuple[float, float]:
    """Return values on either side of a number: ± its tolerance, or for a motion ± half a step, within its range."""
    table, _, name = key.rpartition(".")
    motion = value_at(design, table) if name == "at_deg" and table.startswith("network.motion[") else None
    if not isinstance(motion, NamedMotion):
        return value - tolerance, value + tolerance
    half_step = 0.5 * (motion.to_deg - motion.from_deg) / motion.steps
    return max(motion.at_deg - half_step, motion.from_deg), min(motion.at_deg + half_step, motion.to_deg)
