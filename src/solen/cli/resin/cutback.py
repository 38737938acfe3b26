"""The command that finds the loss of a guide."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Out, show


def cutback(
    file: Path,
    /,
    *,
    sheet: str | None = None,
    unit: str | None = None,
    dark: float | None = None,
    launched: float | None = None,
    wavelength_nm: float | None = None,
    keep_all: Annotated[bool, Parameter(negative=())] = False,
    figure: FigureFile = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Find the loss of a guide in dB/cm from the power that guides of several lengths let through.

    Parameters
    ----------
    file
        A table with a row for each reading: length, power, and best also guide and orientation.
    sheet
        Sheet of a workbook; by default the only one with numbers.
    unit
        Unit of the powers, in place of the header's: mW, µW, V, dBm, dB, %, 1 or relative.
    dark
        Reading without light, in that unit. If all readings are below it, light lowers them.
    launched
        What was launched into the guides, in that unit; it tells the coupling loss.
    wavelength_nm
        Wavelength of the light, for the result to state.
    keep_all
        Set no piece aside.
    """
    from solen.pipeline.resin import cutback as pipeline

    found = pipeline.cutback(
        file,
        sheet=sheet,
        unit=unit,
        dark=dark,
        launched=launched,
        wavelength_nm=wavelength_nm,
        keep_all=keep_all,
        figure=figure,
        out=out,
    )
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    low, high = found["interval95"]
    lengths = found["lengths_mm"]
    lines = [
        f"loss {found['loss_dB_per_cm']:.3g} dB/cm ({low:.3g} to {high:.3g}, 95 %), from {found['readings']} readings "
        f"of {found['guides']} guides, {lengths[0]:g} to {lengths[1]:g} mm long",
        *_absorption(found),
        *_coupling(found),
    ]
    for way, one in found["by_orientation"].items():
        ends = one["interval95"]
        lines.append(f"  {way}: {one['loss_dB_per_cm']:.3g} dB/cm ({ends[0]:.3g} to {ends[1]:.3g})")
    layer = found["single_layer"]
    lines.append(
        f"one layer of {layer['thickness_um']:g} µm cannot show this: {100.0 * layer['u_T']:g} % in its transmittance "
        f"is {layer['smallest_loss_dB_per_cm']:.1f} dB/cm"
    )
    lines += [f"warning: {warning}" for warning in found["warnings"]]
    return lines + [f"{name}: {found[name]}" for name in ("figure", "out") if name in found]


def _absorption(found: dict[str, Any]) -> list[str]:
    if found["absorption_per_mm"] is None:
        return ["absorption per mm: none follows from a loss that is not positive"]
    return [f"absorption {found['absorption_per_mm']:.3g} ± {found['u_absorption_per_mm']:.2g} per mm of guide, base e"]


def _coupling(found: dict[str, Any]) -> list[str]:
    if found["coupling_loss_dB"] is None:
        return []
    low, high = found["coupling_interval95_dB"]
    return [f"coupling and ends {found['coupling_loss_dB']:.3g} dB ({low:.3g} to {high:.3g})"]
