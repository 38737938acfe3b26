"""An index at one or a few wavelengths, extended to n(λ) with its uncertainty by the typical dispersion of polymers.

A refractometer or an ellipsometer measures n at the sodium line to 0.0005, ten times more accurately than R and T
determine it at any wavelength. The extrapolation, for example to 860 nm, is the same for all transparent polymers
except for two numbers: the Abbe number V, which describes how much n falls with wavelength, and the fraction s of this
fall that is quadratic in 1/λ² (see `solen.material.index.literature.Shape`). The literature provides both with a
standard deviation, as a prior; several measured values update it.

    n(λ) = n(λ0) + δ [(1 − s)(g − g0) + s (h − h0)],  δ = (n_d − 1)/V,

with g linear and h quadratic in 1/λ², both rising by 1 from line C to line F. This is a Cauchy formula with three
terms. The fitted parameter is the dispersive power 1/V, because n is nearly linear in it; the covariance of A, B and C
follows from exact derivatives.

`refractometer_index` uses `RefractometerOptions`, and `refractometer` a `Prior`, either from `prior_of` for polymer
classes or from `prior_of_abbe` for a given Abbe number. Both return a `RefractometerIndex`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator
from scipy.special import gammaincc

from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.material.dispersion import Cauchy
from solen.material.index.formulas import covariance_rows
from solen.material.index.illuminant import EvaluatedIndex, formula_in, lines, named_light
from solen.material.index.literature import (
    LINE_C,
    LINE_D,
    LINE_F,
    LINE_HELIUM,
    POLYMERS,
    RESINS,
    Polymer,
    check_index,
    materials,
)
from solen.ranks import Caution, warning
from solen.recording.model import Measured, Provenance
from solen.results import reported
from solen.spec.strict import Finite, NotBelow0, Options, Wavelength, refused
from solen.units import NM_PER_UM

VALID_NM = (400.0, 1000.0)
"""Range of the formula: the wavelengths covered by the literature used for the prior."""

DN_DT_PER_K = -2e-4
"""Temperature coefficient of n used by default; glassy acrylates have −1e-4, elastomers −3e-4 to −5e-4."""

STEP_NM = 5.0
"""Step between the wavelengths of a result."""
Z95 = 1.959963984540054
"""Half-width of the 95 % interval of a normal distribution, in standard deviations."""

_MAX_ITERATIONS = 30
_SIGNIFICANCE = 0.01  # p-value below which values and prior disagree
_STEP = 1e-30


@dataclass(frozen=True)
class Prior:
    """Prior of the dispersion of a polymer.

    Attributes
    ----------
    abbe, u_abbe
        Abbe number V = (n_d − 1)/(n_F − n_C) and its standard uncertainty, which is converted to one of 1/V.
    bend, u_bend
        Fraction of the rise from C to F that is due to the 1/λ⁴ term, and its standard uncertainty.
    source
        Source of the numbers, in words.
    """

    abbe: float
    u_abbe: float
    bend: float
    u_bend: float
    source: str

    def __post_init__(self) -> None:
        """Reject an impossible Abbe number."""
        if not 5.0 <= self.abbe <= 200.0:
            raise DataError("Abbe number", value=self.abbe, limit="must be from 5 to 200")
        if not 0.0 < self.u_abbe < self.abbe / 2:
            limit = f"must be above 0 and below half the Abbe number, {self.abbe / 2:g}"
            raise DataError("uncertainty of the Abbe number", value=self.u_abbe, limit=limit)

    @property
    def power(self) -> tuple[float, float]:
        """Dispersive power 1/V and its standard uncertainty."""
        return 1 / self.abbe, self.u_abbe / self.abbe**2


class _Values(NamedTuple):
    """Measured values: wavelengths and indices, shape (values,), and their covariance."""

    wavelength_nm: FloatArray
    n: FloatArray
    covariance: FloatArray


class RefractometerOptions(Options):
    """Options for extending an index measured at one or a few wavelengths."""

    u: tuple[float, ...] = Field(min_length=1)
    """Standard uncertainty of the index; one for all indices or, repeated, one for each."""
    wavelength_nm: tuple[float, ...] = ()
    """Wavelength of each index in nm; repeatable; default for a single index: the sodium line, 589.3."""
    u_shared: NotBelow0 = 0.0
    """Standard uncertainty common to all indices, due to the calibration."""
    u_temperature_k: NotBelow0 = 0.0
    """Standard uncertainty, in K, of the difference between the temperatures in use and during the measurement."""
    dn_dt_per_k: Finite = DN_DT_PER_K
    """Temperature coefficient of n per K, which converts --u-temperature-k to an uncertainty of n."""
    polymer: tuple[Polymer, ...] = ()
    """A polymer class similar to the material; repeatable; default: acrylate and photoresin."""
    abbe: float | None = None
    """Abbe number of the material, for example from a datasheet, instead of those of the polymer classes."""
    u_abbe: float | None = None
    """Standard uncertainty of the Abbe number."""
    at_nm: tuple[Annotated[Wavelength, Field(ge=VALID_NM[0], le=VALID_NM[1])], ...] = ()
    """A wavelength at which n is evaluated; repeatable."""
    led: str | None = None
    """An emitter for whose light n is evaluated: a part of the library, a part's .toml file, or a file with a
    spectrum.
    """

    @property
    def polymers(self) -> tuple[Polymer, ...]:
        """Polymer classes similar to the material."""
        return self.polymer or RESINS

    @model_validator(mode="after")
    def _check_abbe(self) -> Self:
        for missing, other in (("abbe", "u_abbe"), ("u_abbe", "abbe")):
            if getattr(self, missing) is None and getattr(self, other) is not None:
                raise refused(missing, f"is required with --{other.replace('_', '-')}", remedy="specify both")
        if self.abbe is not None and self.polymer:
            raise refused("polymer", "cannot be combined with --abbe", remedy="omit one of the two")
        return self


class RefractometerIndex(Measured, kw_only=True):
    """n(λ) from measured values at one or a few wavelengths and a prior of the dispersion.

    Attributes
    ----------
    mode
        How the index was determined: ``refractometer``.
    measurement
        Whether n was measured.
    measured_nm, measured_n, u_measured_n
        Wavelengths, measured values and their standard uncertainties, shape (values,).
    prior
        Prior of the dispersion.
    abbe, u_abbe, bend, u_bend
        Abbe number, and fraction of the rise from line C to F that is due to the 1/λ⁴ term, from the measured values
        and the prior combined, with their standard uncertainties.
    n_D, u_n_D
        Index at the sodium line, 589.3 nm, and its standard uncertainty.
    chi2, degrees_of_freedom
        χ² of the measured values and the prior, and the number of values minus one.
    fit
        Cauchy formula with the covariance of A, B and C.
    at
        n at the requested wavelengths.
    led
        n for the light of the requested emitter.
    options
        The options.
    """

    measured_nm: FloatArray
    measured_n: FloatArray
    u_measured_n: FloatArray
    prior: Prior
    abbe: float
    u_abbe: float
    bend: float
    u_bend: float
    n_D: float  # noqa: N815
    u_n_D: float  # noqa: N815
    chi2: float
    degrees_of_freedom: int
    fit: Cauchy
    mode: str = "refractometer"
    measurement: bool = True
    at: tuple[EvaluatedIndex, ...] = ()
    led: EvaluatedIndex | None = None
    options: RefractometerOptions | None = None
    sources: tuple[Provenance, ...] = (Provenance(format="stated", instrument="refractometer"),)

    @reported
    def wavelength_nm(self) -> FloatArray:
        """Wavelengths of the curve, every 5 nm over the range of the formula."""
        return np.arange(VALID_NM[0], VALID_NM[1] + STEP_NM / 2, STEP_NM)

    @reported
    def n(self) -> FloatArray:
        """Index at the wavelengths of the curve."""
        return self.fit.indices(self.wavelength_nm)[0]

    @reported
    def u_n(self) -> FloatArray:
        """Standard uncertainty of the index at the wavelengths of the curve."""
        return self.fit.indices(self.wavelength_nm)[1]

    @reported
    def interval95_n(self) -> FloatArray:
        """95 % interval of the index at the wavelengths of the curve, shape (n, 2)."""
        n, u_n = self.fit.indices(self.wavelength_nm)
        return np.stack([n - Z95 * u_n, n + Z95 * u_n], axis=1)


def refractometer_index(n: Sequence[float], options: RefractometerOptions) -> RefractometerIndex:
    """Return the index against wavelength from measured values, with warnings if the result contradicts the literature.

    Raises
    ------
    DataError, SpecError
        If a value is not an index, options contradict each other, or no polymer has the dispersion of the values.
    """
    if len(n) > 1 and not options.wavelength_nm:
        remedy = "specify it once for each index, in the same order"
        raise SpecError("--wavelength-nm", limit="is missing", remedy=remedy)
    abbe, u_abbe = options.abbe, options.u_abbe
    prior = prior_of(options.polymers) if abbe is None or u_abbe is None else prior_of_abbe(abbe, u_abbe)
    result = refractometer(
        n,
        options.u,
        options.wavelength_nm or LINE_D,
        u_shared=options.u_shared,
        u_temperature_k=options.u_temperature_k,
        dn_dt_per_k=options.dn_dt_per_k,
        prior=prior,
    )
    warnings = check_index(result.measured_nm, result.measured_n, result.u_measured_n, options.polymers, package=False)
    return replace(
        result,
        options=options,
        at=tuple(formula_in(result.fit, lines([nm], [1.0])) for nm in options.at_nm),
        led=None if options.led is None else formula_in(result.fit, named_light(options.led)),
        warnings=(*result.warnings, *warnings),
    )


def prior_of(polymers: Sequence[str] = RESINS) -> Prior:
    """Return the prior for a material of some polymer classes.

    Its standard deviations are predictive, √(1 + 1/N) times the scatter of N polymers. The bend is computed from all
    polymers, because it does not depend on the class.
    """
    entries = materials(polymers)
    abbe_numbers = {shape.abbe for entry in entries if (shape := entry.shape)}
    abbe_numbers |= {abbe for entry in entries for abbe in entry.abbe}
    bends = [shape.bend for entry in materials(POLYMERS) if (shape := entry.shape)]
    power, u_power = _predicted([1 / abbe for abbe in sorted(abbe_numbers)])
    bend, u_bend = _predicted(bends)
    names = " and ".join(f"{polymer}s" for polymer in polymers)
    range_text = f"from {min(abbe_numbers):.0f} to {max(abbe_numbers):.0f}"
    source = f"{len(abbe_numbers)} Abbe numbers of {names} {range_text} in the literature"
    return Prior(1 / power, u_power / power**2, bend, u_bend, source)


def _predicted(values: Sequence[float]) -> tuple[float, float]:
    """Return the mean, and the standard deviation with which it predicts one further value."""
    return float(np.mean(values)), float(np.std(values, ddof=1) * np.sqrt(1 + 1 / len(values)))


def prior_of_abbe(abbe: float, u_abbe: float) -> Prior:
    """Return a prior with a given Abbe number, for example from a datasheet, and the bend from the literature."""
    literature = prior_of()
    source = f"the specified Abbe number of {abbe:g} ± {u_abbe:g}"
    return Prior(abbe, u_abbe, literature.bend, literature.u_bend, source)


def refractometer(
    n: ArrayLike,
    u_n: ArrayLike,
    wavelength_nm: ArrayLike = LINE_D,
    *,
    u_shared: float = 0.0,
    u_temperature_k: float = 0.0,
    dn_dt_per_k: float = DN_DT_PER_K,
    prior: Prior | None = None,
) -> RefractometerIndex:
    """Return the index against wavelength from values at one or a few wavelengths.

    Parameters
    ----------
    n, u_n
        Indices and their standard uncertainties, above 0; one or several.
    wavelength_nm
        Wavelength of each index; default: the sodium line.
    u_shared
        Standard uncertainty common to all values, due to the calibration of the instrument.
    u_temperature_k
        Standard uncertainty of the difference between the temperatures in use and during the measurement.
    dn_dt_per_k
        Temperature coefficient of n, which converts ``u_temperature_k`` to an uncertainty of n.
    prior
        Prior of the dispersion; default: that of acrylates and printing resins.

    Raises
    ------
    DataError
        If a value is not an index, a wavelength is outside 400 to 1000 nm, or no polymer has the dispersion of the
        values.
    """
    prior = prior or prior_of()
    u_temperature = abs(dn_dt_per_k) * _not_negative("u_temperature_k", u_temperature_k)
    values = _values(n, u_n, wavelength_nm, u_temperature, u_shared)
    at_nm = float(values.wavelength_nm[np.abs(values.wavelength_nm - LINE_D).argmin()])
    fitted, covariance = _fitted(values, prior, at_nm)
    jacobian = _derivatives(lambda p: np.stack(_coefficients(p, at_nm)), fitted)
    a, b, c = (float(coefficient) for coefficient in _coefficients(fitted, at_nm))
    rows = covariance_rows(jacobian @ covariance @ jacobian.T)
    model = Cauchy(A=a, B_um2=b, C_um4=c, covariance=rows, valid_nm=VALID_NM)
    residuals = values.n - _index(fitted, at_nm, values.wavelength_nm)
    power, u_power = prior.power
    prior_residuals = (fitted[1] - power) / u_power, (fitted[2] - prior.bend) / prior.u_bend
    chi2 = float(
        residuals @ np.linalg.solve(values.covariance, residuals) + prior_residuals[0] ** 2 + prior_residuals[1] ** 2
    )
    u_fitted_power, u_bend = (float(np.sqrt(covariance[i, i])) for i in (1, 2))
    abbe, u_abbe = 1 / float(fitted[1]), u_fitted_power / float(fitted[1]) ** 2
    return RefractometerIndex(
        measured_nm=values.wavelength_nm,
        measured_n=values.n,
        u_measured_n=np.sqrt(np.diag(values.covariance)),
        prior=prior,
        abbe=abbe,
        u_abbe=u_abbe,
        bend=float(fitted[2]),
        u_bend=u_bend,
        n_D=model.index(LINE_D),
        u_n_D=float(model.u_index(LINE_D) or 0.0),
        chi2=chi2,
        degrees_of_freedom=values.n.size - 1,
        fit=model,
        warnings=tuple(_warnings(values, prior, model, (abbe, u_abbe), chi2)),
    )


def _not_negative(name: str, value: float) -> float:
    if not 0.0 <= value < np.inf:
        raise DataError(name, value=value, limit="must be at least 0")
    return value


def _values(n: ArrayLike, u_n: ArrayLike, wavelength_nm: ArrayLike, u_temperature: float, u_shared: float) -> _Values:
    """Return the measured values, with a covariance that includes their common errors."""
    values, nm = (np.atleast_1d(np.asarray(array, dtype=float)) for array in (n, wavelength_nm))
    u = np.atleast_1d(np.asarray(u_n, dtype=float))
    if values.ndim != 1 or values.size == 0 or nm.shape != values.shape or u.size not in {1, values.size}:
        sizes = f"{values.size} indices, {nm.size} wavelengths, {u.size} uncertainties"
        raise DataError(
            "refractometer", value=sizes, limit="one wavelength and one uncertainty are required for each index"
        )
    for name, invalid, array, limit in (
        ("n", ~((values > 1.0) & (values < 3.0)), values, "must be above 1 and below 3"),
        ("u_n", ~((u > 0.0) & (u < 0.5)), u, "must be above 0 and below 0.5"),
        ("wavelength_nm", ~((nm >= VALID_NM[0]) & (nm <= VALID_NM[1])), nm, "must be from 400 to 1000 nm"),
    ):
        if invalid.any():
            raise DataError(name, value=float(array[invalid][0]), limit=limit)
    shared = np.hypot(u_temperature, _not_negative("u_shared", u_shared))
    return _Values(nm, values, np.diag(np.broadcast_to(u, values.shape) ** 2) + shared**2)


def _fitted(values: _Values, prior: Prior, at_nm: float) -> tuple[FloatArray, FloatArray]:
    """Return n at a wavelength, 1/V and s with maximum posterior probability, and their covariance (Gauss-Newton)."""
    power, u_power = prior.power
    precision, expected = np.array([0.0, u_power**-2, prior.u_bend**-2]), np.array([0.0, power, prior.bend])
    weight = np.linalg.inv(values.covariance)
    fitted = np.array([float(values.n[np.abs(values.wavelength_nm - at_nm).argmin()]), power, prior.bend])
    for _ in range(_MAX_ITERATIONS):
        slope = _derivatives(lambda p: _index(p, at_nm, values.wavelength_nm), fitted)
        residuals = values.n - _index(fitted, at_nm, values.wavelength_nm)
        normal = slope.T @ weight @ slope + np.diag(precision)
        step = np.linalg.solve(normal, slope.T @ weight @ residuals + precision * (expected - fitted))
        fitted = fitted + step
        if (np.abs(step) < 1e-12 * (1 + np.abs(fitted))).all():
            break
    if not 1e-3 < fitted[1] < 0.1:
        limit = "the indices rise with wavelength, or fall more than those of any polymer"
        raise DataError("refractometer", limit=limit, remedy="check the wavelengths and their order")
    return fitted, np.asarray(np.linalg.inv(normal))


def _x(wavelength_nm: ArrayLike) -> FloatArray:
    return np.asarray((np.asarray(wavelength_nm, dtype=float) / NM_PER_UM) ** -2)


_F, _C, _D = (float(_x(line)) for line in (LINE_F, LINE_C, LINE_HELIUM))


def _coefficients(p: NDArray[Any], at_nm: float) -> tuple[Any, Any, Any]:
    """Return A, B and C for n at a wavelength, 1/V and s."""
    n, power, bend = p
    x = float(_x(at_nm))
    linear, square = (_D - x) / (_F - _C), (_D**2 - x**2) / (_F**2 - _C**2)
    delta = power * (n - 1) / (1 - power * ((1 - bend) * linear + bend * square))  # (n_d − 1)/V, n_d from the formula
    b, c = delta * (1 - bend) / (_F - _C), delta * bend / (_F**2 - _C**2)
    return n - b * x - c * x**2, b, c


def _index(p: NDArray[Any], at_nm: float, wavelength_nm: ArrayLike) -> FloatArray:
    a, b, c = _coefficients(p, at_nm)
    x = _x(wavelength_nm)
    return np.asarray(a + b * x + c * x**2)


def _derivatives(function: Callable[[NDArray[Any]], Any], p: FloatArray) -> FloatArray:
    """Return derivatives with respect to each parameter, computed by the complex-step method (exact)."""
    columns = []
    for i in range(p.size):
        shifted = p.astype(complex)
        shifted[i] += 1j * _STEP
        columns.append(np.asarray(function(shifted)).imag / _STEP)
    return np.stack(columns, axis=1)


def _warnings(values: _Values, prior: Prior, model: Cauchy, abbe: tuple[float, float], chi2: float) -> list[Caution]:
    """Return warnings about a result."""
    df = values.n.size - 1
    if df == 0:
        return [
            warning(
                "n was measured at a single wavelength; at other wavelengths, n is derived from "
                f"{prior.source}, V = {prior.abbe:.0f} ± {prior.u_abbe:.0f}, which "
                f"results in u(n) = {model.u_index(450.0):.4f} at 450 nm and {model.u_index(860.0):.4f} "
                "at 860 nm"
            )
        ]
    if gammaincc(df / 2, chi2 / 2) < _SIGNIFICANCE:
        return [
            warning(
                f"the measured values and the prior disagree (χ² = {chi2:.1f} with {df} degrees of freedom): "
                f"V = {abbe[0]:.1f} ± {abbe[1]:.1f} from both, {prior.abbe:.0f} ± {prior.u_abbe:.0f} from the prior; "
                "check the wavelengths and u(n)"
            )
        ]
    return []
