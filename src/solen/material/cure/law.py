"""Cure law from a working-curve file or a print process: cure depth, and the doses in a part.

From a dose E at the surface, E Σ w e^(-d r/Dp) remains at a depth d, where w and r are the power fraction and the
relative absorption of each of the lamp's lines (with a single line, this is Jacobs' law). Resin sets down to the depth
at which this dose equals Ec. A layer of a part receives its own dose and the light that all later layers transmit.

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
from solen.material.cure.spectral import ONE_LINE, Lines, depth, left
from solen.spec.objects import parse_json
from solen.spec.strict import NotNegative, Positive, Strict, error_context


@dataclass(frozen=True)
class CureLaw:
    """Penetration depth (at the surface if the lamp has several lines), critical dose, and the lamp's lines."""

    Dp_um: float
    Ec_mJ_per_cm2: float
    lines: Lines = ONE_LINE

    def depth_um(self, dose: float) -> float:
        """Return the depth to which a dose in mJ/cm² sets resin; 0 below the critical dose."""
        return max(self.Dp_um * float(depth(self.lines, math.log(dose / self.Ec_mJ_per_cm2))), 0.0)

    def left(self, depth_um: ArrayLike) -> FloatArray:
        """Return the fraction of the light that remains at given depths."""
        return left(self.lines, np.asarray(depth_um, float) / self.Dp_um)

    def received(self, doses: FloatArray, layer_um: float) -> FloatArray:
        """Return the mean dose (N,) of each layer, exposed with its own dose and then through the later layers."""
        total = np.zeros(len(doses))
        for share, absorption in self.lines:
            thick = absorption * layer_um / self.Dp_um
            mean, through, later = -math.expm1(-thick) / thick, math.exp(-thick), 0.0
            for number in range(len(doses) - 1, -1, -1):
                later = float(doses[number]) + through * later
                total[number] += share * mean * later
        return total


class _InLamp(Strict):
    """Values of the law for a lamp's lines, as read from a file."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    lamp: str = ""
    Dp_um: Positive
    u_Dp_um: NotNegative
    Ec_mJ_per_cm2: Positive
    u_Ec_mJ_per_cm2: NotNegative
    lamp_lines: tuple[tuple[Positive, Positive], ...]
    preferred: str | None = None


class CureFile(Strict):
    """Values read from a working-curve file, including the law for the lamp's spectrum if present."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    error: ClassVar[type[SolenError]] = DataError

    Dp_um: Positive
    Ec_mJ_per_cm2: Positive
    covariance: tuple[tuple[float, float], tuple[float, float]]
    simulated: bool = False
    in_lamp: _InLamp | None = None

    @property
    def values(self) -> dict[str, Any]:
        """Return the process parameters by key, from the lamp's law unless the discs prefer Jacobs' law."""
        if self.in_lamp is not None and self.in_lamp.preferred != "Jacobs":
            law = self.in_lamp
            return {"Dp_um": law.Dp_um, "Ec_mJ_per_cm2": law.Ec_mJ_per_cm2, "lamp": law.lamp_lines}
        return {"Dp_um": self.Dp_um, "Ec_mJ_per_cm2": self.Ec_mJ_per_cm2, "lamp": ()}

    @property
    def uncertainties(self) -> dict[str, float]:
        """Return the standard uncertainties for the lamp's law; Jacobs' law has a covariance instead."""
        if not self.values["lamp"] or self.in_lamp is None:
            return {}
        return {"Dp_um": self.in_lamp.u_Dp_um, "Ec_mJ_per_cm2": self.in_lamp.u_Ec_mJ_per_cm2}


def read_law(path: Path) -> CureFile:
    """Read the working curve from a file; `DataError` if the file contains none."""
    data = parse_json(read_text(path, DataError), str(path), remedy="write it with solen resin cure --out")
    if not isinstance(data, dict) or data.get("kind") != "cure":
        limit = "is not a working curve"
        raise DataError(str(path), limit=limit, remedy="write it with solen resin cure --out")
    with error_context(str(path)):
        return CureFile(**data)
