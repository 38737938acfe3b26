"""Edges along a front, fitted where the strip's lines say that they run, and which of two is in focus."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from solen.arrays import FloatArray
from solen.metrology.edge import LINES, Edge, fit_edge, fit_two_edges
from solen.metrology.find import Pose
from solen.metrology.ideal import Ideal
from solen.metrology.image import Image
from solen.metrology.strip import Line, Strip

MOST_PLACES = 2500
SPACING_PX = 3.0
USUAL_BLUR_PX = (0.5, 2.0, 8.0)
OVERLAP = 12.0
"""Blurs; edges nearer each other than these are fitted together."""
SHARPER = 1.25
"""Ratio of blurs from which on one of two edges is in focus and the other is not."""


def edges_along(image: Image, pose: Pose, ideal: Ideal, strip: Strip, along: list[Line]) -> list[Edge]:
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


def _smooth(off: FloatArray) -> FloatArray:
    return np.asarray(ndimage.gaussian_filter1d(off, 3.0, mode="nearest"))


def _spaces(off: FloatArray, px_per_mm: float) -> list[float]:
    """For each line the median distance in px to the nearest other one; infinite for one alone."""
    return [
        min(
            (float(np.median(np.abs(own - other))) * px_per_mm for j, other in enumerate(off) if j != i), default=np.inf
        )
        for i, own in enumerate(off)
    ]


def by_focus(outer: Edge, inner: Edge) -> tuple[Edge, Edge] | None:
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


def share(edge: Edge) -> float:
    """Share of the places in the picture that have an edge."""
    inside = len(edge.kept) - edge.rejected.get("outside the picture", 0)
    return float(edge.kept.sum()) / max(inside, 1)


def why_rejected(edges: list[Edge]) -> str:
    """The most frequent reasons for which places were set aside."""
    counts: dict[str, int] = {}
    for edge in edges:
        for reason, count in edge.rejected.items():
            counts[reason] = counts.get(reason, 0) + count
    most = sorted(counts.items(), key=lambda item: -item[1])[:2]
    return ", ".join(f"{reason}: {count}" for reason, count in most if count) or "no reason"
