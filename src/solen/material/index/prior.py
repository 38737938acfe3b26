"""An index at one wavelength or a few, and n(λ) with its uncertainty from what polymers have in common.

The idea: a refractometer or an ellipsometer gives n at the sodium line to 0.0005, ten times better than spectra give it
anywhere. What it does not give, the way to 860 nm, is the same for all transparent polymers but for two numbers: how
much n falls, by the Abbe number V, and how much of that fall bends (see `solen.material.index.literature.Shape`). Both
are known from the literature with a spread, which is a prior; the measured values move it where they are several.

    n(λ) = n(λ0) + δ [(1 − s)(g − g0) + s (h − h0)],  δ = (n_d − 1)/V,

with g linear and h quadratic in 1/λ², both rising by 1 from line C to line F. It is a Cauchy formula of three terms.
The dispersion is carried as its power w = 1/V, in which n is linear, so that the covariance of A, B and C follows by
exact derivatives and covers the few polymers with a small V too.

The interface: `prior_of` classes of polymers, or `Prior` with an Abbe number of your own; `refractometer`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincc

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.dispersion import Cauchy
from solen.material.index.literature import LINE_C, LINE_D, LINE_F, LINE_HELIUM, POLYMERS, RESINS, materials
from solen.units import NM_PER_UM

VALID_NM = (400.0, 1000.0)
"""Where the formula is told: the wavelengths that the literature behind the prior covers."""

DN_DT_PER_K = -2e-4
"""Temperature coefficient of n taken where none is stated; glassy acrylates have −1e-4, elastomers −3e-4 to −5e-4."""

_STEPS = 30
_SURE = 0.01  # chance below which values and prior count as at odds
_STEP = 1e-30


@dataclass(frozen=True)
class Prior:
    """What is expected of a polymer's dispersion before it is measured.

    Attributes
    ----------
    abbe, u_abbe
        Abbe number V = (n_d − 1)/(n_F − n_C) and its standard uncertainty, which is taken as one of 1/V.
    share, u_share
        Part of the rise from C to F that the 1/λ⁴ term makes, and its standard uncertainty.
    source
        Where the numbers are from, in words.
    """

    abbe: float
    u_abbe: float
    share: float
    u_share: float
    source: str

    def __post_init__(self) -> None:
        """Refuse what is no Abbe number."""
        if not 5.0 <= self.abbe <= 200.0:
            raise DataError("Abbe number", value=self.abbe, limit="must be from 5 to 200")
        if not 0.0 < self.u_abbe < self.abbe / 2:
            limit = f"must be above 0 and below half of V = {self.abbe:g}"
            raise DataError("uncertainty of the Abbe number", value=self.u_abbe, limit=limit)

    @property
    def power(self) -> tuple[float, float]:
        """Dispersive power 1/V and its standard uncertainty."""
        return 1 / self.abbe, self.u_abbe / self.abbe**2


@dataclass(frozen=True)
class Values:
    """What an instrument measured.

    Attributes
    ----------
    wavelength_nm, n
        Shape (values,).
    covariance
        Shape (values, values).
    """

    wavelength_nm: FloatArray
    n: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class Refractometer:
    """n(λ) from values at a few wavelengths and a prior.

    Attributes
    ----------
    model
        Cauchy formula with the covariance of A, B and C.
    values, prior
        What went in.
    abbe, u_abbe, share, u_share
        Dispersion that values and prior say together.
    n_line, u_line
        Index at the sodium line, 589.3 nm.
    chi2, freedom
        Misfit of values and prior, in squares of their uncertainties, and how many values there are beyond one.
    warnings
        What the numbers cannot be used for.
    """

    model: Cauchy
    values: Values
    prior: Prior
    abbe: float
    u_abbe: float
    share: float
    u_share: float
    n_line: float
    u_line: float
    chi2: float
    freedom: int
    warnings: tuple[str, ...]

    def index(self, wavelength_nm: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Index and its standard uncertainty at wavelengths from 400 to 1000 nm."""
        at = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
        n = np.array([self.model.index(float(one)) for one in at])
        return n, np.array([self.model.u_index(float(one)) or 0.0 for one in at])


def prior_of(polymers: Sequence[str] = RESINS) -> Prior:
    """Prior of a new material of some classes of polymers: mean and spread of 1/V of those in the literature.

    The spread is that of a further one, √(1 + 1/N) times the scatter of N. The bend is taken from all polymers, as it
    does not depend on the class.
    """
    members = materials(polymers)
    numbers = {shape.abbe for one in members if (shape := one.shape)} | {v for one in members for v in one.abbe}
    shares = [shape.share for one in materials(POLYMERS) if (shape := one.shape)]
    power, u_power = _mean([1 / abbe for abbe in sorted(numbers)])
    share, u_share = _mean(shares)
    names = " and ".join(f"{polymer}s" for polymer in polymers)
    source = f"{len(numbers)} Abbe numbers of {names} from {min(numbers):.0f} to {max(numbers):.0f} in the literature"
    return Prior(1 / power, u_power / power**2, share, u_share, source)


def _mean(values: Sequence[float]) -> tuple[float, float]:
    """Mean, and the spread of a further one."""
    return float(np.mean(values)), float(np.std(values, ddof=1) * np.sqrt(1 + 1 / len(values)))


def stated_prior(abbe: float, u_abbe: float) -> Prior:
    """Prior with an Abbe number of your own, from a data sheet say; the bend is that of the literature."""
    usual = prior_of()
    return Prior(abbe, u_abbe, usual.share, usual.u_share, f"an Abbe number of {abbe:g} ± {u_abbe:g} as stated")


def refractometer(
    n: ArrayLike,
    u_n: ArrayLike,
    wavelength_nm: ArrayLike = LINE_D,
    *,
    u_shared: float = 0.0,
    u_temperature_k: float = 0.0,
    dn_dt_per_k: float = DN_DT_PER_K,
    prior: Prior | None = None,
) -> Refractometer:
    """Index against wavelength from values at one wavelength or a few.

    Parameters
    ----------
    n, u_n
        Indices and their standard uncertainties, above 0; one or several.
    wavelength_nm
        Of each; the sodium line where not said.
    u_shared
        Standard uncertainty that all values share: the calibration of the instrument.
    u_temperature_k
        Standard uncertainty of the temperature at which the index is used, about that at which it was measured.
    dn_dt_per_k
        Temperature coefficient that makes an error of n of it.
    prior
        Of the dispersion; that of acrylates and printing resins where not said.

    Raises
    ------
    DataError
        Where a value is none, lies outside 400 to 1000 nm, or nothing like the values has such a dispersion.
    """
    prior = prior or prior_of()
    values = _values(
        n, u_n, wavelength_nm, abs(dn_dt_per_k) * _not_negative("u_temperature_k", u_temperature_k), u_shared
    )
    at = float(values.wavelength_nm[np.abs(values.wavelength_nm - LINE_D).argmin()])
    found, covariance = _fitted(values, prior, at)
    turn = _derivatives(lambda p: np.stack(_coefficients(p, at)), found)
    a, b, c = (float(one) for one in np.stack(_coefficients(found, at)))
    spread = turn @ covariance @ turn.T
    spread = (spread + spread.T) / 2
    model = Cauchy(
        A=a,
        B_um2=b,
        C_um4=c,
        covariance=tuple(tuple(float(one) for one in row) for row in spread),
        valid_nm=VALID_NM,
    )
    misfit = values.n - _index(found, at, values.wavelength_nm)
    power, u_power = prior.power
    off = (found[1] - power) / u_power, (found[2] - prior.share) / prior.u_share
    chi2 = float(misfit @ np.linalg.solve(values.covariance, misfit) + off[0] ** 2 + off[1] ** 2)
    u_found, u_share = (float(np.sqrt(covariance[i, i])) for i in (1, 2))
    abbe, u_abbe = 1 / float(found[1]), u_found / float(found[1]) ** 2
    return Refractometer(
        model,
        values,
        prior,
        abbe,
        u_abbe,
        float(found[2]),
        u_share,
        model.index(LINE_D),
        float(model.u_index(LINE_D) or 0.0),
        chi2,
        values.n.size - 1,
        tuple(_warnings(values, prior, model, (abbe, u_abbe), chi2)),
    )


def _not_negative(name: str, value: float) -> float:
    if not 0.0 <= value < np.inf:
        raise DataError(name, value=value, limit="must be at least 0")
    return value


def _values(n: ArrayLike, u_n: ArrayLike, wavelength_nm: ArrayLike, u_warm: float, u_shared: float) -> Values:
    """Values that were measured, with the covariance of what they share."""
    values, nm = (np.atleast_1d(np.asarray(one, dtype=float)) for one in (n, wavelength_nm))
    u = np.atleast_1d(np.asarray(u_n, dtype=float))
    if values.ndim != 1 or values.size == 0 or nm.shape != values.shape or u.size not in {1, values.size}:
        sizes = f"{values.size} indices, {nm.size} wavelengths, {u.size} uncertainties"
        raise DataError(
            "refractometer", value=sizes, limit="must be one wavelength for each index, and one uncertainty"
        )
    for name, wrong, each, limit in (
        ("n", ~((values > 1.0) & (values < 3.0)), values, "must be above 1 and below 3"),
        ("u_n", ~((u > 0.0) & (u < 0.5)), u, "must be above 0 and below 0.5"),
        ("wavelength_nm", ~((nm >= VALID_NM[0]) & (nm <= VALID_NM[1])), nm, "must be from 400 to 1000 nm"),
    ):
        if wrong.any():
            raise DataError(name, value=float(each[wrong][0]), limit=limit)
    shared = np.hypot(u_warm, _not_negative("u_shared", u_shared))
    return Values(nm, values, np.diag(np.broadcast_to(u, values.shape) ** 2) + shared**2)


def _fitted(values: Values, prior: Prior, at: float) -> tuple[FloatArray, FloatArray]:
    """N at a wavelength, V and s of the greatest probability, and their covariance, by Gauss and Newton."""
    power, u_power = prior.power
    known, expected = np.array([0.0, u_power**-2, prior.u_share**-2]), np.array([0.0, power, prior.share])
    weight = np.linalg.inv(values.covariance)
    found = np.array([float(values.n[np.abs(values.wavelength_nm - at).argmin()]), power, prior.share])
    for _ in range(_STEPS):
        slope = _derivatives(lambda p: _index(p, at, values.wavelength_nm), found)
        off = values.n - _index(found, at, values.wavelength_nm)
        normal = slope.T @ weight @ slope + np.diag(known)
        pull = slope.T @ weight @ off + known * (expected - found)
        step = np.linalg.solve(normal, pull)
        found = found + step
        if (np.abs(step) < 1e-12 * (1 + np.abs(found))).all():
            break
    if not 1e-3 < found[1] < 0.1:
        limit = "the values rise with the wavelength, or fall as no polymer's do"
        raise DataError("refractometer", limit=limit, remedy="check their wavelengths and their order")
    return found, np.asarray(np.linalg.inv(normal))


def _x(wavelength_nm: ArrayLike) -> FloatArray:
    return np.asarray((np.asarray(wavelength_nm, dtype=float) / NM_PER_UM) ** -2)


_F, _C, _D = (float(_x(line)) for line in (LINE_F, LINE_C, LINE_HELIUM))


def _coefficients(p: NDArray[Any], at: float) -> tuple[Any, Any, Any]:
    """A, B and C of n at a wavelength, 1/V and s."""
    n, power, share = p
    x = float(_x(at))
    linear, square = (_D - x) / (_F - _C), (_D**2 - x**2) / (_F**2 - _C**2)
    delta = power * (n - 1) / (1 - power * ((1 - share) * linear + share * square))  # (n_d − 1)/V, n_d by the formula
    b, c = delta * (1 - share) / (_F - _C), delta * share / (_F**2 - _C**2)
    return n - b * x - c * x**2, b, c


def _index(p: NDArray[Any], at: float, wavelength_nm: ArrayLike) -> FloatArray:
    a, b, c = _coefficients(p, at)
    x = _x(wavelength_nm)
    return np.asarray(a + b * x + c * x**2)


def _derivatives(function: Callable[[NDArray[Any]], Any], p: FloatArray) -> FloatArray:
    """Derivatives by each parameter, by a complex step: exact."""
    columns = []
    for i in range(p.size):
        moved = p.astype(complex)
        moved[i] += 1j * _STEP
        columns.append(np.asarray(function(moved)).imag / _STEP)
    return np.stack(columns, axis=1)


def _warnings(values: Values, prior: Prior, model: Cauchy, abbe: tuple[float, float], chi2: float) -> list[str]:
    """What the numbers of a result cannot be used for."""
    freedom = values.n.size - 1
    if freedom == 0:
        return [
            "one wavelength was measured; how n changes from there on is not measured but expected, from "
            f"{prior.source}: V = {prior.abbe:.0f} ± {prior.u_abbe:.0f}, which makes u(n) "
            f"{model.u_index(450.0):.4f} at 450 nm and {model.u_index(860.0):.4f} at 860 nm"
        ]
    if gammaincc(freedom / 2, chi2 / 2) < _SURE:
        return [
            f"values and prior are at odds (χ² = {chi2:.1f} for {freedom}): together they say V = {abbe[0]:.1f} ± "
            f"{abbe[1]:.1f}, expected was {prior.abbe:.0f} ± {prior.u_abbe:.0f}; check the wavelengths and u(n)"
        ]
    return []
