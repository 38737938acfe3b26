"""The diameter of a disc in an image, to a small fraction of a pixel, with its uncertainty.

The disc's edge is a circle blurred by a Gaussian of standard deviation s. At the distance d from its centre, the
blurred disc of radius r has the height

    P(d) = probability that |X| < r, X normal about d with variance s² in both directions
         = the non-central chi-square distribution with two degrees of freedom at (r/s)², non-centrality (d/s)²,

which for r >> s is a blurred straight edge, shifted by s²/2r because the edge is convex. Grey levels, illumination
gradient, centre, r and s are fitted to the pixels around the edge. The diameters of small discs are therefore not
underestimated, as they are if the half-level contour is traced.

The uncertainty is not based on pixel noise alone: the edge is divided into twenty-four sectors, and the scatter of
their radial deviations, which includes roughness and form, gives the uncertainty.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chndtr, ndtr

from solen.arrays import BoolArray, FloatArray, IntArray
from solen.metrology.coupons.least_squares import Fit, least_squares

SECTORS = 24
MAX_FITTED = 3000
"""Largest number of pixels used in the fit; the sectors use all pixels."""
STRAIGHT_RATIO = 12.0
"""Ratio of radius to blur above which the edge is treated as a straight one with a shift."""
TABLE = np.linspace(-6.5, 6.5, 261)
"""Distances from the edge, in blurs, at which the height of a small disc is tabulated, to interpolate it to 1e-4."""
HALF_RING_BLURS = 5.0
"""Half width of the fitted ring, in blurs."""
FLOOR_PX = 0.05
"""Half width of a uniform distribution of the systematic radius error of any image; the standard uncertainty is this
value over √3.
"""
MIN_SECTOR_RISE = 0.4
"""Minimum rise of a sector with an edge, as a fraction of the disc's rise."""
MIN_BLUR_PX, MAX_BLUR_PX = 0.3, 30.0
MIN_PIXELS = 24
STEP = 0.03
"""Step of the numerical derivatives: in px, or in the logarithm of the blur."""
MIN_RADIUS_PX = 1.2
"""Radius below which a disc cannot be measured."""


@dataclass(frozen=True)
class Disc:
    """A fitted disc.

    Attributes
    ----------
    x_px, y_px
        Coordinates of its centre.
    diameter_px, u_diameter_px
        Mean diameter over its edge, and its standard uncertainty.
    blur_px
        Standard deviation of the blur.
    rise
        Difference in brightness between the disc and its surroundings.
    snr
        Rise over its standard uncertainty.
    coverage
        Fraction of the inspected sectors that have an edge.
    roundness_px
        Standard deviation of the sectors' radii.
    """

    x_px: float
    y_px: float
    diameter_px: float
    u_diameter_px: float
    blur_px: float
    rise: float
    snr: float
    coverage: float
    roundness_px: float


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Pixels around a point: their offsets (N,) from it along x and y, and their grey values."""

    x: FloatArray
    y: FloatArray
    grey: FloatArray

    def of(self, which: BoolArray | slice) -> "_Pixels":
        return _Pixels(self.x[which], self.y[which], self.grey[which])


def blurred_disc(distance_px: FloatArray, radius_px: float, blur_px: float) -> FloatArray:
    """Return the height (N,) of a blurred disc of height 1 at distances (N,) from its centre."""
    return _profile(distance_px, radius_px, blur_px)[0]


def _profile(distance: FloatArray, radius: float, blur: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the heights (N,) of a blurred disc and their derivatives with respect to distance, radius and log blur."""
    if radius > STRAIGHT_RATIO * blur:
        u, bend = (radius - distance) / blur, 0.5 * blur / radius
        gaussian = np.exp(-0.5 * (u - bend) ** 2) / math.sqrt(math.tau)
        return ndtr(u - bend), -gaussian / blur, gaussian * (1.0 / blur + bend / radius), -gaussian * (u + bend)
    at = np.maximum(radius + blur * TABLE, 0.0)
    table = _exact(at, radius, blur)
    by_radius = (_exact(at, radius + STEP, blur) - _exact(at, radius - STEP, blur)) / (2.0 * STEP)
    blurs = blur * math.exp(STEP), blur * math.exp(-STEP)
    by_blur = (_exact(at, radius, blurs[0]) - _exact(at, radius, blurs[1])) / (2.0 * STEP)
    by_distance = -(radius * by_radius + by_blur) / np.maximum(
        at, 1e-9
    )  # height depends only on the ratios of distance, radius and blur
    height, *slopes = (np.interp(distance, at, values) for values in (table, by_distance, by_radius, by_blur))
    return height, slopes[0], slopes[1], slopes[2]


def _exact(distance: FloatArray, radius: float, blur: float) -> FloatArray:
    return np.asarray(chndtr((radius / blur) ** 2, 2.0, (distance / blur) ** 2))


def fit_disc(
    grey: FloatArray,
    centre_px: tuple[float, float],
    radius_px: float,
    reach_px: float,
    *,
    bright: bool,
    blur_px: float | None = None,
    blocked_rad: Sequence[float] = (),
    half_blocked_rad: float = math.radians(65.0),
    ceiling: float = math.inf,
) -> Disc | None:
    """Fit a disc near an initial position.

    Parameters
    ----------
    grey
        Shape (rows, columns).
    centre_px
        Initial centre, (column, row), accurate to about a third of the radius.
    radius_px
        Nominal radius.
    reach_px
        Distance beyond the nominal edge that is free of other features.
    bright
        Whether the disc is brighter than its surroundings.
    blur_px
        Blur if it is known; otherwise it is fitted.
    blocked_rad
        Directions, atan2(rows, columns), in which other features are too near.
    half_blocked_rad
        Half of the angle about these directions that is omitted.
    ceiling
        Grey value at which the camera was saturated; such pixels near the edge are omitted.

    Returns
    -------
    Disc or None
        None if there are too few pixels, or if there is no edge of that sign.
    """
    pixels = _around(grey, centre_px, radius_px + reach_px)
    if pixels is None:
        return None
    angle = np.arctan2(pixels.y, pixels.x)
    free = np.ones(len(angle), dtype=bool)
    for blocked in blocked_rad:
        free &= np.abs(np.angle(np.exp(1j * (angle - blocked)))) > half_blocked_rad
    pixels = pixels.of(free)
    start = _first_radius(pixels, radius_px, reach_px, bright=bright)
    if start is None:
        return None
    guess = blur_px or 1.5
    disc = None
    for _ in range(2):
        disc = _fit(pixels, start, guess, radius_px + reach_px, fixed=blur_px is not None, start=disc)
        if disc is None:
            return None
        start, guess = float(disc.values[2]), float(math.exp(disc.values[3]))
    return None if disc is None else _disc_of_sectors(pixels, disc, centre_px, bright=bright, ceiling=ceiling)


def _around(grey: FloatArray, centre: tuple[float, float], reach: float) -> _Pixels | None:
    """Return the pixels within a distance of a centre, or None if some of them are outside the image."""
    x0, y0 = centre
    left, right = math.floor(x0 - reach), math.ceil(x0 + reach)
    low, high = math.floor(y0 - reach), math.ceil(y0 + reach)
    rows, columns = grey.shape
    if left < 0 or low < 0 or right >= columns or high >= rows:
        return None
    y, x = np.mgrid[low : high + 1, left : right + 1]
    dx, dy = x - x0, y - y0
    nearby = np.hypot(dx, dy) <= reach
    return _Pixels(dx[nearby], dy[nearby], grey[low : high + 1, left : right + 1][nearby])


def _first_radius(pixels: _Pixels, radius: float, reach: float, *, bright: bool) -> float | None:
    """Return the radius at which the ring-averaged grey value falls (or rises) most steeply."""
    ring = np.round(np.hypot(pixels.x, pixels.y)).astype(int)
    count = np.bincount(ring)
    mean = np.bincount(ring, pixels.grey) / np.maximum(count, 1)
    populated = count[:-1] * count[1:] > 0
    steepness = np.where(populated, mean[:-1] - mean[1:], 0.0) * (1.0 if bright else -1.0)
    steepness = np.convolve(steepness, [0.25, 0.5, 0.25], mode="same")
    at = np.arange(len(steepness)) + 0.5
    allowed = (at > 0.3 * radius) & (at < radius + reach)
    if not allowed.any() or steepness[allowed].max() <= 0.0:
        return None
    return float(at[allowed][steepness[allowed].argmax()])


def _fit(
    pixels: _Pixels, radius: float, blur: float, max_radius: float, *, fixed: bool, start: Fit | None
) -> Fit | None:
    """Fit x, y, radius, log blur, background level, rise, and the illumination gradient along x and y."""
    x0, y0 = (0.0, 0.0) if start is None else (float(start.values[0]), float(start.values[1]))
    distance = np.hypot(pixels.x - x0, pixels.y - y0)
    ring = pixels.of(np.abs(distance - radius) <= HALF_RING_BLURS * blur + 2.0)
    if len(ring.x) < MIN_PIXELS:
        return None
    stride = max(1, len(ring.x) // MAX_FITTED)
    ring = ring.of(slice(None, None, stride))
    inside = blurred_disc(np.hypot(ring.x - x0, ring.y - y0), radius, blur)
    log_blur = min(max(math.log(blur), math.log(MIN_BLUR_PX)), math.log(MAX_BLUR_PX))
    blurs = (log_blur, log_blur) if fixed else (math.log(MIN_BLUR_PX), math.log(MAX_BLUR_PX))
    shift, free = max(2.0, 0.4 * radius), [math.inf] * 4
    guess = [x0, y0, radius, log_blur, *_levels(inside, ring)]
    low = [x0 - shift, y0 - shift, 0.5, blurs[0], *(-limit for limit in free)]
    high = [x0 + shift, y0 + shift, max_radius, blurs[1], *free]
    fit = least_squares(lambda p: _model(ring, p), ring.grey, guess, low, high)
    return Fit(fit.values, fit.u_values / math.sqrt(stride), fit.residuals)


def _levels(inside: FloatArray, ring: _Pixels) -> list[float]:
    """Return background level and rise for a fixed position, radius and blur, without an illumination gradient."""
    weight = inside - inside.mean()
    rise = float(np.sum(weight * ring.grey) / max(float(np.sum(weight**2)), 1e-12))
    return [float(ring.grey.mean() - rise * inside.mean()), rise, 0.0, 0.0]


def _model(pixels: _Pixels, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return grey values (N,) and their derivatives (N, 8) with respect to the parameters."""
    dx, dy = pixels.x - p[0], pixels.y - p[1]
    distance = np.maximum(np.hypot(dx, dy), 1e-9)
    radius, blur, rise = float(p[2]), math.exp(float(p[3])), float(p[5])
    inside, by_distance, by_radius, by_blur = _profile(distance, radius, blur)
    ones = np.ones(len(distance))
    slopes = [
        -rise * by_distance * dx / distance,
        -rise * by_distance * dy / distance,
        rise * by_radius,
        rise * by_blur,
    ]
    slopes += [ones, inside, pixels.x, pixels.y]
    return np.asarray(p[4] + rise * inside + p[6] * pixels.x + p[7] * pixels.y), np.column_stack(slopes)


def _disc_of_sectors(
    pixels: _Pixels, fit: Fit, centre: tuple[float, float], *, bright: bool, ceiling: float
) -> Disc | None:
    """Return the disc with radius and uncertainty from its sectors, or None if its contrast has the wrong sign."""
    p = fit.values
    radius, blur, rise = float(p[2]), math.exp(float(p[3])), float(p[5])
    if rise * (1.0 if bright else -1.0) <= 0.0 or radius < MIN_RADIUS_PX:
        return None
    distance = np.hypot(pixels.x - p[0], pixels.y - p[1])
    ring = np.abs(distance - radius) <= HALF_RING_BLURS * blur + 1.0
    nearby = pixels.of(ring)
    model, slopes = _model(nearby, p)
    residual, per_px = nearby.grey - model, slopes[:, 2]
    inside = blurred_disc(distance[ring], radius, blur)
    sector = np.floor((np.arctan2(nearby.y - p[1], nearby.x - p[0]) / math.tau + 0.5) * SECTORS).astype(int) % SECTORS
    usable = nearby.grey < ceiling - 1e-12
    offsets, rises = _sectors(sector, residual, per_px, inside, rise, usable)
    inspected = np.isfinite(rises)
    if inspected.sum() < SECTORS // 6:
        return None
    present = inspected & (rises > MIN_SECTOR_RISE)
    noise = float(np.std(residual))
    radial = offsets[present]
    roundness = float(np.std(radial, ddof=1)) if len(radial) > 1 else math.inf
    mean = float(np.mean(radial)) if len(radial) else 0.0
    u_radius = math.hypot(
        max(roundness / math.sqrt(max(len(radial), 1)), float(fit.u_values[2])), FLOOR_PX / math.sqrt(3.0)
    )
    weight = inside - inside.mean()
    u_rise = noise / max(math.sqrt(float(np.sum(weight**2))), 1e-300)
    return Disc(
        centre[0] + float(p[0]),
        centre[1] + float(p[1]),
        2.0 * (radius + mean),
        2.0 * u_radius,
        blur,
        rise,
        abs(rise) / max(u_rise, 1e-300),
        float(present.sum() / inspected.sum()),
        roundness,
    )


def _sectors(
    sector: IntArray,
    residual: FloatArray,
    per_px: FloatArray,
    inside: FloatArray,
    rise: float,
    usable: BoolArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the offset of each sector's edge from the circle, and its relative rise; NaN for too few usable pixels."""
    offsets, rises = np.full(SECTORS, np.nan), np.full(SECTORS, np.nan)
    for number in range(SECTORS):
        chosen = (sector == number) & usable
        steep = float(np.sum(per_px[chosen] ** 2))
        weight = inside[chosen] - inside[chosen].mean() if chosen.any() else inside[chosen]
        if chosen.sum() < 4 or np.sum(weight**2) < 0.05 or steep <= 0.0:
            continue
        offsets[number] = float(np.sum(residual[chosen] * per_px[chosen])) / steep
        rises[number] = 1.0 + float(np.sum(residual[chosen] * weight) / np.sum(weight**2)) / rise
    return offsets, rises
