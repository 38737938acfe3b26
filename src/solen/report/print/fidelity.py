"""The coupon figure: the image with the measured features overlaid, and measured against nominal sizes."""

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

WIDE_IN, PLOT_IN, HEAD_IN = 7.0, 2.6, 0.9
MAX_PX = 1800
MANY, WIDE = 6, 0.2
"""An axis is logarithmic if there are more sizes than this, and the smallest is below this fraction of the largest."""
TICKS_MM = (0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)
NAMES = {
    "positive_diameter": "smallest pillar",
    "gap": "smallest gap",
    "hole": "smallest hole",
    "hole_variation": "difference between holes",
    "z_step": "smallest step",
}
WHAT = {"pillar": "diameter of pillars", "hole": "diameter of holes", "gap": "gaps", "step": "steps of height"}


def fidelity_figure(measurement: CouponMeasurement) -> Figure:
    """Draw the image in the layout's orientation, with circles and gaps over it, and the deviations below."""
    kinds = _shown(measurement)
    image, extent = _upright(measurement)
    high = min(max(WIDE_IN * (extent[3] - extent[2]) / (extent[1] - extent[0]), 1.0), 4.5) + HEAD_IN
    figure = Figure(figsize=(WIDE_IN, high + (PLOT_IN if kinds else 0.0)))
    ratios = [high, PLOT_IN] if kinds else [high]
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
    """Return the kinds of features to draw: those whose sizes vary."""
    measured = {feature.kind for feature in measurement.measured if feature.measured_mm is not None}
    kinds = [kind for kind in WHAT if kind in measured]
    return [kind for kind in kinds if kind != "pillar" or not measured & {"gap", "step"}]


def _limits(measurement: CouponMeasurement) -> str:
    """Describe the resolution limits."""
    shown = []
    for limit in measurement.limits:
        name = NAMES[limit.kind]
        if limit.nominal_mm is None:
            shown.append(f"{name} above {limit.next_mm:g} mm")
            continue
        printed = "" if limit.measured_mm is None else f" (printed {limit.measured_mm:.4g})"
        shown.append(f"{name} {'at most ' if limit.bound else ''}{limit.nominal_mm:g} mm{printed}")
    return ", ".join(shown)


def _upright(measurement: CouponMeasurement) -> tuple[FloatArray, tuple[float, float, float, float]]:
    """Return the image (rows upwards), sampled along the layout's axes, and its extent in layout mm."""
    from scipy import ndimage

    (width, depth, _), pose, grey = measurement.layout.size_mm, measurement.location.pose, measurement.raster.grey
    half_x, half_y = 0.5 * width + 0.3, 0.5 * depth + 0.3
    step = max(2.0 * half_x / MAX_PX, 1.0 / pose.px_per_mm)
    x, y = np.arange(-half_x, half_x, step), np.arange(-half_y, half_y, step)
    seen = pose.to_px(np.stack(np.meshgrid(x, y), axis=-1))
    smooth = ndimage.gaussian_filter(grey, max(0.0, 0.4 * step * pose.px_per_mm))
    image = ndimage.map_coordinates(smooth, [seen[..., 1], seen[..., 0]], order=1, cval=float(np.median(grey)))
    return image, (-half_x, half_x, -half_y, half_y)


def _overlay(axes: Axes, measurement: CouponMeasurement) -> None:
    """Draw circles around discs, crosses where nothing was printed, bars over gaps, and heights."""
    coupon, by_name = measurement.layout, {feature.name: feature for feature in measurement.measured}
    for feature in (feature for feature in coupon.features if feature.round and feature.name in by_name):
        at, disc = (feature.x_mm, feature.y_mm), measurement.discs.get(feature.name)
        if disc is not None:
            colour = LOST if feature.kind == "mark" else RIGHT
            radius = 0.5 * disc.diameter_px / measurement.location.pose.px_per_mm
            axes.add_patch(Circle(at, radius, fill=False, lw=0.8, ec=colour))
        elif by_name[feature.name].resolved is False:
            axes.plot(*at, "x", ms=5, mew=1.0, color=LEFT)
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
    """Draw each step against the height reached, with a dashed line for each nominal size."""
    upper = {step.name: coupon.feature(step.between[1]).height_mm for step in coupon.steps}
    sizes = sorted({round(feature.nominal_mm, 6) for feature in features}, reverse=True)
    for number, size in enumerate(sizes):
        colour = SERIES[number % len(SERIES)]
        mine = [
            feature for feature in features if round(feature.nominal_mm, 6) == size and feature.measured_mm is not None
        ]
        axes.axhline(1e3 * size, color=colour, lw=0.7, ls="--")
        for good in (True, False):
            these = [one for one in mine if bool(one.resolved) is good]
            axes.errorbar(
                [upper[one.name] for one in these],
                [1e3 * (one.measured_mm or 0.0) for one in these],
                yerr=[2e3 * (one.u_measured_mm or 0.0) for one in these],
                fmt="o" if good else "x",
                ms=3.5,
                lw=1.0,
                color=colour,
                label=f"{1e3 * size:g} µm" + ("" if good else ", no significant rise") if these else None,
            )
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    axes.legend()
    axes.set(xlabel="nominal height that the step leads to (mm)", ylabel="step (µm)")


def _deviations(axes: Axes, kind: str, features: Sequence[MeasuredSize]) -> None:
    """Draw measured minus nominal sizes, with two standard uncertainties; unresolved features are crosses below."""
    there = [feature for feature in features if feature.measured_mm is not None and feature.resolved]
    nominal = [one.nominal_mm for one in there]
    off = [1e3 * ((one.measured_mm or 0.0) - one.nominal_mm) for one in there]
    axes.errorbar(
        nominal, off, yerr=[2e3 * (one.u_measured_mm or 0.0) for one in there], fmt="o", ms=3.5, lw=1.0, color=RIGHT
    )
    axes.axhline(0.0, color=INK, lw=0.7)
    lost = [feature for feature in features if feature.resolved is False]
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -0.15 * high), max(high, -0.15 * low))
    bottom = axes.get_ylim()[0]
    if lost:
        axes.plot(
            [one.nominal_mm for one in lost], [bottom] * len(lost), "x", color=LEFT, clip_on=False, label="not resolved"
        )
        axes.legend()
    sizes = {feature.nominal_mm for feature in features}
    if len(sizes) > MANY and min(sizes) < WIDE * max(sizes):
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xticks([one for one in TICKS_MM if min(sizes) <= one <= max(sizes)])
    axes.set(xlabel=f"nominal, {WHAT[kind]} (mm)", ylabel="measured − nominal (µm)")
