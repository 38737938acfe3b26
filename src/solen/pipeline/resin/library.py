"""Commands that write a resin file from results, and show a resin."""

from pathlib import Path
from typing import Annotated

from solen import __version__, files
from solen.material.facts import ResinFacts, ShowOptions, facts_of
from solen.material.resin import dumps_resin, resin_of
from solen.material.resin_from_results import BuildOptions, build_resin
from solen.pipeline.options import FLAT
from solen.pipeline.outputs import check_ending, check_new, check_outputs, write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.spec.design import is_file_path


def build(
    out: Path,
    /,
    *,
    options: Annotated[BuildOptions, FLAT],
    index: Path | None = None,
    cutback: Path | None = None,
    cure: Path | None = None,
    stiffness: Path | None = None,
    refractometer: Path | None = None,
    penetration: Path | None = None,
    force: bool = False,
) -> Outcome[ResinFacts]:
    """Write a resin file from the results of other commands, written with --out.

    Parameters
    ----------
    out
        The resin file, a .toml file.
    index
        Result of solen resin index or solen resin refractometer.
    refractometer
        Result of solen resin refractometer, to compare with the index.
    penetration
        Result of solen resin penetration, to compare with the working curve.
    cutback
        Result of solen resin cutback.
    cure
        Result of solen resin cure.
    stiffness
        Result of solen resin stiffness.
    force
        Replace an existing file.

    Raises
    ------
    DataError, SpecError
        If a result cannot be read, is of another kind or invalid, or if there is nothing to write.
    OutputError
        If the file exists and must not be replaced, or cannot be written.
    """
    check_ending(out, "a resin file", ".toml")
    check_new(out, force=force)
    paths = {"index": index, "cutback": cutback, "cure": cure, "stiffness": stiffness}
    paths |= {"refractometer": refractometer, "penetration": penetration}
    results = {option: path for option, path in paths.items() if path is not None}
    resin = build_resin(results, options)
    files.write_text(out, dumps_resin(resin, f"Written by solen {__version__}."))
    return Outcome(facts_of(resin, str(out)), {"resin": out})


def show(
    name: str,
    /,
    *,
    options: Annotated[ShowOptions, FLAT] = ShowOptions(),
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[ResinFacts]:
    """Show all data of a resin, and its index at given wavelengths.

    Parameters
    ----------
    name
        A resin of the library, or a resin file (ends in .toml or contains a / or a backslash).
    """
    check_outputs(None, figure)
    resin = resin_of(name, Path(name) if is_file_path(name) else None)
    return write(facts_of(resin, name, options.at_nm), "resin", figure=figure)
