"""Figures of searches: responses before and after with the course of the search, and the front of two goals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.arrays import FloatArray
from solen.explore.optimise import Front, FrontDesign, Optimum
from solen.report.canvas import INK, LEFT, RIGHT


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
    axes.plot(
        np.arange(1, result.history.size + 1),
        result.history,
        color=RIGHT,
        lw=1.6,
        drawstyle="steps-post",
        label="as the search saw it",
    )
    before, u_before = result.before.goal, result.before.u_goal
    axes.axhline(before, color=LEFT, lw=1.0, ls="--", label="before, retraced")
    axes.axhspan(before - u_before, before + u_before, color=LEFT, alpha=0.15, lw=0.0)
    axes.errorbar(
        result.history.size,
        result.after.goal,
        yerr=result.after.u_goal,
        color=INK,
        marker="o",
        ms=4,
        label="after, retraced",
    )
    axes.set_xlabel("designs tried")
    axes.set_ylabel(f"best {result.goal.partition(' ')[2]}")
    axes.legend()


def front_figure(result: Front) -> Figure:
    """The front with its numbers, and the design before, all traced finely and with their uncertainties."""
    figure = Figure(figsize=(7.0, 5.2))
    axes = figure.add_subplot()
    _designs(axes, result.designs, fmt="o-", color=RIGHT, ms=5, lw=1.2, label="front")
    _designs(axes, [result.before], fmt="s", color=LEFT, ms=7, label="before")
    for one in result.designs:
        axes.annotate(
            str(one.number), (one.goals[0], one.goals[1]), xytext=(5, 5), textcoords="offset points", color=RIGHT
        )
    words = [goal.partition(" ") for goal in result.goals]
    axes.set_xlabel(f"{words[0][2]} ({words[0][0]})")
    axes.set_ylabel(f"{words[1][2]} ({words[1][0]})")
    worst = ", worst of the deviations" if result.robust else ""
    axes.set_title(f"simulated: {result.name}{worst}")
    axes.legend()
    return figure


def _designs(axes: Axes, designs: Sequence[FrontDesign], **look: Any) -> None:
    """Goals of some designs with their uncertainties."""
    goals, u = (np.array([getattr(one, name) for one in designs]).T for name in ("goals", "u_goals"))
    axes.errorbar(goals[0], goals[1], xerr=u[0], yerr=u[1], capsize=2, ecolor=INK, elinewidth=1.0, **look)
