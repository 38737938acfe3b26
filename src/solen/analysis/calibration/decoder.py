"""Decoding of voltages into angles with a calibration: the likelihood over all angles, and its credible bands.

Between neighbouring points the curve is straight in the plane of the two voltages, so the nearest angle of each segment
has a closed form. Segments whose best likelihood is far below the maximum are ignored; the others form intervals of
adjoining angles. Over each interval, however narrow, the likelihood is evaluated on a separate fine grid. It is a t
distribution about the rising and the falling curve, each with weight one half. The prior is uniform over the calibrated
range. The probability of an interval is its fraction of the total, and its band is the shortest band that contains 68
or 95 % of it. If two intervals have a notable probability, the reading is ambiguous and both are reported.

A clipped reading of a receiver shows only that the true voltage is at or beyond the limit.

Public names: `Decoder` and `Decoded`.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr
from scipy.stats import f as f_distribution

from solen.analysis.calibration.estimate import Calibration, at_angles
from solen.arrays import BoolArray, FloatArray, IndexArray, joined_rows
from solen.errors import DataError

LEVELS = (0.68, 0.95)
OUTSIDE = 1e-3
"""A reading is off the curve if the probability of a larger distance from the curve is below this value."""
_DROP = 8.0  # largest difference from the maximum log-likelihood that is not negligible
_POINTS = 64  # number of points of the grid of an interval
_AT_ONCE = 512
_MAX_PIECES = 4000
_FLAT = 0.1  # tolerance of the straight pieces, in standard deviations
_COUNTS = 0.01  # smallest probability of an interval that is reported
_TINY = 1e-6  # tolerance, as a fraction of a piece
_SHORT = 1e-9  # smallest length of a piece, in standard deviations
_MAX_LOG_DROP = 200.0  # this far below the maximum log-likelihood, readings are on no piece and all pieces are used
_SURE = 1.0 - LEVELS[1]


@dataclass(frozen=True, eq=False)
class Decoded:
    """Decoded angles of readings.

    Attributes
    ----------
    angle_deg
        Median of the most probable interval, (n,).
    low_deg, high_deg
        Limits of the 68 and 95 % bands of that interval, (n, 2).
    probability
        Probability of that interval.
    right
        Probability of a negative angle (to the right).
    distance
        Squared distance of the voltages from the curve, in units of the covariance.
    outside, ambiguous, clipped
        Whether the voltages match no point on the curve, match several points, or are at a limit of the recorder.
    at_end
        Whether the band reaches an end of the calibrated range, so that the angle may be beyond it.
    other
        Indices (k,) of the readings to which the less probable intervals belong.
    other_deg, other_probability
        95 % bands (k, 2) of these intervals, and their probabilities.
    """

    angle_deg: FloatArray
    low_deg: FloatArray
    high_deg: FloatArray
    probability: FloatArray
    right: FloatArray
    distance: FloatArray
    outside: BoolArray
    ambiguous: BoolArray
    clipped: BoolArray
    at_end: BoolArray
    other: IndexArray
    other_deg: FloatArray
    other_probability: FloatArray

    def holds(self, angle_deg: FloatArray, level: int) -> BoolArray:
        """Return whether the bands at a level (0 for 68 %, 1 for 95 %) contain the true angles.

        At the 95 % level, the band of any interval may contain the angle.
        """
        found = (self.low_deg[:, level] <= angle_deg) & (angle_deg <= self.high_deg[:, level])
        if level == len(LEVELS) - 1 and self.other.size:
            true = angle_deg[self.other]
            inside = (self.other_deg[:, 0] <= true) & (true <= self.other_deg[:, 1])
            found[self.other[inside]] = True
        return np.asarray(found)

    def selected(self, places: IndexArray) -> "Decoded":
        """Select the readings with the given indices, in that order; no index may occur twice."""
        number = np.full(len(self.angle_deg), -1, dtype=np.intp)
        number[places] = np.arange(len(places))
        kept = number[self.other] >= 0
        fields = {name: getattr(self, name) for name in Decoded.__dataclass_fields__}
        found = {name: value[kept if name.startswith("other") else places] for name, value in fields.items()}
        return Decoded(**(found | {"other": number[found["other"]]}))


@dataclass(frozen=True, eq=False)
class _Metric:
    """Distance of voltages from each straight segment, for the receivers that are not clipped.

    The product of (V_left, V_right, 1) with `along` is the position along a segment (0 to 1 within it); the product
    with `aside` is the distance from the segment's line, in units of the covariance. `square` is the squared length of
    the segment.
    """

    along: FloatArray  # (3, 2 k): all rising pieces, then all falling ones
    aside: FloatArray  # (3, 2 k)
    square: FloatArray  # (2 k,)
    constant: FloatArray  # (k,), minus half the logarithm of the determinant
    size: int
    tops: FloatArray  # log-likelihoods, ascending, and for each the largest squared distance that is not negligible
    reach: FloatArray


class Decoder:
    """Decoder of voltages, prepared from a calibration.

    Parameters
    ----------
    calibration
        Calibration of the sensor.
    gain_percent
        Standard deviation of a common gain factor of the light, e.g. from an emitter that ages or warms up.
    dark_V
        Voltage without light, which the gain factor does not change.

    Raises
    ------
    DataError
        If the calibration is not for a single sensor; `solen.analysis.network.load_network` loads network calibrations.
    """

    def __init__(self, calibration: Calibration, *, gain_percent: float = 0.0, dark_V: float = 0.0) -> None:
        if not isinstance(calibration, Calibration):
            limit = (
                "is not the calibration of a sensor, as returned by "
                "solen.analysis.calibration.file.load(FILE).calibration"
            )
            remedy = "decode all motions of a network with solen.analysis.network.load_network(FILE).decoder"
            raise DataError("Decoder", value=type(calibration).__name__, limit=limit, remedy=remedy)
        self.calibration = calibration = calibration.widened()
        total, freedom = calibration.t_distribution()
        if gain_percent:
            light = calibration.curves_V.mean(axis=0) - dark_V
            total = total + (0.01 * gain_percent) ** 2 * light[:, :, None] * light[:, None, :]
        self.nodes_deg = _nodes(calibration, total)
        curves = at_angles(calibration.angle_deg, calibration.curves_V, self.nodes_deg)
        self._start, self._step = curves[:, :-1], np.diff(curves, axis=1)
        middle = 0.5 * (self.nodes_deg[1:] + self.nodes_deg[:-1])
        self._covariance = _between_points(calibration.angle_deg, total, middle)
        self._freedom = np.interp(middle, calibration.angle_deg, freedom)
        self._width = float(self.nodes_deg[1] - self.nodes_deg[0])
        self._limit = 2.0 * np.asarray(f_distribution.isf(OUTSIDE, 2, np.minimum(self._freedom, 1e6)))
        self._metrics: dict[tuple[bool, bool], _Metric] = {}
        self._noise_deg = self._reading_noise(calibration)

    @property
    def pieces(self) -> int:
        """Number of straight segments of the curve."""
        return int(self._freedom.size)

    @property
    def range_deg(self) -> tuple[float, float]:
        """Ends of the calibrated range."""
        return float(self.nodes_deg[0]), float(self.nodes_deg[-1])

    def noise_deg(self, angle_deg: FloatArray) -> FloatArray:
        """Return the standard deviation of an angle due to the noise of a single reading, (n,)."""
        return np.asarray(np.interp(angle_deg, self.nodes_deg[1:], self._noise_deg))

    def decode(self, volts: FloatArray, clipped: NDArray[np.int8] | None = None) -> Decoded:
        """Decode readings into angles.

        Parameters
        ----------
        volts
            Left and right voltages, (n, 2), finite.
        clipped
            1 for readings at the upper limit of the recorder, −1 at the lower limit, otherwise 0, (n, 2).
        """
        marks = np.zeros(volts.shape, dtype=np.int8) if clipped is None else clipped
        parts = [
            self._some(volts[begin : begin + _AT_ONCE], marks[begin : begin + _AT_ONCE])
            for begin in range(0, max(len(volts), 1), _AT_ONCE)
        ]
        return _joined(parts)

    def _some(self, volts: FloatArray, marks: NDArray[np.int8]) -> Decoded:
        """Decode readings, grouped by which receivers are clipped."""
        if not marks.any():
            return self._alike(volts, (0, 0))
        kinds, kind = np.unique(marks, axis=0, return_inverse=True)
        kind = kind.reshape(-1)
        rows = [np.flatnonzero(kind == number) for number in range(len(kinds))]
        parts = [self._alike(volts[row], (int(k[0]), int(k[1]))) for row, k in zip(rows, kinds, strict=True)]
        return _joined(parts).selected(np.argsort(np.concatenate(rows)))

    def _metric(self, marks: tuple[int, int]) -> _Metric:
        """Return the linear forms of the receivers that are not clipped."""
        key = (marks[0] == 0, marks[1] == 0)
        if key not in self._metrics:
            self._metrics[key] = self._new_metric(np.flatnonzero(key))
        return self._metrics[key]

    def _new_metric(self, kept: IndexArray) -> _Metric:
        whiten, constant = np.zeros((self.pieces, 2, 2)), np.zeros(self.pieces)
        if kept.size:
            root = np.linalg.cholesky(self._covariance[:, kept[:, None], kept])
            whiten[:, : kept.size, kept] = np.linalg.inv(root)
            constant = -np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        step = np.einsum("kij,dkj->dki", whiten, self._step)
        step[(step**2).sum(axis=-1) < _SHORT**2] = [_SHORT, 0.0]
        square = (step**2).sum(axis=-1)
        across = np.stack([-step[..., 1], step[..., 0]], axis=-1) / np.sqrt(square)[..., None]
        along, aside = (self._form(one, whiten) for one in (step / square[..., None], across))
        tops = np.linspace(constant.min() - _MAX_LOG_DROP, constant.max(), 400)
        allowed = [self._allowed(np.array([top]), slice(None), constant, kept.size).max() for top in tops.tolist()]
        return _Metric(along, aside, square.ravel(), constant, int(kept.size), tops, np.array(allowed))

    def _form(self, direction: FloatArray, whiten: FloatArray) -> FloatArray:
        """Return the component of the whitened voltages from each segment's start along a direction, as a linear form (3, 2 k)."""
        slope = np.einsum("dki,kij->dkj", direction, whiten)
        level = -(slope * self._start).sum(axis=-1, keepdims=True)
        return np.ascontiguousarray(np.concatenate([slope, level], axis=-1).reshape(-1, 3).T)

    def _allowed(self, top: FloatArray, piece: slice | IndexArray, constant: FloatArray, size: int) -> FloatArray:
        """Return the squared distance beyond which the likelihood is negligible."""
        freedom = self._freedom[piece]
        most = np.minimum(2.0 * (constant[piece] - top + _DROP) / (freedom + size), 500.0)
        return np.asarray(freedom * np.expm1(most))

    def _alike(self, volts: FloatArray, marks: tuple[int, int]) -> Decoded:
        metric = self._metric(marks)
        row, place, along, distance = self._near(volts, metric, all_of_it=any(marks))
        piece = place % self.pieces
        best = metric.constant[piece] + self._log_likelihood(distance, piece, metric.size)
        if any(marks):
            best = best + self._log_clipping(volts[row], self._point(place, along), piece, marks)
        top = np.full(len(volts), -np.inf)
        np.maximum.at(top, row, best)
        kept = best >= top[row] - _DROP
        row, place, along, distance, best = row[kept], place[kept], along[kept], distance[kept], best[kept]
        first = best == top[row]
        nearest, limit = np.zeros(len(volts)), np.zeros(len(volts))
        nearest[row[first]], limit[row[first]] = distance[first], self._limit[place[first] % self.pieces]
        return self._decoded(
            volts, marks, metric, self._intervals(row, place, along, distance, top, metric), nearest, limit
        )

    def _near(
        self, volts: FloatArray, metric: _Metric, *, all_of_it: bool
    ) -> tuple[IndexArray, IndexArray, FloatArray, FloatArray]:
        """Return the pairs of a reading and a nearby segment, with the position along the segment and the squared distance."""
        three = np.column_stack([volts, np.ones(len(volts))])
        along = three @ metric.along
        distance = three @ metric.aside
        distance *= distance
        over = along - np.clip(along, 0.0, 1.0)
        over *= over
        over *= metric.square
        distance += over
        if all_of_it:
            row, place = np.divmod(np.arange(distance.size), distance.shape[1])
            return row, place, along.ravel(), distance.ravel()
        least = distance.argmin(axis=1)
        piece = least % self.pieces
        top = metric.constant[piece] + self._log_likelihood(distance[np.arange(len(volts)), least], piece, metric.size)
        below = np.maximum(np.searchsorted(metric.tops, top, side="right") - 1, 0)
        reach = np.where(top < metric.tops[0], np.inf, metric.reach[below])
        row, place = np.nonzero(distance <= reach[:, None])
        return row, place, along[row, place], distance[row, place]

    def _log_likelihood(self, distance: FloatArray, piece: IndexArray, size: int) -> FloatArray:
        """Return the logarithm of the t distribution, without the constant."""
        freedom = self._freedom[piece]
        return np.asarray(-0.5 * (freedom + size) * np.log1p(distance / freedom))

    def _point(self, place: IndexArray, along: FloatArray) -> FloatArray:
        """Return the voltages of the curve at positions along its segments, (..., 2)."""
        start, step = self._start.reshape(-1, 2)[place], self._step.reshape(-1, 2)[place]
        return np.asarray(start + np.clip(along, 0.0, 1.0)[..., None] * step)

    def _log_clipping(
        self, volts: FloatArray, curve: FloatArray, piece: IndexArray, marks: tuple[int, int]
    ) -> FloatArray:
        """Return the log-probability that clipped receivers would read their limit."""
        found = np.zeros(piece.shape)
        for place, mark in enumerate(marks):
            if mark:
                sd = np.sqrt(self._covariance[piece, place, place])
                found = found + log_ndtr(mark * (curve[..., place] - volts[..., place]) / sd)
        return found

    def _intervals(
        self,
        row: IndexArray,
        place: IndexArray,
        along: FloatArray,
        distance: FloatArray,
        top: FloatArray,
        metric: _Metric,
    ) -> tuple[IndexArray, FloatArray, FloatArray]:
        """Return the angle intervals whose likelihood is not far below the maximum: reading index, and limits in degrees."""
        piece, square = place % self.pieces, metric.square[place]
        over = along - np.clip(along, 0.0, 1.0)
        allowed = self._allowed(top[row], piece, metric.constant, metric.size)
        half = np.sqrt(np.maximum(allowed - (distance - square * over * over), 0.0) / square)
        low, high = piece + np.clip(along - half, 0.0, 1.0), piece + np.clip(along + half, 0.0, 1.0)
        key = row * (self.pieces + 2) + piece  # pieces of one interval have neighbouring keys, for both directions
        order = np.argsort(key, kind="stable")
        begins = np.flatnonzero(np.diff(key[order], prepend=-2) > 1)
        lows, highs = np.minimum.reduceat(low[order], begins), np.maximum.reduceat(high[order], begins)
        first, last = self.range_deg
        lows, highs = first + (lows - _TINY) * self._width, first + (highs + _TINY) * self._width
        highs = np.where(highs > last - _TINY * self._width, last, highs)
        return row[order][begins], np.maximum(lows, first), highs

    def _decoded(
        self,
        volts: FloatArray,
        marks: tuple[int, int],
        metric: _Metric,
        intervals: tuple[IndexArray, FloatArray, FloatArray],
        distance: FloatArray,
        limit: FloatArray,
    ) -> Decoded:
        row, low, high = intervals
        grid = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _POINTS)
        density = self._density(volts, row, grid, marks, metric)
        mass = (density.sum(axis=1) - 0.5 * (density[:, 0] + density[:, -1])) * (high - low)  # trapezoidal rule
        share = mass / np.bincount(row, mass, len(volts))[row]
        lowest, upmost = _bands(density, grid)
        median = _median(density, grid)
        right = (density * (grid < 0.0)).sum(axis=1) / density.sum(axis=1)
        order = np.lexsort((share, row))
        main = order[np.flatnonzero(np.diff(row[order], append=-1) != 0)]
        others = np.flatnonzero((share >= _COUNTS) & ~np.isin(np.arange(row.size), main))
        ends = self.range_deg
        near = 0.51 * (high - low)[main] / _POINTS
        at_end = (lowest[main, 1] <= ends[0] + near) | (upmost[main, 1] >= ends[1] - near)
        return Decoded(
            angle_deg=median[main],
            low_deg=lowest[main],
            high_deg=upmost[main],
            probability=share[main],
            right=np.clip(np.bincount(row, share * right, len(volts)), 0.0, 1.0),
            distance=distance,
            outside=distance > limit,
            ambiguous=share[main] < 1.0 - _SURE,
            clipped=np.full(len(volts), any(marks)),
            at_end=at_end,
            other=row[others].astype(np.intp),
            other_deg=np.column_stack([lowest[others, 1], upmost[others, 1]]),
            other_probability=share[others],
        )

    def _density(
        self, volts: FloatArray, row: IndexArray, angle_deg: FloatArray, marks: tuple[int, int], metric: _Metric
    ) -> FloatArray:
        """Return the likelihood at angles (m, p) for the readings ``row`` (m,), relative to the maximum of each reading."""
        where = (angle_deg - self.nodes_deg[0]) / self._width
        piece = np.clip(where.astype(np.intp), 0, self.pieces - 1)
        held = where - piece
        freedom, constant = self._freedom[piece], metric.constant[piece]
        three = np.column_stack([volts, np.ones(len(volts))])[row].T[..., None]
        both = []
        for way in range(2):
            place = piece + way * self.pieces
            distance = (np.take(metric.aside, place, axis=1) * three).sum(axis=0)
            distance *= distance
            over = (np.take(metric.along, place, axis=1) * three).sum(axis=0) - held
            distance += metric.square[place] * over * over
            law = constant - 0.5 * (freedom + metric.size) * np.log1p(distance / freedom)
            if any(marks):
                law += self._log_clipping(volts[row][:, None], self._point(place, held), piece, marks)
            both.append(law)
        highest = np.full(len(volts), -np.inf)
        np.maximum.at(highest, row, np.maximum(both[0].max(axis=1), both[1].max(axis=1)))
        return np.asarray(sum(np.exp(law - highest[row, None]) for law in both))

    def _reading_noise(self, calibration: Calibration) -> FloatArray:
        """Return the standard deviation of the decoded angle due to noise alone, for each segment."""
        middle = 0.5 * (self.nodes_deg[1:] + self.nodes_deg[:-1])
        slope = self._step.mean(axis=0) / self._width
        toward = np.linalg.solve(self._covariance, slope[..., None])[..., 0]
        size = np.maximum((toward * slope).sum(axis=-1), 1e-300)
        noise = _between_points(calibration.angle_deg, calibration.noise, middle)
        return np.asarray(np.sqrt(np.einsum("ki,kij,kj->k", toward, noise, toward)) / size)


def _nodes(calibration: Calibration, total: FloatArray) -> FloatArray:
    """Return the angles between which the curve is straight to within the tolerance."""
    bend = np.abs(np.diff(calibration.curves_V, 2, axis=1)) / 8.0
    sd = np.sqrt(np.diagonal(total, axis1=1, axis2=2))[1:-1]
    most = float(np.max(bend / (_FLAT * sd)))
    grid = calibration.angle_deg
    parts = int(np.clip(math.ceil(math.sqrt(most)), 1, max(1, _MAX_PIECES // (grid.size - 1))))
    return np.linspace(grid[0], grid[-1], parts * (grid.size - 1) + 1)


def _between_points(grid: FloatArray, matrices: FloatArray, where: FloatArray) -> FloatArray:
    """Return the matrices (g, 2, 2) at other angles, interpolated linearly."""
    place = np.clip(np.searchsorted(grid, where) - 1, 0, grid.size - 2)
    share = ((where - grid[place]) / (grid[place + 1] - grid[place]))[:, None, None]
    return np.asarray((1.0 - share) * matrices[place] + share * matrices[place + 1])


def _bands(density: FloatArray, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the limits of the shortest band at each level, (m, 2): where the density crosses the enclosing height."""
    ordered = -np.sort(-density, axis=1)
    total = np.cumsum(ordered, axis=1) - 0.5 * ordered
    rows, last = np.arange(len(density)), density.shape[1] - 1
    lows, highs = [], []
    for level in LEVELS:
        wanted = level * (total[:, -1] + 0.5 * ordered[:, -1])
        count = np.clip((total < wanted[:, None]).sum(axis=1), 1, last)
        share = (wanted - total[rows, count - 1]) / np.maximum(total[rows, count] - total[rows, count - 1], 1e-300)
        upper, lower = ordered[rows, count - 1], ordered[rows, count]
        height = upper - np.clip(share, 0.0, 1.0) * (upper - lower)
        above = density >= height[:, None]
        lows.append(_crossing(density, grid, above.argmax(axis=1), -1, height))
        highs.append(_crossing(density, grid, last - above[:, ::-1].argmax(axis=1), 1, height))
    return np.column_stack(lows), np.column_stack(highs)


def _crossing(density: FloatArray, grid: FloatArray, place: IndexArray, side: int, height: FloatArray) -> FloatArray:
    """Return the angle beyond the outermost point above a height at which the density falls below it, or the end of the grid."""
    rows = np.arange(len(grid))
    beyond = np.clip(place + side, 0, grid.shape[1] - 1)
    inner, outer = density[rows, place], density[rows, beyond]
    share = np.clip((inner - height) / np.maximum(inner - outer, 1e-300), 0.0, 1.0)
    return np.asarray(grid[rows, place] + share * (grid[rows, beyond] - grid[rows, place]))


def _median(density: FloatArray, grid: FloatArray) -> FloatArray:
    total = np.cumsum(density, axis=1) - 0.5 * density
    half = 0.5 * density.sum(axis=1)
    place = np.clip((total < half[:, None]).sum(axis=1), 1, grid.shape[1] - 1)
    rows = np.arange(len(grid))
    below, above = total[rows, place - 1], total[rows, place]
    share = np.clip((half - below) / np.maximum(above - below, 1e-300), 0.0, 1.0)
    return np.asarray(grid[rows, place - 1] + share * (grid[rows, place] - grid[rows, place - 1]))


def _joined(parts: list[Decoded]) -> Decoded:
    """Concatenate parts."""
    if len(parts) == 1:
        return parts[0]
    offsets = np.cumsum([0, *(len(part.angle_deg) for part in parts[:-1])])
    other = [part.other + offset for part, offset in zip(parts, offsets, strict=True)]
    return replace(joined_rows(parts), other=np.concatenate(other))
