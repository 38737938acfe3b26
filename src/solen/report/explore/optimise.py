"""Figures of a search: responses before and after, progress, and the Pareto front of two goals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from solen.arrays import FloatArray
from solen.explore.merits import table_merits
from solen.explore.optimise import Front, FrontDesign, Optimum
from solen.report.canvas import INK, LEFT, RIGHT


def optimum_figure(result: Optimum) -> Figure:
    """Draw the contrast before and after, the best value against designs tried, and prints of both designs.

    For a network, the merits relative to their initial values replace the contrast.
    """
    has_prints = result.prints_before is not None and result.prints_after is not None
    rows = 3 if has_prints else 2
    figure = Figure(figsize=(9.0, 3.1 * rows))
    grid = figure.add_gridspec(rows, 2)
    if result.contrast_before.size:
        _contrasts(figure, grid, result)
    else:
        _merits(figure.add_subplot(grid[0, :]), result)
    _history(figure.add_subplot(grid[1, :]), result)
    for column, name in enumerate(_print_merits(result) if has_prints else ()):
        _prints(figure.add_subplot(grid[2, column]), result, name)
    figure.suptitle(f"simulated: {result.name}, {result.goal}")
    return figure


def _merits(axes: Axes, result: Optimum) -> None:
    """Draw the ratio of each merit to its initial value, if the initial value exceeds its uncertainty."""
    before, after = result.before.merits, result.after.merits
    names = [
        name for name in table_merits(before) if abs(before[name]) > before[f"u_{name}"] and np.isfinite(after[name])
    ]
    ratios = np.array([after[name] / before[name] for name in names])
    u = [
        np.hypot(after[f"u_{name}"], ratio * before[f"u_{name}"]) / abs(before[name])
        for name, ratio in zip(names, ratios, strict=True)
    ]
    axes.errorbar(ratios, range(len(names)), xerr=u, fmt="o", color=RIGHT, ecolor=INK, ms=5, capsize=2)
    axes.axvline(1.0, color=LEFT, lw=1.0, ls="--")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("ratio of merits, after / before")


def _contrasts(figure: Figure, grid: GridSpec, result: Optimum) -> None:
    """Draw the contrast against the angle before and after."""
    before, after = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    nominal = "as designed" if result.printed_by is None else "as printed"
    cases = 2 if result.robust else 1
    _response(before, result.angle_deg, result.contrast_before[:cases], LEFT, nominal)
    _response(after, result.angle_deg, result.contrast_after[:cases], RIGHT, nominal)
    before.set_title("before")
    after.set_title("after")


def _response(axes: Axes, angle_deg: FloatArray, contrast: FloatArray, colour: str, nominal: str) -> None:
    axes.plot(angle_deg, contrast[0], color=colour, lw=2.0, label=nominal)
    for worst in contrast[1:]:
        axes.plot(angle_deg, worst, "--", color=INK, lw=1.2, label="worst deviations")
    axes.set_xlabel("angle (deg)")
    axes.set_ylabel("contrast")
    axes.legend()


def _print_merits(result: Optimum) -> list[str]:
    """Return the merits whose distributions over the prints are drawn: that of the goal, and the null or the light."""
    names = table_merits(result.before.merits)
    goal_merit = next((name for name in result.before.merits if name in result.goal), names[0])
    other = next(name for name in ("null_deg", "light", *names) if name in names and name != goal_merit)
    return [goal_merit, other]


def _prints(axes: Axes, result: Optimum, name: str) -> None:
    """Draw histograms of a merit over simulated prints of both designs."""
    series = {"before": (result.prints_before, LEFT), "after": (result.prints_after, RIGHT)}
    values = {label: prints.merits[name] for label, (prints, _) in series.items() if prints is not None}
    finite = {label: column[np.isfinite(column)] for label, column in values.items()}
    bins = np.histogram_bin_edges(np.concatenate(list(finite.values())), bins="fd").tolist()
    for label, column in finite.items():
        axes.hist(column, bins=bins, color=series[label][1], alpha=0.6, label=label)
    axes.set_xlabel(f"{name} of prints")
    axes.set_ylabel("prints")
    axes.margins(y=0.6)  # room for the legend
    axes.legend(ncols=2)


def _history(axes: Axes, result: Optimum) -> None:
    axes.plot(
        np.arange(1, result.history.size + 1),
        result.history,
        color=RIGHT,
        lw=1.6,
        drawstyle="steps-post",
        label="as evaluated in the search",
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
    """Draw the numbered designs of the Pareto front and the initial design, all retraced, with their uncertainties."""
    figure = Figure(figsize=(7.0, 5.2))
    axes = figure.add_subplot()
    _designs(axes, result.designs, fmt="o-", color=RIGHT, ms=5, lw=1.2, label="front")
    _designs(axes, [result.before], fmt="s", color=LEFT, ms=7, label="before")
    side = -1 if result.designs[-1].goals[1] > result.designs[0].goals[1] else 1  # labels must not cover the front
    look: dict[str, Any] = {"textcoords": "offset points", "ha": "right" if side < 0 else "left", "color": RIGHT}
    for design in result.designs:
        axes.annotate(str(design.number), (design.goals[0], design.goals[1]), xytext=(6 * side, 5), **look)
    (x_verb, _, x_goal), (y_verb, _, y_goal) = (goal.partition(" ") for goal in result.goals)
    axes.set_xlabel(f"{x_goal} ({x_verb})")
    axes.set_ylabel(f"{y_goal} ({y_verb})")
    worst = ", worst over the deviations" if result.robust else ""
    axes.set_title(f"simulated: {result.name}{worst}")
    axes.legend()
    return figure


def _designs(axes: Axes, designs: Sequence[FrontDesign], **look: Any) -> None:
    """Draw the goals of designs with their uncertainties."""
    goals, u = (np.array([getattr(design, name) for design in designs]).T for name in ("goals", "u_goals"))
    axes.errorbar(goals[0], goals[1], xerr=u[0], yerr=u[1], capsize=2, ecolor=INK, elinewidth=1.0, **look)
