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
ACROSS, UP = 41, 41
"""Number of points across and up at which a face in space is drawn."""
SHOWN_STEPS = 3.0
"""The focus figure varies the index by this multiple of its uncertainty."""


def lens_figure(check: LensCheck) -> Figure:
    """Draw the profile of a design's lens."""
    return profile_figure(check.lens)


def profile_figure(lens: Lens) -> Figure:
    """Draw the lens profile, with ovals for the paper's indices or, for a measured lens, with the designed profile."""
    if isinstance(lens, LensInSpace):
        return _figure_in_space(lens)
    if isinstance(lens, SplineLens):
        return _figure_of_spline(lens)
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


def _figure_of_spline(lens: SplineLens) -> Figure:
    """Draw the face next to the oval, and its deviation, with the knots."""
    figure = Figure(figsize=(7.2, 2.9))
    axes, beyond = figure.subplots(1, 2)
    x = np.linspace(-lens.half_width_mm, lens.half_width_mm, 401)
    axes.plot(x, lens.oval.z_mm(x), color=LOST, lw=1.2, ls="--", label="oval")
    axes.plot(x, lens.z_mm(x), color=INK, lw=2, label="spline")
    axes.set(xlabel="x (mm)", ylabel="z (mm), from the oval's vertex")
    axes.set_aspect("equal")
    axes.legend()
    beyond.axhline(0.0, color=LOST, lw=1.2, ls="--")
    beyond.plot(x, 1e3 * lens.deviation_mm(x), color=INK, lw=1.8)
    at = lens.knots_at_mm[:-1]
    for side in (-at, at):
        beyond.plot(side, lens.knots_um, "o", color=HIGHER, ms=4)
    beyond.set(xlabel="x (mm)", ylabel="deviation along z (µm)")
    return figure


def _figure_in_space(lens: LensInSpace) -> Figure:
    """Draw the face of a lens that is not a cylinder, in three dimensions, and its profiles at some heights."""
    figure = Figure(figsize=(7.6, 3.2))
    grid = figure.add_gridspec(1, 3, width_ratios=(1.0, 0.06, 1.0))
    solid = figure.add_subplot(grid[0], projection="3d")
    x = np.linspace(-lens.half_width_mm, lens.half_width_mm, ACROSS)
    heights, inside = _heights(lens)
    across, up = np.meshgrid(x, heights)
    z = lens.z_at(across, np.meshgrid(x, inside)[1])
    solid.plot_surface(across, up, z, color=SOFT, edgecolor=LOST, linewidth=0.3, rstride=1, cstride=1)
    solid.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    solid.zaxis.labelpad = 0.0
    solid.zaxis.set_major_locator(MaxNLocator(2))
    solid.set_box_aspect((lens.half_width_mm, lens.half_height_mm, 0.5 * lens.deepest_mm), zoom=0.82)
    axes = figure.add_subplot(grid[2])
    for share, color in zip((0.0, 0.5, 1.0), (INK, LOWER, HIGHER), strict=True):
        y_mm = share * lens.half_height_mm * (1.0 - 1e-9)
        axes.plot(x, lens.z_at(x, np.full_like(x, y_mm)), color=color, lw=1.8, label=f"y = {y_mm:.3g} mm")
    axes.set(xlabel="x (mm)", ylabel="z (mm)")
    axes.set_aspect("equal")
    axes.legend()
    return figure


def _heights(lens: LensInSpace) -> tuple[FloatArray, FloatArray]:
    """Return the heights at which to draw a face, and its section heights: both sides of each slab boundary."""
    if isinstance(lens, LayeredLens) and lens.layers < UP:
        return np.repeat(lens.edges_mm, 2)[1:-1], np.repeat(lens.middles_mm, 2)
    heights = np.linspace(-1.0, 1.0, UP) * lens.half_height_mm * (1.0 - 1e-9)
    return heights, heights


def focus_figure(sensor: Sensor) -> Figure:
    """Draw the focus of the lens against the material index, with the index uncertainty as a band.

    If the uncertainty is unknown, the band shows the step used instead.
    """
    lens, material = sensor.lens, sensor.material
    if not isinstance(lens, OvalLens):
        raise DesignError("lens.shape", value=sensor.design.lens.shape, limit="has no focus")
    figure = Figure(figsize=(5.2, 3.2))
    axes = figure.add_subplot()
    steps = index_offsets(material, tolerance_of(sensor, "material.index")[0])
    half, stated = max(abs(step) for step, _ in steps), bool(material.u_index)
    indices = np.linspace(max(material.index - SHOWN_STEPS * half, 1.0), material.index + SHOWN_STEPS * half, 61)
    band = f"{material.index:.6g} ± {half:.2g}" + (" (standard)" if stated else ", for comparison")
    axes.axvspan(material.index - half, material.index + half, color=SOFT, alpha=0.6, lw=0, label=band)
    lines: tuple[tuple[str, Callable[[float], float | None], str], ...] = (
        ("rays near the axis", lens.paraxial_focus_mm, LOWER),
        ("smallest spot", lens.best_focus_mm, INK),
        ("edge rays", lens.marginal_focus_mm, HIGHER),
    )
    for name, at, colour in lines:
        axes.plot(indices, [_or_nan(at(float(index))) for index in indices], color=colour, lw=1.8, label=name)
    axes.axhline(lens.focus_mm, color=INK, lw=0.8, ls=":", label="asked for")
    axes.set(xlabel="material index", ylabel="focus behind the vertex (mm)")
    axes.set(xlim=(indices[0], indices[-1]), ylim=(0.0, 2.0 * lens.focus_mm))
    axes.legend()
    return figure


def _draw_ovals(axes: Axes, lens: OvalLens) -> None:
    x = np.linspace(-lens.half_width_mm, lens.half_width_mm, 401)
    for index, dashes in zip(PAPER_INDICES, ((4, 2), (1, 1.5), (6, 2, 1, 2)), strict=True):
        other = _same_lens(lens, index)
        if other is not None and abs(index - lens.design_index) > 1e-9:
            axes.plot(x, other.z_mm(x), color=LOST, lw=1.2, dashes=dashes, label=f"n = {index:g}")
    axes.plot(x, lens.z_mm(x), color=INK, lw=2, label=f"n = {lens.design_index:.4g} (this lens)")


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def _same_lens(lens: OvalLens, index: float) -> OvalLens | None:
    """Return the lens cut for another index; None if the oval for that index is too narrow."""
    try:
        return OvalLens(lens.distance_mm, lens.focus_mm, lens.half_width_mm, index)
    except DesignError:
        return None
