"""Plans of coupons with their features and nominal sizes, and the sequence of a coupon printed in several runs."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from solen.fabricate.coupons import CouponSet
from solen.geometry.coupons import Coupon, Feature
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SOFT, SPACE

COLOURS = {"mark": LEFT, "hole": "white"}
WIDTH_IN = 7.0
MIN_DEPTH_RATIO = 0.3
"""Minimum depth of a feature with a label inside, as a fraction of the depth of the coupon."""
LETTER, ABOVE = 0.02, 0.08
"""Width of a letter, and space for labels above features, as fractions of the width of the plan."""
TITLE_IN, MIN_IN, MAX_IN = 0.5, 0.5, 2.6


def plans_figure(coupon_set: CouponSet) -> Figure:
    """Draw the plan of each coupon with its scale in mm; for a coupon printed in several runs, the sequence."""
    coupons = coupon_set.layouts
    if len(coupons) == 1 and len(coupons[0].stages) > 1:
        return _sequence(coupons[0])
    heights = [_height_in(coupon) for coupon in coupons]
    figure = Figure(figsize=(WIDTH_IN, sum(heights) + TITLE_IN * len(coupons)))
    grid = figure.add_gridspec(len(coupons), 1, height_ratios=[height + TITLE_IN for height in heights])
    for row, coupon in enumerate(coupons):
        _draw(figure.add_subplot(grid[row, 0]), coupon)
    return figure


def _sequence(coupon: Coupon) -> Figure:
    """Draw side views of a coupon printed in several runs, and the slab that the evaluation of the layer assumes.

    Thicknesses are labelled, and not to scale.
    """
    base, layer = (
        next(feature for feature in coupon.features if feature.stage == stage.name) for stage in coupon.stages
    )
    film_mm = coupon.stages[1].z_offset_mm - base.height_mm
    stack = (
        (f"base, {base.height_mm:g} mm", LOST, 1.0),
        (f"film, {film_mm:g} mm", SPACE, 0.4),
        (f"layer, {1e3 * layer.height_mm:g} µm, {layer.exposure_s:g} s", RIGHT, 0.4),
    )
    steps = (("base printed", stack[:1], True), ("film cured onto it", stack[:2], True), ("layer cured", stack, True),
             ("separated, for R and T", stack[1:], False))  # fmt: skip
    figure = Figure(figsize=(7.0, 4.2))
    grid = figure.add_gridspec(2, 3)
    for number, (title, parts, on_plate) in enumerate(steps):
        axes = figure.add_subplot(grid[divmod(number, 3)])
        _side_view(axes, parts, on_plate=on_plate)
        axes.set_title(title)
    _slab(figure.add_subplot(grid[1, 1]))
    return figure


def _slab(axes: Axes) -> None:
    """Draw the rays reflected (R) and transmitted (T) by a slab of thickness h."""
    low, high, step, bottom, top = 1.3, 2.3, 0.4, 0.6, 3.0
    axes.add_patch(Rectangle((-1.2, low), 2.9, high - low, facecolor=RIGHT, alpha=0.25, lw=0))
    starts = [-0.5 + 2.0 * step * number for number in range(3)]
    arrow = {"arrowstyle": "->", "color": LEFT, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (starts[0], high), (starts[0] - 0.4, top), arrowprops=arrow)
    for number, x in enumerate(starts):
        axes.annotate("", (x + 0.4, top), (x, high), arrowprops=arrow | {"alpha": 0.9**number})
        if number < len(starts) - 1:
            axes.plot([x, x + step, x + 2.0 * step], [high, low, high], color=LEFT, lw=1.0, alpha=0.8**number)
            axes.annotate("", (x + step + 0.4, bottom), (x + step, low), arrowprops=arrow | {"alpha": 0.9**number})
    axes.annotate(
        "", (1.85, low), (1.85, high), arrowprops={"arrowstyle": "<->", "color": INK, "shrinkA": 0, "shrinkB": 0}
    )
    for x, y, text in ((1.95, 1.8, "h"), (1.6, 2.75, "R"), (1.4, 0.8, "T"), (-1.1, 1.8, "n, k"), (-0.85, 2.4, "$R_F$")):
        axes.text(x, y, text, va="center", ha="center" if text == "$R_F$" else "left")
    axes.set(xlim=(-1.4, 2.9), ylim=(0.5, 3.2))
    axes.set_axis_off()
    axes.set_title("a slab of thickness h")


def _side_view(axes: Axes, parts: Sequence[tuple[str, str, float]], *, on_plate: bool) -> None:
    """Draw the print hanging from the build plate, or the separated parts in the light beam."""
    top = 2.6
    if on_plate:
        axes.add_patch(Rectangle((-1.3, top), 2.6, 0.5, facecolor=INK))
        axes.text(0.0, top + 0.25, "build plate", ha="center", va="center", color="white")
    else:
        axes.annotate("", (0.0, 0.9), (0.0, 3.1), arrowprops={"arrowstyle": "->", "color": LEFT})
        axes.text(0.06, 2.9, "light", color=LEFT, va="center")
    for label, colour, height in parts:
        top -= height
        axes.add_patch(Rectangle((-1.0, top), 2.0, height, facecolor=colour, edgecolor="white"))
        axes.text(1.06, top + 0.5 * height, label, va="center")
    axes.set(xlim=(-1.4, 2.9), ylim=(0.5, 3.2))
    axes.set_axis_off()


def _height_in(coupon: Coupon) -> float:
    width, depth, _ = coupon.size_mm
    return min(max(WIDTH_IN * depth / width, MIN_IN), MAX_IN)


def _draw(axes: Axes, coupon: Coupon) -> None:
    width, depth, height = coupon.size_mm
    if coupon.slab is not None:
        slab = coupon.slab
        axes.add_patch(_rectangle(0.0, 0.0, slab.width_mm, slab.depth_mm, slab.bevel_mm, SOFT))
    for feature in coupon.features:
        if feature.stage in {"", coupon.stages[-1].name}:
            axes.add_patch(_patch(feature))
    above = False
    for feature, text in _labels(coupon):
        inside = feature.depth_mm > MIN_DEPTH_RATIO * depth and feature.kind != "hole"
        inside = inside and feature.width_mm > LETTER * len(text) * width
        _label(axes, feature, text, inside=inside)
        above = above or (not inside and coupon.slab is None)
    axes.set_xlim(-0.52 * width, 0.52 * width)
    axes.set_ylim(-0.5 * depth - 0.02 * width, 0.5 * depth + (ABOVE if above else 0.02) * width)
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
    """Return the features to label, with the values that vary between them."""
    if coupon.gaps:
        return [(coupon.feature(gap.between[0]), f"{gap.gap_mm:g}") for gap in coupon.gaps]
    shown = [
        feature
        for feature in coupon.features
        if feature.kind != "mark" and not feature.is_stacked and feature.stage in {"", coupon.stages[-1].name}
    ]
    if coupon.name == "ledges":
        return [(feature, feature.name.split("-")[1].replace("um", " µm")) for feature in shown]
    if coupon.steps or coupon.name == "z-reference":
        return [(feature, f"{feature.height_mm:g}") for feature in shown]
    return [(feature, _varied(feature)) for feature in shown]


def _varied(feature: Feature) -> str:
    """Return the value that varies between features: the grey level, the exposure or the size."""
    if feature.grey is not None:
        return f"{feature.grey:g}"
    return f"{feature.exposure_s:g} s" if feature.exposure_s else f"{feature.width_mm:g}"


def _patch(feature: Feature) -> Circle | Polygon:
    colour = COLOURS.get(feature.kind, RIGHT)
    if feature.round:
        return Circle((feature.x_mm, feature.y_mm), 0.5 * feature.diameter_mm, facecolor=colour, edgecolor=INK, lw=0.4)
    return _rectangle(feature.x_mm, feature.y_mm, feature.width_mm, feature.depth_mm, feature.bevel_mm, colour)


def _rectangle(x: float, y: float, width: float, depth: float, bevel: float, colour: str) -> Polygon:
    right, back, left, front = x + 0.5 * width, y + 0.5 * depth, x - 0.5 * width, y - 0.5 * depth
    corners = [(left, front), (right, front), (right, back - bevel), (right - bevel, back), (left, back)]
    return Polygon(corners, facecolor=colour, edgecolor=LOST, lw=0.6)
