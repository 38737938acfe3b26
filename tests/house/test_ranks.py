"""Ranks of warnings, and merging of equal warnings."""

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

import solen
from solen.errors import SolenError
from solen.ranks import do_not_use, note, ranked

RANKED = ("analysis", "bench", "fabricate", "material", "metrology", "recording")
"""Packages whose warnings must be of type `Caution`, not strings."""
FROM_FILES = {"recording/model.py", "recording/spectrum.py", "material/resin.py"}
"""Modules that read warnings with their ranks from files or channels."""


def nodes(word: str) -> Iterator[tuple[str, ast.AST]]:
    """The file and the node for every node of the syntax trees of files that contain a word."""
    root = Path(inspect.getfile(solen)).parent
    for path in (file for folder in RANKED for file in (root / folder).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if word in text else ():
            yield path.relative_to(root).as_posix(), node


def test_warnings_of_measurements_and_prints_have_a_rank() -> None:
    """Fields and functions named warnings are of type `Caution`, which only the functions of `solen.ranks` create."""
    kinds = [
        (file, ast.unparse(kind))
        for file, node in nodes("warnings")
        if isinstance(node, ast.AnnAssign | ast.FunctionDef)
        and (node.name if isinstance(node, ast.FunctionDef) else ast.unparse(node.target)) in {"warnings", "_warnings"}
        and (kind := node.returns if isinstance(node, ast.FunctionDef) else node.annotation) is not None
    ]
    assert len(kinds) > 30
    strings = {"material/resin.py", "material/dispersion.py", "material/result_files.py"}
    assert not [(file, kind) for file, kind in kinds if "Caution" not in kind and file not in strings]
    calls = [(file, node.func) for file, node in nodes("Caution(") if isinstance(node, ast.Call)]
    creating = {file for file, function in calls if isinstance(function, ast.Name) and function.id == "Caution"}
    assert creating == FROM_FILES


def test_most_serious_warnings_are_first() -> None:
    lines = ranked([note("three"), "two", do_not_use("one"), f"cube: {do_not_use('zero')}"])
    assert lines == ["do not use: one", "do not use: cube: zero", "warning: two", "note: three"]


def test_same_warning_of_several_subjects_is_one_line() -> None:
    texts = [f"{name}.csv: its length is not stated" for name in "abcdef"]
    assert ranked(texts) == ["warning: 6 times (a.csv, b.csv, c.csv, d.csv, e.csv, f.csv): its length is not stated"]


def test_warnings_that_differ_in_a_number_are_one_line() -> None:
    reason, other = "left out, nothing set", "left out, outlier by 8.3 errors"
    texts = [f"{reason}: row 1 (0 µm)", f"{other}: row 21 (20 µm)", f"{reason}: row 4 (0 µm)"]
    assert ranked(texts) == [f"warning: 2 times: {reason}: row 1, 4 (0 µm)", f"warning: {texts[1]}"]


def test_warnings_of_different_rank_or_text_are_separate() -> None:
    texts = ["a: too thin", "a: too thick", note("b: too thin")]
    assert ranked(texts) == ["warning: a: too thin", "warning: a: too thick", "note: b: too thin"]


def test_merged_warnings_contain_all_numbers() -> None:
    texts = [f"{name}: {what} {n}" for name in ("a", "b") for what in ("long", "short") for n in range(5)]
    lines = ranked(texts)
    assert len(lines) == 4
    assert all(line.startswith("warning: 5 times: ") and line.endswith(" 0, 1, 2, 3, 4") for line in lines)


def test_duplicate_warning_is_printed_once() -> None:
    assert ranked(["x", "x"]) == ["warning: x"]


def test_values_in_errors_are_rounded() -> None:
    assert "0.3;" in str(SolenError("x", value=0.1 + 0.2, limit="must be less"))
    assert "'123456789012…'" in str(SolenError("x", value="1234567890123456789012345678901234567890"))
    assert len(str(SolenError("x", value="a" * 5000))) < 250
