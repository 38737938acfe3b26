"""Power at every receiver of a network from each emitter, with the emitters lit in turn.

With one emitter lit and the motions at given angles, a network can be traced like a sensor with a single emitter:
`emitter_sensors` returns one such sensor per emitter. Powers are fractions of the power of the lit emitter.
`network_trace` traces one state, `network_response` several.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError, SpecError
from solen.progress import Progress, on_threads
from solen.results import HIDDEN, Result
from solen.scene.sources.points import COPIES
from solen.sensor.network.readings import readings_of, without_value
from solen.sensor.sensor import MAX_SAMPLED, Sensor
from solen.sensor.unused_keys import keys_without_effect
from solen.spec import Design
from solen.spec.placed import lit, state_of
from solen.trace import Mode, Trace
from solen.trace.nets import integrate_by_nets
from solen.trace.options import TraceOptions, trace_with
from solen.trace.result import Ledger

DEFAULT_TOLERANCE = 5e-4
"""Default uncertainty of a power, as a fraction of the emitted power."""
MIN_SAMPLED_TOLERANCE, RAYS_AT_UNIT_TOLERANCE, MIN_RAYS = 2e-4, 0.03, 2**12
"""Tolerance from which powers are sampled, which is faster than integration; product of the initial number of rays and
the squared tolerance; minimum number of rays.
"""
NET_UNCERTAINTY = 1.25 * math.sqrt((COPIES - 1) / (COPIES - 3))
"""Ratio of the standard uncertainty of a mean over nets to its standard error. The standard error of so few nets is
itself uncertain: the error in units of it follows Student's t distribution (GUM Supplement 1, 6.4.9.4). If few rays
carry the power, the standard error is also too small, by a factor of up to 1.25 for all powers of a network and 40 sets
of rays.
"""


class NetworkResponse(Result):
    """Powers and readings of a network in several states.

    Attributes
    ----------
    motions, emitters, receivers, readings
        Names of the motions, emitters, receivers and readings.
    angle_deg
        Angles (states, motions) of the motions.
    power, u_power
        Fractions (states, emitters, receivers) of the power of the lit emitter, and their uncertainties.
    reading, u_reading
        Values (states, readings) of its readings, NaN if undefined, and upper bounds of their uncertainties.
    ledgers
        Power ledger of each emitter, for each state.
    simulated
        Always true.
    """

    motions: tuple[str, ...]
    emitters: tuple[str, ...]
    receivers: tuple[str, ...]
    readings: tuple[str, ...]
    angle_deg: FloatArray
    power: FloatArray
    u_power: FloatArray
    reading: FloatArray
    u_reading: FloatArray
    ledgers: tuple[tuple[Ledger, ...], ...] = ()
    simulated: bool = True


class NetworkTrace(NetworkResponse, kw_only=True):
    """Response of a network in one state, with the emitters lit in turn.

    Attributes
    ----------
    sensors
        The sensor of each emitter; not in JSON.
    name
        Name of the design.
    mode, method
        Trace mode and sampling method.
    warnings
        Warnings about the design, including keys without effect.
    """

    sensors: tuple[Sensor, ...] = field(metadata=HIDDEN)
    name: str
    mode: str
    method: str
    warnings: tuple[str, ...]


def emitter_sensors(design: Design) -> tuple[Sensor, ...]:
    """Return the sensors of a network's emitters, in the order of the design.

    Raises
    ------
    DesignError
        If the design is not a network.
    """
    if design.body.kind != "network":
        limit = 'must be "network": other bodies have a single emitter'
        raise DesignError("body.kind", value=design.body.kind, limit=limit)
    return tuple(Sensor.of(lit(design, emitter.name)) for emitter in design.network.emitters)


def network_trace(design: Design, options: TraceOptions = TraceOptions()) -> NetworkTrace:
    """Trace a network with its motions as in the design, lit by each emitter; raise the errors of `trace_with`."""
    sensors = emitter_sensors(design)
    traces = [trace_with(sensor.scene(), options, design.trace.mode) for sensor in sensors]
    state = [[motion.at_deg for motion in design.network.motion]]
    response = _response(sensors, state, [traces])
    return NetworkTrace(
        **vars(response),
        sensors=sensors,
        name=design.name,
        mode=traces[0].mode,
        method=traces[0].method,
        warnings=(*warnings_of(sensors, options.mode or design.trace.mode), *reading_warnings(response)),
    )


def check_single_emitter_options(options: Mapping[str, object]) -> None:
    """Raise `SpecError` for an option that does not apply to a trace with several emitters in turn."""
    for name, value in options.items():
        if value is not None:
            is_motion = name in ("--angle-deg", "--at")
            limit = f"applies to a single {'motion' if is_motion else 'emitter'}, and a network has several"
            remedy = "use --set network.motion[0].at_deg=..." if is_motion else "add --emitter"
            raise SpecError(name, value=None if value is True else str(value), limit=limit, remedy=remedy)


def network_response(
    design: Design,
    angles_deg: Sequence[Mapping[str, float]],
    tolerance: float = DEFAULT_TOLERANCE,
    progress: Progress | None = None,
    *,
    built: Callable[[Sensor], Sensor] | None = None,
    lattice: int = 0,
) -> NetworkResponse:
    """Return the response in power of a network in several states of its motions.

    Parameters
    ----------
    design
        The network.
    angles_deg
        For each state, the angles of motions in degrees, keyed by name; the other motions are as in the design.
    tolerance
        Largest uncertainty of a power, as in `Sensor.power`.
    progress
        Function called with the completed fraction, up to 1.
    built
        Function from each sensor to the sensor traced in its place, for example with deviations of the built part.
    lattice
        Seed of the rays.

    Raises
    ------
    SpecError
        If the network does not have a named motion, or an angle is outside the motion's range.
    DesignError
        If the body cannot be built in a state.
    """
    designs = [state_of(design, state) for state in angles_deg]
    return response_of(designs, tolerance, progress, built=built, lattice=lattice)


def response_of(
    designs: Sequence[Design],
    tolerance: float = DEFAULT_TOLERANCE,
    progress: Progress | None = None,
    *,
    built: Callable[[Sensor], Sensor] | None = None,
    lattice: int = 0,
) -> NetworkResponse:
    """Return the response of designs with the same motions, emitters and receivers, one state for each design.

    The motions are at the ``at_deg`` of each design; see `network_response`.
    """

    def traced(design: Design) -> list[Trace]:
        sensors = emitter_sensors(design) if built is None else map(built, emitter_sensors(design))
        return [_traced(sensor, tolerance, lattice) for sensor in sensors]

    rows = on_threads(traced, designs, progress)
    angles_deg = [[motion.at_deg for motion in design.network.motion] for design in designs]
    return _response(emitter_sensors(designs[0]), angles_deg, rows)


def _traced(sensor: Sensor, tolerance: float, lattice: int) -> Trace:
    """Trace the powers from one emitter: sampled if the tolerance is large, otherwise as by `Sensor.reading`."""
    if tolerance < MIN_SAMPLED_TOLERANCE:
        return sensor.reading(tolerance=tolerance)[0]
    first_rays = max(2 ** round(math.log2(RAYS_AT_UNIT_TOLERANCE / tolerance**2)), MIN_RAYS)
    return integrate_by_nets(
        sensor.scene(),
        tolerance / NET_UNCERTAINTY,
        "roulette",
        max_rays=MAX_SAMPLED,
        threads=1,
        first_rays=first_rays,
        seed=lattice,
    )


def _response(
    sensors: Sequence[Sensor], angles_deg: Sequence[Sequence[float]], traces: Sequence[Sequence[Trace]]
) -> NetworkResponse:
    names, receivers = tuple(sensor.design.network.lit or "" for sensor in sensors), receivers_of(sensors)
    shape = (len(traces), len(names), len(receivers))
    detected = [trace.detectors[name] for row in traces for trace in row for name in receivers]
    network = sensors[0].design.network
    motions = tuple(motion.name for motion in network.motion)
    power = np.array([(*row.power_by_source, row.power)[0] for row in detected]).reshape(shape)
    factors = [[NET_UNCERTAINTY if trace.method == "sobol" else 1.0 for trace in row] for row in traces]
    u_power = np.array([row.u_power for row in detected]).reshape(shape) * np.array(factors)[..., None]
    reading, u_reading = readings_of(network, power, u_power)
    return NetworkResponse(
        motions=motions,
        emitters=names,
        receivers=receivers,
        angle_deg=np.array(angles_deg, dtype=float).reshape(len(traces), len(motions)),
        readings=tuple(reading.name for reading in network.reading),
        power=power,
        u_power=u_power,
        reading=reading,
        u_reading=u_reading,
        ledgers=tuple(tuple(trace.ledger for trace in row) for row in traces),
    )


def reading_warnings(response: NetworkResponse) -> list[str]:
    """Return warnings about readings without a value or an uncertainty in some state of a response."""
    return without_value(response.readings, response.reading, response.u_reading)


def receivers_of(sensors: Sequence[Sensor]) -> tuple[str, ...]:
    """Return the names of the receivers, in the order of the design."""
    return tuple(placed.name for placed in sensors[0].design.network.receivers)


def warnings_of(sensors: Sequence[Sensor], mode: Mode | None = None) -> tuple[str, ...]:
    """Return the warnings about the sensors of all emitters, without duplicates."""
    rows = (text for sensor in sensors for text in (*sensor.warnings, *keys_without_effect(sensor, mode)))
    return tuple(dict.fromkeys(rows))
