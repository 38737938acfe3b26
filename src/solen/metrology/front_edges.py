"""Edges along a front, fitted near their traces, and the choice of the edge in focus."""

from collections import Counter
from dataclasses import replace

import numpy as np
from scipy import ndimage

from solen.arrays import BoolArray, FloatArray
from solen.metrology.edge import LINES, Edge, fit_edge, fit_two_edges
from solen.metrology.edge_tracing import Band, TracedEdge
from solen.metrology.image import Image
from solen.metrology.nominal import NominalFront
from solen.metrology.pose import Pose

MAX_POINTS = 2500
SPACING_PX = 3.0
MIN_FIRST_BLUR_PX, FIRST_BLUR_PX, MAX_FIRST_BLUR_PX = 0.5, 2.0, 8.0
"""Initial blur of two edges that are fitted together, and the limits within which a single fit replaces it."""
JOINT_FIT_BLURS = 12.0
"""Distance between edges, in blurs, below which they are fitted together."""
FOCUS_RATIO = 1.25
"""Ratio of blurs above which only the sharper of two edges is considered in focus."""


def edges_along(image: Image, pose: Pose, nominal: NominalFront, band: Band, traced: list[TracedEdge]) -> list[Edge]:
    """Fit the traced edges, from the outermost inwards; two edges near each other are fitted together.

    The image of a curved edge is displaced inwards by σ²/2R for a blur σ and a radius R, and by a similar amount due to
    the variance of the averaged lines; both shifts are corrected.
    """
    length = float(nominal.arc_mm[-1])
    count = int(min(MAX_POINTS, max(100, length * pose.px_per_mm / SPACING_PX)))
    arc = np.linspace(0.0, length, count)
    points, normals = nominal.at(arc)
    directions = pose.direction_px(normals)
    half_curvature = 0.5 * nominal.curvature_per_mm(arc) / pose.px_per_mm
    ordered = sorted(traced, key=lambda edge: -float(np.median(edge.offset_mm)))
    offset = np.stack([np.interp(arc, band.arc_mm, edge.offset_mm) for edge in ordered])
    offset = np.asarray(ndimage.gaussian_filter1d(offset, 3.0, mode="nearest"))
    strongest = int(np.argmax([edge.strength for edge in ordered]))
    separations = _separations(offset, pose.px_per_mm)

    def single(index: int) -> Edge:
        contour = pose.to_px(points + normals * offset[index][:, None])
        half = max(0.5 * separations[index], 3.0)
        rising = ordered[index].rising
        return fit_edge(image.grey, contour, directions, half_px=half, ceiling=image.ceiling, rising=rising)

    if len(ordered) == 2:
        blur = single(strongest).blur
        if not MIN_FIRST_BLUR_PX < blur < MAX_FIRST_BLUR_PX:  # single fits fail on overlapping edges
            blur = FIRST_BLUR_PX
        if separations[0] < JOINT_FIT_BLURS * blur:
            middle = offset.mean(axis=0)
            contour = pose.to_px(points + normals * middle[:, None])
            at = ((offset - middle) * pose.px_per_mm).T
            fits = fit_two_edges(image.grey, contour, directions, at, blur_px=blur, ceiling=image.ceiling)
            return [_unbent(edge, half_curvature) for edge in fits]
    return [_unbent(single(index), half_curvature) for index in range(len(ordered))]


def _unbent(edge: Edge, half_curvature_per_px: FloatArray) -> Edge:
    outwards = half_curvature_per_px * (edge.blur**2 + (LINES**2 - 1.0) / 12.0)
    return replace(edge, points_px=edge.points_px + outwards[:, None] * edge.normals)


def _separations(offset: FloatArray, px_per_mm: float) -> list[float]:
    """Return the median distance in px of each edge to the nearest other one; infinite for a single edge."""
    separation = np.median(np.abs(offset[:, None] - offset[None, :]), axis=2) * px_per_mm
    np.fill_diagonal(separation, np.inf)
    return [float(px) for px in separation.min(axis=1)]


def by_focus(outer: Edge, inner: Edge) -> tuple[Edge, Edge] | None:
    """Return the sharper and the softer edge if they swap sides along the front, as on a tilted part, or None."""
    both = outer.kept & inner.kept
    if both.sum() < 50:
        return None
    ratio = np.where(both, np.log(outer.blur_px / np.maximum(inner.blur_px, 1e-6)), 0.0)
    smooth = ndimage.uniform_filter1d(ratio, 41) / np.maximum(ndimage.uniform_filter1d(both.astype(float), 41), 1e-3)
    limit = np.log(FOCUS_RATIO)
    outer_softer, outer_sharper = np.mean(smooth > limit), np.mean(smooth < -limit)
    if min(outer_softer, outer_sharper) < 0.15:
        return None
    swap = smooth > 0.0
    return _mixed(outer, inner, swap), _mixed(inner, outer, swap)


def _mixed(first: Edge, second: Edge, swap: BoolArray) -> Edge:
    """Return the points of the second edge where ``swap`` is true, and of the first elsewhere."""
    return replace(
        first,
        points_px=np.where(swap[:, None], second.points_px, first.points_px),
        u_px=np.where(swap, second.u_px, first.u_px),
        blur_px=np.where(swap, second.blur_px, first.blur_px),
        rise=np.where(swap, second.rise, first.rise),
        inside=np.where(swap, second.inside, first.inside),
        kept=np.where(swap, second.kept, first.kept),
        rejected={reason: max(count, second.rejected.get(reason, 0)) for reason, count in first.rejected.items()},
    )


def why_rejected(edges: list[Edge]) -> str:
    """Return the two most frequent reasons for rejection, with their counts."""
    counts: Counter[str] = Counter()
    for edge in edges:
        counts.update(edge.rejected)
    return ", ".join(f"{reason}: {count}" for reason, count in counts.most_common(2) if count)
