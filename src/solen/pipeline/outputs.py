"""Files that a command writes beside what it prints: figures, and its result as JSON. Nothing heavy is loaded here."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from solen import __version__, files
from solen.errors import OutputError, SpecError
from solen.report.plot import plot
from solen.results import Outcome, Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURE_KINDS = (".svg", ".png", ".pdf")
R = TypeVar("R", bound=Result)


def check_outputs(out: Path | None, *figures: Path | None) -> None:
    """`OutputError` where the file of the result is not named .json, or a figure has no known format."""
    check_out(out)
    for figure in figures:
        check_figure(figure)


def write(
    result: R,
    kind: str,
    out: Path | None = None,
    figures: "Mapping[str, tuple[Path | None, Callable[[], Figure | bytes]]] | None" = None,
    *,
    figure: Path | None = None,
) -> Outcome[R]:
    """Write a result and its figures where they are asked for, all or none.

    Parameters
    ----------
    result
        Written to ``out`` as JSON.
    kind
        What the result is, as its file states it for the commands that read it: ``index``, ``cutback``, ``cure``.
    out
        File of the result, or None.
    figures
        By the name that the outcome gives it: the file of a figure or None, and the function that draws it; of another
        file, the function that gives its bytes.
    figure
        File of the figure that `solen.report.plot` draws of the result, or None.
    """
    figures = {"figure": (figure, lambda: plot(result))} | dict(figures or {})
    chosen = {name: (path, draw) for name, (path, draw) in figures.items() if path is not None}
    contents: dict[Path, files.Content] = {}
    if out is not None:
        data = {"kind": kind, "solen": __version__} | result.to_dict()
        contents[out] = (json.dumps(data, indent=1, allow_nan=False) + "\n").encode()
    for path, draw in chosen.values():
        content = draw()
        contents[path] = content if isinstance(content, bytes) else _encoded(content, path, kind)
    files.write_all(contents)
    places = {name: path for name, (path, _) in chosen.items()}
    return Outcome(result, places if out is None else places | {"out": out})


def drawn(result: Any, figure: Path | None, kind: str) -> dict[Path, files.Content]:
    """File of the figure that `solen.report.plot` draws of a result, and what it holds; nothing without a file."""
    return {} if figure is None else {figure: _encoded(plot(result), figure, kind)}


def named(**paths: Path | None) -> dict[str, Path]:
    """Files of an outcome by their names, those that were asked for."""
    return {name: path for name, path in paths.items() if path is not None}


def _encoded(figure: "Figure", path: Path, kind: str) -> bytes:
    from solen.report import canvas

    return canvas.encoded(figure, path.suffix.lower(), kind)


def check_figure(figure: Path | None) -> None:
    """`OutputError` where a figure has no known format."""
    check_ending(figure, "a figure", *FIGURE_KINDS)


def check_ending(path: Path | None, what: str, *endings: str) -> None:
    """`OutputError` where a file does not have one of some endings; ``what`` is what it holds."""
    if path is not None and path.suffix.lower() not in endings:
        raise OutputError(str(path), limit=f"{what} ends in {', '.join(endings)}", remedy="rename it")


def check_out(out: Path | None) -> None:
    """`OutputError` where the file of a result is not named .json."""
    check_ending(out, "a result", ".json")


def check_table(out: Path | None, what: str) -> None:
    """`OutputError` where the file of a table is not named .csv."""
    if out is not None and out.suffix.lower() != ".csv":
        raise OutputError(str(out), limit=f"{what} are written as .csv", remedy="rename it")


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """`SpecError` where an option is none of its choices."""
    if value not in choices:
        raise SpecError(name, value=value, limit=f"must be one of {', '.join(choices)}")
