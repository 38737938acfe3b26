"""Edges along an entire front, traced in the band around it.

The band around the front is straightened, with one axis along the front and the other across it. An edge of the lens is
then a line from one end of the band to the other; dust and reflections are short. Dynamic programming finds the exact
continuous path along which the grey value rises, or falls, most in total. Then it finds the next such path, for example
the second rim of a thick transparent part, or the other side of a dark band.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.metrology.image import binned
from solen.metrology.nominal import NominalFront
from solen.metrology.pose import Pose

ALONG, ACROSS = 500, 160
"""Approximate number of positions along the front, and of pixels from its centre line to a side of the band."""
SMOOTH_ALONG, SMOOTH_ACROSS = 1.5, 2.0
MAX_JUMP = 2
"""Largest step of a path sideways from one position to the next, in pixels."""
JUMP_COST = 0.08
"""Cost of a step of one pixel sideways; the gain of a position is at most 1."""
MIN_SEPARATION, MIN_SEPARATION_OPPOSITE = 3.5, 1.0
"""Minimum distance between two paths, in smoothing widths: for paths of the same sign, and for opposite signs, as on
both sides of a narrow dark band.
"""
FLANK = 3
"""Distance to each side, in pixels, at which the change must be smaller than on the path."""
MAX_EDGES = 4
MIN_COVERED, MIN_COVERED_FURTHER = 0.5, 0.35
"""Fraction of positions at which the first edge, and a further one, must be distinct; two edges may cross."""
MIN_SNR = 5.0
MIN_RELATIVE_STRENGTH = 0.15
"""Minimum change across a further edge, relative to that of the first."""


@dataclass(frozen=True, eq=False)
class Band:
    """The straightened surroundings of a front.

    Attributes
    ----------
    arc_mm
        Shape (N,), position along the front.
    offset_mm
        Shape (M,), position across it, positive outwards.
    change
        Shape (N, M), smoothed derivative of the grey value across the front.
    seen
        Shape (N, M), whether the position is in the image.
    """

    arc_mm: FloatArray
    offset_mm: FloatArray
    change: FloatArray
    seen: BoolArray

    @classmethod
    def of(cls, grey: FloatArray, pose: Pose, nominal: NominalFront, reach_mm: float) -> "Band":
        """Return the band of an image, ``reach_mm`` to each side of the front."""
        arc = np.linspace(0.0, float(nominal.arc_mm[-1]), ALONG)
        return cls.along(grey, pose, arc, *nominal.at(arc), reach_mm)

    @classmethod
    def along(
        cls, grey: FloatArray, pose: Pose, arc: FloatArray, points: FloatArray, normals: FloatArray, reach_mm: float
    ) -> "Band":
        """Return the band at points (N, 2) in lens coordinates, with unit normals (N, 2) and lengths ``arc`` (N,)."""
        reach_px = reach_mm * pose.px_per_mm
        factor = max(1, int(reach_px / ACROSS))
        coarse = binned(grey, factor)
        offset_px = np.arange(-np.ceil(reach_px / factor), np.ceil(reach_px / factor) + 0.5) * factor
        positions, directions = pose.to_px(points), pose.direction_px(normals)
        x, y = (
            (positions[:, i : i + 1] + directions[:, i : i + 1] * offset_px - 0.5 * (factor - 1)) / factor
            for i in (0, 1)
        )
        seen = (x >= 0.0) & (x <= coarse.shape[1] - 1.0) & (y >= 0.0) & (y <= coarse.shape[0] - 1.0)
        values = ndimage.map_coordinates(coarse, [y, x], order=1, mode="nearest")
        smooth = ndimage.gaussian_filter1d(values, SMOOTH_ALONG, axis=0)
        change = ndimage.gaussian_filter1d(smooth, SMOOTH_ACROSS, axis=1, order=1)
        return cls(arc, offset_px * pose.um_per_px / 1e3, np.where(seen, change, 0.0), seen)

    @property
    def fraction_seen(self) -> float:
        """Fraction of the front itself that is in the image."""
        return float(np.mean(self.seen[:, len(self.offset_mm) // 2]))


@dataclass(frozen=True, eq=False)
class TracedEdge:
    """An edge along the entire front, located to about a pixel of the band.

    Attributes
    ----------
    offset_mm
        Shape (N,): position across the band, for positions along it.
    rising
        Whether the grey value rises outwards.
    strength
        Median change across the edge.
    covered
        Fraction of positions in the image at which the edge is distinct.
    shown
        Shape (N,): whether the edge is distinct at a position.
    """

    offset_mm: FloatArray
    rising: bool
    strength: float
    covered: float
    shown: BoolArray


def trace_edges(band: Band, max_edges: int = MAX_EDGES) -> list[TracedEdge]:
    """Trace the edges along the front, the strongest first; the list is empty if nothing exceeds the noise."""
    if not band.seen.any():
        return []
    noise = 1.4826 * float(np.median(np.abs(band.change[band.seen])))
    scale = float(np.median(np.abs(band.change).max(axis=1))) + 1e-12
    step_mm = float(band.offset_mm[1] - band.offset_mm[0])
    free = {rising: band.seen.copy() for rising in (True, False)}
    edges: list[TracedEdge] = []
    while len(edges) < max_edges:
        min_change = max(MIN_SNR * noise, MIN_RELATIVE_STRENGTH * edges[0].strength if edges else 0.0)
        candidates = [_traced(band, rising, free[rising], scale, min_change) for rising in (True, False)]
        best = max(candidates, key=lambda edge: edge.covered * edge.strength)
        if best.covered < (MIN_COVERED_FURTHER if edges else MIN_COVERED):
            break
        edges.append(best)
        distance = np.abs(band.offset_mm[None, :] - best.offset_mm[:, None])
        for rising, mask in free.items():
            mask &= (
                distance
                > (MIN_SEPARATION if rising == best.rising else MIN_SEPARATION_OPPOSITE) * SMOOTH_ACROSS * step_mm
            )
    return edges


def _traced(band: Band, rising: bool, free: BoolArray, scale: float, min_change: float) -> TracedEdge:
    """Return the rising or falling edge with the largest total change, along positions that ``free`` allows.

    The edge is distinct at the positions where the change exceeds ``min_change``.
    """
    change = band.change if rising else -band.change
    allowed = np.where(free, change, 0.0)
    gain = np.maximum(allowed, 0.0)
    path = best_path(gain / (gain + scale))
    along = np.arange(len(path))
    shown = _on_maximum(np.maximum(change, 0.0), path) & (allowed[along, path] > min_change)
    covered = float(shown.sum()) / max(int(band.seen[along, path].sum()), 1)
    strength = float(np.median(allowed[along, path][shown])) if shown.any() else 0.0
    return TracedEdge(band.offset_mm[path], rising, strength, covered, shown)


def _on_maximum(gain: FloatArray, path: IndexArray) -> BoolArray:
    """Return whether a path is on a maximum across the band, not on the flank of a broader edge near it."""
    along, last = np.arange(len(path)), gain.shape[1] - 1
    before, behind = (gain[along, np.clip(path + side * FLANK, 0, last)] for side in (-1, 1))
    return np.asarray((gain[along, path] >= before) & (gain[along, path] >= behind))


def best_path(gain: FloatArray) -> IndexArray:
    """Return the column for each row of (N, M) that maximises the sum of gains minus the cost of sideways steps."""
    rows, columns = gain.shape
    cost = JUMP_COST * np.abs(np.arange(-MAX_JUMP, MAX_JUMP + 1))
    steps = np.zeros((rows, columns), dtype=np.intp)
    padded = np.full(columns + 2 * MAX_JUMP, -np.inf)  # the best sums so far; no path enters from outside the band
    total, windows = padded[MAX_JUMP:-MAX_JUMP], np.lib.stride_tricks.sliding_window_view(padded, 2 * MAX_JUMP + 1)
    total[:] = gain[0]
    all_columns = np.arange(columns)
    for row in range(1, rows):
        reached = windows - cost
        steps[row] = reached.argmax(axis=1)
        total[:] = reached[all_columns, steps[row]] + gain[row]
    path = np.zeros(rows, dtype=np.intp)
    path[-1] = int(np.argmax(total))
    for row in range(rows - 1, 0, -1):
        path[row - 1] = path[row] + steps[row, path[row]] - MAX_JUMP
    return path
