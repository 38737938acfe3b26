"""An analogue-to-digital converter: range, steps and intrinsic noise.

Public name: `Adc`.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.parts import AdcPart, AdcRange
from solen.results import reported


@dataclass(frozen=True)
class Adc:
    """A converter in one range.

    Attributes
    ----------
    name
        Part name.
    bits
        Resolution; 2^bits codes.
    low_V, high_V
        Limits of the range; the largest reading is ``high_V`` minus one step.
    noise_V
        Standard deviation of the converter's intrinsic noise.
    bandwidth_kHz
        Input bandwidth; inf if unknown.
    """

    name: str
    bits: int
    low_V: float
    high_V: float
    noise_V: float = 0.0
    bandwidth_kHz: float = math.inf

    @classmethod
    def of(cls, part: AdcPart, supply_V: float, range_V: tuple[float, float] | None = None) -> "Adc":
        """Converter in a requested range, or in its smallest range from 0 that includes the supply voltage."""
        chosen = _stated(part, range_V) if range_V is not None else _smallest(part, supply_V)
        bandwidth = math.inf if part.bandwidth_khz is None else part.bandwidth_khz.nominal
        return cls(part.name, part.bits, chosen.low_v, chosen.high_v, 1e-6 * chosen.noise_uv, bandwidth)

    @reported
    def step_V(self) -> float:
        """Voltage of one step."""
        return (self.high_V - self.low_V) / (1 << self.bits)

    @property
    def quantisation_V(self) -> float:
        """Standard deviation of the quantisation error, step/√12, which is uniform over a step."""
        return self.step_V / math.sqrt(12.0)

    @property
    def top_V(self) -> float:
        """Largest voltage that the converter can read."""
        return self.high_V - self.step_V

    def read(self, volts: FloatArray) -> FloatArray:
        """Voltages (...) as read by the converter: rounded to steps and clipped to the range."""
        numbers = np.clip(np.rint((volts - self.low_V) / self.step_V), 0, 2**self.bits - 1)
        return np.asarray(self.low_V + self.step_V * numbers)


def _smallest(part: AdcPart, supply_V: float) -> AdcRange:
    by_width = sorted(part.range, key=lambda one: one.high_v - one.low_v)
    holds = (one for one in by_width if one.low_v <= 0.0 and one.high_v > supply_V)
    return next(holds, by_width[-1])


def _stated(part: AdcPart, range_V: tuple[float, float]) -> AdcRange:
    for one in part.range:
        if (one.low_v, one.high_v) == range_V:
            return one
    ranges = ", ".join(f"[{one.low_v:g}, {one.high_v:g}]" for one in part.range)
    raise SpecError("readout.adc_range_v", value=list(range_V), limit=f"is not a range of {part.name}", remedy=ranges)
