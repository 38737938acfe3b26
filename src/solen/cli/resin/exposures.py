"""The command of layers against their exposure."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Out, show


def exposures(
    files: Annotated[list[Path], Parameter(negative=())],
    /,
    *,
    wavelength_nm: Annotated[list[float] | None, Parameter(negative=())] = None,
    irradiance_mW_per_cm2: Annotated[float | None, Parameter(name="--irradiance-mW-per-cm2")] = None,
    thickness_um: float | None = None,
    sheet: str | None = None,
    figure: FigureFile = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Show how the transmittance of layers changes with their exposure, and the index where R was measured.

    Parameters
    ----------
    files
        Spectra whose traces, or files, are named by their exposure ("2 s"), or tables of exposure_s, wavelength_nm, T.
    wavelength_nm
        A wavelength to look at; repeatable. By default 450, 500 and 860 nm.
    irradiance_mW_per_cm2
        Irradiance at the window; makes doses of the exposures.
    thickness_um
        Thickness of the layers; the index needs it.
    sheet
        Sheet of a workbook; by default the only one with numbers.
    """
    from solen.pipeline.resin import exposures as pipeline

    found = pipeline.exposures(
        files,
        wavelengths_nm=tuple(wavelength_nm or ()),
        irradiance_mW_per_cm2=irradiance_mW_per_cm2,
        thickness_um=thickness_um,
        sheet=sheet,
        figure=figure,
        out=out,
    )
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    lines = ["exposure (s)  " + "  ".join(f"{seconds:7g}" for seconds in found["exposure_s"])]
    for row in found["wavelengths"]:
        lines.append(f"T {row['wavelength_nm']:7g} nm  " + "  ".join(f"{value:7.4f}" for value in row["T"]))
        lines.append(f"    {_slope(row['trend_T_per_s'], 'T')}")
        if row["trend_n_per_s"] is not None:
            values = ("      -" if value is None else f"{value:7.4f}" for value in row["n"])
            lines.append(f"n {row['wavelength_nm']:7g} nm  " + "  ".join(values))
            lines.append(f"    {_slope(row['trend_n_per_s'], 'n')}")
    lines += [f"warning: {warning}" for warning in found["warnings"]]
    return lines + [f"{name}: {found[name]}" for name in ("figure", "out") if name in found]


def _slope(trend: dict[str, Any], name: str) -> str:
    ends = trend["interval95"]
    told = "no interval from two samples" if ends is None else f"{ends[0]:+.2g} to {ends[1]:+.2g}, 95 %"
    return f"{name} changes by {trend['slope']:+.3g} per s ({told})"
