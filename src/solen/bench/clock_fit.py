"""Conversion of the board's times to the run's clock: a period has certainly ended when its frame arrives.

The board stamps its periods with its own clock, which runs a little fast or slow and has another origin. A frame was
sent before it arrived, by an unknown delay that is never negative and sometimes nearly zero. Of all lines below the
points (board's time, time of arrival), the nearest is therefore the board's clock on the run's clock, except for the
shortest delay. This line extends an edge of the points' lower convex hull. In a short run the slope of the edge depends
more on the delays than on the clocks; it is therefore weighted against the usual accuracy of quartz clocks.

Arrivals alone do not determine the shortest delay. An exchange, a query of the instrument's clock and its reply, bounds
it: the instrument read its clock after the query was sent and before the reply arrived. Half the range that all
exchanges allow is the bound on the error of the line.

`fit_clock` returns the line of one segment without a gap.
"""

from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray

MIN_SPAN_S = 5.0
"""Span in s below which delays hide the rate; the two clocks are then assumed to run at the same rate."""
MAX_PPM = 1000.0
"""Largest relative error of a quartz clock in ppm."""
USUAL_PPM = 50.0
"""Usual relative error of a quartz clock in ppm."""


@dataclass(frozen=True)
class ClockLine:
    """Time of the run = ``begin_s`` + ``rate`` × the board's time in s.

    Attributes
    ----------
    begin_s, rate
        Offset and rate.
    delay_s
        Median delay of the arrivals with respect to this line.
    bound_s
        Bound on the error of this line in either direction; None without exchanges.
    """

    begin_s: float
    rate: float
    delay_s: float
    bound_s: float | None = None

    def at(self, board_s: FloatArray) -> FloatArray:
        """Convert times of the board to times of the run."""
        return np.asarray(self.begin_s + self.rate * board_s)


def fit_clock(board_s: FloatArray, arrival_s: FloatArray, exchanges: FloatArray | None = None) -> ClockLine:
    """Fit the run's clock as a line in the board's clock.

    Parameters
    ----------
    board_s, arrival_s
        Times by the board's clock at which messages were sent, and times by the run's clock at which they arrived,
        (N,), in ascending order.
    exchanges
        Times by the run's clock at which a query was sent and its reply arrived, and the time by the board's clock in
        the reply, in s, (K, 3); NaN if the reply contains no time.
    """
    rate = 1.0
    if len(board_s) > 2 and board_s[-1] - board_s[0] >= MIN_SPAN_S:
        hull = _lower_hull(board_s, arrival_s)
        middle = 0.5 * (board_s[0] + board_s[-1])
        edge = int(np.clip(np.searchsorted(board_s[hull], middle), 1, len(hull) - 1))
        a, b = hull[edge - 1], hull[edge]
        rate = float((arrival_s[b] - arrival_s[a]) / (board_s[b] - board_s[a]))
        rate = _weighted(rate, arrival_s - rate * board_s, float(board_s[b] - board_s[a]))
    delay = arrival_s - rate * board_s
    begin = float(delay.min())
    line = ClockLine(begin, rate, float(np.median(delay) - begin))
    return line if exchanges is None or len(exchanges) == 0 else _bounded(line, exchanges)


def _bounded(line: ClockLine, exchanges: FloatArray) -> ClockLine:
    """Return the line midway between the bounds from the exchanges; arrivals are a further upper bound.

    If no reply contains a time, the shortest round trip bounds the shortest delay.
    """
    sent_s, reply_s, board_s = exchanges.T
    low = line.begin_s - float((reply_s - sent_s).min())
    high = line.begin_s
    if (known := np.isfinite(board_s)).any():
        low = float(np.max(sent_s[known] - line.rate * board_s[known]))
        high = min(high, float(np.min(reply_s[known] - line.rate * board_s[known])))
    begin = 0.5 * (low + high)
    return replace(line, begin_s=begin, delay_s=line.delay_s + line.begin_s - begin, bound_s=0.5 * abs(high - low))


def _weighted(rate: float, delay: FloatArray, edge_s: float) -> float:
    """Return the rate from a hull edge of a given duration, weighted against the usual accuracy of a quartz clock.

    The weight depends on how far delays can tilt the edge.
    """
    u_ppm = 1e6 * float(np.median(delay) - delay.min()) / (np.sqrt(len(delay)) * edge_s)
    error = float(np.clip(rate - 1.0, -1e-6 * MAX_PPM, 1e-6 * MAX_PPM))
    return float(1.0 + error * USUAL_PPM**2 / (USUAL_PPM**2 + u_ppm**2))


def _lower_hull(x: FloatArray, y: FloatArray) -> list[int]:
    """Return the indices of the vertices of the lower convex hull of points with ascending x."""
    hull: list[int] = []
    for index in range(len(x)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            if (x[b] - x[a]) * (y[index] - y[a]) > (y[b] - y[a]) * (x[index] - x[a]):
                break
            hull.pop()
        hull.append(index)
    return hull
