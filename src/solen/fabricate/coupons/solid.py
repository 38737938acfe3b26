"""Solids of coupons: a slab with its holes is one prism, and each column on it is another.

X and Y are those of the layout, and Z is the height above the plate. Each run has a part of its own.
"""

from solen.curve import Arc, Segment
from solen.fabricate.lens_parts import StackedPart
from solen.fabricate.part import Part, Prism
from solen.geometry import Face
from solen.geometry.coupons import Coupon, Feature
from solen.plane import Point

Outline = tuple[Face, ...]


def coupon_parts(coupon: Coupon) -> dict[str, Part]:
    """Return the parts of a coupon, keyed by stage; heights are measured from the first layer of the stage.

    Raises
    ------
    DesignError
        If outlines overlap.
    """
    return {stage.name: _part(coupon, stage.name) for stage in coupon.stages}


def _part(coupon: Coupon, stage: str) -> Part:
    name = f"{coupon.name}-{stage}" if stage else coupon.name
    features = [feature for feature in coupon.features if feature.stage == stage]
    holes = [feature for feature in features if feature.kind == "hole"]
    prisms = []
    if coupon.slab is not None and stage == coupon.stages[0].name:
        slab = coupon.slab
        outer = _rectangle("slab", (0.0, 0.0), slab.width_mm, slab.depth_mm, slab.bevel_mm)
        outlines = (outer, *(_circle(hole, clockwise=True) for hole in holes))
        prisms.append(Prism("slab", outlines, 0.0, slab.thickness_mm))
    columns = [feature for feature in features if feature.kind != "hole"]
    prisms += [Prism(column.name, (_outline(column),), column.from_mm, column.to_mm) for column in columns]
    return (StackedPart if all(feature.kind == "ledge" for feature in features) else Part)(name, tuple(prisms))


def _outline(feature: Feature) -> Outline:
    if feature.round:
        return _circle(feature)
    centre = (feature.x_mm, feature.y_mm)
    return _rectangle(feature.name, centre, feature.width_mm, feature.depth_mm, feature.bevel_mm)


def _circle(feature: Feature, *, clockwise: bool = False) -> Outline:
    circle = Arc.circle((feature.x_mm, feature.y_mm), 0.5 * feature.diameter_mm)
    return (Face(feature.name, circle.reversed() if clockwise else circle),)


def _rectangle(name: str, centre: Point, width: float, depth: float, bevel: float) -> Outline:
    """Return a counter-clockwise rectangle with a chamfered right back corner."""
    x, y = centre
    left, right, front, back = x - 0.5 * width, x + 0.5 * width, y - 0.5 * depth, y + 0.5 * depth
    corner = [(right, back)] if bevel == 0.0 else [(right, back - bevel), (right - bevel, back)]
    corners = [(left, front), (right, front), *corner, (left, back)]
    sides = ["front", "right", *(["bevel"] if bevel else []), "back", "left"]
    following = [*corners[1:], corners[0]]
    return tuple(Face(f"{name}-{side}", Segment(a, b)) for side, a, b in zip(sides, corners, following, strict=True))
