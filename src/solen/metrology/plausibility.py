"""Plausibility: whether the outline in an image can be a print of the design at the image's scale.

A lens of another size or shape, or at a wrong scale, also has edges. Such a lens is recognised by the ends of the
front, the width of the part behind the front, and the registration residual: each has one limit for rejection and a
lower one for a warning. The functions named ``…_warnings`` return a list that is empty if nothing is wrong.
"""

from collections.abc import Sequence

import numpy as np

from solen.errors import DataError
from solen.metrology.edge import Edge
from solen.metrology.edge_tracing import Band, trace_edges
from solen.metrology.front_edges import edges_along
from solen.metrology.image import Image
from solen.metrology.nominal import NominalFront
from solen.metrology.pose import Pose
from solen.metrology.registration import Registration
from solen.ranks import Caution, warning

SIDES = ("left", "right")
WALL_REACH = 0.3
"""Distance to each side within which a wall is searched for, as a fraction of the lens width."""
MAX_WIDTH_RATIO, WIDTH_TOLERANCE = 1.3, 0.03
"""Width factor above which a part is not a print of the design, and relative difference that causes a warning."""
MAX_RMS = 0.015
"""Ratio of the RMS deviation to the lens width above which a part is not a print of the design."""
MAX_MISSING = 0.1
"""Fraction of the front without an edge at one end that causes a warning; at both ends, the image is rejected."""
MAX_IMAGE_FRACTION, MIN_IMAGE_FRACTION = 1.2, 0.1
"""Limits of the ratio of lens width to image width; outside them the scale is probably in another unit."""
MIN_LENS_PX = 60
"""Minimum number of pixels across the lens."""
UNRESOLVED_PX = 4
"""Separation in pixels below which two edges cannot be resolved."""
RESOLVED_PX = 200
"""Number of pixels across the lens above which both faces, if visible, usually appear as two edges."""
MERGED_BLUR_RATIO, MIN_WALL_POINTS = 1.3, 20
"""Ratio of blurs above which an edge that is more blurred than a wall may be two edges, and the minimum number of
points along the wall for this test.
"""
MIN_VISIBLE = 0.5
"""Minimum fraction of the front, or of a wall, that an image must show."""


def no_lens(image: Image, nominal: NominalFront, why: str) -> DataError:
    """Return the error for an image that does not show the lens; if the lens spans few pixels, advise to magnify it."""
    limit = f"shows no lens like that of {nominal.name}: {why}"
    across = nominal.width_mm * 1e3 / image.um_per_px
    if across < RESOLVED_PX:
        limit += (
            f", and at {image.um_per_px:.4g} µm per pixel the lens is {across:.0f} pixels wide, "
            "too few to resolve two closely spaced edges"
        )
        finest = image.um_per_px * across / RESOLVED_PX
        return DataError(
            image.provenance.file,
            limit=limit,
            remedy=f"increase the magnification until a pixel covers at most {finest:.2g} µm",
        )
    remedy = "check --um-per-px, the design, and that the entire front is in the image and in focus"
    return DataError(image.provenance.file, limit=limit, remedy=remedy)


def check_scale(image: Image, nominal: NominalFront) -> None:
    """Raise `DataError` if the lens would be too small in the image or far larger than it."""
    across = nominal.width_mm * 1e3 / image.um_per_px
    size = f"at {image.um_per_px:.4g} µm per pixel the lens of {nominal.width_mm:g} mm is {across:.0f} pixels wide"
    limit, change = "", ""
    if across < MIN_LENS_PX:
        limit, change = f"{size}; at least {MIN_LENS_PX} are needed", "use a higher magnification"
    elif across * MIN_VISIBLE > np.hypot(*image.shape):
        limit, change = f"{size}, and the image is {image.shape[1]} x {image.shape[0]}", "use a lower magnification"
    if limit:
        raise DataError(image.provenance.file, limit=limit, remedy=f"{_other_unit(image, nominal)}, or {change}")


def _other_unit(image: Image, nominal: NominalFront) -> str:
    """Return the remedy: the unit that was probably meant, with which the entire lens would be in the image."""
    um_per_px, width_um = image.um_per_px, nominal.width_mm * 1e3
    units = {"mm per pixel": 1e3 * um_per_px, "pixels per mm": 1e3 / um_per_px, "nm per pixel": 1e-3 * um_per_px}
    units |= {"pixels per µm": 1.0 / um_per_px, "dpi": 25.4e3 / um_per_px}
    likely = [
        f"{um_per_px:g} looks like {unit}: set --um-per-px {um:.4g}"
        for unit, um in units.items()
        if max(MIN_LENS_PX, MIN_IMAGE_FRACTION * max(image.shape))
        <= width_um / um
        <= MAX_IMAGE_FRACTION * max(image.shape)
    ]
    return likely[0] if likely else "check the scale"


def resolution_warnings(image: Image, nominal: NominalFront) -> list[Caution]:
    """Return a warning for a lens that spans few pixels: edges separated by less than a blur are measured as one."""
    across = nominal.width_mm * 1e3 / image.um_per_px
    if across >= RESOLVED_PX:
        return []
    near_um = UNRESOLVED_PX * image.um_per_px
    return [
        warning(
            f"the lens is {across:.0f} pixels wide: edges of the two lens faces that are less than "
            f"{near_um:.2g} µm apart are measured as a single edge between them; use a magnification at which it is "
            f"{RESOLVED_PX} pixels wide or more, or illuminate it from above"
        )
    ]


def check_seen(image: Image, seen: float) -> None:
    """Raise `DataError` if too little of the front is in the image."""
    if seen < MIN_VISIBLE:
        limit = f"shows {seen:.0%} of the front; at least {MIN_VISIBLE:.0%} is needed for the registration"
        raise DataError(image.provenance.file, limit=limit, remedy="take an image of the entire lens")


def check_shape(image: Image, nominal: NominalFront, edge: Edge, fit: Registration, width: float | None) -> None:
    """Raise `DataError` if the outline is too unlike the design to be a print of it at this scale."""
    missing = _missing(edge)
    if width is not None and abs(np.log(width / nominal.width_mm)) > np.log(MAX_WIDTH_RATIO):
        why = f"the part is {width:.3g} mm wide behind the front, whereas the design is {nominal.width_mm:.3g} mm wide"
    elif fit.rms_um > MAX_RMS * 1e3 * nominal.width_mm:
        why = f"the best registration has a residual of {fit.rms_um:.3g} µm RMS"
    elif min(missing) > MAX_MISSING:
        why = f"no edge is visible along the first {missing[0]:.0%} and the last {missing[1]:.0%} of the front"
    else:
        return
    raise no_lens(image, nominal, why)


def wall_edges(image: Image, pose: Pose, nominal: NominalFront, max_edges: int) -> tuple[list[Edge], ...]:
    """Return the edges of the left and the right wall, the outermost first; none for a wall that is not visible."""
    edges: list[list[Edge]] = []
    for wall in nominal.walls:
        band = Band.of(image.grey, pose, wall, WALL_REACH * nominal.width_mm)
        traced = trace_edges(band, max_edges) if band.fraction_seen >= MIN_VISIBLE else []
        fitted = edges_along(image, pose, wall, band, traced) if traced else []
        edges.append([edge for edge in fitted if edge.kept.sum() > MIN_WALL_POINTS])
    return tuple(edges)


def part_width_mm(walls: Sequence[Edge | None], pose: Pose, nominal: NominalFront) -> float | None:
    """Return the width of the part from wall to wall, an independent check of the scale; None without both walls."""
    offsets = [
        float(np.median(wall.nearest(pose.to_mm(edge.measured[0])).deviation_mm))
        for edge, wall in zip(walls, nominal.walls, strict=False)
        if edge is not None
    ]
    return nominal.width_mm + sum(offsets) if len(offsets) == len(SIDES) else None


def merged_edge_warnings(walls: Sequence[Edge | None], edge: Edge) -> list[Caution]:
    """Return a warning for a single edge that is clearly more blurred than the adjacent walls: it may be two edges."""
    blurs = [wall.blur for wall in walls if wall is not None]
    if not blurs or edge.blur < MERGED_BLUR_RATIO * min(blurs):
        return []
    return [
        warning(
            f"the blur of the front's edge is {edge.blur:.2g} px, {edge.blur / min(blurs):.2g} times that of a wall "
            f"({min(blurs):.2g} px): it is out of focus, or two edges closer than about two blurs were measured as one "
            "edge between them"
        )
    ]


def end_warnings(edge: Edge) -> list[Caution]:
    """Return warnings for ends of the front that are in the image but have no edge."""
    return [
        warning(f"the outermost {fraction:.0%} of the front on the {side} is in the image but has no measurable edge")
        for fraction, side in zip(_missing(edge), SIDES, strict=True)
        if fraction > MAX_MISSING
    ]


def width_warnings(width: float | None, nominal: NominalFront) -> list[Caution]:
    """Return a warning for a part that is wider or narrower than the design."""
    if width is None or abs(width / nominal.width_mm - 1.0) < WIDTH_TOLERANCE:
        return []
    return [
        warning(
            f"just behind the front, the part is {width:.3f} mm wide and the design {nominal.width_mm:.3f} mm "
            f"({100.0 * (width / nominal.width_mm - 1.0):+.1f} %): the scale or the size of the print is wrong"
        )
    ]


def crop_warnings(seen: float, ends: tuple[float, float]) -> list[Caution]:
    """Return a warning for a front that is only partly in the image."""
    if seen > 0.99:
        return []
    return [
        warning(
            f"the image shows {seen:.0%} of the front, which is measured only from x = {ends[0]:.2f} "
            f"to {ends[1]:.2f} mm"
        )
    ]


def _missing(edge: Edge) -> tuple[float, float]:
    """Return the fractions of the front at its left and right end that are in the image but have no edge."""
    kept = np.flatnonzero(edge.kept)
    inside = np.flatnonzero(edge.inside)
    return (
        max(float(kept[0] - inside[0]), 0.0) / len(edge.kept),
        max(float(inside[-1] - kept[-1]), 0.0) / len(edge.kept),
    )
