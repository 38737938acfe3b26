"""Requirements and goals: expressions of merits, such as ``abs(null_deg) < 0.3``.

The names in an expression are merits. ``base_null_deg`` is the null of the design itself; ``base`` is short for it if
the null is the only merit in the expression. If a design is traced with deviations, ``worst(light)`` is the worst value
over them, and other merits in the expression are those of the design without deviations.

Public names: `Requirement` and `Goal`.
"""

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.errors import SpecError
from solen.explore.merits import MERITS, worst_index
from solen.expression import MAX_LENGTH, Grammar, names, parsed, value, violation
from solen.spec.strict import nearest

_BASE, _WORST = "base", "worst"


@dataclass(frozen=True)
class Expression:
    """An expression of merits.

    Attributes
    ----------
    text
        The expression as specified.
    merits
        Merits in the expression.
    worst
        Merits whose worst values are in the expression.
    known
        Merits that exist.
    """

    text: str
    merits: tuple[str, ...]
    worst: tuple[str, ...] = ()
    known: tuple[str, ...] = MERITS

    option: ClassVar[str] = "--require"
    is_condition: ClassVar[bool] = True
    has_cases: ClassVar[bool] = False

    @classmethod
    def parse(cls, text: str, known: tuple[str, ...] = MERITS) -> Self:
        """Parse an expression of the existing merits; raise `SpecError` if it is malformed or contains no merit."""
        grammar = cls._grammar(text, known)
        terms = dict.fromkeys(names(parsed(text, grammar), grammar))
        unprefixed = [name.removeprefix(f"{_BASE}_").removeprefix(f"{_WORST} ") for name in terms if name != _BASE]
        merits = tuple(dict.fromkeys(unprefixed))
        worst = tuple(merit for merit in merits if f"{_WORST} {merit}" in terms)
        if worst and not cls.has_cases:
            limit = "worst(...) requires deviations specified with --robust, but there are none"
            raise cls.malformed(text, limit, "write the merit without worst")
        if not merits:
            raise cls.malformed(text, "names no merit", f"use one of {', '.join(known)}")
        if _BASE in terms and len(merits) > 1:
            limit = "base stands for a single merit, but several are named"
            raise cls.malformed(text, limit, f"write {_BASE}_{merits[0]}")
        return cls(text, merits, worst, known)

    @classmethod
    def malformed(cls, text: str, limit: str, remedy: str = "") -> SpecError:
        """Return the error of a malformed expression."""
        text = text if len(text) <= MAX_LENGTH else f"{text[:20]}..."
        example = "abs(null_deg) < 0.3" if cls.is_condition else "linearity_percent"
        return SpecError(cls.option, value=text, limit=limit, remedy=remedy or f"use the form {example}")

    @classmethod
    def _grammar(cls, text: str, known: tuple[str, ...]) -> Grammar:
        def check(name: str) -> None:
            if name != _BASE and name.removeprefix(f"{_BASE}_").removeprefix(f"{_WORST} ") not in known:
                suggestion = nearest(name, known)
                remedy = f"did you mean {suggestion}?" if suggestion else f"use one of {', '.join(known)}"
                raise cls.malformed(text, f"{name} is not a merit", remedy)

        return Grammar(
            "merit", cls.is_condition, lambda limit, remedy: cls.malformed(text, limit, remedy), check, (_WORST,)
        )

    @property
    def _tree(self) -> ast.expr:
        return parsed(self.text, self._grammar(self.text, self.known))

    def _values(self, merits: Mapping[str, FloatArray], base: Mapping[str, float]) -> dict[str, Any]:
        scalars = {f"{_BASE}_{name}": value for name, value in base.items()} | {_BASE: base[self.merits[0]]}
        scalars |= {f"{_WORST} {name}": merits[name][worst_index(name, merits[name])] for name in self.worst}
        columns = {name: column[:1] for name, column in merits.items()} if self.worst else merits
        return {**columns, **{name: np.float64(value) for name, value in scalars.items()}}


@dataclass(frozen=True)
class Requirement(Expression):
    """A condition on merits."""

    def met(self, merits: Mapping[str, FloatArray], base: Mapping[str, float]) -> BoolArray:
        """Return a mask (P,) of the points whose merits meet the condition; false if a merit is missing."""
        exists = np.all([~np.isnan(merits[name]) for name in self.merits], axis=0)
        with np.errstate(all="ignore"):
            return np.asarray(value(self._tree, self._values(merits, base)) & exists, dtype=bool)

    def violation(self, merits: Mapping[str, FloatArray], base: Mapping[str, float]) -> FloatArray:
        """Return the violation (P,) as a fraction of the limit; 0 if the condition is met, 1 if a merit is missing."""
        with np.errstate(all="ignore"):
            size = violation(self._tree, self._values(merits, base))
        return np.where(self.met(merits, base), 0.0, np.nan_to_num(size, nan=1.0, posinf=1e3))


@dataclass(frozen=True)
class Limit(Requirement):
    """A condition on the result of a search."""

    option: ClassVar[str] = "--subject-to"
    has_cases: ClassVar[bool] = True


@dataclass(frozen=True)
class Goal(Expression):
    """A value to be maximised or minimised."""

    option: ClassVar[str] = "--minimise or --maximise"
    is_condition: ClassVar[bool] = False
    has_cases: ClassVar[bool] = True

    def value(self, merits: Mapping[str, FloatArray], base: Mapping[str, float]) -> FloatArray:
        """Return the value (P,); NaN if a merit does not exist."""
        with np.errstate(all="ignore"):
            return np.asarray(value(self._tree, self._values(merits, base)), dtype=float)
