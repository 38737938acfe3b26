"""Requirements: what they mean, and that nothing but an expression of merits passes."""

import numpy as np
import pytest

from solen.errors import SpecError
from solen.explore.merits import NAMES
from solen.explore.requirement import Requirement

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
    ],
)
def test_a_requirement_is_met_where_it_holds_and_its_merits_exist(text: str, met: list[bool]) -> None:
    assert Requirement.parse(text).met(MERITS, BASE).tolist() == met


@pytest.mark.parametrize(
    ("text", "named"),
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
        ("abs(" * 40 + "span" + ")" * 40 + " < 1", "brackets"),
        ("span < " + "1+" * 300 + "1", "500"),
        ("", "expression"),
        ("(not null_deg) < 0.3", "condition"),
        ("-(null_deg < 3) < 1", "values"),
        ("not null_deg or span > 1", "condition"),
        ("null_deg < 10**400 and span < 1e400", "large"),
    ],
)
def test_anything_else_is_refused_by_name(text: str, named: str) -> None:
    with pytest.raises(SpecError, match=r"--require") as refused:
        Requirement.parse(text)
    assert named in str(refused.value)
