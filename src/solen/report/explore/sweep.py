"""The sweep figure: merits against one parameter, heat maps over two, or samples against each parameter."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from solen.explore.merits import table_merits
from solen.explore.swept import Sweep
from solen.report.canvas import INK, RIGHT, SOFT, series

COLOUR_MAP = "viridis"
MAX_CURVES = 7
COLUMNS, MAX_LABELS, DIGITS = 3, 5, 12
"""Number of panel columns, largest number of values that all label an axis, and decimals of a merit on a map."""


def sweep_figure(sweep: Sweep) -> Figure:
    """Draw merits against the varied keys: curves for one key, heat maps for the first two, dots for samples."""
    draw = _curve if len(sweep.values) == 1 else _map if sweep.is_grid else _dots
    names = [name for name in table_merits(sweep.merits) if np.isfinite(sweep.merits[name]).any()]
    keys = [""] if len(sweep.values) == 1 or sweep.is_grid else list(sweep.values)
    panels = [(name, key) for name in names for key in keys]
    columns = COLUMNS if len(keys) == 1 else len(keys)
    extra = len(sweep.values) == 1 and not sweep.labels
    rows = -(-(len(panels) + extra) // columns)
    figure = Figure(figsize=(3.0 * columns, 0.5 + 2.4 * rows))
    for number, (name, key) in enumerate(panels, start=1):
        draw(figure, figure.add_subplot(rows, columns, number), sweep, name, key)
    if extra:
        _responses(figure.add_subplot(rows, columns, len(panels) + 1), sweep)
    plain_numbers(figure)
    figure.suptitle(f"simulated: {sweep.name}{_fixed(sweep)}")
    return figure


def plain_numbers(figure: Figure) -> None:
    """Write the numbers on all axes in full, not as differences from an offset."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(formatter := axis.get_major_formatter(), ScalarFormatter):
                formatter.set_useOffset(False)


def _fixed(sweep: Sweep) -> str:
    """Return the fixed values of the remaining keys of a map, for the title; each is the first value of its key."""
    others = list(sweep.axes.items())[2:] if sweep.is_grid else []
    failed = ", grey: no response" if sweep.failures and len(sweep.values) > 1 and sweep.is_grid else ""
    return "".join(f", {key} = {values[0]}" for key, values in others) + failed


def _ticks(values: list[object], max_labels: int = MAX_LABELS) -> tuple[np.ndarray, list[str] | None]:
    """Return positions on an axis, and labels if there are few values or they are not numbers."""
    if not all(isinstance(value, int | float) for value in values):
        return np.arange(len(values), dtype=float), [str(value) for value in values]
    return np.array(values, dtype=float), [f"{value:.4g}" for value in values] if len(values) <= max_labels else None


def _curve(_: Figure, axes: Axes, sweep: Sweep, name: str, __: str) -> None:
    ((key, values),) = sweep.values.items()
    positions, labels = _ticks(list(values))
    merit, u = sweep.merits[name], np.nan_to_num(sweep.merits[f"u_{name}"], posinf=0.0)
    axes.errorbar(positions, merit, yerr=u, color=RIGHT, ecolor=INK, marker="o", ms=3.5, lw=1.2, capsize=2)
    if labels is not None:
        axes.set_xticks(positions, labels)
    axes.set_xlabel(key)
    axes.set_ylabel(name)


def _responses(axes: Axes, sweep: Sweep) -> None:
    """Draw the contrast at some points of a sweep over one key."""
    ((key, values),) = sweep.values.items()
    chosen = np.unique(np.linspace(0, sweep.points - 1, MAX_CURVES).round().astype(int))
    for number, point in enumerate(chosen):
        value = values[point]
        label = f"{value:.4g}" if isinstance(value, float) else str(value)
        axes.plot(sweep.angle_deg, sweep.contrast[point], label=label, **series(number))
    axes.set_xlabel("angle (deg)")
    axes.set_ylabel("contrast")
    axes.legend(title=key)


def _map(figure: Figure, axes: Axes, sweep: Sweep, name: str, _: str) -> None:
    (x_key, columns), (y_key, rows), *_others = sweep.axes.items()
    merit = sweep.merits[name].reshape(sweep.shape)
    merit = np.round(merit.reshape(*merit.shape[:2], -1)[:, :, 0].T, DIGITS)
    (x, x_labels), (y, y_labels) = _ticks(columns), _ticks(rows)
    axes.set_facecolor(SOFT)  # colour of points without a response
    mesh = axes.pcolormesh(x, y, np.ma.masked_invalid(merit), cmap=COLOUR_MAP, shading="nearest")
    figure.colorbar(mesh, ax=axes, label=name)
    if x_labels is not None:
        axes.set_xticks(x, x_labels)
    if y_labels is not None:
        axes.set_yticks(y, y_labels)
    axes.grid(visible=False)
    axes.set_xlabel(x_key)
    axes.set_ylabel(y_key)


def _dots(_: Figure, axes: Axes, sweep: Sweep, name: str, key: str) -> None:
    positions, labels = _ticks(list(sweep.values[key]), max_labels=0)
    if labels is not None:
        distinct = list(dict.fromkeys(labels))
        positions = np.array([distinct.index(label) for label in labels], dtype=float)
        axes.set_xticks(range(len(distinct)), distinct)
    axes.plot(positions, sweep.merits[name], ".", color=RIGHT, ms=4)
    axes.set_xlabel(key)
    axes.set_ylabel(name)
