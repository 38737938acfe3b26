"""The figure of a result, chosen by the result's type.

Public names: `plot` and `FIGURES`. Neither the result types nor matplotlib are loaded before a result is drawn.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from solen.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from solen.report.options import FigureOptions

FIGURES = {
    "AsPrinted": "print.as_printed:as_printed_figure",
    "Convergence": "design.figures:convergence_figure",
    "CouponMeasurement": "print.fidelity:fidelity_figure",
    "CouponSet": "print.coupons:plans_figure",
    "Deformation": "design.loaded:deformation_figure",
    "Demodulation": "bench.demodulate:demodulation_figure",
    "DesignReadings": "design.readout:readout_figure",
    "DesignStudy": "design.figures:study_figure",
    "DesignTrace": "design.figures:trace_figure",
    "Export": "print.fabricate:export_figure",
    "ExportedSolid": "print.fabricate:solid_figure",
    "ExposureTrends": "resin.exposures:exposures_figure",
    "FacesInspection": "print.inspect:faces_figure",
    "Front": "explore.optimise:front_figure",
    "GuideLoss": "resin.cutback:cutback_figure",
    "LayerIndex": "resin.index:index_figure",
    "LayeredPrint": "print.layers:layers_figure",
    "Lens": "design.lens:profile_figure",
    "LensCheck": "design.lens:lens_figure",
    "LensInspection": "print.inspect:inspect_figure",
    "Listing": "resin.spectra:spectra_figure",
    "LoadedStudy": "design.loaded:response_figure",
    "MeasuredCurve": "resin.cure:cure_figure",
    "MeasuredStiffness": "resin.stiffness:stiffness_figure",
    "Penetration": "resin.penetration:penetration_figure",
    "Practice": "design.figures:effects_figure",
    "NetworkCalibrations": "bench.network:calibration_figure",
    "NetworkSensitivities": "design.network:slopes_figure",
    "NetworkStates": "bench.network:states_figure",
    "NetworkVolts": "design.readout:network_volts_figure",
    "NetworkStudy": "design.network:network_figure",
    "NetworkTrace": "design.network:network_rays_figure",
    "Optimum": "explore.optimise:optimum_figure",
    "PrintedDesign": "print.predict:prediction_figure",
    "PrintedLayers": "print.printed_layers:layers_figure",
    "PrinterCalibration": "print.calibrate:calibration_figure",
    "RefractometerIndex": "resin.refractometer:refractometer_figure",
    "Resin": "resin.library:index_figure",
    "ResinFacts": "resin.library:facts_figure",
    "Response": "design.figures:sweep_figure",
    "SceneTrace": "design.figures:scene_figure",
    "Sensitivities": "design.sensitivity:sensitivities_figure",
    "Sensor": "design.lens:focus_figure",
    "SensorCalibrations": "bench.calibrate:calibration_figure",
    "SensorDiagnoses": "bench.diagnose:diagnoses_figure",
    "Study": "bench.analyse:study_figure",
    "Sweep": "explore.sweep:sweep_figure",
    "Tolerances": "explore.tolerance:tolerance_figure",
    "TunedPrint": "print.tune:tune_figure",
}
"""Functions of this package that draw a result, keyed by the name of the type of the result."""


def plot(result: Any, options: "FigureOptions | None" = None) -> "Figure":
    """Draw the figure of a result in solen's style; a notebook shows it, ``savefig`` writes it.

    Parameters
    ----------
    result
        Result of a stage or a command.
    options
        Width, lettering, panels and limits of axes; no file is written.

    Raises
    ------
    OutputError
        If no figure exists for this type of result.
    SpecError
        If ``options`` names a panel that does not exist, or a font that is not installed.
    """
    canvas = import_module("solen.report.canvas")
    figure: Figure = canvas.drawn(lambda: figure_of(result), *([] if options is None else [options]))
    return figure


def figure_of(result: Any) -> "Figure":
    """Return the figure as its module draws it, before it is finished for a page; raises as `plot` does."""
    kinds = [kind.__name__ for kind in type(result).__mro__ if kind.__name__ in FIGURES]
    if not kinds:
        limit = f"no figure exists for a {type(result).__name__}"
        raise OutputError("plot", limit=limit, remedy=f"figures exist for {', '.join(FIGURES)}")
    module, _, function = FIGURES[kinds[0]].partition(":")
    figure: Figure = getattr(import_module(f"solen.report.{module}"), function)(result)
    return figure
