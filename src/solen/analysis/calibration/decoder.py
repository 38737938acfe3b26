"""Decoding of voltages into angles with a calibration: the likelihood over all angles, and its credible bands.

Between neighbouring points the curve is straight in the plane of the two voltages, so that the nearest angle of each
segment has a closed form. Segments whose largest likelihood is far below the maximum are ignored; the others form
intervals of adjoining angles. In each interval, however narrow, the likelihood is evaluated on a separate fine grid. It
is a t distribution about the rising and about the falling curve, each with weight one half. The prior is uniform over
the calibrated range. The probability of an interval is its fraction of the total, and its 68 or 95 % band is the
shortest band that contains this part of it. If no interval has a probability of 95 %, the reading is ambiguous; all
intervals with a probability of at least 1 % are reported.

If a receiver is clipped, its reading shows only that the true voltage is at or outside the limit.

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
MIN_TAIL_PROBABILITY = 1e-3
"""A reading is off the curve if the probability of a larger distance from the curve is below this value."""
_MAX_DROP = 8.0  # largest difference from the maximum log-likelihood that is not negligible
_POINTS = 64  # number of points of the grid of an interval
_BATCH = 512  # readings
_MAX_PIECES = 4000
_MAX_SAGITTA = 0.1  # largest distance of the curve from its straight pieces, in standard deviations
_MIN_PROBABILITY = 0.01  # smallest probability of an interval that is reported
_MARGIN = 1e-6  # margin at the ends of an interval, as a fraction of a piece
_MIN_LENGTH = 1e-9  # smallest length of a piece, in standard deviations
_MAX_LOG_DROP = 200.0  # a reading whose log-likelihood is lower by more is compared with all segments


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
        Whether the band reaches an end of the calibrated range, so that the angle may be outside it.
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
        contained = (self.low_deg[:, level] <= angle_deg) & (angle_deg <= self.high_deg[:, level])
        if level == len(LEVELS) - 1 and self.other.size:
            true = angle_deg[self.other]
            inside = (self.other_deg[:, 0] <= true) & (true <= self.other_deg[:, 1])
            contained[self.other[inside]] = True
        return np.asarray(contained)

    def selected(self, indices: IndexArray) -> "Decoded":
        """Select the readings with the given indices, in that order; no index may occur twice."""
        new_index = np.full(len(self.angle_deg), -1, dtype=np.intp)
        new_index[indices] = np.arange(len(indices))
        kept = new_index[self.other] >= 0
        fields = {name: getattr(self, name) for name in Decoded.__dataclass_fields__}
        rows = {name: value[kept if name.startswith("other") else indices] for name, value in fields.items()}
        return Decoded(**(rows | {"other": new_index[rows["other"]]}))


@dataclass(frozen=True, eq=False)
class _Metric:
    """Distance of voltages from each straight segment, for the receivers that are not clipped.

    There are k pieces of the range of angles, and 2 k segments: those of the rising curve, then those of the falling
    curve. The product of (V_left, V_right, 1) with `along` is the position along a segment (0 to 1 within it); the
    product with `aside` is the distance from the segment's line, in units of the covariance.
    """

    along: FloatArray  # (3, 2 k)
    aside: FloatArray  # (3, 2 k)
    square: FloatArray  # squared length of each segment, (2 k,)
    constant: FloatArray  # minus half the logarithm of the determinant, (k,)
    size: int  # number of receivers
    tops: FloatArray  # maximum log-likelihoods of a reading, ascending
    reach: FloatArray  # for each of them, the largest squared distance that is not negligible


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
            limit = "is not the calibration of a single sensor"
            remedy = (
                "pass solen.analysis.calibration.file.load(FILE).calibration, or decode a network with "
                "solen.analysis.network.load_network(FILE).decoder"
            )
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
        self._limit = 2.0 * np.asarray(f_distribution.isf(MIN_TAIL_PROBABILITY, 2, np.minimum(self._freedom, 1e6)))
        self._metrics: dict[tuple[bool, bool], _Metric] = {}
        self._noise_deg = self._angle_noise(calibration)

    @property
    def pieces(self) -> int:
        """Number of pieces of the range in which the curve is approximated by straight lines."""
        return int(self._freedom.size)

    @property
    def range_deg(self) -> tuple[float, float]:
        """Ends of the calibrated range."""
        return float(self.nodes_deg[0]), float(self.nodes_deg[-1])

    def noise_deg(self, angle_deg: FloatArray) -> FloatArray:
        """Return the standard deviation (n,) of angles decoded near ``angle_deg`` (n,), from the noise of a reading."""
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
        batches = [slice(begin, begin + _BATCH) for begin in range(0, max(len(volts), 1), _BATCH)]
        return _joined([self._decode_batch(volts[batch], marks[batch]) for batch in batches])

    def _decode_batch(self, volts: FloatArray, marks: NDArray[np.int8]) -> Decoded:
        """Decode readings, grouped by which receivers are clipped."""
        if not marks.any():
            return self._decode_group(volts, (0, 0))
        kinds, kind = np.unique(marks, axis=0, return_inverse=True)
        kind = kind.reshape(-1)
        rows = [np.flatnonzero(kind == number) for number in range(len(kinds))]
        parts = [self._decode_group(volts[row], (int(k[0]), int(k[1]))) for row, k in zip(rows, kinds, strict=True)]
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
        step[(step**2).sum(axis=-1) < _MIN_LENGTH**2] = [_MIN_LENGTH, 0.0]
        square = (step**2).sum(axis=-1)
        normal = np.stack([-step[..., 1], step[..., 0]], axis=-1) / np.sqrt(square)[..., None]
        along, aside = (self._form(direction, whiten) for direction in (step / square[..., None], normal))
        tops = np.linspace(constant.min() - _MAX_LOG_DROP, constant.max(), 400)
        allowed = [self._allowed(np.array([top]), slice(None), constant, kept.size).max() for top in tops.tolist()]
        return _Metric(along, aside, square.ravel(), constant, int(kept.size), tops, np.array(allowed))

    def _form(self, direction: FloatArray, whiten: FloatArray) -> FloatArray:
        """Return the linear forms (3, 2 k) that give the component along a direction, from each segment's start."""
        slope = np.einsum("dki,kij->dkj", direction, whiten)
        constant = -(slope * self._start).sum(axis=-1, keepdims=True)
        return np.ascontiguousarray(np.concatenate([slope, constant], axis=-1).reshape(-1, 3).T)

    def _allowed(self, top: FloatArray, piece: slice | IndexArray, constant: FloatArray, size: int) -> FloatArray:
        """Return the squared distance at which the likelihood becomes negligible."""
        freedom = self._freedom[piece]
        exponent = np.minimum(2.0 * (constant[piece] - top + _MAX_DROP) / (freedom + size), 500.0)
        return np.asarray(freedom * np.expm1(exponent))

    def _decode_group(self, volts: FloatArray, marks: tuple[int, int]) -> Decoded:
        """Decode readings with the same marks."""
        metric = self._metric(marks)
        row, segment, along, distance = self._near(volts, metric, all_segments=any(marks))
        piece = segment % self.pieces
        best = metric.constant[piece] + self._log_likelihood(distance, piece, metric.size)
        if any(marks):
            best = best + self._log_clipping(volts[row], self._point(segment, along), piece, marks)
        top = np.full(len(volts), -np.inf)
        np.maximum.at(top, row, best)
        kept = best >= top[row] - _MAX_DROP
        row, segment, along, distance, best = row[kept], segment[kept], along[kept], distance[kept], best[kept]
        first = best == top[row]
        nearest, limit = np.zeros(len(volts)), np.zeros(len(volts))
        nearest[row[first]], limit[row[first]] = distance[first], self._limit[segment[first] % self.pieces]
        intervals = self._intervals(row, segment, along, distance, top, metric)
        return self._decoded(volts, marks, metric, intervals, nearest, limit)

    def _near(
        self, volts: FloatArray, metric: _Metric, *, all_segments: bool
    ) -> tuple[IndexArray, IndexArray, FloatArray, FloatArray]:
        """Return pairs of a reading and a nearby segment, with the position along it and the squared distance."""
        extended = np.column_stack([volts, np.ones(len(volts))])
        along = extended @ metric.along
        distance = extended @ metric.aside
        distance *= distance
        overshoot = along - np.clip(along, 0.0, 1.0)
        overshoot *= overshoot
        overshoot *= metric.square
        distance += overshoot
        if all_segments:
            row, segment = np.divmod(np.arange(distance.size), distance.shape[1])
            return row, segment, along.ravel(), distance.ravel()
        nearest = distance.argmin(axis=1)
        piece = nearest % self.pieces
        smallest = distance[np.arange(len(volts)), nearest]
        top = metric.constant[piece] + self._log_likelihood(smallest, piece, metric.size)
        below = np.maximum(np.searchsorted(metric.tops, top, side="right") - 1, 0)
        reach = np.where(top < metric.tops[0], np.inf, metric.reach[below])
        row, segment = np.nonzero(distance <= reach[:, None])
        return row, segment, along[row, segment], distance[row, segment]

    def _log_likelihood(self, distance: FloatArray, piece: IndexArray, size: int) -> FloatArray:
        """Return the logarithm of the t distribution, without the constant."""
        freedom = self._freedom[piece]
        return np.asarray(-0.5 * (freedom + size) * np.log1p(distance / freedom))

    def _point(self, segment: IndexArray, along: FloatArray) -> FloatArray:
        """Return the voltages at positions along segments, (..., 2)."""
        start, step = self._start.reshape(-1, 2)[segment], self._step.reshape(-1, 2)[segment]
        return np.asarray(start + np.clip(along, 0.0, 1.0)[..., None] * step)

    def _log_clipping(
        self, volts: FloatArray, curve: FloatArray, piece: IndexArray, marks: tuple[int, int]
    ) -> FloatArray:
        """Return the log-probability that the clipped receivers are at or outside their limits."""
        total = np.zeros(piece.shape)
        for receiver, mark in enumerate(marks):
            if mark:
                sd = np.sqrt(self._covariance[piece, receiver, receiver])
                total = total + log_ndtr(mark * (curve[..., receiver] - volts[..., receiver]) / sd)
        return total

    def _intervals(
        self,
        row: IndexArray,
        segment: IndexArray,
        along: FloatArray,
        distance: FloatArray,
        top: FloatArray,
        metric: _Metric,
    ) -> tuple[IndexArray, FloatArray, FloatArray]:
        """Return the intervals of angles with a likelihood that is not negligible: index of the reading, and limits."""
        piece, square = segment % self.pieces, metric.square[segment]
        overshoot = along - np.clip(along, 0.0, 1.0)
        allowed = self._allowed(top[row], piece, metric.constant, metric.size)
        half = np.sqrt(np.maximum(allowed - (distance - square * overshoot * overshoot), 0.0) / square)
        low, high = piece + np.clip(along - half, 0.0, 1.0), piece + np.clip(along + half, 0.0, 1.0)
        key = row * (self.pieces + 2) + piece  # the pieces of an interval have successive keys, in both directions
        order = np.argsort(key, kind="stable")
        begins = np.flatnonzero(np.diff(key[order], prepend=-2) > 1)
        lows, highs = np.minimum.reduceat(low[order], begins), np.maximum.reduceat(high[order], begins)
        first, last = self.range_deg
        lows, highs = first + (lows - _MARGIN) * self._width, first + (highs + _MARGIN) * self._width
        highs = np.where(highs > last - _MARGIN * self._width, last, highs)
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
        probability = mass / np.bincount(row, mass, len(volts))[row]
        band_low, band_high = _bands(density, grid)
        median = _median(density, grid)
        right = (density * (grid < 0.0)).sum(axis=1) / density.sum(axis=1)
        order = np.lexsort((probability, row))
        main = order[np.flatnonzero(np.diff(row[order], append=-1) != 0)]
        others = np.flatnonzero((probability >= _MIN_PROBABILITY) & ~np.isin(np.arange(row.size), main))
        first, last = self.range_deg
        half_step = 0.51 * (high - low)[main] / _POINTS
        at_end = (band_low[main, 1] <= first + half_step) | (band_high[main, 1] >= last - half_step)
        return Decoded(
            angle_deg=median[main],
            low_deg=band_low[main],
            high_deg=band_high[main],
            probability=probability[main],
            right=np.clip(np.bincount(row, probability * right, len(volts)), 0.0, 1.0),
            distance=distance,
            outside=distance > limit,
            ambiguous=probability[main] < LEVELS[1],
            clipped=np.full(len(volts), any(marks)),
            at_end=at_end,
            other=row[others].astype(np.intp),
            other_deg=np.column_stack([band_low[others, 1], band_high[others, 1]]),
            other_probability=probability[others],
        )

    def _density(
        self, volts: FloatArray, row: IndexArray, angle_deg: FloatArray, marks: tuple[int, int], metric: _Metric
    ) -> FloatArray:
        """Return the likelihood at angles (m, p) of the readings ``row`` (m,), relative to each reading's maximum."""
        position = (angle_deg - self.nodes_deg[0]) / self._width
        piece = np.clip(position.astype(np.intp), 0, self.pieces - 1)
        within = position - piece
        freedom, constant = self._freedom[piece], metric.constant[piece]
        extended = np.column_stack([volts, np.ones(len(volts))])[row].T[..., None]
        logs = []
        for segment in (piece, piece + self.pieces):
            distance = (np.take(metric.aside, segment, axis=1) * extended).sum(axis=0)
            distance *= distance
            along = (np.take(metric.along, segment, axis=1) * extended).sum(axis=0) - within
            distance += metric.square[segment] * along * along
            log = constant - 0.5 * (freedom + metric.size) * np.log1p(distance / freedom)
            if any(marks):
                log += self._log_clipping(volts[row][:, None], self._point(segment, within), piece, marks)
            logs.append(log)
        highest = np.full(len(volts), -np.inf)
        np.maximum.at(highest, row, np.maximum(*logs).max(axis=1))
        return np.asarray(sum(np.exp(log - highest[row, None]) for log in logs))

    def _angle_noise(self, calibration: Calibration) -> FloatArray:
        """Return the standard deviation of the decoded angle due to the noise of a reading, for each piece."""
        middle = 0.5 * (self.nodes_deg[1:] + self.nodes_deg[:-1])
        slope = self._step.mean(axis=0) / self._width
        weight = np.linalg.solve(self._covariance, slope[..., None])[..., 0]
        information = np.maximum((weight * slope).sum(axis=-1), 1e-300)
        noise = _between_points(calibration.angle_deg, calibration.noise, middle)
        return np.asarray(np.sqrt(np.einsum("ki,kij,kj->k", weight, noise, weight)) / information)


def _nodes(calibration: Calibration, total: FloatArray) -> FloatArray:
    """Return the angles between which the curve is straight to within the tolerance."""
    sagitta = np.abs(np.diff(calibration.curves_V, 2, axis=1)) / 8.0
    sd = np.sqrt(np.diagonal(total, axis1=1, axis2=2))[1:-1]
    ratio = float(np.max(sagitta / (_MAX_SAGITTA * sd)))
    grid = calibration.angle_deg
    parts = int(np.clip(math.ceil(math.sqrt(ratio)), 1, max(1, _MAX_PIECES // (grid.size - 1))))
    return np.linspace(grid[0], grid[-1], parts * (grid.size - 1) + 1)


def _between_points(grid: FloatArray, matrices: FloatArray, angle_deg: FloatArray) -> FloatArray:
    """Return matrices (g, 2, 2) at other angles, interpolated linearly."""
    node = np.clip(np.searchsorted(grid, angle_deg) - 1, 0, grid.size - 2)
    fraction = ((angle_deg - grid[node]) / (grid[node + 1] - grid[node]))[:, None, None]
    return np.asarray((1.0 - fraction) * matrices[node] + fraction * matrices[node + 1])


def _bands(density: FloatArray, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the limits (m, 2) of the shortest band at each level: where the density crosses a certain height."""
    ordered = -np.sort(-density, axis=1)
    total = np.cumsum(ordered, axis=1) - 0.5 * ordered
    rows, last = np.arange(len(density)), density.shape[1] - 1
    lows, highs = [], []
    for level in LEVELS:
        target = level * (total[:, -1] + 0.5 * ordered[:, -1])
        count = np.clip((total < target[:, None]).sum(axis=1), 1, last)
        below, above = total[rows, count - 1], total[rows, count]
        upper, lower = ordered[rows, count - 1], ordered[rows, count]
        height = upper - _fraction(target - below, above - below) * (upper - lower)
        inside = density >= height[:, None]
        lows.append(_crossing(density, grid, inside.argmax(axis=1), -1, height))
        highs.append(_crossing(density, grid, last - inside[:, ::-1].argmax(axis=1), 1, height))
    return np.column_stack(lows), np.column_stack(highs)


def _fraction(part: FloatArray, total: FloatArray) -> FloatArray:
    return np.clip(part / np.maximum(total, 1e-300), 0.0, 1.0)


def _crossing(density: FloatArray, grid: FloatArray, point: IndexArray, side: int, height: FloatArray) -> FloatArray:
    """Return the angle at which the density, past the outermost point above a height, falls to this height.

    If that point is an end of the grid, its angle is returned.
    """
    rows = np.arange(len(grid))
    following = np.clip(point + side, 0, grid.shape[1] - 1)
    inner, outer = density[rows, point], density[rows, following]
    fraction = _fraction(inner - height, inner - outer)
    return np.asarray(grid[rows, point] + fraction * (grid[rows, following] - grid[rows, point]))


def _median(density: FloatArray, grid: FloatArray) -> FloatArray:
    total = np.cumsum(density, axis=1) - 0.5 * density
    half = 0.5 * density.sum(axis=1)
    point = np.clip((total < half[:, None]).sum(axis=1), 1, grid.shape[1] - 1)
    rows = np.arange(len(grid))
    below, above = total[rows, point - 1], total[rows, point]
    fraction = _fraction(half - below, above - below)
    return np.asarray(grid[rows, point - 1] + fraction * (grid[rows, point] - grid[rows, point - 1]))


def _joined(parts: list[Decoded]) -> Decoded:
    """Concatenate the decoded angles of successive batches of readings."""
    if len(parts) == 1:
        return parts[0]
    offsets = np.cumsum([0, *(len(part.angle_deg) for part in parts[:-1])])
    other = [part.other + offset for part, offset in zip(parts, offsets, strict=True)]
    return replace(joined_rows(parts), other=np.concatenate(other))
