"""A surrogate of a merit: a polynomial of the varying numbers, fitted to traced samples and tested on others.

The polynomials are orthonormal under the distributions of their variables (polynomial chaos: Hermite for normal,
Legendre for uniform ones), which makes Sobol' indices sums of squared coefficients (Sudret, Reliability Engineering &
System Safety 93, 964, 2008). The degree is that with the smallest error on held-out samples.

Public names: `fit` and `Surrogate`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from solen.arrays import BoolArray, FloatArray, IntArray
from solen.explore.variations import Variation

MAX_DEGREE, SAMPLES_A_TERM = 12, 3
PATIENCE = 3
"""Number of degrees without improvement after which no higher degree is tried."""
FOLDS = 8
"""Number of cross-validation folds."""


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Polynomial of D variables with T terms.

    Attributes
    ----------
    variations
        The variables.
    degrees
        (T, D) degree of each term in each variable; the constant first.
    coefficients
        Coefficients (T,) of the terms.
    held_out
        Fraction of the variance of held-out samples that the polynomial does not explain.
    folds
        (FOLDS, T) coefficients fitted without each part of the samples.
    """

    variations: tuple[Variation, ...]
    degrees: IntArray
    coefficients: FloatArray
    held_out: float
    folds: FloatArray

    def __call__(self, deviations: FloatArray, fold: int | None = None) -> FloatArray:
        """Return values (N,) at deviations (N, D); with ``fold``, of the polynomial fitted without that part."""
        coefficients = self.coefficients if fold is None else self.folds[fold]
        return np.asarray(_terms(self.variations, self.degrees, deviations) @ coefficients)

    @property
    def degree(self) -> int:
        """Degree of the polynomial."""
        return int(self.degrees.sum(axis=1).max())

    @cached_property
    def first_order(self) -> FloatArray:
        """First-order Sobol' indices (D,): fraction of variance due to each variable alone; NaN without variance."""
        alone = (self.degrees > 0).sum(axis=1) == 1
        return self._shares((self.degrees > 0) & alone[:, None])

    @cached_property
    def total(self) -> FloatArray:
        """Total Sobol' indices (D,): the fraction of the variance due to each variable, with its interactions."""
        return self._shares(self.degrees > 0)

    def _shares(self, counted: BoolArray) -> FloatArray:
        variance = self.coefficients[1:] @ self.coefficients[1:]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray((self.coefficients**2 @ counted) / variance)


def fit(variations: Sequence[Variation], deviations: FloatArray, values: FloatArray) -> Surrogate:
    """Fit a surrogate to values (N,) at deviations (N, D); samples without a finite value are omitted.

    The held-out parts are those of `parts`.
    """
    part = parts(values.size)
    finite = np.isfinite(values)
    known, part = deviations[finite], part[finite]
    best: Surrogate | None = None
    for degree in range(MAX_DEGREE + 1):
        degrees = _degrees(len(variations), degree)
        last = best is not None and degree - best.degree > PATIENCE
        if last or (degree and SAMPLES_A_TERM * len(degrees) > values[finite].size):
            break
        made = _fitted(tuple(variations), degrees, known, values[finite], part)
        if best is None or made.held_out < best.held_out:
            best = made
    assert best is not None  # noqa: S101  degree 0 always fits
    return best


def parts(number: int) -> IntArray:
    """Return the part, 0 to `FOLDS` − 1, of each sample; shuffled, as every n-th Sobol' point is in a corner."""
    return np.asarray(np.random.default_rng(0).permutation(number) % FOLDS)


def _fitted(
    variations: tuple[Variation, ...], degrees: IntArray, deviations: FloatArray, values: FloatArray, part: IntArray
) -> Surrogate:
    terms = _terms(variations, degrees, deviations)
    folds = np.array([np.linalg.lstsq(terms[part != k], values[part != k])[0] for k in range(FOLDS)])
    missed = values - (terms * folds[part]).sum(axis=1)
    variance = float(values.var())
    held_out = float((missed**2).mean()) / variance if variance > 0.0 else 0.0
    coefficients = np.asarray(np.linalg.lstsq(terms, values)[0], dtype=np.float64)
    return Surrogate(variations, degrees, coefficients, held_out, folds)


def _degrees(variables: int, highest: int) -> IntArray:
    """Return the degrees (T, variables) of all terms up to a total degree, the constant first."""
    chosen = (
        terms for degree in range(highest + 1) for terms in combinations_with_replacement(range(variables), degree)
    )
    return np.array([np.bincount(np.array(terms, dtype=int), minlength=variables) for terms in chosen])


def _terms(variations: Sequence[Variation], degrees: IntArray, deviations: FloatArray) -> FloatArray:
    """Return the values (N, T) of the terms."""
    product = np.ones((deviations.shape[0], len(degrees)))
    for place, variation in enumerate(variations):
        variable = variation.standard(deviations[:, place])
        powers = np.array([variation.polynomial(degree, variable) for degree in range(degrees[:, place].max() + 1)])
        product *= powers[degrees[:, place]].T
    return product
