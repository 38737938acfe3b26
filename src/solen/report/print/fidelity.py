"""The fidelity figure: the image of a coupon with its measured features, and their sizes against nominal sizes."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import NullFormatter

from solen.arrays import FloatArray
from solen.geometry.coupons import Coupon
from solen.metrology.coupons import CouponMeasurement, MeasuredSize
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SERIES, SPACE

WIDTH_IN, PLOT_IN, TITLE_IN = 7.0, 2.6, 0.9
MAX_PX = 1800
"""Longer side of the drawn image, in pixels."""
MAX_LINEAR_SIZES, MIN_LINEAR_RATIO = 6, 0.2
"""An axis is logarithmic if there are more sizes, and the smallest is less than this fraction of the largest."""
TICKS_MM = (0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)
NAMES = {
    "positive_diameter": "smallest pillar",
    "gap": "smallest gap",
    "hole": "smallest hole",
    "hole_variation": "difference between holes",
    "z_step": "smallest step",
}
QUANTITIES = {"pillar": "pillar diameter", "hole": "hole diameter", "gap": "gap width", "step": "step height"}


def fidelity_figure(measurement: CouponMeasurement) -> Figure:
    """Draw the image in the orientation of the layout, with measured features, and deviations from nominal sizes."""
    kinds = _shown(measurement)
    image, extent = _upright(measurement)
    height = min(max(WIDTH_IN * (extent[3] - extent[2]) / (extent[1] - extent[0]), 1.0), 4.5) + TITLE_IN
    figure = Figure(figsize=(WIDTH_IN, height + (PLOT_IN if kinds else 0.0)))
    ratios = [height, PLOT_IN] if kinds else [height]
    grid = figure.add_gridspec(len(ratios), max(1, len(kinds)), height_ratios=ratios)
    axes = figure.add_subplot(grid[0, :])
    axes.imshow(image, extent=extent, origin="lower", cmap="gray", interpolation="antialiased")
    _overlay(axes, measurement)
    axes.grid(visible=False)
    axes.set(xlabel="x of the layout (mm)", ylabel="y (mm)")
    simulated = "simulated: " if measurement.simulated else ""
    title = f"{simulated}{measurement.sources[0].file}: {measurement.coupon}\n{_limits(measurement)}"
    axes.set_title(title)
    for column, kind in enumerate(kinds):
        below = figure.add_subplot(grid[1, column])
        features = [feature for feature in measurement.measured if feature.kind == kind]
        if kind == "step":
            _steps(below, measurement.layout, features)
        else:
            _deviations(below, kind, features)
    return figure


def _shown(measurement: CouponMeasurement) -> list[str]:
    """Return the kinds of features whose deviations are drawn; pillars only if no gaps or steps were measured."""
    measured = {feature.kind for feature in measurement.measured if feature.measured_mm is not None}
    kinds = [kind for kind in QUANTITIES if kind in measured]
    return [kind for kind in kinds if kind != "pillar" or not measured & {"gap", "step"}]


def _limits(measurement: CouponMeasurement) -> str:
    """Describe the smallest resolved features."""
    texts = []
    for limit in measurement.limits:
        name = NAMES[limit.kind]
        if limit.nominal_mm is None:
            texts.append(f"{name} above {limit.next_mm:g} mm")
            continue
        printed = "" if limit.measured_mm is None else f" (printed {limit.measured_mm:.4g})"
        texts.append(f"{name} {'at most ' if limit.bound else ''}{limit.nominal_mm:g} mm{printed}")
    return ", ".join(texts)


def _upright(measurement: CouponMeasurement) -> tuple[FloatArray, tuple[float, float, float, float]]:
    """Return the image (rows upwards), resampled along the axes of the layout, and its extent in mm."""
    from scipy import ndimage

    (width, depth, _), pose, grey = measurement.layout.size_mm, measurement.location.pose, measurement.raster.grey
    half_x, half_y = 0.5 * width + 0.3, 0.5 * depth + 0.3
    step = max(2.0 * half_x / MAX_PX, 1.0 / pose.px_per_mm)
    x, y = np.arange(-half_x, half_x, step), np.arange(-half_y, half_y, step)
    points = pose.to_px(np.stack(np.meshgrid(x, y), axis=-1))
    smooth = ndimage.gaussian_filter(grey, max(0.0, 0.4 * step * pose.px_per_mm))
    image = ndimage.map_coordinates(smooth, [points[..., 1], points[..., 0]], order=1, cval=float(np.median(grey)))
    return image, (-half_x, half_x, -half_y, half_y)


def _overlay(axes: Axes, measurement: CouponMeasurement) -> None:
    """Draw circles around discs, crosses at missing features, lines over gaps, and heights."""
    coupon, by_name = measurement.layout, {feature.name: feature for feature in measurement.measured}
    for feature in (feature for feature in coupon.features if feature.round and feature.name in by_name):
        centre, disc = (feature.x_mm, feature.y_mm), measurement.discs.get(feature.name)
        if disc is not None:
            colour = LOST if feature.kind == "mark" else RIGHT
            radius = 0.5 * disc.diameter_px / measurement.location.pose.px_per_mm
            axes.add_patch(Circle(centre, radius, fill=False, lw=0.8, ec=colour))
        elif by_name[feature.name].resolved is False:
            axes.plot(*centre, "x", ms=5, mew=1.0, color=LEFT)
        if not coupon.gaps and feature.kind != "mark":
            text = f"{feature.height_mm:.4g}" if coupon.steps else f"{feature.diameter_mm:g}"
            _note(axes, feature.x_mm, feature.y_mm + 0.5 * feature.depth_mm, text)
    for gap in coupon.gaps:
        open_gap = bool(by_name[gap.name].resolved)
        left, right = (coupon.feature(name) for name in gap.between)
        colour, style = (SPACE, "-") if open_gap else (LEFT, ":")
        axes.plot([left.x_mm, right.x_mm], [left.y_mm, right.y_mm], color=colour, lw=1.2, ls=style)
        _note(axes, 0.5 * (left.x_mm + right.x_mm), left.y_mm + 0.5 * left.depth_mm, f"{gap.gap_mm:g}")
    for height in measurement.heights:
        feature = coupon.feature(height.name)
        if feature.kind != "mark" and not feature.round:
            box = {"boxstyle": "round", "fc": "white", "ec": "none", "alpha": 0.8}
            text = f"{height.measured_mm:.4f} mm"
            axes.text(feature.x_mm, feature.y_mm, text, ha="center", va="center", fontsize="small", color=INK, bbox=box)


def _note(axes: Axes, x: float, y: float, text: str) -> None:
    axes.annotate(
        text, (x, y), xytext=(0, 3), textcoords="offset points", ha="center", fontsize="small", color="#ffd24d",
        path_effects=[withStroke(linewidth=1.6, foreground=INK)],
    )  # fmt: skip


def _steps(axes: Axes, coupon: Coupon, features: Sequence[MeasuredSize]) -> None:
    """Draw the steps against the height of their upper levels, with a dashed line for each nominal size."""
    upper = {step.name: coupon.feature(step.between[1]).height_mm for step in coupon.steps}
    sizes = sorted({round(feature.nominal_mm, 6) for feature in features}, reverse=True)
    for number, size in enumerate(sizes):
        colour = SERIES[number % len(SERIES)]
        measured = [
            feature for feature in features if round(feature.nominal_mm, 6) == size and feature.measured_mm is not None
        ]
        axes.axhline(1e3 * size, color=colour, lw=0.7, ls="--")
        for resolved in (True, False):
            steps = [feature for feature in measured if bool(feature.resolved) is resolved]
            axes.errorbar(
                [upper[feature.name] for feature in steps],
                [1e3 * (feature.measured_mm or 0.0) for feature in steps],
                yerr=[2e3 * (feature.u_measured_mm or 0.0) for feature in steps],
                fmt="o" if resolved else "x",
                ms=3.5,
                lw=1.0,
                color=colour,
                label=f"{1e3 * size:g} µm" + ("" if resolved else ", not significant") if steps else None,
            )
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    axes.legend()
    axes.set(xlabel="nominal height of the upper level (mm)", ylabel="step height (µm)")


def _deviations(axes: Axes, kind: str, features: Sequence[MeasuredSize]) -> None:
    """Draw measured minus nominal sizes with two standard uncertainties, and crosses for unresolved features."""
    measured = [feature for feature in features if feature.measured_mm is not None and feature.resolved]
    nominal = [feature.nominal_mm for feature in measured]
    deviation = [1e3 * ((feature.measured_mm or 0.0) - feature.nominal_mm) for feature in measured]
    u = [2e3 * (feature.u_measured_mm or 0.0) for feature in measured]
    axes.errorbar(nominal, deviation, yerr=u, fmt="o", ms=3.5, lw=1.0, color=RIGHT)
    axes.axhline(0.0, color=INK, lw=0.7)
    unresolved = [feature.nominal_mm for feature in features if feature.resolved is False]
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -0.15 * high), max(high, -0.15 * low))
    bottom = axes.get_ylim()[0]
    if unresolved:
        axes.plot(unresolved, [bottom] * len(unresolved), "x", color=LEFT, clip_on=False, label="not resolved")
        axes.legend()
    sizes = {feature.nominal_mm for feature in features}
    if len(sizes) > MAX_LINEAR_SIZES and min(sizes) < MIN_LINEAR_RATIO * max(sizes):
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xticks([tick for tick in TICKS_MM if min(sizes) <= tick <= max(sizes)])
    axes.set(xlabel=f"nominal {QUANTITIES[kind]} (mm)", ylabel="measured − nominal (µm)")
