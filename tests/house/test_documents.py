"""Code blocks of the pages are executed or checked in order, in an empty folder, and their output is compared.

Commands of solen are run, and the lines below ``$ solen ...`` are compared with their output; ``...`` on a separate
line matches any lines, and within a line any text. Python is executed, and the ``text`` that follows is compared with
its output; other ``text`` contains error messages of solen. TOML and JSON are read as the files that their keys
determine. Files that a page assumes are simulated (`page_files.py`). With a comment ``<!-- not run: reason -->`` before
a block, its commands are only parsed.
"""

import contextlib
import io
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from solen.analysis.diagnosis import Response
from solen.bench.simulated import sensors
from solen.cli import run_command
from solen.cli.app import app
from solen.errors import DataError
from solen.pipeline.project.paper import FIGURES
from tests.house.page_checks import check_file
from tests.house.page_files import give
from tests.house.page_support import (
    ROOT,
    Block,
    blocks,
    commands,
    differences,
    not_said,
    pages,
    paint_coarsely,
    words_of,
)

NOT_RUN = {
    "a drawing": 1,
    "a summary of what follows": 1,
    "a cluster": 1,
    "an instrument": 1,
    "belongs to a package that another test installs": 2,
    "needs a measurement of your own": 4,
    "sets a computer up": 6,
    "takes too long": 22,
}
"""Reasons why blocks are not run, and the number of these blocks."""
LESS = {
    "solen explore sweep": ["--rays", "256"],
    "solen explore tolerance": ["--rays", "256", "--prints", "32"],
    "solen run": ["--set", "trace.dimension=2d", "--set", "motion.step_deg=3"],
}
"""Options added to commands whose output is not shown, so that they trace fewer rays or samples."""
OTHERS = {"docs/gallery.md"}
"""Pages that other tests check: `test_examples.py`."""
PAGES = [page for page in pages() if page not in OTHERS and blocks((ROOT / page).read_text(encoding="utf-8"))]
EXACT = {"docs/calibrate.md"}
"""Pages that show numbers from recordings of simulated sensors; on the others, these sensors are traced coarsely."""
ELSEWHERE = {command.partition(" #")[0].strip() for figure in FIGURES for command in figure.commands} | {
    "solen completion",
    "solen project reproduce --out reproduction",
    "solen project reproduce --out reproduction --figure 3C",
}
"""Commands that other tests run: `tests/paper/test_reproduce.py` and `tests/house/test_every_command.py`."""


def printed_by(command: list[str]) -> str:
    """Output of a command on stdout and stderr, regardless of its exit code."""
    with io.StringIO() as text, contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        run_command(command)
        return text.getvalue().replace(os.sep, "/")  # a page shows paths as most systems write them


@cache
def simulated(command: tuple[str, ...], design: str) -> str:
    """Output of ``solen run`` for a design; two pages show the same run."""
    assert design
    return printed_by(list(command))


@pytest.fixture(scope="module", autouse=True)
def shared() -> Iterator[None]:
    """Traces of the same design on several pages are computed once, and figures have few pixels."""
    with pytest.MonkeyPatch.context() as patch:
        traced, of = sensors.traced, Response.of
        kept: dict[str, Any] = {}

        def once(make: Callable[..., Any], *parts: Any) -> Any:
            key = repr((make, *parts, sensors.TOLERANCE))
            if key not in kept:
                kept[key] = make(*parts)
            return kept[key]

        paint_coarsely(patch)
        patch.setattr(sensors, "traced", lambda sensor, angles: once(traced, sensor, angles))
        patch.setattr(Response, "of", lambda *parts: once(of, *parts[:4]))
        yield


def understood(words: list[str]) -> None:
    """Parse a command line, and raise the error of the parser; files that it names need not exist."""
    try:
        app.parse_args(words, exit_on_error=False, print_error=False)
    except DataError as bad:
        if "no such file" not in str(bad):
            raise


def ran(page: str, line: str, shown: list[str]) -> list[str]:
    """Lines that a command line prints; `AssertionError` if it cannot be run."""
    words = words_of(line)
    match words:
        case ["cd", folder]:
            os.chdir(folder)
        case ["make", target]:
            assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE), line
        case ["python", script]:
            assert (ROOT / script).is_file(), line  # run by test_examples.py
        case ["solen", *rest]:
            give(page, line)
            if line.partition(" #")[0].strip() in ELSEWHERE:
                understood(rest)
                return []
            less = [] if shown else next((more for start, more in LESS.items() if line.startswith(start)), [])
            if rest[0] == "run" and shown:
                return simulated(tuple(rest), Path(rest[1]).read_text(encoding="utf-8")).splitlines()
            with pytest.MonkeyPatch.context() as patch:
                if less:
                    patch.setattr("solen.sensor.effects.KEYS", ("emitter.offset_mm",))
                return printed_by([*rest, *less]).splitlines()
        case _:
            raise AssertionError(f"{line} cannot be run by a test")
    return []


def run_python(code: str, names: dict[str, Any]) -> list[str]:
    """Lines that Python prints."""
    with contextlib.redirect_stdout(io.StringIO()) as text:
        exec(compile(code, "page", "exec"), names)  # noqa: S102
    return text.getvalue().splitlines()


def parsed(block: Block) -> None:
    """Check a block that is not run: its commands and options must exist, or its Python code must compile."""
    if block.language == "python":
        compile(block.text, "page", "exec")
    for line, _ in commands(block) if block.language in {"sh", "console"} else ():
        for part in line.split(" | "):
            if part.startswith("solen "):
                understood(words_of(part)[1:])


def check(page: str, block: Block, names: dict[str, Any], printed: list[str] | None) -> list[str] | None:
    """Run or check a block; return the lines that it printed if it is Python."""
    where = f"{page}, line {block.line}"
    if block.not_run is not None:
        parsed(block)
    elif block.language in {"sh", "console"}:
        for line, shown in commands(block):
            found = ran(page, line, shown)
            refused = any(row.startswith("solen: ") for row in found)
            assert refused == any(row.startswith("solen: ") for row in shown), f"{where}: {line}\n{found}"
            assert not shown or not differences(shown, found), f"{where}: {line}\n{differences(shown, found)}"
    elif block.language == "python":
        give(page, block.text)
        return run_python(block.text, names)
    elif block.language == "text":
        shown = block.text.rstrip().splitlines()
        missing = differences(shown, printed) if printed is not None else "\n".join(not_said(shown))
        assert not missing, f"{where}\n{missing}"
    else:
        give(page, block.text)
        check_file(block.language, block.text, Path(f"block.{block.language}"))
    return None


@pytest.mark.parametrize("page", PAGES)
def test_page_is_correct(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if page not in EXACT:
        monkeypatch.setattr(sensors, "MAX_INTERPOLATION_ERROR", 0.02)
        monkeypatch.setattr(sensors, "TOLERANCE", 0.01)
    names: dict[str, Any] = {}
    printed: list[str] | None = None
    for block in blocks((ROOT / page).read_text(encoding="utf-8")):
        printed = check(page, block, names, printed)


def test_blocks_that_are_not_run_have_known_reasons() -> None:
    found = Counter(
        block.not_run
        for page in PAGES
        for block in blocks((ROOT / page).read_text(encoding="utf-8"))
        if block.not_run is not None
    )
    assert found == NOT_RUN


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
def test_compares_lines(shown: list[str], printed: list[str], same: bool) -> None:
    assert (differences(shown, printed) == "") is same
