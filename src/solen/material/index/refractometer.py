"""An index at one or a few wavelengths, extended to n(λ) with uncertainty by the common behaviour of polymers.

A refractometer or an ellipsometer measures n at the sodium line to 0.0005, ten times more accurately than spectra do
anywhere. The extrapolation to 860 nm, where it does not measure, is the same for all transparent polymers except for
two numbers: how much n falls, given by the Abbe number V, and how strongly that fall curves (see
`solen.material.index.literature.Shape`). The literature provides both with a standard deviation, which is a prior; if
several values are measured, they update it.

    n(λ) = n(λ0) + δ [(1 − s)(g − g0) + s (h − h0)],  δ = (n_d − 1)/V,

with g linear and h quadratic in 1/λ², both rising by 1 from line C to line F. This is a Cauchy formula with three
terms. The dispersion is represented by its power w = 1/V, in which n is linear, so the covariance of A, B and C follows
from exact derivatives and covers the few polymers with a small V too.

`refractometer_index` uses `RefractometerOptions`, and `refractometer` a `Prior`, either from `prior_of` for polymer
classes or from `stated_prior` for a given Abbe number. Both return a `RefractometerIndex`.
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
from solen.material.index.illuminant import Evaluated, formula_in, lines, named_light
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
WIDE95 = 1.959963984540054
"""Half of the 95 % interval of a normal distribution, in standard deviations."""

_STEPS = 30
_SURE = 0.01  # probability below which values and prior disagree
_STEP = 1e-30


@dataclass(frozen=True)
class Prior:
    """Prior of a polymer's dispersion.

    Attributes
    ----------
    abbe, u_abbe
        Abbe number V = (n_d − 1)/(n_F − n_C) and its standard uncertainty, which is converted to one of 1/V.
    bend, u_bend
        Fraction of the rise from C to F that is due to the 1/λ⁴ term, and its standard uncertainty.
    source
        Origin of the numbers, in words.
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
            limit = f"must be above 0 and below half of V = {self.abbe:g}"
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
    """Standard uncertainty of the index: one for all, or repeated, one for each index."""
    wavelength_nm: tuple[float, ...] = ()
    """Wavelength of each index in nm; repeatable; default for a single index: the sodium line, 589.3."""
    u_shared: NotBelow0 = 0.0
    """Standard uncertainty shared by all values, from the calibration."""
    u_temperature_k: NotBelow0 = 0.0
    """Standard uncertainty, in K, of the difference between the temperatures in use and during the measurement."""
    dn_dt_per_k: Finite = DN_DT_PER_K
    """Temperature coefficient of n by which that uncertainty is multiplied."""
    polymer: tuple[Polymer, ...] = ()
    """A polymer class that the material resembles; repeatable; default: acrylate and photoresin."""
    abbe: float | None = None
    """Abbe number of the material, for example from a data sheet, instead of that of the class."""
    u_abbe: float | None = None
    """Standard uncertainty of the Abbe number."""
    at_nm: tuple[Annotated[Wavelength, Field(ge=VALID_NM[0], le=VALID_NM[1])], ...] = ()
    """A wavelength at which n is evaluated; repeatable."""
    led: str | None = None
    """An emitter in whose light n is evaluated: a part from the library, a part's .toml file, or a file with a
    spectrum.
    """

    @property
    def polymers(self) -> tuple[Polymer, ...]:
        """Polymer classes that the material resembles."""
        return self.polymer or RESINS

    @model_validator(mode="after")
    def _abbe_is_whole(self) -> Self:
        for missing, there in (("abbe", "u_abbe"), ("u_abbe", "abbe")):
            if getattr(self, missing) is None and getattr(self, there) is not None:
                raise refused(missing, f"is required with --{there.replace('_', '-')}", remedy="specify both")
        if self.abbe is not None and self.polymer:
            raise refused("polymer", "cannot be combined with --abbe", remedy="specify one of the two")
        return self


class RefractometerIndex(Measured, kw_only=True):
    """n(λ) from values at a few wavelengths and a prior.

    Attributes
    ----------
    mode
        How the index was determined: ``refractometer``.
    measurement
        Whether n was measured.
    measured_nm, measured_n, u_measured_n
        Input values with their wavelengths and standard uncertainties, shape (values,).
    prior
        Prior of the dispersion.
    abbe, u_abbe, bend, u_bend
        Abbe number, and the fraction of the rise from line C to F that is due to the 1/λ⁴ term, from values and prior
        combined.
    n_D, u_n_D
        Index at the sodium line, 589.3 nm, and its standard uncertainty.
    chi2, degrees_of_freedom
        Misfit of values and prior, in squares of their uncertainties, and the number of values minus one.
    fit
        Cauchy formula with the covariance of A, B and C.
    at
        n at the requested wavelengths.
    led
        n in the light of the requested emitter.
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
    at: tuple[Evaluated, ...] = ()
    led: Evaluated | None = None
    options: RefractometerOptions | None = None
    sources: tuple[Provenance, ...] = (Provenance(format="stated", instrument="refractometer"),)

    @reported
    def wavelength_nm(self) -> FloatArray:
        """Wavelengths of the curve: every 5 nm over the range of the formula."""
        return np.arange(VALID_NM[0], VALID_NM[1] + STEP_NM / 2, STEP_NM)

    @reported
    def n(self) -> FloatArray:
        """Index along the curve."""
        return self.fit.along(self.wavelength_nm)[0]

    @reported
    def u_n(self) -> FloatArray:
        """Standard uncertainty of the index along the curve."""
        return self.fit.along(self.wavelength_nm)[1]

    @reported
    def interval95_n(self) -> FloatArray:
        """95 % interval of the index along the curve, shape (n, 2)."""
        n, u_n = self.fit.along(self.wavelength_nm)
        return np.stack([n - WIDE95 * u_n, n + WIDE95 * u_n], axis=1)


def refractometer_index(n: Sequence[float], options: RefractometerOptions) -> RefractometerIndex:
    """Return the index against wavelength from measured values, with a comparison with the literature.

    Raises
    ------
    DataError, SpecError
        If a value is not an index, options contradict each other, or no polymer has the required dispersion.
    """
    if len(n) > 1 and not options.wavelength_nm:
        remedy = "specify it once for each index, in the same order"
        raise SpecError("--wavelength-nm", limit="is missing", remedy=remedy)
    stated = options.abbe is not None and options.u_abbe is not None
    prior = stated_prior(options.abbe, options.u_abbe) if stated else prior_of(options.polymers)  # type: ignore[arg-type]
    result = refractometer(
        n,
        options.u,
        options.wavelength_nm or LINE_D,
        u_shared=options.u_shared,
        u_temperature_k=options.u_temperature_k,
        dn_dt_per_k=options.dn_dt_per_k,
        prior=prior,
    )
    unlike = check_index(result.measured_nm, result.measured_n, result.u_measured_n, options.polymers, package=False)
    return replace(
        result,
        options=options,
        at=tuple(formula_in(result.fit, lines([nm], [1.0])) for nm in options.at_nm),
        led=None if options.led is None else formula_in(result.fit, named_light(options.led)),
        warnings=(*result.warnings, *unlike),
    )


def prior_of(polymers: Sequence[str] = RESINS) -> Prior:
    """Return the prior for a material in some polymer classes: mean and standard deviation of 1/V.

    The standard deviation is predictive, √(1 + 1/N) times the scatter of N polymers. The bend is computed from all
    polymers, because it does not depend on the class.
    """
    members = materials(polymers)
    numbers = {shape.abbe for member in members if (shape := member.shape)} | {
        v for member in members for v in member.abbe
    }
    bends = [shape.bend for material in materials(POLYMERS) if (shape := material.shape)]
    power, u_power = _mean([1 / abbe for abbe in sorted(numbers)])
    bend, u_bend = _mean(bends)
    names = " and ".join(f"{polymer}s" for polymer in polymers)
    source = f"{len(numbers)} Abbe numbers of {names} from {min(numbers):.0f} to {max(numbers):.0f} in the literature"
    return Prior(1 / power, u_power / power**2, bend, u_bend, source)


def _mean(values: Sequence[float]) -> tuple[float, float]:
    """Return the mean, and the predictive standard deviation of one further value."""
    return float(np.mean(values)), float(np.std(values, ddof=1) * np.sqrt(1 + 1 / len(values)))


def stated_prior(abbe: float, u_abbe: float) -> Prior:
    """Return a prior with a given Abbe number, for example from a data sheet, and the literature's bend."""
    usual = prior_of()
    return Prior(abbe, u_abbe, usual.bend, usual.u_bend, f"an Abbe number of {abbe:g} ± {u_abbe:g} as specified")


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
    """Return the index against wavelength from values at one wavelength or a few.

    Parameters
    ----------
    n, u_n
        Indices and their standard uncertainties, above 0; one or several.
    wavelength_nm
        Wavelength of each index; default: the sodium line.
    u_shared
        Standard uncertainty shared by all values: the calibration of the instrument.
    u_temperature_k
        Standard uncertainty of the difference between the temperatures in use and during the measurement.
    dn_dt_per_k
        Temperature coefficient that converts it to an error of n.
    prior
        Prior of the dispersion; default: that of acrylates and printing resins.

    Raises
    ------
    DataError
        If a value is not an index, a wavelength is outside 400 to 1000 nm, or no polymer has the required dispersion.
    """
    prior = prior or prior_of()
    values = _values(
        n, u_n, wavelength_nm, abs(dn_dt_per_k) * _not_negative("u_temperature_k", u_temperature_k), u_shared
    )
    at = float(values.wavelength_nm[np.abs(values.wavelength_nm - LINE_D).argmin()])
    found, covariance = _fitted(values, prior, at)
    turn = _derivatives(lambda p: np.stack(_coefficients(p, at)), found)
    a, b, c = (float(one) for one in np.stack(_coefficients(found, at)))
    model = Cauchy(A=a, B_um2=b, C_um4=c, covariance=covariance_rows(turn @ covariance @ turn.T), valid_nm=VALID_NM)
    misfit = values.n - _index(found, at, values.wavelength_nm)
    power, u_power = prior.power
    off = (found[1] - power) / u_power, (found[2] - prior.bend) / prior.u_bend
    chi2 = float(misfit @ np.linalg.solve(values.covariance, misfit) + off[0] ** 2 + off[1] ** 2)
    u_found, u_bend = (float(np.sqrt(covariance[i, i])) for i in (1, 2))
    abbe, u_abbe = 1 / float(found[1]), u_found / float(found[1]) ** 2
    return RefractometerIndex(
        measured_nm=values.wavelength_nm,
        measured_n=values.n,
        u_measured_n=np.sqrt(np.diag(values.covariance)),
        prior=prior,
        abbe=abbe,
        u_abbe=u_abbe,
        bend=float(found[2]),
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


def _values(n: ArrayLike, u_n: ArrayLike, wavelength_nm: ArrayLike, u_warm: float, u_shared: float) -> _Values:
    """Return the measured values, with the covariance of their shared errors."""
    values, nm = (np.atleast_1d(np.asarray(one, dtype=float)) for one in (n, wavelength_nm))
    u = np.atleast_1d(np.asarray(u_n, dtype=float))
    if values.ndim != 1 or values.size == 0 or nm.shape != values.shape or u.size not in {1, values.size}:
        sizes = f"{values.size} indices, {nm.size} wavelengths, {u.size} uncertainties"
        raise DataError(
            "refractometer", value=sizes, limit="one wavelength and one uncertainty are required for each index"
        )
    for name, wrong, each, limit in (
        ("n", ~((values > 1.0) & (values < 3.0)), values, "must be above 1 and below 3"),
        ("u_n", ~((u > 0.0) & (u < 0.5)), u, "must be above 0 and below 0.5"),
        ("wavelength_nm", ~((nm >= VALID_NM[0]) & (nm <= VALID_NM[1])), nm, "must be from 400 to 1000 nm"),
    ):
        if wrong.any():
            raise DataError(name, value=float(each[wrong][0]), limit=limit)
    shared = np.hypot(u_warm, _not_negative("u_shared", u_shared))
    return _Values(nm, values, np.diag(np.broadcast_to(u, values.shape) ** 2) + shared**2)


def _fitted(values: _Values, prior: Prior, at: float) -> tuple[FloatArray, FloatArray]:
    """Return n at a wavelength, V and s with maximum posterior probability, and their covariance (Gauss-Newton)."""
    power, u_power = prior.power
    known, expected = np.array([0.0, u_power**-2, prior.u_bend**-2]), np.array([0.0, power, prior.bend])
    weight = np.linalg.inv(values.covariance)
    fitted = np.array([float(values.n[np.abs(values.wavelength_nm - at).argmin()]), power, prior.bend])
    for _ in range(_STEPS):
        slope = _derivatives(lambda p: _index(p, at, values.wavelength_nm), fitted)
        off = values.n - _index(fitted, at, values.wavelength_nm)
        normal = slope.T @ weight @ slope + np.diag(known)
        pull = slope.T @ weight @ off + known * (expected - fitted)
        step = np.linalg.solve(normal, pull)
        fitted = fitted + step
        if (np.abs(step) < 1e-12 * (1 + np.abs(fitted))).all():
            break
    if not 1e-3 < fitted[1] < 0.1:
        limit = "the values rise with the wavelength, or fall more than those of any polymer"
        raise DataError("refractometer", limit=limit, remedy="check their wavelengths and their order")
    return fitted, np.asarray(np.linalg.inv(normal))


def _x(wavelength_nm: ArrayLike) -> FloatArray:
    return np.asarray((np.asarray(wavelength_nm, dtype=float) / NM_PER_UM) ** -2)


_F, _C, _D = (float(_x(line)) for line in (LINE_F, LINE_C, LINE_HELIUM))


def _coefficients(p: NDArray[Any], at: float) -> tuple[Any, Any, Any]:
    """Return A, B and C for n at a wavelength, 1/V and s."""
    n, power, share = p
    x = float(_x(at))
    linear, square = (_D - x) / (_F - _C), (_D**2 - x**2) / (_F**2 - _C**2)
    delta = power * (n - 1) / (1 - power * ((1 - share) * linear + share * square))  # (n_d − 1)/V, n_d from the formula
    b, c = delta * (1 - share) / (_F - _C), delta * share / (_F**2 - _C**2)
    return n - b * x - c * x**2, b, c


def _index(p: NDArray[Any], at: float, wavelength_nm: ArrayLike) -> FloatArray:
    a, b, c = _coefficients(p, at)
    x = _x(wavelength_nm)
    return np.asarray(a + b * x + c * x**2)


def _derivatives(function: Callable[[NDArray[Any]], Any], p: FloatArray) -> FloatArray:
    """Return derivatives with respect to each parameter, computed by the complex-step method (exact)."""
    columns = []
    for i in range(p.size):
        moved = p.astype(complex)
        moved[i] += 1j * _STEP
        columns.append(np.asarray(function(moved)).imag / _STEP)
    return np.stack(columns, axis=1)


def _warnings(values: _Values, prior: Prior, model: Cauchy, abbe: tuple[float, float], chi2: float) -> list[Caution]:
    """Return warnings about the numbers of a result."""
    freedom = values.n.size - 1
    if freedom == 0:
        return [
            warning(
                "only one wavelength was measured; at other wavelengths n is not measured but "
                f"derived from {prior.source}: V = {prior.abbe:.0f} ± {prior.u_abbe:.0f}, which "
                f"results in u(n) = {model.u_index(450.0):.4f} at 450 nm and {model.u_index(860.0):.4f} "
                "at 860 nm"
            )
        ]
    if gammaincc(freedom / 2, chi2 / 2) < _SURE:
        return [
            warning(
                f"measured values and prior disagree (χ² = {chi2:.1f} for {freedom}): combined "
                f"V = {abbe[0]:.1f} ± {abbe[1]:.1f}, prior {prior.abbe:.0f} ± {prior.u_abbe:.0f}; "
                "check the wavelengths and u(n)"
            )
        ]
    return []
