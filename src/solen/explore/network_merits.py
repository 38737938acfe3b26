"""Merits of a network: the response of readings to motions, the light of each channel, and the resolution of motions.

A network is traced in the states of `solen.sensor.network.motion_states`, which vary each motion over its range while
the others are at rest, and in states on either side of rest, which determine the resolution of all motions. A reading
has a slope, a span and a range for each motion. The name of a merit consists of the merit, its subject and its unit,
with _ in place of characters that a name cannot contain: ``slope_lean_index_bends_per_deg``.

`network_point` traces a network; `NetworkMerits` computes its merits.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from solen.arrays import FloatArray
from solen.errors import DesignError, SpecError
from solen.explore.merits import CHANNEL, COARSE_SHARE, every_second
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

MIN_STEPS = 2
SLOPE_SHARE = 1 / 16
"""Step on either side of rest for the slopes, as a fraction of each motion's range: that of `solen sensitivity` with
eight steps.
"""


class _Beside(NamedTuple):
    """Indices of the states on either side of a motion's rest position, and the distance between them."""

    places: tuple[int, int]
    step_deg: float


def network_point(variant: Variant, accuracy: Accuracy) -> Point:
    """Return the powers of a network in the states of its motions; raises the errors of `network_response`."""
    tolerance = accuracy.tolerance or DEFAULT_TOLERANCE
    found = network_response(
        variant.design,
        states_of(variant.design.network)[0],
        tolerance,
        built=partial(with_deviations, steps=variant.off) if variant.off else None,
        lattice=accuracy.lattice,
    )
    power, u_power = (each.reshape(len(each), -1) for each in (found.power, found.u_power))
    reached = float(u_power.max())
    why = f"the uncertainty of the powers is {reached:.1e} instead of {tolerance:g}" if reached > tolerance else ""
    return Point(power, u_power, _sds(variant.design, found), why)


def _sds(design: Design, found: NetworkResponse) -> FloatArray:
    """Return the standard deviation of each motion at rest from one cycle of readings, with its u (motions, 2)."""
    states, places, beside = states_of(design.network)
    if not beside:
        return np.empty((0, 2))
    chosen = [0, *(place for one in beside for place in one.places)]
    seen = network_signals(
        [state_of(design, states[place]) for place in chosen], found.power[chosen], found.u_power[chosen]
    )
    u = found.u_power[chosen] * seen.slope_V
    low, high = slice(1, None, 2), slice(2, None, 2)
    steps = np.array([one.step_deg for one in beside])
    slope = (seen.voltage_V[high] - seen.voltage_V[low]).reshape(len(steps), -1).T / steps
    u_slope = np.hypot(u[high], u[low]).reshape(len(steps), -1).T / steps
    known = determined(tuple(places), slope, u_slope, seen.covariance_V2())
    return np.stack([known.sd_deg, known.u_sd_deg], axis=-1)


def states_of(network: Network) -> tuple[list[dict[str, float]], dict[str, list[int]], list[_Beside]]:
    """Return the states to be traced, the indices of `motion_states`, and those of states on either side of rest."""
    states, places = motion_states(network)
    beside = []
    for motion in network.motion:
        step = SLOPE_SHARE * (motion.to_deg - motion.from_deg)
        ends = max(motion.at_deg - step, motion.from_deg), min(motion.at_deg + step, motion.to_deg)
        beside.append(_Beside((len(states), len(states) + 1), ends[1] - ends[0]))
        states += [{motion.name: end} for end in ends]
    return states, places, beside


class NetworkMerits:
    """Merits of a network's points, as defined by `solen.explore.measures.Measure`."""

    calibrated: tuple[str, ...] = ()

    def __init__(self, design: Design) -> None:
        """Create the merits of a design.

        Raises
        ------
        SpecError, DesignError
            If a motion has too few steps, or two merits would have the same name.
        """
        self.network = design.network
        self.states, self.places, _ = states_of(self.network)
        for number, motion in enumerate(self.network.motion):
            if motion.steps < MIN_STEPS:
                limit = f"merits require {MIN_STEPS}"
                raise SpecError(f"network.motion[{number}].steps", value=motion.steps, limit=limit)
        twice = next((name for name, times in Counter(self._stated()).items() if times > 1), None)
        if twice is not None:
            raise DesignError(
                "network", value=twice, limit="would be the name of two merits", remedy="rename a part or a reading"
            )
        self.names = tuple(self._stated())
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
        power, u_power = (each.reshape(shape) for each in (point.power, point.u_power))
        on_ranges = 1 + max((place for row in self.places.values() for place in row), default=0)
        rows = dict(self._light(power[:on_ranges], u_power[:on_ranges]))
        rows |= zip(self._of_motions(), self._sds(point), strict=True)
        reading, u_reading = readings_of(self.network, power, u_power)
        for (number, one), motion in product(enumerate(self.network.reading), self.network.motion):
            places = self.places[motion.name]
            course = reading[places, number], u_reading[places, number]
            about = word(one.name), word(motion.name)
            names = _names_of_course(*about)
            rows |= zip(names, _of_course(np.array(motion.angles_deg()), *course, motion.at_deg), strict=True)
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
                place = int(np.argmin(power[:, i, j]))
                yield _channel(emitter.name, receiver.name), (float(power[place, i, j]), float(u_power[place, i, j]))

    def _sds(self, point: Point) -> list[tuple[float, float]]:
        """Return the largest standard deviation of the motions, followed by all of them."""
        rows: list[tuple[float, float]] = [(sd, u) for sd, u in point.sd_deg.tolist()]
        return [*([max(rows)] if rows else []), *rows]

    def _of_motions(self) -> list[str]:
        names = [f"sd_{word(motion.name)}_deg" for motion in self.network.motion]
        return [*(["worst_sd_deg"] if names else []), *names]

    def _stated(self) -> Iterator[str]:
        yield "light"
        yield from (_channel(a.name, b.name) for a, b in product(self.network.emitters, self.network.receivers))
        yield from self._of_motions()
        for reading, motion in product(self.network.reading, self.network.motion):
            yield from _names_of_course(word(reading.name), word(motion.name))


def word(name: str) -> str:
    """Convert a name to a valid part of a merit's name."""
    return re.sub(r"\W", "_", name)


def _channel(emitter: str, receiver: str) -> str:
    return f"{CHANNEL}{word(emitter)}_{word(receiver)}"


def _names_of_course(reading: str, motion: str) -> tuple[str, str, str]:
    return f"slope_{reading}_{motion}_per_deg", f"span_{reading}_{motion}", f"range_{reading}_{motion}_deg"


def _of_course(
    angle: FloatArray, value: FloatArray, u: FloatArray, at_deg: float
) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Return the slope of a reading at rest, its span, and the length of its monotonic range about rest."""
    if not (np.isfinite(value).all() and np.isfinite(u).all()):
        return ((math.nan, math.nan),) * 3
    second = every_second(angle.size)
    slope = float(CubicSpline(angle, value)(at_deg, 1))
    rough = float(CubicSpline(angle[second], value[second])(at_deg, 1)) if second.size > MIN_STEPS else 2.0 * slope
    step = float(np.diff(angle).max())
    near = int(np.argmin(np.abs(angle - at_deg)))
    u_slope = 1.5 * float(u[max(0, near - 1) : near + 2].max()) / step + COARSE_SHARE * abs(rough - slope)
    high, low = int(np.argmax(value)), int(np.argmin(value))
    span = float(value[high] - value[low]), float(u[high] + u[low])
    return (slope, u_slope), span, monotone_deg(angle, value, u, at_deg)
