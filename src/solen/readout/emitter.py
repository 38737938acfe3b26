"""Radiant power of an emitter at a current and a temperature.

A datasheet specifies the power at one current. The power follows a power law in the current, with exponent 1 up to
about 100 mA, and falls linearly with temperature. If a datasheet gives no limits of the power, it varies from part to
part in the same ratio as the radiant intensity.

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
        """Return an emitter at a current; raise `DataError` without a power or an intensity at a known current."""
        if part.current_ma is None:
            limit, remedy = "is missing, but the power requires it", "add it to the part file"
            raise DataError(f"{part.name}: current_ma", limit=limit, remedy=remedy)
        typical = _reference_mW(part)
        low, high = _spread(part)
        exponent = part.power_exponent
        ends = (1.0,) if exponent is None else (exponent.nominal, exponent.min or exponent.nominal)
        ratio = current_mA / part.current_ma.nominal
        scales = [ratio**end for end in ends]
        fall = 0.0 if part.fall_percent_per_k is None else 0.01 * part.fall_percent_per_k.nominal
        max_current_mA = math.inf if part.max_current_ma is None else part.max_current_ma.nominal
        return cls(
            name=part.name,
            current_mA=current_mA,
            typical_mW=typical * scales[0],
            min_mW=typical * low * min(scales),
            max_mW=typical * high * max(scales),
            fall_per_K=fall,
            peak_nm=part.peak_nm.nominal,
            max_current_mA=max_current_mA,
        )

    def power_mW(self, temperature_C: float | FloatArray = REFERENCE_C) -> FloatArray:
        """Return the radiant power of a typical part at temperatures of any shape; at least 0."""
        rise_K = np.asarray(temperature_C, dtype=float) - REFERENCE_C
        return np.maximum(self.typical_mW * (1.0 - self.fall_per_K * rise_K), 0.0)


def solid_angle_sr(pattern: PatternPart) -> float:
    """Return 2π ∫ I(θ) sin θ dθ / I(0): the integral of a pattern, relative to its axial value; π for a cosine."""
    angle = np.linspace(0.0, pattern.angle_deg[-1], 20_001)
    relative = np.interp(angle, pattern.angle_deg, pattern.relative) / pattern.relative[0]
    theta = np.radians(angle)
    return float(2.0 * np.pi * np.trapezoid(relative * np.sin(theta), theta))


def _reference_mW(part: EmitterPart) -> float:
    """Return the power at the datasheet's current: as specified, or axial intensity times the pattern's solid angle."""
    if part.power_mw is not None:
        return part.power_mw.nominal
    if part.intensity_mw_per_sr is None or not part.pattern.relative[0] > 0.0:
        limit = "specifies neither power_mw nor intensity_mw_per_sr"
        remedy = "add power_mw or intensity_mw_per_sr, with its current_ma"
        raise DataError(f"part {part.name}", limit=limit, remedy=remedy)
    return part.intensity_mw_per_sr.nominal * solid_angle_sr(part.pattern)


def _spread(part: EmitterPart) -> tuple[float, float]:
    """Return the weakest and strongest part relative to a typical one, from the limits of power or of intensity."""
    for value in (part.power_mw, part.intensity_mw_per_sr):
        if value is not None and (value.min is not None or value.max is not None):
            return (value.min or value.nominal) / value.nominal, (value.max or value.nominal) / value.nominal
    return 1.0, 1.0
