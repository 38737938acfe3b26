"""Linear fits to few points, with realistic intervals, for the cut-back and the working curve.

The level in dB against length and the cure depth against the logarithm of dose are straight lines. Realistic intervals
must account for repeated readings of one guide, which are not new guides; for scatter that may grow with the measured
value in a way that is only assumed; for the small number of points; and for outliers. A fit here is therefore a linear
model y = X β + Σ Z u + e: with random effects if there are groups, whose variances are determined by restricted maximum
likelihood; or, if the weights are a guess, with a covariance from the residuals. Intervals use t quantiles with
appropriate degrees of freedom, n − p in the simplest case. Outliers are found by Rosner's sequential test on deletion
residuals at a specified false-alarm rate; the calling code reports them.

`fitted` returns a `LinearFit`; `rosner_outliers` returns the points that a fit should omit; `t_quantile`, `t_tail` and
`f_tail` compute quantiles and tail probabilities.
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

FALSE_ALARM_RATE = 0.01
"""Fraction of data sets without an outlier in which `rosner_outliers` reports an outlier."""
MIN_DF = 0.25
"""Lower limit of the degrees of freedom of a covariance from residuals, as a fraction of n − p (decision 0028)."""
_MAX_ITERATIONS = 100
_MIN_VARIANCE_FRACTION = 1e-8  # variances below this fraction of their sum are negligible
_TINY = 1e-300
_MIN_EIGENVALUE = 1e-6  # smallest eigenvalue of the normalised overlap at which two effects are distinguishable
_ROUNDING = 1e-10  # residuals below this fraction of the data are rounding errors


@dataclass(frozen=True, eq=False)
class Components:
    """For k variance components: derivatives of the covariance of β, (k, p, p), and covariance of the components."""

    gradients: FloatArray
    covariance: FloatArray

    def df(self, contrast: FloatArray, variance: float) -> float:
        """Return the degrees of freedom of the variance of c·β (Satterthwaite, Biometrics Bulletin 2, 110, 1946)."""
        slope = np.array([contrast @ gradient @ contrast for gradient in self.gradients])
        spread = float(slope @ self.covariance @ slope)
        return 2.0 * variance**2 / spread if spread > 0.0 else math.inf


@dataclass(frozen=True, eq=False)
class Sandwich:
    """Covariance of β, estimated from the residuals.

    Attributes
    ----------
    design, rows
        X, (n, p), and the matrix that converts y to β, (p, n).
    variances, factors
        Assumed variances of e, and 1/(1 − h) with the leverage h of each point, (n,).
    """

    design: FloatArray
    rows: FloatArray
    variances: FloatArray
    factors: FloatArray

    def df(self, contrast: FloatArray, variance: float) -> float:  # noqa: ARG002
        """Return the degrees of freedom of the variance of c·β (Bell and McCaffrey, Survey Methodology 28, 169, 2002).

        The residuals have the covariance B = (I − H) V (I − H)ᵀ. If the variance of c·β is Σ wᵢ rᵢ² for residuals rᵢ,
        its degrees of freedom are (Σ wᵢ Bᵢᵢ)² / Σ wᵢ Bᵢⱼ² wⱼ. B is V plus W K Wᵀ with few columns in W, so that no n by
        n matrix is computed.
        """
        weights = (contrast @ self.rows) ** 2 * self.factors
        columns = np.column_stack([self.design, (self.rows * self.variances).T])
        p = len(self.rows)
        inner = np.zeros((2 * p, 2 * p))
        inner[:p, :p] = (self.rows * self.variances) @ self.rows.T
        inner[:p, p:] = inner[p:, :p] = -np.eye(p)
        corrections = np.sum(columns @ inner * columns, axis=1)
        product = inner @ (columns.T * weights) @ columns
        squares = weights**2 @ (self.variances**2 + 2.0 * self.variances * corrections) + np.trace(product @ product)
        return float(weights @ (self.variances + corrections)) ** 2 / float(squares) if squares > 0.0 else math.inf


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Result of `fitted`.

    Attributes
    ----------
    parameters, covariance
        β, shape (p,), and its covariance, (p, p).
    sigma, effect_sigmas
        Standard deviations of e at weight 1 and of each random effect; 0 for effects that the data do not show.
    error_df, min_df
        n − p, and the lower limit of the degrees of freedom.
    residuals
        y − X β, shape (n,).
    deletion_t
        Deviation of each point from a fit to the other points, in standard errors of that fit, shape (n,).
    criterion
        −2 ln of the restricted likelihood, up to a constant that depends only on X.
    estimator
        Estimator of the covariance, which determines its degrees of freedom.
    """

    parameters: FloatArray
    covariance: FloatArray
    sigma: float
    effect_sigmas: tuple[float, ...]
    error_df: int
    min_df: float
    residuals: FloatArray
    deletion_t: FloatArray
    criterion: float
    estimator: Components | Sandwich

    def df(self, contrast: ArrayLike) -> float:
        """Return the degrees of freedom of a combination c·β."""
        c = np.asarray(contrast, float)
        variance = float(c @ self.covariance @ c)
        df = self.estimator.df(c, variance) if variance > 0.0 else math.inf
        return max(min(df, float(self.error_df)), self.min_df)

    def u(self, contrast: ArrayLike) -> float:
        """Return the standard uncertainty of c·β."""
        c = np.asarray(contrast, float)
        return math.sqrt(max(float(c @ self.covariance @ c), 0.0))

    def interval(self, contrast: ArrayLike) -> tuple[float, float]:
        """Return the 95 % interval of c·β."""
        value = float(np.asarray(contrast, float) @ self.parameters)
        half = t_quantile(0.95, self.df(contrast)) * self.u(contrast)
        return value - half, value + half


def fitted(
    design: ArrayLike,
    y: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    effects: Sequence[FloatArray] = (),
    robust: bool = False,
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
        `group_covariance`. An effect that does not raise the likelihood, or that X fully represents, is omitted.
    robust
        Compute the covariance of β from the residuals, for weights that are a guess (HC2: MacKinnon and White, Journal
        of Econometrics 29, 305, 1985). Not with effects.
    """
    x, y = np.asarray(design, float), np.asarray(y, float)
    variances = np.ones(len(y)) if weights is None else 1.0 / np.asarray(weights, float)
    best = _without_effects(x, y, variances)
    if robust:
        return _from_residuals(best, x, variances)
    if effects and best.sigma > 0.0:
        noise, best = np.diag(variances), replace(best, effect_sigmas=(0.0,) * len(effects))
        complement = np.eye(len(y)) - x @ np.linalg.pinv(x)
        projected = [complement @ part @ complement for part in (noise, *effects)]
        for subset in [subset for count in (1, 2) for subset in combinations(range(len(effects)), count)]:
            parts = [noise, *(effects[k] for k in subset)]
            if not _distinguishable([projected[0], *(projected[k + 1] for k in subset)], parts):
                continue
            components = _variances(x, y, parts)
            if components.min() < _MIN_VARIANCE_FRACTION * components.sum():
                continue
            ratios = dict(zip(subset, (components[1:] / components[0]).tolist(), strict=True))
            fit = _with_effects(x, y, noise, effects, ratios)
            if fit.criterion < best.criterion - 1e-6:
                best = fit
    return best


def group_covariance(groups: Sequence[Hashable], factors: ArrayLike | None = None) -> FloatArray | None:
    """Return the covariance, up to a factor, of an effect shared within groups; None if no group has two points.

    ``factors``, shape (n,), multiply the effect, for slopes that differ between groups.
    """
    number = group_numbers(groups)
    same: FloatArray = (number[:, None] == number[None, :]).astype(float)
    if same.sum() == len(number):
        return None
    if factors is None:
        return same
    values = np.asarray(factors, dtype=float)
    return same * np.outer(values, values)


def rosner_outliers(fit: Callable[[BoolArray], LinearFit], count: int, max_outliers: int) -> dict[int, float]:
    """Return the outliers, each with its deletion residual t, the worst first.

    The worst point is removed up to ``max_outliers`` times; the last one whose t exceeds its Bonferroni quantile
    determines how many are reported, so that one outlier does not mask another (Rosner, Technometrics 25, 165, 1983).

    Parameters
    ----------
    fit
        Function that fits the points selected by a mask of shape (n,).
    count, max_outliers
        Number of points, and largest number of outliers.
    """
    keep = np.ones(count, bool)
    removed: list[tuple[int, float]] = []
    outliers = 0
    for _ in range(max_outliers):
        result = fit(keep)
        worst = int(np.argmax(np.abs(result.deletion_t)))
        t, df = float(result.deletion_t[worst]), result.error_df - 1
        index = int(np.flatnonzero(keep)[worst])
        removed.append((index, t))
        if df >= 1 and abs(t) > t_quantile(1.0 - FALSE_ALARM_RATE / int(keep.sum()), df):
            outliers = len(removed)
        keep[index] = False
    return dict(removed[:outliers])


def t_quantile(level: float, df: float) -> float:
    """Return the half width, in standard uncertainties, of the two-sided interval with this coverage."""
    return float(stdtrit(df, 0.5 + level / 2.0))


def t_tail(t: float, df: float) -> float:
    """Return the two-sided probability of a larger t by chance."""
    return float(2.0 * stdtr(df, -abs(t)))


def f_tail(ratio: float, between: float, within: float) -> float:
    """Return the probability of a larger ratio of variances by chance, given their degrees of freedom."""
    return float(fdtrc(between, within, ratio))


def frequency(p: float) -> str:
    """Return words for the probability that a table shows an effect by chance."""
    return "in less than 0.1 % of such tables" if p < 1e-3 else f"in {100.0 * p:.2g} % of such tables"


def group_means(labels: Sequence[L], values: ArrayLike) -> dict[L, float]:
    """Return the mean value for each label, in the order of first appearance."""
    number = group_numbers(labels)
    means = np.bincount(number, weights=np.asarray(values, float)) / np.bincount(number)
    return dict(zip(dict.fromkeys(labels), means.tolist(), strict=True))


def group_numbers(labels: Sequence[Hashable]) -> IndexArray:
    """Return the number of each label, counted from 0 in the order of first appearance."""
    numbers: dict[Hashable, int] = {}
    return np.array([numbers.setdefault(label, len(numbers)) for label in labels], np.intp)


def _distinguishable(projected: Sequence[FloatArray], parts: Sequence[FloatArray]) -> bool:
    """Whether X fully represents none of the covariances ``parts``, and their projections are linearly independent."""
    if any(np.abs(a).max() <= _ROUNDING * np.abs(part).max() for a, part in zip(projected, parts, strict=True)):
        return False
    units = [a / np.linalg.norm(a) for a in projected]
    return bool(np.linalg.eigvalsh([[np.sum(a * b) for b in units] for a in units]).min() > _MIN_EIGENVALUE)


def _variances(x: FloatArray, y: FloatArray, parts: Sequence[FloatArray]) -> FloatArray:
    """Return the restricted maximum-likelihood variances of the parts (Fisher scoring: Patterson and Thompson, 1971).

    If the data do not show a part, its variance ends at a negligible fraction of the others.
    """
    variances = np.full(len(parts), max(float(np.var(y)), _TINY) / len(parts))
    for _ in range(_MAX_ITERATIONS):
        inverse = np.linalg.inv(np.tensordot(variances, np.array(parts), 1))
        hat = inverse @ x
        projector = inverse - hat @ np.linalg.solve(x.T @ hat, hat.T)
        weighted = projector @ y
        products = [projector @ part for part in parts]
        information = np.array([[np.sum(a * b.T) for b in products] for a in products])
        update = np.linalg.lstsq(information, np.array([weighted @ part @ weighted for part in parts]))[0]
        update = np.maximum(update, 0.1 * variances)
        converged = np.max(np.abs(update - variances)) < 1e-6 * update.sum()
        variances = update
        if converged or update.min() < _MIN_VARIANCE_FRACTION * update.sum():
            break
    return variances


def _without_effects(x: FloatArray, y: FloatArray, variances: FloatArray) -> LinearFit:
    """Fit without effects, from the variances of e; this is `_with_effects` for diagonal matrices."""
    n, p = x.shape
    scaled = x / variances[:, None]
    unscaled = np.asarray(np.linalg.inv(x.T @ scaled), float)
    hat = scaled @ unscaled
    beta = hat.T @ y
    residuals = y - x @ beta
    weighted = residuals / variances
    squares, weighted = _without_rounding(float(residuals @ weighted), float(y @ (y / variances)), weighted)
    df = n - p
    variance = squares / df
    logs = float(np.sum(np.log(variances))) - np.linalg.slogdet(unscaled)[1]
    return LinearFit(
        parameters=beta,
        covariance=variance * unscaled,
        sigma=math.sqrt(variance),
        effect_sigmas=(),
        error_df=df,
        min_df=0.0,
        residuals=residuals,
        deletion_t=_deletion_t(weighted, (1.0 - np.sum(hat * x, 1)) / variances, squares, df),
        criterion=float(df * math.log(variance) + logs) if variance > 0.0 else -math.inf,
        estimator=Components(unscaled[None], np.array([[2.0 * variance**2 / df]])),
    )


def _with_effects(
    x: FloatArray, y: FloatArray, noise: FloatArray, effects: Sequence[FloatArray], ratios: Mapping[int, float]
) -> LinearFit:
    """Fit with random effects; ``ratios`` are variances of effects relative to that of e, keyed by effect number."""
    n, p = x.shape
    parts = [noise, *(effects[number] for number in ratios)]
    shape = noise + sum((ratio * effects[number] for number, ratio in ratios.items()), np.zeros_like(noise))
    inverse = np.linalg.inv(shape)
    unscaled = np.linalg.inv(x.T @ inverse @ x)
    hat = inverse @ x @ unscaled
    beta = hat.T @ y
    projector = inverse - hat @ x.T @ inverse  # its product with y is the weighted residual
    weighted = projector @ y
    df = n - p
    squares, weighted = _without_rounding(float(y @ weighted), float(y @ inverse @ y), weighted)
    variance = squares / df
    information = np.array([[0.5 * np.trace(projector @ a @ projector @ b) for b in parts] for a in parts])
    logs = np.linalg.slogdet(shape)[1] - np.linalg.slogdet(unscaled)[1]
    return LinearFit(
        parameters=beta,
        covariance=variance * unscaled,
        sigma=math.sqrt(variance),
        effect_sigmas=tuple(math.sqrt(ratios.get(number, 0.0) * variance) for number in range(len(effects))),
        error_df=df,
        min_df=0.0,
        residuals=y - x @ beta,
        deletion_t=_deletion_t(weighted, np.diag(projector), squares, df),
        criterion=float(df * math.log(variance) + logs) if variance > 0.0 else -math.inf,
        estimator=Components(
            gradients=np.array([hat.T @ part @ hat for part in parts]),
            covariance=variance**2 * np.linalg.inv(information),
        ),
    )


def _from_residuals(fit: LinearFit, x: FloatArray, variances: FloatArray) -> LinearFit:
    """Return the same fit with a covariance estimated from its residuals."""
    weighted = x / variances[:, None]
    rows = np.asarray(np.linalg.solve(x.T @ weighted, weighted.T), float)
    factors = 1.0 / np.maximum(1.0 - np.sum(x * rows.T, axis=1), _ROUNDING)
    covariance = (rows * (fit.residuals**2 * factors)) @ rows.T
    sandwich = Sandwich(x, rows, variances, factors)
    return replace(fit, covariance=covariance, estimator=sandwich, min_df=MIN_DF * fit.error_df)


def _without_rounding(squares: float, size: float, weighted: FloatArray) -> tuple[float, FloatArray]:
    """Return the sum of squares and the weighted residuals, or 0 if they are only rounding errors of the data."""
    return (squares, weighted) if squares > _ROUNDING**2 * size else (0.0, np.zeros_like(weighted))


def _deletion_t(weighted: FloatArray, diagonal: FloatArray, squares: float, df: int) -> FloatArray:
    """Return each point's residual from a fit to the other points, in standard errors; 0 if undetermined."""
    if squares == 0.0 or df < 2:
        return np.zeros(len(weighted))
    determined = diagonal > _ROUNDING * diagonal.max()
    divisor = np.where(determined, diagonal, 1.0)
    others = np.maximum(squares - weighted**2 / divisor, 1e-12 * squares) / (df - 1)
    return np.where(determined, weighted / np.sqrt(divisor * others), 0.0)
