"""Common base of simulated samplers, which sample simulated sensors by the clock of a run.

Public name: `SimulatedSampler`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from solen.arrays import FloatArray
from solen.bench.clock import Clock
from solen.bench.rig import AmbientLight
from solen.bench.simulated.cell import SimulatedCell
from solen.bench.simulated.networks import SimulatedNetwork
from solen.bench.simulated.sensors import SimulatedSensor


@dataclass
class SimulatedSampler:
    """Base of a sampler of simulated sensors.

    Attributes
    ----------
    clock
        Clock of the run.
    sensors
        Sensors connected to its inputs.
    angle_deg
        Function that returns, at ascending times (N,), the angles of the sensors (N,), or of their motions (N, M).
    room
        Ambient light.
    rng
        Generator of noise and phases.
    ppm
        Excess rate of its clock, relative to the run's clock, in ppm.
    cell
        Load cell on one of its inputs.
    """

    clock: Clock
    sensors: tuple[SimulatedSensor, ...] | tuple[SimulatedNetwork, ...]
    angle_deg: Callable[[FloatArray], FloatArray]
    room: AmbientLight
    rng: np.random.Generator
    ppm: float = field(default=20.0, kw_only=True)
    cell: SimulatedCell | None = field(default=None, kw_only=True)
    _begun_s: float | None = field(default=None, init=False)
    _next: int = field(default=0, init=False)
    _flicker: float = field(default=0.0, init=False)

    def start(self) -> None:
        """Start switching the emitters and sampling."""
        self._begun_s, self._next = self.clock.now_s(), 0
        self._flicker = float(self.rng.uniform(0.0, 2.0 * math.pi))

    def stop(self) -> None:
        """Switch the emitters off and stop sampling."""
        self._begun_s = None

    def close(self) -> None:
        """Switch the emitters off and stop sampling."""
        self.stop()

    @property
    def _step_V(self) -> float:
        return self.sensors[0].circuit.adc.step_V
