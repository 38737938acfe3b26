"""The surroundings of a front, unrolled: along it one way, across it the other, and the edges that run all along it.

The idea: an edge of the lens is a line from one end of the strip to the other, wherever it lies across; dust and
reflections are short. The line that gathers the most change of one sign, without jumping, is found exactly by dynamic
programming, then the next one beside it: the two rims of a thick transparent part, or both sides of a dark band.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from solen.arrays import BoolArray, FloatArray
from solen.metrology.find import Pose, binned
from solen.metrology.ideal import Ideal

ALONG, ACROSS = 500, 160
"""Places along the front, and pixels from its middle to a side of the strip, about."""
SMOOTH_ALONG, SMOOTH_ACROSS = 1.5, 2.0
JUMP = 2
"""Pixels by which a line may move aside from one place to the next."""
JUMP_COST = 0.08
APART, APART_OTHER = 3.5, 1.0
"""Smoothing widths between two lines, at least: of one sign, and of two, as on both sides of a narrow dark band."""
FLANK = 3
"""Pixels to each side at which the change must be less than on a line."""
MOST_LINES = 4
LEAST_COVERED, LEAST_COVERED_FURTHER = 0.5, 0.35
"""Share of the places at which the first line, and a further one, must stand out; two lines may cross."""
LEAST_SNR = 5.0
FAINTEST = 0.15
"""Change across a further line over that of the first."""


@dataclass(frozen=True)
class Strip:
    """Grey values around a front.

    Attributes
    ----------
    arc_mm
        Shape (N,), along the front.
    off_mm
        Shape (M,), across it, positive outwards.
    change
        Shape (N, M), smoothed derivative of the grey value across.
    seen
        Shape (N, M), whether the place is in the picture.
    """

    arc_mm: FloatArray
    off_mm: FloatArray
    change: FloatArray
    seen: BoolArray

    @classmethod
    def of(cls, grey: FloatArray, pose: Pose, ideal: Ideal, reach_mm: float) -> "Strip":
        """Strip of a picture, ``reach_mm`` to each side of the front."""
        arc = np.linspace(0.0, float(ideal.arc_mm[-1]), ALONG)
        return cls.along(grey, pose, arc, *ideal.at(arc), reach_mm)

    @classmethod
    def along(
        cls, grey: FloatArray, pose: Pose, arc: FloatArray, points: FloatArray, normals: FloatArray, reach_mm: float
    ) -> "Strip":
        """Strip along any points (N, 2) in lens coordinates, with unit normals (N, 2) and lengths ``arc`` (N,)."""
        reach_px = reach_mm * 1e3 / pose.um_per_px
        factor = max(1, int(reach_px / ACROSS))
        coarse = binned(grey, factor)
        off_px = np.arange(-np.ceil(reach_px / factor), np.ceil(reach_px / factor) + 0.5) * factor
        places, ways = pose.to_px(points), pose.direction_px(normals)
        x, y = ((places[:, i : i + 1] + ways[:, i : i + 1] * off_px - 0.5 * (factor - 1)) / factor for i in (0, 1))
        seen = (x >= 0.0) & (x <= coarse.shape[1] - 1.0) & (y >= 0.0) & (y <= coarse.shape[0] - 1.0)
        values = ndimage.map_coordinates(coarse, [y, x], order=1, mode="nearest")
        smooth = ndimage.gaussian_filter1d(values, SMOOTH_ALONG, axis=0)
        change = ndimage.gaussian_filter1d(smooth, SMOOTH_ACROSS, axis=1, order=1)
        return cls(arc, off_px * pose.um_per_px / 1e3, np.where(seen, change, 0.0), seen)

    @property
    def step_mm(self) -> float:
        """From one place across to the next."""
        return float(self.off_mm[1] - self.off_mm[0])


@dataclass(frozen=True)
class Line:
    """An edge along the whole front.

    Attributes
    ----------
    off_mm
        Shape (N,): where it is across, at the strip's places along.
    rising
        Whether the grey value rises outwards.
    strength
        Median change across it.
    covered
        Share of the places in the picture where it stands out.
    shown
        Shape (N,): whether it stands out there.
    """

    off_mm: FloatArray
    rising: bool
    strength: float
    covered: float
    shown: BoolArray


def lines(strip: Strip, most: int = MOST_LINES) -> list[Line]:
    """Edges that run along the front, the strongest first; none where nothing stands out of the noise."""
    if not strip.seen.any():
        return []
    noise = 1.4826 * float(np.median(np.abs(strip.change[strip.seen])))
    scale = float(np.median(np.abs(strip.change).max(axis=1))) + 1e-12
    free = {rising: strip.seen.copy() for rising in (True, False)}
    found: list[Line] = []
    while len(found) < most:
        both = [_line(strip, rising, free[rising], scale, noise, found) for rising in (True, False)]
        best = max(both, key=lambda line: line.covered * line.strength)
        if best.covered < (LEAST_COVERED_FURTHER if found else LEAST_COVERED):
            break
        found.append(best)
        away = np.abs(strip.off_mm[None, :] - best.off_mm[:, None])
        for rising, places in free.items():
            places &= away > (APART if rising == best.rising else APART_OTHER) * SMOOTH_ACROSS * strip.step_mm
    return found


def _line(strip: Strip, rising: bool, free: BoolArray, scale: float, noise: float, before: list[Line]) -> Line:
    """The line of one sign that gathers the most change where it is free to go."""
    change = np.where(free, strip.change if rising else -strip.change, 0.0)
    gain = np.maximum(change, 0.0)
    path = best_path(gain / (gain + scale))
    gain = np.maximum(strip.change if rising else -strip.change, 0.0)
    along = np.arange(len(path))
    own = np.where(_peaks(gain, path), change[along, path], 0.0)
    least = max(LEAST_SNR * noise, FAINTEST * before[0].strength if before else 0.0)
    shown = own > least
    seen = strip.seen[along, path]
    covered = float(shown.sum()) / max(int(seen.sum()), 1)
    strength = float(np.median(own[shown])) if shown.any() else 0.0
    return Line(strip.off_mm[path], rising, strength, covered, shown)


def _peaks(gain: FloatArray, path: NDArray[np.intp]) -> BoolArray:
    """Where a line stands on a maximum across, and not on the flank of the broader line beside it."""
    along, last = np.arange(len(path)), gain.shape[1] - 1
    own = gain[along, path]
    sides = [gain[along, np.clip(path + side * FLANK, 0, last)] for side in (-1, 1)]
    return np.asarray((own >= sides[0]) & (own >= sides[1]))


def best_path(gain: FloatArray) -> NDArray[np.intp]:
    """Column for each row of (N, M) such that the sum of gains less the cost of moving aside is greatest."""
    rows, columns = gain.shape
    cost = JUMP_COST * np.abs(np.arange(-JUMP, JUMP + 1))
    came = np.zeros((rows, columns), dtype=np.intp)
    padded = np.full(columns + 2 * JUMP, -np.inf)  # the best sums so far; nothing comes from beyond the strip
    total, near = padded[JUMP:-JUMP], np.lib.stride_tricks.sliding_window_view(padded, 2 * JUMP + 1)
    total[:] = gain[0]
    every = np.arange(columns)
    for row in range(1, rows):
        reached = near - cost
        came[row] = reached.argmax(axis=1)
        total[:] = reached[every, came[row]] + gain[row]
    path = np.zeros(rows, dtype=np.intp)
    path[-1] = int(np.argmax(total))
    for row in range(rows - 1, 0, -1):
        path[row - 1] = path[row] + came[row, path[row]] - JUMP
    return path
