"""Figures of a design's lens: profile and focus."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.lens import LayeredLens, Lens, LensInSpace, MeasuredLens, OvalLens, SplineLens
from solen.report.canvas import HIGHER, INK, LOST, LOWER, SOFT
from solen.sensor import LensCheck, Sensor, tolerance_of
from solen.sensor.effects import index_offsets

PAPER_INDICES = (1.44, 1.49, 1.54)
TOLERANCE_MM = 1e-4
"""Largest distance between a drawn profile and the exact one."""
COLUMNS, ROWS = 41, 41
"""Numbers of points along x and y at which a face in space is drawn."""
INDEX_STEPS = 3.0
"""Range of the index in the focus figure, in units of its uncertainty, to either side."""


def lens_figure(check: LensCheck) -> Figure:
    """Draw the profile of a design's lens."""
    return profile_figure(check.lens)


def profile_figure(lens: Lens) -> Figure:
    """Draw the lens profile, with ovals for the paper's indices or, for a measured lens, with the designed profile."""
    if isinstance(lens, LensInSpace):
        return _figure_in_space(lens)
    if isinstance(lens, SplineLens):
        return _spline_figure(lens)
    figure = Figure(figsize=(5.2, 2.7))
    axes = figure.add_subplot()
    if isinstance(lens, OvalLens):
        _draw_ovals(axes, lens)
    else:
        label = {"none": "flat face"}.get(lens.shape, lens.shape)
        axes.plot(*lens.front.flattened(TOLERANCE_MM).T, color=INK, lw=2, label=label)
    if isinstance(lens, MeasuredLens):
        axes.plot(*lens.designed.front.flattened(TOLERANCE_MM).T, color=LOST, lw=1.2, ls="--", label="designed")
    axes.set(xlabel="x (mm)", ylabel="z (mm), from the vertex")
    axes.set_aspect("equal")
    axes.legend()
    return figure


def _spline_figure(lens: SplineLens) -> Figure:
    """Draw the face and the oval from which it deviates, and the deviation with its knots."""
    figure = Figure(figsize=(7.2, 2.9))
    axes, deviation_axes = figure.subplots(1, 2)
    x = np.linspace(-lens.half_width_mm, lens.half_width_mm, 401)
    axes.plot(x, lens.oval.z_mm(x), color=LOST, lw=1.2, ls="--", label="oval")
    axes.plot(x, lens.z_mm(x), color=INK, lw=2, label="spline")
    axes.set(xlabel="x (mm)", ylabel="z (mm), from the oval's vertex")
    axes.set_aspect("equal")
    axes.legend()
    deviation_axes.axhline(0.0, color=LOST, lw=1.2, ls="--")
    deviation_axes.plot(x, 1e3 * lens.deviation_mm(x), color=INK, lw=1.8)
    knots_mm = lens.knots_at_mm[:-1]
    for side in (-knots_mm, knots_mm):
        deviation_axes.plot(side, lens.knots_um, "o", color=HIGHER, ms=4)
    deviation_axes.set(xlabel="x (mm)", ylabel="deviation along z (µm)")
    return figure


def _figure_in_space(lens: LensInSpace) -> Figure:
    """Draw the face of a lens that is not a cylinder, in three dimensions, and its profiles at some heights."""
    figure = Figure(figsize=(7.6, 3.2))
    grid = figure.add_gridspec(1, 3, width_ratios=(1.0, 0.06, 1.0))
    solid = figure.add_subplot(grid[0], projection="3d")
    x = np.linspace(-lens.half_width_mm, lens.half_width_mm, COLUMNS)
    heights, section_heights = _heights(lens)
    x_grid, y_grid = np.meshgrid(x, heights)
    z = lens.z_at(x_grid, np.meshgrid(x, section_heights)[1])
    solid.plot_surface(x_grid, y_grid, z, color=SOFT, edgecolor=LOST, linewidth=0.3, rstride=1, cstride=1)
    solid.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    solid.zaxis.labelpad = 0.0
    solid.zaxis.set_major_locator(MaxNLocator(2))
    solid.set_box_aspect((lens.half_width_mm, lens.half_height_mm, 0.5 * lens.deepest_mm), zoom=0.82)
    axes = figure.add_subplot(grid[2])
    for fraction, color in zip((0.0, 0.5, 1.0), (INK, LOWER, HIGHER), strict=True):
        y_mm = fraction * lens.half_height_mm * (1.0 - 1e-9)
        axes.plot(x, lens.z_at(x, np.full_like(x, y_mm)), color=color, lw=1.8, label=f"y = {y_mm:.3g} mm")
    axes.set(xlabel="x (mm)", ylabel="z (mm)")
    axes.set_aspect("equal")
    axes.legend()
    return figure


def _heights(lens: LensInSpace) -> tuple[FloatArray, FloatArray]:
    """Return the heights at which a face is drawn, and those of the drawn sections; slab boundaries occur twice."""
    if isinstance(lens, LayeredLens) and lens.layers < ROWS:
        return np.repeat(lens.edges_mm, 2)[1:-1], np.repeat(lens.middles_mm, 2)
    heights = np.linspace(-1.0, 1.0, ROWS) * lens.half_height_mm * (1.0 - 1e-9)
    return heights, heights


def focus_figure(sensor: Sensor) -> Figure:
    """Draw the focus of the lens against the material index, with the index uncertainty as a band.

    If the uncertainty is unknown, the band shows the tolerance of the index.
    """
    lens, material = sensor.lens, sensor.material
    if not isinstance(lens, OvalLens):
        limit, remedy = "has no computed focus", "use a Cartesian oval"
        raise DesignError("lens.shape", value=sensor.design.lens.shape, limit=limit, remedy=remedy)
    figure = Figure(figsize=(5.2, 3.2))
    axes = figure.add_subplot()
    steps = index_offsets(material, tolerance_of(sensor, "material.index")[0])
    half = max(abs(step) for step, _ in steps)
    indices = np.linspace(max(material.index - INDEX_STEPS * half, 1.0), material.index + INDEX_STEPS * half, 61)
    kind = "standard uncertainty" if material.u_index else "tolerance"
    band = f"{material.index:.6g} ± {half:.2g} ({kind})"
    axes.axvspan(material.index - half, material.index + half, color=SOFT, alpha=0.6, lw=0, label=band)
    lines: tuple[tuple[str, Callable[[float], float | None], str], ...] = (
        ("rays near the axis", lens.paraxial_focus_mm, LOWER),
        ("smallest spot", lens.best_focus_mm, INK),
        ("edge rays", lens.marginal_focus_mm, HIGHER),
    )
    for name, focus_mm, colour in lines:
        axes.plot(indices, [_or_nan(focus_mm(float(index))) for index in indices], color=colour, lw=1.8, label=name)
    axes.axhline(lens.focus_mm, color=INK, lw=0.8, ls=":", label="specified")
    axes.set(xlabel="material index", ylabel="focus behind the vertex (mm)")
    axes.set(xlim=(indices[0], indices[-1]), ylim=(0.0, 2.0 * lens.focus_mm))
    axes.legend()
    return figure


def _draw_ovals(axes: Axes, lens: OvalLens) -> None:
    x = np.linspace(-lens.half_width_mm, lens.half_width_mm, 401)
    for index, dashes in zip(PAPER_INDICES, ((4, 2), (1, 1.5), (6, 2, 1, 2)), strict=True):
        other = _with_index(lens, index)
        if other is not None and abs(index - lens.design_index) > 1e-9:
            axes.plot(x, other.z_mm(x), color=LOST, lw=1.2, dashes=dashes, label=f"n = {index:g}")
    axes.plot(x, lens.z_mm(x), color=INK, lw=2, label=f"n = {lens.design_index:.4g} (this lens)")


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def _with_index(lens: OvalLens, index: float) -> OvalLens | None:
    """Return the lens designed for another index; None if the oval for that index is too narrow."""
    try:
        return OvalLens(lens.distance_mm, lens.focus_mm, lens.half_width_mm, index)
    except DesignError:
        return None
