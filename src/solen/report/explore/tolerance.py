"""The figure of tolerances: one page with the yield, what costs it, and how every merit varies between prints."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from solen.explore.tolerance import MeritSpread, Tolerances
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SERIES
from solen.report.design.answer import measured

COLUMNS, LEAST_BINS = 3, 8


def tolerance_figure(result: Tolerances) -> Figure:
    """Yields; yield if each number were exact; causes of each merit's variance; histograms of the merits."""
    spreads = result.spreads
    rows = -(-len(spreads) // COLUMNS)
    heights = [1.0 + 0.3 * max(len(result.varied), 2 * len(result.yields)), 1.2 + 0.3 * len(spreads), 2.1 * rows]
    figure = Figure(figsize=(9.0, 0.8 + sum(heights)))
    top, middle, bottom = figure.add_gridspec(3, 1, height_ratios=heights)
    if result.yields:
        left, right = top.subgridspec(1, 2)
        _yields(figure.add_subplot(left), result)
        _costs(figure.add_subplot(right), result)
    else:
        _deviations(figure.add_subplot(top), result)
    _causes(figure.add_subplot(middle), result)
    places = bottom.subgridspec(rows, COLUMNS)
    for place, spread in enumerate(spreads):
        _histogram(figure.add_subplot(places[place // COLUMNS, place % COLUMNS]), result, spread)
    figure.suptitle(f"simulated: {result.name}, {result.prints} prints")
    return figure


def _yields(axes: Axes, result: Tolerances) -> None:
    """Bars of each requirement's yield, as printed and calibrated."""
    for place, one in enumerate(result.yields):
        pairs = ((one.share, one.u_share, LEFT), (one.calibrated_share, one.u_calibrated_share, RIGHT))
        for (share, u, colour), off in zip(pairs, (-0.18, 0.18), strict=True):
            axes.barh(place + off, 100 * share, height=0.32, color=colour, alpha=0.8, xerr=100 * u)
    axes.set_yticks(range(len(result.yields)), [one.requirement or "all" for one in result.yields])
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel("yield in %")
    axes.legend(handles=[Patch(color=LEFT, label="as printed"), Patch(color=RIGHT, label="null and gain calibrated")])


def _costs(axes: Axes, result: Tolerances) -> None:
    """Yield if each number alone were exact."""
    rows = result.varied
    axes.barh(range(len(rows)), [100 * (row.share_if_exact or 0.0) for row in rows], color=SERIES[2], alpha=0.8)
    axes.axvline(100 * result.yields[-1].share, color=INK, lw=1.0)
    axes.set_yticks(range(len(rows)), [row.key for row in rows])
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel("yield in % if this number were exact (line: as it is)")


def _deviations(axes: Axes, result: Tolerances) -> None:
    """What varies, where there is no requirement."""
    axes.set_axis_off()
    rows = [f"{row.key}: {row.distribution} {row.deviation[0]:.3g}, {row.deviation[1]:.3g}" for row in result.varied]
    axes.text(0.0, 1.0, "\n".join(rows), va="top", transform=axes.transAxes)


def _causes(axes: Axes, result: Tolerances) -> None:
    """Total Sobol' indices of each merit, stacked in shares of their sum."""
    keys = [row.key for row in result.varied]
    names = [spread.merit for spread in result.spreads]
    left = np.zeros(len(names))
    total = np.array([[max(spread.total[key], 0.0) for key in keys] for spread in result.spreads])
    share = 100 * np.nan_to_num(total / total.sum(axis=1, keepdims=True))
    shown = [place for place in np.argsort(-share.max(axis=0)) if share[:, place].max() > 3.0][: len(SERIES) - 1]
    for number, place in enumerate(shown):
        axes.barh(range(len(names)), share[:, place], left=left, color=SERIES[number], alpha=0.85, label=keys[place])
        left += share[:, place]
    axes.barh(range(len(names)), 100.0 - left, left=left, color=LOST, alpha=0.5, label="others")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel("share of the variance in %, by total Sobol' indices")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))


def _histogram(axes: Axes, result: Tolerances, spread: MeritSpread) -> None:
    values = result.merits[spread.merit]
    finite = np.isfinite(values)
    groups = [values[finite & result.met], values[finite & ~result.met]]
    bins = max(LEAST_BINS, math.isqrt(int(finite.sum())))
    axes.hist(groups, bins=bins, stacked=True, color=[RIGHT, LOST])
    axes.axvline(spread.base, color=INK, lw=1.0)
    axes.set_xlabel(spread.merit)
    axes.set_title(f"design {measured(spread.base, spread.u_base, sign=False)}")
    axes.set_ylabel("prints")
