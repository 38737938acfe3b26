"""Simulated networks: each a print of its design, traced over the ranges of its motions.

A print is drawn once, with the rig's seed, like other sensors. Its powers, emitter by emitter, are traced on a grid
over the ranges of its motions. The grid is refined, motion by motion, if a state midway differs from the surface
through the others; between the states of the grid the surface is used. The tracing takes a minute or more; the powers
therefore are stored in a file, and traced again if the design differs.

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
from solen.bench.rig import SensorOf
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
TRACED = 5e-4
"""Uncertainty of a traced power, as a fraction of the emitted power."""
MIN_STEPS, MAX_STEPS = 6, 24
"""Number of steps over the range of a motion, at first and at most."""
NEAR = 4e-3
"""Largest difference between a state midway and the surface, as a fraction of the emitter's brightest power."""


@dataclass(frozen=True, eq=False)
class SimulatedNetwork:
    """One simulated network.

    Attributes
    ----------
    wires
        Its wiring.
    drawn
        Values drawn for it.
    angles_deg
        Angles of each motion at which it was traced, in the order of the rig's stages.
    fractions
        Fractions of the emitted power that receivers convert to current, (n_1, ..., n_M, emitters, receivers), in the
        order of its wiring.
    strength
        Current per fraction of each emitter's power, relative to that of the first, (emitters,).
    circuit
        Its receivers and converter, driven by the first emitter.
    """

    wires: SensorOf
    drawn: dict[str, float]
    angles_deg: tuple[FloatArray, ...]
    fractions: FloatArray
    strength: FloatArray
    circuit: Circuit

    @property
    def places(self) -> list[int]:
        """Inputs of its receivers, from 0."""
        return [number - 1 for number in self.wires.read_on.values()]

    def at(self, angles_deg: FloatArray) -> FloatArray:
        """Return the fractions of the emitted power that receivers convert in states (N, motions).

        The shape is (N, emitters, receivers).
        """
        found = self._surface.at(angles_deg)
        return np.maximum(found, 0.0).reshape(len(angles_deg), *self.fractions.shape[-2:])

    def shares(self, angles_deg: FloatArray, emitter: IntArray) -> FloatArray:
        """Return the light (N, receivers) in states (N, motions), with one emitter of the board on (from 0; -1: none).

        The light is the fraction of the first emitter's power that would give the same photocurrent.
        """
        light = np.zeros((len(angles_deg), len(self.places)))
        for place, number in enumerate(self.wires.lit_by.values()):
            on = emitter == number - 1
            if on.any():
                light[on] = self.strength[place] * self.at(angles_deg[on])[:, place]
        return light

    @cached_property
    def _surface(self) -> Surface:
        grid = self.fractions.shape[:-2]
        return Surface.through(self.angles_deg, self.fractions.reshape(*grid, -1))


def traced_network(
    wires: SensorOf, design: Design, ranges_deg: Mapping[str, Range], kept: Path | None = None
) -> SimulatedNetwork:
    """Return a network with typical parts, traced over ranges of its motions by name.

    Parameters
    ----------
    wires, design
        Its wiring and its design.
    ranges_deg
        Lowest and highest angle of each motion, in the order of the rig's stages.
    kept
        File of the traced powers; read if it belongs to this network, otherwise written.

    Raises
    ------
    SpecError
        If a range is not within that of the motion.
    DesignError
        If the body cannot be built in a state.
    """
    named = list(wires.lit_by), list(wires.read_on)
    sensor = Sensor.of(design)
    made_of = __version__, dumps(design), sensor.material, Acceptance.of(sensor), named, dict(ranges_deg)
    key = hashlib.sha256(repr(made_of).encode()).hexdigest()
    found = None if kept is None else _read(kept, key)
    if found is None:
        found = _traced(wires, design, ranges_deg)
        if kept is not None:
            _keep(kept, key, *found)
    each = [_circuit(wires, lit(design, name)) for name in wires.lit_by]
    strength = np.array([_strength(one) for one in each])
    return SimulatedNetwork(wires, {}, *found, strength / strength[0], each[0])


def _traced(
    wires: SensorOf, design: Design, ranges_deg: Mapping[str, Range]
) -> tuple[tuple[FloatArray, ...], FloatArray]:
    """Return the angles of each motion, and the powers over their grid."""
    middle = {name: 0.5 * (low + high) for name, (low, high) in ranges_deg.items()}
    angles = {name: _nodes(wires, design, name, ends, middle) for name, ends in ranges_deg.items()}
    mesh = np.stack(np.meshgrid(*angles.values(), indexing="ij"), axis=-1)
    shares = _powers(wires, design, list(angles), mesh.reshape(-1, len(angles)))
    return tuple(angles.values()), shares.reshape(*mesh.shape[:-1], *shares.shape[1:])


def _read(kept: Path, key: str) -> tuple[tuple[FloatArray, ...], FloatArray] | None:
    """Read the powers from a file; None if the file belongs to another network or does not exist."""
    try:
        with np.load(kept, allow_pickle=False) as file:
            if str(file["key"]) != key:
                return None
            angles = tuple(file[f"angles_{number}"] for number in range(file["fractions"].ndim - 2))
            return angles, file["fractions"]
    except (OSError, ValueError, KeyError, BadZipFile):
        return None


def _keep(kept: Path, key: str, angles: tuple[FloatArray, ...], fractions: FloatArray) -> None:
    content = BytesIO()
    arrays: dict[str, Any] = {f"angles_{number}": angle for number, angle in enumerate(angles)}
    np.savez(content, key=np.array(key), fractions=fractions, **arrays)
    with suppress(OutputError):  # in a read-only folder the network is traced again next time
        write_bytes(kept, content.getvalue())


def with_parts(network: SimulatedNetwork, rng: np.random.Generator) -> SimulatedNetwork:
    """Return a network with random parts: receivers, and each emitter's power, within the limits of the datasheets."""
    first, *others = (network.circuit.drawn(rng) for _ in network.wires.lit_by)
    power = np.array([one.drive.typical_mW for one in (first, *others)])
    return replace(network, circuit=first, strength=network.strength * power / power[0])


def _strength(circuit: Circuit) -> float:
    """Return the current of a receiver for the total power of an emitter, up to a factor common to all emitters."""
    return circuit.transistor.response * float(circuit.drive.power_mW())


def _circuit(wires: SensorOf, design: Design) -> Circuit:
    areas = face_areas_mm2(design, Sensor.of(design).body())
    return circuit_of(design, {name: areas[name] for name in wires.read_on})


def _nodes(wires: SensorOf, design: Design, name: str, ends: Range, middle: Mapping[str, float]) -> FloatArray:
    """Return as many angles of one motion as its response needs, with the others at the middle of their ranges."""
    low, high = ends
    if low == high:
        return np.array([low])
    motions, steps = list(middle), MIN_STEPS
    column = motions.index(name)

    def along(angles: FloatArray) -> FloatArray:
        rows = np.tile([middle[motion] for motion in motions], (len(angles), 1))
        rows[:, column] = angles
        return _powers(wires, design, motions, rows).reshape(len(angles), -1)

    angles = np.linspace(low, high, steps + 1)
    found = along(angles)
    while True:
        between = 0.5 * (angles[1:] + angles[:-1])
        more = along(between)
        surface = Surface.through([angles], found)
        off = np.abs(surface.at(between[:, None]) - more).max() / found.max()
        order = np.argsort(np.concatenate([angles, between]))
        if off <= NEAR:
            return angles
        angles, found = np.concatenate([angles, between])[order], np.concatenate([found, more])[order]
        if len(angles) > MAX_STEPS:
            return angles


def _powers(wires: SensorOf, design: Design, motions: list[str], states: FloatArray) -> FloatArray:
    """Return the fractions (states, emitters, receivers) that receivers convert, in the order of the wiring."""
    moved = [state_of(design, dict(zip(motions, row, strict=True))) for row in states.tolist()]
    response = response_of(moved, TRACED)
    lights = [response.emitters.index(name) for name in wires.lit_by]
    places = [response.receivers.index(name) for name in wires.read_on]
    return received_by(moved, response.power)[:, lights][:, :, places]
