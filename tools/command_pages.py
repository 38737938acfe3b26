"""Run the example calls of docs/commands on the sample data: ``python -m tools.command_pages [COMMAND ...]``.

Under each call the tool writes the first lines of its output, and its figure to docs/images/commands. A command that
reads a file of another command is run together with that command.
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
"""The command that makes the folder in which the other calls are run."""
OF_THE_COMPUTER = {"doctor", "completion"}
"""Commands whose output differs between computers; their pages show none."""
ROUNDED = re.compile(r"(?<=adaptive with )\d+(?= rays)")
"""Numbers of rays of an integral to 1e-11: the last ones depend on rounding, which differs between systems."""
MAX_LINES = 12
PAGE_MM = 180.0


def page_of(command: str) -> Path:
    """Return the page of a command."""
    return DOCS / "commands" / f"{command.replace(' ', '-', 1)}.md"


def calls() -> dict[str, tuple[list[str], list[str]]]:
    """Return the arguments of the call on each command's page, and the lines that it shows; sample data come first."""
    found = {}
    for command in sorted(commands(), key=lambda one: one != SAMPLES):
        for call, shown in CALL.findall(page_of(command).read_text(encoding="utf-8")):
            found[command] = (shlex.split(call.replace("\\\n", " ")), shown.splitlines())
    return found


def head(printed: str) -> str:
    """Return the first lines of a command's output, with dots for the remaining ones."""
    lines = [line.rstrip() for line in ROUNDED.sub("...", printed.replace(os.sep, "/")).splitlines()]
    return "\n".join(lines if len(lines) <= MAX_LINES else [*lines[: MAX_LINES - 2], "..."]) + "\n"


def picture(figure: bytes) -> bytes:
    """Return a figure as lossless WebP, or as a photograph if that is much smaller."""
    files = []
    with Image.open(io.BytesIO(figure)) as image:
        for settings in ({"lossless": True, "quality": 100}, {"quality": 85}):
            file = io.BytesIO()
            image.convert("RGB").save(file, "WEBP", method=6, **settings)
            files.append(file.getvalue())
    return files[0] if len(files[0]) < 60_000 else files[1]


def run(command: str, arguments: list[str]) -> tuple[str, Outcome[Result] | None]:
    """Return the output and the outcome of a call."""
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
