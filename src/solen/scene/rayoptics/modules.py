"""Modules: objects defined once with formulas in backticks, and expanded for each use, in loops and under conditions.

A module has points, which its formulas call x_1, y_1, x_2 and so on; parameters; and its own variables and functions. A
string that consists of one formula in single backticks is replaced by the value of the formula; in double backticks, it
remains a formula, in which the names have their values in the module. Nothing is executed: all formulas are parsed by
`solen.scene.rayoptics.formula`.
"""

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from solen.errors import DataError
from solen.scene.rayoptics.formula import Function, Values, number_in, parse

MAX_ITERATIONS = 1000
"""Default limit on the number of iterations of a loop; a module may set a limit up to a hundred times higher."""
MAX_NUMBER = 1e300
FUNCTION = re.compile(r"^\s*(\w+)\s*\(\s*([^)]*?)\s*\)\s*=(?!=)\s*(.+)$", re.DOTALL)
VARIABLE = re.compile(r"^\s*(\w+)\s*=(?!=)\s*(.+)$", re.DOTALL)


@dataclass(frozen=True)
class Scope:
    """Values and functions, keyed by name."""

    values: Values = field(default_factory=dict)
    functions: Mapping[str, Function] = field(default_factory=dict)

    def number(self, text: str) -> float:
        """Return the value of a formula; raise `DataError` if it is undefined."""
        value = parse(text, tuple(self.values), self.functions)(**self.values)
        if value != value:
            raise DataError(f"formula {text!r}", value=value, limit="must have a finite value")
        return value

    def with_values(self, values: Values) -> "Scope":
        """Return a scope with further values, which override existing values of the same name."""
        return replace(self, values={**self.values, **values})

    def with_definition(self, text: str) -> "Scope":
        """Return a scope with one more definition: a variable, or a function of variables."""
        if function := FUNCTION.match(text):
            name, names, body = function.groups()
            variables = tuple(variable.strip() for variable in names.split(","))
            formula = parse(body, (*self.values, *variables), self.functions)
            values = dict(self.values)

            def call(*arguments: float) -> float:
                return formula(**values, **dict(zip(variables, arguments, strict=True)))

            return replace(self, functions={**self.functions, name: call})
        if variable := VARIABLE.match(text):
            return self.with_values({variable[1]: self.number(variable[2])})
        raise DataError(f"definition {text!r}", limit="must be name = formula or name(x) = formula")


@dataclass(frozen=True)
class Expression:
    """A formula in some variables, with the definitions of all other names that it contains."""

    text: str
    variables: tuple[str, ...]
    scope: Scope = field(default_factory=Scope)

    def in_variable(self, variable: str) -> "Expression":
        """Return the expression as a formula in one variable."""
        return replace(self, variables=(variable,))

    def compiled(self) -> Function:
        """Return the expression as a function of its variables in order; raise `DataError` if it is not a formula."""
        formula = parse(self.text, (*self.scope.values, *self.variables), self.scope.functions)
        values, names = dict(self.scope.values), self.variables

        def call(*arguments: float) -> float:
            return formula.node({**values, **dict(zip(names, arguments, strict=True))})

        return call


def expanded(definition: Mapping[str, Any], points: Any, parameters: Any) -> list[dict[str, Any]]:
    """Return the objects that one use of a module expands to.

    Raises
    ------
    DataError
        If a formula is invalid or undefined, or a loop is too long.
    """
    if not isinstance(parameters, dict):
        raise DataError("params", limit="must be an object of numbers")
    scope = _scope(definition, _items("points", points), parameters)
    limit = definition.get("maxLoopLength", MAX_ITERATIONS)
    if not isinstance(limit, int) or not 1 <= limit <= 100 * MAX_ITERATIONS:
        raise DataError("maxLoopLength", value=limit, limit=f"must be an integer from 1 to {100 * MAX_ITERATIONS}")
    objects = _items("objs", definition.get("objs", []))
    return [item for item in _expanded_list(objects, scope, limit) if isinstance(item, dict)]


def _items(what: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise DataError(what, limit="must be a list")
    return value


def _scope(definition: Mapping[str, Any], points: list[Any], parameters: Mapping[str, Any]) -> Scope:
    values: dict[str, float] = {}
    for text in _items("params", definition.get("params", [])):
        name, _, _, _, default = _range(text, Scope(values))
        values[name] = default
    values |= {name: _number(f"params.{name}", value) for name, value in parameters.items()}
    for i, point in enumerate(points, 1):
        if not isinstance(point, dict):
            raise DataError(f"points[{i - 1}]", limit="must be a point")
        values |= {f"{axis}_{i}": _number(f"points[{i - 1}].{axis}", point.get(axis)) for axis in ("x", "y")}
    scope = Scope(values)
    for text in _items("vars", definition.get("vars", [])):
        scope = scope.with_definition(str(text))
    return scope


def _number(what: str, value: Any) -> float:
    number = number_in(value)
    if number is None:
        raise DataError(what, value=value, limit="must be a number")
    if not abs(number) < MAX_NUMBER:
        raise DataError(what, limit=f"must have an absolute value below {MAX_NUMBER:g}")
    return number


def _range(text: Any, scope: Scope) -> tuple[str, float, float, float, float]:
    """Return the name, start, step, end and default of ``name=start:step:end`` or ``name=start:step:end:default``."""
    name, equals, rest = str(text).partition("=")
    parts = rest.split(":")
    if not equals or len(parts) not in (3, 4):
        raise DataError(f"range {text!r}", limit="must be name=start:step:end or name=start:step:end:default")
    start, step, end = (scope.number(part) for part in parts[:3])
    return name.strip(), start, step, end, scope.number(parts[3]) if len(parts) == 4 else start


def _expanded_list(items: list[Any], scope: Scope, limit: int) -> list[Any]:
    expanded_items: list[Any] = []
    for item in items:
        if not isinstance(item, dict):
            expanded_items.append(_expanded(item, scope, limit))
            continue
        template = {key: value for key, value in item.items() if key not in ("for", "if")}
        iterations = _iterations(item.get("for", []), scope, limit)
        included = (inner for inner in iterations if "if" not in item or inner.number(str(item["if"])))
        expanded_items += [_expanded(template, inner, limit) for inner in included]
    return expanded_items


def _iterations(loops: Any, scope: Scope, limit: int) -> Iterator[Scope]:
    """Yield the scope for each combination of loop values."""
    ranges = [_range(text, scope) for text in ([loops] if isinstance(loops, str) else _items("for", loops))]
    series = [_series(start, step, end, limit, name) for name, start, step, end, _ in ranges]
    total = 1
    for values in series:
        total *= len(values)
    if total > limit:
        raise DataError("for", value=f"{total} iterations", limit=f"must be at most {limit} (maxLoopLength)")
    for combination in itertools.product(*series):
        yield scope.with_values(dict(zip((loop[0] for loop in ranges), combination, strict=True)))


def _series(start: float, step: float, end: float, limit: int, name: str) -> list[float]:
    """Return the values from the start up to the end; each is the previous value plus the step."""
    if step == 0.0 or (end - start) * step < 0.0 or (end - start) / step + 1.0 > limit:
        raise DataError(f"for {name}", value=f"{start:g}:{step:g}:{end:g}", limit=f"must end within {limit} iterations")
    values, value = [], start
    while value <= end:  # as in ray-optics: a descending range yields at most its start
        values.append(value)
        value += step
    return values


def _expanded(value: Any, scope: Scope, limit: int) -> Any:
    if isinstance(value, str):
        return _expanded_string(value, scope)
    if isinstance(value, list):
        return _expanded_list(value, scope, limit)
    if isinstance(value, dict):
        return {key: _expanded(item, scope, limit) for key, item in value.items()}
    return value


def _expanded_string(text: str, scope: Scope) -> Any:
    """Expand a string: to a number or a formula if it consists of one, otherwise with the values of its formulas."""
    if text.startswith("``") and text.endswith("``") and len(text) > 4 and "`" not in text[2:-2]:
        return Expression(text[2:-2], (), scope)
    parts = text.split("`")
    if len(parts) == 3 and not parts[0] and not parts[2]:
        return scope.number(parts[1])
    if "" in parts[1:-1:2] or len(parts) % 2 == 0:
        limit = "must consist of one formula in double backticks, or enclose each formula in single backticks"
        raise DataError(f"string {text!r}", limit=limit)
    return "".join(f"{scope.number(part):.17g}" if i % 2 else part for i, part in enumerate(parts))
