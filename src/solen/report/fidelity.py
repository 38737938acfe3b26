"""The figure of a measured coupon: its picture with what was found drawn over it, and what came out against nominal."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from solen.geometry.coupons import Coupon
from solen.metrology.coupons import Fidelity, Measured
from solen.recording import Provenance
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SPACE, STYLE

Floats = NDArray[np.float64]

WIDE_IN, PLOT_IN = 7.0, 2.6
MOST_PX = 1800
NAMES = {
    "positive_diameter": "smallest pillar",
    "gap": "smallest gap",
    "hole": "smallest hole",
    "hole_variation": "variation of holes",
    "z_step": "smallest step",
}
WHAT = {"pillar": "diameter of pillars", "hole": "diameter of holes", "gap": "gaps", "step": "steps of height"}


def fidelity_figure(grey: Floats, coupon: Coupon, found: Fidelity, source: Provenance) -> Figure:
    """The picture turned as the layout is drawn, circles and gaps over it, and deviations below."""
    kinds = [kind for kind in WHAT if any(one.kind == kind and one.measured_mm is not None for one in found.measured)]
    kinds = [kind for kind in kinds if kind != "pillar" or "gap" not in kinds]
    picture, extent, to_mm = _upright(grey, coupon, found)
    high = WIDE_IN * (extent[3] - extent[2]) / (extent[1] - extent[0])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDE_IN, min(high, 4.5) + 0.7 + (PLOT_IN if kinds else 0.0)), layout="constrained")
        grid = figure.add_gridspec(
            2 if kinds else 1, max(1, len(kinds)), height_ratios=[min(high, 4.5) + 0.4, PLOT_IN][: 1 + bool(kinds)]
        )
        axes = figure.add_subplot(grid[0, :])
        axes.imshow(picture, extent=extent, origin="lower", cmap="gray", interpolation="antialiased")
        _overlay(axes, coupon, found, to_mm)
        axes.grid(visible=False)
        axes.set(xlabel="x of the layout (mm)", ylabel="y (mm)")
        axes.set_title(
            f"{'simulated: ' if source.simulated else ''}{source.file}: {coupon.name}; {_limits(found)}", fontsize=8
        )
        for column, kind in enumerate(kinds):
            _deviations(figure.add_subplot(grid[1, column]), kind, [one for one in found.measured if one.kind == kind])
    return figure


def _limits(found: Fidelity) -> str:
    """The limits as words."""
    shown = []
    for limit in found.limits:
        name = NAMES[limit.kind]
        if limit.nominal_mm is None:
            shown.append(f"{name} above {limit.next_mm:g} mm")
            continue
        printed = "" if limit.measured_mm is None else f" (printed {limit.measured_mm:.3f})"
        shown.append(f"{name} {'at most ' if limit.bound else ''}{limit.nominal_mm:g} mm{printed}")
    return ", ".join(shown)


def _upright(grey: Floats, coupon: Coupon, found: Fidelity) -> tuple[Floats, tuple[float, float, float, float], float]:
    """Picture (rows upwards) sampled along the layout's axes, its extent in mm of the layout, and px per mm."""
    from scipy import ndimage

    width, depth, _ = coupon.size_mm
    half_x, half_y = 0.5 * width + 0.3, 0.5 * depth + 0.3
    step = max(2.0 * half_x / MOST_PX, 1.0 / found.registration.placement.px_per_mm)
    x, y = np.arange(-half_x, half_x, step), np.arange(-half_y, half_y, step)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    seen = found.registration.placement.px(places)
    smooth = ndimage.gaussian_filter(grey, max(0.0, 0.4 * step * found.registration.placement.px_per_mm))
    picture = ndimage.map_coordinates(smooth, [seen[:, 1], seen[:, 0]], order=1, cval=float(np.median(grey)))
    return picture.reshape(len(y), len(x)), (-half_x, half_x, -half_y, half_y), found.registration.placement.px_per_mm


def _overlay(axes: Axes, coupon: Coupon, found: Fidelity, px_per_mm: float) -> None:
    """Circles as found, crosses where nothing is, bars over merged gaps."""
    by = {one.name: one for one in found.measured}
    for one in coupon.features:
        told = by.get(one.name)
        if told is None or not one.round:
            continue
        at = (one.x_mm, one.y_mm)
        if told.measured_mm is not None:
            disc = found.discs[one.name]
            axes.add_patch(
                Circle(
                    at, 0.5 * disc.diameter_px / px_per_mm, fill=False, lw=0.8, ec=LOST if one.kind == "mark" else RIGHT
                )
            )
        elif told.resolved is False:
            axes.plot(*at, "x", ms=5, mew=1.0, color=LEFT)
        if not coupon.gaps and one.kind != "mark":
            _note(axes, one.x_mm, one.y_mm + 0.5 * one.depth_mm, f"{one.diameter_mm:g}")
    for gap in coupon.gaps:
        told = by[gap.name]
        one, other = (coupon.feature(name) for name in gap.between)
        colour = SPACE if told.resolved else LEFT
        axes.plot(
            [one.x_mm, other.x_mm], [one.y_mm, other.y_mm], color=colour, lw=1.2, ls="-" if told.resolved else ":"
        )
        _note(axes, 0.5 * (one.x_mm + other.x_mm), one.y_mm + 0.5 * one.depth_mm, f"{gap.gap_mm:g}")
    for name, height in found.heights.items():
        one = coupon.feature(name)
        if one.kind != "mark" and not one.round:
            axes.text(
                one.x_mm, one.y_mm, f"{height.height_mm:.4f} mm", ha="center", va="center", fontsize=7, color=LEFT
            )


def _note(axes: Axes, x: float, y: float, text: str) -> None:
    axes.annotate(text, (x, y), xytext=(0, 3), textcoords="offset points", ha="center", fontsize=5.5, color="#ffd24d")


def _deviations(axes: Axes, kind: str, some: Sequence[Measured]) -> None:
    """Measured less nominal, with two standard uncertainties; crosses at the bottom for what is not resolved."""
    there = [one for one in some if one.measured_mm is not None and one.resolved]
    nominal = [one.nominal_mm for one in there]
    off = [1e3 * ((one.measured_mm or 0.0) - one.nominal_mm) for one in there]
    axes.errorbar(nominal, off, yerr=[2e3 * (one.u_mm or 0.0) for one in there], fmt="o", ms=3.5, lw=1.0, color=RIGHT)
    axes.axhline(0.0, color=INK, lw=0.7)
    lost = [one for one in some if one.resolved is False]
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -0.15 * high), max(high, -0.15 * low))
    bottom = axes.get_ylim()[0]
    axes.plot(
        [one.nominal_mm for one in lost], [bottom] * len(lost), "x", color=LEFT, clip_on=False, label="not resolved"
    )
    if lost:
        axes.legend(fontsize=7)
    if len({one.nominal_mm for one in some}) > 6 and min(one.nominal_mm for one in some) < 0.2 * max(
        one.nominal_mm for one in some
    ):
        axes.set_xscale("log")
    axes.set(xlabel=f"nominal, {WHAT[kind]} (mm)", ylabel="measured − nominal (µm)")
