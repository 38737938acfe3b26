"""Simulated presses of a fingertip: true force, load cell, depth and both receivers."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from solen.arrays import FloatArray

CELL = """[load_cell]
N_per_V = 0.5
capacity_N = 0.5
u_sensitivity_percent = 1.0
nonlinearity_percent = 0.5
"""
ZERO_V = 0.8


@dataclass(frozen=True)
class Presses:
    """A recording of presses to 0.3 N.

    ``scale`` is the relative error of the load cell's sensitivity, and ``bow`` its non-linearity, as a fraction of the
    capacity.
    """

    seed: int = 1
    cycles: int = 6
    scale: float = 0.0
    bow: float = 0.0
    noise_V: float = 1e-3
    cell_noise_V: float = 2e-4
    late_s: float = 0.0
    newton_per_s: float = 0.4

    @property
    def time_s(self) -> FloatArray:
        period_s = 2.0 * 0.3 / self.newton_per_s + 0.4
        return np.arange(0.0, 1.0 + period_s * self.cycles + 0.5, 0.005)

    def force_at(self, time_s: FloatArray) -> FloatArray:
        """Return the true force in N at given times."""
        ramp = 0.3 / self.newton_per_s
        corners = np.array([0.0, ramp, ramp + 0.2, 2.0 * ramp + 0.2, 2.0 * ramp + 0.4])
        force = np.interp((time_s - 1.0) % corners[-1], corners, [0.0, 0.3, 0.3, 0.0, 0.0])
        return np.where((time_s < 1.0) | (time_s > 1.0 + corners[-1] * self.cycles), 0.0, force)

    @property
    def force_N(self) -> FloatArray:
        return self.force_at(self.time_s)

    @property
    def volts(self) -> FloatArray:
        """Left and right voltages, delayed by `late_s` relative to the force."""
        force = self.force_at(self.time_s - self.late_s)
        clean = np.column_stack([3.0 + 2.9 * force - 0.6 * force**2, 3.0 - 2.7 * force + 1.2 * force**2])
        return clean + self.noise_V * np.random.default_rng(self.seed).standard_normal(clean.shape)

    @property
    def cell_V(self) -> FloatArray:
        """Voltage of the load cell, whose nominal sensitivity is 2 V/N."""
        force, rng = self.force_N, np.random.default_rng([self.seed, 1])
        indicated = force * (1.0 + self.scale) + self.bow * 0.5 * 4.0 * force / 0.5 * (1.0 - force / 0.5)
        return ZERO_V + 2.0 * indicated + self.cell_noise_V * rng.standard_normal(force.size)

    def write(self, path: Path, force: str = "load_cell_V", factor: float | None = None, depth: bool = False) -> Path:
        """Write a table with the force in a unit of which ``factor`` make a newton, or with the voltage of the cell."""
        column = self.cell_V if factor is None else factor * (self.cell_V - ZERO_V) / 2.0
        depths = [1.5 * (self.force_N / 0.3) ** 0.7] if depth else []
        names = ["time_s", force, *(["depth_mm"] if depth else []), "left_V", "right_V"]
        rows = np.column_stack([self.time_s, column, *depths, self.volts])
        np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.7g")
        return path
