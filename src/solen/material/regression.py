"""Lines through few points, with realistic intervals, for the cut-back and the working curve.

A loss and a working curve are straight lines if powers are in dB and doses are logarithms. The validity of their
intervals depends on other properties: readings of the same guide are not new guides, scatter may grow with the measured
value in a way that is only assumed, there are few points, and one of them may be bad. A fit here is therefore a linear
model y = X β + Σ Z u + e, with random effects if there are groups, whose variances are found by restricted maximum
likelihood; or, if the weights are a guess, with a covariance from the residuals. Intervals use t quantiles with
appropriate degrees of freedom, which are n − p in the plain case. Bad points are found by Rosner's sequential test on
deletion residuals at a specified false-alarm rate; the calling code reports them.

`fitted` returns a `LinearFit`; `rosner_outliers` returns the points that a fit should omit; `t_quantile`, `t_tail` and
`f_tail` compute quantiles and tails.
"""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import fdtrc, stdtr, stdtrit

from solen.arrays import BoolArray, FloatArray, IndexArray

L = TypeVar("L", bound=Hashable)

FALSE_ALARMS = 0.01
"""Fraction of data sets without a bad point in which `rosner_outliers` reports one."""
MIN_DF = 0.25
"""Lower limit of the degrees of freedom of a covariance from residuals, as a fraction of n − p (decision 0028)."""
_SCORINGS, _NOTHING, _TINY = 100, 1e-8, 1e-300
_ALIKE = 1e-6  # smallest eigenvalue of the normalised overlap at which two effects are distinguishable
_EXACT = 1e-10  # residuals below this fraction of the data are rounding errors


@dataclass(frozen=True, eq=False)
class Components:
    """Estimated variances: derivatives of the covariance by each, (k, p, p), and their covariance, (k, k)."""

    gradients: FloatArray
    variances: FloatArray

    def df(self, contrast: FloatArray, variance: float) -> float:
        """Return degrees of freedom of a combination's variance (Satterthwaite, Biometrics Bulletin 2, 110, 1946)."""
        slope = np.array([contrast @ gradient @ contrast for gradient in self.gradients])
        spread = float(slope @ self.variances @ slope)
        return 2.0 * variance**2 / spread if spread > 0.0 else math.inf


@dataclass(frozen=True, eq=False)
class Sandwich:
    """A covariance from the residuals.

    Attributes
    ----------
    design, rows
        X, (n, p), and the matrix that converts y to β, (p, n).
    each, raised
        Assumed variances of e, and 1/(1 − h) with each point's leverage h, (n,).
    """

    design: FloatArray
    rows: FloatArray
    each: FloatArray
    raised: FloatArray

    def df(self, contrast: FloatArray, variance: float) -> float:  # noqa: ARG002
        """Return degrees of freedom of a combination's variance (Bell and McCaffrey, Survey Methodology 28, 169, 2002).

        Residuals covary as B = (I − H) V (I − H)ᵀ; with fractions s of the variance the degrees of freedom are (Σ s B)²
        / Σ s B² s. B is V plus W K Wᵀ with few columns, so no n by n matrix is computed.
        """
        shares = (contrast @ self.rows) ** 2 * self.raised
        columns = np.column_stack([self.design, (self.rows * self.each).T])
        p = len(self.rows)
        inner = np.zeros((2 * p, 2 * p))
        inner[:p, :p] = (self.rows * self.each) @ self.rows.T
        inner[:p, p:] = inner[p:, :p] = -np.eye(p)
        corrections = np.sum(columns @ inner * columns, axis=1)
        weighed = inner @ (columns.T * shares) @ columns
        squares = shares**2 @ (self.each**2 + 2.0 * self.each * corrections) + np.trace(weighed @ weighed)
        return float(shares @ (self.each + corrections)) ** 2 / float(squares) if squares > 0.0 else math.inf


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Result of `fitted`.

    Attributes
    ----------
    parameters, covariance
        β, shape (p,), and its covariance, (p, p).
    sigma, effect_sigmas
        Standard deviations of e at weight 1 and of each random effect; 0 for effects that the data do not show.
    error_df, least_df
        n − p, and the lower limit of degrees of freedom.
    residuals
        y − X β, shape (n,).
    deletion_t
        Deviation of each point from the fit of the others, in standard errors estimated without it, shape (n,).
    criterion
        −2 ln of the restricted likelihood, up to a constant that depends only on X.
    known_by
        Source of the covariance, which determines its degrees of freedom.
    """

    parameters: FloatArray
    covariance: FloatArray
    sigma: float
    effect_sigmas: tuple[float, ...]
    error_df: int
    least_df: float
    residuals: FloatArray
    deletion_t: FloatArray
    criterion: float
    known_by: Components | Sandwich

    def df(self, contrast: ArrayLike) -> float:
        """Return the degrees of freedom of a combination c·β."""
        c = np.asarray(contrast, float)
        variance = float(c @ self.covariance @ c)
        inf = self.known_by.df(c, variance) if variance > 0.0 else math.inf
        return max(min(inf, float(self.error_df)), self.least_df)

    def u(self, contrast: ArrayLike) -> float:
        """Return the standard uncertainty of c·β."""
        c = np.asarray(contrast, float)
        return math.sqrt(max(float(c @ self.covariance @ c), 0.0))

    def interval(self, contrast: ArrayLike) -> tuple[float, float]:
        """Return the 95 % interval of c·β."""
        middle = float(np.asarray(contrast, float) @ self.parameters)
        half = t_quantile(0.95, self.df(contrast)) * self.u(contrast)
        return middle - half, middle + half


def fitted(
    design: ArrayLike,
    y: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    effects: Sequence[FloatArray] = (),
    guessed: bool = False,
) -> LinearFit:
    """Fit y = X β + Σ Z u + e.

    Parameters
    ----------
    design
        X, shape (n, p), of full rank, n > p.
    y
        Shape (n,).
    weights
        Reciprocal variances of e, up to a factor, shape (n,).
    effects
        Random effects, at most two: for each, the covariance of its part of y, up to a factor, shape (n, n), as from
        `shared`. An effect that does not raise the likelihood, or that X fully represents, is omitted.
    guessed
        The weights are a guess: compute the covariance of β from the residuals (HC2: MacKinnon and White, Journal of
        Econometrics 29, 305, 1985). Not with effects.
    """
    x, y = np.asarray(design, float), np.asarray(y, float)
    each = np.ones(len(y)) if weights is None else 1.0 / np.asarray(weights, float)
    best = _plain(x, y, each)
    if guessed:
        return _from_residuals(best, x, each)
    if effects and best.sigma > 0.0:
        own, best = np.diag(each), replace(best, effect_sigmas=(0.0,) * len(effects))
        across = np.eye(len(y)) - x @ np.linalg.pinv(x)
        seen = [across @ part @ across for part in (own, *effects)]
        for shown in [subset for count in (1, 2) for subset in combinations(range(len(effects)), count)]:
            if not _distinguishable([seen[0], *(seen[k + 1] for k in shown)], [own, *(effects[k] for k in shown)]):
                continue
            variances = _variances(x, y, [own, *(effects[number] for number in shown)])
            if variances.min() < _NOTHING * variances.sum():
                continue
            fit = _at(x, y, own, effects, dict(zip(shown, (variances[1:] / variances[0]).tolist(), strict=True)))
            if fit.criterion < best.criterion - 1e-6:
                best = fit
    return best


def shared(groups: Sequence[Hashable], of: ArrayLike | None = None) -> FloatArray | None:
    """Return the covariance, up to a factor, of an effect shared within groups; None if no group has two points.

    ``of``, shape (n,), multiplies the effect, for slopes that differ between groups.
    """
    number = ranks(groups)
    same = (number[:, None] == number[None, :]).astype(float)
    if same.sum() == len(number):
        return None
    return same if of is None else np.asarray(same * np.multiply.outer(np.asarray(of, float), np.asarray(of, float)))


def rosner_outliers(fit: Callable[[BoolArray], LinearFit], points: int, most: int) -> dict[int, float]:
    """Return points that do not fit the others, each with its deletion residual t, the worst first.

    The worst point is removed up to ``most`` times; the last one whose t exceeds its Bonferroni quantile determines how
    many are reported, so that one outlier does not mask another (Rosner, Technometrics 25, 165, 1983).

    Parameters
    ----------
    fit
        Function that fits the points selected by a mask of shape (n,).
    points, most
        Number of points, and the largest number of outliers.
    """
    keep = np.ones(points, bool)
    found: list[tuple[int, float]] = []
    bad = 0
    for _ in range(most):
        here = fit(keep)
        left = int(keep.sum())
        worst = int(np.argmax(np.abs(here.deletion_t)))
        t, df = float(here.deletion_t[worst]), here.error_df - 1
        index = int(np.flatnonzero(keep)[worst])
        found.append((index, t))
        if df >= 1 and abs(t) > t_quantile(1.0 - FALSE_ALARMS / left, df):
            bad = len(found)
        keep[index] = False
    return dict(found[:bad])


def t_quantile(level: float, df: float) -> float:
    """Return the half width, in standard uncertainties, of the two-sided interval with this coverage."""
    return float(stdtrit(df, 0.5 + level / 2.0))


def t_tail(t: float, df: float) -> float:
    """Return the two-sided probability of a larger t by chance."""
    return float(2.0 * stdtr(df, -abs(t)))


def f_tail(ratio: float, between: float, within: float) -> float:
    """Return the probability of a larger ratio of variances by chance."""
    return float(fdtrc(between, within, ratio))


def chance(p: float) -> str:
    """Describe the probability that a result occurs by chance."""
    return "in less than 0.1 % of such tables" if p < 1e-3 else f"in {100.0 * p:.2g} % of such tables"


def group_means(labels: Sequence[L], values: ArrayLike) -> dict[L, float]:
    """Return the mean value for each label, in the order of first appearance."""
    number = ranks(labels)
    means = np.bincount(number, weights=np.asarray(values, float)) / np.bincount(number)
    return dict(zip(dict.fromkeys(labels), means.tolist(), strict=True))


def ranks(labels: Sequence[Hashable]) -> IndexArray:
    """Return the number of each label, counted from 0 in the order of first appearance."""
    seen: dict[Hashable, int] = {}
    return np.array([seen.setdefault(label, len(seen)) for label in labels], np.intp)


def _distinguishable(seen: Sequence[FloatArray], parts: Sequence[FloatArray]) -> bool:
    """Whether each covariance has a part that X does not represent, and no two of these parts are the same."""
    if any(np.abs(left).max() <= _EXACT * np.abs(part).max() for left, part in zip(seen, parts, strict=True)):
        return False
    units = [left / np.linalg.norm(left) for left in seen]
    return bool(np.linalg.eigvalsh([[np.sum(a * b) for b in units] for a in units]).min() > _ALIKE)


def _variances(x: FloatArray, y: FloatArray, parts: Sequence[FloatArray]) -> FloatArray:
    """Return the restricted maximum-likelihood variances of the parts (Fisher scoring: Patterson and Thompson, 1971).

    If the data do not show a part, its variance ends at a negligible fraction of the others.
    """
    variances = np.full(len(parts), max(float(np.var(y)), _TINY) / len(parts))
    for _ in range(_SCORINGS):
        inverse = np.linalg.inv(np.tensordot(variances, np.array(parts), 1))
        hat = inverse @ x
        projector = inverse - hat @ np.linalg.solve(x.T @ hat, hat.T)
        pulled = projector @ y
        pushed = [projector @ part for part in parts]
        information = np.array([[np.sum(a * b.T) for b in pushed] for a in pushed])
        better = np.linalg.lstsq(information, np.array([pulled @ part @ pulled for part in parts]))[0]
        better = np.maximum(better, 0.1 * variances)
        done = np.max(np.abs(better - variances)) < 1e-6 * better.sum() or better.min() < _NOTHING * better.sum()
        variances = better
        if done:
            break
    return variances


def _plain(x: FloatArray, y: FloatArray, each: FloatArray) -> LinearFit:
    """Fit without effects, from the variances of e; this is `_at` with diagonal matrices."""
    n, p = x.shape
    weighted = x / each[:, None]
    unscaled = np.asarray(np.linalg.inv(x.T @ weighted), float)
    hat = weighted @ unscaled
    beta = hat.T @ y
    residuals = y - x @ beta
    pulled = residuals / each
    squares, pulled = _exact(float(residuals @ pulled), float(y @ (y / each)), pulled)
    df = n - p
    variance = squares / df
    logs = float(np.sum(np.log(each))) - np.linalg.slogdet(unscaled)[1]
    return LinearFit(
        parameters=beta,
        covariance=variance * unscaled,
        sigma=math.sqrt(variance),
        effect_sigmas=(),
        error_df=df,
        least_df=0.0,
        residuals=residuals,
        deletion_t=_deletion_t(pulled, (1.0 - np.sum(hat * x, 1)) / each, squares, df),
        criterion=float(df * math.log(variance) + logs) if variance > 0.0 else -math.inf,
        known_by=Components(unscaled[None], np.array([[2.0 * variance**2 / df]])),
    )


def _at(
    x: FloatArray, y: FloatArray, own: FloatArray, effects: Sequence[FloatArray], ratios: Mapping[int, float]
) -> LinearFit:
    """Fit at given ratios of the variances of the effects to that of e."""
    n, p = x.shape
    parts = [own, *(effects[number] for number in ratios)]
    shape = own + sum((ratio * effects[number] for number, ratio in ratios.items()), np.zeros_like(own))
    inverse = np.linalg.inv(shape)
    unscaled = np.linalg.inv(x.T @ inverse @ x)
    hat = inverse @ x @ unscaled
    beta = hat.T @ y
    projector = inverse - hat @ x.T @ inverse  # P: its product with y is the weighted residual
    pulled = projector @ y
    df = n - p
    squares, pulled = _exact(float(y @ pulled), float(y @ inverse @ y), pulled)
    variance = squares / df
    information = np.array([[0.5 * np.trace(projector @ a @ projector @ b) for b in parts] for a in parts])
    logs = np.linalg.slogdet(shape)[1] - np.linalg.slogdet(unscaled)[1]
    return LinearFit(
        parameters=beta,
        covariance=variance * unscaled,
        sigma=math.sqrt(variance),
        effect_sigmas=tuple(math.sqrt(ratios.get(number, 0.0) * variance) for number in range(len(effects))),
        error_df=df,
        least_df=0.0,
        residuals=y - x @ beta,
        deletion_t=_deletion_t(pulled, np.diag(projector), squares, df),
        criterion=float(df * math.log(variance) + logs) if variance > 0.0 else -math.inf,
        known_by=Components(
            gradients=np.array([hat.T @ part @ hat for part in parts]),
            variances=variance**2 * np.linalg.inv(information),
        ),
    )


def _from_residuals(fit: LinearFit, x: FloatArray, each: FloatArray) -> LinearFit:
    """Return the same fit with a covariance estimated from its residuals."""
    weighted = x / each[:, None]
    rows = np.asarray(np.linalg.solve(x.T @ weighted, weighted.T), float)
    raised = 1.0 / np.maximum(1.0 - np.sum(x * rows.T, axis=1), _EXACT)
    covariance = (rows * (fit.residuals**2 * raised)) @ rows.T
    sandwich = Sandwich(x, rows, each, raised)
    return replace(fit, covariance=covariance, known_by=sandwich, least_df=MIN_DF * fit.error_df)


def _exact(squares: float, size: float, pulled: FloatArray) -> tuple[float, FloatArray]:
    """Return the sum of squares and weighted residuals, set to 0 if they are only rounding errors of the data."""
    return (squares, pulled) if squares > _EXACT**2 * size else (0.0, np.zeros_like(pulled))


def _deletion_t(pulled: FloatArray, diagonal: FloatArray, squares: float, df: int) -> FloatArray:
    """Return each point's residual from the fit of the others in standard errors, or 0 if that is undetermined."""
    if squares == 0.0 or df < 2:
        return np.zeros(len(pulled))
    judged = diagonal > _EXACT * diagonal.max()
    room = np.where(judged, diagonal, 1.0)
    others = np.maximum(squares - pulled**2 / room, 1e-12 * squares) / (df - 1)
    return np.where(judged, pulled / np.sqrt(room * others), 0.0)
