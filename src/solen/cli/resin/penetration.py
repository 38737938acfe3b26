"""The command of the penetration depth, from an absorbance spectrum."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Out, show


def penetration(
    file: Path,
    /,
    *,
    path_um: float,
    led: str | None = None,
    led_nm: float | None = None,
    led_fwhm_nm: float | None = None,
    u_path_um: float | None = None,
    u_absorbance: float | None = None,
    absorbance: Annotated[list[str] | None, Parameter(negative=())] = None,
    sheet: str | None = None,
    figure: FigureFile = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Find the penetration depth of a resin from its absorbance, Dp = path / (A ln 10), in a lamp's light.

    Parameters
    ----------
    file
        A spectrum of the liquid resin: absorbance, base 10, or transmittance.
    path_um
        Path of the light through the resin.
    led
        The printer's lamp: a part of the library, a part's .toml, or a file of a measured spectrum.
    led_nm
        Its peak, in place of --led.
    led_fwhm_nm
        Its full width at half of the peak; without it one wavelength is meant.
    u_path_um
        Standard uncertainty of the path.
    u_absorbance
        Standard uncertainty of the absorbance, the same way at all wavelengths.
    absorbance
        Name of a trace, where there are several; repeatable, and those named are averaged.
    sheet
        Sheet of a workbook; by default the only one with numbers.
    """
    from solen.pipeline.resin import penetration as pipeline

    found = pipeline.penetration(
        file,
        path_um=path_um,
        lamp=pipeline.Lamp(led, led_nm, led_fwhm_nm),
        u_path_um=u_path_um,
        u_absorbance=u_absorbance,
        traces=tuple(absorbance or ()),
        sheet=sheet,
        figure=figure,
        out=out,
    )
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    lines = []
    if found["lamp"] is not None:
        u = "" if found["u_Dp_um"] is None else f" ± {found['u_Dp_um']:.2g}"
        between = found["between"]
        lines.append(f"Dp {found['Dp_um']:.4g}{u} µm at the surface, in the light of {found['lamp']['source']}")
        lines.append(
            f"Dp {between['Dp_um']:.4g} µm between {between['from_um']:g} and {between['to_um']:g} µm, as a working "
            "curve of such discs has it"
        )
    known = [value for value in found["Dp_spectrum_um"] if value is not None]
    if known:
        at = found["wavelength_nm"][found["Dp_spectrum_um"].index(min(known))]
        lines.append(f"shortest: {min(known):.4g} µm, at {at:g} nm")
    lines += [f"warning: {warning}" for warning in found["warnings"]]
    return lines + [f"{name}: {found[name]}" for name in ("figure", "out") if name in found]
