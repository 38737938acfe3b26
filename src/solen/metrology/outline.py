"""The printed front in an image: location, names of its edges, and their positions to a small fraction of a pixel.

The design only defines where to search and in which directions; the position of an edge is determined by the grey
values alone. A thick transparent part shows the rims of its upper and lower faces. If both run along the front, both
are measured and named `outer` and `inner` by their position. If one is clearly sharper than the other, it is the edge
of the face on which the microscope was focused, usually the upper one, and is used as the outline.

`measure_outline` returns an `Outline` with its edges in order along the front, the chosen one first.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.metrology.edge import Edge
from solen.metrology.edge_tracing import MAX_EDGES, Band, TracedEdge, trace_edges
from solen.metrology.front_edges import FOCUS_RATIO, by_focus, edges_along, why_rejected
from solen.metrology.image import Image
from solen.metrology.nominal import NominalFront, SeenFrom
from solen.metrology.plausibility import (
    check_scale,
    check_seen,
    check_shape,
    crop_warnings,
    end_warnings,
    merged_edge_warnings,
    no_lens,
    part_width_mm,
    wall_edges,
    width_warnings,
)
from solen.metrology.pose import Pose
from solen.metrology.print_fit import PrintFit, PrintPriors, TracedOutline, fit_print
from solen.metrology.registration import Registration, register
from solen.metrology.template_match import Match, match_template
from solen.ranks import Caution, do_not_use, warning

EdgeChoice = Literal["auto", "outer", "inner", "sharper"]
REACH = 0.08
"""Distance on each side of the design within which an edge is searched for, as a fraction of the lens width."""
REACH_PX = 14.0
"""Minimum of the search distance in pixels: image noise is estimated near the edge, not on it."""
MIN_SCORE = 0.08
"""Minimum score of a match."""
MIN_KEPT = 0.4
"""Minimum fraction of the positions in the image that must have an edge."""
RIVAL_SCORE = 0.9
"""Score relative to the best one above which another region also looks like the lens."""
MAX_SIDE_RATIO = 0.8
"""Ratio of RMS deviations above which the viewing side is uncertain."""

UNKNOWN_SIDE = warning(
    "the design is mirror-symmetric, so the image does not show which face is visible: left and "
    "right, and the sign of asymmetries, may be exchanged; set --seen-from to top or bottom"
)


@dataclass(frozen=True, eq=False)
class NamedEdge:
    """One edge along the front.

    Attributes
    ----------
    name
        ``single``, ``outer``, ``inner``, or ``sharper`` and ``softer`` if these cross each other along the front.
    edge
        The fitted edge, in the order of the front.
    registration
        Registration of the edge to the design.
    traced, size
        The edge with the walls behind it, and their fit with size and overgrowth.
    sharpest
        Whether it is in focus and the other edge is not.
    """

    name: str
    edge: Edge
    registration: Registration
    traced: TracedOutline
    size: PrintFit
    sharpest: bool = False

    def outside_um(self, other: "NamedEdge") -> FloatArray:
        """Return the distances by which this edge is outside another, at positions (M,) where both are measured."""
        both = self.edge.kept & other.edge.kept
        px = np.sum((self.edge.points_px - other.edge.points_px) * other.edge.normals, axis=1)[both]
        return np.asarray(px * other.registration.pose.um_per_px)


@dataclass(frozen=True, eq=False)
class Outline:
    """Front as seen in an image.

    Attributes
    ----------
    edges
        All edges, the chosen one first.
    seen
        Fraction of the front that the image shows.
    ends_x_mm
        Lateral range over which the chosen edge was measured, lens coordinates.
    width_mm
        Width of the part just behind the front, from wall to wall; None if the image or the design does not show
        both.
    warnings
        Warnings.
    """

    edges: tuple[NamedEdge, ...]
    seen: float
    ends_x_mm: tuple[float, float]
    width_mm: float | None
    warnings: tuple[Caution, ...]

    @property
    def chosen(self) -> NamedEdge:
        """The edge that is used as the outline."""
        return self.edges[0]


def measure_outline(
    image: Image,
    nominal: NominalFront,
    choice: EdgeChoice = "auto",
    priors: PrintPriors = PrintPriors(),
    seen_from: SeenFrom | None = None,
) -> Outline:
    """Measure the front of a lens in an image.

    Parameters
    ----------
    image
        The image.
    nominal
        The design that the part was made from, or a similar one.
    choice
        Edge to select if there are two: ``outer``, ``inner``, ``sharper``, or ``auto`` for the sharper one, or the
        outer one if neither is sharper.
    priors
        Priors of the print's size and form.
    seen_from
        Face that the image shows; ``bottom`` was on the build plate and appears mirrored. None selects the side that
        fits.

    Raises
    ------
    SpecError
        If ``choice`` is not one of these.
    DataError
        If no such lens is found, too little of it is in the image, or too little of its edge can be measured.
    """
    if choice not in get_args(EdgeChoice):
        raise SpecError("edge", value=choice, limit=f"must be one of {', '.join(get_args(EdgeChoice))}")
    check_scale(image, nominal)
    sides = (False, True) if seen_from is None else (seen_from == "bottom",)
    match, warnings = _match(image, nominal, sides[:1] if nominal.is_symmetric else sides)
    pose, band, traced = _traced(image, match.pose, nominal)
    check_seen(image, band.fraction_seen)
    if not traced:
        raise no_lens(image, nominal, "there is no edge where its front is expected")
    edges = edges_along(image, pose, nominal, band, traced)
    walls = wall_edges(image, pose, nominal, 1 if len(edges) == 1 else MAX_EDGES)
    traced_side = pose.mirrored
    pose, side_warnings = _side(edges, pose, nominal, sides)
    walls = walls if pose.mirrored == traced_side else walls[::-1]
    width = part_width_mm([wall[0] if wall else None for wall in walls], pose, nominal)
    named = _named(edges, walls, image, _RegistrationInputs(pose, nominal, priors))
    if not named:
        why = f"less than {MIN_KEPT:.0%} of its edge can be measured ({why_rejected(edges)})"
        raise no_lens(image, nominal, why)
    ordered, choice_warnings = _ordered(named, choice)
    chosen = ordered[0]
    check_shape(image, nominal, chosen.edge, chosen.registration, width)
    x = chosen.registration.points_mm[:, 0]
    ends = (float(x.min()), float(x.max()))
    warnings += [*side_warnings, *choice_warnings, *crop_warnings(band.fraction_seen, ends)]
    warnings += [*end_warnings(chosen.edge), *width_warnings(width, nominal)]
    if len(named) == 1:
        warnings += merged_edge_warnings([wall[0] if wall else None for wall in walls], chosen.edge)
    return Outline(tuple(ordered), band.fraction_seen, ends, width, tuple(warnings))


def _match(image: Image, nominal: NominalFront, sides: Sequence[bool]) -> tuple[Match, list[Caution]]:
    """Return the location of the lens, and a warning about other candidates; ``sides`` are allowed mirror states."""
    searches = (match_template(image.grey, image.um_per_px, nominal, mirrored=mirrored) for mirrored in sides)
    matches = [match for search in searches for match in search]
    matches.sort(key=lambda match: -match.score)
    if not matches or matches[0].score < MIN_SCORE:
        raise no_lens(image, nominal, "nothing in the image has the shape of the lens at this scale")
    best, min_px = matches[0], 0.5 * nominal.width_mm * 1e3 / image.um_per_px
    x, y = best.pose.origin_px
    rivals = sum(
        match.score > RIVAL_SCORE * best.score and np.hypot(*np.subtract(match.pose.origin_px, (x, y))) > min_px
        for match in matches
    )
    caution = f"{rivals + 1} regions look like the lens: the region with its vertex at ({x:.0f}, {y:.0f}) px is used"
    return best, [warning(caution)] if rivals else []


def _traced(image: Image, pose: Pose, nominal: NominalFront) -> tuple[Pose, Band, list[TracedEdge]]:
    """Return the edges along the front; the strongest edge is used first to correct the pose."""
    reach_mm = max(REACH * nominal.width_mm, REACH_PX * 1e-3 * image.um_per_px)
    band = Band.of(image.grey, pose, nominal, reach_mm)
    for _ in range(2):
        strongest = trace_edges(band, max_edges=1)
        if not strongest:
            return pose, band, []
        points, normals = nominal.at(band.arc_mm)
        positions = pose.to_px(points + normals * strongest[0].offset_mm[:, None])[strongest[0].shown]
        pose = register(positions, np.ones(len(positions)), pose, nominal).pose
        band = Band.of(image.grey, pose, nominal, reach_mm)
    return pose, band, trace_edges(band)


@dataclass(frozen=True, eq=False)
class _RegistrationInputs:
    """Inputs for the registration of an edge: an initial pose, the design, and priors of the print."""

    pose: Pose
    nominal: NominalFront
    priors: PrintPriors

    def named(self, name: str, edge: Edge, walls: Sequence[Edge | None], image: Image, *, sharpest: bool) -> NamedEdge:
        """Return an edge with its name, fit and registration."""
        scale = image.scale
        traced = TracedOutline.of(edge, walls, self.pose, None if scale.u_um_per_px is None else scale.u_relative)
        size = fit_print(traced, self.nominal, self.priors)
        registration = register(*edge.measured, self.pose, self.nominal, scale.u_relative, size.on_front)
        return NamedEdge(name, edge, registration, traced, size, sharpest)


def _named(
    edges: list[Edge], walls: Sequence[list[Edge]], image: Image, inputs: _RegistrationInputs
) -> list[NamedEdge]:
    """Return the edges, with names, of which a sufficient part can be measured."""
    measurable = [edge for edge in edges if edge.fraction_kept >= MIN_KEPT]
    wall_sets = [_walls_of(walls, edges.index(edge), len(edges)) for edge in measurable]
    names: Iterable[str] = ("outer", *(f"middle {i}" for i in range(1, len(measurable) - 1)), "inner")
    if len(measurable) == 2 and (crossed := by_focus(*measurable)) is not None:
        measurable, names, wall_sets = list(crossed), ("sharper", "softer"), [(), ()]
    elif len(measurable) == 1:
        names = ("single",)
    sharpest = min((edge.blur for edge in measurable), default=0.0)
    return [
        inputs.named(
            name,
            edge,
            edge_walls,
            image,
            sharpest=len(measurable) > 1
            and edge.blur == sharpest
            and all(other is edge or other.blur > FOCUS_RATIO * edge.blur for other in measurable),
        )
        for name, edge, edge_walls in zip(names, measurable, wall_sets, strict=False)
    ]


def _walls_of(walls: Sequence[list[Edge]], index: int, count: int) -> tuple[Edge | None, ...]:
    """Return the edge of each wall that continues an edge of the front; None if the wall has more or fewer edges."""
    return tuple(wall[index] if len(wall) == count else None for wall in walls)


def _side(edges: list[Edge], pose: Pose, nominal: NominalFront, sides: Sequence[bool]) -> tuple[Pose, list[Caution]]:
    """Return the pose with the allowed mirror state that fits the edge best; warn if the mirror state is uncertain."""
    edge = max(edges, key=lambda edge: edge.fraction_kept)
    if nominal.is_symmetric:
        return pose, [UNKNOWN_SIDE] if len(sides) > 1 else []
    if edge.fraction_kept < MIN_KEPT:
        return pose, []
    poses = [pose, replace(pose, mirrored=not pose.mirrored)]
    best, other = sorted((register(*edge.measured, side, nominal) for side in poses), key=lambda fit: fit.rms_um)
    if best.pose.mirrored not in sides:
        face = "bottom" if best.pose.mirrored else "top"
        return other.pose, [
            do_not_use(
                f"the front fits the design better as seen from the {face} ({best.rms_um:.3g} µm RMS, compared with "
                f"{other.rms_um:.3g} µm for the side specified with --seen-from): check which face the image shows"
            )
        ]
    if len(sides) == 1 or best.rms_um <= MAX_SIDE_RATIO * other.rms_um:
        return best.pose, []
    return best.pose, [
        warning(
            f"the front also fits the design's mirror image ({other.rms_um:.3g} and {best.rms_um:.3g} "
            "µm RMS): the image may show the part from either side (--seen-from)"
        )
    ]


def _ordered(named: list[NamedEdge], choice: EdgeChoice) -> tuple[list[NamedEdge], list[Caution]]:
    """Return the chosen edge first, and warnings about the choice."""
    if len(named) == 1:
        without_choice = choice in {"inner", "sharper"}
        return named, [warning(f"only one edge is visible: --edge {choice} has no effect")] if without_choice else []
    by_name = {edge.name: edge for edge in named}
    sharp = next((edge for edge in named if edge.sharpest or edge.name == "sharper"), None)
    if choice == "sharper" and sharp is None:
        raise DataError("--edge", value=choice, limit="no edge is clearly sharper", remedy="set it to outer or inner")
    chosen = by_name.get(choice) or sharp or named[0]
    others = [edge for edge in named if edge is not chosen]
    gaps = ", ".join(f"{np.median(np.abs(other.outside_um(chosen))):.0f} µm" for other in others)
    why = "the sharper" if chosen is sharp else f"the {chosen.name}"
    text = (
        f"{len(named)} edges are visible ({', '.join(edge.name for edge in named)}; {gaps} apart): {why} edge is used"
    )
    if chosen is not sharp and choice == "auto":
        text += " because none is sharper; the image does not show to which face the edge belongs (--edge)"
    return [chosen, *others], [warning(text)]
