"""The figure of a predicted print: deviation from the designed lens, walls or steps, and response."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.fabricate.process import PrintedDesign
from solen.report.canvas import INK, LEFT, LOST, RIGHT, series
from solen.sensor.print_loss import PrintLoss

_EXAGGERATED = 10.0
_BAND = 0.2


def printed_figure(prediction: PrintedDesign) -> Figure:
    """Draw outline and deviation, walls or steps, and the contrast if it was traced."""
    figure = Figure(figsize=(9.6, 7.2))
    (outline, deviation), (through, response) = figure.subplots(2, 2)
    _outline(outline, prediction)
    _deviation(deviation, prediction)
    (_walls if prediction.walls is not None else _steps)(through, prediction)
    _response(response, prediction.response)
    figure.suptitle(
        f"simulated: {prediction.name}, printed {prediction.orientation} ({prediction.process}), off by "
        f"{prediction.deviation.rms_um:.3g} µm rms, largest {prediction.deviation.largest_um:+.3g} µm",
    )
    return figure


def _outline(axes: Axes, prediction: PrintedDesign) -> None:
    target, made = prediction.deviation.target, prediction.compensation
    axes.plot(*target.points_mm.T, color=INK, lw=3.0, alpha=0.5, label="wanted")
    axes.plot(*target.displaced(_EXAGGERATED * prediction.deviation.um).T, **series(1), lw=1.2, label="printed")
    if made is not None:
        axes.plot(*target.displaced(_EXAGGERATED * made.drawn_um).T, **series(2), lw=1.2, label="to draw")
        axes.plot(*target.displaced(_EXAGGERATED * made.printed.um).T, color=RIGHT, lw=1.2, label="printed then")
    axes.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal")
    axes.set_title(f"the lens, deviations drawn {_EXAGGERATED:g} times")
    axes.legend()


def _deviation(axes: Axes, prediction: PrintedDesign) -> None:
    x, um, u_um = prediction.deviation.target.points_mm[:, 0], prediction.deviation.um, prediction.lens.u_um
    axes.axhline(0.0, color=LOST, lw=1.0)
    axes.fill_between(x, um - 2 * u_um, um + 2 * u_um, color=LEFT, alpha=_BAND, lw=0, label="± 2 u")
    if np.any(prediction.lens.ripple_um):
        axes.plot(x, um + prediction.lens.ripple_um, color=LOST, lw=0.6, label="with its steps")
    axes.plot(x, um, **series(1), lw=1.4, label=f"printed, {prediction.deviation.rms_um:.3g} µm rms")
    if prediction.compensation is not None:
        printed = prediction.compensation.printed
        axes.plot(x, printed.um, color=RIGHT, lw=1.4, label=f"compensated, {printed.rms_um:.2g} µm rms")
    axes.set(xlabel="x on the designed lens (mm)", ylabel="beyond the designed lens (µm)")
    axes.set_title("deviation along the normal (positive: more material)")
    axes.legend()


def _walls(axes: Axes, prediction: PrintedDesign) -> None:
    if prediction.walls is not None:
        axes.plot(prediction.walls.beyond_um, 1e-3 * prediction.walls.height_um, ".-", ms=3, lw=0.8, color=RIGHT)
    axes.set(xlabel="straight wall beyond its image (µm)", ylabel="height above the platform (mm)")
    axes.set_title("walls over the thickness, without shrinkage")


def _steps(axes: Axes, prediction: PrintedDesign) -> None:
    axes.plot(prediction.deviation.target.along_mm, prediction.lens.ripple_um, color=RIGHT, lw=0.8)
    axes.set(xlabel="along the lens (mm)", ylabel="steps of the layers (µm)")
    axes.set_title("steps of the layers, not in the traced profile")


def _response(axes: Axes, response: PrintLoss | None) -> None:
    if response is None:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no response traced", ha="center", va="center", color=LOST)
        return
    for emitter, style in ((response.own, "-"), (response.chip, "--")):
        if emitter is None:
            continue
        width = "a point" if emitter.width_mm == 0.0 else f"{emitter.width_mm:g} mm"
        for name, colour, contrast, slope in (
            ("designed", INK, emitter.contrast_designed, emitter.slope_designed_per_deg),
            ("printed", LEFT, emitter.contrast_printed, emitter.slope_printed_per_deg),
        ):
            label = f"{name}, {width}" + ("" if slope is None else f", {slope:.2g}/° at 0")
            axes.plot(emitter.angle_deg, contrast, style, marker=".", ms=4, lw=1.2, color=colour, label=label)
    axes.set(xlabel="angle (deg)", ylabel="contrast (R − L)/(R + L)")
    axes.set_title("response, traced with both lenses")
    axes.legend()
