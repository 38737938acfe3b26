"""The figure of a measured printed lens: its deviation from the design, and its effect on the response."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.lens import MeasuredLens
from solen.report.canvas import INK, LOST, RIGHT, SOFT, SPACE
from solen.sensor import AsPrinted, Comparison

CURVE_POINTS = 400
"""Number of points of the smoothed deviation."""
MAX_DOTS = 400
"""Maximum number of profile points that are drawn."""


def as_printed_figure(as_printed: AsPrinted) -> Figure:
    """Draw the deviation of the lens, the designed and printed responses, and their difference with its uncertainty."""
    figure = Figure(figsize=(10.2, 3.8))
    shape_axes, contrast_axes, difference_axes = figure.subplots(1, 3)
    draw_deviation(shape_axes, as_printed.lens)
    shape_axes.set_title(f"lens {as_printed.label}")
    for comparison, colour in ((as_printed.emitter, INK), (as_printed.chip, SPACE)):
        if comparison is not None:
            _draw_responses(contrast_axes, comparison, colour)
            _draw_difference(difference_axes, comparison, colour)
    contrast_axes.set(xlabel="angle (deg)", ylabel="contrast (R − L)/(R + L)", ylim=(-1.05, 1.05))
    contrast_axes.set_title("simulated responses")
    contrast_axes.legend()
    difference_axes.axhline(0.0, color=INK, lw=0.8)
    difference_axes.set(xlabel="angle (deg)", ylabel="contrast, printed − designed")
    difference_axes.legend()
    return figure


def draw_deviation(axes: Axes, lens: MeasuredLens) -> None:
    """Draw the deviation of a profile along the normal of the lens: points, and the smoothed curve with uncertainty."""
    fit, half_mm = lens.fit, lens.half_width_mm
    x = np.linspace(-half_mm, half_mm, CURVE_POINTS)
    smoothed = -1e3 * fit.deviation_mm(x) / np.hypot(1.0, lens.designed.slope(x))
    u = 1e3 * fit.u_mm(x)
    step = max(1, fit.points[0].size // MAX_DOTS)
    points_x, deviation = (values[::step] for values in fit.points)
    points_um = -1e3 * deviation / np.hypot(1.0, lens.designed.slope(points_x))
    axes.plot(points_x, points_um, ".", color=LOST, ms=2.5, label="points")
    axes.fill_between(x, smoothed - u, smoothed + u, color=SOFT, lw=0, zorder=1, label="standard uncertainty")
    axes.plot(x, smoothed, color=RIGHT, lw=1.6, label="smoothed, as traced")
    axes.axhline(0.0, color=INK, lw=0.8, ls=":")
    axes.set(xlabel="x (mm)", ylabel="deviation from the design (µm)")
    axes.legend()


def _name(comparison: Comparison) -> str:
    return f"{comparison.width_mm:g} mm emitter" if comparison.width_mm > 0.0 else "point emitter"


def _draw_responses(axes: Axes, comparison: Comparison, colour: str) -> None:
    angle, name = comparison.designed.angle_deg, _name(comparison)
    axes.plot(angle, comparison.designed.contrast, "--", color=colour, lw=1.2, label=f"designed, {name}")
    axes.plot(angle, comparison.printed.contrast, color=colour, lw=1.8, label=f"printed, {name}")


def _draw_difference(axes: Axes, comparison: Comparison, colour: str) -> None:
    angle, change, u = comparison.designed.angle_deg, comparison.difference, comparison.u_difference
    axes.fill_between(angle, change - u, change + u, color=colour, alpha=0.2, lw=0)
    axes.plot(angle, change, "o-", color=colour, ms=3, lw=1.4, label=_name(comparison))
