"""Files that a command writes: figures, and its result as JSON. This module imports no large packages."""

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from solen import __version__, files
from solen.errors import OutputError, SpecError
from solen.report.options import FigureOptions
from solen.results import Outcome, Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

R = TypeVar("R", bound=Result)


def check_outputs(out: Path | None, figure: FigureOptions) -> None:
    """Raise `OutputError` if the result's file is not named .json, or the figure has an unknown format."""
    check_out(out)
    figure.check()


def write(
    result: R,
    kind: str,
    out: Path | None = None,
    further: Mapping[str, tuple[Path | None, Callable[[], bytes]]] | None = None,
    *,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[R]:
    """Write a result and its figures to the requested files, all or none.

    Parameters
    ----------
    result
        The result; ``out`` contains it as JSON.
    kind
        Kind of the result, which its file contains for the commands that read it: ``index``, ``cutback``, ``cure``.
    out
        File of the result, or None.
    further
        Further files, keyed by their names in the outcome: path or None, and a function that returns the content.
    figure
        File and style of the figure of the result, which `solen.report.plot` draws.
    """
    contents = drawn(result, figure, kind)
    requested = {name: (path, content) for name, (path, content) in (further or {}).items() if path is not None}
    if out is not None:
        data = {"kind": kind, "solen": __version__} | result.to_dict()
        contents[out] = (json.dumps(data, indent=1, allow_nan=False) + "\n").encode()
    contents |= {path: content() for path, content in requested.values()}
    files.write_all(contents)
    return Outcome(
        result, named(figure=figure.figure, **{name: path for name, (path, _) in requested.items()}, out=out)
    )


def drawn(result: Any, figure: FigureOptions, kind: str) -> dict[Path, files.Content]:
    """Return the file and content of a result's figure drawn by `solen.report.plot`; empty if no file is requested."""
    from solen.report.plot import figure_of

    path = figure.figure
    return {} if path is None else {path: figure_bytes(lambda: figure_of(result), path, kind, figure)}


def figure_bytes(draw: "Callable[[], Figure]", path: Path, kind: str, options: FigureOptions) -> bytes:
    """Return the content of a figure file; ``kind`` distinguishes its internal names from those of other figures."""
    from solen.report import canvas

    return canvas.encoded(canvas.drawn(draw, options), path.suffix.lower(), kind, options.dpi)


def toml_bytes(text: str, command: str) -> bytes:
    """Return the content of a TOML file, with the command that wrote it in its first line."""
    return f"# Written by solen {__version__} {command}.\n{text}".encode()


def named(**paths: Path | None) -> dict[str, Path]:
    """Return the requested files of an outcome, keyed by name."""
    return {name: path for name, path in paths.items() if path is not None}


def check_ending(path: Path | None, what: str, *endings: str) -> None:
    """Raise `OutputError` if a file has none of the specified extensions; ``what`` names the content."""
    if path is not None and path.suffix.lower() not in endings:
        raise OutputError(str(path), limit=f"{what} must end in {', '.join(endings)}", remedy="rename it")


def check_new(path: Path | None, *, force: bool) -> None:
    """Raise `OutputError` if a file exists, because it may contain measurements; ``force`` allows replacing it."""
    if path is None or force:
        return
    try:
        exists = path.exists()
    except OSError:  # a name that is too long; writing reports it
        return
    if exists:
        raise OutputError(str(path), limit="already exists", remedy="specify another file, or add --force")


def check_out(out: Path | None) -> None:
    """Raise `OutputError` if the result file is not named .json."""
    check_ending(out, "a result", ".json")


def check_table(out: Path | None, what: str, source: Path | str, *, force: bool) -> None:
    """Raise `OutputError` if a table of readings is not named .csv, or exists and may therefore be a recording."""
    check_ending(out, what, ".csv")
    check_sources([out], [Path(source)])
    check_new(out, force=force)


def check_sources(targets: Iterable[Path | None], sources: Iterable[Path | None]) -> None:
    """Raise `OutputError` if an output file is also an input file."""
    read = {path.resolve() for path in sources if path is not None}
    for path in targets:
        if path is not None and path.resolve() in read:
            raise OutputError(str(path), limit="is an input file", remedy="specify another file")


def check_different(targets: Iterable[Path]) -> None:
    """Raise `OutputError` if two output files of a command have the same path."""
    files.joined(*({path: b""} for path in targets))


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Raise `SpecError` if an option is not one of its choices."""
    if value not in choices:
        raise SpecError(name, value=value, limit=f"must be one of {', '.join(choices)}")
