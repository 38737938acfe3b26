"""Radiant power of an emitter at a current and a temperature.

A datasheet specifies the power at one current. The power follows a power law in the current, with exponent 1 up to
about 100 mA, and falls linearly with temperature. It varies from part to part in the same ratio as the radiant
intensity.

Public name: `Drive`.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.parts import EmitterPart, PatternPart

REFERENCE_C = 25.0
"""Temperature to which datasheet values refer."""


@dataclass(frozen=True)
class Drive:
    """An emitter at a current.

    Attributes
    ----------
    name
        Part name.
    current_mA
        Current while the emitter is on.
    typical_mW, min_mW, max_mW
        Radiant power of a typical, the weakest and the strongest part at that current and 25 °C.
    fall_per_K
        Relative decrease in power per K.
    peak_nm
        Peak wavelength.
    max_current_mA
        Maximum continuous current; inf if unknown.
    """

    name: str
    current_mA: float
    typical_mW: float
    min_mW: float
    max_mW: float
    fall_per_K: float
    peak_nm: float
    max_current_mA: float = math.inf

    @classmethod
    def of(cls, part: EmitterPart, current_mA: float) -> "Drive":
        """Emitter at a current; `DataError` if its part specifies no power or intensity with a current."""
        if part.current_ma is None:
            raise DataError(
                f"{part.name}: current_ma", limit="is missing, but the power requires it", remedy="add it to the part"
            )
        typical = _reference_mW(part)
        low, high = _spread(part)
        exponent = part.power_exponent
        ends = (1.0,) if exponent is None else (exponent.nominal, exponent.min or exponent.nominal)
        ratio = current_mA / part.current_ma.nominal
        scales = [ratio**end for end in ends]
        fall = 0.0 if part.fall_percent_per_k is None else 0.01 * part.fall_percent_per_k.nominal
        most = math.inf if part.max_current_ma is None else part.max_current_ma.nominal
        return cls(
            name=part.name,
            current_mA=current_mA,
            typical_mW=typical * scales[0],
            min_mW=typical * low * min(scales),
            max_mW=typical * high * max(scales),
            fall_per_K=fall,
            peak_nm=part.peak_nm.nominal,
            max_current_mA=most,
        )

    def power_mW(self, temperature_C: float | FloatArray = REFERENCE_C) -> FloatArray:
        """Radiant power of a typical part at temperatures of any shape; at least 0."""
        warmer_K = np.asarray(temperature_C, dtype=float) - REFERENCE_C
        return np.maximum(self.typical_mW * (1.0 - self.fall_per_K * warmer_K), 0.0)


def solid_angle_sr(pattern: PatternPart) -> float:
    """Integral of a pattern over the sphere, relative to its axial value: 2π ∫ I(θ) sin θ dθ / I(0); π for a cosine."""
    angle = np.linspace(0.0, pattern.angle_deg[-1], 20_001)
    relative = np.interp(angle, pattern.angle_deg, pattern.relative) / pattern.relative[0]
    theta = np.radians(angle)
    return float(2.0 * np.pi * np.trapezoid(relative * np.sin(theta), theta))


def _reference_mW(part: EmitterPart) -> float:
    """Power at the datasheet's current: as specified, or axial intensity times the pattern's solid angle."""
    if part.power_mw is not None:
        return part.power_mw.nominal
    if part.intensity_mw_per_sr is None or not part.pattern.relative[0] > 0.0:
        limit = "specifies neither power_mw nor intensity_mw_per_sr"
        raise DataError(
            f"part {part.name}", limit=limit, remedy="add power_mw or intensity_mw_per_sr, with its current_ma"
        )
    return part.intensity_mw_per_sr.nominal * solid_angle_sr(part.pattern)


def _spread(part: EmitterPart) -> tuple[float, float]:
    """Weakest and strongest part relative to a typical part, from the limits of the power, or else of the intensity."""
    for one in (part.power_mw, part.intensity_mw_per_sr):
        if one is not None and (one.min is not None or one.max is not None):
            return (one.min or one.nominal) / one.nominal, (one.max or one.nominal) / one.nominal
    return 1.0, 1.0
