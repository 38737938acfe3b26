"""A network of guides: its emitters in turn, and what every receiver gets of each.

The idea: with one emitter alight and the motions at their angles a network is a sensor like any other, so a response is
that of as many sensors as there are emitters. Powers are fractions of what the emitter that lights emits.

The interface: `network_trace` at one state, `network_response` over states, `network_study` over every motion's range.
"""

import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from solen.arrays import FloatArray, Progress
from solen.errors import DesignError, SpecError
from solen.geometry.network import network_lenses
from solen.lens import CurvedLens
from solen.material import Optical
from solen.results import HIDDEN, Result, reported
from solen.sensor.network_readings import readings_of, without_value
from solen.sensor.sensor import MOST_SAMPLED, Sensor
from solen.sensor.unused_keys import keys_without_effect
from solen.spec import Design
from solen.spec.placed import lit, state_of, states
from solen.trace import Mode, Trace
from solen.trace.nets import by_nets
from solen.trace.options import TraceOptions, trace_with
from solen.trace.result import Ledger

USUAL_TOLERANCE = 5e-4
"""Default uncertainty of a power, as a share of what its emitter emits."""
ROUGH, RAYS_OF_ONE, FEWEST_RAYS = 2e-4, 0.03, 2**12
"""Tolerance from which on powers are sampled, quicker than integrated; rays to begin with, times its square; fewest."""


@dataclass(frozen=True)
class LensOfNetwork:
    """A lens of a network, and where its emitter's light meets in the material, mm behind its vertex."""

    name: str
    shape: str
    half_width_mm: float
    depth_mm: float
    best_focus_mm: float | None


@dataclass(frozen=True)
class EmitterOfNetwork:
    """An emitter of a network: its place, its direction, counter-clockwise from +z, and its light."""

    name: str
    x_mm: float
    z_mm: float
    axis_deg: float
    wavelength_nm: float


class NetworkCheck(Result):
    """A network that can be built in the checked states of its motions.

    Attributes
    ----------
    name
        Name of the design.
    states
        States in which its body was built: each motion over its range, and the ends of all together.
    material
        Index and absorption at the first emitter's wavelength.
    guides, receivers, motions
        Their names.
    readings
        Expressions of its readings, by name.
    lenses, emitters
        Its lenses, and its emitters at rest.
    faces
        Names of all faces.
    area_mm2
        Area of the section.
    warnings
        Warnings about the design, and keys of it that have no effect.
    """

    name: str
    states: int
    material: Optical
    guides: tuple[str, ...]
    lenses: tuple[LensOfNetwork, ...]
    emitters: tuple[EmitterOfNetwork, ...]
    receivers: tuple[str, ...]
    motions: tuple[str, ...]
    readings: dict[str, str]
    faces: tuple[str, ...]
    area_mm2: float
    warnings: tuple[str, ...]


class NetworkResponse(Result):
    """Powers by state, emitter and receiver.

    Attributes
    ----------
    motions, emitters, receivers, readings
        Their names.
    angle_deg
        (states, motions) angles of the motions.
    power, u_power
        (states, emitters, receivers) fractions of what the emitter emits, and their uncertainties.
    reading, u_reading
        (states, readings) values of its readings, NaN where one has none, and bounds of their uncertainties.
    ledgers
        For each state the ledger of each emitter.
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
        Warnings, and keys that have no effect.
    """

    sensors: tuple[Sensor, ...] = field(metadata=HIDDEN)
    name: str
    mode: str
    method: str
    warnings: tuple[str, ...]


class NetworkStudy(Result):
    """Response of a network over the range of each of its motions, the others as they stand.

    Attributes
    ----------
    design
        The design studied.
    check
        Its check.
    at_rest
        Its response with the motions as they stand.
    sweeps
        Its response over the range of each motion, by the motion's name.
    warnings
        Reasons to doubt a value.
    simulated
        Always true.
    """

    sensors: tuple[Sensor, ...] = field(metadata=HIDDEN)
    design: Design
    check: NetworkCheck
    at_rest: NetworkResponse
    sweeps: dict[str, NetworkResponse]
    warnings: tuple[str, ...]
    simulated: bool = True

    @reported
    def name(self) -> str:
        """Name of the design."""
        return self.design.name


def in_turn(design: Design) -> tuple[Sensor, ...]:
    """Sensors of a network's emitters, in the order of the design.

    Raises
    ------
    DesignError
        If the design is no network.
    """
    if design.body.kind != "network":
        limit = "has one emitter; emitters in turn are those of a network"
        raise DesignError("body.kind", value=design.body.kind, limit=limit, remedy='set body.kind = "network"')
    return tuple(Sensor.of(lit(design, emitter.name)) for emitter in design.network.emitters)


def network_check(design: Design) -> NetworkCheck:
    """Check that a network can be built in all states of its motions; `DesignError` if it cannot."""
    sensors = in_turn(design)
    for sensor in sensors:
        sensor.check()
    body, network = sensors[0].body(), design.network
    return NetworkCheck(
        name=design.name,
        states=len(list(states(network))),
        material=sensors[0].material,
        guides=tuple(guide.name for guide in network.guides),
        lenses=tuple(_lens(sensors, name) for name in network_lenses(design)),
        emitters=tuple(_emitter(sensor) for sensor in sensors),
        receivers=_receivers(sensors),
        motions=tuple(motion.name for motion in network.motion),
        readings={one.name: one.value for one in network.reading},
        faces=tuple(face.name for face in (*body.all_faces, *body.apart)),
        area_mm2=body.area_mm2(),
        warnings=_warnings(sensors),
    )


def network_trace(design: Design, options: TraceOptions = TraceOptions()) -> NetworkTrace:
    """Trace a network in the state in which its motions stand, its emitters in turn; raises as `trace_with` does."""
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
        warnings=(*_warnings(sensors, options.mode or design.trace.mode), *unread_in(found)),
    )


def refuse_in_turn(options: Mapping[str, object]) -> None:
    """`SpecError` for an option that a trace of several emitters has not."""
    for name, value in options.items():
        if value is not None:
            moves = name in ("--angle-deg", "--at")
            limit = f"is of one {'motion' if moves else 'emitter'}; a network has several"
            remedy = "use --set network.motion[0].at_deg=..." if moves else "add --emitter"
            raise SpecError(name, value=None if value is True else str(value), limit=limit, remedy=remedy)


def network_response(
    design: Design,
    angles_deg: Sequence[Mapping[str, float]],
    tolerance: float = USUAL_TOLERANCE,
    progress: Progress | None = None,
) -> NetworkResponse:
    """Response of a network in power over states, each the angles of its motions by name.

    Parameters
    ----------
    design
        The network.
    angles_deg
        Of each state, the angles in degrees of the motions that it names; the others stand as in the design.
    tolerance
        Largest uncertainty of a power, as of `Sensor.power`.
    progress
        Called with the completed share, up to 1.

    Raises
    ------
    SpecError
        For a motion that the network does not have, or an angle beyond its range.
    DesignError
        If the body cannot be built in a state.
    """
    moved = [state_of(design, state) for state in angles_deg]
    rows: list[list[Trace]] = []
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        try:
            for row in pool.map(lambda each: [_traced(sensor, tolerance) for sensor in in_turn(each)], moved):
                rows.append(row)
                if progress is not None:
                    progress(len(rows) / len(moved))
        finally:
            pool.shutdown(cancel_futures=True)
    return _response(in_turn(design), [[one.at_deg for one in each.network.motion] for each in moved], rows)


def network_study(design: Design, progress: Progress | None = None, tolerance: float = USUAL_TOLERANCE) -> NetworkStudy:
    """Response of a network as it stands, and over the range of each of its motions; see `network_response`."""
    check, sensors = network_check(design), in_turn(design)
    ranges = {motion.name: [{motion.name: angle} for angle in motion.angles_deg()] for motion in design.network.motion}
    every = [{}, *(state for row in ranges.values() for state in row)]
    whole = network_response(design, every, tolerance, progress)
    ends = np.cumsum([1, *(len(row) for row in ranges.values())]).tolist()
    parts = pairwise(ends)
    sweeps = {name: _part(whole, *part) for name, part in zip(ranges, parts, strict=True)}
    return NetworkStudy(
        sensors=sensors,
        design=design,
        check=check,
        at_rest=_part(whole, 0, 1),
        sweeps=sweeps,
        warnings=(*check.warnings, *_rough(whole, design), *unread_in(whole)),
    )


def _traced(sensor: Sensor, tolerance: float) -> Trace:
    """Powers of one emitter's light: by samples to a rough tolerance, else integrated, or sampled where that fails."""
    if tolerance < ROUGH:
        return sensor.reading(tolerance=tolerance)[0]
    first = 2 ** round(math.log2(RAYS_OF_ONE / tolerance**2))
    return by_nets(
        sensor.scene(), tolerance, "roulette", most_rays=MOST_SAMPLED, threads=1, first_rays=max(first, FEWEST_RAYS)
    )


def _response(
    sensors: Sequence[Sensor], angles_deg: Sequence[Sequence[float]], traces: Sequence[Sequence[Trace]]
) -> NetworkResponse:
    names, receivers = tuple(sensor.design.network.lit or "" for sensor in sensors), _receivers(sensors)
    shape = (len(traces), len(names), len(receivers))
    detected = [trace.detectors[name] for row in traces for trace in row for name in receivers]
    network = sensors[0].design.network
    motions = tuple(motion.name for motion in network.motion)
    power = np.array([(*row.power_by_source, row.power)[0] for row in detected]).reshape(shape)
    u_power = np.array([row.u_power for row in detected]).reshape(shape)
    reading, u_reading = readings_of(network, power, u_power)
    return NetworkResponse(
        motions=motions,
        emitters=names,
        receivers=receivers,
        angle_deg=np.array(angles_deg, dtype=float).reshape(len(traces), len(motions)),
        readings=tuple(one.name for one in network.reading),
        power=power,
        u_power=u_power,
        reading=reading,
        u_reading=u_reading,
        ledgers=tuple(tuple(trace.ledger for trace in row) for row in traces),
    )


def _part(whole: NetworkResponse, low: int, high: int) -> NetworkResponse:
    """Some states of a response."""
    return replace(
        whole,
        angle_deg=whole.angle_deg[low:high],
        power=whole.power[low:high],
        u_power=whole.u_power[low:high],
        reading=whole.reading[low:high],
        u_reading=whole.u_reading[low:high],
        ledgers=whole.ledgers[low:high],
    )


def unread_in(response: NetworkResponse) -> list[str]:
    """Warnings about readings that have no certain value in some state of a response."""
    return without_value(response.readings, response.reading, response.u_reading)


def _receivers(sensors: Sequence[Sensor]) -> tuple[str, ...]:
    """Names of the receivers, in the order of the design."""
    return tuple(placed.name for placed in sensors[0].design.network.receivers)


def _lens(sensors: Sequence[Sensor], name: str) -> LensOfNetwork:
    """A lens, with its focus in the material at the wavelength of the emitter before it."""
    network = sensors[0].design.network
    lens = network_lenses(sensors[0].design)[name]
    before = [sensor for sensor, emitter in zip(sensors, network.emitters, strict=True) if emitter.lens == name]
    index = (before or sensors)[0].material.index
    focus = lens.best_focus_mm(index) if isinstance(lens, CurvedLens) else None
    return LensOfNetwork(name, lens.shape, lens.half_width_mm, lens.depth_mm, focus)


def _emitter(sensor: Sensor) -> EmitterOfNetwork:
    pose = sensor.body().emitter
    return EmitterOfNetwork(sensor.design.network.lit or "", *pose.point, pose.axis_deg, sensor.light.wavelength_nm)


def _warnings(sensors: Sequence[Sensor], mode: Mode | None = None) -> tuple[str, ...]:
    """Warnings about all emitters' sensors, each once."""
    rows = (text for sensor in sensors for text in (*sensor.warnings, *keys_without_effect(sensor, mode)))
    return tuple(dict.fromkeys(rows))


def _rough(response: NetworkResponse, design: Design) -> list[str]:
    """Warning where a power is less certain than samples should make it."""
    worst = float(np.nanmax(response.u_power, initial=0.0))
    if math.isnan(worst) or worst <= USUAL_TOLERANCE:
        return []
    return [f"powers of {design.name} are uncertain by up to {worst:.1e} of the emitted power"]
