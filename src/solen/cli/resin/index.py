"""The command that computes the index of a printed layer from its spectra."""

from collections.abc import Iterable, Iterator

from solen.cli.app import lines, short
from solen.material.index.illuminant import EvaluatedIndex
from solen.material.index.layer import LayerIndex
from solen.pipeline.resin.index import index as index
from solen.results import plain

MAX_ROWS = 12
"""Maximum number of wavelengths printed; JSON and files contain all of them."""


@lines.register
def _(index: LayerIndex) -> Iterator[str]:
    count = index.n.size
    yield (
        f"{index.file}: index by mode {index.mode}{'' if index.measurement else ', NOT A MEASUREMENT'}, "
        f"{count} wavelengths, masked: {index.masked_n} in n, {index.masked_k} in k"
    )
    yield f"  {'nm':>8}  {'n':<18} {'k':<22} {'lossless n':<10}"
    yield from (_row(index, row) for row in range(0, count, max(1, -(-count // MAX_ROWS))))
    if (film := index.interference) is not None:
        optical = ""
        if film.optical_thickness_um is not None:
            optical = f", n times thickness {film.optical_thickness_um:.4f} ± {short(film.u_optical_thickness_um)} µm"
        yield (
            f"layer {film.thickness_um:.2f} ± {short(film.u_thickness_um)} µm thick{optical}, standard deviation of "
            f"the thickness within the beam {film.thickness_spread_percent:.2g} %"
        )
    yield from evaluated_lines(index.at, index.led)
    if index.fit is not None:
        model = plain(index.fit.model)
        names = ("A", "B_um2", "C_um4") if index.fit.kind == "cauchy" else ("B", "C_um2")
        values = ", ".join(f"{name} = {model[name]}" for name in names)
        misfit = "" if index.fit.chi2_reduced is None else f", reduced χ² {index.fit.chi2_reduced:.2f}"
        terms = f"{index.fit.terms} term{'s' if index.fit.terms > 1 else ''}"
        yield f"{index.fit.kind} fit of {terms} through {index.fit.points} points{misfit}: {values}"
        yield from evaluated_lines((*index.fit_at, *filter(None, [index.fit_led])), name=f"{index.fit.kind} fit")


def evaluated_lines(at: Iterable[EvaluatedIndex], led: EvaluatedIndex | None = None, name: str = "at") -> Iterator[str]:
    """Yield a line for n at each wavelength, and for n averaged over the spectrum of an emitter."""
    for label, value in [*((name, evaluated) for evaluated in at), *([(led.source, led)] if led else [])]:
        if value.n is None:
            yield f"{label}: n is unknown: {value.reason}"
        else:
            yield f"{label}, mean wavelength {value.wavelength_nm:g} nm: n = {value.n:.5f} ± {short(value.u_n)}"


def _row(index: LayerIndex, row: int) -> str:
    n, u_n, k, u_k, lossless = (
        plain(values[row]) for values in (index.n, index.u_n, index.k, index.u_k, index.lossless_n)
    )
    n_cell = "masked" if n is None else f"{n:.5f} ± {short(u_n)}"
    k_cell = "masked" if k is None else f"{k:.3e} ± {short(u_k)}"
    reason = f"  {index.reason[row]}" if n is None else ""
    lossless_cell = "none" if lossless is None else f"{lossless:.5f}"
    return f"  {index.wavelength_nm[row]:8g}  {n_cell:<18} {k_cell:<22} {lossless_cell:<10}{reason}".rstrip()
