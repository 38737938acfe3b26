"""The paper's statements with their locations, and whether solen's numbers agree.

One table contains every number in the paper, and one rule decides. The uncertainty of a reported number is that of its
last digit (a rectangular distribution of that width). A value within two combined standard uncertainties **agrees**,
and beyond them **differs**; a bound differs if it is missed by more than that; a direction agrees if its sign is
equally certain. "Negligible" is read as below 5 % of the effect with which the value is compared. A statement based on
unpublished data **cannot be checked**, whatever solen simulates in its place.

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
SURE = 2.0
"""Number of combined standard uncertainties beyond which two numbers differ."""
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
        """Return whether a number from the run agrees with the statement."""
        if self.kind == "measured" or number is None or not math.isfinite(number):
            return UNCHECKED
        if self.kind in {"positive", "negative"}:
            signed = number if self.kind == "positive" else -number
            return AGREES if signed > SURE * u else DIFFERS if signed < -SURE * u else UNCHECKED
        if self.kind == "negligible":
            return AGREES if abs(number) - SURE * u <= NEGLIGIBLE_PERCENT else DIFFERS
        off, sure = number - (self.value or 0.0), SURE * math.hypot(u, self.u_value)
        return AGREES if (off >= -sure if self.kind == "above" else abs(off) <= sure) else DIFFERS


class Comparison(Result):
    """A statement of the paper and solen's number.

    Attributes
    ----------
    key, figure, panel
        Key, figure and panel of the statement.
    paper, place
        The statement of the paper, and its place.
    paper_value, u_paper_value
        The stated number and its uncertainty from the last digit; None without a number.
    quantity, unit
        Quantity that solen computed, and its unit.
    solen_value, u_solen_value
        Its number and standard uncertainty; None if there is none.
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
    """Return all statements by their keys."""
    text = (files("solen.paper") / "statements.toml").read_text(encoding="utf-8")
    return {row["key"]: Statement(**row) for row in tomllib.loads(text)["statement"]}


def stated(key: str) -> float:
    """Return the number in a statement."""
    value = statements()[key].value
    if value is None:
        raise KeyError(key)
    return value


def compared(key: str, number: float | None, u: float = 0.0, **of_the_run: Any) -> Comparison:
    """Compare a statement with a number from the run; ``of_the_run`` are the numbers used in its reason."""
    one = statements()[key]
    return Comparison(
        key=key,
        figure=one.figure,
        panel=one.panel,
        paper=one.words,
        place=one.place,
        paper_value=one.value,
        u_paper_value=None if one.value is None else one.u_value,
        quantity=one.quantity,
        unit=one.unit,
        solen_value=number,
        u_solen_value=u,
        verdict=one.verdict(number, u),
        why=one.why.format(**of_the_run),
    )
