"""Simulated sensors: the design of each with variations between prints, traced, with individual parts.

Prints of one design differ in index, decentre of the emitter, chip and parts. Each print is drawn once, with the rig's
seed, and its response is **traced**, angle by angle; in between it is interpolated monotonically, with as many traced
angles as needed.

Public names: `simulated_sensors`, `simulated_networks` and `room_light_mw_cm2`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.bench.rig import Rig, RoomLight, SensorOf, check_names
from solen.bench.simulated.networks import SimulatedNetwork, traced_network, with_parts
from solen.errors import BenchError
from solen.parts import AdcPart, library_part
from solen.readout import Adc, Circuit, circuit_of, face_areas_mm2
from solen.sensor import Response, Sensor
from solen.sensor.loaded import force_of
from solen.sensor.readings import received
from solen.spec import Design, load, with_values
from solen.spec.placed import state_of
from solen.spec.soft import driven

ANGLES, DEPTHS = 25, 9
"""Number of angles, or of depths of a finger, at which a response is traced at first."""
CLOSE = 2e-4
"""Largest difference between a value traced midway and its interpolation, as a fraction of the brightest value."""
TOLERANCE = 2e-4
"""Tolerance of a fraction of the emitted power integrated over the chip; the error is mostly ten times smaller."""
HALVINGS = 6
"""Largest number of times a step between two angles is halved, which limits the refinement at a jump."""
BEYOND = 1.02
"""Traced range relative to the protocol's range, because a stage may overshoot."""
MAX_DEG = 80.0
"""Largest angle in degrees at which a sensor can be traced."""
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class SimulatedSensor:
    """One simulated sensor.

    Attributes
    ----------
    wires
        Its wiring.
    drawn
        Values drawn for it: index, decentre and width of the chip, and the gains of its parts, in V.
    angle_deg, fractions
        Angles (N,) and fractions of the emitted power (N, 2) at the right and the left receiver, as traced.
    circuit
        Its emitter, receivers and converter.
    force_N
        For a soft sensor, the force on the finger at each depth (N,), and ``angle_deg`` contains these depths; None for
        others.
    """

    wires: SensorOf
    drawn: dict[str, float]
    angle_deg: FloatArray
    fractions: FloatArray
    circuit: Circuit
    force_N: FloatArray | None = None

    def at(self, angle_deg: FloatArray) -> FloatArray:
        """Return the fractions of the emitted power (..., 2) at angles (...)."""
        inside = np.clip(angle_deg, self.angle_deg[0], self.angle_deg[-1])
        return np.asarray(self._curve(inside))

    @property
    def places(self) -> list[int]:
        """Inputs of its receivers, from 0."""
        return [number - 1 for number in self.wires.read_on.values()]

    def shares(self, angle_deg: FloatArray, emitter: IntArray) -> FloatArray:
        """Return the fractions of the emitted power (N, 2) at angles (N,), with an emitter on (from 0; -1: none)."""
        light = np.zeros((len(angle_deg), 2))
        on = emitter == next(iter(self.wires.lit_by.values())) - 1
        light[on] = self.at(angle_deg[on])
        return light

    def pressed_N(self, depth_mm: FloatArray) -> FloatArray:
        """Return the forces (...) on the finger at depths (...).

        0 if it does not touch, or for a sensor that is bent.
        """
        if self.force_N is None:
            return np.zeros(depth_mm.shape)
        return np.asarray(self._force(np.clip(depth_mm, self.angle_deg[0], self.angle_deg[-1])))

    @cached_property
    def _force(self) -> Callable[[FloatArray], FloatArray]:
        return between(self.angle_deg, np.zeros(self.angle_deg.shape) if self.force_N is None else self.force_N)

    @cached_property
    def _curve(self) -> Callable[[FloatArray], FloatArray]:
        return between(self.angle_deg, self.fractions)


def simulated_networks(
    rig: Rig,
    folder: Path,
    visited_deg: Mapping[str, tuple[float, float]],
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> tuple[SimulatedNetwork, ...]:
    """Return all networks of a simulated rig, traced over the whole ranges of their motions.

    Parameters
    ----------
    rig, folder, rng, progress
        As in `simulated_sensors`.
    visited_deg
        Angles that each motion reaches, which must be within its range.

    Raises
    ------
    BenchError, SpecError, DataError, DesignError
        If a design cannot be read, cannot be built, or cannot vary as the rig states, or a motion goes beyond its
        range.
    """
    check_names(rig, folder)
    made = []
    for wires in rig.sensor:
        if progress is not None:
            progress(f"tracing {wires.name}")
        design = load(folder / wires.design)
        for end in (0, 1):
            state_of(design, {motion: reached[end] for motion, reached in visited_deg.items()})
        motions = {motion.name: (motion.from_deg, motion.to_deg) for motion in design.network.motion}
        ranges = {motion: motions[motion] for motion in visited_deg}
        drawn = _drawn(rig, wires, design, rng)
        kept = folder / f"{wires.name}.traced.npz"
        network = replace(traced_network(wires, with_values(design, drawn), ranges, kept), drawn=drawn)
        network = with_parts(network, rng) if rig.spread.parts else network
        light = network.strength[:, None] * network.fractions
        made.append(replace(network, circuit=_set(rig, network.circuit, light.reshape(-1, light.shape[-1]))))
    return tuple(made)


def simulated_sensors(
    rig: Rig, folder: Path, reach_deg: float, rng: np.random.Generator, progress: Progress | None = None
) -> tuple[SimulatedSensor, ...]:
    """Return all sensors of a simulated rig, traced up to an angle in both directions.

    Raises
    ------
    BenchError, SpecError, DataError, DesignError
        If a design cannot be read, cannot be built, or cannot vary as the rig states.
    """
    if rig.stage.drives == "angle" and reach_deg > MAX_DEG:
        limit = f"a simulated sensor is traced up to {MAX_DEG:g} deg"
        raise BenchError("the protocol's reach in deg", value=reach_deg, limit=limit, remedy="turn less far")
    made = []
    for wires in rig.sensor:
        if progress is not None:
            progress(f"tracing {wires.name}")
        made.append(_print(rig, wires, load(folder / wires.design), reach_deg, rng))
    return tuple(made)


def _print(rig: Rig, wires: SensorOf, design: Design, reach_deg: float, rng: np.random.Generator) -> SimulatedSensor:
    drawn = _drawn(rig, wires, design, rng)
    pressed = rig.stage.drives == "depth"
    values = np.linspace(0.0, BEYOND * reach_deg, DEPTHS) if pressed else _angles(reach_deg)
    swept = _swept_depths(design, wires.design, values) if pressed else with_values(design, _sweep(values))
    sensor = Sensor.of(with_values(swept, drawn))
    sensor = replace(sensor, cut=Sensor.of(design).cut)  # another index, but the lens of the design
    if not wires.lens:
        sensor = sensor.without_lens
    sensor.check_pair()
    angle_deg, fractions = traced(sensor, values)
    areas = face_areas_mm2(sensor.design, sensor.body())
    circuit = circuit_of(sensor.design, {name: areas[name] for name in ("right", "left")})
    if rig.spread.parts:
        circuit = circuit.drawn(rng)
    circuit = _set(rig, circuit, fractions)
    forces = np.array([force_of(sensor, value) for value in angle_deg.tolist()]) if pressed else None
    simulated_sensor = SimulatedSensor(wires, drawn | _gains(circuit), angle_deg, fractions, circuit, forces)
    simulated_sensor.at(simulated_sensor.angle_deg[:1])  # imports are done here, not while a run waits
    return simulated_sensor


def _angles(reach_deg: float) -> FloatArray:
    end = max(BEYOND * reach_deg, 0.1)
    return np.linspace(-end, end, ANGLES)


def _sweep(angle_deg: FloatArray) -> dict[str, float]:
    low, high = angle_deg[[0, -1]].tolist()
    return {"motion.from_deg": low, "motion.to_deg": high, "motion.step_deg": (high - low) / (ANGLES - 1)}


def _swept_depths(design: Design, file: str, depth_mm: FloatArray) -> Design:
    """Return a loaded design whose finger is pushed to depths, whether its depth or its force is driven."""
    motion = design.motion
    if motion.kind != "loaded" or (drives := driven(design))[0] != "press":
        what = f"turns ({motion.kind})" if motion.kind != "loaded" else f"drives {motion.drives}"
        limit = f"{what}, and the stage of the rig presses a finger into the sensor"
        remedy = 'use a design with motion.kind = "loaded" whose [[press]] is driven, or omit stage.drives'
        raise BenchError(file, limit=limit, remedy=remedy)
    stated = {"drives": f"{drives[1]}.depth_mm", "depths_mm": tuple(depth_mm.tolist()), "forces_N": None}
    return design.model_copy(update={"motion": motion.model_copy(update=stated)}).in_folder(design.folder)


def traced(sensor: Sensor, angle_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return angles (N,) and fractions (N, 2) at the right and the left receiver, dense enough for interpolation.

    Every step is halved until the power traced midway is within `CLOSE` of the interpolation.
    """
    found = sensor.power(angle_deg.tolist(), tolerance=TOLERANCE)
    wide = np.ones(len(angle_deg) - 1, dtype=bool)
    for _ in range(HALVINGS):
        guessed = between(found.angle_deg, _shares(found))
        steps = np.flatnonzero(wide)
        middles = 0.5 * (found.angle_deg[steps] + found.angle_deg[steps + 1])
        more = sensor.power(middles.tolist(), tolerance=TOLERANCE)
        off = np.abs(_shares(more) - guessed(middles)).max(axis=1) > CLOSE * _shares(found).max()
        found = found.merged(more)
        if not off.any():
            break
        begun = np.searchsorted(found.angle_deg, middles[off])
        wide = np.zeros(len(found.angle_deg) - 1, dtype=bool)
        wide[np.concatenate([begun - 1, begun])] = True
    return found.angle_deg, received(sensor, found)


def _shares(response: Response) -> FloatArray:
    return np.column_stack([response.right, response.left])


def between(angle_deg: FloatArray, fractions: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Interpolate fractions (..., 2) at any angles (...), monotone where the given values are."""
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(angle_deg, fractions)


def _gains(circuit: Circuit) -> dict[str, float]:
    """Return the drop in volts that all of the emitted light would cause at each receiver with an unlimited supply."""
    none, whole = circuit.current_mA(np.array([[0.0, 0.0], [1.0, 1.0]]))
    gains = 1e-3 * (whole - none) * np.array(circuit.load_ohm)
    return {f"gain_{name}_V": float(gain) for name, gain in zip(circuit.names, gains, strict=True)}


def converter(rig: Rig) -> Adc:
    """Return the converter of the rig: unipolar on the board, bipolar in a data acquisition."""
    board, daq = rig.board, rig.daq
    if daq is None:
        return Adc("board", board.bits, 0.0, board.range_v, 1e-6 * board.noise_uv)
    part = cast(AdcPart, library_part(daq.kind))  # part of that kind in the shipped library
    adc = Adc.of(part, daq.range_v, (-daq.range_v, daq.range_v))
    return adc if daq.noise_uv is None else replace(adc, noise_V=1e-6 * daq.noise_uv)


def _set(rig: Rig, circuit: Circuit, fractions: FloatArray) -> Circuit:
    """Return a circuit with the rig's converter, and trimmers that are set if the rig states their level."""
    rate_hz = rig.board.rate_hz if rig.daq is None else rig.daq.switch_hz
    circuit, to_v = replace(circuit, adc=converter(rig), rate_hz=rate_hz), (rig.daq or rig.board).trim_v
    return circuit if to_v is None else _trimmed(circuit, fractions, rig.ambient.mean_mw_cm2, to_v)


def _trimmed(circuit: Circuit, fractions: FloatArray, room_mw_cm2: float, to_v: float) -> Circuit:
    """Return a circuit with loads that put the brightest reading at a given voltage, within the trimmers' range."""
    if to_v >= circuit.supply_V:
        limit = f"must be below the supply, {circuit.supply_V:g} V"
        raise BenchError("trim_v", value=to_v, limit=limit)
    most_ma = circuit.current_mA(fractions, room_mw_cm2).max(axis=0)
    wanted = 1e3 * (circuit.supply_V - to_v) / most_ma
    return replace(circuit, load_ohm=tuple(np.minimum(wanted, circuit.load_ohm).tolist()))


def _drawn(rig: Rig, wires: SensorOf, design: Design, rng: np.random.Generator) -> dict[str, float]:
    """Draw the deviations of this print.

    Every number is drawn, and one standard deviation does not affect the other draws.
    """
    index, offset, chip = rng.standard_normal(3)
    spread, values = rig.spread, {}
    if spread.index > 0.0:
        if design.material.index is None:
            limit = f"needs material.index in {wires.design}, which names a resin"
            raise BenchError("spread.index", value=spread.index, limit=limit, remedy="state the index there")
        values["material.index"] = design.material.index + spread.index * float(index)
    if spread.emitter_offset_mm > 0.0:
        values["emitter.offset_mm"] = design.emitter.offset_mm + spread.emitter_offset_mm * float(offset)
    if spread.chip_mm > 0.0:
        values["emitter.width_mm"] = max(0.0, design.emitter.width_mm + spread.chip_mm * float(chip))
    return values


def room_light_mw_cm2(room: RoomLight, time_s: FloatArray, phase: float) -> FloatArray:
    """Return the ambient light in mW/cm² at times, shape as given, with its flicker beginning at a phase.

    Never below 0.
    """
    drift = 1.0 + 1e-2 * room.drift_percent_per_min * time_s / 60.0
    flicker = 1e-2 * room.flicker_percent * np.sin(2.0 * math.pi * room.flicker_hz * time_s + phase)
    return np.asarray(np.maximum(0.0, room.mean_mw_cm2 * drift * (1.0 + flicker)))
