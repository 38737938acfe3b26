"""Expressions such as ``abs(null_deg) < 0.3``, which are parsed and never executed.

Allowed are names, numbers, + - * / ** and parentheses, abs, min and max, comparisons, ``and``, ``or`` and ``not``. A
`Grammar` defines the names. It may also define functions whose argument is a name, such as ``worst(light)``, whose
value is looked up under the name ``worst light``.

`parsed` parses a string, and `names` lists its names; `value` evaluates it, `derivatives` differentiates it with
respect to its names, and `violation` measures by how much a condition is not met.
"""

import ast
import operator
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from solen.arrays import FloatArray

MAX_LENGTH, MAX_DEPTH, MAX_NUMBER = 500, 20, 1e100
_ARITHMETIC: Mapping[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_COMPARISONS: Mapping[type, Callable[..., Any]] = {
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
class Grammar:
    """Names and functions that an expression may contain.

    Attributes
    ----------
    noun
        Kind of quantity that a name refers to, in one word.
    is_condition
        Whether the expression is a condition; otherwise it is a value.
    refusal
        Function that returns an error from a limit and a remedy, which may be empty.
    check
        Function that raises an error for an unknown name.
    name_functions
        Functions whose argument is a single name.
    """

    noun: str
    is_condition: bool
    refusal: Callable[[str, str], Exception]
    check: Callable[[str], object]
    name_functions: Collection[str] = ()


def parsed(text: str, grammar: Grammar) -> ast.expr:
    """Return the syntax tree of a string; its names and operations are not yet checked."""
    if len(text) > MAX_LENGTH:
        raise grammar.refusal(f"is longer than {MAX_LENGTH} characters", "")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise grammar.refusal("is not a valid expression", "") from None
    if grammar.is_condition and not _is_condition(tree):
        raise grammar.refusal("must be a condition", "compare two sides with <, <=, > or >=")
    if not grammar.is_condition and any(isinstance(node, ast.Compare | ast.BoolOp) for node in ast.walk(tree)):
        raise grammar.refusal("must be a value, not a condition", "")
    return tree


def names(node: ast.AST, grammar: Grammar, depth: int = 0) -> list[str]:
    """Return the names in a tree; raise the grammar's error for anything that an expression may not contain."""
    if depth > MAX_DEPTH:
        raise grammar.refusal("has too many nested parentheses", "")
    if isinstance(node, ast.Name):
        grammar.check(node.id)
        return [node.id]
    if isinstance(node, ast.Constant):
        return _no_names(node, grammar)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in grammar.name_functions:
        return [_name_function(node, node.func.id, grammar)]
    parts: list[ast.AST]
    if isinstance(node, ast.Call):
        parts = _arguments(node, grammar)
    elif isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        parts = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub | ast.Not):
        parts = [node.operand]
    elif isinstance(node, ast.Compare) and all(type(op) in _COMPARISONS for op in node.ops):
        parts = [node.left, *node.comparators]
    elif isinstance(node, ast.BoolOp):
        parts = list(node.values)
    else:
        raise grammar.refusal(f"{ast.unparse(node)} is not allowed in an expression of {grammar.noun}s", "")
    takes_conditions = isinstance(node, ast.BoolOp) or (isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not))
    if any(isinstance(part, ast.expr) and _is_condition(part) is not takes_conditions for part in parts):
        raise grammar.refusal(f"{ast.unparse(node)} takes {'conditions' if takes_conditions else 'values'}", "")
    return [name for part in parts for name in names(part, grammar, depth + 1)]


def value(node: ast.expr, values: Mapping[str, Any]) -> Any:
    """Return the value of a checked tree."""
    match node:
        case ast.Name():
            return values[node.id]
        case ast.Constant():
            return np.float64(node.value)  # type: ignore[arg-type]  # only numbers pass the check
        case ast.Call(func=ast.Name(id=function), args=args) if function in _FUNCTIONS:
            return _FUNCTIONS[function](*(value(part, values) for part in args))
        case ast.Call(func=ast.Name(id=function), args=[ast.Name(id=name)]):
            return values[f"{function} {name}"]
        case ast.BinOp():
            return _ARITHMETIC[type(node.op)](value(node.left, values), value(node.right, values))
        case ast.UnaryOp():
            inner = value(node.operand, values)
            return ~inner if isinstance(node.op, ast.Not) else _ARITHMETIC[type(node.op)](inner)
        case ast.BoolOp():
            join = np.logical_and if isinstance(node.op, ast.And) else np.logical_or
            return join.reduce(np.broadcast_arrays(*(value(part, values) for part in node.values)))
        case ast.Compare():
            sides = [value(part, values) for part in (node.left, *node.comparators)]
            pairs = zip(node.ops, sides, sides[1:], strict=False)
            return np.logical_and.reduce(np.broadcast_arrays(*(_COMPARISONS[type(op)](a, b) for op, a, b in pairs)))
    raise TypeError(ast.dump(node))


def derivatives(node: ast.expr, values: Mapping[str, FloatArray]) -> dict[str, Any]:
    """Return the exact derivatives of a checked tree of values with respect to each name in it.

    For abs, min and max they are the derivatives of the selected branch.
    """
    match node:
        case ast.Name():
            return {node.id: np.float64(1.0)}
        case ast.UnaryOp():
            sign = -1.0 if isinstance(node.op, ast.USub) else 1.0
            return _sum((sign, derivatives(node.operand, values)))
        case ast.BinOp():
            by_left, by_right = _by_sides(node.op, value(node.left, values), value(node.right, values))
            return _sum((by_left, derivatives(node.left, values)), (by_right, derivatives(node.right, values)))
        case ast.Call(func=ast.Name(id="abs"), args=[part]):
            return _sum((np.where(value(part, values) < 0.0, -1.0, 1.0), derivatives(part, values)))
        case ast.Call():
            result = value(node, values)
            selected = np.array(
                np.broadcast_arrays(*(value(part, values) == result for part in node.args)), dtype=float
            )
            weights = selected / np.maximum(selected.sum(axis=0), 1.0)
            return _sum(*((weight, derivatives(part, values)) for weight, part in zip(weights, node.args, strict=True)))
    return {}


def violation(node: ast.expr, values: Mapping[str, Any]) -> Any:
    """Return the violation of a condition: the difference of its sides relative to their size; 0 if it is met."""
    if isinstance(node, ast.BoolOp):
        parts = np.broadcast_arrays(*(violation(part, values) for part in node.values))
        return np.sum(parts, axis=0) if isinstance(node.op, ast.And) else np.min(parts, axis=0)
    if not isinstance(node, ast.Compare):
        return np.ones(())  # unknown for a negation
    sides = [np.asarray(value(part, values)) for part in (node.left, *node.comparators)]
    pairs = zip(node.ops, sides, sides[1:], strict=False)
    excesses = [b - a if isinstance(op, ast.Gt | ast.GtE) else a - b for op, a, b in pairs]
    size = max(float(np.nan_to_num(np.abs(side)).max()) for side in sides) or 1.0
    return np.sum([np.maximum(excess, 0.0) / size for excess in excesses], axis=0)


def _is_condition(node: ast.expr) -> bool:
    if isinstance(node, ast.BoolOp):
        return all(map(_is_condition, node.values))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return _is_condition(node.operand)
    return isinstance(node, ast.Compare)


def _name_function(node: ast.Call, function: str, grammar: Grammar) -> str:
    """Return the name under which a function such as ``worst(light)`` is looked up: ``worst light``."""
    if not (len(node.args) == 1 and not node.keywords and isinstance(node.args[0], ast.Name)):
        raise grammar.refusal(f"{function} requires one {grammar.noun}", "")
    name = f"{function} {node.args[0].id}"
    grammar.check(name)
    return name


def _arguments(node: ast.Call, grammar: Grammar) -> list[ast.AST]:
    """Return the arguments of a function call that an expression may contain."""
    if not (isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS and node.args and not node.keywords):
        functions = ", ".join((*_FUNCTIONS, *grammar.name_functions))
        raise grammar.refusal(f"{ast.unparse(node)} is not allowed; the functions are {functions}", "")
    if node.func.id == "abs" and len(node.args) > 1:
        raise grammar.refusal("abs requires one value", "")
    return list(node.args)


def _no_names(node: ast.Constant, grammar: Grammar) -> list[str]:
    """Return no names for a constant; raise an error if it is not a number or is too large."""
    if isinstance(node.value, bool) or not isinstance(node.value, int | float):
        raise grammar.refusal(f"{ast.unparse(node)} is not allowed in an expression of {grammar.noun}s", "")
    if not abs(node.value) < MAX_NUMBER:
        raise grammar.refusal("contains a number that is too large", "")
    return []


def _by_sides(op: ast.operator, a: Any, b: Any) -> tuple[Any, Any]:
    """Return the derivatives of an operation with respect to its two operands."""
    match op:
        case ast.Mult():
            return b, a
        case ast.Div():
            return 1.0 / b, -a / b**2
        case ast.Pow():
            return b * a ** (b - 1.0), a**b * np.log(a)
    return 1.0, -1.0 if isinstance(op, ast.Sub) else 1.0


def _sum(*parts: tuple[Any, dict[str, Any]]) -> dict[str, Any]:
    """Return the sum of derivatives, each multiplied by the derivative of the outer function (chain rule)."""
    total: dict[str, Any] = {}
    for factor, inner in parts:
        for name, derivative in inner.items():
            total[name] = total.get(name, 0.0) + factor * derivative
    return total
