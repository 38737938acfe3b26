"""Plans of coupons, side by side: what stands, what is a hole, which mark orients it, and the nominal sizes."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from solen.fabricate.coupons import CouponSet
from solen.geometry.coupons import Coupon, Feature
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SOFT

COLOURS = {"mark": LEFT, "hole": "white"}
WIDE_IN = 7.0
INSIDE = 0.3
"""Share of a coupon's depth from which on a feature's number stands in it."""
TITLE_IN, LEAST_IN, MOST_IN = 0.5, 0.5, 2.6


def plans_figure(coupon_set: CouponSet) -> Figure:
    """A plan for each coupon, all as wide as the page, with the scale in mm below each."""
    coupons = coupon_set.layouts
    heights = [_height_in(coupon) for coupon in coupons]
    figure = Figure(figsize=(WIDE_IN, sum(heights) + TITLE_IN * len(coupons)))
    grid = figure.add_gridspec(len(coupons), 1, height_ratios=[height + TITLE_IN for height in heights])
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
    for feature in coupon.features:
        if feature.stage in {"", coupon.stages[-1].name}:
            axes.add_patch(_patch(feature))
    for feature, text in _labels(coupon):
        _label(axes, feature, text, inside=feature.depth_mm > INSIDE * depth and feature.kind != "hole")
    axes.set_xlim(-0.52 * width, 0.52 * width)
    axes.set_ylim(-0.5 * depth - 0.02 * width, 0.5 * depth + 0.02 * width)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set(xlabel="x (mm)", ylabel="y (mm)")
    axes.set_title(f"{coupon.name}: {coupon.title}, {width:.4g} × {depth:.4g} × {height:.4g} mm")


def _label(axes: Axes, feature: Feature, text: str, *, inside: bool) -> None:
    if inside:
        axes.text(feature.x_mm, feature.y_mm, text, ha="center", va="center", fontsize="small", color="white")
        return
    top = (feature.x_mm, feature.y_mm + 0.5 * feature.depth_mm)
    axes.annotate(text, top, xytext=(0, 2), textcoords="offset points", ha="center", fontsize="small", color=INK)


def _labels(coupon: Coupon) -> list[tuple[Feature, str]]:
    """Numbers beside the features: what varies."""
    if coupon.gaps:
        return [(coupon.feature(gap.between[0]), f"{gap.gap_mm:g}") for gap in coupon.gaps]
    shown = [
        feature
        for feature in coupon.features
        if feature.kind != "mark" and feature.stage in {"", coupon.stages[-1].name}
    ]
    if coupon.steps or coupon.name == "z-reference":
        return [(feature, f"{feature.height_mm:g}") for feature in shown]
    return [(each, f"{each.exposure_s:g} s" if each.exposure_s else f"{each.width_mm:g}") for each in shown]


def _patch(feature: Feature) -> Circle | Polygon:
    colour = COLOURS.get(feature.kind, RIGHT)
    if feature.round:
        return Circle((feature.x_mm, feature.y_mm), 0.5 * feature.diameter_mm, facecolor=colour, edgecolor=INK, lw=0.4)
    return _rectangle(feature.x_mm, feature.y_mm, feature.width_mm, feature.depth_mm, feature.bevel_mm, colour)


def _rectangle(x: float, y: float, width: float, depth: float, bevel: float, colour: str) -> Polygon:
    right, back, left, front = x + 0.5 * width, y + 0.5 * depth, x - 0.5 * width, y - 0.5 * depth
    corners = [(left, front), (right, front), (right, back - bevel), (right - bevel, back), (left, back)]
    return Polygon(corners, facecolor=colour, edgecolor=LOST, lw=0.6)
