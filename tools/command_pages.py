"""Run the example calls in docs/commands on the sample data: ``python -m tools.command_pages [COMMAND ...]``.

The tool writes the first lines of output below each call, and the figure to docs/images/commands. A command that reads
the output file of another command must be run together with that command.
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
"""Command that creates the folder in which the other calls are run."""
MACHINE_DEPENDENT = {"doctor", "completion"}
"""Commands whose output depends on the computer; their pages show no output."""
ROUNDED = re.compile(r"(?<=adaptive with )\d+(?= rays)")
"""Number of rays of an integral to 1e-11, which depends on rounding errors and so on the system."""
MAX_LINES = 12
PAGE_MM = 180.0


def page_of(command: str) -> Path:
    """Return the path of the page of a command."""
    return DOCS / "commands" / f"{command.replace(' ', '-', 1)}.md"


def calls() -> dict[str, tuple[list[str], list[str]]]:
    """Return the arguments and output lines on the page of each command, keyed by command; the samples come first."""
    examples = {}
    for command in sorted(commands(), key=lambda command: command != SAMPLES):
        for call, output in CALL.findall(page_of(command).read_text(encoding="utf-8")):
            examples[command] = (shlex.split(call.replace("\\\n", " ")), output.splitlines())
    return examples


def head(printed: str) -> str:
    """Return the first lines of the output of a command, with dots for the remaining lines."""
    lines = [line.rstrip() for line in ROUNDED.sub("...", printed.replace(os.sep, "/")).splitlines()]
    return "\n".join(lines if len(lines) <= MAX_LINES else [*lines[: MAX_LINES - 2], "..."]) + "\n"


def as_webp(figure: bytes) -> bytes:
    """Return a figure as lossless WebP, or as lossy WebP if the lossless file is large."""
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
            raise SystemExit(f"solen {command}: the call on its page failed")
    return text.getvalue(), outcomes[0] if outcomes else None


def main() -> None:
    """Run the calls of all commands, or of the specified ones, in a folder with the sample data."""
    selected = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder, patch.dict(os.environ, HOME=folder, USERPROFILE=folder):
        os.chdir(folder)
        for command, (arguments, _) in calls().items():
            if selected and command not in {*selected, SAMPLES}:
                continue
            printed, outcome = run(command, arguments)
            page = page_of(command)
            text = page.read_text(encoding="utf-8")
            output = "" if command in MACHINE_DEPENDENT else head(printed)
            if call := CALL.search(text):
                text = f"{text[: call.start(2)]}{output}{text[call.end(2) :]}"
                page.write_text(text, encoding="utf-8")
            image = DOCS / "images" / "commands" / f"{page.stem}.webp"
            if outcome and f"images/commands/{image.name}" in text:
                figure = solen.plot(outcome.result)
                if figure.get_figwidth() > PAGE_MM / 25.4:
                    figure = solen.plot(outcome.result, FigureOptions(width_mm=PAGE_MM))
                image.write_bytes(as_webp(encoded(figure, ".png", f"solen {command}", 150)))
                print(f"{command}: {image.stat().st_size} bytes")
            if command == SAMPLES:
                os.chdir("samples")
        os.chdir(DOCS)


if __name__ == "__main__":
    main()
