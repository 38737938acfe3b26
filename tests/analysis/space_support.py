"""Chips that an independent tracer traced in space, and recordings of them.

``chips-in-space.csv`` has, for chips of the design `DESIGN`, the shares of the emitted power at both receivers by the
angle: by `tests.analysis.space_tracer_support`, with 2²⁰ rays for each. Their errors are some 4e-5.
"""

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from solen.arrays import FloatArray
from solen.spec import loads
from tests.analysis.made_support import Truth
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
    """Angles (a,), and shares right and left (a, 2)."""
    rows = np.loadtxt(FILE, delimiter=",", skiprows=1)
    own = rows[rows[:, 0] == chip]
    return own[:, 1], own[:, 2:]


def shares(chip: int, angle_deg: FloatArray) -> FloatArray:
    """Shares (n, 2) of a chip, right and left."""
    return np.asarray(CubicSpline(*traced(chip))(angle_deg))


@dataclass(frozen=True)
class LitInSpace(Truth):
    """A made recording of a chip in space."""

    chip: int = 0
    zero_deg: float = 0.0
    gains_V: tuple[float, float] = (8.0, 7.0)
    offsets_V: tuple[float, float] = (5.0, 4.8)
    noise_V: float = field(default=3e-3, kw_only=True)

    def response_V(self, angle_deg: FloatArray) -> FloatArray:
        """Left and right, (n, 2)."""
        light = shares(self.chip, angle_deg + self.zero_deg)
        return np.asarray((np.array(self.offsets_V) - np.array(self.gains_V) * light)[:, ::-1])
