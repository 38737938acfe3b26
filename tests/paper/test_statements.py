"""Statements in the paper, and the rule by which a computed value agrees with one."""

import math
import re

import pytest

from solen.paper.sensor_numbers import ratio
from solen.paper.statements import COVERAGE_FACTOR, NEGLIGIBLE_PERCENT, Statement, compared, paper_value, statements
from solen.pipeline.project.paper import FIGURES

ROW = {"key": "k", "figure": "3A", "panel": "A", "place": "p", "words": "w", "quantity": "q", "unit": "", "why": "y"}


def test_value_agrees_within_two_combined_uncertainties() -> None:
    statement = Statement(**ROW, kind="value", value=1.44, resolution=0.01)
    u_value = 0.01 / math.sqrt(12.0)
    tolerance = COVERAGE_FACTOR * math.hypot(u_value, 0.02)
    assert statement.verdict(1.44 + 0.999 * tolerance, 0.02) == "agrees"
    assert statement.verdict(1.44 - 0.999 * tolerance, 0.02) == "agrees"
    assert statement.verdict(1.44 + 1.001 * tolerance, 0.02) == "differs"
    assert statement.verdict(1.44 - 1.001 * tolerance, 0.02) == "differs"


@pytest.mark.parametrize(
    ("kind", "number", "u", "verdict"),
    [
        ("above", 10.0, 0.0, "agrees"),
        ("above", 4.9, 0.1, "agrees"),
        ("above", 4.7, 0.1, "differs"),
        ("positive", 0.3, 0.1, "agrees"),
        ("positive", -0.3, 0.1, "differs"),
        ("positive", 0.1, 0.1, "cannot be checked"),
        ("negative", -0.3, 0.1, "agrees"),
        ("negative", 0.3, 0.1, "differs"),
        ("negligible", NEGLIGIBLE_PERCENT + 0.1, 0.1, "agrees"),
        ("negligible", -NEGLIGIBLE_PERCENT - 0.3, 0.1, "differs"),
        ("measured", 5.0, 0.1, "cannot be checked"),
        ("value", None, 0.0, "cannot be checked"),
        ("value", math.nan, 0.0, "cannot be checked"),
    ],
)
def test_verdicts_of_other_kinds_of_statement(kind: str, number: float | None, u: float, verdict: str) -> None:
    assert Statement(**ROW, kind=kind, value=5.0).verdict(number, u) == verdict


def test_statements_cover_all_figures() -> None:
    names = {statement.name for statement in FIGURES}
    assert {statement.figure for statement in statements().values()} == names


def test_value_of_statement_appears_in_its_words() -> None:
    words = {"three": "3", "five": "5", "six": "6", "eight": "8", "twelve": "12", "fifteen": "15"}
    for statement in statements().values():
        text = " ".join(words.get(word, word) for word in re.split(r"[ ,()]+", statement.words))
        assert not statement.value or f"{statement.value:g}" in text or f"{statement.value:.2f}" in text, statement.key


def test_decimals_in_reasons_come_from_run() -> None:
    row = compared("cure-depth", 206.1, 1.7, Dp=99.0, Ec=5.2)
    assert "Dp = 99 µm" in row.why
    assert row.verdict == "cannot be checked"
    assert (row.paper_value, row.solen_value, row.u_solen_value) == (paper_value("cure-depth"), 206.1, 1.7)
    for statement in statements().values():
        decimals = re.findall(r"(?<![\d.°])\d+\.\d+", re.sub(r"\{[^}]*\}", "", statement.why))
        assert set(decimals) <= {"0.02"}, statement.key


def test_uncertainty_of_ratio() -> None:
    assert ratio((0.0, 0.02), (0.5, 0.1)) == pytest.approx((0.0, 0.04))
    assert ratio((0.1, 0.02), (0.5, 0.1)) == pytest.approx((0.2, 0.2 * math.hypot(0.2, 0.2)))
