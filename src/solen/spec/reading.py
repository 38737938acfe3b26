"""Readings of a network: ``[[network.reading]]``, named expressions of powers such as ``(a.right - a.left) / a.end``.

A power is written ``EMITTER.RECEIVER``: the power at that receiver while that emitter is lit. Names may contain a dash,
so a minus sign between two names needs spaces. Expressions are parsed and never executed; see `solen.expression`.
"""

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, product
from typing import Any, ClassVar, Self

from pydantic import Field

from solen.expression import Grammar, derivatives, names, parsed, value
from solen.spec.strict import Strict, Text, nearest, refused

_NAME = r"[A-Za-z0-9](?:[A-Za-z0-9_-]*[A-Za-z0-9])?"
_POWER = re.compile(rf"(?<![\w.]){_NAME}\.{_NAME}(?![\w.])")
_NUMBER = re.compile(r"\d+\.\d+(?:[eE][-+]?\d+)?")


class Reading(Strict):
    """A named expression of powers."""

    table: ClassVar[str] = "network.reading"

    name: Text = Field(description="name of the reading.")
    value: Text = Field(
        description="expression of powers EMITTER.RECEIVER, such as (a.right - a.left) / (a.right + a.left)."
    )


@dataclass(frozen=True)
class Formula:
    """The parsed expression of a reading.

    Attributes
    ----------
    name
        Name of the reading.
    powers
        Emitter and receiver of each power in the expression.
    """

    name: str
    powers: tuple[tuple[str, str], ...]
    _tree: ast.expr
    _identifiers: Mapping[tuple[str, str], str]

    @classmethod
    def of(cls, reading: Reading, emitters: Sequence[str], receivers: Sequence[str], key: str = "") -> Self:
        """Parse the expression of a reading; raise `SpecError` if it is malformed or contains no power."""
        pairs = list(product(emitters, receivers))
        stem = next(stem for length in count(1) if (stem := "p" * length) not in reading.value)
        known = {pair: f"{stem}_{number}" for number, pair in enumerate(pairs)}
        shown = {identifier: ".".join(pair) for pair, identifier in known.items()}

        def refusal(limit: str, remedy: str) -> Exception:
            limit = re.sub(rf"{stem}_\d+", lambda match: shown.get(match[0], match[0]), limit)
            choices = (
                f"write a power as EMITTER.RECEIVER; emitters: {', '.join(emitters)}; receivers: {', '.join(receivers)}"
            )
            return refused(key, limit, value=reading.value, remedy=remedy or choices)

        def check(name: str) -> None:
            if name not in inserted:
                raise refusal(f"{name} is not a power", "")

        text, inserted = _with_identifiers(reading.value, known, refusal)
        grammar = Grammar("power", False, refusal, check)
        tree = parsed(text, grammar)
        used = set(names(tree, grammar))
        if not used:
            raise refusal("must contain a power", "")
        return cls(reading.name, tuple(power for power, name in known.items() if name in used), tree, known)

    def value(self, powers: Mapping[tuple[str, str], Any]) -> Any:
        """Return the value of the reading for powers keyed by emitter and receiver."""
        return value(self._tree, self._by_identifier(powers))

    def slopes(self, powers: Mapping[tuple[str, str], Any]) -> dict[tuple[str, str], Any]:
        """Return the exact derivatives of the reading with respect to the powers that it contains."""
        slopes = derivatives(self._tree, self._by_identifier(powers))
        return {power: slopes[self._identifiers[power]] for power in self.powers}

    def _by_identifier(self, powers: Mapping[tuple[str, str], Any]) -> dict[str, Any]:
        return {self._identifiers[power]: powers[power] for power in self.powers}


def _with_identifiers(
    text: str, known: Mapping[tuple[str, str], str], refusal: Callable[[str, str], Exception]
) -> tuple[str, set[str]]:
    """Replace every power in the text by an identifier.

    Return the new text and the identifiers used; raise an error if a power does not exist.
    """
    used = set()

    def identifier(match: re.Match[str]) -> str:
        power = match[0]
        emitter, receiver = power.split(".")
        is_number = _NUMBER.fullmatch(power)
        if is_number and (emitter, receiver) not in known:
            return power
        if is_number:
            raise refusal(f"{power} is both a number and a power", "give the emitter a name that contains a letter")
        if (emitter, receiver) not in known:
            near = nearest(power, [".".join(pair) for pair in known])
            hints = [f"did you mean {near}?"] if near else []
            hints += ["put spaces around a minus sign after a name"] if "-" in power else []
            raise refusal(f"{power} is not a power", " ".join(hints))
        used.add(known[emitter, receiver])
        return known[emitter, receiver]

    return _POWER.sub(identifier, text), used
