"""The routes from spectra of a layer to its index, with their assumptions.

- **measured**: R and T, both measured. The only route that measures both n and k.
- **absorptance**: R = 1 − T − A with the *absorptance* A, the fraction of power absorbed in the layer, measured with
  an integrating sphere. An error in T also changes R: 0.1 % of T changes n by 0.0042 near n = 1.5.
- **as-published**: R = 1 − T − A with the *absorbance* −log10 T as A, as a spectrophotometer exports it. R is then a
  function of T alone and n is not a measurement; the route reproduces numbers that were published in this way, and
  marks them.
- **lossless**: T alone, assuming k = 0: T = 2n/(n² + 1). Absorption or scattering in the layer increases this n.

`measured` and `lossless` accept a `Setup` for a layer on its substrate. Near n = 1.5 on PET, an error of 0.001 in R
changes n by 0.009, an error of 0.1 % in T changes the lossless n by the same amount, and an error in the substrate's
index causes an equal error in n, because the reflectance of the layer is measured relative to that of the bare
substrate. An index on a substrate is masked if it cannot be distinguished from the second index that fits the same
readings, or if k is significantly below 0.

`measured`, `absorptance`, `as_published` and `lossless` return an `IndexSpectrum`; `extinction_on_substrate` evaluates
a layer with a known index; and `is_absorbance` detects an absorbance that was used as an absorptance.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError
from solen.material.index import masks
from solen.material.index.inversion import Slopes, invert, slopes
from solen.material.index.literature import band
from solen.material.index.lossless_index import lossless_in_air
from solen.material.index.masks import THREE_SIGMAS, UNRESOLVED, Codes, Reason, first_code, mask_warnings
from solen.material.index.reading import Combined, Contribution, Length, Reading, combined
from solen.material.index.route_warnings import (
    input_warnings,
    lossless_warning,
    negative_k_warnings,
    substrate_warnings,
)
from solen.material.index.spectrum import Estimate, IndexSpectrum, all_masked, estimate
from solen.material.index.stack import Setup
from solen.material.index.substrate import (
    SubstrateInversion,
    extinction,
    invert_lossless,
    invert_on_substrate,
    max_transmittance,
)
from solen.ranks import do_not_use, warning

AS_PUBLISHED = do_not_use(
    "as published, not valid as a measurement: R = 1 − T − A with A = −log10 T makes R a function of T alone, so "
    "this n contains no information about the reflectance; a lossless layer of n = 1.50 evaluated in this way gives "
    "1.351"
)
BASES = {"log10": float(np.log(10.0)), "ln": 1.0}
"""Natural logarithm of the base of each kind of absorbance."""
_RELATIVE_TOLERANCE, _TOLERANCE = 0.02, 1e-4  # tolerances for A = −log10 T


@dataclass(frozen=True, eq=False)
class _Input:
    """A reading of a layer in air, and the derivatives of R and T with respect to it."""

    reading: Reading
    r_by: float
    t_by: float

    def slope(self, by: Slopes) -> FloatArray:
        """Return a derivative with respect to the input; terms with a derivative of 0 are omitted, even if infinite."""
        r_term = by["R"] * self.r_by if self.r_by else 0.0
        return r_term + (by["T"] * self.t_by if self.t_by else np.zeros_like(by["T"]))


def measured(
    wavelength_nm: ArrayLike,
    transmittance: Reading,
    reflectance: Reading,
    thickness: Length,
    setup: Setup | None = None,
) -> IndexSpectrum:
    """Return n and k from R and T, both measured on the free-standing layer or, with ``setup``, on its substrate.

    Raises
    ------
    DataError
        If R is 1 − T + log10 T: it was then computed from T, using the absorbance as the absorptance.
    """
    if setup is not None:
        return _measured_on_substrate(wavelength_nm, transmittance, reflectance, thickness, setup)
    r, t = reflectance.value, transmittance.value
    if is_absorbance(1.0 - r - t, t, tolerance=0.0):
        raise no_reflectance(
            "this R: it is 1 − T + log10 T, computed from an absorbance,", wavelength_nm, transmittance
        )
    inputs = {"R": _Input(reflectance, 1.0, 0.0), "T": _Input(transmittance, 0.0, 1.0)}
    return _in_air("measured", wavelength_nm, r, t, inputs, thickness)


def absorptance(
    wavelength_nm: ArrayLike, transmittance: Reading, absorbed: Reading, thickness: Length
) -> IndexSpectrum:
    """Return the index and extinction from T and the absorptance, the fraction of the power absorbed in the layer.

    Raises
    ------
    DataError
        If the absorptance is −log10 T or −ln T: an absorbance, from which no reflectance follows.
    """
    t, a = transmittance.value, absorbed.value
    for kind, base in BASES.items():
        if is_absorbance(a, t, base):
            raise no_reflectance(f"this A: it is an absorbance, −{kind} T,", wavelength_nm, transmittance)
    inputs = {"T": _Input(transmittance, -1.0, 1.0), "A": _Input(absorbed, -1.0, 0.0)}
    return _in_air("absorptance", wavelength_nm, 1.0 - t - a, t, inputs, thickness)


def as_published(wavelength_nm: ArrayLike, transmittance: Reading, thickness: Length) -> IndexSpectrum:
    """Return the numbers from R = 1 − T − A with the absorbance −log10 T as A, for comparison with published ones.

    They are not an index and have no uncertainty: that of T does not describe the error of n.
    """
    t = transmittance.value
    with np.errstate(divide="ignore", invalid="ignore"):
        r = 1.0 - t + np.log10(np.where(t > 0.0, t, np.nan))
    spectrum = _in_air("as-published", wavelength_nm, r, t, {"T": _Input(transmittance, 0.0, 1.0)}, thickness)
    none = np.full(t.shape, np.nan)
    return replace(
        spectrum,
        measurement=False,
        n=spectrum.n.without_u,
        k=all_masked(np.where(spectrum.n.known, Reason.PUBLISHED, spectrum.n.codes).astype(np.int8)),
        k_low95=none,
        k_high95=none,
        correlation=none,
        warnings=(AS_PUBLISHED, *transmittance.warnings, *mask_warnings("n", spectrum.n.codes)),
    )


def lossless(wavelength_nm: ArrayLike, transmittance: Reading, setup: Setup | None = None) -> IndexSpectrum:
    """Return the index from T alone, assuming k = 0, of a free-standing layer or, with ``setup``, on a substrate.

    If the layer absorbs, n is an upper bound.
    """
    nm, t = np.asarray(wavelength_nm, dtype=float), transmittance.value
    none = np.full(t.shape, np.nan)
    if setup is None:
        n = lossless_in_air(transmittance)
        warnings = [lossless_warning(t[n.known]), *input_warnings({"T": transmittance})]
    else:
        inverse = invert_lossless(t, nm, setup)
        n = _lossless_on_substrate(nm, transmittance, inverse, setup)
        text = "lossless: k = 0 is assumed, so n is an upper bound: absorption or scattering in the layer increases it"
        warnings = [warning(text), *substrate_warnings(inverse, n, {"T": transmittance}, setup)]
    return IndexSpectrum(
        mode="lossless",
        measurement=True,
        wavelength_nm=nm,
        n=n,
        k=all_masked(np.where(n.known, Reason.ASSUMED, n.codes).astype(np.int8)),
        k_low95=none,
        k_high95=none,
        correlation=none,
        lossless=n,
        reflectance=1.0 - t if setup is None else none,
        transmittance=t,
        thickness=None,
        warnings=(*warnings, *transmittance.warnings, *mask_warnings("n", n.codes)),
    )


def extinction_on_substrate(
    wavelength_nm: ArrayLike,
    transmittance: Reading,
    n: ArrayLike,
    thickness: Length,
    setup: Setup,
    *,
    u_n: ArrayLike = 0.0,
) -> Estimate:
    """Return the extinction of a layer on its substrate from T and an index measured by other means.

    Parameters
    ----------
    wavelength_nm, transmittance, thickness, setup
        As for `measured`.
    n, u_n
        Index of the layer and its standard uncertainty, due to a single error common to all wavelengths.
    """
    nm, t = np.asarray(wavelength_nm, dtype=float), transmittance.value
    inverse = extinction(t, n, nm, thickness.um, setup)
    u = {**setup.u, "thickness_um": thickness.u_um or 0.0, "n": u_n}
    k = combined(_contributions(inverse.k_by, {"T": transmittance}, u), nm.size)
    tests = {
        Reason.MISSING: ~np.isfinite(t),
        Reason.TRANSMITTANCE: ~(t > 0.0),
        Reason.BRIGHT: _is_negative(inverse.k, k),
    }
    return estimate(inverse.k, k, _substrate_k_codes(first_code(tests), inverse.k, k))


def is_absorbance(
    a: FloatArray, transmittance: FloatArray, base: float = BASES["log10"], tolerance: float = _RELATIVE_TOLERANCE
) -> bool:
    """Whether A is −ln T divided by ``base``, not an absorptance: the median difference of the two is at most 2 %.

    With a tolerance of 0 they must agree to within rounding error, as if one was computed from the other.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = -np.log(np.where(transmittance > 0.0, transmittance, np.nan)) / base
        difference = np.abs(a - expected)
    known = np.isfinite(difference)
    if not known.any():
        return False
    return bool(np.median(difference[known]) <= tolerance * np.median(np.abs(expected[known])) + _TOLERANCE)


def no_reflectance(source: str, wavelength_nm: ArrayLike, transmittance: Reading) -> DataError:
    """Return the error for a measured index if only T is known; it reports the index from T alone."""
    lossless_n, nm = lossless_in_air(transmittance), np.asarray(wavelength_nm, dtype=float)
    known = np.flatnonzero(lossless_n.known)
    estimate_text = ""
    if known.size:
        i = known[known.size // 2]
        estimate_text = f"; T alone, assuming k = 0, gives n({nm[i]:g} nm) = {lossless_n.value[i]:.4f}"
        literature = band(nm[i], package=False)
        if np.isfinite(literature.low[0]):
            low, high = literature.low[0], literature.high[0]
            estimate_text += f", whereas acrylates and photoresins have {low:.2f} to {high:.2f}"
    return DataError(
        "a measured index",
        limit=f"does not follow from {source} which contains no information about the reflectance{estimate_text}",
        remedy="measure R, or use --mode lossless, or --mode as-published, which is marked as not a measurement",
    )


def _in_air(
    mode: str, wavelength_nm: ArrayLike, r: FloatArray, t: FloatArray, inputs: Mapping[str, _Input], thickness: Length
) -> IndexSpectrum:
    """Return the index of a free-standing layer from R and T computed from the inputs."""
    index, derivatives = invert(r, t, thickness.um, wavelength_nm), slopes(r, t, thickness.um, wavelength_nm)
    read = {name: source.reading for name, source in inputs.items()}
    n_by, k_by = (
        {name: source.slope(by) for name, source in inputs.items()} | {"thickness_um": by["thickness_um"]}
        for by in derivatives
    )
    u = _propagated(n_by, k_by, read, {"thickness_um": thickness.u_um or 0.0})
    u_sum, u_t = (_u_of_sum(inputs, weight, r.size) for weight in (1.0, 0.0))
    no_n = masks.n_codes(r, t, u_sum, index)
    no_k = masks.k_codes(no_n, index.k, u.k, t, u_t)
    n, k = estimate(index.n, u.n, no_n), estimate(index.k, u.k, no_k)
    low, high = _k_bounds(index.k, u.k, no_k, t, u_t, derivatives[1]["T"])
    return IndexSpectrum(
        mode=mode,
        measurement=True,
        wavelength_nm=np.asarray(wavelength_nm, dtype=float),
        n=n,
        k=k,
        k_low95=low,
        k_high95=high,
        correlation=u.correlation,
        lossless=lossless_in_air(read["T"]),
        reflectance=r,
        transmittance=t,
        thickness=thickness,
        warnings=(
            *input_warnings(read),
            *(text for reading in read.values() for text in reading.warnings),
            *negative_k_warnings(index.k, u.k),
            *mask_warnings("n", no_n),
            *mask_warnings("k", no_k, no_n),
        ),
    )


def _u_of_sum(inputs: Mapping[str, _Input], weight: float, points: int) -> Combined:
    """Return the uncertainty of T + weight · R."""
    sources = inputs.values()
    return combined(
        [part for source in sources for part in source.reading.contributions(source.r_by * weight + source.t_by)],
        points,
    )


def _measured_on_substrate(
    wavelength_nm: ArrayLike, transmittance: Reading, reflectance: Reading, thickness: Length, setup: Setup
) -> IndexSpectrum:
    nm, t, r = np.asarray(wavelength_nm, dtype=float), transmittance.value, reflectance.value
    inverse = invert_on_substrate(t, r, nm, thickness.um, setup)
    read = {"T": transmittance, "R": reflectance}
    u = _propagated(inverse.n_by, inverse.k_by, read, {**setup.u, "thickness_um": thickness.u_um or 0.0})
    u_t = combined(transmittance.contributions(np.ones(nm.size)), nm.size)
    max_r = 1.0 if setup.baseline_r == "air" else np.inf  # a layer may reflect more than its bare substrate
    no_n = first_code(
        {
            Reason.MISSING: ~(np.isfinite(t) & np.isfinite(r)),
            Reason.REFLECTANCE: ~((r > 0.0) & (r < max_r)),
            Reason.TRANSMITTANCE: ~(t > 0.0),
            Reason.NO_FIT: np.isnan(inverse.n),
            Reason.INDISTINCT: _is_indistinct(inverse, u.n),
            Reason.BRIGHT: _is_negative(inverse.k, u.k),
        }
    )
    no_k = _substrate_k_codes(no_n, inverse.k, u.k)
    n, k = estimate(inverse.n, u.n, no_n), estimate(inverse.k, u.k, no_k)
    low, high = _k_bounds(inverse.k, u.k, no_k, t, u_t, inverse.k_by["T"])
    return IndexSpectrum(
        mode="measured",
        measurement=True,
        wavelength_nm=nm,
        n=n,
        k=k,
        k_low95=low,
        k_high95=high,
        correlation=u.correlation,
        lossless=_lossless_on_substrate(nm, transmittance, invert_lossless(t, nm, setup), setup),
        reflectance=r,
        transmittance=t,
        thickness=thickness,
        warnings=(
            *substrate_warnings(inverse, n, read, setup),
            *transmittance.warnings,
            *reflectance.warnings,
            *negative_k_warnings(inverse.k, u.k),
            *mask_warnings("n", no_n),
            *mask_warnings("k", no_k, no_n),
        ),
    )


class _Propagated(NamedTuple):
    """Uncertainties of n and k, and the correlation of their errors."""

    n: Combined
    k: Combined
    correlation: FloatArray


def _propagated(n_by: Slopes, k_by: Slopes, read: Mapping[str, Reading], u: Mapping[str, ArrayLike]) -> _Propagated:
    n_parts, k_parts = _contributions(n_by, read, u), _contributions(k_by, read, u)
    covariance = np.array([n.u * k.u for n, k in zip(n_parts, k_parts, strict=True)]).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = covariance / np.sqrt(sum(n.u**2 for n in n_parts) * sum(k.u**2 for k in k_parts))
    size = covariance.size
    return _Propagated(combined(n_parts, size), combined(k_parts, size), np.asarray(correlation))


def _contributions(by: Slopes, read: Mapping[str, Reading], u: Mapping[str, ArrayLike]) -> list[Contribution]:
    """Return the contributions to an uncertainty from each reading, and from other inputs."""
    parts = [part for name, reading in read.items() for part in reading.contributions(by[name])]
    return parts + [Contribution(np.asarray(by[name] * np.asarray(u[name])), np.inf, True) for name in u if name in by]


def _k_bounds(
    result: FloatArray, k: Combined, no_k: Codes, t: FloatArray, u_t: Combined, k_by_t: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the 95 % bounds of k: both if k is resolved, 0 and an upper one if not, only a lower one if T may be 0."""
    unresolved, u, u95 = np.isin(no_k, UNRESOLVED), k.u, k.bound(0.95)
    with np.errstate(all="ignore"):
        truncated = result - u * ndtri(0.05 * ndtr(result / u))
        lower_if_dark = result + k_by_t * t * np.log1p(u_t.bound(0.90) / t)  # k is proportional to ln T there
    known = (unresolved | (no_k == Reason.NONE)) & ~np.isnan(u)
    low = np.where(unresolved, 0.0, np.maximum(result - u95, 0.0))
    high = np.where(unresolved, truncated, result + u95)
    low = np.where(known, low, np.where(no_k == Reason.DARK, lower_if_dark, np.nan))
    return low, np.where(known, high, np.nan)


def _is_indistinct(inverse: SubstrateInversion, n: Combined) -> BoolArray:
    """Whether the extremum of R or T between the two possible indices is within three uncertainties of n."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(inverse.n - inverse.other_n) < 2.0 * n.bound(THREE_SIGMAS))


def _is_negative(result: FloatArray, k: Combined) -> BoolArray:
    with np.errstate(invalid="ignore"):
        return np.asarray(result < -k.bound(THREE_SIGMAS) - masks.ROUNDING)


def _substrate_k_codes(no_n: Codes, result: FloatArray, k: Combined) -> Codes:
    with np.errstate(invalid="ignore"):
        tests = {Reason.BELOW: result < 0.0, Reason.SMALL: masks.unresolved(result, k)}
    return np.where(no_n != Reason.NONE, no_n, first_code(tests)).astype(np.int8)


def _lossless_on_substrate(
    nm: FloatArray, transmittance: Reading, inverse: SubstrateInversion, setup: Setup
) -> Estimate:
    t = transmittance.value
    n = combined(_contributions(inverse.n_by, {"T": transmittance}, setup.u), nm.size)
    with np.errstate(invalid="ignore"):
        tests = {
            Reason.MISSING: ~np.isfinite(t),
            Reason.TRANSMITTANCE: ~(t > 0.0),
            Reason.TOO_CLEAR: t > max_transmittance(nm, setup) + masks.ROUNDING,
            Reason.TOO_DARK: np.isnan(inverse.n),
            Reason.INDISTINCT: _is_indistinct(inverse, n),
        }
    return estimate(inverse.n, n, first_code(tests))
