"""The commands of resins: build a file from results, list and show them, weigh in a mixture."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel

from solen.cli.app import FLAT, lines, listing, short, text
from solen.material.facts import IndexAt, ResinFacts, ResinList, ShowOptions, listed
from solen.material.mix import MixOptions, Mixtures, Weighed, mixtures
from solen.material.resin import Source
from solen.material.resin_from_results import BuildOptions
from solen.report.options import FigureOptions
from solen.results import Outcome


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
        The resin file, a .toml.
    index
        Result of solen resin index or solen resin refractometer.
    refractometer
        Result of solen resin refractometer, which the index is compared with.
    penetration
        Result of solen resin penetration, which the working curve is compared with.
    cutback
        Result of solen resin cutback.
    cure
        Result of solen resin cure.
    stiffness
        Result of solen resin stiffness.
    force
        Replace a file that exists.
    """
    from solen.pipeline.resin import library as pipeline

    given = {"index": index, "cutback": cutback, "cure": cure, "stiffness": stiffness}
    given |= {"refractometer": refractometer, "penetration": penetration}
    results = {option: path for option, path in given.items() if path is not None}
    return pipeline.build(out, results, options, force=force)


def list_() -> Outcome[ResinList]:
    """List the resins that solen ships, with their index."""
    return Outcome(listed())


def show(
    name: str,
    /,
    *,
    options: Annotated[ShowOptions, FLAT] = ShowOptions(),
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[ResinFacts]:
    """Show everything that a resin says, and its index at wavelengths.

    Parameters
    ----------
    name
        A resin of the library, or a resin file (ends in .toml or holds a / or a backslash).
    """
    from solen.pipeline.resin import library as pipeline

    return pipeline.show(name, options.at_nm, figure=figure)


def mix(*components: str, options: Annotated[MixOptions, FLAT] = MixOptions()) -> Outcome[Mixtures]:
    """Compute what to weigh in for a mixture, in both readings of its percentages.

    Parameters
    ----------
    components
        Names with their shares of the whole in per cent by weight, the base first: "RA-139:75" "lauryl acrylate:25".
    """
    return Outcome(mixtures(components, options))


@lines.register
def _(facts: ResinFacts) -> Iterator[str]:
    yield facts.name
    yield from (f"  {name}: {words}" for name, words in (("source", facts.source), ("notes", facts.notes)) if words)
    yield from (f"  n at {at.wavelength_nm:g} nm: {_index(at)}" for at in facts.at)
    if facts.index is not None:
        yield f"  index: {', '.join(filter(None, (facts.index.kind, facts.index.mode)))}"
    for name, table in (("loss", facts.loss), ("cure", facts.cure), ("stiffness", facts.stiffness)):
        if table is not None:
            yield f"  {name}:"
            yield from (f"  {line}" for line in listing(_shown(table)))
    if facts.formulation:
        yield "  formulation: " + ", ".join(f"{part.component} {part.wt_percent:g} wt%" for part in facts.formulation)
    yield from map(_source, facts.sources)


def _shown(table: BaseModel) -> dict[str, Any]:
    """The entries of a table that a listing shows, pairs of numbers as text."""
    values = {key: value for key, value in table.model_dump(mode="json").items() if value is not None and value != ""}
    return {key: f"{text(value[0])} to {text(value[1])}" if _is_pair(value) else value for key, value in values.items()}


def _is_pair(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(isinstance(end, float) for end in value)


def _index(at: IndexAt) -> str:
    if at.n is None:
        return "not known"
    return f"{at.n:.5g}" + ("" if at.u_n is None else f" ± {short(at.u_n)}")


def _source(source: Source) -> str:
    checksum = f"sha256 {source.sha256[:12]}…" if source.sha256 else ""
    words = (source.file, source.instrument, source.date, checksum, "simulated" * source.simulated)
    return f"  source of {source.of}: {', '.join(filter(None, words))}"


@lines.register
def _(listing: ResinList) -> Iterator[str]:
    width = max(len(facts.resin) for facts in listing.resins)
    wavelengths = [f"{at.wavelength_nm:g} nm" for at in listing.resins[0].at]
    yield f"  {'':{width}}  {'  '.join(f'{name:>9}' for name in wavelengths)}  mode"
    for facts in listing.resins:
        values = "  ".join(f"{'–' if at.n is None else format(at.n, '.4f'):>9}" for at in facts.at)
        warned = " (see its warning)" if facts.warnings else ""
        mode = facts.index.mode if facts.index is not None else ""
        yield f"  {facts.resin:{width}}  {values}  {mode or 'not stated'}{warned}"


@lines.register
def _(weighed: Mixtures) -> Iterator[str]:
    readings = {
        "read as shares of the whole mixture": weighed.of_whole,
        "read as grams for 100 g of the base": weighed.on_base,
    }
    for reading, mixture in readings.items():
        yield f"{reading}: {mixture.total_g:g} g in all"
        width = max(len(part.name) for part in mixture.components)
        yield from (f"  {part.name:{width}}  {_part(part)}" for part in mixture.components)
        if mixture.index_estimate is not None:
            index = f"{mixture.index_estimate:.4f}"
            yield f"  index of the liquid, an estimate (Lorentz-Lorenz, volumes that add up): {index}"


def _part(part: Weighed) -> str:
    volume = "" if part.volume_mL is None else f"  {part.volume_mL:.4g} mL"
    share = f"{part.wt_percent:.3f} wt%, weighed {part.error_wt_percent:+.3f} ± {part.worst_wt_percent:.3f}"
    return f"{part.weighed_g:10g} g{volume}  {share}  {part.phr:.2f} phr"
