"""Cure law from a working-curve file or a print process: cure depth, and the doses in a part.

Of a dose E at the surface, E Σ w e^(-d r/Dp) reaches the depth d, where w and r are the power fraction and the relative
absorption of each of the lamp's lines (with a single line, this is Jacobs' law). Resin cures down to the depth at which
this dose equals Ec. A layer of a part receives its own dose and the light that all later layers transmit.

`CureLaw` computes depths and doses; `read_law` reads a file written by `solen resin cure --out`.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ConfigDict

from solen.arrays import FloatArray
from solen.errors import DataError, SolenError
from solen.files import read_text
from solen.material.cure.spectral import ONE_LINE, Lines, depth, transmitted
from solen.spec.objects import parse_json
from solen.spec.strict import NotNegative, Positive, Strict, error_context


@dataclass(frozen=True)
class CureLaw:
    """Penetration depth (at the surface if the lamp has several lines), critical dose, and the lamp's lines."""

    Dp_um: float
    Ec_mJ_per_cm2: float
    lines: Lines = ONE_LINE

    def depth_um(self, dose: float) -> float:
        """Return the depth to which a dose in mJ/cm² cures resin; 0 below the critical dose."""
        return max(self.Dp_um * float(depth(self.lines, math.log(dose / self.Ec_mJ_per_cm2))), 0.0)

    def transmitted(self, depth_um: ArrayLike) -> FloatArray:
        """Return the fraction of the light that reaches given depths."""
        return transmitted(self.lines, np.asarray(depth_um, float) / self.Dp_um)

    def mean_doses(self, doses: FloatArray, layer_um: float) -> FloatArray:
        """Return the mean dose (N,) of each layer, from its own exposure and from those of the later layers."""
        total = np.zeros(len(doses))
        for fraction, absorption in self.lines:
            optical_depth = absorption * layer_um / self.Dp_um
            mean, transmittance = -math.expm1(-optical_depth) / optical_depth, math.exp(-optical_depth)
            dose = 0.0
            for number in range(len(doses) - 1, -1, -1):
                dose = float(doses[number]) + transmittance * dose
                total[number] += fraction * mean * dose
        return total


class _SpectralLaw(Strict):
    """Values of the spectral cure law, as read from a file."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    lamp: str = ""
    Dp_um: Positive
    u_Dp_um: NotNegative
    Ec_mJ_per_cm2: Positive
    u_Ec_mJ_per_cm2: NotNegative
    lamp_lines: tuple[tuple[Positive, Positive], ...]
    preferred: str | None = None


class CureFile(Strict):
    """Values read from a working-curve file, with the spectral cure law if the file contains it."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    error: ClassVar[type[SolenError]] = DataError

    Dp_um: Positive
    Ec_mJ_per_cm2: Positive
    covariance: tuple[tuple[float, float], tuple[float, float]]
    simulated: bool = False
    in_lamp: _SpectralLaw | None = None

    @property
    def values(self) -> dict[str, Any]:
        """Process parameters keyed by name, from the spectral cure law unless Jacobs' law fits the discs better."""
        if self.in_lamp is not None and self.in_lamp.preferred != "Jacobs":
            law = self.in_lamp
            return {"Dp_um": law.Dp_um, "Ec_mJ_per_cm2": law.Ec_mJ_per_cm2, "lamp": law.lamp_lines}
        return {"Dp_um": self.Dp_um, "Ec_mJ_per_cm2": self.Ec_mJ_per_cm2, "lamp": ()}

    @property
    def uncertainties(self) -> dict[str, float]:
        """Standard uncertainties of Dp and Ec of the spectral law; empty for Jacobs' law, which has a covariance."""
        if not self.values["lamp"] or self.in_lamp is None:
            return {}
        return {"Dp_um": self.in_lamp.u_Dp_um, "Ec_mJ_per_cm2": self.in_lamp.u_Ec_mJ_per_cm2}


def read_law(path: Path) -> CureFile:
    """Read the working curve from a file; raise `DataError` if the file contains none."""
    data = parse_json(read_text(path, DataError), str(path), remedy="write it with solen resin cure --out")
    if not isinstance(data, dict) or data.get("kind") != "cure":
        limit = "is not a working curve"
        raise DataError(str(path), limit=limit, remedy="write it with solen resin cure --out")
    with error_context(str(path)):
        return CureFile(**data)
