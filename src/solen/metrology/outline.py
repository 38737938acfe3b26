"""The printed front in a picture: found, its edges named, each measured to a small part of a pixel.

The idea: the design says what to look for and where its normals are, and nothing more; where an edge is, the grey
values alone say. A thick transparent part shows the rim of its upper face and that of its lower one. Where both run
along the front, both are measured: `outer` and `inner` by their place, and where one is clearly sharper than the other,
that is the face on which the microscope was focused, usually the upper one, and it is taken for the outline.

The interface: `measure` gives an `Outline`: the edges, their points in the order of the front, the chosen one first.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from solen.errors import DataError, SpecError
from solen.metrology.edge import LINES, Edge, fit_edge, fit_two_edges
from solen.metrology.find import Found, Pose, find
from solen.metrology.ideal import Ideal, outward
from solen.metrology.image import Image
from solen.metrology.register import Registration, register
from solen.metrology.strip import Line, Strip, lines

Floats = NDArray[np.float64]

NAMES = ("outer", "inner")
CHOICES = ("auto", "outer", "inner", "sharper")
REACH = 0.08
"""How far to each side of the design an edge is looked for, as a fraction of the lens's width."""
LEAST_SCORE = 0.08
LEAST_SEEN = 0.5
"""Share of the front that a picture must show."""
LEAST_KEPT = 0.4
"""Share of the places in the picture that must have an edge."""
MOST_PLACES = 2500
SPACING_PX = 3.0
SHARPER = 1.25
"""Ratio of blurs from which on one of two edges is in focus and the other is not."""
USUAL_BLUR_PX = (0.5, 2.0, 8.0)
OVERLAP = 12.0
"""Blurs; edges nearer each other than these are fitted together."""
RIVAL = 0.9
SIDES = 0.8
"""Ratio of rms distances above which it is not clear from which side a picture was taken."""
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


@dataclass(frozen=True)
class NamedEdge:
    """One edge along the front.

    Attributes
    ----------
    name
        ``single``, ``outer``, ``inner``, or ``sharper`` and ``softer`` where these cross each other along the front.
    edge
        Its places, in the order of the front.
    registration
        How it lies on the design.
    sharpest
        Whether it is in focus and the other is not.
    """

    name: str
    edge: Edge
    registration: Registration
    sharpest: bool = False


@dataclass(frozen=True)
class Outline:
    """What a picture shows of a front.

    Attributes
    ----------
    edges
        The chosen edge first.
    seen
        Share of the front that the picture shows.
    ends_x_mm
        From where to where the chosen edge was measured, lens coordinates.
    score
        Of the search (`solen.metrology.find`).
    width_mm
        Of the part right behind the front, from wall to wall; None where the picture or the design does not show both.
    warnings
        What cannot be concluded.
    """

    edges: tuple[NamedEdge, ...]
    seen: float
    ends_x_mm: tuple[float, float]
    score: float
    width_mm: float | None
    warnings: tuple[str, ...]

    @property
    def chosen(self) -> NamedEdge:
        """The edge that is taken for the outline."""
        return self.edges[0]


def measure(image: Image, ideal: Ideal, choice: str = "auto") -> Outline:
    """Measure the front of a lens in a picture.

    Parameters
    ----------
    image
        The picture.
    ideal
        The design that the part was made from, or one near it.
    choice
        Which edge of two to take: ``outer``, ``inner``, ``sharper``, or ``auto``: the sharper one, and where neither
        is, the outer one.

    Raises
    ------
    DataError
        Where no such lens is found, too little of it is in the picture, or too little of its edge can be measured.
    """
    if choice not in CHOICES:
        raise SpecError("--edge", value=choice, limit=f"must be one of {', '.join(CHOICES)}")
    _check_scale(image, ideal)
    found, warnings = _found(image, ideal)
    pose, strip, along = _lines(image, found.pose, ideal)
    seen = float(np.mean(strip.seen[:, len(strip.off_mm) // 2]))
    _check_seen(image, seen)
    width = _width(image, pose, ideal)
    if not along:
        raise _none(image, ideal, "no edge runs along where its front would be")
    edges = _edges(image, pose, ideal, strip, along)
    pose, more = _side(edges, pose, ideal)
    named = _named(edges, image, pose, ideal)
    if not named:
        raise _none(image, ideal, f"less than {LEAST_KEPT:.0%} of its edge can be measured ({_why(edges)})")
    ordered, said = _ordered(named, choice)
    _check_shape(image, ideal, ordered[0], width)
    x = ordered[0].registration.points_mm[:, 0]
    ends = (float(x.min()), float(x.max()))
    said += [*_cropped(seen, ends), *_ends(ordered[0].edge), *_wide(width, ideal)]
    return Outline(tuple(ordered), seen, ends, found.score, width, (*warnings, *more, *said))


def _check_scale(image: Image, ideal: Ideal) -> None:
    """`DataError` where the lens would be too small in the picture or far larger than it."""
    across = ideal.width_mm * 1e3 / image.um_per_px
    file, said = image.provenance.file, f"at {image.um_per_px:.4g} µm per pixel the lens of {ideal.width_mm:g} mm"
    if across < COARSEST_PX:
        limit = f"{said} is {across:.0f} pixels wide; at least {COARSEST_PX} are needed"
        raise DataError(file, limit=limit, remedy="check the scale, or magnify more")
    if across * LEAST_SEEN > np.hypot(*image.shape):
        limit = f"{said} is {across:.0f} pixels wide, and the picture {image.shape[1]} x {image.shape[0]}"
        raise DataError(file, limit=limit, remedy="check the scale, or magnify less")


def _found(image: Image, ideal: Ideal) -> tuple[Found, list[str]]:
    """Where the lens is, and what else may be one; both sides are tried where they differ."""
    sides = (False,) if ideal.is_symmetric else (False, True)
    found = sorted(
        (one for mirrored in sides for one in find(image.grey, image.um_per_px, ideal, mirrored=mirrored)),
        key=lambda one: -one.score,
    )
    if not found or found[0].score < LEAST_SCORE:
        raise _none(image, ideal, "nothing in it has its shape at this scale")
    far = 0.5 * ideal.width_mm * 1e3 / image.um_per_px
    rivals = [
        one
        for one in found[1:]
        if one.score > RIVAL * found[0].score
        and np.hypot(*np.subtract(one.pose.vertex_px, found[0].pose.vertex_px)) > far
    ]
    x, y = found[0].pose.vertex_px
    said = f"{len(rivals) + 1} places look like the lens: the one with its vertex at ({x:.0f}, {y:.0f}) px is taken"
    return found[0], [said] if rivals else []


def _lines(image: Image, pose: Pose, ideal: Ideal) -> tuple[Pose, Strip, list[Line]]:
    """The edges along the front, after the strongest one has set the pose right."""
    strip = Strip.of(image.grey, pose, ideal, REACH * ideal.width_mm)
    for _ in range(2):
        first = lines(strip, most=1)
        if not first:
            return pose, strip, []
        points, normals = ideal.at(strip.arc_mm)
        there = pose.to_px(points + normals * first[0].off_mm[:, None])[first[0].shown]
        pose = register(there, np.full(len(there), 1.0), pose, ideal).pose
        strip = Strip.of(image.grey, pose, ideal, REACH * ideal.width_mm)
    return pose, strip, lines(strip)


def _edges(image: Image, pose: Pose, ideal: Ideal, strip: Strip, along: list[Line]) -> list[Edge]:
    """The edges of the lines, from the outermost inwards, each by a fit; two near each other by one."""
    length = float(ideal.arc_mm[-1])
    count = int(min(MOST_PLACES, max(100, length * 1e3 / image.um_per_px / SPACING_PX)))
    arc = np.linspace(0.0, length, count)
    points, normals = ideal.at(arc)
    ways = pose.direction_px(normals)
    ordered = sorted(along, key=lambda line: -float(np.median(line.off_mm)))
    off = np.stack([_smooth(np.interp(arc, strip.arc_mm, line.off_mm)) for line in ordered])
    px_per_mm = 1e3 / image.um_per_px
    strongest = int(np.argmax([line.strength for line in ordered]))
    spaces = _spaces(off, px_per_mm)

    def one(index: int) -> Edge:
        contour = pose.to_px(points + normals * off[index][:, None])
        half = max(0.5 * spaces[index], 3.0)
        return fit_edge(
            image.grey, contour, ways, half_px=half, ceiling=image.ceiling, rising=ordered[index].rising, lines=LINES
        )

    if len(ordered) == 1:
        return [one(0)]
    blur = one(strongest).blur
    blur = blur if USUAL_BLUR_PX[0] < blur < USUAL_BLUR_PX[2] else USUAL_BLUR_PX[1]  # edges too near to tell it alone
    if len(ordered) == 2 and spaces[0] < OVERLAP * blur:
        middle = off.mean(axis=0)
        contour = pose.to_px(points + normals * middle[:, None])
        at = ((off - middle) * px_per_mm).T
        both = fit_two_edges(image.grey, contour, ways, at, blur_px=blur, ceiling=image.ceiling)
        return list(both)
    return [one(index) for index in range(len(ordered))]


def _smooth(off: Floats) -> Floats:
    return np.asarray(ndimage.gaussian_filter1d(off, 3.0, mode="nearest"))


def _spaces(off: Floats, px_per_mm: float) -> list[float]:
    """For each line the median distance in px to the nearest other one; infinite for one alone."""
    return [
        min(
            (float(np.median(np.abs(own - other))) * px_per_mm for j, other in enumerate(off) if j != i), default=np.inf
        )
        for i, own in enumerate(off)
    ]


def _named(edges: list[Edge], image: Image, pose: Pose, ideal: Ideal) -> list[NamedEdge]:
    """Edges of which enough can be measured, with names."""
    kept = [edge for edge in edges if _share(edge) >= LEAST_KEPT]
    scale = image.scale.u_um_per_px
    u_scale = 0.0 if scale is None else scale / image.um_per_px
    names: tuple[str, ...]
    if len(kept) == 2 and (crossed := _by_focus(*kept)) is not None:
        kept, names = list(crossed), ("sharper", "softer")
    elif len(kept) == 1:
        names = ("single",)
    else:
        names = (NAMES[0], *(f"middle {i}" for i in range(1, len(kept) - 1)), NAMES[1])
    sharpest = min((edge.blur for edge in kept), default=0.0)
    return [
        NamedEdge(
            name,
            edge,
            register(edge.points_px[edge.kept], edge.u_px[edge.kept], pose, ideal, u_scale),
            len(kept) > 1 and edge.blur == sharpest and all(e is edge or e.blur > SHARPER * edge.blur for e in kept),
        )
        for name, edge in zip(names, kept, strict=False)
    ]


def _side(edges: list[Edge], pose: Pose, ideal: Ideal) -> tuple[Pose, list[str]]:
    """Pose from the side on which the edge lies best, where the design has two, and what is to be said of it."""
    edge = max(edges, key=_share)
    if ideal.is_symmetric or _share(edge) < LEAST_KEPT:
        return pose, []
    ways = [pose, replace(pose, mirrored=not pose.mirrored)]
    laid = [register(edge.points_px[edge.kept], edge.u_px[edge.kept], way, ideal) for way in ways]
    laid.sort(key=lambda one: one.rms_um)
    said = f"the front lies as well on the design's mirror image ({laid[1].rms_um:.3g} and {laid[0].rms_um:.3g} µm rms)"
    return laid[0].pose, [said] if laid[0].rms_um > SIDES * laid[1].rms_um else []


def _share(edge: Edge) -> float:
    """Share of the places in the picture that have an edge."""
    inside = len(edge.kept) - edge.rejected.get("outside the picture", 0)
    return float(edge.kept.sum()) / max(inside, 1)


def _by_focus(outer: Edge, inner: Edge) -> tuple[Edge, Edge] | None:
    """The sharper and the softer edge where these change sides along the front, as in a tilted part; None otherwise."""
    both = outer.kept & inner.kept
    if both.sum() < 50:
        return None
    ratio = np.where(both, np.log(outer.blur_px / np.maximum(inner.blur_px, 1e-6)), 0.0)
    smooth = ndimage.uniform_filter1d(ratio, 41) / np.maximum(ndimage.uniform_filter1d(both.astype(float), 41), 1e-3)
    limit = np.log(SHARPER)
    outer_softer, outer_sharper = np.mean(smooth > limit), np.mean(smooth < -limit)
    if min(outer_softer, outer_sharper) < 0.15:
        return None
    swap = smooth > 0.0
    return _mixed(outer, inner, swap), _mixed(inner, outer, swap)


def _mixed(first: Edge, second: Edge, swap: NDArray[np.bool_]) -> Edge:
    """Places of the second edge where ``swap``, of the first elsewhere."""
    return Edge(
        np.where(swap[:, None], second.points_px, first.points_px),
        first.normals,
        np.where(swap, second.u_px, first.u_px),
        np.where(swap, second.blur_px, first.blur_px),
        np.where(swap, second.rise, first.rise),
        np.where(swap, second.inside, first.inside),
        np.where(swap, second.kept, first.kept),
        {reason: max(count, second.rejected.get(reason, 0)) for reason, count in first.rejected.items()},
    )


def _ordered(named: list[NamedEdge], choice: str) -> tuple[list[NamedEdge], list[str]]:
    """The chosen edge first, and what is to be said of the choice."""
    if len(named) == 1:
        wanted = choice in ("inner", "sharper")
        return named, [f"one edge alone is seen, so --edge {choice} has nothing to choose from"] if wanted else []
    by_name = {one.name: one for one in named}
    sharp = next((one for one in named if one.sharpest or one.name == "sharper"), None)
    if choice in by_name:
        chosen = by_name[choice]
    elif choice == "sharper" and sharp is None:
        raise DataError("--edge", value=choice, limit="no edge is clearly sharper", remedy="name outer or inner")
    else:
        chosen = sharp or named[0]
    others = [one for one in named if one is not chosen]
    gaps = ", ".join(f"{_apart_um(chosen, one):.0f} µm" for one in others)
    why = "the sharper" if chosen is sharp else f"the {chosen.name}"
    said = f"{len(named)} edges are seen ({', '.join(one.name for one in named)}; {gaps} apart): {why} is taken"
    if chosen is not sharp and choice == "auto":
        said += ", as none is sharper: which face it belongs to cannot be told (--edge)"
    return [chosen, *others], [said]


def _apart_um(one: NamedEdge, other: NamedEdge) -> float:
    """Median distance of two edges along the normals."""
    both = one.edge.kept & other.edge.kept
    if not both.any():
        return float("nan")
    px = np.sum((one.edge.points_px - other.edge.points_px) * one.edge.normals, axis=1)[both]
    return float(np.median(np.abs(px))) * one.registration.pose.um_per_px


def _width(image: Image, pose: Pose, ideal: Ideal) -> float | None:
    """Width of the part from wall to wall; the front says nothing about it where its scale is in doubt."""
    total = ideal.width_mm
    for wall, side in ((ideal.left_mm, -1.0), (ideal.right_mm, 1.0)):
        if len(wall) < 2:
            return None
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(wall, axis=0).T))])
        far = arc > WALL_FROM * arc[-1]  # past the corner
        strip = Strip.along(
            image.grey, pose, arc[far], wall[far], side * outward(wall)[far], WALL_REACH * ideal.width_mm
        )
        if np.mean(strip.seen[:, len(strip.off_mm) // 2]) < LEAST_SEEN or not (found := lines(strip, most=1)):
            return None
        total += float(np.median(found[0].off_mm[found[0].shown]))
    return total


def _check_shape(image: Image, ideal: Ideal, chosen: NamedEdge, width: float | None) -> None:
    """`DataError` where what was found is too unlike the design to be a print of it at this scale."""
    laid = chosen.registration
    missing = _missing(chosen.edge)
    why = ""
    if width is not None and abs(np.log(width / ideal.width_mm)) > np.log(MOST_WIDTH):
        why = f"the part is {width:.3g} mm wide behind the front, and the design {ideal.width_mm:.3g} mm"
    elif laid.rms_um > MOST_RMS * 1e3 * ideal.width_mm:
        why = f"the best place leaves {laid.rms_um:.3g} µm (rms)"
    elif min(missing) > MOST_MISSING:
        why = f"its edge ends {missing[0]:.0%} and {missing[1]:.0%} before the ends of the front"
    if why:
        raise _none(image, ideal, why)


def _missing(edge: Edge) -> tuple[float, float]:
    """Shares of the front at its left and right end that the picture shows and that have no edge."""
    at = np.flatnonzero(edge.kept)
    shown = np.flatnonzero(edge.inside)
    return (max(float(at[0] - shown[0]), 0.0) / len(edge.kept), max(float(shown[-1] - at[-1]), 0.0) / len(edge.kept))


def _ends(edge: Edge) -> list[str]:
    return [
        f"the last {share:.0%} of the front on the {side} is in the picture and has no edge that can be measured"
        for share, side in zip(_missing(edge), ("left", "right"), strict=True)
        if share > MOST_MISSING
    ]


def _wide(width: float | None, ideal: Ideal) -> list[str]:
    if width is None or abs(width / ideal.width_mm - 1.0) < ODD_WIDTH:
        return []
    return [
        f"the part is {width:.3f} mm wide right behind the front where the design has {ideal.width_mm:.3f} mm "
        f"({100.0 * (width / ideal.width_mm - 1.0):+.1f} %): the scale is off, or the print is"
    ]


def _cropped(seen: float, ends: tuple[float, float]) -> list[str]:
    if seen > 0.99:
        return []
    return [
        f"the picture shows {seen:.0%} of the front: it is measured from x = {ends[0]:.2f} to {ends[1]:.2f} mm alone"
    ]


def _check_seen(image: Image, seen: float) -> None:
    if seen < LEAST_SEEN:
        limit = f"shows {seen:.0%} of the front; at least {LEAST_SEEN:.0%} is needed to lay it on the design"
        raise DataError(image.provenance.file, limit=limit, remedy="take a picture of the whole lens")


def _why(edges: list[Edge]) -> str:
    """The most frequent reasons for which places were set aside."""
    counts: dict[str, int] = {}
    for edge in edges:
        for reason, count in edge.rejected.items():
            counts[reason] = counts.get(reason, 0) + count
    most = sorted(counts.items(), key=lambda item: -item[1])[:2]
    return ", ".join(f"{reason}: {count}" for reason, count in most if count) or "no reason"


def _none(image: Image, ideal: Ideal, why: str) -> DataError:
    limit = f"shows no lens like that of {ideal.name}: {why}"
    remedy = "check --um-per-px, the design, and that the whole front is in the picture and in focus"
    return DataError(image.provenance.file, limit=limit, remedy=remedy)
