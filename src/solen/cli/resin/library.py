"""Commands for resins: build a file from results, list and show resins, compute a mixture."""

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import BaseModel

from solen.cli.app import lines, listing, short, text
from solen.material.facts import IndexAt, ResinFacts, ResinList, listed
from solen.material.mix import MixOptions, Mixtures, Weighed, mixtures
from solen.material.resin import Source
from solen.pipeline.options import FLAT
from solen.pipeline.resin.library import build as build
from solen.pipeline.resin.library import show as show
from solen.results import Outcome


def list_() -> Outcome[ResinList]:
    """List the resins shipped with solen, with their indices."""
    return Outcome(listed())


def mix(*components: str, options: Annotated[MixOptions, FLAT] = MixOptions()) -> Outcome[Mixtures]:
    """Compute the masses to weigh for a mixture, for both meanings of its percentages.

    Parameters
    ----------
    components
        Names with their mass fractions in per cent, the base first: "RA-139:75" "lauryl acrylate:25".
    """
    return Outcome(mixtures(components, options))


@lines.register
def _(facts: ResinFacts) -> Iterator[str]:
    yield facts.name
    yield from (f"  {name}: {value}" for name, value in (("source", facts.source), ("notes", facts.notes)) if value)
    yield from (f"  n at {at.wavelength_nm:g} nm: {_index(at)}" for at in facts.at)
    if facts.index is not None:
        yield f"  index: {', '.join(filter(None, (facts.index.kind, facts.index.mode)))}"
    for name, table in (("loss", facts.loss), ("cure", facts.cure), ("stiffness", facts.stiffness)):
        if table is not None:
            yield f"  {name}:"
            yield from (f"  {line}" for line in listing(_entries(table)))
    if facts.formulation:
        yield "  formulation: " + ", ".join(f"{part.component} {part.wt_percent:g} wt%" for part in facts.formulation)
    yield from map(_source, facts.sources)


def _entries(table: BaseModel) -> dict[str, Any]:
    """Return the entries of a table for a listing, with pairs of numbers as strings."""
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
    parts = (source.file, source.instrument, source.date, checksum, "simulated" * source.simulated)
    return f"  source of {source.of}: {', '.join(filter(None, parts))}"


@lines.register
def _(listing: ResinList) -> Iterator[str]:
    width = max(len(facts.resin) for facts in listing.resins)
    wavelengths = [f"{at.wavelength_nm:g} nm" for at in listing.resins[0].at]
    yield f"  {'':{width}}  {'  '.join(f'{name:>9}' for name in wavelengths)}  mode"
    for facts in listing.resins:
        values = "  ".join(f"{'–' if at.n is None else format(at.n, '.4f'):>9}" for at in facts.at)
        suffix = " (see its warning)" if facts.warnings else ""
        mode = facts.index.mode if facts.index is not None else ""
        yield f"  {facts.resin:{width}}  {values}  {mode or 'not specified'}{suffix}"


@lines.register
def _(mixtures: Mixtures) -> Iterator[str]:
    meanings = {
        "percentages of the whole mixture": mixtures.of_whole,
        "grams per 100 g of the base": mixtures.on_base,
    }
    for meaning, mixture in meanings.items():
        yield f"{meaning}: {mixture.total_g:g} g in total"
        width = max(len(part.name) for part in mixture.components)
        yield from (f"  {part.name:{width}}  {_part(part)}" for part in mixture.components)
        if mixture.index_estimate is not None:
            index = f"{mixture.index_estimate:.4f}"
            yield f"  estimated index of the liquid (Lorentz-Lorenz, additive volumes): {index}"


def _part(part: Weighed) -> str:
    volume = "" if part.volume_mL is None else f"  {part.volume_mL:.4g} mL"
    fraction = f"{part.wt_percent:.3f} wt%, weighed {part.error_wt_percent:+.3f} ± {part.worst_wt_percent:.3f}"
    return f"{part.weighed_g:10g} g{volume}  {fraction}  {part.phr:.2f} phr"
