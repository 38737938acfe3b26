"""Simulated sensors: prints of a design that vary, with individual parts, and their traced responses.

Prints of one design differ in index, decentre of the emitter, chip and parts. Each is sampled at random once, with the
rig's seed, and its response is **traced** at as many angles as a monotone interpolation between them needs.

Public names: `simulated_sensors`, `simulated_networks` and `ambient_mw_cm2`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.bench.rig import AmbientLight, Rig, SensorTable, check_names
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
"""Initial number of angles, or of depths of a finger, at which a response is traced."""
MAX_INTERPOLATION_ERROR = 2e-4
"""Largest difference between a value traced midway between two angles and the interpolation there, as a fraction of the
brightest value.
"""
TOLERANCE = 2e-4
"""Tolerance of a fraction of the emitted power, integrated over the chip; the error is mostly ten times smaller."""
MAX_HALVINGS = 6
"""Largest number of times that a step between two angles is halved, which limits the refinement at a discontinuity."""
RANGE_FACTOR = 1.02
"""Traced range relative to the protocol's range, because a stage may overshoot."""
MAX_DEG = 80.0
"""Largest angle in degrees at which a sensor can be traced."""
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class SimulatedSensor:
    """One simulated sensor.

    Attributes
    ----------
    wiring
        Its wiring.
    drawn
        Values of this print: index, decentre of the emitter, width of the chip, and the gains of its parts in V.
    angle_deg, fractions
        Traced angles (N,), and the fractions of the emitted power (N, 2) received on the right and the left.
    circuit
        Its emitter, receivers and ADC.
    force_N
        For a sensor that is pressed, the force on the finger at each depth (N,); ``angle_deg`` then contains the
        depths. None for others.
    """

    wiring: SensorTable
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
    def input_indices(self) -> list[int]:
        """Indices of the inputs of its receivers, from 0."""
        return [number - 1 for number in self.wiring.input_numbers.values()]

    def received(self, angle_deg: FloatArray, emitter: IntArray) -> FloatArray:
        """Return the fractions of the emitted power (N, 2) at angles (N,), with an emitter on (from 0; -1: none)."""
        fractions = np.zeros((len(angle_deg), 2))
        on = emitter == next(iter(self.wiring.emitter_numbers.values())) - 1
        fractions[on] = self.at(angle_deg[on])
        return fractions

    def force_at_N(self, depth_mm: FloatArray) -> FloatArray:
        """Return the forces (...) on the finger at depths (...): 0 without contact, or for a sensor that is bent."""
        if self.force_N is None:
            return np.zeros(depth_mm.shape)
        return np.asarray(self._force(np.clip(depth_mm, self.angle_deg[0], self.angle_deg[-1])))

    @cached_property
    def _force(self) -> Callable[[FloatArray], FloatArray]:
        return interpolation(self.angle_deg, np.zeros(self.angle_deg.shape) if self.force_N is None else self.force_N)

    @cached_property
    def _curve(self) -> Callable[[FloatArray], FloatArray]:
        return interpolation(self.angle_deg, self.fractions)


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
        Lowest and highest angle of each motion in the protocol, which must be within the range of the motion.

    Raises
    ------
    BenchError, SpecError, DataError, DesignError
        If a design cannot be read or built, or does not allow the variation in the rig file, or the protocol exceeds
        the range of a motion.
    """
    check_names(rig, folder)
    networks = []
    for wiring in rig.sensor:
        if progress is not None:
            progress(f"tracing {wiring.name}")
        design = load(folder / wiring.design)
        for end in (0, 1):
            state_of(design, {motion: limits[end] for motion, limits in visited_deg.items()})
        all_ranges = {motion.name: (motion.from_deg, motion.to_deg) for motion in design.network.motion}
        ranges = {motion: all_ranges[motion] for motion in visited_deg}
        drawn = _drawn(rig, wiring, design, rng)
        cache = folder / f"{wiring.name}.traced.npz"
        network = replace(traced_network(wiring, with_values(design, drawn), ranges, cache), drawn=drawn)
        network = with_parts(network, rng) if rig.spread.parts else network
        light = network.strength[:, None] * network.fractions
        circuit = _adjusted(rig, network.circuit, light.reshape(-1, light.shape[-1]))
        networks.append(replace(network, circuit=circuit))
    return tuple(networks)


def simulated_sensors(
    rig: Rig, folder: Path, largest: float, rng: np.random.Generator, progress: Progress | None = None
) -> tuple[SimulatedSensor, ...]:
    """Return all sensors of a simulated rig, traced up to an angle in deg in both directions, or to a depth in mm.

    Raises
    ------
    BenchError, SpecError, DataError, DesignError
        If a design cannot be read or built, or does not allow the variation in the rig file.
    """
    if rig.stage.drives == "angle" and largest > MAX_DEG:
        limit = f"a simulated sensor is traced up to {MAX_DEG:g} deg"
        raise BenchError("largest angle of the protocol", value=largest, limit=limit, remedy="reduce the angle")
    sensors = []
    for wiring in rig.sensor:
        if progress is not None:
            progress(f"tracing {wiring.name}")
        sensors.append(_traced_print(rig, wiring, load(folder / wiring.design), largest, rng))
    return tuple(sensors)


def _traced_print(
    rig: Rig, wiring: SensorTable, design: Design, largest: float, rng: np.random.Generator
) -> SimulatedSensor:
    drawn = _drawn(rig, wiring, design, rng)
    pressed = rig.stage.drives == "depth"
    values = np.linspace(0.0, RANGE_FACTOR * largest, DEPTHS) if pressed else _angles(largest)
    swept = _swept_depths(design, wiring.design, values) if pressed else with_values(design, _sweep(values))
    sensor = Sensor.of(with_values(swept, drawn))
    sensor = replace(sensor, cut=Sensor.of(design).cut)  # another index, but the lens of the design
    if not wiring.lens:
        sensor = sensor.without_lens
    sensor.check_pair()
    angle_deg, fractions = traced(sensor, values)
    areas = face_areas_mm2(sensor.design, sensor.body())
    circuit = circuit_of(sensor.design, {name: areas[name] for name in ("right", "left")})
    if rig.spread.parts:
        circuit = circuit.drawn(rng)
    circuit = _adjusted(rig, circuit, fractions)
    forces = np.array([force_of(sensor, value) for value in angle_deg.tolist()]) if pressed else None
    simulated_sensor = SimulatedSensor(wiring, drawn | _gains(circuit), angle_deg, fractions, circuit, forces)
    simulated_sensor.at(simulated_sensor.angle_deg[:1])  # lazy imports are done before the run begins
    return simulated_sensor


def _angles(largest_deg: float) -> FloatArray:
    end = max(RANGE_FACTOR * largest_deg, 0.1)
    return np.linspace(-end, end, ANGLES)


def _sweep(angle_deg: FloatArray) -> dict[str, float]:
    low, high = angle_deg[[0, -1]].tolist()
    return {"motion.from_deg": low, "motion.to_deg": high, "motion.step_deg": (high - low) / (ANGLES - 1)}


def _swept_depths(design: Design, file: str, depth_mm: FloatArray) -> Design:
    """Return a design whose finger is pressed to the given depths, even if the design drives the force of the finger.

    Raises `BenchError` if the motion of the design is not a finger that presses.
    """
    motion = design.motion
    if motion.kind != "loaded" or (drives := driven(design))[0] != "press":
        what = f"has motion.kind = {motion.kind}" if motion.kind != "loaded" else f"drives {motion.drives}"
        limit = f"{what}, but the stage of the rig presses a finger into the sensor"
        remedy = 'use a design with motion.kind = "loaded" whose [[press]] is driven, or omit stage.drives'
        raise BenchError(file, limit=limit, remedy=remedy)
    prescribed = {"drives": f"{drives[1]}.depth_mm", "depths_mm": tuple(depth_mm.tolist()), "forces_N": None}
    return design.model_copy(update={"motion": motion.model_copy(update=prescribed)}).in_folder(design.folder)


def traced(sensor: Sensor, angle_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return angles (N,) and the fractions (N, 2) received on the right and the left, dense enough for interpolation.

    Every step is halved, at most `MAX_HALVINGS` times, until the power traced at its middle is within
    `MAX_INTERPOLATION_ERROR` of the interpolation.
    """
    response = sensor.power(angle_deg.tolist(), tolerance=TOLERANCE)
    unchecked = np.ones(len(angle_deg) - 1, dtype=bool)
    for _ in range(MAX_HALVINGS):
        predicted = interpolation(response.angle_deg, _columns(response))
        steps = np.flatnonzero(unchecked)
        middles = 0.5 * (response.angle_deg[steps] + response.angle_deg[steps + 1])
        midway = sensor.power(middles.tolist(), tolerance=TOLERANCE)
        error = np.abs(_columns(midway) - predicted(middles)).max(axis=1)
        coarse = error > MAX_INTERPOLATION_ERROR * _columns(response).max()
        response = response.merged(midway)
        if not coarse.any():
            break
        index = np.searchsorted(response.angle_deg, middles[coarse])
        unchecked = np.zeros(len(response.angle_deg) - 1, dtype=bool)
        unchecked[np.concatenate([index - 1, index])] = True
    return response.angle_deg, received(sensor, response)


def _columns(response: Response) -> FloatArray:
    return np.column_stack([response.right, response.left])


def interpolation(angle_deg: FloatArray, fractions: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the monotone interpolation of fractions (N, ...) at angles (N,)."""
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(angle_deg, fractions)


def _gains(circuit: Circuit) -> dict[str, float]:
    """Return the drop in volts that all of the emitted light would cause at each receiver with an unlimited supply."""
    dark, bright = circuit.current_mA(np.array([[0.0, 0.0], [1.0, 1.0]]))
    gains = 1e-3 * (bright - dark) * np.array(circuit.load_ohm)
    return {f"gain_{name}_V": float(gain) for name, gain in zip(circuit.names, gains, strict=True)}


def adc_of(rig: Rig) -> Adc:
    """Return the ADC of a rig: unipolar on a board, bipolar in a DAQ device."""
    board, daq = rig.board, rig.daq
    if daq is None:
        return Adc("board", board.bits, 0.0, board.range_v, 1e-6 * board.noise_uv)
    part = cast(AdcPart, library_part(daq.kind))  # every model that can be simulated is in the shipped library
    adc = Adc.of(part, daq.range_v, (-daq.range_v, daq.range_v))
    return adc if daq.noise_uv is None else replace(adc, noise_V=1e-6 * daq.noise_uv)


def _adjusted(rig: Rig, circuit: Circuit, fractions: FloatArray) -> Circuit:
    """Return a circuit with the ADC of the rig, and with trimmers adjusted if the rig specifies ``trim_v``."""
    rate_hz = rig.board.rate_hz if rig.daq is None else rig.daq.switch_hz
    circuit, trim_V = replace(circuit, adc=adc_of(rig), rate_hz=rate_hz), (rig.daq or rig.board).trim_v
    return circuit if trim_V is None else _trimmed(circuit, fractions, rig.ambient.mean_mw_cm2, trim_V)


def _trimmed(circuit: Circuit, fractions: FloatArray, mean_ambient_mw_cm2: float, trim_V: float) -> Circuit:
    """Return a circuit with loads that put the brightest reading at a voltage, within the range of the trimmers."""
    if trim_V >= circuit.supply_V:
        raise BenchError("trim_v", value=trim_V, limit=f"must be below the supply, {circuit.supply_V:g} V")
    largest_mA = circuit.current_mA(fractions, mean_ambient_mw_cm2).max(axis=0)
    load_ohm = 1e3 * (circuit.supply_V - trim_V) / largest_mA
    return replace(circuit, load_ohm=tuple(np.minimum(load_ohm, circuit.load_ohm).tolist()))


def _drawn(rig: Rig, wiring: SensorTable, design: Design, rng: np.random.Generator) -> dict[str, float]:
    """Return the values of a design that vary, sampled at random for a print.

    All deviations are sampled, even those that are not used, so that each is independent of which others are used.
    """
    index, offset, chip = rng.standard_normal(3)
    spread, values = rig.spread, {}
    if spread.index > 0.0:
        if design.material.index is None:
            limit = f"requires material.index in {wiring.design}, which has a resin instead"
            raise BenchError("spread.index", value=spread.index, limit=limit, remedy="set material.index there")
        values["material.index"] = design.material.index + spread.index * float(index)
    if spread.emitter_offset_mm > 0.0:
        values["emitter.offset_mm"] = design.emitter.offset_mm + spread.emitter_offset_mm * float(offset)
    if spread.chip_mm > 0.0:
        values["emitter.width_mm"] = max(0.0, design.emitter.width_mm + spread.chip_mm * float(chip))
    return values


def ambient_mw_cm2(ambient: AmbientLight, time_s: FloatArray, phase: float) -> FloatArray:
    """Return the irradiance of ambient light in mW/cm² at times (N,), at least 0; ``phase`` is that of the flicker."""
    drift = 1.0 + 1e-2 * ambient.drift_percent_per_min * time_s / 60.0
    flicker = 1e-2 * ambient.flicker_percent * np.sin(2.0 * math.pi * ambient.flicker_hz * time_s + phase)
    return np.asarray(np.maximum(0.0, ambient.mean_mw_cm2 * drift * (1.0 + flicker)))
