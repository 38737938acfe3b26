"""Code blocks of the pages, the commands in them, and comparisons of output."""

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
"""Folders of generated pages; the calls in ``docs/commands`` are compared in `test_every_command.py`."""
FENCE = re.compile(r"^(?:<!-- not run: ([^\n]*) -->\n)?```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block of a page: why it is not run (or None), language, text, and number of its first line."""

    not_run: str | None
    language: str
    text: str
    line: int


def pages() -> list[str]:
    """Every page that is written by hand, relative to the root of the repository."""
    paths = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "examples" / "README.md"]
    paths += [page for page in (ROOT / "docs").rglob("*.md") if not GENERATED & {*page.parents}]
    return sorted(page.relative_to(ROOT).as_posix() for page in paths)


def blocks(text: str) -> list[Block]:
    """The blocks of a page except directives, which Sphinx checks."""
    matches = FENCE.finditer(text)
    fenced = [Block(match[1], match[2], match[3], text.count("\n", 0, match.start()) + 1) for match in matches]
    return [block for block in fenced if not block.language.startswith("{")]


def commands(block: Block) -> Iterator[tuple[str, list[str]]]:
    """Command lines of a shell block, each with the output shown below it, which only console blocks contain."""
    text = block.text.replace("\\\n", " ")
    if block.language == "console":
        lines = [part.rstrip().splitlines() for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]]
    else:
        lines = [[line] for line in text.splitlines() if line and not line.startswith("#")]
    for line, *output in lines:
        *first, last = re.split(r" && ", line)
        yield from ((command, []) for command in first)
        yield last, output


def paint_coarsely(patch: pytest.MonkeyPatch) -> None:
    """Write figures with few pixels: at full resolution, this would take most of the time of a command."""
    encoded = canvas.encoded

    def coarse(figure: Figure, suffix: str, salt: str, dpi: int = 200) -> bytes:
        return encoded(figure, suffix, salt, min(dpi, 40))

    patch.setattr(canvas, "encoded", coarse)


def words_of(line: str) -> list[str]:
    """Words of a command line without its comment; patterns are replaced by matching files, as in a shell."""
    words: list[str] = []
    for word in shlex.split(line, comments=True):
        files = sorted(path.as_posix() for path in Path().glob(word)) if "*" in word and "=" not in word else []
        words += files or [word]
    return words


def differences(shown: list[str], printed: list[str]) -> str:
    """Difference between the lines shown on a page and those printed; empty if they agree.

    ``...`` on a separate line matches any lines, and within a line any text.
    """
    position, text = 0, "".join(f"\n{line.rstrip()}" for line in printed) + "\n"
    for index, part in enumerate("".join(f"\n{line}" for line in shown).split("\n...")):
        match = re.compile(".*".join(map(re.escape, f"{part}\n".split("...")))).search(text, position)
        if not match or (index == 0 and match.start() > 0):
            return f"shown:\n{part}\n\nprinted:\n{text}"
        position = match.end() - 1
    return "" if shown[-1] == "..." or position == len(text) - 1 else f"not shown:\n{text[position:]}"


@cache
def wordings() -> re.Pattern[str]:
    """Pattern of the messages in the packages that refuse drawings and designs, with any values in them."""
    patterns: set[str] = set()
    for package in ("analysis", "geometry", "lens", "sensor", "spec"):
        for path in (ROOT / "src" / "solen" / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr | ast.Constant):
                    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
                    texts = [str(part.value) if isinstance(part, ast.Constant) else None for part in parts]
                    if len(re.findall(r"[a-z]{2,}", " ".join(filter(None, texts)))) > 1:
                        patterns.add("".join(".+?" if text is None else re.escape(text) for text in texts))
    return re.compile("|".join(sorted(patterns, key=len, reverse=True)))


def not_said(lines: list[str]) -> list[str]:
    """Phrases of error messages on a page that solen never prints; two adjacent phrases may be a single text."""
    missing = []
    for line in lines:
        phrases = re.sub(r"; at x = \S+, z = \S+ mm(?=[,;])", "; ", line).split("; ")[1:]
        known = {phrase for phrase in phrases if wordings().fullmatch(phrase)}
        for pair in pairwise(phrases):
            known |= {*pair} if wordings().fullmatch("; ".join(pair)) else set()
        missing += [phrase for phrase in phrases if phrase not in known] if phrases else [line]
    return missing
