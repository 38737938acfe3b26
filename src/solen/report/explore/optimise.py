"""Figures of searches: responses before and after with the course of the search, and the front of two goals."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.arrays import FloatArray
from solen.explore.optimise import Front, Optimum
from solen.report.canvas import INK, LEFT, LOST, RIGHT


def optimum_figure(result: Optimum) -> Figure:
    """Contrast over the angle before and after, as designed and at worst; best value by number of designs tried."""
    figure = Figure(figsize=(9.0, 6.2))
    grid = figure.add_gridspec(2, 2)
    before, after = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    nothing_off = "as designed" if result.printed_by is None else "as printed"
    _response(before, result.angle_deg, result.contrast_before, LEFT, nothing_off)
    _response(after, result.angle_deg, result.contrast_after, RIGHT, nothing_off)
    before.set_title("before")
    after.set_title("after")
    _course(figure.add_subplot(grid[1, :]), result)
    figure.suptitle(f"simulated: {result.name}, {result.goal}")
    return figure


def _response(axes: Axes, angle_deg: FloatArray, contrast: FloatArray, colour: str, nothing_off: str) -> None:
    axes.plot(angle_deg, contrast[0], color=colour, lw=2.0, label=nothing_off)
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


def front_figure(result: Front) -> Figure:
    """The front with its numbers, all designs tried that meet the conditions, and the design before."""
    figure = Figure(figsize=(7.0, 5.2))
    axes = figure.add_subplot()
    axes.plot(result.tried[:, 0], result.tried[:, 1], ".", color=LOST, ms=4, label="tried, meeting all conditions")
    goals, u = (np.array([getattr(one, name) for one in result.designs]).T for name in ("goals", "u_goals"))
    axes.errorbar(
        goals[0], goals[1], xerr=u[0], yerr=u[1], fmt="o-", color=RIGHT, ms=5, lw=1.2, label="front, traced again"
    )
    for one in result.designs:
        axes.annotate(
            str(one.number), (one.goals[0], one.goals[1]), xytext=(5, 5), textcoords="offset points", color=RIGHT
        )
    axes.plot(*result.before.goals, "s", color=LEFT, ms=7, label="before")
    words = [goal.partition(" ") for goal in result.goals]
    axes.set_xlabel(f"{words[0][2]} ({words[0][0]})")
    axes.set_ylabel(f"{words[1][2]} ({words[1][0]})")
    axes.set_title(f"simulated: {result.name}")
    axes.legend()
    return figure
