"""Parameters that vary from print to print: distributions of their deviations, and samples of prints.

Public names: `variation`, `draw_deviations` and `deviations_by_key`.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import eval_hermitenorm, eval_legendre, ndtri

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.explore.sobol import sobol
from solen.sensor import Sensor
from solen.sensor.numbers import MATERIAL_KEYS, number, why_inert

FORMS = "write KEY=normal:MEAN:SD or KEY=uniform:LOW:HIGH, as deviations from the design"
SPECIFIED = "specified"
_TERM = re.compile(r"\s*([+-]?)\s*(?:([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*\*\s*)?([a-z_]+[A-Za-z_0-9.\[\]]+)\s*")
TABLES_WITHOUT_EFFECT = ("fabricate", "tolerance")
"""Tables whose parameters do not affect light and readout."""
COMMON_TABLES = ("trace", "motion")
"""Tables whose parameters must be the same for all designs that are compared."""


@dataclass(frozen=True)
class Variation:
    """Distribution of the deviation of a parameter from its design value, or of several that vary together.

    Attributes
    ----------
    key
        The parameter, or a weighted sum of several, as specified; or the name of the cause that changes several.
    kind
        ``normal`` with mean and standard deviation, or ``uniform`` between two limits.
    first, second
        Mean and standard deviation, or the limits, in the unit of the key.
    source
        Source of the distribution.
    effects
        If the key is the name of a cause: change of each parameter per unit of it.
    """

    key: str
    kind: Literal["normal", "uniform"]
    first: float
    second: float
    source: str = SPECIFIED
    effects: Mapping[str, float] | None = None

    @property
    def weights(self) -> Mapping[str, float]:
        """Change of each parameter of the design per unit of the deviation."""
        return weights_of(self.key) if self.effects is None else self.effects

    @property
    def centre(self) -> float:
        """Deviation that remains if the tolerance is tightened: the mean if normal, otherwise the one nearest to 0."""
        return self.first if self.kind == "normal" else min(max(0.0, self.first), self.second)

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Return the quantiles of the deviation at the given probabilities, 0 to 1."""
        if self.kind == "normal":
            return np.asarray(self.first + self.second * ndtri(probability))
        return np.asarray(self.first + (self.second - self.first) * probability)

    def standard(self, deviation: FloatArray) -> FloatArray:
        """Return the standardised variable of deviations: with mean 0 and variance 1, or uniform from −1 to 1."""
        if self.kind == "normal":
            return np.asarray((deviation - self.first) / self.second)
        return np.asarray((2.0 * deviation - self.first - self.second) / (self.second - self.first))

    def polynomial(self, degree: int, variable: FloatArray) -> FloatArray:
        """Return the orthonormal polynomial of a degree in the standardised variable."""
        if self.kind == "normal":
            return np.asarray(eval_hermitenorm(degree, variable) / math.sqrt(math.factorial(degree)))
        return np.asarray(eval_legendre(degree, variable) * math.sqrt(2 * degree + 1))


def variation(text: str, sensor: Sensor) -> Variation:
    """Parse a variation; raise `SpecError` if it is malformed or its parameter has no effect."""
    key, _, distribution = (part.strip() for part in text.partition("="))
    kind, *numbers = distribution.split(":")
    what = f"--vary {key}"
    try:
        first, second = map(float, numbers)
    except ValueError:
        limit = "is not a distribution with two numbers"
        raise SpecError(what, value=distribution, limit=limit, remedy=FORMS) from None
    if kind not in {"normal", "uniform"} or not (math.isfinite(first) and math.isfinite(second)):
        raise SpecError(what, value=distribution, limit="is not a normal or uniform distribution", remedy=FORMS)
    if kind == "normal" and not second > 0.0:
        limit = "is a standard deviation that is not greater than 0"
        raise SpecError(what, value=second, limit=limit, remedy="specify a larger value, or omit this --vary")
    if kind == "uniform" and not first < second:
        raise SpecError(what, value=distribution, limit="is an empty range", remedy="write the lower limit first")
    for parameter in weights_of(key):
        check_key(sensor, parameter, "--vary", material=True)
    return Variation(key, "normal" if kind == "normal" else "uniform", first, second)


def check_key(sensor: Sensor, key: str, option: str, *, material: bool = False) -> None:
    """Raise `SpecError` if a key does not name a parameter that affects the response.

    With ``material``, parameters of the material are accepted even if a resin determines them.
    """
    table = key.partition(".")[0]
    if table in TABLES_WITHOUT_EFFECT:
        raise SpecError(f"{option} {key}", limit="does not affect the response", remedy=f"omit {option} {key}")
    if table in COMMON_TABLES or key.startswith("network.motion["):
        limit = "must be the same for all designs that are compared"
        raise SpecError(f"{option} {key}", limit=limit, remedy=f"omit {option} {key}")
    number(sensor, key)
    if why := "" if material and key in MATERIAL_KEYS else why_inert(sensor, key):
        raise SpecError(f"{option} {key}", limit=why, remedy=f"omit {option} {key}")


def parse_deviation(text: str, sensor: Sensor, option: str) -> tuple[str, float]:
    """Parse key and size, ``emitter.offset_mm=0.03``; raise `SpecError` if malformed or without effect."""
    key, _, value = (part.strip() for part in text.partition("="))
    try:
        size = float(value)
    except ValueError:
        size = math.nan
    if not 0.0 < size < math.inf:
        limit, remedy = "must be a number greater than 0", "write KEY=DEVIATION, as in emitter.offset_mm=0.03"
        raise SpecError(f"{option} {key}", value=value, limit=limit, remedy=remedy)
    check_key(sensor, key, option, material=True)
    return key, size


def weights_of(text: str) -> dict[str, float]:
    """Parse a weighted sum, ``body.arm_width_mm+0.5*lens.half_width_mm``; return the weight of each parameter."""
    weights: dict[str, float] = {}
    position = 0
    while position < len(text) and (term := _TERM.match(text, position)) and bool(term[1]) == bool(position):
        try:
            weight = float(term[2] or 1.0)
        except ValueError:
            break
        weights[term[3]] = weights.get(term[3], 0.0) + (-weight if term[1] == "-" else weight)
        position = term.end()
    if position < len(text) or not weights:
        remedy = "write KEY, or KEY+0.5*KEY for parameters that vary together"
        raise SpecError(
            "--vary", value=text, limit="is not a design parameter or a sum of design parameters", remedy=remedy
        )
    return weights


def deviations_by_key(variations: Sequence[Variation], row: Sequence[float]) -> dict[str, float]:
    """Return the deviation of each parameter of a print with the given deviation (D,) of each variation."""
    deviations: dict[str, float] = {}
    for variation, deviation in zip(variations, row, strict=True):
        for key, weight in variation.weights.items():
            deviations[key] = deviations.get(key, 0.0) + weight * deviation
    return deviations


def draw_deviations(variations: Sequence[Variation], prints: int, seed: int) -> FloatArray:
    """Return deviations (P, D) of prints, sampled with a scrambled Sobol' sequence."""
    probabilities = sobol(len(variations), prints, np.random.default_rng(seed))
    columns = [variation.quantile(column) for variation, column in zip(variations, probabilities.T, strict=True)]
    return np.column_stack(columns)
