"""Pages that a newcomer follows, executed as they stand: in order, in an empty folder, with what they show compared.

Commands of solen are run, and what stands under ``$ solen ...`` is what each must print; ``...`` on a line of its own
stands for any lines. Python is executed, and the ``text`` that follows is what it prints.
"""

import contextlib
import io
import os
import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from solen.cli import run_command

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    "README.md",
    "docs/quickstart.md",
    *sorted(f"docs/{one.name}" for one in (ROOT / "docs").glob("tutorial-*.md")),
]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INSTALLS = ("make ", "pip ", "python3 -m venv ", ". .venv/", "solen studio")
"""Beginnings of lines that set a system up, or wait for a person."""


def printed_by(command: list[str]) -> str:
    """What a command prints, stdout and stderr, whatever it ends with."""
    with io.StringIO() as text, contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        run_command(command)
        return text.getvalue().replace(os.sep, "/")  # a page shows paths as most systems write them


@cache
def simulated(command: tuple[str, ...], design: str) -> str:
    """What ``solen run`` prints of a design; two pages show the same run."""
    assert design
    return printed_by(list(command))


def answer(line: str) -> list[str]:
    """Lines that a command line prints."""
    words = shlex.split(line, comments=True)
    if words[0] == "cd":
        os.chdir(words[1])
        return []
    assert words[0] == "solen", f"{line} is no command of solen"
    if words[1] == "run":
        return simulated(tuple(words[1:]), Path(words[2]).read_text(encoding="utf-8")).splitlines()
    return printed_by(words[1:]).splitlines()


def commands(text: str) -> Iterator[tuple[str, list[str]]]:
    """Command lines of a console, each with the lines under it."""
    for part in re.split(r"^\$ ", text.replace("\\\n", " "), flags=re.MULTILINE)[1:]:
        line, *shown = part.rstrip().splitlines()
        yield line, shown


def differences(shown: list[str], printed: list[str]) -> str:
    """Empty if lines are as shown, ``...`` standing for any; else the first line that is not."""
    at, text = 0, "".join(f"\n{line.rstrip()}" for line in printed) + "\n"
    for place, part in enumerate("".join(f"\n{line}" for line in shown).split("\n...")):
        found = text.find(f"{part}\n", at)
        if found < 0 or (place == 0 and found > 0):
            return f"shown:\n{part}\n\nprinted:\n{text}"
        at = found + len(part)
    return "" if shown[-1] == "..." or at == len(text) - 1 else f"not shown:\n{text[at:]}"


def run_python(code: str, names: dict[str, Any]) -> list[str]:
    """Lines that Python prints."""
    with contextlib.redirect_stdout(io.StringIO()) as text:
        exec(compile(code, "page", "exec"), names)  # noqa: S102
    return text.getvalue().splitlines()


@pytest.mark.parametrize("page", PAGES)
def test_a_page_does_what_it_says(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    printed: list[str] | None = None
    for language, text in BLOCK.findall((ROOT / page).read_text(encoding="utf-8")):
        if language == "console":
            for line, shown in commands(text):
                found = answer(line)
                refused = any(row.startswith("solen: ") for row in found)
                assert refused == any(row.startswith("solen: ") for row in shown), f"{line}\n{found}"
                assert not shown or not differences(shown, found), f"{page}: {line}\n{differences(shown, found)}"
        elif language == "sh":
            for line in text.splitlines():
                if line and not line.startswith((*INSTALLS, "#")):
                    assert not [row for row in answer(line) if row.startswith("solen: ")], line
        elif language == "python":
            printed = run_python(text, names)
        elif language == "text" and printed is not None:
            assert not differences(text.rstrip().splitlines(), printed), (
                f"{page}\n{differences(text.splitlines(), printed)}"
            )
            printed = None


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        (["a 1", "b 2"], ["a 1", "b 2"], True),
        (["a 1", "b 2"], ["a 1", "b 3"], False),
        (["a 1"], ["a 1", "b 3"], False),
        (["a 1", "...", "c"], ["a 1", "b", "b", "c"], True),
        (["a 1", "...", "d"], ["a 1", "b", "c"], False),
        (["a 1", "..."], ["a 1", "b"], True),
        (["..."], ["a 1", "b"], True),
        (["a 1", "..."], ["a 12", "b"], False),
        (["b"], ["a 1", "b"], False),
    ],
)
def test_lines_are_compared(shown: list[str], printed: list[str], same: bool) -> None:
    assert (differences(shown, printed) == "") is same
