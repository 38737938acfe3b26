"""Optical elements in the file (glasses, mirrors, walls and ideal elements) as outlines and curves."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from solen.curve import Curve
from solen.plane import Point, along, left_of, minus, unit
from solen.scene.model import Behaviour
from solen.scene.rayoptics.arrangement import Element, Glass
from solen.scene.rayoptics.fields import GREEN_NM, Fields, UnreadableError, finite
from solen.scene.rayoptics.outlines import (
    Outline,
    SceneSettings,
    aperture,
    arc,
    between_formulas,
    circle,
    half_plane,
    over_line_curves,
    parabola,
    parametric_curves,
    parametric_outline,
    path,
    path_outline,
    segment,
    smooth_curve,
    smooth_outline,
)
from solen.scene.surface import Grating, Surface

MAX_ORDERS, MIN_EFFICIENCY = 1000, 1e-7
"""Maximum number of diffraction orders on either side, and the efficiency below which an order is omitted."""

Reader = Callable[[Fields, str, "SceneSettings"], Sequence[Glass | Element]]
"""Function that reads an object of one type; its second argument is the name of the result."""


def glass(fields: Fields, name: str, outline: Sequence[Curve], settings: SceneSettings, **options: bool) -> list[Glass]:
    """Return a glass from an outline and the keys common to all glasses."""
    index, b = fields.number_of("refIndex", 1.5, above=0.0), fields.number_of("cauchyB", 0.004)
    partial = fields.flag("partialReflect", True)
    return [Glass(name, tuple(outline), index, b if settings.colours else 0.0, partial, **options)]


def filter_band(fields: Fields, settings: SceneSettings) -> tuple[float, float] | None:
    """Return the wavelength limits of a filter, the longer one first if it acts outside its band."""
    enabled, invert = fields.flag("filter"), fields.flag("invert")
    center, half = fields.number_of("wavelength", GREEN_NM), fields.number_of("bandwidth", 10.0)
    if not (enabled and settings.colours):
        return None
    if half < 0.0:
        raise UnreadableError("bandwidth", f"must be at least 0, not {half:g}")
    low, high = center - half, center + half
    return (max(high, math.nextafter(low, math.inf)), low) if invert else (low, high)


def _element(
    behaviour: Behaviour, curves: Outline, *, filters: bool = True, **numbers: Callable[[Fields], float]
) -> Reader:
    """Return the reader for an element: its curves, its filter if it can have one, and its surface parameters."""

    def read(fields: Fields, name: str, settings: SceneSettings) -> Sequence[Glass | Element]:
        outline = tuple(curves(fields, settings))
        values = {key: number(fields) for key, number in numbers.items()}
        band = filter_band(fields, settings) if filters else None
        surface = Surface(band_nm=band, **values) if band is not None or values else None  # type: ignore[arg-type]
        return [Element(name, outline, behaviour, surface)]

    return read


def _glass(outline: Outline, **options: bool) -> Reader:
    """Return the reader for a glass within an outline."""
    return lambda fields, name, settings: glass(fields, name, outline(fields, settings), settings, **options)


def _spherical_lens(fields: Fields, name: str, settings: SceneSettings) -> Sequence[Glass | Element]:
    """Read a lens from its outline, or from its two edges, thickness and radii or focal distances."""
    defined = fields.string("defBy", "DR1R2")
    if fields.data.get("path") is not None:
        fields.skip("p1", "p2", "params")
        return glass(fields, name, path_outline(fields, settings), settings)
    edges, numbers = (fields.point("p1"), fields.point("p2")), fields.data.get("params")
    fields.skip("path", "params")
    if not isinstance(numbers, dict):
        raise UnreadableError("params", "is missing, and so is path")
    if defined == "DR1R2":
        d, r1, r2 = (_radius(f"params.{key}", numbers.get(key)) for key in ("d", "r1", "r2"))
        return glass(fields, name, _lens(*edges, d, r1, r2), settings)
    if defined != "DFfdBfd":
        raise UnreadableError("defBy", f"must be DR1R2 or DFfdBfd, not {defined}")
    d, ffd, bfd = (finite(f"params.{key}", numbers.get(key)) for key in ("d", "ffd", "bfd"))
    (template,) = glass(fields, name, (), settings)
    for radii in _radii(d, ffd, bfd, template.a + template.b_um2 / 0.546**2):
        try:
            return [replace(template, outline=tuple(_lens(*edges, d, *radii)))]
        except UnreadableError:
            continue
    raise UnreadableError("params", "do not give radii of curvature with which the lens can be built")


def _radius(key: str, value: Any) -> float:
    """Read a radius; a string or null stands for infinity, which JSON cannot express."""
    return math.inf if value in (None, "Infinity", "-Infinity", "inf", "-inf") else finite(key, value)


def _radii(d: float, ffd: float, bfd: float, n: float) -> list[tuple[float, float]]:
    """Return the radii of lenses with this thickness and these front and back focal distances, smaller radii first."""
    square = d * d + 4.0 * bfd * ffd * n * n
    if square < 0.0:
        raise UnreadableError("params", "do not give a lens with real radii of curvature")
    radii_pairs = []
    for root in (-math.sqrt(square), math.sqrt(square)):
        try:
            r1 = d * (n - 1.0) * (d + 2.0 * ffd * n + root) / (2.0 * n * (d + (ffd - bfd) * n))
            r2 = -d * (n - 1.0) * (d + 2.0 * bfd * n + root) / (2.0 * n * (d + (bfd - ffd) * n))
        except ZeroDivisionError:
            continue
        radii_pairs.append((r1, r2))
    return sorted(radii_pairs, key=lambda radii: abs(radii[0]) + abs(radii[1]))


def _lens(p1: Point, p2: Point, d: float, r1: float, r2: float) -> list[Curve]:
    """Return the outline of a lens between two edges, with its axial thickness and two radii of curvature."""
    length = math.dist(p1, p2)
    if length == 0.0:
        raise UnreadableError("p2", "is the same point as p1")
    axis = left_of(unit(minus(p2, p1)))
    center = (0.5 * (p1[0] + p2[0]), 0.5 * (p1[1] + p2[1]))
    front, back = 0.5 * d - _sag(r1, length), 0.5 * d + _sag(r2, length)
    corners = [(p1, -front), (p1, back), (center, 0.5 * d), (p2, back), (p2, -front), (center, -0.5 * d)]
    points = [along(start, axis, shift) for start, shift in corners]
    items = [{"x": x, "y": -z, "arc": i in (2, 5)} for i, (x, z) in enumerate(points)]
    return path(items)


def _sag(radius: float, length: float) -> float:
    if math.isinf(radius):
        return 0.0
    square = radius * radius - 0.25 * length * length
    if square < 0.0:
        raise UnreadableError("params", "do not describe a lens: a radius is less than half its height")
    return radius - math.copysign(math.sqrt(square), radius)


def _focal(fields: Fields) -> float:
    focal_length = fields.number_of("focalLength", 100.0)
    if focal_length == 0.0:
        raise UnreadableError("focalLength", "must not be 0")
    return focal_length


def _transmitted(fields: Fields) -> float:
    fraction = fields.number_of("transRatio", 0.5)
    if not 0.0 <= fraction <= 1.0:
        raise UnreadableError("transRatio", f"must be from 0 to 1, not {fraction:g}")
    return fraction


def _grating(curves: Outline, sign: int, mirrored: bool | None = None) -> Reader:
    """Return the reader for a grating; positive orders turn to the right, or to the left if ``sign`` is −1."""

    def read(fields: Fields, name: str, settings: SceneSettings) -> Sequence[Glass | Element]:
        lines, custom = fields.number_of("lineDensity", 1000.0, above=0.0), fields.flag("customBrightness")
        brightnesses, ratio = fields.numbers("brightnesses", (1.0, 0.5, 0.5)), fields.number_of("slitRatio", 0.5)
        if not 0.0 <= ratio <= 1.0:
            raise UnreadableError("slitRatio", f"must be from 0 to 1, not {ratio:g}")
        orders = _listed_orders(brightnesses) if custom else _slit_orders(ratio)
        if not orders:
            raise UnreadableError("brightnesses" if custom else "slitRatio", "gives every order a brightness of 0")
        reflected = fields.flag("mirrored") if mirrored is None else mirrored
        grating = Grating(lines, tuple((sign * order, efficiency) for order, efficiency in orders), reflected)
        return [Element(name, tuple(curves(fields, settings)), "grating", Surface(grating=grating))]

    return read


def _listed_orders(brightnesses: Sequence[float]) -> list[tuple[int, float]]:
    """Return the orders 0, 1, −1, 2, −2 and so on, with their diffraction efficiencies."""
    if min(brightnesses, default=0.0) < 0.0:
        raise UnreadableError("brightnesses", f"must be at least 0, not {min(brightnesses):g}")
    return [((i + 1) // 2 * (1 if i % 2 else -1), value) for i, value in enumerate(brightnesses) if value > 0.0]


def _slit_orders(ratio: float) -> list[tuple[int, float]]:
    """Return the orders of a wall whose slits cover the fraction ``ratio``.

    The diffraction efficiency of order m is sin²(π m ratio) / (π m)² at any angle.
    """
    orders = [(0, ratio * ratio)]
    for m in range(1, MAX_ORDERS + 1):
        efficiency = (math.sin(math.pi * m * ratio) / (math.pi * m)) ** 2
        orders += [(sign * m, efficiency) for sign in (1, -1)]
    return [(m, efficiency) for m, efficiency in orders if efficiency > MIN_EFFICIENCY]


READERS: dict[str, Reader] = {
    "Glass": _glass(path_outline),
    "CircleGlass": _glass(circle),
    "PlaneGlass": _glass(half_plane, endless=True),
    "SphericalLens": _spherical_lens,
    "CurveGlass": _glass(smooth_outline),
    "CustomGlass": _glass(between_formulas, oriented=True),
    "ParamGlass": _glass(parametric_outline, oriented=True),
    "IdealLens": _element("lens", segment, filters=False, focal_mm=_focal),
    "IdealMirror": _element("mirror", segment, focal_mm=_focal),
    "Blocker": _element("absorbing", segment),
    "CircleBlocker": _element("absorbing", circle),
    "Aperture": _element("absorbing", aperture),
    "Mirror": _element("mirror", segment),
    "ArcMirror": _element("mirror", arc),
    "ParabolicMirror": _element("mirror", parabola),
    "CustomMirror": _element("mirror", over_line_curves),
    "ParamMirror": _element("mirror", parametric_curves),
    "CurveMirror": _element("mirror", smooth_curve),
    "DiffractionGrating": _grating(segment, 1),
    "ConcaveDiffractionGrating": _grating(arc, -1, mirrored=True),
    "BeamSplitter": _element("splitter", segment, transmitted=_transmitted),
}
"""Readers, keyed by object type; to add a type, add an entry."""
