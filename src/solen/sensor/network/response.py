"""Power at every receiver of a network from each emitter, with the emitters lit in turn.

With one emitter lit and the motions at given angles, a network is a sensor like any other. Its response consists of one
sensor per emitter. Powers are fractions of the power emitted by the lit emitter.

`in_turn` returns these sensors, `network_trace` traces one state, `network_response` several.
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
from solen.trace.nets import by_nets
from solen.trace.options import TraceOptions, trace_with
from solen.trace.result import Ledger

USUAL_TOLERANCE = 5e-4
"""Default uncertainty of a power, as a fraction of the emitted power."""
ROUGH, RAYS_OF_ONE, MIN_RAYS = 2e-4, 0.03, 2**12
"""Tolerance from which powers are sampled, which is faster than integration; initial number of rays multiplied by the
squared tolerance; minimum number of rays.
"""
OF_NETS = 1.25 * math.sqrt((COPIES - 1) / (COPIES - 3))
"""Factor from the standard error of a mean of nets to its standard uncertainty. With so few nets the standard error is
itself uncertain, and the error in units of it follows Student's t (Supplement 1 to the GUM, 6.4.9.4). The standard
error is also too small, by up to 1.25 over all powers of a network and 40 lattices, if few rays carry the power.
"""


class NetworkResponse(Result):
    """Powers by state, emitter and receiver.

    Attributes
    ----------
    motions, emitters, receivers, readings
        Names of the motions, emitters, receivers and readings.
    angle_deg
        Angles (states, motions) of the motions.
    power, u_power
        Fractions (states, emitters, receivers) of the power of the lit emitter, and their uncertainties.
    reading, u_reading
        Values (states, readings) of its readings, NaN if one does not exist, and bounds of their uncertainties.
    ledgers
        Ledger of each emitter, for each state.
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
    """Response of a network in one state: all emitters in turn.

    Attributes
    ----------
    sensors
        The sensor of each emitter; not in JSON.
    name
        Name of the design.
    mode, method
        How rays were followed and chosen.
    warnings
        Warnings, and keys without effect.
    """

    sensors: tuple[Sensor, ...] = field(metadata=HIDDEN)
    name: str
    mode: str
    method: str
    warnings: tuple[str, ...]


def in_turn(design: Design) -> tuple[Sensor, ...]:
    """Return the sensors of a network's emitters, in the order of the design.

    Raises
    ------
    DesignError
        If the design is not a network.
    """
    if design.body.kind != "network":
        limit = "has one emitter; only a network has several emitters to light in turn"
        raise DesignError("body.kind", value=design.body.kind, limit=limit, remedy='set body.kind = "network"')
    return tuple(Sensor.of(lit(design, emitter.name)) for emitter in design.network.emitters)


def network_trace(design: Design, options: TraceOptions = TraceOptions()) -> NetworkTrace:
    """Trace a network with its motions as in the design and its emitters in turn; raises the errors of `trace_with`."""
    sensors = in_turn(design)
    traces = [trace_with(sensor.scene(), options, design.trace.mode) for sensor in sensors]
    state = [[motion.at_deg for motion in design.network.motion]]
    found = _response(sensors, state, [traces])
    return NetworkTrace(
        **vars(found),
        sensors=sensors,
        name=design.name,
        mode=traces[0].mode,
        method=traces[0].method,
        warnings=(*warnings_of(sensors, options.mode or design.trace.mode), *unread_in(found)),
    )


def refuse_in_turn(options: Mapping[str, object]) -> None:
    """Raise `SpecError` for an option that does not apply to a trace of several emitters."""
    for name, value in options.items():
        if value is not None:
            moves = name in ("--angle-deg", "--at")
            limit = f"applies to a single {'motion' if moves else 'emitter'}; a network has several"
            remedy = "use --set network.motion[0].at_deg=..." if moves else "add --emitter"
            raise SpecError(name, value=None if value is True else str(value), limit=limit, remedy=remedy)


def network_response(
    design: Design,
    angles_deg: Sequence[Mapping[str, float]],
    tolerance: float = USUAL_TOLERANCE,
    progress: Progress | None = None,
    *,
    built: Callable[[Sensor], Sensor] | None = None,
    lattice: int = 0,
) -> NetworkResponse:
    """Return the response of a network in power over states, each given by the angles of its motions by name.

    Parameters
    ----------
    design
        The network.
    angles_deg
        For each state, the angles in degrees of the named motions; the others are as in the design.
    tolerance
        Largest uncertainty of a power, as in `Sensor.power`.
    progress
        Function called with the completed fraction, up to 1.
    built
        Function that converts a sensor to the one that is traced, for example with deviations of the built part.
    lattice
        Number of the rays' lattice, which selects other rays.

    Raises
    ------
    SpecError
        If the network does not have a motion, or an angle is beyond its range.
    DesignError
        If the body cannot be built in a state.
    """
    moved = [state_of(design, state) for state in angles_deg]
    return response_of(moved, tolerance, progress, built=built, lattice=lattice)


def response_of(
    designs: Sequence[Design],
    tolerance: float = USUAL_TOLERANCE,
    progress: Progress | None = None,
    *,
    built: Callable[[Sensor], Sensor] | None = None,
    lattice: int = 0,
) -> NetworkResponse:
    """Return the response of designs with the same motions, emitters and receivers, at rest; see `network_response`."""

    def traced(each: Design) -> list[Trace]:
        sensors = in_turn(each) if built is None else map(built, in_turn(each))
        return [_traced(sensor, tolerance, lattice) for sensor in sensors]

    rows = on_threads(traced, designs, progress)
    return _response(in_turn(designs[0]), [[motion.at_deg for motion in each.network.motion] for each in designs], rows)


def _traced(sensor: Sensor, tolerance: float, lattice: int) -> Trace:
    """Trace the powers from one emitter: sampled if the tolerance is large or integration fails, else integrated."""
    if tolerance < ROUGH:
        return sensor.reading(tolerance=tolerance)[0]
    first = max(2 ** round(math.log2(RAYS_OF_ONE / tolerance**2)), MIN_RAYS)
    scene = sensor.scene()
    return by_nets(
        scene, tolerance / OF_NETS, "roulette", most_rays=MAX_SAMPLED, threads=1, first_rays=first, seed=lattice
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
    factors = [[OF_NETS if trace.method == "sobol" else 1.0 for trace in row] for row in traces]
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


def unread_in(response: NetworkResponse) -> list[str]:
    """Return warnings about readings that have no certain value in some state of a response."""
    return without_value(response.readings, response.reading, response.u_reading)


def receivers_of(sensors: Sequence[Sensor]) -> tuple[str, ...]:
    """Return the names of the receivers, in the order of the design."""
    return tuple(placed.name for placed in sensors[0].design.network.receivers)


def warnings_of(sensors: Sequence[Sensor], mode: Mode | None = None) -> tuple[str, ...]:
    """Return warnings about all emitters' sensors, without duplicates."""
    rows = (text for sensor in sensors for text in (*sensor.warnings, *keys_without_effect(sensor, mode)))
    return tuple(dict.fromkeys(rows))
