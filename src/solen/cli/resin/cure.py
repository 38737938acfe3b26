"""The command of the working curve."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Out, show

Irradiance = Annotated[float | None, Parameter(name="--irradiance-mW-per-cm2")]


def cure(
    file: Path,
    /,
    *,
    irradiance_mW_per_cm2: Irradiance = None,
    layer_um: float | None = None,
    exposure_s: float | None = None,
    overcure: float = 2.0,
    layers: int | None = None,
    burn_in_layers: int = 0,
    burn_in_s: float | None = None,
    min_thickness_um: float | None = None,
    scatter: str = "auto",
    keep_all: Annotated[bool, Parameter(negative=())] = False,
    wavelength_nm: float | None = None,
    sheet: str | None = None,
    figure: FigureFile = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Fit the working curve of a resin, Dc = Dp ln(E/Ec), and say what it means for a print in layers.

    Parameters
    ----------
    file
        A table with a row for each cured disc: thickness, and dose or time.
    irradiance_mW_per_cm2
        Irradiance at the window; makes doses of times.
    layer_um
        Thickness of a printed layer: which exposure it needs, and with --exposure-s what that does.
    exposure_s
        Exposure of a layer.
    overcure
        Cure depth to find the exposure for, in thicknesses of a layer.
    layers
        Number of layers of the part; by default enough for it to have an inside.
    burn_in_layers
        How many of them, first, are exposed for --burn-in-s.
    burn_in_s
        Exposure of these.
    min_thickness_um
        Leave out doses whose discs are thinner on average.
    scatter
        How discs scatter: proportional (as a share of their thickness), constant, or auto, to be found.
    keep_all
        Set no disc aside.
    wavelength_nm
        Wavelength of the lamp, for the result to state.
    sheet
        Sheet of a workbook; by default the only one with numbers.
    """
    from solen.pipeline.resin import cure as pipeline

    how = pipeline.Print(irradiance_mW_per_cm2, layer_um, exposure_s, overcure, layers, burn_in_layers, burn_in_s)
    found = pipeline.cure(
        file,
        how=how,
        sheet=sheet,
        scatter=scatter,
        min_thickness_um=min_thickness_um,
        keep_all=keep_all,
        wavelength_nm=wavelength_nm,
        figure=figure,
        out=out,
    )
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    ends = found["interval95"]
    scatter = found["scatter"]
    return [
        f"Dp {found['Dp_um']:.4g} µm ({_ends(ends['Dp_um'])}, 95 %)",
        f"Ec {found['Ec_mJ_per_cm2']:.3g} mJ/cm² ({_ends(ends['Ec_mJ_per_cm2'])}, 95 %)",
        f"from {found['discs']} discs at {found['doses']} doses; discs of {scatter['at_um']:.3g} µm scatter by "
        f"{scatter['um']:.2g} µm",
        *(_layer(found["layer"]) if found["layer"] else []),
        *(_stack(found["stack"]) if found["stack"] else []),
        *(f"warning: {warning}" for warning in found["warnings"]),
        *(f"{name}: {found[name]}" for name in ("figure", "out") if name in found),
    ]


def _ends(interval: list[float] | None) -> str:
    return "no interval" if interval is None else f"{interval[0]:.3g} to {interval[1]:.3g}"


def _layer(layer: dict[str, Any]) -> list[str]:
    dose = layer["needed_mJ_per_cm2"]
    ends = _ends(layer["needed_interval95_mJ_per_cm2"])
    needs = "more than can be told" if dose is None else f"{dose:.3g} mJ/cm² ({ends})"
    seconds = f", {layer['needed_s']:.2g} s" if "needed_s" in layer else ""
    lines = [f"{layer['layer_um']:g} µm cured {layer['overcure']:g} times over need {needs}{seconds}"]
    if "dose_mJ_per_cm2" in layer:
        lines.append(
            f"{layer['exposure_s']:g} s ({layer['dose_mJ_per_cm2']:.3g} mJ/cm²) cure {layer['cure_depth_um']:.3g} µm "
            f"({_ends(layer['cure_depth_interval95_um'])}), {layer['cure_depth_in_layers']:.2g} layers; below the "
            f"layer {layer['dose_below_mJ_per_cm2']:.3g} mJ/cm² are left, {layer['dose_below_over_Ec']:.2g} Ec"
        )
        lines.append(
            f"print-through into a gap: {layer['print_through_um']:.3g} µm below one layer, "
            f"{layer['print_through_many_layers_um']:.3g} µm below many"
        )
    return lines


def _stack(stack: dict[str, Any]) -> list[str]:
    low, high = stack["interior_range_mJ_per_cm2"]
    return [
        f"dose inside the part: {stack['interior_mean_mJ_per_cm2']:.3g} ± {stack['u_interior_mean_mJ_per_cm2']:.2g} "
        f"mJ/cm² ({low:.3g} to {high:.3g} within a layer), {stack['interior_over_single_layer']:.2g} times the "
        f"{stack['single_layer_mean_mJ_per_cm2']:.3g} mJ/cm² of one layer on its own, as the index is measured on; the "
        f"last {stack['layers_to_99_percent']} layers get less than those inside"
    ]
