"""Surrogate of a figure of merit: a polynomial in the varying parameters, fitted to traced samples and cross-validated.

The basis is orthonormal under the distributions of the variables (polynomial chaos: Hermite polynomials for normal,
Legendre polynomials for uniform ones), so that Sobol' indices are sums of squared coefficients (Sudret, Reliability
Engineering & System Safety 93, 964, 2008). The degree is that with the smallest error on held-out samples.

Public names: `fit` and `Surrogate`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from solen.arrays import BoolArray, FloatArray, IntArray
from solen.explore.variations import Variation

MAX_DEGREE, SAMPLES_PER_TERM = 12, 3
PATIENCE = 3
"""Largest number of degrees tried after the best one."""
FOLDS = 8
"""Number of cross-validation folds."""


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Polynomial in D variables with T terms.

    Attributes
    ----------
    variations
        The variables.
    degrees
        (T, D) degree of each term in each variable; the first term is constant.
    coefficients
        Coefficients (T,) of the terms.
    held_out
        Fraction of the variance of held-out samples that the polynomial does not explain.
    folds
        (FOLDS, T) coefficients fitted without each fold of the samples.
    """

    variations: tuple[Variation, ...]
    degrees: IntArray
    coefficients: FloatArray
    held_out: float
    folds: FloatArray

    def __call__(self, deviations: FloatArray, fold: int | None = None) -> FloatArray:
        """Return values (N,) at deviations (N, D); with ``fold``, those of the polynomial fitted without that fold."""
        coefficients = self.coefficients if fold is None else self.folds[fold]
        return np.asarray(_terms(self.variations, self.degrees, deviations) @ coefficients)

    @property
    def degree(self) -> int:
        """Degree of the polynomial."""
        return int(self.degrees.sum(axis=1).max())

    @cached_property
    def first_order(self) -> FloatArray:
        """First-order Sobol' indices (D,): fraction of variance due to each variable alone; NaN without variance."""
        univariate = (self.degrees > 0).sum(axis=1) == 1
        return self._variance_fractions((self.degrees > 0) & univariate[:, None])

    @cached_property
    def total(self) -> FloatArray:
        """Total Sobol' indices (D,): fraction of the variance due to each variable, including its interactions."""
        return self._variance_fractions(self.degrees > 0)

    def _variance_fractions(self, terms: BoolArray) -> FloatArray:
        variance = self.coefficients[1:] @ self.coefficients[1:]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray((self.coefficients**2 @ terms) / variance)


def fit(variations: Sequence[Variation], deviations: FloatArray, values: FloatArray) -> Surrogate:
    """Fit a surrogate to values (N,) at deviations (N, D); samples without a finite value are omitted.

    The folds of the cross-validation are those of `fold_indices`.
    """
    finite = np.isfinite(values)
    fold = fold_indices(values.size)[finite]
    best: Surrogate | None = None
    for degree in range(MAX_DEGREE + 1):
        degrees = _degrees(len(variations), degree)
        last = best is not None and degree - best.degree > PATIENCE
        if last or (degree and SAMPLES_PER_TERM * len(degrees) > fold.size):
            break
        surrogate = _fitted(tuple(variations), degrees, deviations[finite], values[finite], fold)
        if best is None or surrogate.held_out < best.held_out:
            best = surrogate
    assert best is not None  # noqa: S101  degree 0 always fits
    return best


def fold_indices(samples: int) -> IntArray:
    """Return a cross-validation fold (N,), 0 to FOLDS − 1, for each sample, assigned at random.

    Folds of every n-th sample would not do, because every n-th Sobol' point is in the same part of the cube.
    """
    return np.asarray(np.random.default_rng(0).permutation(samples) % FOLDS)


def _fitted(
    variations: tuple[Variation, ...], degrees: IntArray, deviations: FloatArray, values: FloatArray, fold: IntArray
) -> Surrogate:
    terms = _terms(variations, degrees, deviations)
    folds = np.array([np.linalg.lstsq(terms[fold != k], values[fold != k])[0] for k in range(FOLDS)])
    residual = values - (terms * folds[fold]).sum(axis=1)
    variance = float(values.var())
    held_out = float((residual**2).mean()) / variance if variance > 0.0 else 0.0
    coefficients = np.asarray(np.linalg.lstsq(terms, values)[0], dtype=np.float64)
    return Surrogate(variations, degrees, coefficients, held_out, folds)


def _degrees(variables: int, highest: int) -> IntArray:
    """Return the degrees (T, variables) of all terms up to a total degree, the constant term first."""
    terms = (
        factors for degree in range(highest + 1) for factors in combinations_with_replacement(range(variables), degree)
    )
    return np.array([np.bincount(np.array(factors, dtype=int), minlength=variables) for factors in terms])


def _terms(variations: Sequence[Variation], degrees: IntArray, deviations: FloatArray) -> FloatArray:
    """Return the values (N, T) of the terms."""
    product = np.ones((deviations.shape[0], len(degrees)))
    for k, variation in enumerate(variations):
        variable = variation.standard(deviations[:, k])
        basis = np.array([variation.polynomial(degree, variable) for degree in range(degrees[:, k].max() + 1)])
        product *= basis[degrees[:, k]].T
    return product
