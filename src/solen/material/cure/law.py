"""The law by which light cures a resin, as a working curve's file or a process states it: depth and doses in a part.

The idea: a dose E at the surface leaves E Σ w e^(-d r/Dp) at a depth d, w and r being the shares and relative
absorptions of the lamp's lines (one line: Jacobs' law), and resin sets down to where that is Ec. A layer of a part
receives its own dose and what all later layers let through.

The interface: `CureLaw`; `read_law` of a file that `solen resin cure --out` wrote.
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
from solen.spec.objects import parsed
from solen.spec.strict import NotNegative, Positive, Strict, error_context


@dataclass(frozen=True)
class CureLaw:
    """Penetration depth (with a lamp, at the surface), critical dose, and the lamp's lines."""

    Dp_um: float
    Ec_mJ_per_cm2: float
    lines: Lines = ONE_LINE

    def depth_um(self, dose: float) -> float:
        """How deep a dose in mJ/cm² sets resin; 0 below the critical dose."""
        return max(self.Dp_um * float(depth(self.lines, math.log(dose / self.Ec_mJ_per_cm2))), 0.0)

    def left(self, depth_um: ArrayLike) -> FloatArray:
        """Share of the light that is left at depths."""
        return left(self.lines, np.asarray(depth_um, float) / self.Dp_um)

    def received(self, doses: FloatArray, layer_um: float) -> FloatArray:
        """Mean dose (N,) in layers, of which each is exposed with its own dose and after that through later ones."""
        total = np.zeros(len(doses))
        for share, absorption in self.lines:
            thick = absorption * layer_um / self.Dp_um
            mean, through, later = -math.expm1(-thick) / thick, math.exp(-thick), 0.0
            for number in range(len(doses) - 1, -1, -1):
                later = float(doses[number]) + through * later
                total[number] += share * mean * later
        return total


class _InLamp(Strict):
    """Law with a lamp's lines, as far as it is needed."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    lamp: str = ""
    Dp_um: Positive
    u_Dp_um: NotNegative
    Ec_mJ_per_cm2: Positive
    u_Ec_mJ_per_cm2: NotNegative
    lamp_lines: tuple[tuple[Positive, Positive], ...]
    preferred: str | None = None


class CureFile(Strict):
    """The needed part of a working curve's file; the law with the lamp in addition to Jacobs'."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    error: ClassVar[type[SolenError]] = DataError

    Dp_um: Positive
    Ec_mJ_per_cm2: Positive
    covariance: tuple[tuple[float, float], tuple[float, float]]
    simulated: bool = False
    in_lamp: _InLamp | None = None

    @property
    def values(self) -> dict[str, Any]:
        """Numbers of a process by its keys: those of the lamp's law, unless the discs prefer Jacobs'."""
        if self.in_lamp is not None and self.in_lamp.preferred != "Jacobs":
            law = self.in_lamp
            return {"Dp_um": law.Dp_um, "Ec_mJ_per_cm2": law.Ec_mJ_per_cm2, "lamp": law.lamp_lines}
        return {"Dp_um": self.Dp_um, "Ec_mJ_per_cm2": self.Ec_mJ_per_cm2, "lamp": ()}

    @property
    def uncertainties(self) -> dict[str, float]:
        """Standard uncertainties of the lamp's law; of Jacobs' there is the covariance."""
        if not self.values["lamp"] or self.in_lamp is None:
            return {}
        return {"Dp_um": self.in_lamp.u_Dp_um, "Ec_mJ_per_cm2": self.in_lamp.u_Ec_mJ_per_cm2}


def read_law(path: Path) -> CureFile:
    """Working curve of a file; `DataError` if it is not one."""
    data = parsed(read_text(path, DataError), str(path), remedy="write it with solen resin cure --out")
    if not isinstance(data, dict) or data.get("kind") != "cure":
        limit = "is not a working curve"
        raise DataError(str(path), limit=limit, remedy="write it with solen resin cure --out")
    with error_context(str(path)):
        return CureFile(**data)
