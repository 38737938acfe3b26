"""The figure of an optimum: responses before and after, and the course of the search."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.arrays import FloatArray
from solen.explore.optimise import Optimum
from solen.report.canvas import INK, LEFT, RIGHT


def optimum_figure(result: Optimum) -> Figure:
    """Contrast over the angle before and after, as designed and at worst; best value by number of designs tried."""
    figure = Figure(figsize=(9.0, 6.2))
    grid = figure.add_gridspec(2, 2)
    before, after = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    _response(before, result.angle_deg, result.contrast_before, LEFT)
    _response(after, result.angle_deg, result.contrast_after, RIGHT)
    before.set_title("before")
    after.set_title("after")
    _course(figure.add_subplot(grid[1, :]), result)
    figure.suptitle(f"simulated: {result.name}, {result.goal}")
    return figure


def _response(axes: Axes, angle_deg: FloatArray, contrast: FloatArray, colour: str) -> None:
    axes.plot(angle_deg, contrast[0], color=colour, lw=2.0, label="as designed")
    axes.plot(angle_deg, contrast[1], "--", color=INK, lw=1.2, label="where the goal is worst")
    axes.set_xlabel("angle in deg")
    axes.set_ylabel("contrast")
    axes.legend()


def _course(axes: Axes, result: Optimum) -> None:
    axes.plot(np.arange(1, result.history.size + 1), result.history, color=RIGHT, lw=1.6, drawstyle="steps-post")
    axes.axhline(result.before.goal, color=LEFT, lw=1.0, ls="--", label="design")
    axes.errorbar(
        result.history.size, result.after.goal, yerr=result.after.u_goal, color=INK, marker="o", ms=4, label="retraced"
    )
    axes.set_xlabel("designs tried")
    axes.set_ylabel(f"best {result.goal.partition(' ')[2]}")
    axes.legend()
