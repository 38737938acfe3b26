"""Plans of coupons, side by side: what stands, what is a hole, which mark orients it, and the nominal sizes."""

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from solen.geometry.coupons import Coupon, Feature
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SOFT, STYLE

COLOURS = {"mark": LEFT, "hole": "white"}
WIDE_IN = 7.0
INSIDE = 0.3
"""Share of a coupon's depth from which on a feature's number stands in it."""
TITLE_IN, LEAST_IN, MOST_IN = 0.5, 0.5, 2.6


def plans_figure(coupons: list[Coupon]) -> Figure:
    """A plan for each coupon, all as wide as the page, with the scale in mm below each."""
    heights = [_height_in(coupon) for coupon in coupons]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDE_IN, sum(heights) + TITLE_IN * len(coupons)), layout="constrained")
        grid = figure.add_gridspec(len(coupons), 1, height_ratios=[one + TITLE_IN for one in heights])
        for row, coupon in enumerate(coupons):
            _draw(figure.add_subplot(grid[row, 0]), coupon)
    return figure


def _height_in(coupon: Coupon) -> float:
    width, depth, _ = coupon.size_mm
    return min(max(WIDE_IN * depth / width, LEAST_IN), MOST_IN)


def _draw(axes: Axes, coupon: Coupon) -> None:
    width, depth, height = coupon.size_mm
    if coupon.slab is not None:
        slab = coupon.slab
        axes.add_patch(_rectangle(0.0, 0.0, slab.width_mm, slab.depth_mm, slab.bevel_mm, SOFT))
    for one in coupon.features:
        if one.stage in {"", coupon.stages[-1].name}:
            axes.add_patch(_patch(one))
    for one, text in _labels(coupon):
        _label(axes, one, text, inside=one.depth_mm > INSIDE * depth and one.kind != "hole")
    axes.set_xlim(-0.52 * width, 0.52 * width)
    axes.set_ylim(-0.5 * depth - 0.02 * width, 0.5 * depth + 0.02 * width)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.tick_params(labelsize=6)
    axes.set_xlabel("x (mm)", fontsize=6)
    axes.set_ylabel("y (mm)", fontsize=6)
    axes.set_title(f"{coupon.name}: {coupon.title}, {width:.4g} × {depth:.4g} × {height:.4g} mm", fontsize=8)


def _label(axes: Axes, one: Feature, text: str, *, inside: bool) -> None:
    if inside:
        axes.text(one.x_mm, one.y_mm, text, ha="center", va="center", fontsize=7, color="white")
        return
    top = (one.x_mm, one.y_mm + 0.5 * one.depth_mm)
    axes.annotate(text, top, xytext=(0, 2), textcoords="offset points", ha="center", fontsize=5.5, color=INK)


def _labels(coupon: Coupon) -> list[tuple[Feature, str]]:
    """Numbers beside the features: what varies."""
    if coupon.gaps:
        return [(coupon.feature(gap.between[0]), f"{gap.gap_mm:g}") for gap in coupon.gaps]
    shown = [one for one in coupon.features if one.kind != "mark" and one.stage in {"", coupon.stages[-1].name}]
    if coupon.steps or coupon.name == "z-reference":
        return [(one, f"{one.height_mm:g}") for one in shown]
    return [(one, f"{one.exposure_s:g} s" if one.exposure_s else f"{one.width_mm:g}") for one in shown]


def _patch(one: Feature) -> Circle | Polygon:
    colour = COLOURS.get(one.kind, RIGHT)
    if one.round:
        return Circle((one.x_mm, one.y_mm), 0.5 * one.diameter_mm, facecolor=colour, edgecolor=INK, lw=0.4)
    return _rectangle(one.x_mm, one.y_mm, one.width_mm, one.depth_mm, one.bevel_mm, colour)


def _rectangle(x: float, y: float, width: float, depth: float, bevel: float, colour: str) -> Polygon:
    right, back, left, front = x + 0.5 * width, y + 0.5 * depth, x - 0.5 * width, y - 0.5 * depth
    corners = [(left, front), (right, front), (right, back - bevel), (right - bevel, back), (left, back)]
    return Polygon(corners, facecolor=colour, edgecolor=LOST, lw=0.6)
