"""Figures of merit of a network: response of readings to motions, light of each channel, and resolution of motions.

A network is traced in the states of `solen.sensor.network.motion_states`, which vary each motion over its range while
the others are at rest, and in states on either side of rest, which determine the resolution of all motions. A reading
has a slope, a span and a range for each motion. The name of a merit consists of its kind, its subject and its unit,
with _ in place of characters that a name cannot contain: ``slope_lean_index_bends_per_deg``.

`network_point` traces a network; `NetworkMerits` computes its merits.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from solen.arrays import FloatArray
from solen.errors import DesignError, SpecError
from solen.explore.merits import CHANNEL, COARSE_FRACTION, every_second
from solen.explore.monotone import monotone_deg
from solen.explore.store import Accuracy, Point, Variant
from solen.sensor.effects import with_deviations
from solen.sensor.network import (
    DEFAULT_TOLERANCE,
    NetworkResponse,
    determined,
    motion_states,
    network_response,
    network_signals,
)
from solen.sensor.network.readings import readings_of
from solen.spec import Design
from solen.spec.network import Network
from solen.spec.placed import state_of
from solen.spec.strict import repeated

MIN_STEPS = 2
SLOPE_STEP = 1 / 16
"""Step on either side of rest for the slopes, as a fraction of each motion's range: the same as in
`solen sensitivity` for a motion with eight steps.
"""


class _SlopeStates(NamedTuple):
    """Indices of the states on either side of a motion's rest position, and the distance between them."""

    indices: tuple[int, int]
    step_deg: float


def network_point(variant: Variant, accuracy: Accuracy) -> Point:
    """Return the powers of a network in the states of its motions; raise the errors of `network_response`."""
    tolerance = accuracy.tolerance or DEFAULT_TOLERANCE
    response = network_response(
        variant.design,
        states_of(variant.design.network)[0],
        tolerance,
        built=partial(with_deviations, steps=variant.deviations) if variant.deviations else None,
        lattice=accuracy.lattice,
    )
    power, u_power = (values.reshape(len(values), -1) for values in (response.power, response.u_power))
    reached = float(u_power.max())
    why = f"the uncertainty of the powers is {reached:.1e} instead of {tolerance:g}" if reached > tolerance else ""
    return Point(power, u_power, _motion_sds(variant.design, response), why)


def _motion_sds(design: Design, response: NetworkResponse) -> FloatArray:
    """Return, for each motion, its standard deviation at rest from one cycle of readings, and the u of that (M, 2)."""
    states, motion_indices, slope_states = states_of(design.network)
    if not slope_states:
        return np.empty((0, 2))
    used = [0, *(index for pair in slope_states for index in pair.indices)]
    signals = network_signals(
        [state_of(design, states[index]) for index in used], response.power[used], response.u_power[used]
    )
    u = response.u_power[used] * signals.slope_V
    low, high = slice(1, None, 2), slice(2, None, 2)
    steps = np.array([pair.step_deg for pair in slope_states])
    slope = (signals.voltage_V[high] - signals.voltage_V[low]).reshape(len(steps), -1).T / steps
    u_slope = np.hypot(u[high], u[low]).reshape(len(steps), -1).T / steps
    motions = determined(tuple(motion_indices), slope, u_slope, signals.covariance_V2())
    return np.stack([motions.sd_deg, motions.u_sd_deg], axis=-1)


def states_of(network: Network) -> tuple[list[dict[str, float]], dict[str, list[int]], list[_SlopeStates]]:
    """Return the states to be traced, and the indices of `motion_states` and of the states on either side of rest."""
    states, indices = motion_states(network)
    slope_states = []
    for motion in network.motion:
        step = SLOPE_STEP * (motion.to_deg - motion.from_deg)
        ends = max(motion.at_deg - step, motion.from_deg), min(motion.at_deg + step, motion.to_deg)
        slope_states.append(_SlopeStates((len(states), len(states) + 1), ends[1] - ends[0]))
        states += [{motion.name: end} for end in ends]
    return states, indices, slope_states


class NetworkMerits:
    """Figures of merit for points of a network, as defined by `solen.explore.measures.Measure`."""

    calibrated: tuple[str, ...] = ()

    def __init__(self, design: Design) -> None:
        """Create the measure of a design.

        Raises
        ------
        SpecError, DesignError
            If a motion has too few steps, or two merits would have the same name.
        """
        self.network = design.network
        self.states, self.indices, _ = states_of(self.network)
        for number, motion in enumerate(self.network.motion):
            if motion.steps < MIN_STEPS:
                limit, remedy = f"merits require at least {MIN_STEPS}", "use more steps"
                raise SpecError(f"network.motion[{number}].steps", value=motion.steps, limit=limit, remedy=remedy)
        self.names = tuple(self._names())
        twice = repeated(self.names)
        if twice is not None:
            limit = "would be the name of two merits"
            remedy = "rename an emitter, a receiver, a motion or a reading"
            raise DesignError("network", value=twice, limit=limit, remedy=remedy)
        rest = {motion.name: motion.at_deg for motion in self.network.motion}
        self.angle_deg = np.array([[state.get(name, at) for name, at in rest.items()] for state in self.states])
        self.labels: Mapping[str, tuple[str, ...]] = {
            "motion": tuple(rest),
            "emitter": tuple(emitter.name for emitter in self.network.emitters),
            "receiver": tuple(receiver.name for receiver in self.network.receivers),
        }

    def merits(self, point: Point) -> dict[str, float]:
        """Return the merits of a point and their uncertainties; NaN if one does not exist."""
        shape = (len(self.states), len(self.network.emitters), len(self.network.receivers))
        power, u_power = (values.reshape(shape) for values in (point.power, point.u_power))
        in_range = 1 + max((index for indices in self.indices.values() for index in indices), default=0)
        rows = dict(self._light(power[:in_range], u_power[:in_range]))
        rows |= zip(self._sd_names(), self._sds(point), strict=True)
        values, u_values = readings_of(self.network, power, u_power)
        for (number, reading), motion in product(enumerate(self.network.reading), self.network.motion):
            indices = self.indices[motion.name]
            curve = values[indices, number], u_values[indices, number]
            names = _reading_names(reading.name, motion.name)
            rows |= zip(names, _reading_merits(np.array(motion.angles_deg()), *curve, motion.at_deg), strict=True)
        return {key: value for name, pair in rows.items() for key, value in zip((name, f"u_{name}"), pair, strict=True)}

    def warnings(self, _points: Sequence[Point]) -> Iterator[str]:
        """Yield no warning, since the uncertainties include the step between states."""
        yield from ()

    def denser(self, design: Design) -> Design:
        """Return the design with half the step between states."""
        return design.set(
            {f"network.motion[{i}].steps": 2 * motion.steps for i, motion in enumerate(self.network.motion)}
        )

    def _light(self, power: FloatArray, u_power: FloatArray) -> Iterator[tuple[str, tuple[float, float]]]:
        """Yield the smallest light from any emitter at all receivers combined, and that of each channel."""
        yield "light", (float(power.sum(axis=2).min()), float(u_power.sum(axis=2).max()))
        for i, emitter in enumerate(self.network.emitters):
            for j, receiver in enumerate(self.network.receivers):
                state = int(np.argmin(power[:, i, j]))
                yield _channel(emitter.name, receiver.name), (float(power[state, i, j]), float(u_power[state, i, j]))

    def _sds(self, point: Point) -> list[tuple[float, float]]:
        """Return the largest standard deviation of a motion, followed by those of all motions."""
        rows: list[tuple[float, float]] = [(sd, u) for sd, u in point.sd_deg.tolist()]
        return [*([max(rows)] if rows else []), *rows]

    def _sd_names(self) -> list[str]:
        names = [f"sd_{_identifier(motion.name)}_deg" for motion in self.network.motion]
        return [*(["worst_sd_deg"] if names else []), *names]

    def _names(self) -> Iterator[str]:
        yield "light"
        yield from (_channel(a.name, b.name) for a, b in product(self.network.emitters, self.network.receivers))
        yield from self._sd_names()
        for reading, motion in product(self.network.reading, self.network.motion):
            yield from _reading_names(reading.name, motion.name)


def _identifier(name: str) -> str:
    """Replace the characters of a name that a merit's name cannot contain."""
    return re.sub(r"\W", "_", name)


def _channel(emitter: str, receiver: str) -> str:
    return f"{CHANNEL}{_identifier(emitter)}_{_identifier(receiver)}"


def _reading_names(reading: str, motion: str) -> tuple[str, str, str]:
    subject = f"{_identifier(reading)}_{_identifier(motion)}"
    return f"slope_{subject}_per_deg", f"span_{subject}", f"range_{subject}_deg"


def _reading_merits(
    angle: FloatArray, value: FloatArray, u: FloatArray, at_deg: float
) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Return the slope of a reading at rest, its span, and the length of its monotonic range about rest."""
    if not (np.isfinite(value).all() and np.isfinite(u).all()):
        return ((math.nan, math.nan),) * 3
    second = every_second(angle.size)
    slope = float(CubicSpline(angle, value)(at_deg, 1))
    coarse = float(CubicSpline(angle[second], value[second])(at_deg, 1)) if second.size > MIN_STEPS else 2.0 * slope
    step = float(np.diff(angle).max())
    nearest = int(np.argmin(np.abs(angle - at_deg)))
    u_slope = 1.5 * float(u[max(0, nearest - 1) : nearest + 2].max()) / step + COARSE_FRACTION * abs(coarse - slope)
    high, low = int(np.argmax(value)), int(np.argmin(value))
    span = float(value[high] - value[low]), float(u[high] + u[low])
    return (slope, u_slope), span, monotone_deg(angle, value, u, at_deg)
