"""The printed front in a picture: found, its edges named, each measured to a small part of a pixel.

The idea: the design says what to look for and where its normals are, and nothing more; where an edge is, the grey
values alone say. A thick transparent part shows the rim of its upper face and that of its lower one. Where both run
along the front, both are measured: `outer` and `inner` by their place, and where one is clearly sharper than the other,
that is the face on which the microscope was focused, usually the upper one, and it is taken for the outline.

The interface: `measure` gives an `Outline`: the edges, their points in the order of the front, the chosen one first.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from solen.errors import DataError, SpecError
from solen.metrology.edge import LINES, Edge, fit_edge, fit_two_edges
from solen.metrology.find import Found, Pose, find
from solen.metrology.ideal import Ideal
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
OVERLAP = 12.0
"""Blurs; edges nearer each other than these are fitted together."""
RIVAL = 0.9
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
    warnings
        What cannot be concluded.
    """

    edges: tuple[NamedEdge, ...]
    seen: float
    ends_x_mm: tuple[float, float]
    score: float
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
    if not along:
        raise _none(image, ideal, "no edge runs along where its front would be")
    edges = _edges(image, pose, ideal, strip, along)
    named, more = _named(edges, image, pose, ideal)
    if not named:
        raise _none(image, ideal, f"less than {LEAST_KEPT:.0%} of its edge can be measured ({_why(edges)})")
    ordered, said = _ordered(named, choice)
    x = ordered[0].registration.points_mm[:, 0]
    ends = (float(x.min()), float(x.max()))
    return Outline(tuple(ordered), seen, ends, found.score, (*warnings, *more, *said, *_cropped(seen, ends)))


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
    if len(ordered) == 2 and np.isfinite(blur) and spaces[0] < OVERLAP * blur:
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


def _named(edges: list[Edge], image: Image, pose: Pose, ideal: Ideal) -> tuple[list[NamedEdge], list[str]]:
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
    named = [
        NamedEdge(
            name,
            edge,
            register(edge.points_px[edge.kept], edge.u_px[edge.kept], pose, ideal, u_scale),
            len(kept) > 1 and edge.blur == sharpest and all(e is edge or e.blur > SHARPER * edge.blur for e in kept),
        )
        for name, edge in zip(names, kept, strict=False)
    ]
    return named, []


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
