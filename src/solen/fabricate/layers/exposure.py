"""How long each layer is lit: the first ones longer, so that the part holds to the plate."""

import math
from dataclasses import dataclass

from solen.errors import SpecError

MOST_S = 3600.0


@dataclass(frozen=True)
class Exposure:
    """Times in s of the first layers and of all others, and the irradiance at the window in mW/cm².

    The defaults are the paper's: six layers of 3 s, then 2 s, and 13 mW/cm² as its working curve was measured.
    """

    burn_in_layers: int = 6
    burn_in_s: float = 3.0
    layer_s: float = 2.0
    irradiance_mW_per_cm2: float = 13.0

    def __post_init__(self) -> None:
        if not 0 <= self.burn_in_layers <= 1000:
            raise SpecError("--burn-in-layers", value=self.burn_in_layers, limit="must be from 0 to 1000")
        for name, seconds in (("--burn-in-s", self.burn_in_s), ("--exposure-s", self.layer_s)):
            if not 0.0 < seconds <= MOST_S:
                raise SpecError(name, value=seconds, limit=f"must be above 0 and at most {MOST_S:g} s")
        if not (math.isfinite(self.irradiance_mW_per_cm2) and self.irradiance_mW_per_cm2 > 0.0):
            raise SpecError("--irradiance-mW-per-cm2", value=self.irradiance_mW_per_cm2, limit="must be above 0 mW/cm²")

    def seconds(self, index: int) -> float:
        """Exposure of a layer in s; the first is number 0."""
        return self.burn_in_s if index < self.burn_in_layers else self.layer_s

    def dose(self, index: int) -> float:
        """Dose of a layer at the window in mJ/cm²: irradiance times time."""
        return self.irradiance_mW_per_cm2 * self.seconds(index)

    def total_s(self, layers: int) -> float:
        """Exposure of a number of layers together in s."""
        burn_in = min(layers, self.burn_in_layers)
        return burn_in * self.burn_in_s + (layers - burn_in) * self.layer_s
