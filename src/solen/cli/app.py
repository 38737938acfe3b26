"""The application, and the printing of results, which all commands share.

A command returns an `Outcome`: a typed result and the written files. `show_outcome` prints it: as one JSON object with
``--json``, otherwise as the lines that `lines` returns for the type of the result, followed by its warnings and the
files. A command module registers the lines of its result::

    @lines.register
    def _(loss: GuideLoss) -> Iterator[str]:
        yield f"loss {loss.loss_dB_per_cm:.3g} dB/cm"
"""

import functools
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from cyclopts import App, Parameter

from solen import __version__
from solen.cli.commands import COMMANDS, DESIGN, GROUPS
from solen.cli.waiting import CURRENT
from solen.ranks import ranked
from solen.results import Outcome

COMMON_OPTIONS = "Every command also accepts --json (one JSON object on stdout) and --quiet (only warnings)."


@dataclass
class Shown:
    """Output options of the running command."""

    as_json: bool = False
    quiet: bool = False


SHOWN = Shown()


def option_name(field: str) -> str:
    """Return the name of the option for a field: ``irradiance_mW_per_cm2`` becomes ``irradiance-mW-per-cm2``."""
    return field.strip("_").replace("_", "-")


def shown_default(value: Any) -> str | None:
    """Return the default of an option as a user would type it; None for a flag, an empty list or no value."""
    if isinstance(value, bool) or value in {None, "", ()}:
        return None
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _application() -> App:
    """Return the application with all commands registered but not yet imported."""
    application = App(
        name="solen",
        default_parameter=Parameter(name_transform=option_name, negative=(), show_default=shown_default),
        version=__version__,
        help="From the spectra of a resin to a printed, tested and calibrated soft optical sensor.",
        help_epilogue=COMMON_OPTIONS,
        help_format="plaintext",
        suppress_keyboard_interrupt=False,
    )
    groups = {DESIGN: application}
    for name, text in GROUPS.items():
        groups[name] = App(
            name=name, help=text, help_epilogue=COMMON_OPTIONS, sort_key=len(COMMANDS[DESIGN]) + len(groups)
        )
        application.command(groups[name])
    for group, rows in COMMANDS.items():
        for position, (name, location, text) in enumerate(rows):
            groups[group].command(f"solen.cli.{location}", name=name, help=text, sort_key=position)
    return application


app = _application()


@functools.singledispatch
def lines(result: Any) -> Iterable[str]:
    """Return the lines to print for a result; each command module registers a function for the type of its result."""
    raise TypeError(f"no lines for {type(result).__name__}")


def show_outcome(outcome: Outcome[Any]) -> None:
    """Print a result as requested: as JSON, as lines, or with ``--quiet`` only its warnings."""
    if SHOWN.as_json:
        print(json.dumps(outcome.to_dict(), allow_nan=False))
        return
    if not SHOWN.quiet:
        print("\n".join(lines(outcome.result)))
    for line in ranked(getattr(outcome.result, "warnings", ())):
        print(line, file=sys.stderr if SHOWN.quiet else sys.stdout)
    if not SHOWN.quiet:
        for name, path in outcome.files.items():
            print(f"{name}: {path}")


def listing(values: dict[str, Any]) -> list[str]:
    """Return one line per scalar value, with its key; tables and lists are omitted."""
    scalars = {key: value for key, value in values.items() if not isinstance(value, list | dict)}
    width = max(len(key) for key in scalars)
    return [f"  {key:{width}}  {text(value)}" for key, value in scalars.items()]


def text(value: Any) -> str:
    """Format a value as text, numbers to six digits."""
    if value is None:
        return "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def simulated(result: Any) -> str:
    """Return "simulated: " for a result that is not based on measurements alone, otherwise an empty string."""
    return "simulated: " if result.simulated else ""


def short(value: float | None) -> str:
    """Format an error or uncertainty to two digits, or as "unknown" if it is not finite."""
    return f"{value:.1e}" if value is not None and math.isfinite(value) else "unknown"


@contextmanager
def progress_bar(description: str) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on stderr if it is a terminal and ``--quiet`` is not set; otherwise only count progress."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    hidden = SHOWN.quiet or not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=hidden) as bar:
        task = bar.add_task(description, total=1.0)
        if not hidden:
            CURRENT.describe = lambda message: bar.update(task, description=message)

        def update(done: float) -> None:
            CURRENT.done = done
            bar.update(task, completed=done)

        yield update
