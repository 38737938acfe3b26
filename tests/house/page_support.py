"""Code blocks of the pages: what a block is, the commands in it, and the files that it takes for granted."""

import ast
import re
import shlex
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest
from matplotlib.figure import Figure

from solen.report import canvas

ROOT = Path(__file__).resolve().parents[2]
GENERATED = {ROOT / "docs" / "api", ROOT / "docs" / "commands"}
"""Folders of pages that programs write; calls of the latter are compared in `test_every_command.py`."""
FENCE = re.compile(r"^(?:<!-- not run: ([^\n]*) -->\n)?```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block of a page: why it is not run, or None; its language; its text; the line where it begins."""

    not_run: str | None
    language: str
    text: str
    line: int


def pages() -> list[str]:
    """Every page that is written by hand, from the project's root."""
    found = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "examples" / "README.md"]
    found += [page for page in (ROOT / "docs").rglob("*.md") if not GENERATED & {*page.parents}]
    return sorted(page.relative_to(ROOT).as_posix() for page in found)


def blocks(text: str) -> list[Block]:
    """The blocks of a page but for directives, which Sphinx checks."""
    found = [Block(one[1], one[2], one[3], text.count("\n", 0, one.start()) + 1) for one in FENCE.finditer(text)]
    return [block for block in found if not block.language.startswith("{")]


def commands(block: Block) -> Iterator[tuple[str, list[str]]]:
    """Command lines of a shell block, each with the lines that it is shown to print; none but in a console."""
    text = block.text.replace("\\\n", " ")
    if block.language == "console":
        lines = [part.rstrip().splitlines() for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]]
    else:
        lines = [[line] for line in text.splitlines() if line and not line.startswith("#")]
    for line, *shown in lines:
        *before, last = re.split(r" && ", line)
        yield from ((one, []) for one in before)
        yield last, shown


def paint_coarsely(patch: pytest.MonkeyPatch) -> None:
    """Write figures with few pixels: with those of a printed page, painting them takes most of a command's time."""
    encoded = canvas.encoded

    def coarse(figure: Figure, suffix: str, salt: str, dpi: int = 200) -> bytes:
        return encoded(figure, suffix, salt, min(dpi, 40))

    patch.setattr(canvas, "encoded", coarse)


def words_of(line: str) -> list[str]:
    """Words of a command line, without its comment; a pattern stands for the files that fit, as in a shell."""
    found: list[str] = []
    for word in shlex.split(line, comments=True):
        files = sorted(path.as_posix() for path in Path().glob(word)) if "*" in word and "=" not in word else []
        found += files or [word]
    return found


def differences(shown: list[str], printed: list[str]) -> str:
    """Empty if lines are as shown; else the first that is not.

    ``...`` on a line of its own stands for any lines, within a line for any part of it.
    """
    at, text = 0, "".join(f"\n{line.rstrip()}" for line in printed) + "\n"
    for place, part in enumerate("".join(f"\n{line}" for line in shown).split("\n...")):
        found = re.compile(".*".join(map(re.escape, f"{part}\n".split("...")))).search(text, at)
        if not found or (place == 0 and found.start() > 0):
            return f"shown:\n{part}\n\nprinted:\n{text}"
        at = found.end() - 1
    return "" if shown[-1] == "..." or at == len(text) - 1 else f"not shown:\n{text[at:]}"


@cache
def wordings() -> re.Pattern[str]:
    """What the rooms that refuse drawings and designs say, as one pattern: their texts, with any value in them."""
    found: set[str] = set()
    for room in ("analysis", "geometry", "lens", "sensor", "spec"):
        for path in (ROOT / "src" / "solen" / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr | ast.Constant):
                    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
                    said = [str(part.value) if isinstance(part, ast.Constant) else None for part in parts]
                    if len(re.findall(r"[a-z]{2,}", " ".join(filter(None, said)))) > 1:
                        found.add("".join(".+?" if one is None else re.escape(one) for one in said))
    return re.compile("|".join(sorted(found, key=len, reverse=True)))


def not_said(lines: list[str]) -> list[str]:
    """Phrases of refusals, behind what they are about, that solen does not say; two may be one text."""
    missing = []
    for line in lines:
        phrases = re.sub(r"; at x = \S+, z = \S+ mm(?=[,;])", "; ", line).split("; ")[1:]
        said = {one for one in phrases if wordings().fullmatch(one)}
        for pair in pairwise(phrases):
            said |= {*pair} if wordings().fullmatch("; ".join(pair)) else set()
        missing += [one for one in phrases if one not in said] if phrases else [line]
    return missing
