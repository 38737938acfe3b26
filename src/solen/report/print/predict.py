"""The figure of a printed lens: how far it is from the wanted one, its walls, and its response."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.arrays import FloatArray
from solen.fabricate.process import Compensation, Prediction
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SPACE, STYLE

_EXAGGERATED = 10.0
_BAND = 0.2


def printed_figure(
    found: Prediction, made: Compensation | None, walls: tuple[FloatArray, FloatArray] | None, told: dict[str, Any]
) -> Figure:
    """Outline and deviation; walls or steps; contrast where it was traced."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 7.2), layout="constrained")
        (outline, deviation), (through, response) = figure.subplots(2, 2)
        _outline(outline, found, made)
        _deviation(deviation, found, made)
        if walls is not None:
            _walls(through, *walls)
        else:
            _steps(through, found)
        _response(response, told["response"])
        figure.suptitle(
            f"simulated: {told['name']}, printed {told['orientation']} ({told['process']}), off by "
            f"{told['deviation_um']['rms']:.3g} µm rms, largest {told['deviation_um']['max']:+.3g} µm",
            fontsize=9,
        )
    return figure


def _outline(axes: Axes, found: Prediction, made: Compensation | None) -> None:
    target = found.deviation.target
    axes.plot(*target.points_mm.T, color=INK, lw=3.0, alpha=0.5, label="wanted")
    axes.plot(*target.moved_um(_EXAGGERATED * found.deviation.um).T, color=LEFT, lw=1.2, label="printed")
    if made is not None:
        axes.plot(*target.moved_um(_EXAGGERATED * made.drawn_um).T, "--", color=SPACE, lw=1.2, label="to be drawn")
        axes.plot(*target.moved_um(_EXAGGERATED * made.printed.um).T, color=RIGHT, lw=1.2, label="printed then")
    axes.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal")
    axes.set_title(f"the lens, deviations drawn {_EXAGGERATED:g} times", fontsize=9)
    axes.legend(fontsize=8, loc="upper center")


def _deviation(axes: Axes, found: Prediction, made: Compensation | None) -> None:
    x, um = found.deviation.target.points_mm[:, 0], found.deviation.um
    axes.axhline(0.0, color=LOST, lw=1.0)
    axes.fill_between(x, um - 2 * found.u_um, um + 2 * found.u_um, color=LEFT, alpha=_BAND, lw=0, label="± 2 u")
    if np.any(found.ripple_um):
        axes.plot(x, um + found.ripple_um, color=LOST, lw=0.6, label="with its steps")
    axes.plot(x, um, color=LEFT, lw=1.4, label=f"printed, {found.deviation.rms_um:.3g} µm rms")
    if made is not None:
        label = f"compensated, {made.printed.rms_um:.2g} µm rms"
        axes.plot(x, made.printed.um, color=RIGHT, lw=1.4, label=label)
    axes.set(xlabel="x on the wanted lens (mm)", ylabel="beyond the wanted lens (µm)")
    axes.set_title("deviation along the normal, more material upwards", fontsize=9)
    axes.legend(fontsize=8)


def _walls(axes: Axes, heights_um: FloatArray, walls_um: FloatArray) -> None:
    axes.plot(walls_um, 1e-3 * heights_um, ".-", ms=3, lw=0.8, color=RIGHT)
    axes.set(xlabel="straight wall beyond its image (µm)", ylabel="height above the platform (mm)")
    axes.set_title("walls through the thickness, shrinkage left out", fontsize=9)


def _steps(axes: Axes, found: Prediction) -> None:
    axes.plot(found.deviation.target.along_mm, found.ripple_um, color=RIGHT, lw=0.8)
    axes.set(xlabel="along the lens (mm)", ylabel="steps of the layers (µm)")
    axes.set_title("what is left out of the traced profile", fontsize=9)


def _response(axes: Axes, response: dict[str, Any] | None) -> None:
    if response is None:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no response traced", ha="center", va="center", color=LOST)
        return
    for emitter, style in ((response, "-"), (response["chip"], "--")):
        if emitter is None:
            continue
        width = "a point" if emitter["width_mm"] == 0.0 else f"{emitter['width_mm']:g} mm"
        for name, colour in (("designed", INK), ("printed", LEFT)):
            values = np.array([np.nan if value is None else value for value in emitter["contrast"][name]])
            slope = emitter["slope_per_deg"][name]
            told = "" if slope is None else f", {slope:.2g}/° at 0"
            label = f"{name}, {width}{told}"
            axes.plot(emitter["angle_deg"], values, style, marker=".", ms=4, lw=1.2, color=colour, label=label)
    axes.set(xlabel="angle (deg)", ylabel="contrast (R − L)/(R + L)")
    axes.set_title("response, traced with both lenses", fontsize=9)
    axes.legend(fontsize=8)
