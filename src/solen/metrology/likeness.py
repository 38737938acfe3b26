"""Whether what a picture shows can be a print of the design at the picture's scale, and what must be said of it.

A lens of another size or shape, or at a wrong scale, has edges as well. What tells it are the ends of the front, the
width of the part behind it, and what the best place leaves; each is refused beyond a limit, and told before.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.metrology.edge import Edge, fit_edge
from solen.metrology.find import Pose
from solen.metrology.ideal import Ideal, outward
from solen.metrology.image import Image
from solen.metrology.register import Registration
from solen.metrology.strip import Strip, lines

WALL_FROM, WALL_REACH = 0.25, 0.3
"""Where behind the corner a wall is looked at, as a fraction of its length, and how far aside, of the lens's width."""
MOST_WIDTH, ODD_WIDTH = 1.3, 0.03
"""Factor of width from which on it is no print of the design, and the relative difference that is told."""
MOST_RMS = 0.015
"""Rms distance over the lens's width from which on it is no print of the design."""
MOST_MISSING = 0.1
"""Share of the front without an edge at an end of it that is told, and at both ends refused."""
COARSEST_PX = 60
"""Pixels across the lens, at least."""
WIDER, LEAST_PLACES = 1.3, 20
"""How many times as wide as a wall's an edge is told to be, and places along that wall that are needed for it."""
LEAST_SEEN = 0.5
"""Share of the front that a picture must show."""


def check_scale(image: Image, ideal: Ideal) -> None:
    """`DataError` where the lens would be too small in the picture or far larger than it."""
    across = ideal.width_mm * 1e3 / image.um_per_px
    file, said = image.provenance.file, f"at {image.um_per_px:.4g} µm per pixel the lens of {ideal.width_mm:g} mm"
    if across < COARSEST_PX:
        limit = f"{said} is {across:.0f} pixels wide; at least {COARSEST_PX} are needed"
        raise DataError(file, limit=limit, remedy="check the scale, or magnify more")
    if across * LEAST_SEEN > np.hypot(*image.shape):
        limit = f"{said} is {across:.0f} pixels wide, and the picture {image.shape[1]} x {image.shape[0]}"
        raise DataError(file, limit=limit, remedy="check the scale, or magnify less")


def check_seen(image: Image, seen: float) -> None:
    """`DataError` where too little of the front is in the picture."""
    if seen < LEAST_SEEN:
        limit = f"shows {seen:.0%} of the front; at least {LEAST_SEEN:.0%} is needed to lay it on the design"
        raise DataError(image.provenance.file, limit=limit, remedy="take a picture of the whole lens")


def part_width_mm(image: Image, pose: Pose, ideal: Ideal) -> float | None:
    """Width of the part from wall to wall; the front says nothing about it where its scale is in doubt."""
    walls = _walls(image, pose, ideal)
    if len(walls) < 2:
        return None
    return ideal.width_mm + sum(float(np.median(wall.off_mm[wall.shown])) for wall in walls)


@dataclass(frozen=True)
class _Wall:
    """A wall behind the front: places (N, 2) of the design, its normals outwards, how far out the edge was seen."""

    points_mm: FloatArray
    normals: FloatArray
    off_mm: FloatArray
    shown: NDArray[np.bool_]


def _walls(image: Image, pose: Pose, ideal: Ideal) -> list[_Wall]:
    """Those of the two walls that the design has and the picture shows."""
    found = []
    for wall, side in ((ideal.left_mm, -1.0), (ideal.right_mm, 1.0)):
        if len(wall) < 2:
            continue
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(wall, axis=0).T))])
        far = arc > WALL_FROM * arc[-1]  # past the corner
        points, normals = wall[far], side * outward(wall)[far]
        strip = Strip.along(image.grey, pose, arc[far], points, normals, WALL_REACH * ideal.width_mm)
        if np.mean(strip.seen[:, len(strip.off_mm) // 2]) >= LEAST_SEEN and (seen := lines(strip, most=1)):
            found.append(_Wall(points, normals, seen[0].off_mm, seen[0].shown))
    return found


def merged(image: Image, pose: Pose, ideal: Ideal, edge: Edge) -> list[str]:
    """What to say of a single edge that is clearly wider than the walls' beside it: it may be two in one."""
    blurs = []
    for wall in _walls(image, pose, ideal):
        contour = pose.to_px(wall.points_mm + wall.normals * wall.off_mm[:, None])[wall.shown]
        ways = pose.direction_px(wall.normals)[wall.shown]
        beside = fit_edge(image.grey, contour, ways, ceiling=image.ceiling)
        if beside.kept.sum() > LEAST_PLACES:
            blurs.append(beside.blur)
    if not blurs or edge.blur < WIDER * min(blurs):
        return []
    return [
        f"the edge of the front is blurred over {edge.blur:.2g} px, {edge.blur / min(blurs):.2g} times as far as a "
        f"wall's ({min(blurs):.2g} px): it is out of focus, or two edges nearer each other than about two blurs were "
        "measured as one, which lies between them"
    ]


def check_shape(image: Image, ideal: Ideal, edge: Edge, laid: Registration, width: float | None) -> None:
    """`DataError` where what was found is too unlike the design to be a print of it at this scale."""
    missing = _missing(edge)
    why = ""
    if width is not None and abs(np.log(width / ideal.width_mm)) > np.log(MOST_WIDTH):
        why = f"the part is {width:.3g} mm wide behind the front, and the design {ideal.width_mm:.3g} mm"
    elif laid.rms_um > MOST_RMS * 1e3 * ideal.width_mm:
        why = f"the best place leaves {laid.rms_um:.3g} µm (rms)"
    elif min(missing) > MOST_MISSING:
        why = f"its edge ends {missing[0]:.0%} and {missing[1]:.0%} before the ends of the front"
    if why:
        raise no_lens(image, ideal, why)


def _missing(edge: Edge) -> tuple[float, float]:
    """Shares of the front at its left and right end that the picture shows and that have no edge."""
    at = np.flatnonzero(edge.kept)
    shown = np.flatnonzero(edge.inside)
    return (max(float(at[0] - shown[0]), 0.0) / len(edge.kept), max(float(shown[-1] - at[-1]), 0.0) / len(edge.kept))


def missing_ends(edge: Edge) -> list[str]:
    """What to say of ends of the front that are in the picture and have no edge."""
    return [
        f"the last {share:.0%} of the front on the {side} is in the picture and has no edge that can be measured"
        for share, side in zip(_missing(edge), ("left", "right"), strict=True)
        if share > MOST_MISSING
    ]


def odd_width(width: float | None, ideal: Ideal) -> list[str]:
    """What to say of a part that is wider or narrower than the design."""
    if width is None or abs(width / ideal.width_mm - 1.0) < ODD_WIDTH:
        return []
    return [
        f"the part is {width:.3f} mm wide right behind the front where the design has {ideal.width_mm:.3f} mm "
        f"({100.0 * (width / ideal.width_mm - 1.0):+.1f} %): the scale is off, or the print is"
    ]


def cropped(seen: float, ends: tuple[float, float]) -> list[str]:
    """What to say of a front that is only partly in the picture."""
    if seen > 0.99:
        return []
    return [
        f"the picture shows {seen:.0%} of the front: it is measured from x = {ends[0]:.2f} to {ends[1]:.2f} mm alone"
    ]


def no_lens(image: Image, ideal: Ideal, why: str) -> DataError:
    """The error for a picture that shows no such lens, with the reason and the remedy."""
    limit = f"shows no lens like that of {ideal.name}: {why}"
    remedy = "check --um-per-px, the design, and that the whole front is in the picture and in focus"
    return DataError(image.provenance.file, limit=limit, remedy=remedy)
