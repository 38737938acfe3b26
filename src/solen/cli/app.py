"""What the commands share: the application they register with, options that many have, and how answers are shown."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Group, Parameter

from solen import __version__

Set = Annotated[
    list[str] | None,
    Parameter(
        name="--set", negative=(), help="A key of the design and its value, as in --set lens.focus_mm=25; repeatable."
    ),
]
Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print one JSON object on stdout.")]

FigureFile = Annotated[Path | None, Parameter(name="--figure", help="Draw the result into this .svg, .png or .pdf.")]
Out = Annotated[
    Path | None, Parameter(name="--out", help="Write the result to this .json, which solen resin build reads.")
]

MATERIAL = Group("The resin, from what instruments export", sort_key=1)
DESIGN = Group("The sensor, from its design", sort_key=2)
PRINT = Group("The print", sort_key=3)
BENCH = Group("The bench, and what it recorded", sort_key=4)

app = App(
    name="solen",
    version=__version__,
    help="From the index of a resin to the response curve of a 3D-printed soft optical sensor.",
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
)


def show(found: dict[str, Any], as_json: bool, told: Callable[[], list[str]]) -> None:
    """Print one JSON object, or lines for a reader."""
    print(json.dumps(found, allow_nan=False) if as_json else "\n".join(told()))


def listing(values: dict[str, Any]) -> list[str]:
    """A line for each plain value, its key before it; tables and lists are left out."""
    shown = {key: value for key, value in values.items() if not isinstance(value, list | dict)}
    width = max(len(key) for key in shown)
    return [f"  {key:{width}}  {text(value)}" for key, value in shown.items()]


def text(value: Any) -> str:
    """A value as a reader wants it: six digits of a number."""
    if value is None:
        return "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def short(value: float | None) -> str:
    """An error or uncertainty, two digits of it."""
    return "unknown" if value is None else f"{value:.1e}"


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None]]:
    """A progress bar on stderr where that is a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda done: bar.update(task, completed=done)
