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
BLURS = 5.0
"""Half length of a fitted line, in blurs."""
FIRST_BLUR_PX = 2.0
"""Initial value of the blur, from which the image's own blur is determined."""
MIN_HALF_PX = 5.0
SOME, WIDER = 120, 1.25
"""Number of positions from which the blur is estimated, and the relative growth of the estimate below which search
lines are long enough.
"""
MIN_GOOD_FITS = 20
"""Minimum number of good fits for an estimate of typical parameters."""
U_LOG_BLUR, U_SLOPE_SHARE = 0.2, 3e-3
"""Relative variation of the blur along a contour, and the background slope per px, as a fraction of the rise."""
SATURATED = 0.5
"""Fraction of saturated pixels across a line above which it is rejected; noise alone saturates fewer."""
MAX_U_PX = 1.0
MIN_SNR = 4.0
"""Minimum ratio of a step's rise to the noise of a line."""
MIN_RISE = 0.25
"""Ratio to the median rise along the contour below which a step belongs to another edge or to none."""
ODD_BLUR = 2.5
ODD_SHAPE = 2.2
"""Ratio of the residuals to their median above which another object lies on the edge."""
ODD_SHARE = 0.02
"""Fraction of the rise below which residuals are negligible."""
BESIDE = 2
NEIGHBOURS = 15
OFF_SIGMAS, OFF_PX = 5.0, 0.5
ALONE_PLACES, ALONE_SHARE = 9, 0.4
NOISE_PLACES, NEIGHBOURS_WEIGHT = 31, 4.0
"""Number of neighbours used for a point's noise, and their weight relative to its own residuals."""
MIN_TRIPLES = 40
"""Number of comparisons with neighbours below which the scatter is not evaluated."""


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
    def share_kept(self) -> float:
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


def normals_of(contour_px: FloatArray, *, closed: bool, over: int = 5) -> FloatArray:
    """Return the unit normals (N, 2) of a contour, to its left as seen in the image.

    The tangent (dx, dy) runs from ``over`` points before to ``over`` points after, and is rotated to (dy, −dx).
    """
    if closed:
        ahead, behind = np.roll(contour_px, -over, axis=0), np.roll(contour_px, over, axis=0)
    else:
        index = np.arange(len(contour_px))
        ahead = contour_px[np.minimum(index + over, len(contour_px) - 1)]
        behind = contour_px[np.maximum(index - over, 0)]
    way = ahead - behind
    return np.stack([way[:, 1], -way[:, 0]], axis=1) / np.maximum(np.hypot(way[:, 0], way[:, 1]), 1e-12)[:, None]


def profiles(
    grey: FloatArray,
    points_px: FloatArray,
    normals: FloatArray,
    t_px: FloatArray,
    lines: int = LINES,
    order: Literal[1, 3] = 3,
) -> tuple[FloatArray, BoolArray]:
    """Return grey values (N, M) at distances ``t_px`` (M,) along normals, and whether each line is in the image.

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
    margin = reach + 12.0  # spline coefficients depend on a few pixels beyond
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
    view = _View(grey, contour_px, normals, half_px, ceiling, lines, closed)
    steps, inside, saturated = view.fitted(at, view.blur(at, FIRST_BLUR_PX))
    return view.checked(steps, 0, rising, inside, saturated)


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
    view = _View(grey, contour_px, normals, float("inf"), ceiling, LINES, False)
    steps, inside, saturated = view.fitted(at_px, view.two_blurs(at_px, blur_px))
    return (view.checked(steps, 0, None, inside, saturated), view.checked(steps, 1, None, inside, saturated))


@dataclass(frozen=True, eq=False)
class _View:
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
        part, at = self._sample(at)
        for _ in range(4):
            steps, inside, _ = part.fitted(at, guess_px)
            good = steps.settled & inside & (np.abs(steps.rise[:, 0]) > MIN_SNR * steps.noise)
            found = float(np.median(steps.blur_px[good, 0])) if good.any() else guess_px
            if found < WIDER * guess_px:
                return float(np.clip(found, 0.5, MAX_BLUR_PX))
            guess_px = min(found, MAX_BLUR_PX)
        return guess_px

    def two_blurs(self, at: FloatArray, guess_px: float) -> FloatArray:
        """Return the blurs of two edges at a sample of points, from the pair with the most good fits."""
        part, at = self._sample(at)
        best, blurs = -np.inf, np.array([guess_px, guess_px])
        for factors in ((1.0, 1.0), (1.0, 2.0), (2.0, 1.0), (2.0, 2.0)):
            steps, inside, _ = part.fitted(at, guess_px * np.array(factors))
            good = inside & steps.settled & (steps.u_at_px.max(axis=1) < MAX_U_PX)
            merit = float(good.sum()) - 10.0 * _median(steps.noise, good) / max(_median(steps.noise, inside), 1e-12)
            if good.any() and merit > best:
                best, blurs = merit, np.median(steps.blur_px[good], axis=0)
        return np.asarray(np.clip(blurs, 0.5, MAX_BLUR_PX))

    def _sample(self, at: FloatArray) -> tuple["_View", FloatArray]:
        """Return a sample of points, evenly spaced along the contour, and their first guesses."""
        some = np.unique(np.linspace(0, len(at) - 1, min(len(at), SOME)).astype(int))
        return replace(self, contour_px=self.contour_px[some], normals=self.normals[some]), at[some]

    def fitted(self, at: FloatArray, blur_px: float | FloatArray) -> tuple[Steps, BoolArray, BoolArray]:
        """Return the fits, whether each line is in the image, and its saturated fraction.

        A second fit uses parameters that the lines of the first have in common: if edges overlap or are faint, a single
        line cannot determine its own blur and slope.
        """
        around = max(BLURS * float(np.max(blur_px)), MIN_HALF_PX)
        half = np.ceil(min(float(np.max(np.abs(at))) + around, self.half_px))
        t = np.arange(-half, half + 0.5)
        values, inside = profiles(self.grey, self.contour_px, self.normals, t, self.lines)
        use = (t >= at.min(axis=1, keepdims=True) - around) & (t <= at.max(axis=1, keepdims=True) + around)
        saturated = self._saturated(t, use)
        seen = (inside | ~use).all(axis=1)
        alone = fit_steps(t, values, at, blur_px, use)
        usual = _typical(alone, seen & ~saturated)
        return (alone if usual is None else fit_steps(t, values, at, blur_px, use, usual)), seen, saturated

    def _saturated(self, t: FloatArray, use: BoolArray) -> BoolArray:
        """Return the lines that contain a saturated point, which would shift the fitted step."""
        limit = self.grey >= self.ceiling
        if not limit.any():
            return np.zeros(len(use), dtype=bool)
        share, _ = profiles(limit.astype(np.float64), self.contour_px, self.normals, t, self.lines, order=1)
        return np.asarray(((share > SATURATED) & use).any(axis=1))

    def checked(self, steps: Steps, which: int, rising: bool | None, inside: BoolArray, saturated: BoolArray) -> Edge:
        """Return one of the fitted edges, with outliers rejected."""
        at, u, rise, blur = (values[:, which] for values in (steps.at_px, steps.u_at_px, steps.rise, steps.blur_px))
        points = self.contour_px + self.normals * at[:, None]
        fit = inside & ~saturated
        noise = _median(steps.noise, fit)
        strong = fit & (np.abs(rise) > MIN_SNR * noise)
        usual = _median(rise, strong) if rising is None else (1.0 if rising else -1.0) * _median(np.abs(rise), strong)
        weak = (rise * np.sign(usual) < MIN_RISE * abs(usual)) | (np.abs(rise) < MIN_SNR * noise) | (usual == 0.0)
        usual_blur = _median(blur, fit & ~weak)
        bad = {
            "outside the image": ~inside,
            "saturated": saturated,
            "low contrast": weak,
            "no fit": ~steps.settled | ~(u < MAX_U_PX),
            "odd blur": (blur > ODD_BLUR * usual_blur) | (blur < usual_blur / ODD_BLUR),
            "odd shape": _near_outliers(steps.noise > np.maximum(ODD_SHAPE * noise, ODD_SHARE * abs(usual))),
        }
        kept, rejected = _counted(bad, len(at))
        out = kept & _off_neighbours(points, self.contour_px, self.normals, kept, self.closed)
        kept, rejected["off its neighbours"] = kept & ~out, int(out.sum())
        out = kept & _isolated(kept, inside)
        kept, rejected["alone"] = kept & ~out, int(out.sum())
        u = u * _noise_factors(steps.noise)
        u = u * scatter_over_u(points, self.normals, u, kept, self.lines)
        return Edge(points, self.normals, u, blur, rise, inside, kept, rejected)


def _noise_factors(noise: FloatArray) -> FloatArray:
    """Return factors (N,) on the uncertainties if the noise is also estimated from neighbours.

    A line has about ten values and five parameters, so its residuals determine its noise to 30 % at best.
    """
    usual = ndimage.median_filter(noise, NOISE_PLACES, mode="nearest")
    own = np.maximum(noise, 1e-12)
    return np.asarray(np.sqrt((1.0 + NEIGHBOURS_WEIGHT * (usual / own) ** 2) / (1.0 + NEIGHBOURS_WEIGHT)))


def scatter_over_u(
    points: FloatArray, normals: FloatArray, u: FloatArray, kept: BoolArray, lines: int = LINES
) -> float:
    """Return the ratio of the edge's scatter between neighbours to that expected from the residuals; at least 1.

    The fit treats residuals as independent, but the residuals of a sharpened, compressed or textured image are not, and
    interpolation correlates them too. Each point is compared with the mean of one point before and one after that share
    no pixel with it; slow bending does not count as scatter. Roughness finer than about ten pixels therefore counts as
    uncertainty too.
    """
    step = float(np.median(np.hypot(*np.diff(points, axis=0).T))) if len(points) > 1 else 0.0
    lag = int(np.ceil((lines + 1.0) / step)) if step > 0.0 else 0
    if lag == 0 or len(points) <= 2 * lag:
        return 1.0
    here, before, behind = np.s_[lag:-lag], np.s_[: -2 * lag], np.s_[2 * lag :]
    bend = np.sum((points[here] - 0.5 * (points[before] + points[behind])) * normals[here], axis=1)
    sigma = np.sqrt(u[here] ** 2 + 0.25 * (u[before] ** 2 + u[behind] ** 2))
    known = kept[here] & kept[before] & kept[behind] & (sigma > 0.0)
    if known.sum() < MIN_TRIPLES:
        return 1.0
    ratio = bend[known] / sigma[known]
    rest = ratio - ndimage.median_filter(ratio, 12 * lag + 1, mode="nearest")
    return float(max(1.0, 1.4826 * float(np.median(np.abs(rest)))))


def _typical(steps: Steps, fit: BoolArray) -> StepPriors | None:
    """Return typical parameters of the good fits, or None if there are too few."""
    noise = _median(steps.noise, fit)
    good = fit & steps.settled & (np.abs(steps.rise).min(axis=1) > MIN_SNR * noise)
    good &= steps.u_at_px.max(axis=1) < np.maximum(2.0 * float(np.median(steps.u_at_px)), 0.1)
    if good.sum() < MIN_GOOD_FITS:
        return None
    rise = float(np.median(np.abs(steps.rise[good]).max(axis=1)))
    return StepPriors(
        log_blur=np.log(np.median(steps.blur_px[good], axis=0)),
        u_log_blur=U_LOG_BLUR,
        slope_per_px=float(np.median(steps.slope_per_px[good])),
        u_slope_per_px=U_SLOPE_SHARE * rise,
        noise=noise,
    )


def _counted(bad: dict[str, BoolArray], count: int) -> tuple[BoolArray, dict[str, int]]:
    """Return a mask of the points that are not rejected, and the number of points rejected for each reason."""
    kept, rejected = np.ones(count, dtype=bool), {}
    for reason, flags in bad.items():
        rejected[reason] = int(np.sum(kept & flags))
        kept &= ~flags
    return kept, rejected


def _isolated(kept: BoolArray, inside: BoolArray) -> BoolArray:
    """Return points that are isolated: most of their neighbours in the image are not edges, so they are rejected."""
    shares = (ndimage.uniform_filter1d(flags.astype(float), ALONE_PLACES, mode="nearest") for flags in (kept, inside))
    own, all_of_them = shares
    return np.asarray(own < ALONE_SHARE * all_of_them)


def _near_outliers(odd: BoolArray) -> BoolArray:
    """Return outliers with `BESIDE` neighbours to either side, because an object on an edge fades out gradually."""
    return np.asarray(ndimage.binary_dilation(odd, iterations=BESIDE)) if odd.any() else odd


def _median(values: FloatArray, where: BoolArray) -> float:
    return float(np.median(values[where])) if where.any() else 0.0


def _off_neighbours(
    points: FloatArray, contour: FloatArray, normals: FloatArray, kept: BoolArray, closed: bool
) -> BoolArray:
    """Return points whose distance from the running median of their neighbours exceeds the scatter and half a pixel."""
    if int(kept.sum()) < NEIGHBOURS:
        return np.zeros(len(kept), dtype=bool)
    mode: Literal["wrap", "nearest"] = "wrap" if closed else "nearest"
    smooth = ndimage.uniform_filter1d(contour, 5, axis=0, mode=mode)
    offset = np.sum((points - smooth) * normals, axis=1)[kept]
    rest = offset - ndimage.median_filter(offset, NEIGHBOURS, mode=mode)
    scatter = 1.4826 * float(np.median(np.abs(rest)))
    off = np.zeros(len(kept), dtype=bool)
    off[kept] = np.abs(rest) > max(OFF_SIGMAS * scatter, OFF_PX)
    return off
