"""Numbers that vary from print to print: distributions of their deviations from the design, and prints drawn from them.

Public names: `variation`, `drawn` and `offs`.
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
STATED = "stated"
_TERM = re.compile(r"\s*([+-]?)\s*(?:([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*\*\s*)?([a-z_]+[A-Za-z_0-9.\[\]]+)\s*")
UNSEEN = ("fabricate", "tolerance", "trace", "motion")
"""Tables whose numbers do not affect light and readout, or are the same for all designs of a table."""


@dataclass(frozen=True)
class Variation:
    """Distribution of the deviation of one number from its design value, or of several that move together.

    Attributes
    ----------
    key
        The number, or the sum of several with their weights, as stated; or the name of the cause that moves several.
    kind
        ``normal`` with mean and standard deviation, or ``uniform`` between two ends.
    first, second
        Mean and standard deviation, or the ends, in the unit of the key.
    source
        Source of the distribution.
    moved
        If the key is a name: displacement of each number per unit of it.
    """

    key: str
    kind: Literal["normal", "uniform"]
    first: float
    second: float
    source: str = STATED
    moved: Mapping[str, float] | None = None

    @property
    def weights(self) -> Mapping[str, float]:
        """Displacement of each number of the design per unit of the deviation."""
        return together(self.key) if self.moved is None else self.moved

    @property
    def centre(self) -> float:
        """Deviation that does not change on tightening: the mean if normal, otherwise the deviation nearest to 0."""
        return self.first if self.kind == "normal" else min(max(0.0, self.first), self.second)

    def deviation(self, share: FloatArray) -> FloatArray:
        """Return the deviations at probabilities, 0 to 1, of its distribution function."""
        if self.kind == "normal":
            return np.asarray(self.first + self.second * ndtri(share))
        return np.asarray(self.first + (self.second - self.first) * share)

    def standard(self, deviation: FloatArray) -> FloatArray:
        """Return the standard variable of deviations: with mean 0 and unit variance, or uniform from −1 to 1."""
        if self.kind == "normal":
            return np.asarray((deviation - self.first) / self.second)
        return np.asarray((2.0 * deviation - self.first - self.second) / (self.second - self.first))

    def polynomial(self, degree: int, variable: FloatArray) -> FloatArray:
        """Return an orthonormal polynomial of its standard variable."""
        if self.kind == "normal":
            return np.asarray(eval_hermitenorm(degree, variable) / math.sqrt(math.factorial(degree)))
        return np.asarray(eval_legendre(degree, variable) * math.sqrt(2 * degree + 1))


def variation(text: str, sensor: Sensor) -> Variation:
    """Parse a variation; raise `SpecError` if it is malformed or its number has no effect."""
    key, _, stated = (part.strip() for part in text.partition("="))
    kind, *numbers = stated.split(":")
    what = f"--vary {key}"
    try:
        first, second = map(float, numbers)
    except ValueError:
        raise SpecError(what, value=stated, limit="is not a distribution with two numbers", remedy=FORMS) from None
    if kind not in {"normal", "uniform"} or not (math.isfinite(first) and math.isfinite(second)):
        raise SpecError(what, value=stated, limit="is not a normal or uniform distribution", remedy=FORMS)
    if kind == "normal" and not second > 0.0:
        raise SpecError(what, value=second, limit="a standard deviation must be greater than 0", remedy="omit it")
    if kind == "uniform" and not first < second:
        raise SpecError(what, value=stated, limit="is an empty range", remedy="write the lower end first")
    for each in together(key):
        check_key(sensor, each, "--vary", material=True)
    return Variation(key, "normal" if kind == "normal" else "uniform", first, second)


def check_key(sensor: Sensor, key: str, option: str, *, material: bool = False) -> None:
    """Raise `SpecError` if a key is not that of a number that affects the response.

    With ``material``, numbers of the material are accepted even if they follow from a resin.
    """
    if key.partition(".")[0] in UNSEEN or key.startswith("network.motion["):
        limit = "is not a parameter that affects a response, or is the same for all designs"
        raise SpecError(f"{option} {key}", limit=limit, remedy="omit it")
    number(sensor, key)
    if why := "" if material and key in MATERIAL_KEYS else why_inert(sensor, key):
        raise SpecError(f"{option} {key}", limit=why, remedy="omit it")


def deviation_of(text: str, sensor: Sensor, option: str) -> tuple[str, float]:
    """Parse number and size, ``emitter.offset_mm=0.03``; raise `SpecError` if malformed or without effect."""
    key, _, stated = (part.strip() for part in text.partition("="))
    try:
        size = float(stated)
    except ValueError:
        size = math.nan
    if not 0.0 < size < math.inf:
        limit, remedy = "must be a number greater than 0", "write KEY=DEVIATION, as in emitter.offset_mm=0.03"
        raise SpecError(f"{option} {key}", value=stated, limit=limit, remedy=remedy)
    check_key(sensor, key, option, material=True)
    return key, size


def together(text: str) -> dict[str, float]:
    """Parse a sum of numbers that vary together, ``body.arm_width_mm+0.5*lens.half_width_mm``, to their weights."""
    weights: dict[str, float] = {}
    place = 0
    while place < len(text) and (term := _TERM.match(text, place)) and bool(term[1]) == bool(place):
        try:
            weight = float(term[2] or 1.0)
        except ValueError:
            break
        weights[term[3]] = weights.get(term[3], 0.0) + (-weight if term[1] == "-" else weight)
        place = term.end()
    if place < len(text) or not weights:
        remedy = "write KEY, or KEY+0.5*KEY for parameters that vary together"
        raise SpecError(
            "--vary", value=text, limit="is not a design parameter or a sum of design parameters", remedy=remedy
        )
    return weights


def offs(variations: Sequence[Variation], row: Sequence[float]) -> dict[str, float]:
    """Return the deviation of each number in one print."""
    moved: dict[str, float] = {}
    for one, deviation in zip(variations, row, strict=True):
        for key, weight in one.weights.items():
            moved[key] = moved.get(key, 0.0) + weight * deviation
    return moved


def drawn(variations: Sequence[Variation], prints: int, seed: int) -> FloatArray:
    """Draw deviations (P, D) of prints from a scrambled Sobol' sequence."""
    shares = sobol(len(variations), prints, np.random.default_rng(seed))
    return np.column_stack([one.deviation(column) for one, column in zip(variations, shares.T, strict=True)])
