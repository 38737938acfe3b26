"""The gap between two pillars: whether it is open, and how wide it is.

Along lines from one pillar to the other, the grey value falls from the pillar level to the ground level and rises
again: this dip is modelled as a slit with the same edge blur as the pillars. Off-centre lines are wider because of the
geometry of the two circles. The depth of the slit is taken from the pillars' outer edges, so even a slit narrower than
the blur can be assigned a width, from the missing light. If the slit is wide enough to show its own depth, the depth is
fitted, and a film that closes the gap halfway up shows as a reduced depth. A merged pair has no slit: its width is zero
within its uncertainty.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.special import ndtr

from solen.arrays import FloatArray
from solen.metrology.coupons.disc import FLOOR_PX, Disc
from solen.metrology.coupons.least_squares import least_squares

STRIP = 0.15
"""Half width of the evaluated strip, in radii."""
INTO = 0.7
"""Distance by which the strip extends into the pillars, in radii."""
OWN_DEPTH = 2.5
"""Width in blurs above which the slit's own depth is fitted."""
SIGMAS = 4.0
"""Minimum width of an open gap, in standard uncertainties."""
DEEP = 0.5
"""Minimum depth of an open gap, as a fraction of the pillars' rise."""
WHOLE = math.sqrt(math.tau)
NOISE_OF_LINES = 1.5
"""Factor applied to the uncertainty because neighbouring samples share pixels."""


@dataclass(frozen=True)
class GapFit:
    """A fitted gap: its width and standard uncertainty in px, and its depth as a fraction of the pillars' rise."""

    width_px: float
    u_width_px: float
    depth: float

    @property
    def open(self) -> bool:
        """Whether the gap is statistically significant and reaches down to the ground."""
        return self.width_px > SIGMAS * self.u_width_px and self.depth >= DEEP


def fit_gap(grey: FloatArray, left: Disc, right: Disc) -> GapFit | None:
    """Fit the gap between two standing pillars; return None if it is not in the image."""
    radius = 0.25 * (left.diameter_px + right.diameter_px)
    blur = 0.5 * (left.blur_px + right.blur_px)
    apart = math.hypot(right.x_px - left.x_px, right.y_px - left.y_px)
    expected = max(apart - 2.0 * radius, 0.0)
    aside = np.arange(-math.floor(STRIP * radius), math.floor(STRIP * radius) + 1.0)
    half = 0.5 * expected + INTO * radius
    along = np.arange(-math.floor(half), math.floor(half) + 1.0)
    values = _strip(grey, left, right, along, aside)
    if values is None or len(along) < 8:
        return None
    wider = 2.0 * (radius - np.sqrt(radius**2 - aside**2)) + blur**2 / radius  # blur moves a convex edge inwards
    rise = 0.5 * (left.rise + right.rise)
    gap_fit = _fit(along, values, wider, rise, blur, expected, own_depth=False)
    if gap_fit.width_px > OWN_DEPTH * blur:
        gap_fit = _fit(along, values, wider, rise, blur, gap_fit.width_px, own_depth=True)
    return gap_fit


def _strip(grey: FloatArray, left: Disc, right: Disc, along: FloatArray, aside: FloatArray) -> FloatArray | None:
    """Return grey values (lines, positions) between two pillars, or None if the strip leaves the image."""
    middle = np.array([0.5 * (left.x_px + right.x_px), 0.5 * (left.y_px + right.y_px)])
    way = np.array([right.x_px - left.x_px, right.y_px - left.y_px])
    way = way / np.hypot(*way)
    x = middle[0] + along[None, :] * way[0] - aside[:, None] * way[1]
    y = middle[1] + along[None, :] * way[1] + aside[:, None] * way[0]
    rows, columns = grey.shape
    if x.min() < 0.0 or y.min() < 0.0 or x.max() > columns - 1.0 or y.max() > rows - 1.0:
        return None
    x0, y0 = math.floor(x.min()), math.floor(y.min())
    part = grey[y0 : math.ceil(y.max()) + 2, x0 : math.ceil(x.max()) + 2]
    return np.asarray(ndimage.map_coordinates(part, [y - y0, x - x0], order=1, mode="nearest"))


def _fit(
    along: FloatArray, values: FloatArray, wider: FloatArray, rise: float, blur: float, width: float, *, own_depth: bool
) -> GapFit:
    places = np.broadcast_to(along, values.shape)
    extra = np.broadcast_to(wider[:, None], values.shape)

    def model(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        half = 0.5 * (p[1] + extra)
        rises, falls = (places - p[0] + half) / blur, (places - p[0] - half) / blur
        slit = ndtr(rises) - ndtr(falls)
        bells = np.exp(-0.5 * rises**2) / WHOLE, np.exp(-0.5 * falls**2) / WHOLE
        by_place = rise * p[4] * (bells[0] - bells[1]) / blur
        by_width = -rise * p[4] * 0.5 * (bells[0] + bells[1]) / blur
        slopes = (by_place, by_width, np.ones(values.shape), places, -rise * slit)
        grey = p[2] + p[3] * places - rise * p[4] * slit
        return grey.ravel(), np.column_stack([slope.ravel() for slope in slopes])

    level = float(np.median(values)) + 0.5 * rise
    low, high = [-len(along), -math.inf, -math.inf, -math.inf, 1.0], [len(along), math.inf, math.inf, math.inf, 1.0]
    if own_depth:
        low[4], high[4] = 0.0, 3.0
    fit = least_squares(model, values.ravel(), [0.0, width, level, 0.0, 1.0], low, high)
    own = NOISE_OF_LINES * float(fit.u_values[1])
    u_width = math.hypot(own, 2.0 * FLOOR_PX / math.sqrt(3.0))
    return GapFit(float(fit.values[1]), u_width, float(fit.values[4]))
