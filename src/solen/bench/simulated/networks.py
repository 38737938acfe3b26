"""Simulated networks: prints of a design, traced over the ranges of their motions.

The receivers and emitters of a network are sampled at random once, with the rig's seed. The received powers are traced
for each emitter on a grid over the ranges of the motions, and interpolated by a surface. The grid is refined, motion by
motion, until the powers traced midway between its angles agree with those of the surface. Because the tracing takes a
minute or more, the powers are stored in a file, and traced again only if the design differs.

Public names: `traced_network` and `SimulatedNetwork`.
"""

import hashlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from solen import __version__
from solen.analysis.surface import Surface
from solen.arrays import FloatArray, IntArray
from solen.bench.rig import SensorTable
from solen.errors import OutputError
from solen.files import write_bytes
from solen.readout import Circuit, circuit_of, face_areas_mm2
from solen.sensor import Sensor
from solen.sensor.acceptance import Acceptance
from solen.sensor.network.response import response_of
from solen.sensor.network.signals import received_by
from solen.spec import Design
from solen.spec.placed import lit, state_of
from solen.spec.toml import dumps

Range = tuple[float, float]
TOLERANCE = 5e-4
"""Uncertainty of a traced power, as a fraction of the emitted power."""
MIN_STEPS, MAX_STEPS = 6, 24
"""Initial number of steps over the range of a motion, and the number above which it is not refined further."""
MAX_INTERPOLATION_ERROR = 4e-3
"""Largest difference between a power traced midway between two angles and that of the surface, as a fraction of the
largest power.
"""


@dataclass(frozen=True, eq=False)
class SimulatedNetwork:
    """One simulated network.

    Attributes
    ----------
    wiring
        Its wiring.
    drawn
        Values sampled at random for this network.
    angles_deg
        Angles of each motion at which it was traced, in the order of the rig's stages.
    fractions
        Fractions of the emitted power that the receivers convert to current, (n_1, ..., n_M, emitters, receivers), in
        the order of its wiring.
    strength
        Photocurrent for the same fraction of the power of each emitter, relative to that of the first, (emitters,).
    circuit
        Its receivers and ADC, with the drive of the first emitter.
    """

    wiring: SensorTable
    drawn: dict[str, float]
    angles_deg: tuple[FloatArray, ...]
    fractions: FloatArray
    strength: FloatArray
    circuit: Circuit

    @property
    def input_indices(self) -> list[int]:
        """Indices of the inputs of its receivers, from 0."""
        return [number - 1 for number in self.wiring.input_numbers.values()]

    def at(self, angles_deg: FloatArray) -> FloatArray:
        """Return the fractions of the emitted power (N, emitters, receivers) in states (N, motions)."""
        fractions = np.maximum(self._surface.at(angles_deg), 0.0)
        return fractions.reshape(len(angles_deg), *self.fractions.shape[-2:])

    def received(self, angles_deg: FloatArray, emitter: IntArray) -> FloatArray:
        """Return the light (N, receivers) in states (N, motions), with an emitter of the board on (from 0; -1: none).

        The light is the fraction of the first emitter's power that would give the same photocurrent.
        """
        light = np.zeros((len(angles_deg), len(self.input_indices)))
        for index, number in enumerate(self.wiring.emitter_numbers.values()):
            on = emitter == number - 1
            if on.any():
                light[on] = self.strength[index] * self.at(angles_deg[on])[:, index]
        return light

    @cached_property
    def _surface(self) -> Surface:
        grid = self.fractions.shape[:-2]
        return Surface.through(self.angles_deg, self.fractions.reshape(*grid, -1))


def traced_network(
    wiring: SensorTable, design: Design, ranges_deg: Mapping[str, Range], cache: Path | None = None
) -> SimulatedNetwork:
    """Return a network with typical parts, traced over ranges of its motions.

    Parameters
    ----------
    wiring, design
        Its wiring and its design.
    ranges_deg
        Lowest and highest angle of each motion, keyed by motion, in the order of the rig's stages.
    cache
        File of the traced powers; read if it belongs to this network, otherwise written.

    Raises
    ------
    SpecError
        If a range is not within that of the motion.
    DesignError
        If the body cannot be built in a state.
    """
    names = list(wiring.emitter_numbers), list(wiring.input_numbers)
    sensor = Sensor.of(design)
    inputs = __version__, dumps(design), sensor.material, Acceptance.of(sensor), names, dict(ranges_deg)
    key = hashlib.sha256(repr(inputs).encode()).hexdigest()
    powers = None if cache is None else _read_cache(cache, key)
    if powers is None:
        powers = _traced(wiring, design, ranges_deg)
        if cache is not None:
            _write_cache(cache, key, *powers)
    circuits = [_circuit(wiring, lit(design, name)) for name in wiring.emitter_numbers]
    strength = np.array([_strength(circuit) for circuit in circuits])
    return SimulatedNetwork(wiring, {}, *powers, strength / strength[0], circuits[0])


def _traced(
    wiring: SensorTable, design: Design, ranges_deg: Mapping[str, Range]
) -> tuple[tuple[FloatArray, ...], FloatArray]:
    """Return the angles of each motion, and the powers over their grid."""
    middle = {motion: 0.5 * (low + high) for motion, (low, high) in ranges_deg.items()}
    angles = {motion: _grid_angles(wiring, design, motion, ends, middle) for motion, ends in ranges_deg.items()}
    mesh = np.stack(np.meshgrid(*angles.values(), indexing="ij"), axis=-1)
    powers = _powers(wiring, design, list(angles), mesh.reshape(-1, len(angles)))
    return tuple(angles.values()), powers.reshape(*mesh.shape[:-1], *powers.shape[1:])


def _read_cache(cache: Path, key: str) -> tuple[tuple[FloatArray, ...], FloatArray] | None:
    """Read the powers from a file; None if it does not exist or belongs to another network."""
    try:
        with np.load(cache, allow_pickle=False) as file:
            if str(file["key"]) != key:
                return None
            angles = tuple(file[f"angles_{number}"] for number in range(file["fractions"].ndim - 2))
            return angles, file["fractions"]
    except (OSError, ValueError, KeyError, BadZipFile):
        return None


def _write_cache(cache: Path, key: str, angles: tuple[FloatArray, ...], fractions: FloatArray) -> None:
    content = BytesIO()
    arrays: dict[str, Any] = {f"angles_{number}": angle for number, angle in enumerate(angles)}
    np.savez(content, key=np.array(key), fractions=fractions, **arrays)
    with suppress(OutputError):  # in a read-only folder the network is traced again the next time
        write_bytes(cache, content.getvalue())


def with_parts(network: SimulatedNetwork, rng: np.random.Generator) -> SimulatedNetwork:
    """Return a network whose receivers and emitter powers are random samples within the limits of the datasheets."""
    circuits = [network.circuit.drawn(rng) for _ in network.wiring.emitter_numbers]
    power = np.array([circuit.drive.typical_mW for circuit in circuits])
    return replace(network, circuit=circuits[0], strength=network.strength * power / power[0])


def _strength(circuit: Circuit) -> float:
    """Return the current of a receiver for the total power of an emitter, up to a factor common to all emitters."""
    return circuit.transistor.response * float(circuit.drive.power_mW())


def _circuit(wiring: SensorTable, design: Design) -> Circuit:
    areas = face_areas_mm2(design, Sensor.of(design).body())
    return circuit_of(design, {name: areas[name] for name in wiring.input_numbers})


def _grid_angles(
    wiring: SensorTable, design: Design, motion: str, ends: Range, middle: Mapping[str, float]
) -> FloatArray:
    """Return the angles of one motion at which to trace; the other motions are in the middle of their ranges."""
    low, high = ends
    if low == high:
        return np.array([low])
    motions = list(middle)
    column = motions.index(motion)

    def powers_at(angles: FloatArray) -> FloatArray:
        states = np.tile([middle[name] for name in motions], (len(angles), 1))
        states[:, column] = angles
        return _powers(wiring, design, motions, states).reshape(len(angles), -1)

    angles = np.linspace(low, high, MIN_STEPS + 1)
    powers = powers_at(angles)
    while len(angles) <= MAX_STEPS:
        middles = 0.5 * (angles[1:] + angles[:-1])
        midway = powers_at(middles)
        predicted = Surface.through([angles], powers).at(middles[:, None])
        if np.abs(predicted - midway).max() <= MAX_INTERPOLATION_ERROR * powers.max():
            break
        angles, powers = np.concatenate([angles, middles]), np.concatenate([powers, midway])
        order = np.argsort(angles)
        angles, powers = angles[order], powers[order]
    return angles


def _powers(wiring: SensorTable, design: Design, motions: list[str], states: FloatArray) -> FloatArray:
    """Return the fractions (states, emitters, receivers) that the receivers convert, in the order of the wiring."""
    placed = [state_of(design, dict(zip(motions, row, strict=True))) for row in states.tolist()]
    response = response_of(placed, TOLERANCE)
    emitters = [response.emitters.index(name) for name in wiring.emitter_numbers]
    receivers = [response.receivers.index(name) for name in wiring.input_numbers]
    return received_by(placed, response.power)[:, emitters][:, :, receivers]
