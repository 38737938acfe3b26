"""Responses of chips in space, traced by an independent tracer, and recordings of them.

For several chips in `DESIGN`, ``chips-in-space.csv`` contains the fractions of the emitted power at both receivers
against the angle, from `tests.analysis.space_tracer_support` with 2²⁰ rays at each angle. Their errors are about 4e-5.
"""

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from solen.arrays import FloatArray
from solen.spec import loads
from tests.analysis.simulated_support import Truth
from tests.analysis.space_tracer_support import LitChip

DESIGN = loads("""
schema = 1
name = "in space"
[material]
index = 1.44
[emitter]
pattern = "lambertian"
width_mm = 0.2
height_mm = 0.2
[trace]
dimension = "extruded"
""")
CHIPS = (LitChip(0.02, 0.2, 0.2), LitChip(-0.05, 0.15, 0.2), LitChip(0.0, 0.27, 0.2))
FILE = Path(__file__).parent / "chips-in-space.csv"


@cache
def traced(chip: int) -> tuple[FloatArray, FloatArray]:
    """Return the angles (a,) and the fractions right and left (a, 2) of a chip."""
    rows = np.loadtxt(FILE, delimiter=",", skiprows=1)
    rows = rows[rows[:, 0] == chip]
    return rows[:, 1], rows[:, 2:]


def fractions(chip: int, angle_deg: FloatArray) -> FloatArray:
    """Return the interpolated fractions (n, 2) of a chip, right and left."""
    return np.asarray(CubicSpline(*traced(chip))(angle_deg))


@dataclass(frozen=True)
class LitInSpace(Truth):
    """True values of a recording of a chip in space."""

    chip: int = 0
    zero_deg: float = 0.0
    gains_V: tuple[float, float] = (8.0, 7.0)
    offsets_V: tuple[float, float] = (5.0, 4.8)
    noise_V: float = field(default=3e-3, kw_only=True)

    def response_V(self, angle_deg: FloatArray) -> FloatArray:
        """Return the left and right voltages, (n, 2)."""
        light = fractions(self.chip, angle_deg + self.zero_deg)
        return np.asarray((np.array(self.offsets_V) - np.array(self.gains_V) * light)[:, ::-1])
