"""The board's clock on the run's: a period is known to be over when it has come, and never before.

The idea: the board stamps its periods by its own clock, which runs a little fast or slow and began at another moment.
What came at a time had been sent before it, by an unknown delay that is never negative and sometimes next to nothing.
So the line that lies below all points (board's time, time it came) and nearest to them is the board's clock on the
run's, but for the least delay: an edge of the points' lower convex hull. Of a short run the edge's slope says more of
the delays than of the clocks; it counts by what it is worth beside what is known of any quartz.

Received messages alone do not show the least delay. An exchange says more: the instrument read its clock after it was
asked and before its answer came. What all exchanges leave open is the line's bound.

The interface: `fit_clock` gives the line of one stretch without a break.
"""

from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray

LEAST_SPAN_S = 5.0
"""Over a shorter span delays hide the rate, and the two clocks are taken to run alike."""
MOST_PPM = 1000.0
"""Largest relative error of a quartz."""
USUAL_PPM = 50.0
"""Usual relative error of a quartz."""


@dataclass(frozen=True)
class ClockLine:
    """Time of the run = ``begin_s`` + ``rate`` × the board's time in s.

    Attributes
    ----------
    begin_s, rate
        Offset and rate.
    delay_s
        Median delay of arrivals beyond the shortest.
    bound_s
        Bound of the error of the fit, to either side; None without exchanges.
    """

    begin_s: float
    rate: float
    delay_s: float
    bound_s: float | None = None

    def at(self, board_s: FloatArray) -> FloatArray:
        """Time of the run at times of the board."""
        return np.asarray(self.begin_s + self.rate * board_s)


def fit_clock(board_s: FloatArray, came_s: FloatArray, exchanges: FloatArray | None = None) -> ClockLine:
    """Line of times of the board and the times of the run at which they had come; both ascending.

    Parameters
    ----------
    board_s, came_s
        Times of the board, and of the run, (N,).
    exchanges
        Time of the run when the board was asked for its time, time when its answer had come, and the board's time in
        it, in s, (K, 3); NaN for a board's time that it did not state.
    """
    rate = 1.0
    if len(board_s) > 2 and board_s[-1] - board_s[0] >= LEAST_SPAN_S:
        hull = _below(board_s, came_s)
        middle = 0.5 * (board_s[0] + board_s[-1])
        right = int(np.clip(np.searchsorted(board_s[hull], middle), 1, len(hull) - 1))
        a, b = hull[right - 1], hull[right]
        rate = float((came_s[b] - came_s[a]) / (board_s[b] - board_s[a]))
        rate = _credible(rate, came_s - rate * board_s, float(board_s[b] - board_s[a]))
    delay = came_s - rate * board_s
    begin = float(delay.min())
    line = ClockLine(begin, rate, float(np.median(delay) - begin))
    return line if exchanges is None or len(exchanges) == 0 else _between(line, exchanges)


def _between(line: ClockLine, exchanges: FloatArray) -> ClockLine:
    """The line midway between the bounds that the exchanges set; received messages bound it from above as well.

    An answer without a time bounds the least delay of what came by the shortest of all round trips.
    """
    asked_s, answered_s, board_s = exchanges.T
    low = line.begin_s - float((answered_s - asked_s).min())
    high = line.begin_s
    if (stated := np.isfinite(board_s)).any():
        low = float(np.max(asked_s[stated] - line.rate * board_s[stated]))
        high = min(high, float(np.min(answered_s[stated] - line.rate * board_s[stated])))
    begin = 0.5 * (low + high)
    return replace(line, begin_s=begin, delay_s=line.delay_s + line.begin_s - begin, bound_s=0.5 * abs(high - low))


def _credible(rate: float, delay: FloatArray, edge_s: float) -> float:
    """A rate by an edge so long, weighed against that of a quartz: what delays may turn the edge by."""
    u_ppm = 1e6 * float(np.median(delay) - delay.min()) / (np.sqrt(len(delay)) * edge_s)
    off = float(np.clip(rate - 1.0, -1e-6 * MOST_PPM, 1e-6 * MOST_PPM))
    return float(1.0 + off * USUAL_PPM**2 / (USUAL_PPM**2 + u_ppm**2))


def _below(x: FloatArray, y: FloatArray) -> list[int]:
    """Indices of the corners of the lower convex hull of points with ascending x."""
    hull: list[int] = []
    for place in range(len(x)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            if (x[b] - x[a]) * (y[place] - y[a]) > (y[b] - y[a]) * (x[place] - x[a]):
                break
            hull.pop()
        hull.append(place)
    return hull
