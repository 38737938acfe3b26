"""What the paper states, and the rule by which a number of solen agrees with it."""

import math
import re

import pytest

from solen.paper.sensor_numbers import ratio
from solen.paper.statements import NEGLIGIBLE_PERCENT, SURE, Statement, compared, stated, statements
from solen.pipeline.project.paper import FIGURES

ROW = {"key": "k", "figure": "3A", "panel": "A", "place": "p", "words": "w", "quantity": "q", "unit": "", "why": "y"}


def test_a_value_agrees_within_two_combined_uncertainties() -> None:
    one = Statement(**ROW, kind="value", value=1.44, resolution=0.01)
    own = 0.01 / math.sqrt(12.0)
    sure = SURE * math.hypot(own, 0.02)
    assert one.verdict(1.44 + 0.999 * sure, 0.02) == "agrees"
    assert one.verdict(1.44 - 0.999 * sure, 0.02) == "agrees"
    assert one.verdict(1.44 + 1.001 * sure, 0.02) == "differs"
    assert one.verdict(1.44 - 1.001 * sure, 0.02) == "differs"


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
def test_other_statements_by_the_same_rule(kind: str, number: float | None, u: float, verdict: str) -> None:
    assert Statement(**ROW, kind=kind, value=5.0).verdict(number, u) == verdict


def test_every_statement_is_of_a_figure_that_is_made() -> None:
    names = {one.name for one in FIGURES}
    assert {one.figure for one in statements().values()} == names


def test_each_number_of_the_table_stands_in_the_words_beside_it() -> None:
    words = {"three": "3", "five": "5", "six": "6", "eight": "8", "twelve": "12", "fifteen": "15"}
    for one in statements().values():
        text = " ".join(words.get(word, word) for word in re.split(r"[ ,()]+", one.words))
        assert not one.value or f"{one.value:g}" in text or f"{one.value:.2f}" in text, one.key


def test_a_reason_holds_numbers_of_the_run_alone() -> None:
    row = compared("cure-depth", 206.1, 1.7, Dp=99.0, Ec=5.2)
    assert "Dp = 99 µm" in row.why
    assert row.verdict == "cannot be checked"
    assert (row.paper_value, row.solen_value, row.u_solen_value) == (stated("cure-depth"), 206.1, 1.7)
    for one in statements().values():
        typed = re.findall(r"(?<![\d.°])\d+\.\d+", re.sub(r"\{[^}]*\}", "", one.why))
        assert set(typed) <= {"0.02"}, one.key


def test_a_ratio_of_nothing_is_as_uncertain_as_its_part() -> None:
    assert ratio((0.0, 0.02), (0.5, 0.1)) == pytest.approx((0.0, 0.04))
    assert ratio((0.1, 0.02), (0.5, 0.1)) == pytest.approx((0.2, 0.2 * math.hypot(0.2, 0.2)))
