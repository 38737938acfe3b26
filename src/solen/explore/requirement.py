"""Expressions of merits, such as ``abs(null_deg) < 0.3``, parsed and never run as code.

Names are the merits. ``base`` is the merit that an expression names, of which there must then be one, for the design
itself; ``base_null_deg`` names it in full. Allowed are numbers, + - * / ** and brackets, abs, min and max, comparisons,
``and``, ``or`` and ``not``. Where a design is traced with numbers off, ``worst(light)`` is the worst over these, and
other merits beside it in an expression are those of the design as it is.

The interface: `Requirement.parse` a condition, ``met`` by arrays of merits, and ``violation`` of it; `Goal.parse` a
value.
"""

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.errors import SpecError
from solen.explore.merits import MERITS, worst_place
from solen.spec.strict import nearest

LONGEST, DEEPEST, LARGEST = 500, 20, 1e100
_BASE, _WORST = "base", "worst"
_ARITHMETIC: Mapping[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_COMPARED: Mapping[type, Callable[..., Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": np.abs,
    "min": lambda *values: np.minimum.reduce(np.broadcast_arrays(*values)),
    "max": lambda *values: np.maximum.reduce(np.broadcast_arrays(*values)),
}


@dataclass(frozen=True)
class Expression:
    """An expression of merits.

    Attributes
    ----------
    text
        As it was stated.
    merits
        Merits that it names.
    worst
        Those of which it names the worst.
    """

    text: str
    merits: tuple[str, ...]
    worst: tuple[str, ...] = ()

    option: ClassVar[str] = "--require"
    is_condition: ClassVar[bool] = True
    has_cases: ClassVar[bool] = False

    @classmethod
    def parse(cls, text: str) -> Self:
        """Expression of a text; `SpecError` where it is malformed or names no merit."""
        names = dict.fromkeys(_names(_tree(cls, text), cls, text))
        bare = [name.removeprefix(f"{_BASE}_").removeprefix(f"{_WORST}_") for name in names if name != _BASE]
        merits = tuple(dict.fromkeys(bare))
        worst = tuple(merit for merit in merits if f"{_WORST}_{merit}" in names)
        if worst and not cls.has_cases:
            raise cls.refusal(
                text, "worst(...) is over the numbers off of --robust, and there are none", "leave it out"
            )
        if not merits:
            raise cls.refusal(text, "names no merit", f"the merits are {', '.join(MERITS)}")
        if _BASE in names and len(merits) > 1:
            raise cls.refusal(text, "base stands for one merit, and several are named", f"write {_BASE}_{merits[0]}")
        return cls(text, merits, worst)

    @classmethod
    def refusal(cls, text: str, limit: str, remedy: str = "") -> SpecError:
        """The error of a malformed expression."""
        example = "abs(null_deg) < 0.3" if cls.is_condition else "linearity_percent"
        return SpecError(cls.option, value=text, limit=limit, remedy=remedy or f"write as in {example}")

    def _values(self, merits: Mapping[str, FloatArray], base: Mapping[str, float]) -> dict[str, Any]:
        named = {f"{_BASE}_{name}": value for name, value in base.items()}
        numbers = named | {_BASE: base[self.merits[0]]}
        own = {name: column[:1] for name, column in merits.items()} if self.worst else merits
        numbers |= {f"{_WORST}_{name}": merits[name][worst_place(name, merits[name])] for name in self.worst}
        return {**own, **{name: np.float64(value) for name, value in numbers.items()}}


@dataclass(frozen=True)
class Requirement(Expression):
    """A condition on merits."""

    def met(self, merits: Mapping[str, FloatArray], base: Mapping[str, float]) -> BoolArray:
        """Where merits (P,) meet it, given those of the design itself; a merit that does not exist meets nothing."""
        exists = np.all([~np.isnan(merits[name]) for name in self.merits], axis=0)
        with np.errstate(all="ignore"):
            return np.asarray(_value(_tree(type(self), self.text), self._values(merits, base)) & exists, dtype=bool)

    def violation(self, merits: Mapping[str, FloatArray], base: Mapping[str, float]) -> FloatArray:
        """How far merits (P,) are from meeting it, as shares of its limits; 0 where they do, 1 where one is missing."""
        with np.errstate(all="ignore"):
            missed = _missed(_tree(type(self), self.text), self._values(merits, base))
        return np.where(self.met(merits, base), 0.0, np.nan_to_num(missed, nan=1.0, posinf=1e3))


@dataclass(frozen=True)
class Limit(Requirement):
    """A condition on the result of a search."""

    option: ClassVar[str] = "--subject-to"
    has_cases: ClassVar[bool] = True


@dataclass(frozen=True)
class Goal(Expression):
    """A value to be made as large or as small as it can be."""

    option: ClassVar[str] = "--minimise or --maximise"
    is_condition: ClassVar[bool] = False
    has_cases: ClassVar[bool] = True

    def value(self, merits: Mapping[str, FloatArray], base: Mapping[str, float]) -> FloatArray:
        """Its value (P,); NaN where a merit does not exist."""
        with np.errstate(all="ignore"):
            return np.asarray(_value(_tree(type(self), self.text), self._values(merits, base)), dtype=float)


def _tree(kind: type[Expression], text: str) -> ast.expr:
    """Parsed expression, which is a condition where its kind is."""
    if len(text) > LONGEST:
        raise kind.refusal(f"{text[:20]}...", f"is longer than {LONGEST} characters")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise kind.refusal(text, "is not an expression") from None
    if kind.is_condition and not _is_condition(tree):
        raise kind.refusal(text, "is not a condition", "compare two sides by <, <=, > or >=")
    if not kind.is_condition and any(isinstance(node, ast.Compare | ast.BoolOp) for node in ast.walk(tree)):
        raise kind.refusal(text, "is a condition, not a value")
    return tree


def _is_condition(node: ast.expr) -> bool:
    if isinstance(node, ast.BoolOp):
        return all(map(_is_condition, node.values))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return _is_condition(node.operand)
    return isinstance(node, ast.Compare)


def _names(node: ast.AST, kind: type[Expression], text: str, depth: int = 0) -> list[str]:
    """Names of merits in a tree; `SpecError` for anything that an expression may not hold."""
    if depth > DEEPEST:
        raise kind.refusal(text, "has too many brackets")
    if isinstance(node, ast.Name):
        return [_merit(node.id, kind, text)]
    if isinstance(node, ast.Constant):
        return _no_names(node, kind, text)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == _WORST:
        return [f"{_WORST}_{_worst(node, kind, text)}"]
    parts: list[ast.AST]
    if isinstance(node, ast.Call):
        parts = _arguments(node, kind, text)
    elif isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        parts = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub | ast.Not):
        parts = [node.operand]
    elif isinstance(node, ast.Compare) and all(type(op) in _COMPARED for op in node.ops):
        parts = [node.left, *node.comparators]
    elif isinstance(node, ast.BoolOp):
        parts = list(node.values)
    else:
        raise kind.refusal(text, f"{ast.unparse(node)} is not allowed in an expression of merits")
    within = isinstance(node, ast.BoolOp) or (isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not))
    if any(isinstance(part, ast.expr) and _is_condition(part) is not within for part in parts):
        raise kind.refusal(text, f"{ast.unparse(node)} takes {'conditions' if within else 'values'}")
    return [name for part in parts for name in _names(part, kind, text, depth + 1)]


def _arguments(node: ast.Call, kind: type[Expression], text: str) -> list[ast.AST]:
    """Arguments of a function that an expression may hold."""
    if not (isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS and node.args and not node.keywords):
        raise kind.refusal(text, f"functions are {', '.join((*_FUNCTIONS, _WORST))}")
    if node.func.id == "abs" and len(node.args) > 1:
        raise kind.refusal(text, "abs takes one value")
    return list(node.args)


def _worst(node: ast.Call, kind: type[Expression], text: str) -> str:
    """Merit of which the worst is named."""
    if len(node.args) == 1 and not node.keywords and isinstance(node.args[0], ast.Name) and node.args[0].id in MERITS:
        return node.args[0].id
    raise kind.refusal(text, "worst takes one merit", f"the merits are {', '.join(MERITS)}")


def _no_names(node: ast.Constant, kind: type[Expression], text: str) -> list[str]:
    """None, where a constant is a number of a size that can be."""
    if isinstance(node.value, bool) or not isinstance(node.value, int | float):
        raise kind.refusal(text, f"{ast.unparse(node)} is not allowed in an expression of merits")
    if not abs(node.value) < LARGEST:
        raise kind.refusal(text, "has too large a number")
    return []


def _merit(name: str, kind: type[Expression], text: str) -> str:
    """The name, where it is one of a merit."""
    if name != _BASE and name.removeprefix(f"{_BASE}_") not in MERITS:
        near = nearest(name, MERITS)
        remedy = f"did you mean {near}?" if near else f"the merits are {', '.join(MERITS)}"
        raise kind.refusal(text, f"{name} is not a merit", remedy)
    return name


def _value(node: ast.expr, values: Mapping[str, Any]) -> Any:
    """Value of a checked tree."""
    match node:
        case ast.Name():
            return values[node.id]
        case ast.Constant():
            return np.float64(node.value)  # type: ignore[arg-type]  # numbers alone pass the check
        case ast.Call(func=ast.Name(id="worst"), args=[ast.Name(id=merit)]):
            return values[f"{_WORST}_{merit}"]
        case ast.Call():
            return _FUNCTIONS[node.func.id](*(_value(part, values) for part in node.args))  # type: ignore[attr-defined]  # a name, as checked
        case ast.BinOp():
            return _ARITHMETIC[type(node.op)](_value(node.left, values), _value(node.right, values))
        case ast.UnaryOp():
            inner = _value(node.operand, values)
            return ~inner if isinstance(node.op, ast.Not) else _ARITHMETIC[type(node.op)](inner)
        case ast.BoolOp():
            join = np.logical_and if isinstance(node.op, ast.And) else np.logical_or
            return join.reduce(np.broadcast_arrays(*(_value(part, values) for part in node.values)))
        case ast.Compare():
            sides = [_value(part, values) for part in (node.left, *node.comparators)]
            pairs = zip(node.ops, sides, sides[1:], strict=False)
            return np.logical_and.reduce(np.broadcast_arrays(*(_COMPARED[type(op)](a, b) for op, a, b in pairs)))
    raise TypeError(ast.dump(node))


def _missed(node: ast.expr, values: Mapping[str, Any]) -> Any:
    """By how much the sides of a condition are on the wrong sides of one another, relative to their size."""
    if isinstance(node, ast.BoolOp):
        parts = np.broadcast_arrays(*(_missed(part, values) for part in node.values))
        return np.sum(parts, axis=0) if isinstance(node.op, ast.And) else np.min(parts, axis=0)
    if not isinstance(node, ast.Compare):
        return np.ones(())  # of a negation it is not known
    sides = [np.asarray(_value(part, values)) for part in (node.left, *node.comparators)]
    pairs = zip(node.ops, sides, sides[1:], strict=False)
    away = [b - a if isinstance(op, ast.Gt | ast.GtE) else a - b for op, a, b in pairs]
    size = max(float(np.nan_to_num(np.abs(side)).max()) for side in sides) or 1.0
    return np.sum([np.maximum(one, 0.0) / size for one in away], axis=0)
