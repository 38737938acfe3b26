"""Run the worked calls of docs/commands in the sample data: ``python -m tools.command_pages [COMMAND ...]``.

Writes under each call the first lines of what it prints, and its figure to docs/images/commands. A command that reads
what another one wrote is run with that one.
"""

import io
import os
import re
import shlex
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from unittest.mock import patch

from PIL import Image

import solen
import solen.cli
from solen.cli.app import show_outcome
from solen.cli.design.schema import commands
from solen.report.canvas import encoded
from solen.report.options import FigureOptions
from solen.results import Outcome, Result

DOCS = Path(__file__).resolve().parents[1] / "docs"
CALL = re.compile(r"(?<=^```console\n)\$ solen ((?:.*\\\n)*.*)\n([^`]*)(?=^```$)", re.MULTILINE)
SAMPLES = "project examples"
"""The command in whose folder the other calls are run."""
OF_THE_COMPUTER = {"doctor", "completion"}
"""Commands whose answer is another one on each computer: their pages show none."""
ROUNDED = re.compile(r"(?<=adaptive with )\d+(?= rays)")
"""Rays of an integral to 1e-11: rounding decides the last ones, and differs between systems."""
MOST_LINES = 12
PAGE_MM = 180.0


def page_of(command: str) -> Path:
    """Page of a command."""
    return DOCS / "commands" / f"{command.replace(' ', '-', 1)}.md"


def calls() -> dict[str, tuple[list[str], list[str]]]:
    """Arguments of the call on each command's page, and the lines that it shows; sample data first."""
    found = {}
    for command in sorted(commands(), key=lambda one: one != SAMPLES):
        for call, shown in CALL.findall(page_of(command).read_text(encoding="utf-8")):
            found[command] = (shlex.split(call.replace("\\\n", " ")), shown.splitlines())
    return found


def head(printed: str) -> str:
    """First lines of what a command printed, and dots for the others."""
    lines = [line.rstrip() for line in ROUNDED.sub("...", printed.replace(os.sep, "/")).splitlines()]
    return "\n".join(lines if len(lines) <= MOST_LINES else [*lines[: MOST_LINES - 2], "..."]) + "\n"


def picture(figure: bytes) -> bytes:
    """A figure as WebP without loss, or as a photograph where that is much smaller."""
    files = []
    with Image.open(io.BytesIO(figure)) as image:
        for settings in ({"lossless": True, "quality": 100}, {"quality": 85}):
            file = io.BytesIO()
            image.convert("RGB").save(file, "WEBP", method=6, **settings)
            files.append(file.getvalue())
    return files[0] if len(files[0]) < 60_000 else files[1]


def run(command: str, arguments: list[str]) -> tuple[str, Outcome[Result] | None]:
    """What a call prints, and its outcome."""
    outcomes: list[Outcome[Result]] = []

    def keep(outcome: Outcome[Result]) -> None:
        outcomes.append(outcome)
        show_outcome(outcome)

    text = io.StringIO()
    with patch("solen.cli.show_outcome", keep), redirect_stdout(text), redirect_stderr(io.StringIO()):
        if solen.cli.run_command(arguments):
            raise SystemExit(f"solen {command} failed on its page's call")
    return text.getvalue(), outcomes[0] if outcomes else None


def main() -> None:
    """Run all calls, or those of some commands, in a folder with the sample data."""
    asked = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder, patch.dict(os.environ, HOME=folder, USERPROFILE=folder):
        os.chdir(folder)
        for command, (arguments, _) in calls().items():
            if asked and command not in {*asked, SAMPLES}:
                continue
            printed, outcome = run(command, arguments)
            page = page_of(command)
            text = page.read_text(encoding="utf-8")
            shown = "" if command in OF_THE_COMPUTER else head(printed)
            if call := CALL.search(text):
                text = f"{text[: call.start(2)]}{shown}{text[call.end(2) :]}"
                page.write_text(text, encoding="utf-8")
            drawn = DOCS / "images" / "commands" / f"{page.stem}.webp"
            if outcome and f"images/commands/{drawn.name}" in text:
                figure = solen.plot(outcome.result)
                if figure.get_figwidth() > PAGE_MM / 25.4:
                    figure = solen.plot(outcome.result, FigureOptions(width_mm=PAGE_MM))
                drawn.write_bytes(picture(encoded(figure, ".png", f"solen {command}", 150)))
                print(f"{command}: {drawn.stat().st_size} bytes")
            if command == SAMPLES:
                os.chdir("samples")
        os.chdir(DOCS)


if __name__ == "__main__":
    main()
