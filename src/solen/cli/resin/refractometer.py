"""The command of a refractometer: from an index at one wavelength or a few to n against wavelength."""

from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Out, short, show

Numbers = Annotated[list[float] | None, Parameter(negative=())]


def refractometer(
    n: list[float],
    /,
    *,
    u: Annotated[list[float], Parameter(negative=())],
    wavelength_nm: Numbers = None,
    u_shared: float = 0.0,
    u_temperature_k: float = 0.0,
    dn_dt_per_k: float | None = None,
    polymer: Annotated[list[str] | None, Parameter(negative=())] = None,
    abbe: float | None = None,
    u_abbe: float | None = None,
    at_nm: Numbers = None,
    led: str | None = None,
    figure: FigureFile = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Find n against wavelength from what a refractometer or an ellipsometer measured, and what polymers share.

    Parameters
    ----------
    n
        Measured index, or indices at several wavelengths.
    u
        Its standard uncertainty; one for all, or --u once for each.
    wavelength_nm
        Wavelength of each, 589.3 (the sodium line) where one index is given; repeatable.
    u_shared
        Standard uncertainty that all values share, of the calibration.
    u_temperature_k
        Standard uncertainty of the temperature in use, about that of the measurement, in K.
    dn_dt_per_k
        Temperature coefficient of n that it is multiplied with; −2e-4 where not stated.
    polymer
        A class that the material is like: acrylate, photoresin, silicone or aromatic; repeatable. Acrylate and
        photoresin where not stated.
    abbe
        Abbe number of the material, from a data sheet say, in place of that of the class.
    u_abbe
        Its standard uncertainty.
    at_nm
        A wavelength at which n is told; repeatable.
    led
        An emitter at whose light n is told: a part of the library, a part's .toml, or a file of a measured spectrum.
    """
    from solen.pipeline.resin import refractometer as pipeline

    options = pipeline.RefractometerOptions(
        n=tuple(n),
        u=tuple(u),
        wavelength_nm=tuple(wavelength_nm or ()),
        u_shared=u_shared,
        u_temperature_k=u_temperature_k,
        dn_dt_per_k=dn_dt_per_k,
        polymers=tuple(polymer or ()),
        abbe=abbe,
        u_abbe=u_abbe,
        at_nm=tuple(at_nm or ()),
        led=led,
    )
    found = pipeline.refractometer(options, out=out, figure=figure)
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    shape, line = found["dispersion"], found["line"]
    lines = [
        f"index from {len(found['values']['n'])} measured and the dispersion of polymers",
        f"  n_D (589.3 nm)  {line['n']:.5f} ± {short(line['u_n'])}",
        f"  Abbe number     {shape['abbe']:.1f} ± {shape['u_abbe']:.1f}",
    ]
    wanted = {450, 500, 650, 750, 860, 950}
    for nm, n, u_n in zip(found["wavelength_nm"], found["n"], found["u_n"], strict=True):
        if nm in wanted:
            lines.append(f"  {nm:6g} nm       {n:.5f} ± {short(u_n)}")
    lines += [_evaluated("at", one) for one in found["at"]]
    if found["led"] is not None:
        lines.append(_evaluated(found["led"]["source"], found["led"]))
    lines += [f"warning: {told}" for told in found["warnings"]]
    return lines + [f"{kind}: {found[kind]}" for kind in ("figure", "out") if kind in found]


def _evaluated(what: str, one: dict[str, Any]) -> str:
    if one["n"] is None:
        return f"{what}: no n, {one['reason']}"
    return f"{what}, mean wavelength {one['wavelength_nm']:g} nm: n = {one['n']:.5f} ± {short(one['u_n'])}"
