"""The tolerance figure: yields, yield losses, and the variation of every merit between prints."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.explore.prints import MeritSpread
from solen.explore.tolerance import Tolerances
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SERIES, SOFT
from solen.report.design.summary import measured
from solen.report.explore.sweep import plain_numbers

COLUMNS, MIN_BINS, MAX_UNKNOWN = 3, 8, 0.5


def tolerance_figure(result: Tolerances) -> Figure:
    """Draw yields, yields with one parameter exact, the causes of the variance, and histograms of the merits."""
    spreads = result.spreads
    rows = -(-len(spreads) // COLUMNS)
    adjusted = result.yields[0].adjusted_share if result.yields else None
    heights = [
        0.9 + max(0.3 * len(result.varied), (0.76 if adjusted is None else 1.0) * len(result.yields)),
        1.9 + 0.26 * len(result.varied),
        2.1 * rows,
    ]
    figure = Figure(figsize=(9.0, 0.8 + sum(heights)))
    grid = figure.add_gridspec(3, 1, height_ratios=heights)
    top, middle, bottom = (grid[row] for row in range(3))
    if result.yields:
        left, right = (top.subgridspec(1, 2)[column] for column in range(2))
        _yields(figure.add_subplot(left), result)
        _costs(figure.add_subplot(right), result)
    else:
        _deviations(figure.add_subplot(top), result)
    _causes(figure, figure.add_subplot(middle), result)
    panels = bottom.subgridspec(rows, COLUMNS)
    for k, spread in enumerate(spreads):
        _histogram(figure.add_subplot(panels[k // COLUMNS, k % COLUMNS]), result, spread)
    plain_numbers(figure)
    figure.suptitle(
        f"simulated: {result.name}, {result.prints} prints{_failed(result)}"
        f"{', blue: prints that meet all requirements' if result.yields else ''}"
    )
    return figure


def _failed(result: Tolerances) -> str:
    """Return the number of prints without a response, which are missing from the histograms, for the title."""
    failed = int(np.isnan(result.merits["light"]).sum())
    return f" ({failed} without a response)" if failed else ""


def _yields(axes: Axes, result: Tolerances) -> None:
    """Draw the yield for each requirement as bars: as printed and, below, calibrated and adjusted."""
    rows: list[tuple[str, float, float, str]] = []
    for result_yield in result.yields:
        name = result_yield.requirement or "all"
        rows.append((name, result_yield.share, result_yield.u_share, LEFT))
        if result_yield.calibrated_share is not None:
            rows.append(("calibrated", result_yield.calibrated_share, result_yield.u_calibrated_share or 0.0, RIGHT))
        if result_yield.adjusted_share is not None:
            rows.append(("adjusted", result_yield.adjusted_share, result_yield.u_adjusted_share or 0.0, SERIES[2]))
    for row, (_, fraction, u, colour) in enumerate(rows):
        axes.barh(row, 100 * fraction, color=colour, alpha=0.8, xerr=100 * u)
    axes.set_yticks(range(len(rows)), [name for name, *_ in rows])
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel("yield (%)")


def _costs(axes: Axes, result: Tolerances) -> None:
    """Draw the yield if one parameter were exact, for each parameter in turn."""
    rows = result.varied
    axes.barh(range(len(rows)), [100 * (row.share_if_exact or 0.0) for row in rows], color=SERIES[2], alpha=0.8)
    axes.axvline(100 * result.yields[-1].share, color=INK, lw=1.0)
    axes.set_yticks(range(len(rows)), [row.key for row in rows])
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel("yield (%) if this parameter were exact (line: all vary)")


def _deviations(axes: Axes, result: Tolerances) -> None:
    """Draw the varied parameters if no requirement is specified."""
    axes.set_axis_off()
    rows = [f"{row.key}: {row.distribution} {row.deviation[0]:.3g}, {row.deviation[1]:.3g}" for row in result.varied]
    axes.text(0.0, 1.0, "\n".join(rows), va="top", transform=axes.transAxes)


def _causes(figure: Figure, axes: Axes, result: Tolerances) -> None:
    """Draw the total Sobol' indices of each merit, in grey if the surrogate is not valid."""
    keys = [row.key for row in result.varied]
    indices = np.array(
        [[spread.total[key] if spread.held_out < MAX_UNKNOWN else np.nan for spread in result.spreads] for key in keys]
    )
    axes.set_facecolor(SOFT)
    mesh = axes.pcolormesh(100 * np.ma.masked_invalid(indices), vmin=0, vmax=100, cmap="Blues", edgecolors="w", lw=0.8)
    axes.set_xticks(np.arange(len(result.spreads)) + 0.5, [spread.merit for spread in result.spreads], rotation=90)
    axes.set_yticks(np.arange(len(keys)) + 0.5, keys)
    axes.invert_yaxis()
    axes.grid(visible=False)
    if np.isnan(indices).any():
        axes.set_title("grey: constant, or causes not resolved by these prints")
    figure.colorbar(mesh, ax=axes, label="fraction of the\nvariance (%)")


def _histogram(axes: Axes, result: Tolerances, spread: MeritSpread) -> None:
    values = result.merits[spread.merit]
    finite = np.isfinite(values)
    groups = [values[finite & result.met], values[finite & ~result.met]]
    bins = max(MIN_BINS, math.isqrt(int(finite.sum())))
    axes.hist(groups, bins=bins, stacked=True, color=[RIGHT, LOST])
    axes.axvline(spread.base, color=INK, lw=1.0)
    axes.set_xlabel(spread.merit)
    missing = int((~finite).sum())
    without = f"; {missing} without" if missing else ""
    axes.set_title(f"design {measured(spread.base, spread.u_base, sign=False)}{without}")
    axes.set_ylabel("prints")
