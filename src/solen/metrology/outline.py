"""The printed front in a picture: found, its edges named, each measured to a small part of a pixel.

The idea: the design says what to look for and where its normals are, and nothing more; where an edge is, the grey
values alone say. A thick transparent part shows the rim of its upper face and that of its lower one. Where both run
along the front, both are measured: `outer` and `inner` by their place, and where one is clearly sharper than the other,
that is the face on which the microscope was focused, usually the upper one, and it is taken for the outline.

The interface: `measure` gives an `Outline`: the edges, their points in the order of the front, the chosen one first.
"""

from dataclasses import dataclass, replace

import numpy as np

from solen.errors import DataError, SpecError
from solen.metrology.along import SHARPER, by_focus, edges_along, share, why_rejected
from solen.metrology.edge import Edge
from solen.metrology.find import Found, Pose, find
from solen.metrology.ideal import Ideal
from solen.metrology.image import Image
from solen.metrology.likeness import (
    check_scale,
    check_seen,
    check_shape,
    cropped,
    merged,
    missing_ends,
    no_lens,
    odd_width,
    part_width_mm,
)
from solen.metrology.register import Registration, register
from solen.metrology.strip import Line, Strip, lines

NAMES = ("outer", "inner")
CHOICES = ("auto", "outer", "inner", "sharper")
REACH = 0.08
"""How far to each side of the design an edge is looked for, as a fraction of the lens's width."""
LEAST_SCORE = 0.08
LEAST_KEPT = 0.4
"""Share of the places in the picture that must have an edge."""
RIVAL = 0.9
SIDES = 0.8
"""Ratio of rms distances above which it is not clear from which side a picture was taken."""


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
    check_scale(image, ideal)
    found, warnings = _found(image, ideal)
    pose, strip, along = _lines(image, found.pose, ideal)
    seen = float(np.mean(strip.seen[:, len(strip.off_mm) // 2]))
    check_seen(image, seen)
    width = part_width_mm(image, pose, ideal)
    if not along:
        raise no_lens(image, ideal, "no edge runs along where its front would be")
    edges = edges_along(image, pose, ideal, strip, along)
    pose, more = _side(edges, pose, ideal)
    named = _named(edges, image, pose, ideal)
    if not named:
        raise no_lens(image, ideal, f"less than {LEAST_KEPT:.0%} of its edge can be measured ({why_rejected(edges)})")
    ordered, said = _ordered(named, choice)
    check_shape(image, ideal, ordered[0].edge, ordered[0].registration, width)
    x = ordered[0].registration.points_mm[:, 0]
    ends = (float(x.min()), float(x.max()))
    said += [*cropped(seen, ends), *missing_ends(ordered[0].edge), *odd_width(width, ideal)]
    if len(named) == 1:
        said += merged(image, pose, ideal, named[0].edge)
    return Outline(tuple(ordered), seen, ends, found.score, width, (*warnings, *more, *said))


def _found(image: Image, ideal: Ideal) -> tuple[Found, list[str]]:
    """Where the lens is, and what else may be one; both sides are tried where they differ."""
    sides = (False,) if ideal.is_symmetric else (False, True)
    found = sorted(
        (one for mirrored in sides for one in find(image.grey, image.um_per_px, ideal, mirrored=mirrored)),
        key=lambda one: -one.score,
    )
    if not found or found[0].score < LEAST_SCORE:
        raise no_lens(image, ideal, "nothing in it has its shape at this scale")
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


def _named(edges: list[Edge], image: Image, pose: Pose, ideal: Ideal) -> list[NamedEdge]:
    """Edges of which enough can be measured, with names."""
    kept = [edge for edge in edges if share(edge) >= LEAST_KEPT]
    scale = image.scale.u_um_per_px
    u_scale = 0.0 if scale is None else scale / image.um_per_px
    names: tuple[str, ...]
    if len(kept) == 2 and (crossed := by_focus(*kept)) is not None:
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
    edge = max(edges, key=share)
    if ideal.is_symmetric or share(edge) < LEAST_KEPT:
        return pose, []
    ways = [pose, replace(pose, mirrored=not pose.mirrored)]
    laid = [register(edge.points_px[edge.kept], edge.u_px[edge.kept], way, ideal) for way in ways]
    laid.sort(key=lambda one: one.rms_um)
    said = f"the front lies as well on the design's mirror image ({laid[1].rms_um:.3g} and {laid[0].rms_um:.3g} µm rms)"
    return laid[0].pose, [said] if laid[0].rms_um > SIDES * laid[1].rms_um else []


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
