"""The command that computes the index of a printed layer from its spectra."""

from collections.abc import Iterable, Iterator

from solen.cli.app import lines, short
from solen.material.index.illuminant import Evaluated
from solen.material.index.layer import LayerIndex
from solen.pipeline.resin.index import index as index
from solen.results import plain

MAX_ROWS = 12
"""Largest number of wavelengths to print; JSON and files contain all."""


@lines.register
def _(index: LayerIndex) -> Iterator[str]:
    count = index.n.size
    yield (
        f"{index.file}: index by mode {index.mode}{'' if index.measurement else ', NO MEASUREMENT'}, "
        f"{count} wavelengths, masked: {index.masked_n} in n, {index.masked_k} in k"
    )
    yield f"  {'nm':>8}  {'n':<18} {'k':<22} {'lossless n':<10}"
    yield from (_row(index, at) for at in range(0, count, max(1, -(-count // MAX_ROWS))))
    if (film := index.interference) is not None:
        optical = ""
        if film.optical_thickness_um is not None:
            optical = f", n times thickness {film.optical_thickness_um:.4f} ± {short(film.u_optical_thickness_um)} µm"
        yield (
            f"layer {film.thickness_um:.2f} ± {short(film.u_thickness_um)} µm thick{optical}, thickness in the beam "
            f"± {film.thickness_spread_percent:.2g} %"
        )
    yield from evaluated_lines(index.at, index.led)
    if index.fit is not None:
        model = plain(index.fit.model)
        names = ("A", "B_um2", "C_um4") if index.fit.kind == "cauchy" else ("B", "C_um2")
        values = ", ".join(f"{name} = {model[name]}" for name in names)
        misfit = "" if index.fit.chi2_reduced is None else f", reduced χ² {index.fit.chi2_reduced:.2f}"
        terms = f"{index.fit.terms} term{'s' if index.fit.terms > 1 else ''}"
        yield f"{index.fit.kind} fit of {terms} through {index.fit.points} points{misfit}: {values}"
        yield from evaluated_lines((*index.fit_at, *filter(None, [index.fit_led])), what=f"{index.fit.kind} fit")


def evaluated_lines(at: Iterable[Evaluated], led: Evaluated | None = None, what: str = "at") -> Iterator[str]:
    """Yield a line for n at each wavelength, and for n averaged over an emitter's spectrum."""
    for name, value in [*((what, each) for each in at), *([(led.source, led)] if led else [])]:
        if value.n is None:
            yield f"{name}: no n, {value.reason}"
        else:
            yield f"{name}, mean wavelength {value.wavelength_nm:g} nm: n = {value.n:.5f} ± {short(value.u_n)}"


def _row(index: LayerIndex, at: int) -> str:
    n, u_n, k, u_k, lossless = (
        plain(values[at]) for values in (index.n, index.u_n, index.k, index.u_k, index.lossless_n)
    )
    shown_n = "masked" if n is None else f"{n:.5f} ± {short(u_n)}"
    shown_k = "masked" if k is None else f"{k:.3e} ± {short(u_k)}"
    reason = f"  {index.reason[at]}" if n is None else ""
    shown_lossless = "none" if lossless is None else f"{lossless:.5f}"
    return f"  {index.wavelength_nm[at]:8g}  {shown_n:<18} {shown_k:<22} {shown_lossless:<10}{reason}".rstrip()
