"""Requirements: evaluation of conditions, and refusal of anything but an expression of merits."""

import numpy as np
import pytest

from solen.errors import SpecError
from solen.explore.merits import NAMES
from solen.explore.requirement import Goal, Limit, Requirement

MERITS = {name: np.array([1.0, 2.0, np.nan]) for name in NAMES} | {"null_deg": np.array([-0.2, 0.5, 0.1])}
BASE = dict.fromkeys(NAMES, 1.5)


@pytest.mark.parametrize(
    ("text", "met"),
    [
        ("abs(null_deg) < 0.3", [True, False, True]),
        ("light >= 0.9 * base", [False, True, False]),
        ("abs(span / base_span - 1) < 0.34", [True, True, False]),
        ("null_deg > -1 and not span > 1.5", [True, False, False]),
        ("-0.3 < null_deg <= 0.5", [True, True, True]),
        ("min(span, light) ** 2 > 3 or null_deg < 0", [True, True, False]),
        ("span > 0", [True, True, False]),
        ("null_deg < 1/0", [True, True, True]),
        ("null_deg * (1 / (base - 1.5)) < 1", [True, False, False]),
        ("span > 1.5 and 1 < base_span < 2", [False, True, False]),
    ],
)
def test_requirement_is_met_if_condition_holds_and_merits_exist(text: str, met: list[bool]) -> None:
    assert Requirement.parse(text).met(MERITS, BASE).tolist() == met


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("__import__('os')", "condition"),
        ("null_deg.real < 1", "null_deg.real"),
        ("(lambda: 1)() < span", "functions"),
        ("[1][0] < span", "[1][0]"),
        ("'a' < span", "'a'"),
        ("True < span", "True"),
        ("eval('1') < span", "functions"),
        ("abs(span, light) < 1", "abs"),
        ("nul_deg < 1", "null_deg"),
        ("span", "condition"),
        ("1 < 2", "merit"),
        ("span < light * base", "base_span"),
        ("span <", "expression"),
        ("span == 1", "span == 1"),
        ("abs(" * 40 + "span" + ")" * 40 + " < 1", "parentheses"),
        ("span < " + "1+" * 300 + "1", "500"),
        ("", "expression"),
        ("(not null_deg) < 0.3", "condition"),
        ("-(null_deg < 3) < 1", "values"),
        ("not null_deg or span > 1", "condition"),
        ("null_deg < 10**400 and span < 1e400", "large"),
        ("worst(light) > 0.1", "--robust"),
    ],
)
def test_refuses_other_expressions(text: str, reason: str) -> None:
    with pytest.raises(SpecError, match=r"--require") as error:
        Requirement.parse(text)
    assert reason in str(error.value)


CASES = {name: np.array([1.0, 3.0, 2.0]) for name in NAMES} | {"null_deg": np.array([0.1, -0.4, 0.2])}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("worst(linearity_percent)", 3.0),
        ("worst(null_deg)", -0.4),
        ("worst(light)", 1.0),
        ("linearity_percent + worst(linearity_percent)", 4.0),
    ],
)
def test_worst_is_over_cases_and_other_merits_are_nominal(text: str, value: float) -> None:
    assert Goal.parse(text).value(CASES, BASE).max() == value


def test_limit_on_worst_value() -> None:
    assert Limit.parse("span >= 1 and worst(linearity_percent) < 3.5").met(CASES, BASE).all()
    assert not Limit.parse("worst(linearity_percent) < 2.5").met(CASES, BASE).any()
    with pytest.raises(SpecError, match="one merit"):
        Limit.parse("worst(span + light) > 1")
