"""Requirements on merits: expressions such as ``abs(null_deg) < 0.3``, parsed and never run as code.

Names are the merits. ``base`` is the merit that an expression names, of which there must then be one, for the design
itself; ``base_null_deg`` names it in full. Allowed are numbers, + - * / ** and brackets, abs, min and max, comparisons,
``and``, ``or`` and ``not``.

The interface: `Requirement.parse` a text; ``met`` by arrays of merits.
"""

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.errors import SpecError
from solen.explore.merits import MERITS
from solen.spec.strict import nearest

LONGEST, DEEPEST = 500, 20
_BASE = "base"
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
class Requirement:
    """A condition on merits.

    Attributes
    ----------
    text
        As it was stated.
    merits
        Merits that it names.
    """

    text: str
    merits: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> "Requirement":
        """Requirement of a text; `SpecError` where it is not a condition on merits."""
        names = dict.fromkeys(_names(_tree(text), text))
        merits = tuple(dict.fromkeys(name.removeprefix(f"{_BASE}_") for name in names if name != _BASE))
        if not merits:
            raise _bad(text, "names no merit", f"the merits are {', '.join(MERITS)}")
        if _BASE in names and len(merits) > 1:
            raise _bad(text, "base stands for one merit, and several are named", f"write {_BASE}_{merits[0]}")
        return cls(text, merits)

    def met(self, merits: Mapping[str, FloatArray], base: Mapping[str, float]) -> BoolArray:
        """Where merits (P,) meet it, given those of the design itself; a merit that does not exist meets nothing."""
        values = {**merits, **{f"{_BASE}_{name}": value for name, value in base.items()}, _BASE: base[self.merits[0]]}
        exists = np.all([np.isfinite(merits[name]) | np.isinf(merits[name]) for name in self.merits], axis=0)
        with np.errstate(all="ignore"):
            return np.asarray(_value(_tree(self.text), values) & exists, dtype=bool)


def _bad(text: str, limit: str, remedy: str = "write as in abs(null_deg) < 0.3") -> SpecError:
    return SpecError("--require", value=text, limit=limit, remedy=remedy)


def _tree(text: str) -> ast.expr:
    """Parsed expression, which is a condition."""
    if len(text) > LONGEST:
        raise _bad(f"{text[:20]}...", f"is longer than {LONGEST} characters")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise _bad(text, "is not an expression") from None
    if not _is_condition(tree):
        raise _bad(text, "is not a condition", "compare two sides by <, <=, > or >=")
    return tree


def _is_condition(node: ast.expr) -> bool:
    if isinstance(node, ast.BoolOp):
        return all(map(_is_condition, node.values))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return _is_condition(node.operand)
    return isinstance(node, ast.Compare)


def _names(node: ast.AST, text: str, depth: int = 0) -> list[str]:
    """Names of merits in a tree; `SpecError` for anything that an expression may not hold."""
    if depth > DEEPEST:
        raise _bad(text, "has too many brackets")
    if isinstance(node, ast.Name):
        return [_merit(node.id, text)]
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return []
    if isinstance(node, ast.Call):
        if not (isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS and node.args and not node.keywords):
            raise _bad(text, f"functions are {', '.join(_FUNCTIONS)}")
        if node.func.id == "abs" and len(node.args) > 1:
            raise _bad(text, "abs takes one value")
        parts: list[ast.AST] = list(node.args)
    elif isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        parts = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub | ast.Not):
        parts = [node.operand]
    elif isinstance(node, ast.Compare) and all(type(op) in _COMPARED for op in node.ops):
        parts = [node.left, *node.comparators]
    elif isinstance(node, ast.BoolOp):
        parts = list(node.values)
    else:
        raise _bad(text, f"{ast.unparse(node)} is not allowed in a requirement")
    return [name for part in parts for name in _names(part, text, depth + 1)]


def _merit(name: str, text: str) -> str:
    """The name, where it is one of a merit."""
    if name != _BASE and name.removeprefix(f"{_BASE}_") not in MERITS:
        near = nearest(name, MERITS)
        remedy = f"did you mean {near}?" if near else f"the merits are {', '.join(MERITS)}"
        raise _bad(text, f"{name} is not a merit", remedy)
    return name


def _value(node: ast.expr, values: Mapping[str, Any]) -> Any:
    """Value of a checked tree."""
    match node:
        case ast.Name():
            return values[node.id]
        case ast.Constant():
            return float(node.value)  # type: ignore[arg-type]  # numbers alone pass the check
        case ast.Call():
            return _FUNCTIONS[node.func.id](*(_value(part, values) for part in node.args))  # type: ignore[attr-defined]  # a name, as checked
        case ast.BinOp():
            return _ARITHMETIC[type(node.op)](_value(node.left, values), _value(node.right, values))
        case ast.UnaryOp():
            inner = _value(node.operand, values)
            return ~inner if isinstance(node.op, ast.Not) else _ARITHMETIC[type(node.op)](inner)
        case ast.BoolOp():
            join = np.logical_and if isinstance(node.op, ast.And) else np.logical_or
            return join.reduce([np.asarray(_value(part, values)) for part in node.values])
        case ast.Compare():
            sides = [_value(part, values) for part in (node.left, *node.comparators)]
            pairs = zip(node.ops, sides, sides[1:], strict=False)
            return np.logical_and.reduce([np.asarray(_COMPARED[type(op)](a, b)) for op, a, b in pairs])
    raise TypeError(ast.dump(node))
