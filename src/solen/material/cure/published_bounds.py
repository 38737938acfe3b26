"""Bounds on the working curve of a resin from published statements without data points.

"39 mJ/cm² cures more than 200 µm" is an inequality, Dp ln(39/Ec) > 200 µm, so for each penetration depth the critical
dose is below 39 e^(-200/Dp). Several statements are consistent with all points (Dp, Ec) of a region; they determine no
single point. `PAPER` contains the statements of the paper on which solen is based (Cafiso et al.; Methods: 13 mW/cm²;
main text: depths), which does not report Dp and Ec.

`largest_Ec` returns the bound from several `Statement`s, and `binding` the statement that determines it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from solen.errors import DataError


@dataclass(frozen=True)
class Statement:
    """A dose in mJ/cm² that cures resin at least to a depth, with the words of the source."""

    dose_mJ_per_cm2: float
    depth_um: float
    words: str

    def largest_Ec(self, Dp_um: float) -> float:
        """Return the largest critical dose in mJ/cm² that is consistent with the statement at a penetration depth."""
        return self.dose_mJ_per_cm2 * math.exp(-self.depth_um / Dp_um)

    def holds(self, Dp_um: float, Ec_mJ_per_cm2: float) -> bool:
        """Whether a working curve is consistent with the statement."""
        return Dp_um * math.log(self.dose_mJ_per_cm2 / Ec_mJ_per_cm2) >= self.depth_um


PAPER = (
    Statement(39.0, 200.0, "3 s at 13 mW/cm², about 40 mJ/cm², cures more than 200 µm"),
    Statement(26.0, 25.0, "prints in layers of 25 µm with 2 s at 13 mW/cm², 26 mJ/cm²"),
    Statement(91.0, 100.0, "prints in layers up to 100 µm with less than 7 s, 91 mJ/cm²"),
)
"""Cure depths reported by the paper; each depth is a lower bound."""


def binding(Dp_um: float, statements: Sequence[Statement] = PAPER) -> Statement:
    """Return the statement with the lowest bound on the critical dose at a penetration depth."""
    if not 0.0 < Dp_um < math.inf:
        raise DataError("penetration depth", value=Dp_um, limit="must be above 0 µm")
    return min(statements, key=lambda statement: statement.largest_Ec(Dp_um))


def largest_Ec(Dp_um: float, statements: Sequence[Statement] = PAPER) -> float:
    """Return the largest critical dose in mJ/cm² that is consistent with all statements at a penetration depth."""
    return binding(Dp_um, statements).largest_Ec(Dp_um)
