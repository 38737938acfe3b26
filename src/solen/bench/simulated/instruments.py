"""Stage and sampler of a simulated rig, made as a whole: the sampler needs to know where the stage is."""

from collections.abc import Callable
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
from solen.bench.simulated.sensors import simulated_sensors
from solen.bench.simulated.stage import SimulatedStage


def simulated_instruments(
    rig: Rig,
    protocol: Protocol,
    folder: Path,
    clock: Clock,
    noise: np.random.Generator,
    report: Callable[[str], None] | None = None,
) -> tuple[SimulatedStage, EmitterBoard | Daq, list[dict[str, Any]]]:
    """Stage and sampler of a simulated rig, and its sensors with their drawn parameters, for a journal's header.

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
        If a design cannot be read, built, or vary as the rig states.
    """
    of_run = {"zero": rig.stage.zero, "lever_mm": rig.stage.lever_mm, "drives": rig.stage.drives}
    targets = np.array([step.target for step in protocol.step if step.to_N is None])
    if protocol.forces_N and rig.stage.travel is not None:
        targets = np.append(targets, rig.stage.travel[1])
    if rig.stage.drives == "angle":
        targets = np.array([-protocol.reach, protocol.reach]) + rig.stage.zero
    reach_deg = float(np.abs(driven_values(targets, of_run)).max())
    sensors = simulated_sensors(rig, folder, reach_deg, np.random.default_rng([rig.seed, 0]), report)
    stage = SimulatedStage(clock, protocol.unit)

    def angles(time_s: FloatArray) -> FloatArray:
        return driven_values(stage.axis.positions(time_s), of_run)

    cell = None
    if rig.load_cell is not None:
        cell = SimulatedCell.drawn(rig.load_cell, sensors[0], np.random.default_rng([rig.seed, 2]))

    sampler: EmitterBoard | Daq
    if (setup := rig.setup) is not None:
        sampler = SimulatedDaq(clock, sensors, angles, rig.ambient, setup, noise, cell=cell)
    else:
        layout, period_s = Layout(rig.emitters, rig.inputs), 1.0 / rig.board.rate_hz
        per_count = None if rig.unit == "V" else rig.board.step
        sampler = SimulatedBoard(
            clock, sensors, angles, rig.ambient, layout, period_s, noise, per_count=per_count, cell=cell
        )
    drawn = [sensor.wires.model_dump(mode="json") | {"drawn": sensor.drawn} for sensor in sensors]
    return stage, sampler, drawn
