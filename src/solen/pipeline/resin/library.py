"""Resins: a file built from results, and one shown."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from solen import __version__, files
from solen.errors import OutputError
from solen.material.facts import ResinFacts, facts_of
from solen.material.resin import dumps_resin, resin_of
from solen.material.resin_from_results import BuildOptions, gather
from solen.pipeline.outputs import check_ending, check_outputs, write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.spec.design import names_file


def build(out: Path, results: Mapping[str, Path], options: BuildOptions, *, force: bool = False) -> Outcome[ResinFacts]:
    """Write a resin file from the results of other commands, by their option.

    Raises
    ------
    DataError, SpecError
        Where a result cannot be read, is of another kind or not valid, or where there is nothing to write.
    OutputError
        Where the file exists already and is not to be replaced, or cannot be written.
    """
    check_ending(out, "a resin file", ".toml")
    if out.exists() and not force:
        raise OutputError(str(out), limit="exists already", remedy="name another file, or add --force")
    resin = gather(results, options)
    files.write_text(out, dumps_resin(resin, f"Written by solen {__version__}."))
    return Outcome(facts_of(resin, str(out)), {"resin": out})


def show(name: str, at_nm: Sequence[float] = (), *, figure: FigureOptions = FigureOptions()) -> Outcome[ResinFacts]:
    """Everything that a resin of the library or a file says, and its index at wavelengths."""
    check_outputs(None, figure)
    resin = resin_of(name, Path(name) if names_file(name) else None)
    return write(facts_of(resin, name, at_nm), "resin", figure=figure)
