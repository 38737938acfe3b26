"""The board's clock on the run's clock: a period has certainly ended when its frame arrives.

The board stamps its periods with its own clock, which runs a little fast or slow and began at another moment. A frame
that arrives at a given time was sent earlier, by an unknown delay that is never negative and sometimes nearly zero. The
line below all points (board's time, time of arrival) that is nearest to them therefore is the board's clock on the
run's clock, except for the least delay: it is an edge of the points' lower convex hull. In a short run the slope of the
edge depends more on the delays than on the clocks; it is weighted against the known accuracy of quartzes.

Received messages alone do not show the least delay. An exchange tells more: the instrument read its clock after it was
asked and before its answer arrived. The range that all exchanges allow is the bound of the line's error.

`fit_clock` returns the line of one segment without a break.
"""

from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray

MIN_SPAN_S = 5.0
"""Below this span in s, delays hide the rate, and the two clocks are assumed to run at the same rate."""
MAX_PPM = 1000.0
"""Largest relative error of a quartz in ppm."""
USUAL_PPM = 50.0
"""Usual relative error of a quartz in ppm."""


@dataclass(frozen=True)
class ClockLine:
    """Time of the run = ``begin_s`` + ``rate`` × the board's time in s.

    Attributes
    ----------
    begin_s, rate
        Offset and rate.
    delay_s
        Median delay of arrivals beyond the shortest delay.
    bound_s
        Bound on the error of the fit in either direction; None without exchanges.
    """

    begin_s: float
    rate: float
    delay_s: float
    bound_s: float | None = None

    def at(self, board_s: FloatArray) -> FloatArray:
        """Convert times of the board to times of the run."""
        return np.asarray(self.begin_s + self.rate * board_s)


def fit_clock(board_s: FloatArray, came_s: FloatArray, exchanges: FloatArray | None = None) -> ClockLine:
    """Fit the line between times of the board and times of arrival in the run; both are ascending.

    Parameters
    ----------
    board_s, came_s
        Times of the board, and of their arrival in the run, (N,).
    exchanges
        Time of the run when the board was asked for its time, time of the run when its answer arrived, and the board's
        time in the answer, in s, (K, 3); NaN if the board did not state its time.
    """
    rate = 1.0
    if len(board_s) > 2 and board_s[-1] - board_s[0] >= MIN_SPAN_S:
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
    """Return the line midway between the bounds from the exchanges; received messages are a further upper bound.

    If no answer contains a time, the shortest round trip bounds the minimum message delay.
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
    """Return the rate from a hull edge of the specified length, weighted against the accuracy of a quartz.

    The weight depends on how far delays can tilt the edge.
    """
    u_ppm = 1e6 * float(np.median(delay) - delay.min()) / (np.sqrt(len(delay)) * edge_s)
    off = float(np.clip(rate - 1.0, -1e-6 * MAX_PPM, 1e-6 * MAX_PPM))
    return float(1.0 + off * USUAL_PPM**2 / (USUAL_PPM**2 + u_ppm**2))


def _below(x: FloatArray, y: FloatArray) -> list[int]:
    """Return the indices of the corners of the lower convex hull of points with ascending x."""
    hull: list[int] = []
    for place in range(len(x)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            if (x[b] - x[a]) * (y[place] - y[a]) > (y[b] - y[a]) * (x[place] - x[a]):
                break
            hull.pop()
        hull.append(place)
    return hull
