"""Sub-pixel edges: the position of a contour from the blurred step along its normals.

Contours from a threshold deviate by a fraction of a pixel, and by more if the background is non-uniform. Here an
initial contour only defines where to search. Along each of its normals, the grey values are averaged over a few
neighbouring lines, and a step blurred by a Gaussian is fitted with its own levels; the edge is the centre of the step.
A point without such a step (because of dust, a reflection, or an edge that is too weak for the noise) is rejected with
a reason.

Public names: `fit_edge`, `Edge`, `normals_of` and `profiles`. Positions are (x, y) = (column, row) in pixels, integer
at the centre of a pixel, y downwards.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import ndimage

from solen.arrays import BoolArray, FloatArray
from solen.metrology.step_fit import MAX_BLUR_PX, StepPriors, Steps, fit_steps

LINES = 5
"""Number of neighbouring lines, one pixel apart, whose grey values are averaged."""
HALF_LINE_BLURS = 5.0
"""Half length of a fitted line, in blurs."""
FIRST_BLUR_PX = 2.0
"""Initial value of the blur, from which the image's own blur is determined."""
MIN_HALF_LINE_PX = 5.0
BLUR_SAMPLES, MAX_BLUR_GROWTH = 120, 1.25
"""Number of positions from which the blur is estimated, and the factor between estimates below which the lines are long
enough.
"""
MIN_GOOD_FITS = 20
"""Minimum number of good fits for an estimate of typical parameters."""
U_LOG_BLUR, U_SLOPE_FRACTION = 0.2, 3e-3
"""Prior standard deviations along a contour: of the logarithm of the blur, and of the background slope per pixel, as a
fraction of the rise.
"""
MAX_SATURATED_FRACTION = 0.5
"""Fraction of saturated pixels across a line above which it is rejected; noise alone saturates fewer."""
MAX_U_PX = 1.0
MIN_SNR = 4.0
"""Minimum ratio of a step's rise to the noise of a line."""
MIN_RISE = 0.25
"""Smallest rise of a step, relative to the median along the contour; a smaller step is not part of the edge."""
MAX_BLUR_RATIO = 2.5
"""Ratio of a fit's blur to the median blur, or inverse of this ratio, above which the fit is rejected."""
MAX_RESIDUAL_RATIO = 2.2
"""Ratio of a line's residuals to their median above which another object is assumed to lie on the edge."""
NEGLIGIBLE_RESIDUAL = 0.02
"""Fraction of the rise below which residuals are negligible."""
DILATION = 2
"""Number of points on each side of another object that are rejected with it."""
MEDIAN_POINTS = 15
MAX_OFFSET_SIGMAS, MAX_OFFSET_PX = 5.0, 0.5
"""Largest distance of a point from the running median of `MEDIAN_POINTS` neighbours; the larger limit applies."""
ISOLATION_POINTS, MIN_KEPT_FRACTION = 9, 0.4
"""Number of neighbours of a point, and the fraction of edges among them below which the point is isolated."""
NOISE_POINTS, NEIGHBOUR_WEIGHT = 31, 4.0
"""Number of neighbours used for the noise of a point, and their weight relative to that of the point itself."""
MIN_TRIPLES = 40
"""Minimum number of comparisons with neighbours for an estimate of the scatter."""


@dataclass(frozen=True, eq=False)
class Edge:
    """An edge, point by point along its contour.

    Attributes
    ----------
    points_px
        Shape (N, 2): (x, y) of the edge.
    normals
        Shape (N, 2): unit vectors of the search lines.
    u_px
        Shape (N,): standard uncertainty of the position along the normal.
    blur_px
        Shape (N,): standard deviation of the blur.
    rise
        Shape (N,): rise of the grey value along the normal.
    inside
        Shape (N,): whether the fitted line lies in the image.
    kept
        Shape (N,): whether the point is an edge.
    rejected
        Number of rejected points by reason, in the order of the tests.
    """

    points_px: FloatArray
    normals: FloatArray
    u_px: FloatArray
    blur_px: FloatArray
    rise: FloatArray
    inside: BoolArray
    kept: BoolArray
    rejected: dict[str, int]

    @property
    def measured(self) -> tuple[FloatArray, FloatArray]:
        """Accepted points (M, 2) and their standard uncertainties (M,), px."""
        return self.points_px[self.kept], self.u_px[self.kept]

    @property
    def fraction_kept(self) -> float:
        """Fraction of the points in the image that are accepted."""
        return float(self.kept.sum()) / max(int(self.inside.sum()), 1)

    @property
    def blur(self) -> float:
        """Median blur of the accepted points, px; NaN without accepted points."""
        return float(np.median(self.blur_px[self.kept])) if self.kept.any() else float("nan")

    @property
    def contrast(self) -> float:
        """Median rise of the accepted points; NaN without accepted points."""
        return float(np.median(self.rise[self.kept])) if self.kept.any() else float("nan")


def normals_of(contour_px: FloatArray, *, closed: bool, span: int = 5) -> FloatArray:
    """Return the unit normals (N, 2) of a contour, to its left as seen in the image.

    The tangent (dx, dy) runs from ``span`` points before to ``span`` points after, and is rotated to (dy, −dx).
    """
    if closed:
        ahead, behind = np.roll(contour_px, -span, axis=0), np.roll(contour_px, span, axis=0)
    else:
        index = np.arange(len(contour_px))
        ahead = contour_px[np.minimum(index + span, len(contour_px) - 1)]
        behind = contour_px[np.maximum(index - span, 0)]
    tangent = ahead - behind
    length = np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-12)
    return np.stack([tangent[:, 1], -tangent[:, 0]], axis=1) / length[:, None]


def profiles(
    grey: FloatArray,
    points_px: FloatArray,
    normals: FloatArray,
    t_px: FloatArray,
    lines: int = LINES,
    order: Literal[1, 3] = 3,
) -> tuple[FloatArray, BoolArray]:
    """Return grey values (N, M) at distances ``t_px`` (M,) along normals, and whether each sample is in the image.

    Values between pixels are interpolated by splines, cubic ones by default; ``lines`` parallel lines, a pixel apart,
    are averaged.
    """
    rows, columns = grey.shape
    values = np.zeros((len(points_px), len(t_px)))
    inside = np.ones(values.shape, dtype=bool)
    patch, corner = _patch(grey, points_px, float(np.max(np.abs(t_px))) + lines, order)
    for shift in np.arange(lines) - 0.5 * (lines - 1):
        x = points_px[:, :1] + normals[:, :1] * t_px - normals[:, 1:] * shift
        y = points_px[:, 1:] + normals[:, 1:] * t_px + normals[:, :1] * shift
        inside &= (x >= 0.0) & (x <= columns - 1.0) & (y >= 0.0) & (y <= rows - 1.0)
        values += ndimage.map_coordinates(
            patch, [y - corner[1], x - corner[0]], order=order, prefilter=False, mode="nearest"
        )
    return values / lines, inside


def _patch(
    grey: FloatArray, points: FloatArray, reach: float, order: Literal[1, 3]
) -> tuple[FloatArray, tuple[int, int]]:
    """Return the spline coefficients of the required part of the image, and its first column and row."""
    rows, columns = grey.shape
    margin = reach + 12.0  # spline coefficients depend on nearby pixels
    x0, y0 = (int(max(0.0, np.floor(float(points[:, i].min()) - margin))) for i in (0, 1))
    x1, y1 = (int(np.ceil(float(points[:, i].max()) + margin)) + 1 for i in (0, 1))
    x0, y0 = min(x0, columns - 1), min(y0, rows - 1)
    part = grey[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)]
    return (np.asarray(ndimage.spline_filter(part, order=3, mode="nearest")) if order > 1 else part), (x0, y0)


def fit_edge(
    grey: FloatArray,
    contour_px: FloatArray,
    normals: FloatArray,
    *,
    half_px: float = float("inf"),
    ceiling: float = float("inf"),
    rising: bool | None = None,
    lines: int = LINES,
    closed: bool = False,
) -> Edge:
    """Fit the edge near a contour, to a small fraction of a pixel.

    Parameters
    ----------
    grey
        Shape (rows, columns).
    contour_px, normals
        Shape (N, 2): a contour within about two blurs of the edge, and unit vectors across it.
    half_px
        Largest distance searched on each side, for an edge with another one near it.
    ceiling
        Grey value at which the camera was saturated.
    rising
        Whether the grey value rises along the normals; None selects the more frequent sign.
    lines
        Number of parallel lines to average, one pixel apart; 1 if the contour turns within a few pixels.
    closed
        Whether the contour is closed, so that the last point is next to the first.
    """
    at = np.zeros((len(contour_px), 1))
    sampling = _Sampling(grey, contour_px, normals, half_px, ceiling, lines, closed)
    steps, inside, saturated = sampling.fitted(at, sampling.blur(at, FIRST_BLUR_PX))
    return sampling.checked(steps, 0, rising, inside, saturated)


def fit_two_edges(
    grey: FloatArray,
    contour_px: FloatArray,
    normals: FloatArray,
    at_px: FloatArray,
    *,
    blur_px: float = FIRST_BLUR_PX,
    ceiling: float = float("inf"),
) -> tuple[Edge, Edge]:
    """Fit two edges with overlapping blurs jointly.

    Parameters are as in `fit_edge`; ``at_px`` (N, 2) are initial positions of both edges along the normals.
    """
    sampling = _Sampling(grey, contour_px, normals, float("inf"), ceiling, LINES, False)
    steps, inside, saturated = sampling.fitted(at_px, sampling.two_blurs(at_px, blur_px))
    return (sampling.checked(steps, 0, None, inside, saturated), sampling.checked(steps, 1, None, inside, saturated))


@dataclass(frozen=True, eq=False)
class _Sampling:
    """A contour in an image, and how the lines across it are sampled."""

    grey: FloatArray
    contour_px: FloatArray
    normals: FloatArray
    half_px: float
    ceiling: float
    lines: int
    closed: bool

    def blur(self, at: FloatArray, guess_px: float) -> float:
        """Return the median blur at a sample of points, on lines that are lengthened until they are long enough."""
        sample, at = self._sample(at)
        for _ in range(4):
            steps, inside, _ = sample.fitted(at, guess_px)
            reliable = steps.converged & inside & (np.abs(steps.rise[:, 0]) > MIN_SNR * steps.noise)
            blur_px = float(np.median(steps.blur_px[reliable, 0])) if reliable.any() else guess_px
            if blur_px < MAX_BLUR_GROWTH * guess_px:
                return float(np.clip(blur_px, 0.5, MAX_BLUR_PX))
            guess_px = min(blur_px, MAX_BLUR_PX)
        return guess_px

    def two_blurs(self, at: FloatArray, guess_px: float) -> FloatArray:
        """Return the blurs of two edges at a sample of points, from the pair with the most good fits."""
        sample, at = self._sample(at)
        best, blurs = -np.inf, np.array([guess_px, guess_px])
        for factors in ((1.0, 1.0), (1.0, 2.0), (2.0, 1.0), (2.0, 2.0)):
            steps, inside, _ = sample.fitted(at, guess_px * np.array(factors))
            reliable = inside & steps.converged & (steps.u_at_px.max(axis=1) < MAX_U_PX)
            relative_noise = _median(steps.noise, reliable) / max(_median(steps.noise, inside), 1e-12)
            score = float(reliable.sum()) - 10.0 * relative_noise
            if reliable.any() and score > best:
                best, blurs = score, np.median(steps.blur_px[reliable], axis=0)
        return np.asarray(np.clip(blurs, 0.5, MAX_BLUR_PX))

    def _sample(self, at: FloatArray) -> tuple["_Sampling", FloatArray]:
        """Return a sample of points, evenly spaced along the contour, and their initial positions."""
        chosen = np.unique(np.linspace(0, len(at) - 1, min(len(at), BLUR_SAMPLES)).astype(int))
        return replace(self, contour_px=self.contour_px[chosen], normals=self.normals[chosen]), at[chosen]

    def fitted(self, at: FloatArray, blur_px: float | FloatArray) -> tuple[Steps, BoolArray, BoolArray]:
        """Return the fits, and for each line whether it is in the image and whether it is saturated.

        A second fit uses parameters that the lines of the first have in common: if edges overlap or are faint, a single
        line cannot determine its own blur and slope.
        """
        around = max(HALF_LINE_BLURS * float(np.max(blur_px)), MIN_HALF_LINE_PX)
        half = np.ceil(min(float(np.max(np.abs(at))) + around, self.half_px))
        t = np.arange(-half, half + 0.5)
        values, inside = profiles(self.grey, self.contour_px, self.normals, t, self.lines)
        use = (t >= at.min(axis=1, keepdims=True) - around) & (t <= at.max(axis=1, keepdims=True) + around)
        saturated = self._saturated(t, use)
        complete = (inside | ~use).all(axis=1)
        independent = fit_steps(t, values, at, blur_px, use)
        priors = _typical(independent, complete & ~saturated)
        return (independent if priors is None else fit_steps(t, values, at, blur_px, use, priors)), complete, saturated

    def _saturated(self, t: FloatArray, use: BoolArray) -> BoolArray:
        """Return a mask of the lines that contain a saturated point, which would shift the fitted step."""
        limit = self.grey >= self.ceiling
        if not limit.any():
            return np.zeros(len(use), dtype=bool)
        fraction, _ = profiles(limit.astype(np.float64), self.contour_px, self.normals, t, self.lines, order=1)
        return np.asarray(((fraction > MAX_SATURATED_FRACTION) & use).any(axis=1))

    def checked(self, steps: Steps, index: int, rising: bool | None, inside: BoolArray, saturated: BoolArray) -> Edge:
        """Return one of the fitted edges, with outliers rejected."""
        at, u, rise, blur = (values[:, index] for values in (steps.at_px, steps.u_at_px, steps.rise, steps.blur_px))
        points = self.contour_px + self.normals * at[:, None]
        usable = inside & ~saturated
        noise = _median(steps.noise, usable)
        strong = usable & (np.abs(rise) > MIN_SNR * noise)
        typical = _median(rise, strong)
        if rising is not None:
            typical = _median(np.abs(rise), strong) * (1.0 if rising else -1.0)
        weak = (rise * np.sign(typical) < MIN_RISE * abs(typical)) | (np.abs(rise) < MIN_SNR * noise) | (typical == 0.0)
        typical_blur = _median(blur, usable & ~weak)
        max_residual = np.maximum(MAX_RESIDUAL_RATIO * noise, NEGLIGIBLE_RESIDUAL * abs(typical))
        reasons = {
            "outside the image": ~inside,
            "saturated": saturated,
            "low contrast": weak,
            "no fit": ~steps.converged | ~(u < MAX_U_PX),
            "unusual blur": (blur > MAX_BLUR_RATIO * typical_blur) | (blur < typical_blur / MAX_BLUR_RATIO),
            "unusual shape": _near_outliers(steps.noise > max_residual),
        }
        kept, rejected = _counted(reasons, len(at))
        outliers = kept & _off_neighbours(points, self.contour_px, self.normals, kept, self.closed)
        kept, rejected["outlier"] = kept & ~outliers, int(outliers.sum())
        outliers = kept & _isolated(kept, inside)
        kept, rejected["isolated"] = kept & ~outliers, int(outliers.sum())
        u = u * _noise_factors(steps.noise)
        u = u * scatter_over_u(points, self.normals, u, kept, self.lines)
        return Edge(points, self.normals, u, blur, rise, inside, kept, rejected)


def _noise_factors(noise: FloatArray) -> FloatArray:
    """Return factors (N,) for the uncertainties by which neighbouring lines contribute to the estimate of the noise.

    A line has about ten values and five parameters, so its residuals determine its noise to 30 % at best.
    """
    local = ndimage.median_filter(noise, NOISE_POINTS, mode="nearest")
    single = np.maximum(noise, 1e-12)
    return np.asarray(np.sqrt((1.0 + NEIGHBOUR_WEIGHT * (local / single) ** 2) / (1.0 + NEIGHBOUR_WEIGHT)))


def scatter_over_u(
    points: FloatArray, normals: FloatArray, u: FloatArray, kept: BoolArray, lines: int = LINES
) -> float:
    """Return the ratio of the scatter between neighbouring points to that expected from the residuals; at least 1.

    The fit treats residuals as independent, but those of a sharpened, compressed or textured image are correlated, and
    interpolation adds to the correlation. Each point is compared with the mean of one point before and one after it
    that share no pixel with it, and slow bending is subtracted. Roughness finer than about ten pixels therefore
    contributes to the uncertainty.
    """
    step = float(np.median(np.hypot(*np.diff(points, axis=0).T))) if len(points) > 1 else 0.0
    lag = int(np.ceil((lines + 1.0) / step)) if step > 0.0 else 0
    if lag == 0 or len(points) <= 2 * lag:
        return 1.0
    middle, before, after = np.s_[lag:-lag], np.s_[: -2 * lag], np.s_[2 * lag :]
    bend = np.sum((points[middle] - 0.5 * (points[before] + points[after])) * normals[middle], axis=1)
    sigma = np.sqrt(u[middle] ** 2 + 0.25 * (u[before] ** 2 + u[after] ** 2))
    valid = kept[middle] & kept[before] & kept[after] & (sigma > 0.0)
    if valid.sum() < MIN_TRIPLES:
        return 1.0
    ratio = bend[valid] / sigma[valid]
    residual = ratio - ndimage.median_filter(ratio, 12 * lag + 1, mode="nearest")
    return float(max(1.0, 1.4826 * float(np.median(np.abs(residual)))))


def _typical(steps: Steps, usable: BoolArray) -> StepPriors | None:
    """Return typical parameters of the good fits, or None if there are too few."""
    noise = _median(steps.noise, usable)
    reliable = usable & steps.converged & (np.abs(steps.rise).min(axis=1) > MIN_SNR * noise)
    reliable &= steps.u_at_px.max(axis=1) < np.maximum(2.0 * float(np.median(steps.u_at_px)), 0.1)
    if reliable.sum() < MIN_GOOD_FITS:
        return None
    rise = float(np.median(np.abs(steps.rise[reliable]).max(axis=1)))
    return StepPriors(
        log_blur=np.log(np.median(steps.blur_px[reliable], axis=0)),
        u_log_blur=U_LOG_BLUR,
        slope_per_px=float(np.median(steps.slope_per_px[reliable])),
        u_slope_per_px=U_SLOPE_FRACTION * rise,
        noise=noise,
    )


def _counted(reasons: dict[str, BoolArray], count: int) -> tuple[BoolArray, dict[str, int]]:
    """Return a mask of the points that are not rejected, and the number of points rejected for each reason."""
    kept, rejected = np.ones(count, dtype=bool), {}
    for reason, flags in reasons.items():
        rejected[reason] = int(np.sum(kept & flags))
        kept &= ~flags
    return kept, rejected


def _isolated(kept: BoolArray, inside: BoolArray) -> BoolArray:
    """Return a mask of isolated points: most of their neighbours in the image are not edges."""
    kept_fraction, inside_fraction = (
        ndimage.uniform_filter1d(flags.astype(float), ISOLATION_POINTS, mode="nearest") for flags in (kept, inside)
    )
    return np.asarray(kept_fraction < MIN_KEPT_FRACTION * inside_fraction)


def _near_outliers(odd: BoolArray) -> BoolArray:
    """Return a mask of outliers and `DILATION` neighbours on each side, because objects on an edge fade gradually."""
    return np.asarray(ndimage.binary_dilation(odd, iterations=DILATION)) if odd.any() else odd


def _median(values: FloatArray, where: BoolArray) -> float:
    return float(np.median(values[where])) if where.any() else 0.0


def _off_neighbours(
    points: FloatArray, contour: FloatArray, normals: FloatArray, kept: BoolArray, closed: bool
) -> BoolArray:
    """Return a mask of points too far from the running median of their neighbours."""
    if int(kept.sum()) < MEDIAN_POINTS:
        return np.zeros(len(kept), dtype=bool)
    mode: Literal["wrap", "nearest"] = "wrap" if closed else "nearest"
    smooth = ndimage.uniform_filter1d(contour, 5, axis=0, mode=mode)
    offset = np.sum((points - smooth) * normals, axis=1)[kept]
    residual = offset - ndimage.median_filter(offset, MEDIAN_POINTS, mode=mode)
    scatter = 1.4826 * float(np.median(np.abs(residual)))
    outliers = np.zeros(len(kept), dtype=bool)
    outliers[kept] = np.abs(residual) > max(MAX_OFFSET_SIGMAS * scatter, MAX_OFFSET_PX)
    return outliers
