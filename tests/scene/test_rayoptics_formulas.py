"""Formulas of ray-optics scenes: values compared with Python's, and errors that report the position."""

import math

import pytest

from solen.errors import DataError
from solen.scene.rayoptics.formula import FUNCTIONS, parse
from solen.scene.rayoptics.modules import Scope, expanded

X = 0.37


@pytest.mark.parametrize(
    ("text", "value"),
    [
        (r"0.5\cdot\sqrt{1-x^2}", 0.5 * math.sqrt(1 - X**2)),
        (r"-\sqrt{1-x^2}", -math.sqrt(1 - X**2)),
        (r"x-\operatorname{floor}\left(x\right)", X),
        (r"50\cdot\cos\left(x\right)", 50 * math.cos(X)),
        (r"\frac{1}{2}x", X / 2),
        (r"\frac{x+1}{x-1}", (X + 1) / (X - 1)),
        (r"\sqrt[3]{x}", X ** (1 / 3)),
        (r"\left|x-2\right|", 2 - X),
        ("|x-2|", 2 - X),
        (r"e^{-x}\cdot\pi", math.exp(-X) * math.pi),
        (r"\sin^2 x + \cos^{2} x", 1.0),
        ("sin^2(x)+cos^2(x)", 1.0),
        (r"\arctan\left(x\right)", math.atan(X)),
        ("atan2(x, -2)", math.atan2(X, -2.0)),
        ("(1-x)^3*2+3*(1-x)^2*x", (1 - X) ** 3 * 2 + 3 * (1 - X) ** 2 * X),
        ("2x^2 - 3 x + 1", 2 * X**2 - 3 * X + 1),
        ("2(x+1)(x-1)", 2 * (X + 1) * (X - 1)),
        ("1/2x", X / 2),
        ("-x^2", -(X**2)),
        ("2^-1", 0.5),
        ("2^3^2", 512.0),
        ("1 - 2 - 3", -4.0),
        ("1.5e-2 + .5", 0.515),
        ("xx", X * X),
        ("max(x, 0.1, 2) - min(x, 0.1, 2)", 1.9),
        ("round(2.5) + ceil(x) + trunc(-1.7) + sign(-x)", 3 + 1 - 1 - 1),
        ("ln(x) - log(x)", 0.0),
        ("x < 1 and not (x == 2)", 1.0),
        ("x >= 1 or x != x", 0.0),
    ],
)
def test_values(text: str, value: float) -> None:
    assert parse(text, ["x"])(x=X) == pytest.approx(value, rel=1e-15, abs=1e-15)


def test_every_function_has_finite_value() -> None:
    for name in FUNCTIONS:
        argument = 1.5 if name in ("acosh", "sec") else 0.5
        arguments = "x, x" if name in ("max", "min", "atan2") else "x"
        assert math.isfinite(parse(f"{name}({arguments})", ["x"])(x=argument)), name


@pytest.mark.parametrize("text", [r"\sqrt{x}", "log(x)", "x^0.5", "1/(x+1)", "asin(2x)", "exp(1000)^2", "x^2^2^-x/0"])
def test_undefined_value_is_nan(text: str) -> None:
    assert math.isnan(parse(text, ["x"])(x=-1.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x.__class__", "at character 2"),
        ("__import__('os')", "at character 1"),
        ("import os", "'import'; is unknown"),
        ("open(x)", "'open'; is unknown"),
        ("lambda: x", "at character 7"),
        ("y+1", "the known names are x"),
        ("(x", "its end'; must be )"),
        ("x)", "is not allowed here"),
        ("sin()", "must be a number, a name or a bracket"),
        ("sin(x, x)", "sin takes one argument, not 2"),
        ("atan2(x)", "atan2 takes two arguments, not 1"),
        ("max(x)", "max takes two arguments or more, not 1"),
        ("x+", "must be a number"),
        ("", "must be a number"),
        (r"\frac{1}", "must be {"),
        (r"\left(x\right]", "must be )"),
        ("(" * 100 + "x", "more than 60 brackets"),
        ("x+" * 10_000 + "x", "too long"),
        ("x=1", "at character 2"),
        ("x;x", "at character 2"),
    ],
)
def test_errors_report_position(text: str, message: str) -> None:
    with pytest.raises(DataError, match="formula") as bad:
        parse(text, ["x"])(x=1.0)
    assert message in str(bad.value)
    assert "\n" not in str(bad.value)


def test_expands_loops_and_conditions_of_modules() -> None:
    module = {
        "params": ["n=1:1:9:3", "size=0:1:10:2"],
        "vars": ["half = size/2", "square(t) = t^2 * half"],
        "objs": [
            {"for": "i=1:1:n", "if": "i != 2", "type": "A", "x": "`x_1 + square(i)`", "label": "no. `i`!"},
            {"for": ["i=0:1:1", "j=0:1:1"], "type": "B", "nested": {"v": ["`10 i + j`"]}},
        ],
    }
    objects = expanded(module, [{"x": 100, "y": 0}], {"size": 4})
    assert objects[:2] == [{"type": "A", "x": 102.0, "label": "no. 1!"}, {"type": "A", "x": 118.0, "label": "no. 3!"}]
    assert [item["nested"]["v"][0] for item in objects[2:]] == [0.0, 1.0, 10.0, 11.0]


def test_formula_in_double_backticks_uses_values_of_module() -> None:
    module = {"vars": ["f(t) = t^3 * x_1"], "objs": [{"type": "A", "eqn": "``f(x) + x_1``"}]}
    (item,) = expanded(module, [{"x": 2, "y": 0}], {})
    assert item["eqn"].in_variable("x").compiled()(3.0) == 56.0


@pytest.mark.parametrize(
    ("module", "message"),
    [
        ({"objs": [{"for": "i=1:1:5000", "type": "A"}]}, "must end within 1000 iterations"),
        ({"objs": [{"for": ["i=1:1:500", "j=1:1:500"], "type": "A"}]}, "250000 iterations"),
        ({"objs": [{"for": "i=1:0:5", "type": "A"}]}, "must end within"),
        ({"objs": [{"for": "i=1:5", "type": "A"}]}, "name=start:step:end"),
        ({"objs": [{"type": "A", "x": "`random()`"}]}, "'random'; is unknown"),
        ({"objs": [{"type": "A", "x": "`1/0`"}]}, "must have a finite value"),
        ({"objs": [{"type": "A", "x": "``x`` and text"}]}, "backtick"),
        ({"vars": ["no definition"], "objs": []}, "must be name = formula"),
        ({"maxLoopLength": 10**9, "objs": []}, "maxLoopLength"),
    ],
)
def test_refuses_invalid_module_in_one_line(module: dict[str, object], message: str) -> None:
    with pytest.raises(DataError) as bad:
        expanded(module, [], {})
    assert message in str(bad.value)


def test_adding_values_does_not_change_scope() -> None:
    scope = Scope({"a": 1.0})
    assert scope.with_values({"a": 2.0}).number("a") == 2.0
    assert scope.number("a") == 1.0
