"""The routes from spectra of a layer to its index; each documents its assumptions.

- **measured**: R and T, each measured. The only route that measures both n and k.
- **absorptance**: R = 1 − T − A with A the *absorptance*, the fraction of power absorbed in the layer, measured with
  an integrating sphere. An error in T also changes R: 0.1 % of T changes n by 0.0042 near n = 1.5.
- **as-published**: R = 1 − T − A with A the *absorbance* −log10 T, as a spectrophotometer exports it. R is then a
  function of T alone and n is not a measurement; the route reproduces and labels numbers published in this way.
- **lossless**: T alone, with k = 0 assumed: T = 2n/(n² + 1). Absorption or scattering in the layer raises this n.

`measured` and `lossless` accept a `Setup` for a layer on its substrate. Near n = 1.5 on PET, an error of 0.001 in R
changes n by 0.009, an error of 0.1 % in T changes the lossless n by as much, and an error in the substrate's index is
transferred to n one to one, because the layer's reflectance is seen against that of the bare sheet. An index on a
substrate is masked if it cannot be distinguished from the second one that fits the same readings, or if more light came
out than went in.

`measured`, `absorptance`, `as_published` and `lossless` return an `IndexSpectrum`; `extinction_on_substrate` evaluates
a layer with a known index; and `is_absorbance` recognises an absorbance that was used as an absorptance.
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
from solen.material.index.inversion import Inverse, Slopes, invert, slopes
from solen.material.index.literature import band
from solen.material.index.lossless_index import lossless_in_air
from solen.material.index.masks import THREE_SIGMAS, UNRESOLVED, Codes, Why, counted, first
from solen.material.index.reading import Combined, Length, Reading, Share, combined
from solen.material.index.route_warnings import about_substrate, assumed, too_bright, unstated
from solen.material.index.spectrum import Estimate, IndexSpectrum, estimate, nothing
from solen.material.index.stack import Setup
from solen.material.index.substrate import extinction, invert_lossless, invert_on_substrate, most_transmitted
from solen.ranks import do_not_use, warning

AS_PUBLISHED = do_not_use(
    "as published, not valid as a measurement: R = 1 − T − A with A = −log10 T makes R a function of T alone, so "
    "this n contains no information on the reflectance; a clear layer of n = 1.50 evaluated in this way gives 1.351"
)
BASES = {"log10": float(np.log(10.0)), "ln": 1.0}
"""Natural logarithm of the base of each kind of absorbance."""
_ALIKE, _ROUNDED = 0.02, 1e-4  # tolerances within which A is −log10 T


@dataclass(frozen=True, eq=False)
class _Input:
    """A reading of a layer in air, and how R and T follow from it."""

    reading: Reading
    r_by: float
    t_by: float

    def slope(self, by: Slopes) -> FloatArray:
        """Return the derivative with respect to the input; infinite values are ignored if R or T has no effect."""
        r_part = by["R"] * self.r_by if self.r_by else 0.0
        return r_part + (by["T"] * self.t_by if self.t_by else np.zeros_like(by["T"]))


def measured(
    wavelength_nm: ArrayLike,
    transmittance: Reading,
    reflectance: Reading,
    thickness: Length,
    setup: Setup | None = None,
) -> IndexSpectrum:
    """Return n and k from R and T, each measured on the free-standing layer or, with ``setup``, on its substrate.

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


def absorptance(wavelength_nm: ArrayLike, transmittance: Reading, share: Reading, thickness: Length) -> IndexSpectrum:
    """Return the index and extinction from T and the absorptance, the fraction of the power absorbed in the layer.

    Raises
    ------
    DataError
        If the absorptance is −log10 T or −ln T: an absorbance, from which no reflectance follows.
    """
    t, a = transmittance.value, share.value
    for kind, base in BASES.items():
        if is_absorbance(a, t, base):
            raise no_reflectance(f"this A: it is an absorbance, −{kind} T,", wavelength_nm, transmittance)
    inputs = {"T": _Input(transmittance, -1.0, 1.0), "A": _Input(share, -1.0, 0.0)}
    return _in_air("absorptance", wavelength_nm, 1.0 - t - a, t, inputs, thickness)


def as_published(wavelength_nm: ArrayLike, transmittance: Reading, thickness: Length) -> IndexSpectrum:
    """Return the numbers from R = 1 − T − A with the absorbance −log10 T as A, for comparison with published ones.

    They are not an index and have no uncertainty: the uncertainty of T would not be one of n.
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
        k=nothing(np.where(spectrum.n.known, Why.PUBLISHED, spectrum.n.why).astype(np.int8)),
        k_low95=none,
        k_high95=none,
        correlation=none,
        warnings=(AS_PUBLISHED, *transmittance.remarks, *counted("n", spectrum.n.why)),
    )


def lossless(wavelength_nm: ArrayLike, transmittance: Reading, setup: Setup | None = None) -> IndexSpectrum:
    """Return the index from T alone, assuming k = 0, of a free-standing layer or, with ``setup``, on a substrate.

    If the layer absorbs, n is an upper bound.
    """
    nm, t = np.asarray(wavelength_nm, dtype=float), transmittance.value
    none = np.full(t.shape, np.nan)
    if setup is None:
        n = lossless_in_air(transmittance)
        head = [assumed(t[n.known]), *unstated({"T": transmittance})]
    else:
        inverse = invert_lossless(t, nm, setup)
        n = _lossless_on_substrate(nm, transmittance, inverse, setup)
        assumption = "lossless: k = 0 is assumed, so n is an upper bound: any absorption or scattering in the layer "
        head = [warning(f"{assumption}raises it"), *about_substrate(inverse, n, {"T": transmittance}, setup)]
    return IndexSpectrum(
        mode="lossless",
        measurement=True,
        wavelength_nm=nm,
        n=n,
        k=nothing(np.where(n.known, Why.ASSUMED, n.why).astype(np.int8)),
        k_low95=none,
        k_high95=none,
        correlation=none,
        lossless=n,
        reflectance=1.0 - t if setup is None else none,
        transmittance=t,
        thickness=None,
        warnings=(*head, *transmittance.remarks, *counted("n", n.why)),
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
    n, u_n
        The layer's index and its standard uncertainty, a single error common to all wavelengths.
    """
    nm, t = np.asarray(wavelength_nm, dtype=float), transmittance.value
    found = extinction(t, n, nm, thickness.um, setup)
    u = {**setup.u, "thickness_um": thickness.u_um or 0.0, "n": u_n}
    k = combined(_parts(found.k_by, {"T": transmittance}, u), nm.size)
    lost = first({Why.MISSING: ~np.isfinite(t), Why.TRANSMITTANCE: ~(t > 0.0), Why.BRIGHT: _bright(found.k, k)})
    return estimate(found.k, k, _why_no_k(lost, found.k, k))


def is_absorbance(
    a: FloatArray, transmittance: FloatArray, base: float = BASES["log10"], tolerance: float = _ALIKE
) -> bool:
    """Whether A is −ln T over ``base`` rather than an absorptance: the two agree to 2 % at most wavelengths.

    With a tolerance of 0 they must agree to within rounding error, as if one was computed from the other.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = -np.log(np.where(transmittance > 0.0, transmittance, np.nan)) / base
        gap = np.abs(a - expected)
    seen = np.isfinite(gap)
    if not seen.any():
        return False
    return bool(np.median(gap[seen]) <= tolerance * np.median(np.abs(expected[seen])) + _ROUNDED)


def no_reflectance(what: str, wavelength_nm: ArrayLike, transmittance: Reading) -> DataError:
    """Return the error for a measured index if only T is known; it reports the index from T alone."""
    found, nm = lossless_in_air(transmittance), np.asarray(wavelength_nm, dtype=float)
    at = np.flatnonzero(found.known)
    instead = ""
    if at.size:
        middle = at[at.size // 2]
        instead = f"; T alone, assuming k = 0, gives n({nm[middle]:g} nm) = {found.value[middle]:.4f}"
        known = band(nm[middle], package=False)
        if np.isfinite(known.low[0]):
            instead += f", while acrylates and photoresins have {known.low[0]:.2f} to {known.high[0]:.2f}"
    return DataError(
        "a measured index",
        limit=f"does not follow from {what} which contains no information on the reflectance{instead}",
        remedy="measure R; or use --mode lossless; or --mode as-published, which is labelled as not measured",
    )


def _in_air(
    mode: str, wavelength_nm: ArrayLike, r: FloatArray, t: FloatArray, inputs: Mapping[str, _Input], thickness: Length
) -> IndexSpectrum:
    """Return the index of a free-standing layer from R and T computed from the inputs."""
    index, by = invert(r, t, thickness.um, wavelength_nm), slopes(r, t, thickness.um, wavelength_nm)
    read = {name: one.reading for name, one in inputs.items()}
    n_by, k_by = (
        {name: one.slope(each) for name, one in inputs.items()} | {"thickness_um": each["thickness_um"]} for each in by
    )
    u = _propagated(n_by, k_by, read, {"thickness_um": thickness.u_um or 0.0})
    u_sum, u_t = (_sum_of(inputs, r_share, r.size) for r_share in (1.0, 0.0))
    no_n = masks.why_no_n(r, t, u_sum, index)
    no_k = masks.why_no_k(no_n, index.k, u.k, t, u_t)
    n, k = estimate(index.n, u.n, no_n), estimate(index.k, u.k, no_k)
    low, high = _k_bounds(index.k, u.k, no_k, t, u_t, by[1]["T"])
    remarks = [remark for one in read.values() for remark in one.remarks]
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
            *unstated(read),
            *remarks,
            *too_bright(index.k, u.k),
            *counted("n", no_n),
            *counted("k", no_k, no_n),
        ),
    )


def _sum_of(inputs: Mapping[str, _Input], r_share: float, points: int) -> Combined:
    """Return the uncertainty of T plus a fraction of R."""
    shares = (one.reading.shares(one.r_by * r_share + one.t_by) for one in inputs.values())
    return combined([share for each in shares for share in each], points)


def _measured_on_substrate(
    wavelength_nm: ArrayLike, transmittance: Reading, reflectance: Reading, thickness: Length, setup: Setup
) -> IndexSpectrum:
    nm, t, r = np.asarray(wavelength_nm, dtype=float), transmittance.value, reflectance.value
    inverse = invert_on_substrate(t, r, nm, thickness.um, setup)
    read = {"T": transmittance, "R": reflectance}
    u = _propagated(inverse.n_by, inverse.k_by, read, {**setup.u, "thickness_um": thickness.u_um or 0.0})
    u_t = combined(transmittance.shares(np.ones(nm.size)), nm.size)
    most_r = 1.0 if setup.baseline_r == "air" else np.inf  # a layer may reflect more than its bare substrate
    no_n = first(
        {
            Why.MISSING: ~(np.isfinite(t) & np.isfinite(r)),
            Why.REFLECTANCE: ~((r > 0.0) & (r < most_r)),
            Why.TRANSMITTANCE: ~(t > 0.0),
            Why.NO_FIT: np.isnan(inverse.n),
            Why.INDISTINCT: _indistinct(inverse, u.n),
            Why.BRIGHT: _bright(inverse.k, u.k),
        }
    )
    no_k = _why_no_k(no_n, inverse.k, u.k)
    n, k = estimate(inverse.n, u.n, no_n), estimate(inverse.k, u.k, no_k)
    low, high = _k_bounds(inverse.k, u.k, no_k, t, u_t, inverse.k_by["T"])
    head = [*about_substrate(inverse, n, read, setup), *transmittance.remarks, *reflectance.remarks]
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
        warnings=(*head, *too_bright(inverse.k, u.k), *counted("n", no_n), *counted("k", no_k, no_n)),
    )


class _Propagated(NamedTuple):
    """Uncertainties of n and of k, and the correlation of their errors."""

    n: Combined
    k: Combined
    correlation: FloatArray


def _propagated(n_by: Slopes, k_by: Slopes, read: Mapping[str, Reading], u: Mapping[str, ArrayLike]) -> _Propagated:
    n_parts, k_parts = _parts(n_by, read, u), _parts(k_by, read, u)
    together = np.array([n.u * k.u for n, k in zip(n_parts, k_parts, strict=True)]).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = together / np.sqrt(sum(n.u**2 for n in n_parts) * sum(k.u**2 for k in k_parts))
    size = together.size
    return _Propagated(combined(n_parts, size), combined(k_parts, size), np.asarray(correlation))


def _parts(by: Slopes, read: Mapping[str, Reading], u: Mapping[str, ArrayLike]) -> list[Share]:
    """Return the parts of an uncertainty: from each reading, and from other inputs."""
    parts = [share for name, reading in read.items() for share in reading.shares(by[name])]
    return parts + [Share(np.asarray(by[name] * np.asarray(u[name])), np.inf, True) for name in u if name in by]


def _k_bounds(
    result: FloatArray, k: Combined, no_k: Codes, t: FloatArray, u_t: Combined, k_by_t: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return 95 % bounds of k; if not resolved, they are 0 and the 95 % quantile of a normal error truncated at 0."""
    unresolved, u, u95 = np.isin(no_k, UNRESOLVED), k.u, k.bound(0.95)
    with np.errstate(all="ignore"):
        above = result - u * ndtri(0.05 * ndtr(result / u))
        darkest = result + k_by_t * t * np.log1p(u_t.bound(0.90) / t)  # k is proportional to ln T there
    seen = (unresolved | (no_k == Why.FINE)) & ~np.isnan(u)
    low = np.where(unresolved, 0.0, np.maximum(result - u95, 0.0))
    high = np.where(unresolved, above, result + u95)
    low = np.where(seen, low, np.where(no_k == Why.DARK, darkest, np.nan))
    return low, np.where(seen, high, np.nan)


def _indistinct(inverse: Inverse, n: Combined) -> BoolArray:
    """Return where the extremum of R or T between the two indices is within three uncertainties of n."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(inverse.n - inverse.other_n) < 2.0 * n.bound(THREE_SIGMAS))


def _bright(bright: FloatArray, k: Combined) -> BoolArray:
    with np.errstate(invalid="ignore"):
        return np.asarray(bright < -k.bound(THREE_SIGMAS) - masks.ROUNDING)


def _why_no_k(no_n: Codes, result: FloatArray, k: Combined) -> Codes:
    with np.errstate(invalid="ignore"):
        tests = {Why.BELOW: result < 0.0, Why.SMALL: masks.unresolved(result, k)}
    return np.where(no_n != Why.FINE, no_n, first(tests)).astype(np.int8)


def _lossless_on_substrate(nm: FloatArray, transmittance: Reading, inverse: Inverse, setup: Setup) -> Estimate:
    t = transmittance.value
    n = combined(_parts(inverse.n_by, {"T": transmittance}, setup.u), nm.size)
    with np.errstate(invalid="ignore"):
        tests = {
            Why.MISSING: ~np.isfinite(t),
            Why.TRANSMITTANCE: ~(t > 0.0),
            Why.TOO_CLEAR: t > most_transmitted(nm, setup) + masks.ROUNDING,
            Why.TOO_DARK: np.isnan(inverse.n),
            Why.INDISTINCT: _indistinct(inverse, n),
        }
    return estimate(inverse.n, n, first(tests))
