"""An analogue-to-digital converter (ADC): range, steps and intrinsic noise.

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
    """An ADC in one of its ranges.

    Attributes
    ----------
    name
        Part name.
    bits
        Resolution; 2^bits codes.
    low_V, high_V
        Limits of the range; the largest reading is ``high_V`` minus one step.
    noise_V
        Standard deviation of the ADC's intrinsic noise.
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
        """Return the ADC in a requested range, by default in the smallest range that includes 0 and the supply."""
        selected = _requested_range(part, range_V) if range_V is not None else _smallest_range(part, supply_V)
        bandwidth = math.inf if part.bandwidth_khz is None else part.bandwidth_khz.nominal
        return cls(part.name, part.bits, selected.low_v, selected.high_v, 1e-6 * selected.noise_uv, bandwidth)

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
        """Largest voltage that the ADC can read."""
        return self.high_V - self.step_V

    def read(self, volts: FloatArray) -> FloatArray:
        """Return voltages (...) as read by the ADC: rounded to steps and clipped to the range."""
        codes = np.clip(np.rint((volts - self.low_V) / self.step_V), 0, 2**self.bits - 1)
        return np.asarray(self.low_V + self.step_V * codes)


def _smallest_range(part: AdcPart, supply_V: float) -> AdcRange:
    """Return the smallest range that includes 0 and the supply, or the widest range if there is none."""
    ranges = sorted(part.range, key=lambda adc_range: adc_range.high_v - adc_range.low_v)
    sufficient = (adc_range for adc_range in ranges if adc_range.low_v <= 0.0 and adc_range.high_v > supply_V)
    return next(sufficient, ranges[-1])


def _requested_range(part: AdcPart, range_V: tuple[float, float]) -> AdcRange:
    for adc_range in part.range:
        if (adc_range.low_v, adc_range.high_v) == range_V:
            return adc_range
    ranges = ", ".join(f"[{adc_range.low_v:g}, {adc_range.high_v:g}]" for adc_range in part.range)
    limit, remedy = f"is not a range of {part.name}", f"set one of {ranges}"
    raise SpecError("readout.adc_range_v", value=list(range_V), limit=limit, remedy=remedy)
