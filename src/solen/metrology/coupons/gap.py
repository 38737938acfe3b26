"""Width of the gap between two pillars, and whether it is open.

Along lines from one pillar to the other, the grey value falls from the pillar level to the ground level and rises
again: this dip is modelled as a slit with the same edge blur as the pillars. The pillars are round, so the slit is
wider along lines off the centre. Its depth is taken to be that of the pillars' outer edges, so the area of the dip
gives the width even of a slit narrower than the blur. If the slit is wide enough to show its own depth, the depth is
fitted, and a film that closes the gap halfway up appears as a reduced depth. A merged pair has no slit: its width is
zero within its uncertainty.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.special import ndtr

from solen.arrays import FloatArray
from solen.metrology.coupons.disc import FLOOR_PX, Disc
from solen.metrology.coupons.least_squares import least_squares

HALF_STRIP = 0.15
"""Half width of the evaluated strip, in radii of the pillars."""
OVERLAP = 0.7
"""Distance by which the strip extends into the pillars, in radii."""
DEPTH_FIT_BLURS = 2.5
"""Width of a slit in blurs above which its own depth is fitted."""
MIN_SIGMAS = 4.0
"""Minimum width of an open gap, in standard uncertainties."""
MIN_DEPTH = 0.5
"""Minimum depth of an open gap, as a fraction of the pillars' rise."""
SQRT_TAU = math.sqrt(math.tau)
NOISE_FACTOR = 1.5
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
        return self.width_px > MIN_SIGMAS * self.u_width_px and self.depth >= MIN_DEPTH


def fit_gap(grey: FloatArray, left: Disc, right: Disc) -> GapFit | None:
    """Fit the gap between two standing pillars; return None if it is not in the image."""
    radius = 0.25 * (left.diameter_px + right.diameter_px)
    blur = 0.5 * (left.blur_px + right.blur_px)
    distance = math.hypot(right.x_px - left.x_px, right.y_px - left.y_px)
    expected = max(distance - 2.0 * radius, 0.0)
    across = np.arange(-math.floor(HALF_STRIP * radius), math.floor(HALF_STRIP * radius) + 1.0)
    half = 0.5 * expected + OVERLAP * radius
    along = np.arange(-math.floor(half), math.floor(half) + 1.0)
    values = _strip(grey, left, right, along, across)
    if values is None or len(along) < 8:
        return None
    widening = 2.0 * (radius - np.sqrt(radius**2 - across**2)) + blur**2 / radius  # blur moves a convex edge inwards
    rise = 0.5 * (left.rise + right.rise)
    gap_fit = _fit(along, values, widening, rise, blur, expected, free_depth=False)
    if gap_fit.width_px > DEPTH_FIT_BLURS * blur:
        gap_fit = _fit(along, values, widening, rise, blur, gap_fit.width_px, free_depth=True)
    return gap_fit


def _strip(grey: FloatArray, left: Disc, right: Disc, along: FloatArray, across: FloatArray) -> FloatArray | None:
    """Return grey values (lines, positions) between two pillars, or None if the strip leaves the image."""
    middle = np.array([0.5 * (left.x_px + right.x_px), 0.5 * (left.y_px + right.y_px)])
    direction = np.array([right.x_px - left.x_px, right.y_px - left.y_px])
    direction = direction / np.hypot(*direction)
    x = middle[0] + along[None, :] * direction[0] - across[:, None] * direction[1]
    y = middle[1] + along[None, :] * direction[1] + across[:, None] * direction[0]
    rows, columns = grey.shape
    if x.min() < 0.0 or y.min() < 0.0 or x.max() > columns - 1.0 or y.max() > rows - 1.0:
        return None
    x0, y0 = math.floor(x.min()), math.floor(y.min())
    part = grey[y0 : math.ceil(y.max()) + 2, x0 : math.ceil(x.max()) + 2]
    return np.asarray(ndimage.map_coordinates(part, [y - y0, x - x0], order=1, mode="nearest"))


def _fit(
    along: FloatArray,
    values: FloatArray,
    widening: FloatArray,
    rise: float,
    blur: float,
    width: float,
    *,
    free_depth: bool,
) -> GapFit:
    positions = np.broadcast_to(along, values.shape)
    extra = np.broadcast_to(widening[:, None], values.shape)

    def model(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        half = 0.5 * (p[1] + extra)
        rises, falls = (positions - p[0] + half) / blur, (positions - p[0] - half) / blur
        slit = ndtr(rises) - ndtr(falls)
        bells = np.exp(-0.5 * rises**2) / SQRT_TAU, np.exp(-0.5 * falls**2) / SQRT_TAU
        by_position = rise * p[4] * (bells[0] - bells[1]) / blur
        by_width = -rise * p[4] * 0.5 * (bells[0] + bells[1]) / blur
        slopes = (by_position, by_width, np.ones(values.shape), positions, -rise * slit)
        grey = p[2] + p[3] * positions - rise * p[4] * slit
        return grey.ravel(), np.column_stack([slope.ravel() for slope in slopes])

    level = float(np.median(values)) + 0.5 * rise
    low, high = [-len(along), -math.inf, -math.inf, -math.inf, 1.0], [len(along), math.inf, math.inf, math.inf, 1.0]
    if free_depth:
        low[4], high[4] = 0.0, 3.0
    fit = least_squares(model, values.ravel(), [0.0, width, level, 0.0, 1.0], low, high)
    u_fit = NOISE_FACTOR * float(fit.u_values[1])
    u_width = math.hypot(u_fit, 2.0 * FLOOR_PX / math.sqrt(3.0))
    return GapFit(float(fit.values[1]), u_width, float(fit.values[4]))
