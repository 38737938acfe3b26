"""Stages and sampler of a simulated rig, created together because the sampler needs the positions of the stages.

Public name: `simulated_instruments`.
"""

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
    """Return the stages of a simulated rig, keyed by motion, its sampler, and the header entries of its sensors.

    Parameters
    ----------
    rig, protocol
        The rig, and the protocol, over whose range the sensors are traced.
    folder
        Base folder of the rig's designs.
    clock, noise
        Clock and noise of the run. The variation of the sensors is independent of the noise: a resumed run has
        the same sensors but other noise.
    report
        Called with progress messages.

    Raises
    ------
    BenchError, SpecError, DataError, DesignError
        If a design cannot be read or built, or does not allow the variation in the rig file.
    """
    rng = np.random.default_rng([rig.seed, 0])
    settings = {motion: axis.model_dump(include={"zero", "lever_mm", "drives"}) for motion, axis in rig.axes.items()}
    stages = {motion: SimulatedStage(clock, protocol.unit, f"simulated stage {motion}".strip()) for motion in settings}
    for motion, stage in stages.items():
        low, high = protocol.ranges.get(motion, (0.0, 0.0))
        stage.axis.initial = min(max(0.0, low), high) if motion else 0.0
    sensors: tuple[SimulatedSensor, ...] | tuple[SimulatedNetwork, ...]
    if rig.stages:
        sensors = simulated_networks(rig, folder, _ranges_deg(protocol, settings), rng, report)
    else:
        sensors = simulated_sensors(rig, folder, _largest_drive(rig, protocol, settings[""]), rng, report)

    def angles(time_s: FloatArray) -> FloatArray:
        columns = [driven_values(stages[motion].axis.positions(time_s), settings[motion]) for motion in settings]
        return np.stack(columns, axis=1) if rig.stages else columns[0]

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
    entries = [sensor.wiring.model_dump(mode="json") | {"drawn": sensor.drawn} for sensor in sensors]
    return stages, sampler, entries


def _largest_drive(rig: Rig, protocol: Protocol, settings: Mapping[str, Any]) -> float:
    """Return the largest angle in degrees, or depth in mm, of a protocol."""
    targets = np.array([step.targets[""] for step in protocol.steps if step.to_N is None])
    if protocol.forces_N and rig.stage.travel is not None:
        targets = np.append(targets, rig.stage.travel[1])
    if rig.stage.drives == "angle":
        targets = np.array([-protocol.farthest, protocol.farthest]) + rig.stage.zero
    return float(np.abs(driven_values(targets, settings)).max())


def _ranges_deg(protocol: Protocol, settings: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[float, float]]:
    """Return the lowest and highest angle of each motion."""
    ranges = {}
    for motion, of_motion in settings.items():
        ends = np.array(protocol.ranges.get(motion, (of_motion["zero"],)))
        angles = driven_values(ends, of_motion)
        ranges[motion] = float(angles.min()), float(angles.max())
    return ranges
