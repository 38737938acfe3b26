"""The sensitivity figure: derivatives of the contrast with respect to each parameter, in a panel for each unit."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.errors import OutputError
from solen.report.canvas import INK, LEFT, RIGHT
from solen.sensor.response import Sensitivity
from solen.sensor.traced import Sensitivities, value_text

UNITS = {"_mm": "mm", "_deg": "deg", "_per_mm": "1/mm", "_MPa": "MPa"}
"""Units, keyed by suffix of a design key; other keys are dimensionless."""


def sensitivities_figure(sensitivities: Sensitivities) -> Figure:
    """Draw the contrast derivatives and their uncertainties as bars; parameters with the same unit share a panel.

    Raises
    ------
    OutputError
        If no parameter has a derivative.
    """
    rows = [row for row in sensitivities.sensitivities if np.isfinite(row.contrast.value)]
    if not rows:
        limit = "the contrast has no derivative with respect to any parameter at this position"
        raise OutputError("figure", limit=limit, remedy="omit --figure, or change the position")
    units = dict.fromkeys(unit_of(row.key) for row in rows)
    panels = {unit: [row for row in rows if unit_of(row.key) == unit] for unit in units}
    figure = Figure(figsize=(6.4, 0.9 + 0.7 * len(panels) + 0.34 * len(rows)))
    grid = figure.add_gridspec(len(panels), 1, height_ratios=[len(panel) + 1 for panel in panels.values()])
    for row, (unit, panel) in enumerate(panels.items()):
        _draw(figure.add_subplot(grid[row, 0]), unit, panel)
    figure.suptitle(f"simulated: {sensitivities.name} at {value_text(sensitivities)}")
    return figure


def unit_of(key: str) -> str:
    """Return the unit of a design key; empty if it is dimensionless."""
    suffixes = sorted(UNITS, key=len, reverse=True)
    return next((UNITS[suffix] for suffix in suffixes if key.endswith(suffix)), "")


def _draw(axes: Axes, unit: str, rows: Sequence[Sensitivity]) -> None:
    values = [row.contrast.value for row in rows]
    colours = [RIGHT if value > 0.0 else LEFT for value in values]
    u = np.nan_to_num([row.contrast.u_value for row in rows])
    axes.barh(range(len(rows)), values, color=colours, alpha=0.8, xerr=u, error_kw={"ecolor": INK, "lw": 1.0})
    axes.axvline(0.0, color=INK, lw=0.8)
    axes.locator_params(axis="x", nbins=6)
    axes.set_yticks(range(len(rows)), [f"{row.key}\n{row.contrast.value:.3g}" for row in rows])
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(f"change of the contrast per {unit or 'unit (dimensionless)'}")
