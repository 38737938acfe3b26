"""The working curve from a table of discs, and the exposures and doses in a print that follow from it.

`curve_of_discs` evaluates a recording with `CureOptions` and returns a `MeasuredCurve`; `curves_of_discs` compares
further recordings with the first.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from solen.material.cure.cautions import cautions
from solen.material.cure.disc_table import DISCS, REPLICATES, THICKNESSES, discs_of
from solen.material.cure.layers import StackDose, dose_below, stack_dose, stack_print_through_um
from solen.material.cure.spectral import SpectralFit
from solen.material.cure.working_curve_fit import Scatter, WorkingCurve, working_curve
from solen.material.rows import REPEATS, RowOptions, chosen_rows, constant_number, refuse_unused, stacked_replicates
from solen.ranks import Caution, do_not_use, prefixed, warning
from solen.recording import Measured, Recording
from solen.results import reported
from solen.spec.strict import Finite, Wavelength, refused

MAX_LAYERS = 100_000
"""Maximum number of layers: more than any printer prints, 1 m in layers of 10 µm."""
PLAUSIBLE_DP_UM = (1.0, 1e4)
"""Range far wider than that of the penetration depths of printable resins; outside it, a unit is probably wrong."""
_MAX_DP_DIFFERENCE = 0.2  # largest relative difference of Dp from discs and from absorbance without a warning


class CureOptions(RowOptions):
    """Options for evaluating discs and the exposure of a part."""

    irradiance_mW_per_cm2: Finite | None = Field(None, gt=0.0)
    """Irradiance at the window; converts exposure times to doses."""
    layer_um: Finite | None = Field(None, gt=0.0)
    """Thickness of a printed layer; adds the required exposure and, with --exposure-s, the effect of that exposure."""
    exposure_s: Finite | None = Field(None, gt=0.0)
    """Exposure time of a layer."""
    overcure: Finite = Field(2.0, gt=0.0)
    """Cure depth for the required exposure, in layer thicknesses."""
    layers: int | None = Field(None, gt=0, le=MAX_LAYERS)
    """Number of layers of the part; default: enough for its interior to reach a constant dose."""
    burn_in_layers: int = Field(0, ge=0)
    """Number of first layers that are exposed for --burn-in-s."""
    burn_in_s: Finite | None = Field(None, gt=0.0)
    """Exposure time of the burn-in layers."""
    min_thickness_um: Finite | None = Field(None, ge=0.0)
    """Omit doses whose discs have a lower mean thickness."""
    scatter: Scatter = "auto"
    """Scatter of the discs: proportional to their thickness, constant, or estimated (auto)."""
    keep_all: bool = False
    """Include outliers in the fit."""
    wavelength_nm: Wavelength | None = None
    """Wavelength of the lamp, stored in the result; default: that of the table, if it is the same in all rows."""

    @model_validator(mode="after")
    def _check_exposure(self) -> Self:
        if self.exposure_s is not None and self.layer_um is None:
            raise refused("exposure_s", "requires the layer thickness", remedy="add --layer-um")
        if self.exposure_s is not None and self.irradiance_mW_per_cm2 is None:
            raise refused("exposure_s", "requires the irradiance", remedy="add --irradiance-mW-per-cm2")
        if (self.layers is not None or self.burn_in_layers) and self.exposure_s is None:
            name = "layers" if self.layers is not None else "burn_in_layers"
            raise refused(name, "requires --exposure-s", remedy="add --exposure-s")
        if (self.burn_in_layers > 0) != (self.burn_in_s is not None):
            missing = "--burn-in-layers" if self.burn_in_layers == 0 else "--burn-in-s"
            limit = "--burn-in-layers above 0 and --burn-in-s must be specified together"
            raise refused("burn_in_layers", limit, value=self.burn_in_layers, remedy=f"add {missing}")
        if self.layers is not None and self.burn_in_layers > self.layers:
            raise refused("burn_in_layers", f"must be at most --layers, {self.layers}", value=self.burn_in_layers)
        return self

    @property
    def dose_mJ_per_cm2(self) -> float | None:
        """Dose of one exposure of a layer."""
        if self.exposure_s is None or self.irradiance_mW_per_cm2 is None:
            return None
        return self.exposure_s * self.irradiance_mW_per_cm2


@dataclass(frozen=True)
class LayerNeed:
    """Exposure that cures resin to a multiple of the layer thickness.

    Attributes
    ----------
    layer_um, overcure
        Layer thickness, and cure depth in layer thicknesses.
    needed_mJ_per_cm2, interval95_needed_mJ_per_cm2
        Required dose and its 95 % interval; None if the dose overflows or has no interval.
    needed_s, interval95_needed_s
        Required exposure time and its 95 % interval; None without an irradiance, or if the dose is None.
    """

    layer_um: float
    overcure: float
    needed_mJ_per_cm2: float | None
    interval95_needed_mJ_per_cm2: tuple[float, float] | None
    needed_s: float | None
    interval95_needed_s: tuple[float, float] | None


@dataclass(frozen=True)
class LayerExposure:
    """Effect of the exposure of a layer.

    Attributes
    ----------
    exposure_s, dose_mJ_per_cm2
        Exposure time and dose of the layer, at the window.
    cure_depth_um, interval95_cure_depth_um, cure_depth_layers
        Cure depth, its 95 % interval, and the cure depth in layer thicknesses.
    dose_below_mJ_per_cm2, dose_below_over_Ec
        Dose at the far side of the layer, in mJ/cm² and relative to the critical dose.
    print_through_um, print_through_many_layers_um
        Depth to which resin cures into a gap beyond a single layer, and beyond many layers.
    """

    exposure_s: float
    dose_mJ_per_cm2: float
    cure_depth_um: float
    interval95_cure_depth_um: tuple[float, float]
    cure_depth_layers: float
    dose_below_mJ_per_cm2: float
    dose_below_over_Ec: float
    print_through_um: float
    print_through_many_layers_um: float


@dataclass(frozen=True)
class SpectralExposure:
    """Effect of the exposure of a layer according to the spectral cure law, for comparison with Jacobs' law.

    Attributes
    ----------
    cure_depth_um, print_through_many_layers_um, interior_mean_mJ_per_cm2
        The quantities of `LayerExposure` and `StackDose`, computed with the spectral cure law.
    interior_over_jacobs
        Ratio of the interior mean dose to its value from Jacobs' law.
    """

    cure_depth_um: float
    print_through_many_layers_um: float
    interior_mean_mJ_per_cm2: float
    interior_over_jacobs: float


class ComparedCurve(WorkingCurve, Measured, kw_only=True):
    """Working curve from another table, for comparison with the first.

    Attributes
    ----------
    file
        Name of the table.
    """

    file: str


class MeasuredCurve(WorkingCurve, Measured, kw_only=True):
    """Working curve from a table of discs, with exposures and doses in a print.

    Attributes
    ----------
    irradiance_mW_per_cm2, wavelength_nm
        Irradiance and wavelength of the lamp; None if not specified.
    layer, exposure, stack
        Exposure that a layer needs, effect of the chosen exposure, and the dose inside a part; None if not requested.
    beside
        Working curves from further tables, for example of other resins.
    in_lamp, in_lamp_exposure
        The spectral cure law, for the spectrum of the lamp, and the effect of the exposure of a layer according to this
        law; None if not requested.
    """

    irradiance_mW_per_cm2: float | None
    wavelength_nm: float | None
    layer: LayerNeed | None
    exposure: LayerExposure | None
    stack: StackDose | None
    beside: tuple[ComparedCurve, ...] = ()
    in_lamp: SpectralFit | None = None
    in_lamp_exposure: SpectralExposure | None = None

    @reported
    def u_interior_mean_mJ_per_cm2(self) -> float | None:
        """Standard uncertainty of the mean dose inside the part, propagated from the penetration depth."""
        return None if self.stack is None else self.stack.interior_mean_mJ_per_cm2 * self.u_Dp_um / self.Dp_um


def curve_of_discs(recording: Recording, options: CureOptions = CureOptions()) -> MeasuredCurve:
    """Return the working curve of discs and, if a layer is specified, its exposure and dose.

    Parameters
    ----------
    recording
        Table with a column of thicknesses and a column of doses or times.
    options
        Options of the evaluation; the irradiance converts times to doses.

    Raises
    ------
    DataError
        If the table lacks these columns, or they determine no curve.
    """
    recording = stacked_replicates(chosen_rows(recording, options), THICKNESSES, (*DISCS, *REPLICATES))
    discs = discs_of(recording, options.irradiance_mW_per_cm2)
    notes = refuse_unused(recording, options, (*discs.columns, *REPEATS))
    curve = working_curve(
        discs.dose,
        discs.thickness_um,
        scatter=options.scatter,
        min_thickness_um=options.min_thickness_um,
        keep_all=options.keep_all,
        rows=discs.rows,
    )
    exposure = _exposure(curve, options)
    return MeasuredCurve(
        **vars(curve),
        irradiance_mW_per_cm2=options.irradiance_mW_per_cm2,
        wavelength_nm=options.wavelength_nm or constant_number(recording, ("wavelength",), "nm"),
        layer=_need(curve, options),
        exposure=exposure,
        stack=None if exposure is None else _stack(curve.Dp_um, options),
        sources=(recording.provenance,),
        warnings=(
            *_implausible(curve),
            *(channel.caution for channel in recording.channels if channel.note and channel.name in discs.columns),
            *notes,
            *discs.warnings,
            *cautions(curve),
            *_exposure_warnings(curve, options.layer_um, exposure),
        ),
    )


def curves_of_discs(recordings: Sequence[Recording], options: CureOptions = CureOptions()) -> MeasuredCurve:
    """Return the curve of the first recording, as from `curve_of_discs`, with the other curves for comparison."""
    first, *others = (curve_of_discs(recording, options) for recording in recordings)
    fields = [field.name for field in dataclasses.fields(ComparedCurve) if field.name != "file"]
    compared = tuple(
        ComparedCurve(**{name: getattr(curve, name) for name in fields}, file=curve.sources[0].file) for curve in others
    )
    warnings = (*first.warnings, *(prefixed(curve.file, text) for curve in compared for text in curve.warnings))
    sources = (*first.sources, *(source for curve in compared for source in curve.sources))
    return dataclasses.replace(first, beside=compared, warnings=warnings, sources=sources)


def with_spectral_law(curve: MeasuredCurve, fit: SpectralFit) -> MeasuredCurve:
    """Return the curve with the spectral cure law, and the effect of an exposure according to this law."""
    exposure = None
    if curve.exposure is not None and curve.layer is not None:
        dose, layer_um = curve.exposure.dose_mJ_per_cm2, curve.layer.layer_um
        interior = fit.interior_mean_mJ_per_cm2(dose, layer_um)
        exposure = SpectralExposure(
            cure_depth_um=float(fit.depth_um(dose)),
            print_through_many_layers_um=max(fit.print_through_um(dose, layer_um), 0.0),
            interior_mean_mJ_per_cm2=interior,
            interior_over_jacobs=interior * layer_um / (dose * curve.Dp_um),
        )
    warnings = []
    if fit.preferred == "spectrum":
        warnings = [
            warning(
                f"the discs agree better with the cure law for the lamp's spectrum ({fit.rms_um:.2g} µm RMS) than with "
                f"Jacobs' law ({fit.jacobs_rms_um:.2g} µm RMS): Dp is {fit.Dp_um:.3g} µm at the surface and grows with "
                f"depth; the {curve.Dp_um:.3g} µm of Jacobs' law are valid only for discs of these thicknesses"
            )
        ]
    difference_um = abs(fit.Dp_um - fit.liquid_Dp_um)
    if difference_um > max(_MAX_DP_DIFFERENCE * fit.liquid_Dp_um, 3.0 * fit.u_Dp_um):
        warnings.append(
            warning(
                f"Dp at the surface is {fit.Dp_um:.3g} µm from the discs and {fit.liquid_Dp_um:.3g} µm from the "
                "absorbance of the liquid: check the path length of the cell, the lamp's spectrum and the irradiance"
            )
        )
    return dataclasses.replace(curve, in_lamp=fit, in_lamp_exposure=exposure, warnings=(*curve.warnings, *warnings))


def _need(curve: WorkingCurve, options: CureOptions) -> LayerNeed | None:
    if options.layer_um is None:
        return None
    depth_um, irradiance = options.overcure * options.layer_um, options.irradiance_mW_per_cm2
    dose, interval = curve.dose_mJ_per_cm2(depth_um), curve.dose_interval95(depth_um)
    has_time = irradiance is not None and math.isfinite(dose)
    return LayerNeed(
        layer_um=options.layer_um,
        overcure=options.overcure,
        needed_mJ_per_cm2=dose if math.isfinite(dose) else None,
        interval95_needed_mJ_per_cm2=interval,
        needed_s=dose / irradiance if has_time and irradiance else None,
        interval95_needed_s=(interval[0] / irradiance, interval[1] / irradiance)
        if has_time and irradiance and interval
        else None,
    )


def _exposure(curve: WorkingCurve, options: CureOptions) -> LayerExposure | None:
    dose = options.dose_mJ_per_cm2
    if dose is None or options.layer_um is None or options.exposure_s is None:
        return None
    depth, half = float(curve.depth_um(dose)), float(curve.half_width_um(dose))
    below = float(dose_below(dose, options.layer_um, curve.Dp_um))
    print_through = stack_print_through_um(dose, options.layer_um, curve.Dp_um, curve.Ec_mJ_per_cm2)
    return LayerExposure(
        exposure_s=options.exposure_s,
        dose_mJ_per_cm2=dose,
        cure_depth_um=depth,
        interval95_cure_depth_um=(depth - half, depth + half),
        cure_depth_layers=depth / options.layer_um,
        dose_below_mJ_per_cm2=below,
        dose_below_over_Ec=below / curve.Ec_mJ_per_cm2,
        print_through_um=max(depth - options.layer_um, 0.0),
        print_through_many_layers_um=max(print_through, 0.0),
    )


def _stack(Dp_um: float, options: CureOptions) -> StackDose | None:
    """Return the dose inside a part, by default with enough layers for a constant interior dose."""
    if options.layer_um is None or options.exposure_s is None or options.irradiance_mW_per_cm2 is None:
        return None
    settled = stack_dose(Dp_um, options.layer_um, [1.0]).layers_to_99_percent
    seconds = np.full(options.layers or options.burn_in_layers + max(3 * settled, 20), options.exposure_s)
    seconds[: options.burn_in_layers] = options.burn_in_s or options.exposure_s
    return stack_dose(Dp_um, options.layer_um, seconds * options.irradiance_mW_per_cm2)


def _implausible(curve: WorkingCurve) -> list[Caution]:
    """Return a warning if a unit is probably wrong."""
    low, high = PLAUSIBLE_DP_UM
    if low <= curve.Dp_um <= high:
        return []
    for factor, mistake in ((1e3, "values in mm under a header in µm"), (1e-3, "values in µm under a header in mm")):
        if low <= factor * curve.Dp_um <= high:
            return [
                do_not_use(
                    f"the thicknesses look like {mistake}: Dp would be {factor * curve.Dp_um:.3g} µm instead of "
                    f"{curve.Dp_um:.3g} µm, which no printable resin has; correct the header"
                )
            ]
    return [
        do_not_use(
            f"Dp = {curve.Dp_um:.3g} µm is implausible for a printable resin (tens to hundreds of µm): check the unit "
            "of the thickness in the header of the table"
        )
    ]


def _exposure_warnings(curve: WorkingCurve, layer_um: float | None, exposure: LayerExposure | None) -> list[Caution]:
    """Return warnings if the exposure is outside the range of the discs' doses, or may not cure through the layer."""
    if exposure is None or layer_um is None:
        return []
    warnings, dose, (lowest, highest) = [], exposure.dose_mJ_per_cm2, curve.dose_range_mJ_per_cm2
    if not lowest <= dose <= highest:
        warnings.append(
            warning(
                f"an exposure of {dose:.3g} mJ/cm² is outside the doses of the discs, {lowest:.3g} to {highest:.3g} "
                "mJ/cm²: its cure depth is an extrapolation"
            )
        )
    low, _ = exposure.interval95_cure_depth_um
    if low < layer_um:
        warnings.append(
            warning(
                f"an exposure of {exposure.exposure_s:g} s cures {exposure.cure_depth_um:.3g} ± "
                f"{exposure.cure_depth_um - low:.2g} µm: a layer of {layer_um:g} µm may not bond "
                "to the previous one"
            )
        )
    return warnings
