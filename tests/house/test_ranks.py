"""Warnings for a reader: ranked, and one sentence once."""

from solen.errors import SolenError
from solen.ranks import do_not_use, note, ranked


def test_the_most_serious_come_first() -> None:
    found = ranked([note("three"), "two", do_not_use("one"), f"cube: {do_not_use('zero')}"])
    assert found == ["do not use: one", "do not use: cube: zero", "warning: two", "note: three"]


def test_one_sentence_of_several_things_is_one_line_with_their_count() -> None:
    texts = [f"{name}.csv: its length is not stated" for name in "abcdef"]
    assert ranked(texts) == ["warning: 6 times (a.csv, b.csv, c.csv, d.csv and 2 more): its length is not stated"]


def test_sentences_that_differ_in_numbers_are_one() -> None:
    texts = ["soft: a.csv: off by 1.5e+03 µm", "alone", "soft: b.csv: off by 12 µm", "hard: c.csv: off by −3 µm"]
    first, second = ranked(texts)
    assert first.startswith("warning: 3 times (")
    assert all(name in first for name in ("a.csv", "b.csv", "c.csv", "off by 1.5e+03 µm", "numbers of soft: a.csv"))
    assert second == "warning: alone"


def test_sentences_of_different_rank_or_words_stay_apart() -> None:
    texts = ["a: too thin", "a: too thick", note("b: too thin")]
    assert ranked(texts) == ["warning: a: too thin", "warning: a: too thick", "note: b: too thin"]


def test_nothing_is_lost() -> None:
    texts = [f"{name}: {what} {n}" for name in ("a", "b") for what in ("long", "short") for n in range(5)]
    lines = ranked(texts)
    assert len(lines) == 2
    assert all("10 times" in line for line in lines)


def test_the_same_text_twice_is_one() -> None:
    assert ranked(["x", "x"]) == ["warning: x"]


def test_values_in_refusals_are_rounded() -> None:
    assert "0.3;" in str(SolenError("x", value=0.1 + 0.2, limit="must be less"))
    assert "'123456789012…'" in str(SolenError("x", value="1234567890123456789012345678901234567890"))
    assert len(str(SolenError("x", value="a" * 5000))) < 250
