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

    name: Text = Field(description="its name.")
    value: Text = Field(description="expression of powers EMITTER.RECEIVER: (a.right - a.left) / (a.right + a.left).")


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
    _places: Mapping[tuple[str, str], str]

    @classmethod
    def of(cls, reading: Reading, emitters: Sequence[str], receivers: Sequence[str], key: str = "") -> Self:
        """Parse the expression of a reading; raise `SpecError` if it is malformed or contains no power."""
        pairs = list(product(emitters, receivers))
        mark = next(mark for length in count(1) if (mark := "p" * length) not in reading.value)  # a name not stated
        known = {pair: f"{mark}_{number}" for number, pair in enumerate(pairs)}
        shown = {place: ".".join(pair) for pair, place in known.items()}

        def refusal(limit: str, remedy: str) -> Exception:
            limit = re.sub(rf"{mark}_\d+", lambda found: shown.get(found[0], found[0]), limit)
            choices = (
                f"powers are EMITTER.RECEIVER, with emitters {', '.join(emitters)} and receivers {', '.join(receivers)}"
            )
            return refused(key, limit, value=reading.value, remedy=remedy or choices)

        def check(name: str) -> None:
            if name not in stated:
                raise refusal(f"{name} is not a power", "")

        text, stated = _with_places(reading.value, known, refusal)
        grammar = Grammar("power", False, refusal, check)
        tree = parsed(text, grammar)
        held = set(names(tree, grammar))
        if not held:
            raise refusal("names no power", "")
        return cls(reading.name, tuple(power for power, place in known.items() if place in held), tree, known)

    def value(self, powers: Mapping[tuple[str, str], Any]) -> Any:
        """Return the value of the reading for powers given by emitter and receiver."""
        return value(self._tree, self._by_place(powers))

    def slopes(self, powers: Mapping[tuple[str, str], Any]) -> dict[tuple[str, str], Any]:
        """Return the exact derivatives of the reading with respect to the powers that it contains."""
        found = derivatives(self._tree, self._by_place(powers))
        return {power: found[self._places[power]] for power in self.powers}

    def _by_place(self, powers: Mapping[tuple[str, str], Any]) -> dict[str, Any]:
        return {self._places[power]: powers[power] for power in self.powers}


def _with_places(
    text: str, known: Mapping[tuple[str, str], str], refusal: Callable[[str, str], Exception]
) -> tuple[str, set[str]]:
    """Replace every power in the text by an identifier.

    Return the new text and the identifiers used; raise an error if a power does not exist.
    """
    stated = set()

    def place(found: re.Match[str]) -> str:
        emitter, receiver = found[0].split(".")
        is_number = _NUMBER.fullmatch(found[0])
        if is_number and (emitter, receiver) not in known:
            return found[0]
        if is_number:
            raise refusal(f"{found[0]} is both a number and a power", "give the emitter a name that contains a letter")
        if (emitter, receiver) not in known:
            near = nearest(found[0], [".".join(pair) for pair in known])
            hints = [f"did you mean {near}?"] * bool(near) + ["put spaces around a minus sign after a name"] * (
                "-" in found[0]
            )
            raise refusal(f"{found[0]} is not a power", " ".join(hints))
        stated.add(known[emitter, receiver])
        return known[emitter, receiver]

    return _POWER.sub(place, text), stated
