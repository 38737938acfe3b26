"""The command for the working curve."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.material.cure import MeasuredCurve
from solen.material.cure.discs import LayerExposure, LayerNeed, SpectralExposure
from solen.material.cure.spectral import SpectralFit
from solen.pipeline.resin.cure import cure as cure


@lines.register
def _(curve: MeasuredCurve) -> Iterator[str]:
    yield f"Dp {curve.Dp_um:.4g} µm ({_ends(curve.interval95_Dp_um)}, 95 %)"
    yield f"Ec {curve.Ec_mJ_per_cm2:.3g} mJ/cm² ({_ends(curve.interval95_Ec_mJ_per_cm2)}, 95 %)"
    yield (
        f"from {curve.discs} discs at {curve.doses} doses; discs of {curve.mean_thickness_um:.3g} µm scatter by "
        f"{curve.sd_thickness_um:.2g} µm"
    )
    for other in curve.beside:
        Dp = f"Dp {other.Dp_um:.4g} µm ({_ends(other.interval95_Dp_um)})"
        yield f"{other.file}: {Dp}, Ec {other.Ec_mJ_per_cm2:.3g} mJ/cm²"
    if curve.in_lamp is not None:
        yield from _spectral_law(curve.in_lamp, curve.in_lamp_exposure)
    if curve.layer is not None:
        yield _need(curve.layer)
    if curve.exposure is not None:
        yield from _exposure(curve.exposure)
    if (stack := curve.stack) is not None:
        low, high = stack.interior_range_mJ_per_cm2
        yield (
            f"dose inside the part: {stack.interior_mean_mJ_per_cm2:.3g} ± {curve.u_interior_mean_mJ_per_cm2:.2g} "
            f"mJ/cm² ({low:.3g} to {high:.3g} within a layer), {stack.interior_over_single_layer:.2g} times the "
            f"{stack.single_layer_mean_mJ_per_cm2:.3g} mJ/cm² of a single layer, on which the index is measured; "
            f"the last {stack.layers_to_99_percent} layers receive less than those inside"
        )


def _spectral_law(fit: SpectralFit, exposure: SpectralExposure | None) -> Iterator[str]:
    preference = {
        None: "do not distinguish the two laws",
        "spectrum": "favour this law",
        "Jacobs": "favour Jacobs' law",
    }
    yield (
        f"spectral cure law (lamp: {fit.lamp}): Dp {fit.Dp_um:.4g} ± {fit.u_Dp_um:.2g} µm at the surface, Ec "
        f"{fit.Ec_mJ_per_cm2:.3g} ± {fit.u_Ec_mJ_per_cm2:.1g} mJ/cm²; the discs {preference[fit.preferred]} "
        f"({fit.rms_um:.2g} µm RMS, Jacobs' law {fit.jacobs_rms_um:.2g} µm RMS)"
    )
    if exposure is not None:
        yield (
            f"according to this law, the exposure cures {exposure.cure_depth_um:.3g} µm, the print-through below many "
            f"layers is {exposure.print_through_many_layers_um:.3g} µm, and the dose inside is "
            f"{exposure.interior_mean_mJ_per_cm2:.3g} mJ/cm², {exposure.interior_over_jacobs:.3g} times "
            "that of Jacobs' law"
        )


def _ends(interval: tuple[float, float] | None) -> str:
    return "no interval" if interval is None else f"{interval[0]:.3g} to {interval[1]:.3g}"


def _need(layer: LayerNeed) -> str:
    dose = "too large to compute"
    if layer.needed_mJ_per_cm2 is not None:
        dose = f"{layer.needed_mJ_per_cm2:.3g} mJ/cm² ({_ends(layer.interval95_needed_mJ_per_cm2)})"
    seconds = "" if layer.needed_s is None else f", {layer.needed_s:.2g} s"
    return f"dose to cure {layer.overcure:g} times a layer of {layer.layer_um:g} µm: {dose}{seconds}"


def _exposure(exposure: LayerExposure) -> Iterator[str]:
    yield (
        f"an exposure of {exposure.exposure_s:g} s ({exposure.dose_mJ_per_cm2:.3g} mJ/cm²) cures "
        f"{exposure.cure_depth_um:.3g} µm ({_ends(exposure.interval95_cure_depth_um)}), "
        f"{exposure.cure_depth_layers:.2g} layers; the dose below the layer is {exposure.dose_below_mJ_per_cm2:.3g} "
        f"mJ/cm², {exposure.dose_below_over_Ec:.2g} Ec"
    )
    yield (
        f"print-through into a gap: {exposure.print_through_um:.3g} µm below one layer, "
        f"{exposure.print_through_many_layers_um:.3g} µm below many"
    )
