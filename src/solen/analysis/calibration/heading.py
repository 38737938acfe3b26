"""Heading of a stream of angles, rising or falling, from the last few angles.

A least-squares line is fitted to the angles in a short window that ends at each angle. The standard deviation of its
slope includes only the noise of a reading, because errors that are constant over a cycle shift all angles alike. The
probability that the slope is positive follows from a normal distribution; if the angle is not clearly rising or
falling, it has no heading.

`Tracker` accepts angles in batches of any size, and returns `Headings`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from solen.arrays import FloatArray

WINDOW_S = 0.05
_MIN_PROBABILITY = 0.975
_MIN_POINTS = 3


@dataclass(frozen=True, eq=False)
class Headings:
    """Slope (deg/s) and probability that the angle is rising, both (n,); NaN and 0.5 if there are too few angles."""

    slope_deg_per_s: FloatArray
    rises: FloatArray

    def labels(self) -> list[str]:
        """Return ``rising``, ``falling`` or an empty string for each angle."""
        labels = np.where(self.rises <= 1.0 - _MIN_PROBABILITY, "falling", "")
        return list(np.where(self.rises >= _MIN_PROBABILITY, "rising", labels).tolist())


class Tracker:
    """Headings of a stream of angles, of which the last window is kept."""

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s
        self._kept = np.zeros((0, 3))

    def of(self, time_s: FloatArray, angle_deg: FloatArray, noise_deg: FloatArray) -> Headings:
        """Return the headings at the next angles of the stream, (n,), in time order; if time jumps back, start anew."""
        if len(time_s) and len(self._kept) and time_s[0] < self._kept[-1, 0]:  # the clock was reset
            self._kept = self._kept[:0]
        rows = np.vstack([self._kept, np.column_stack([time_s, angle_deg, noise_deg])])
        start = len(rows) - len(time_s)
        first = np.searchsorted(rows[:, 0], rows[start:, 0] - self._window_s * (1.0 + 1e-9))
        last = np.arange(start, len(rows)) + 1
        if len(rows):
            self._kept = rows[np.searchsorted(rows[:, 0], rows[-1, 0] - self._window_s) :]
        t, y = (rows[:, 0] - rows[0, 0], rows[:, 1] - rows[0, 1]) if len(rows) else (rows[:, 0], rows[:, 1])
        sums = np.vstack([np.zeros(5), np.cumsum(np.column_stack([t, y, t * t, t * y, rows[:, 2] ** 2]), axis=0)])
        n = (last - first).astype(float)
        st, sy, stt, sty, variance = (sums[last] - sums[first]).T
        spread = stt - st * st / n
        enough = (n >= _MIN_POINTS) & (spread > 1e-12)
        with np.errstate(invalid="ignore", divide="ignore"):
            slope = np.where(enough, (sty - st * sy / n) / spread, np.nan)
            u = np.sqrt(variance / n / spread)
            rises = np.where(enough, ndtr(slope / np.maximum(u, 1e-300)), 0.5)
        return Headings(np.asarray(slope), np.asarray(rises))
