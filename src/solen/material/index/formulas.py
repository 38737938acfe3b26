"""The fitted formulas, in parameters that are suitable for a fit, and their conversion to the usual coefficients.

Over a short wavelength range, A, B and C of Cauchy's formula are strongly correlated, and so are B and C of
Sellmeier's. A fit therefore uses other parameters: coefficients of Legendre polynomials in 1/λ², scaled to the range of
the points; the straight line of 1/(n² − 1) against 1/λ² for a single Sellmeier term; and logarithms for two terms.

`CauchyForm`, `OnePole` and `TwoPoles` are `Form`s, with the methods `start`, `value`, `check` and `model`. A form
raises `UnfitError` if it cannot follow the points.
"""

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.polynomial import legendre

from solen.arrays import FloatArray
from solen.material.dispersion import Cauchy, Sellmeier
from solen.units import NM_PER_UM

_MAX_RESONANCE = 0.97  # ratio of a resonance to the lower end of the range, or of the upper end to a resonance
_RESONANCES_UM = (0.01, 200.0)  # range of the search for resonances
_MAX_RELATIVE_U = 0.5  # relative uncertainty above which a coefficient is not determined


class UnfitError(Exception):
    """Reason why a formula cannot be fitted to the points, as the predicate of a sentence."""


def _scaled(um: FloatArray) -> tuple[FloatArray, float, float]:
    """Return 1/λ², scaled to the range from −1 to 1, and the centre and half width of its range."""
    x = um**-2
    centre, half = float(x.max() + x.min()) / 2, float(x.max() - x.min()) / 2 or 1.0
    return (x - centre) / half, centre, half


class Form(ABC):
    """A formula at given wavelengths, in terms of its inner parameters."""

    size: int

    @abstractmethod
    def start(self, um: FloatArray, n: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the initial inner parameters."""

    @abstractmethod
    def value(self, inner: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the index, shape (points,), and its derivatives, shape (points, size)."""

    def check(self, inner: FloatArray) -> None:  # noqa: B027  most forms have no limits
        """Raise `UnfitError` if no transparent material can have these parameters."""

    def check_covariance(self, inner: FloatArray, covariance: FloatArray) -> None:  # noqa: B027
        """Raise `UnfitError` if linear propagation of the uncertainty would be meaningless."""

    @abstractmethod
    def model(self, inner: FloatArray, covariance: FloatArray, range_nm: tuple[float, float]) -> Cauchy | Sellmeier:
        """Return the formula with its usual coefficients."""


class CauchyForm(Form):
    """n as a polynomial in 1/λ², with Legendre polynomials over the range of the points."""

    def __init__(self, um: FloatArray, terms: int) -> None:
        self.size = terms
        t, self._centre, self._half = _scaled(um)
        self._slope: FloatArray = legendre.legvander(t, terms - 1).astype(float)

    def start(self, um: FloatArray, n: FloatArray, weights: FloatArray) -> FloatArray:  # noqa: ARG002
        """Return zeros: the formula is linear, so its first step is the solution."""
        return np.zeros(self.size)

    def value(self, inner: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the index and its derivatives."""
        return self._slope @ inner, self._slope

    def model(self, inner: FloatArray, covariance: FloatArray, range_nm: tuple[float, float]) -> Cauchy:
        """Return Cauchy's formula; coefficients of omitted terms are exactly 0."""
        matrix = np.zeros((3, self.size))
        for j in range(self.size):
            powers = legendre.leg2poly(np.eye(self.size)[j])
            for i, factor in enumerate(powers):
                shifted = np.polynomial.Polynomial((-self._centre / self._half, 1 / self._half)) ** i
                matrix[: i + 1, j] += factor * shifted.coef
        a, b, c = (float(coefficient) for coefficient in matrix @ inner)
        covariance = matrix @ covariance @ matrix.T
        return Cauchy(A=a, B_um2=b, C_um4=c, covariance=covariance_rows(covariance), valid_nm=range_nm)


class OnePole(Form):
    """Sellmeier's formula with a single term.

    1/(n² − 1) = 1/B − (C/B)/λ² is a straight line, whose value at the centre and slope are the inner parameters.
    """

    size = 2

    def __init__(self, um: FloatArray) -> None:
        self._um = um
        self._t, self._centre, self._half = _scaled(um)

    def start(self, um: FloatArray, n: FloatArray, weights: FloatArray) -> FloatArray:  # noqa: ARG002
        """Return the straight line fitted to 1/(n² − 1), with weights propagated from n."""
        if (n <= 1).any():
            raise UnfitError(f"requires indices above 1, but one index is {float(n.min()):.4g}")
        y = 1 / (n**2 - 1)
        weight = weights / (2 * n * y**2)  # dy = −2n y² dn
        line = np.stack([np.ones_like(y), self._t], axis=1)
        return np.asarray(np.linalg.lstsq(weight[:, None] * line, weight * y, rcond=None)[0])

    def value(self, inner: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the index and its derivatives."""
        y = inner[0] + inner[1] * self._t
        with np.errstate(all="ignore"):
            n = np.sqrt(1 + 1 / y)
            by_y = -1 / (2 * n * y**2)
        return n, np.stack([by_y, by_y * self._t], axis=1)

    def _line(self, inner: FloatArray) -> tuple[float, float]:
        """Return 1/B and C/B."""
        slope = inner[1] / self._half
        return float(inner[0] - slope * self._centre), float(-slope)

    def check(self, inner: FloatArray) -> None:
        """Reject an index that rises with wavelength, and a resonance inside the range."""
        constant, slope = self._line(inner)
        if slope < 0:
            raise UnfitError("has no resonance that would produce this index, which rises with wavelength")
        if constant <= 0 or math.sqrt(slope / constant) >= self._um.min():
            raise UnfitError("has its resonance inside the range of the points")

    def model(self, inner: FloatArray, covariance: FloatArray, range_nm: tuple[float, float]) -> Sellmeier:
        """Return Sellmeier's formula with one term."""
        constant, slope = self._line(inner)
        line = np.array([[1.0, -self._centre / self._half], [0.0, -1 / self._half]])
        matrix = np.array([[-1 / constant**2, 0.0], [-slope / constant**2, 1 / constant]]) @ line
        rows = covariance_rows(matrix @ covariance @ matrix.T)
        return Sellmeier(B=(1 / constant,), C_um2=(slope / constant,), covariance=rows, valid_nm=range_nm)


class TwoPoles(Form):
    """Sellmeier's formula with two terms; the inner parameters are the logarithms of B1, B2, C1 and C2.

    The second resonance is below or above the range of the points.
    """

    size = 4

    def __init__(self, um: FloatArray) -> None:
        self._square = um**2

    def start(self, um: FloatArray, n: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the better of two bounded fits, with a second resonance in the ultraviolet and in the infrared."""
        from scipy.optimize import least_squares

        def residuals(z: FloatArray) -> FloatArray:
            return np.asarray(weights * (n - self.value(z)[0]))

        def jacobian(z: FloatArray) -> FloatArray:
            return np.asarray(-weights[:, None] * self.value(z)[1])

        one_pole = OnePole(um)
        line = one_pole.start(um, n, weights)
        one_pole.check(line)
        constant, slope = one_pole._line(line)
        b, c = 1 / constant, max(slope / constant, _RESONANCES_UM[0] ** 2)
        lowest, highest = (2 * math.log(end) for end in _RESONANCES_UM)
        below, above = 2 * math.log(_MAX_RESONANCE * um.min()), 2 * math.log(um.max() / _MAX_RESONANCE)
        starts = (  # start, and bounds of the logarithm of the second C
            ((b / 2, b / 2, c / 2, c * 1.5), lowest, below),
            ((b, b / 50, c, (3 * um.max()) ** 2), above, highest),
        )
        fits = []
        for start, second_low, second_high in starts:
            low = np.array([-12.0, -12.0, lowest, second_low])
            high = np.array([3.0, 8.0, below, second_high])
            fit = least_squares(
                residuals,
                np.clip(np.log(start), low + 1e-6, high - 1e-6),
                jac=jacobian,
                bounds=(low, high),
                x_scale="jac",
                ftol=1e-15,
                xtol=1e-15,
                gtol=1e-15,
                max_nfev=100,
            )
            fits.append(fit)
        best = min(fits, key=lambda fit: float(fit.cost))
        if best.active_mask.any():
            raise UnfitError("has a second term at the limit of the allowed range: a single term suffices")
        return np.asarray(best.x)

    def value(self, inner: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the index and its derivatives."""
        with np.errstate(all="ignore"):
            b, c = np.exp(inner[:2]), np.exp(inner[2:])
            difference = self._square[:, None] - c
            terms = b * self._square[:, None] / difference
            n = np.sqrt(1 + terms.sum(axis=1))
            derivatives = np.concatenate([terms, terms * c / difference], axis=1) / (2 * n[:, None])
        return n, derivatives

    def check(self, inner: FloatArray) -> None:
        """Reject a resonance inside the range."""
        c = np.exp(inner[2:])
        if ((c >= self._square.min()) & (c <= self._square.max())).any():
            raise UnfitError("has a resonance inside the range of the points")

    def check_covariance(self, inner: FloatArray, covariance: FloatArray) -> None:  # noqa: ARG002
        """Reject coefficients that the points do not determine."""
        largest_u = float(np.sqrt(np.diag(covariance).max()))
        if not largest_u < _MAX_RELATIVE_U:
            raise UnfitError(
                f"leaves a coefficient uncertain by {100 * largest_u:.3g} %: these points do not resolve two terms"
            )

    def model(self, inner: FloatArray, covariance: FloatArray, range_nm: tuple[float, float]) -> Sellmeier:
        """Return Sellmeier's formula with two terms, starting with the resonance at the shorter wavelength."""
        values = np.exp(inner)
        covariance = np.outer(values, values) * covariance
        order = [0, 1, 2, 3] if values[2] <= values[3] else [1, 0, 3, 2]
        b1, b2, c1, c2 = (float(value) for value in values[order])
        return Sellmeier(
            B=(b1, b2), C_um2=(c1, c2), covariance=covariance_rows(covariance[np.ix_(order, order)]), valid_nm=range_nm
        )


def covariance_rows(covariance: FloatArray) -> tuple[tuple[float, ...], ...]:
    """Return the rows of a covariance, exactly symmetric, for a file."""
    symmetric = (covariance + covariance.T) / 2
    return tuple(tuple(row) for row in symmetric.tolist())


def resonance_nm(model: Sellmeier) -> tuple[float, ...]:
    """Return the wavelengths of the resonances of a formula in nm."""
    return tuple(math.sqrt(c) * NM_PER_UM for c in model.C_um2)
