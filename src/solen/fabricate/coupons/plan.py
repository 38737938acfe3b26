"""SVG plan of a coupon at true scale: a user unit is 1 mm, and each feature is a named shape."""

from xml.sax.saxutils import escape, quoteattr

from solen.fabricate.label import Label
from solen.geometry.coupons import Coupon, Feature

MARGIN_MM, LINE_MM, TEXT_MM = 2.0, 0.05, 0.35
STAGE_GAP_MM = 4.0


def as_plan(coupon: Coupon, label: Label) -> bytes:
    """Return the plan of a coupon as an SVG file, seen from above, with the names of the features."""
    width, depth, _ = coupon.size_mm
    count = len(coupon.stages)
    total_height = count * depth + (count - 1) * STAGE_GAP_MM + 2.0 * MARGIN_MM + 1.5
    total_width = width + 2.0 * MARGIN_MM
    box = f"{-0.5 * total_width:g} {-0.5 * depth - MARGIN_MM - 1.5:g} {total_width:g} {total_height:g}"
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{total_width:g}mm" height="{total_height:g}mm" '
        f'viewBox="{box}">',
        f"<title>{escape(label.name)}</title>",
        f"<desc>{escape('; '.join(label.lines[1:]))}</desc>",
        f'<g fill="none" stroke="black" stroke-width="{LINE_MM:g}">',
    ]
    for number, stage in enumerate(coupon.stages):
        down = number * (depth + STAGE_GAP_MM)
        if coupon.slab is not None and number == 0:
            slab = coupon.slab
            lines.append(_rectangle("slab", 0.0, down, slab.width_mm, slab.depth_mm, slab.bevel_mm))
        lines += [_shape(feature, down) for feature in coupon.features if feature.stage == stage.name]
    lines += ["</g>", f'<g font-family="sans-serif" font-size="{TEXT_MM:g}" text-anchor="middle">']
    for number, stage in enumerate(coupon.stages):
        down = number * (depth + STAGE_GAP_MM)
        features = [feature for feature in coupon.features if feature.stage == stage.name and not feature.is_stacked]
        lines += [_label(feature, down, index) for index, feature in enumerate(features)]
    return "\n".join([*lines, "</g>", "</svg>\n"]).encode()


def _shape(feature: Feature, down: float) -> str:
    if feature.round:
        x, y, radius = feature.x_mm, down - feature.y_mm, 0.5 * feature.diameter_mm
        return f'<circle id={quoteattr(feature.name)} cx="{x:.9g}" cy="{y:.9g}" r="{radius:.9g}"/>'
    return _rectangle(
        feature.name, feature.x_mm, down - feature.y_mm, feature.width_mm, feature.depth_mm, feature.bevel_mm
    )


def _rectangle(name: str, x: float, y: float, width: float, depth: float, bevel: float) -> str:
    """Return a rectangle centred at a point, with a chamfered right back corner; the y axis of SVG points down."""
    right, back = x + 0.5 * width, y - 0.5 * depth
    start = f"M{right - width:.9g} {back + depth:.9g}H{right:.9g}V{back + bevel:.9g}"
    return f'<path id={quoteattr(name)} d="{start}L{right - bevel:.9g} {back:.9g}H{right - width:.9g}Z"/>'


def _label(feature: Feature, down: float, index: int) -> str:
    """Return the label above a feature; alternate labels are raised, so that neighbours do not overlap."""
    above = 0.5 * feature.depth_mm + 0.12 + 0.4 * (index % 2)
    return f'<text x="{feature.x_mm:.6g}" y="{down - feature.y_mm - above:.6g}">{escape(feature.name)}</text>'
