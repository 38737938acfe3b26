"""Stages and sampler of a simulated rig, created together because the sampler needs the positions of the stages."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.bench.clock import Clock
from solen.bench.frames import Layout
from solen.bench.protocol import Protocol
from solen.bench.rig import Rig, driven_values
from solen.bench.roles import Daq, EmitterBoard
from solen.bench.simulated.board import SimulatedBoard
from solen.bench.simulated.cell import SimulatedCell
from solen.bench.simulated.daq import SimulatedDaq
from solen.bench.simulated.networks import SimulatedNetwork
from solen.bench.simulated.sensors import SimulatedSensor, simulated_networks, simulated_sensors
from solen.bench.simulated.stage import SimulatedStage


def simulated_instruments(
    rig: Rig,
    protocol: Protocol,
    folder: Path,
    clock: Clock,
    noise: np.random.Generator,
    report: Callable[[str], None] | None = None,
) -> tuple[dict[str, SimulatedStage], EmitterBoard | Daq, list[dict[str, Any]]]:
    """Return the stages of a simulated rig by motion, its sampler, and its sensors with the drawn values.

    Parameters
    ----------
    rig, protocol
        The sensors are traced over the protocol's range.
    folder
        Base folder of the rig's designs.
    clock, noise
        Clock and noise of the run. Sensors are drawn independently of noise: a resumed run has the same sensors but
        other noise.
    report
        Called with progress messages.

    Raises
    ------
    BenchError, SpecError, DataError, DesignError
        If a design cannot be read, cannot be built, or cannot vary as the rig states.
    """
    rng = np.random.default_rng([rig.seed, 0])
    driven = {name: axis.model_dump(include={"zero", "lever_mm", "drives"}) for name, axis in rig.axes.items()}
    stages = {motion: SimulatedStage(clock, protocol.unit, f"simulated stage {motion}".strip()) for motion in driven}
    for motion, stage in stages.items():
        low, high = protocol.places.get(motion, (0.0, 0.0))
        stage.axis.rest = min(max(0.0, low), high) if motion else 0.0
    sensors: tuple[SimulatedSensor, ...] | tuple[SimulatedNetwork, ...]
    if rig.stages:
        sensors = simulated_networks(rig, folder, _ranges_deg(protocol, driven), rng, report)
    else:
        sensors = simulated_sensors(rig, folder, _reach_deg(rig, protocol, driven[""]), rng, report)

    def angles(time_s: FloatArray) -> FloatArray:
        each = [driven_values(stages[motion].axis.positions(time_s), one) for motion, one in driven.items()]
        return np.stack(each, axis=1) if rig.stages else each[0]

    cell = None
    if rig.load_cell is not None and isinstance(sensors[0], SimulatedSensor):
        cell = SimulatedCell.drawn(rig.load_cell, sensors[0], np.random.default_rng([rig.seed, 2]))

    sampler: EmitterBoard | Daq
    if (setup := rig.setup) is not None:
        sampler = SimulatedDaq(clock, sensors, angles, rig.ambient, noise, setup=setup, cell=cell)
    else:
        sampler = SimulatedBoard(
            clock,
            sensors,
            angles,
            rig.ambient,
            noise,
            layout=Layout(rig.emitters, rig.inputs),
            period_s=1.0 / rig.board.rate_hz,
            per_count=None if rig.unit == "V" else rig.board.step,
            cell=cell,
        )
    drawn = [sensor.wires.model_dump(mode="json") | {"drawn": sensor.drawn} for sensor in sensors]
    return stages, sampler, drawn


def _reach_deg(rig: Rig, protocol: Protocol, driven: Mapping[str, Any]) -> float:
    """Return the largest angle, or depth, of a protocol."""
    targets = np.array([step.targets[""] for step in protocol.steps if step.to_N is None])
    if protocol.forces_N and rig.stage.travel is not None:
        targets = np.append(targets, rig.stage.travel[1])
    if rig.stage.drives == "angle":
        targets = np.array([-protocol.reach, protocol.reach]) + rig.stage.zero
    return float(np.abs(driven_values(targets, driven)).max())


def _ranges_deg(protocol: Protocol, driven: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[float, float]]:
    """Return the lowest and highest angle of each motion."""
    places = {motion: np.array(protocol.places.get(motion, (one["zero"],))) for motion, one in driven.items()}
    ends = {motion: driven_values(places[motion], one) for motion, one in driven.items()}
    return {motion: (float(angles.min()), float(angles.max())) for motion, angles in ends.items()}
