"""The figure of a predicted print: deviation from the designed lens, walls or layer steps, and response."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.fabricate.process import PrintedDesign
from solen.report.canvas import INK, LEFT, LOST, RIGHT, series
from solen.sensor.print_loss import PrintLoss

EXAGGERATION = 10.0


def prediction_figure(prediction: PrintedDesign) -> Figure:
    """Draw the outline, the deviation, the walls or layer steps, and the contrast."""
    figure = Figure(figsize=(9.6, 7.2))
    (outline, deviation), (layers, response) = figure.subplots(2, 2)
    _outline(outline, prediction)
    _deviation(deviation, prediction)
    (_walls if prediction.walls is not None else _steps)(layers, prediction)
    _response(response, prediction.response)
    figure.suptitle(
        f"simulated: {prediction.name}, printed {prediction.orientation} ({prediction.process}), deviation "
        f"{prediction.deviation.rms_um:.3g} µm RMS, largest {prediction.deviation.largest_um:+.3g} µm",
    )
    return figure


def _outline(axes: Axes, prediction: PrintedDesign) -> None:
    target, compensation = prediction.deviation.target, prediction.compensation
    axes.plot(*target.points_mm.T, color=INK, lw=3.0, alpha=0.5, label="intended")
    axes.plot(*target.displaced(EXAGGERATION * prediction.deviation.um).T, **series(1), lw=1.2, label="printed")
    if compensation is not None:
        drawn, printed = compensation.drawn_um, compensation.printed.um
        axes.plot(*target.displaced(EXAGGERATION * drawn).T, **series(2), lw=1.2, label="compensated drawing")
        axes.plot(*target.displaced(EXAGGERATION * printed).T, color=RIGHT, lw=1.2, label="printed, compensated")
    axes.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal")
    axes.set_title(f"lens, with deviations times {EXAGGERATION:g}")
    axes.legend()


def _deviation(axes: Axes, prediction: PrintedDesign) -> None:
    x, um, u_um = prediction.deviation.target.points_mm[:, 0], prediction.deviation.um, prediction.lens.u_um
    axes.axhline(0.0, color=LOST, lw=1.0)
    axes.fill_between(x, um - 2 * u_um, um + 2 * u_um, color=LEFT, alpha=0.2, lw=0, label="± 2 u")
    if np.any(prediction.lens.ripple_um):
        axes.plot(x, um + prediction.lens.ripple_um, color=LOST, lw=0.6, label="with layer steps")
    axes.plot(x, um, **series(1), lw=1.4, label=f"printed, {prediction.deviation.rms_um:.3g} µm RMS")
    if prediction.compensation is not None:
        printed = prediction.compensation.printed
        axes.plot(x, printed.um, color=RIGHT, lw=1.4, label=f"compensated, {printed.rms_um:.2g} µm RMS")
    axes.set(xlabel="x on the designed lens (mm)", ylabel="deviation from the design (µm)")
    axes.set_title("deviation along the normal, positive outwards")
    axes.legend()


def _walls(axes: Axes, prediction: PrintedDesign) -> None:
    if prediction.walls is not None:
        axes.plot(prediction.walls.beyond_um, 1e-3 * prediction.walls.height_um, ".-", ms=3, lw=0.8, color=RIGHT)
    axes.set(xlabel="growth of a straight wall (µm)", ylabel="height above the plate (mm)")
    axes.set_title("growth of walls, without shrinkage")


def _steps(axes: Axes, prediction: PrintedDesign) -> None:
    axes.plot(prediction.deviation.target.along_mm, prediction.lens.ripple_um, color=RIGHT, lw=0.8)
    axes.set(xlabel="position along the lens (mm)", ylabel="layer steps (µm)")
    axes.set_title("layer steps, not included in the traced profile")


def _response(axes: Axes, response: PrintLoss | None) -> None:
    if response is None:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no response was traced", ha="center", va="center", color=LOST)
        return
    for emitter, style in ((response.own, "-"), (response.chip, "--")):
        if emitter is None:
            continue
        width = "a point" if emitter.width_mm == 0.0 else f"{emitter.width_mm:g} mm"
        for name, colour, contrast, slope in (
            ("designed", INK, emitter.contrast_designed, emitter.slope_designed_per_deg),
            ("printed", LEFT, emitter.contrast_printed, emitter.slope_printed_per_deg),
        ):
            label = f"{name}, {width}" + ("" if slope is None else f", {slope:.2g}/° at 0°")
            axes.plot(emitter.angle_deg, contrast, style, marker=".", ms=4, lw=1.2, color=colour, label=label)
    axes.set(xlabel="angle (deg)", ylabel="contrast (R − L)/(R + L)")
    axes.set_title("response with the designed and the printed lens")
    axes.legend()
