"""Warnings for a reader: ranked, and one sentence once."""

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

import solen
from solen.errors import SolenError
from solen.ranks import do_not_use, note, ranked

RANKED = ("analysis", "bench", "fabricate", "material", "metrology", "recording")
"""Folders whose sentences the type checker takes only with a rank, as they are `Caution` and not text."""
FROM_FILES = {"recording/model.py", "recording/spectrum.py", "material/resin.py"}
"""Where a sentence comes with its rank from a file or a channel."""


def nodes() -> Iterator[tuple[str, ast.AST]]:
    root = Path(inspect.getfile(solen)).parent
    for path in (file for folder in RANKED for file in (root / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            yield path.relative_to(root).as_posix(), node


def test_every_warning_of_a_measurement_or_a_print_states_a_rank() -> None:
    """Fields and functions called warnings hold `Caution`, and nobody makes one but by the words for a rank."""
    kinds = [
        (file, ast.unparse(kind))
        for file, node in nodes()
        if isinstance(node, ast.AnnAssign | ast.FunctionDef)
        and (node.name if isinstance(node, ast.FunctionDef) else ast.unparse(node.target)) in {"warnings", "_warnings"}
        and (kind := node.returns if isinstance(node, ast.FunctionDef) else node.annotation) is not None
    ]
    assert len(kinds) > 30
    written = {"material/resin.py", "material/dispersion.py", "material/result_files.py"}
    assert not [(file, kind) for file, kind in kinds if "Caution" not in kind and file not in written]
    made = {file for file, node in nodes() if isinstance(node, ast.Call) and ast.unparse(node.func) == "Caution"}
    assert made == FROM_FILES


def test_the_most_serious_come_first() -> None:
    found = ranked([note("three"), "two", do_not_use("one"), f"cube: {do_not_use('zero')}"])
    assert found == ["do not use: one", "do not use: cube: zero", "warning: two", "note: three"]


def test_one_sentence_of_several_things_is_one_line_with_their_count() -> None:
    texts = [f"{name}.csv: its length is not stated" for name in "abcdef"]
    assert ranked(texts) == ["warning: 6 times (a.csv, b.csv, c.csv, d.csv, e.csv, f.csv): its length is not stated"]


def test_numbers_that_differ_are_listed_where_all_words_are_the_same() -> None:
    reason, other = "left out, nothing set", "left out, outlier by 8.3 errors"
    texts = [f"{reason}: row 1 (0 µm)", f"{other}: row 21 (20 µm)", f"{reason}: row 4 (0 µm)"]
    assert ranked(texts) == [f"warning: 2 times: {reason}: row 1, 4 (0 µm)", f"warning: {texts[1]}"]


def test_sentences_of_different_rank_or_words_stay_apart() -> None:
    texts = ["a: too thin", "a: too thick", note("b: too thin")]
    assert ranked(texts) == ["warning: a: too thin", "warning: a: too thick", "note: b: too thin"]


def test_nothing_is_lost() -> None:
    texts = [f"{name}: {what} {n}" for name in ("a", "b") for what in ("long", "short") for n in range(5)]
    lines = ranked(texts)
    assert len(lines) == 4
    assert all(line.startswith("warning: 5 times: ") and line.endswith(" 0, 1, 2, 3, 4") for line in lines)


def test_the_same_text_twice_is_one() -> None:
    assert ranked(["x", "x"]) == ["warning: x"]


def test_values_in_refusals_are_rounded() -> None:
    assert "0.3;" in str(SolenError("x", value=0.1 + 0.2, limit="must be less"))
    assert "'123456789012…'" in str(SolenError("x", value="1234567890123456789012345678901234567890"))
    assert len(str(SolenError("x", value="a" * 5000))) < 250
