"""The statements in the paper with their locations, and whether the values computed by solen agree with them.

``statements.toml`` contains every number in the paper, and one rule decides. The uncertainty of a reported number is
that of its last digit (a rectangular distribution of that width). A computed value that deviates by at most two
combined standard uncertainties **agrees**; otherwise it **differs**. A bound differs if it is missed by more than two
combined standard uncertainties; a direction agrees if its sign is certain to the same extent. "Negligible" is
interpreted as below 5 % of the effect with which the value is compared. A statement based on unpublished data **cannot
be checked**, whatever solen simulates instead.

Public names: `compared` and `Comparison`.
"""

import math
import tomllib
from functools import cache
from importlib.resources import files
from typing import Any, ClassVar, Final, Literal

from solen.errors import DataError, SolenError
from solen.results import Result
from solen.spec.strict import Strict

Verdict = Literal["agrees", "differs", "cannot be checked"]
AGREES: Final = "agrees"
DIFFERS: Final = "differs"
UNCHECKED: Final = "cannot be checked"
COVERAGE_FACTOR = 2.0
"""Number of combined standard uncertainties by which two values may differ and still agree."""
NEGLIGIBLE_PERCENT = 5.0


class Statement(Strict):
    """A statement in the paper, as listed in ``statements.toml``."""

    error: ClassVar[type[SolenError]] = DataError

    key: str
    figure: str
    panel: str
    place: str
    words: str
    quantity: str
    kind: Literal["value", "above", "positive", "negative", "negligible", "measured"]
    value: float | None = None
    resolution: float | None = None
    unit: str
    why: str

    @property
    def u_value(self) -> float:
        """Standard uncertainty of the reported number, from its last digit."""
        return (self.resolution or 0.0) / math.sqrt(12.0)

    def verdict(self, number: float | None, u: float) -> Verdict:
        """Return whether a computed value agrees with the statement."""
        if self.kind == "measured" or number is None or not math.isfinite(number):
            return UNCHECKED
        if self.kind in {"positive", "negative"}:
            signed = number if self.kind == "positive" else -number
            return AGREES if signed > COVERAGE_FACTOR * u else DIFFERS if signed < -COVERAGE_FACTOR * u else UNCHECKED
        if self.kind == "negligible":
            return AGREES if abs(number) - COVERAGE_FACTOR * u <= NEGLIGIBLE_PERCENT else DIFFERS
        deviation, tolerance = number - (self.value or 0.0), COVERAGE_FACTOR * math.hypot(u, self.u_value)
        return AGREES if (deviation >= -tolerance if self.kind == "above" else abs(deviation) <= tolerance) else DIFFERS


class Comparison(Result):
    """A statement in the paper and the value computed by solen.

    Attributes
    ----------
    key, figure, panel
        Key, figure and panel of the statement.
    paper, place
        The statement, and its location in the paper.
    paper_value, u_paper_value
        The reported value and its uncertainty, from the last digit; None if the statement contains no value.
    quantity, unit
        The quantity computed by solen, and its unit.
    solen_value, u_solen_value
        The computed value, None if there is none, and its standard uncertainty.
    verdict
        ``agrees``, ``differs`` or ``cannot be checked``.
    why
        The reason for the verdict.
    """

    key: str
    figure: str
    panel: str
    paper: str
    place: str
    paper_value: float | None
    u_paper_value: float | None
    quantity: str
    unit: str
    solen_value: float | None
    u_solen_value: float
    verdict: Verdict
    why: str


@cache
def statements() -> dict[str, Statement]:
    """Return all statements, keyed by ``key``."""
    text = (files("solen.paper") / "statements.toml").read_text(encoding="utf-8")
    return {row["key"]: Statement(**row) for row in tomllib.loads(text)["statement"]}


def paper_value(key: str) -> float:
    """Return the value reported in a statement."""
    value = statements()[key].value
    if value is None:
        raise KeyError(key)
    return value


def compared(key: str, number: float | None, u: float = 0.0, **reason_values: Any) -> Comparison:
    """Compare a statement with a computed value; ``reason_values`` are inserted into the reason."""
    statement = statements()[key]
    return Comparison(
        key=key,
        figure=statement.figure,
        panel=statement.panel,
        paper=statement.words,
        place=statement.place,
        paper_value=statement.value,
        u_paper_value=None if statement.value is None else statement.u_value,
        quantity=statement.quantity,
        unit=statement.unit,
        solen_value=number,
        u_solen_value=u,
        verdict=statement.verdict(number, u),
        why=statement.why.format(**reason_values),
    )
