"""The routes from spectra of a free-standing layer to its index; each states what it assumes.

- **measured**: R and T, each measured. The only one that measures both n and k.
- **absorptance**: R = 1 − T − A with A the *absorptance*, the share of the power that stays in the layer, measured in
  an integrating sphere. An error of T goes into R as well: 0.1 % of T moves n by 0.0042 near n = 1.5.
- **as-published**: R = 1 − T − A with A the *absorbance* −log10 T, what a spectrophotometer exports. R is then a
  function of T alone and n no measurement; the route reproduces numbers that were published so, and says what they are.
- **lossless**: T alone, with k = 0 assumed: T = 2n/(n² + 1). Whatever the layer absorbs or scatters raises this n.

The interface: `measured`, `absorptance`, `as_published`, `lossless`, each giving an `IndexSpectrum`; `is_absorbance`
tells an absorbance that was taken for an absorptance.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index import masks
from solen.material.index.inversion import Inverted, Slopes, invert, slopes
from solen.material.index.literature import band
from solen.material.index.masks import WORDS, Codes, Why
from solen.material.index.reading import Combined, Length, Reading, Share, combined
from solen.material.index.spectrum import UNRESOLVED, Estimate, IndexSpectrum, estimate, nothing

MODES = ("measured", "absorptance", "as-published", "lossless")
AS_PUBLISHED = (
    "as published, refused as a measurement: R = 1 − T − A with A = −log10 T makes R a function of T alone, so this n "
    "says nothing of the reflectance; so read, a clear layer of n = 1.50 gives 1.351"
)
_ALIKE, _ROUNDED = 0.02, 1e-4  # A that differs from −log10 T by less is −log10 T


@dataclass(frozen=True)
class _Input:
    """A reading, and how R and T follow from it."""

    name: str
    reading: Reading
    r_by: float
    t_by: float


def measured(
    wavelength_nm: ArrayLike, transmittance: Reading, reflectance: Reading, thickness: Length
) -> IndexSpectrum:
    """Index and extinction from R and T, each measured on the free-standing layer.

    Raises
    ------
    DataError
        Where R is 1 − T + log10 T: it was not measured but made of T, with the absorbance taken for the absorptance.
    """
    inputs = [_Input("R", reflectance, 1.0, 0.0), _Input("T", transmittance, 0.0, 1.0)]
    r, t = reflectance.value, transmittance.value
    if is_absorbance(1.0 - r - t, t, tolerance=0.0):
        raise no_reflectance("this R: it is 1 − T + log10 T, made of an absorbance,", wavelength_nm, transmittance)
    return _inverse("measured", wavelength_nm, r, t, inputs, thickness)


def absorptance(wavelength_nm: ArrayLike, transmittance: Reading, share: Reading, thickness: Length) -> IndexSpectrum:
    """Index and extinction from T and the absorptance, the share of the power that stays in the layer.

    Raises
    ------
    DataError
        Where the absorptance is −log10 T or −ln T: an absorbance, of which no reflectance follows.
    """
    t, a = transmittance.value, share.value
    for kind, base in (("log10", np.log(10.0)), ("ln", 1.0)):
        if is_absorbance(a, t, base):
            raise no_reflectance(f"this A: it is an absorbance, −{kind} T,", wavelength_nm, transmittance)
    inputs = [_Input("T", transmittance, -1.0, 1.0), _Input("A", share, -1.0, 0.0)]
    return _inverse("absorptance", wavelength_nm, 1.0 - t - a, t, inputs, thickness)


def as_published(wavelength_nm: ArrayLike, transmittance: Reading, thickness: Length) -> IndexSpectrum:
    """What R = 1 − T − A gives when A is the absorbance −log10 T: numbers to compare with published ones, no index.

    No uncertainty goes with it: one of T would not be one of n.
    """
    t = transmittance.value
    with np.errstate(divide="ignore", invalid="ignore"):
        r = 1.0 - t + np.log10(np.where(t > 0.0, t, np.nan))
    found = _inverse("as-published", wavelength_nm, r, t, [_Input("T", transmittance, 0.0, 1.0)], thickness)
    no_k = np.where(found.n.known, Why.PUBLISHED, found.n.why).astype(np.int8)
    none = np.full(t.shape, np.nan)
    return replace(
        found,
        measurement=False,
        n=found.n.without_u,
        k=nothing(no_k),
        k_low95=none,
        k_high95=none,
        correlation=none,
        warnings=(AS_PUBLISHED, *transmittance.remarks, *masked_at(found.n, "n")),
    )


def lossless(wavelength_nm: ArrayLike, transmittance: Reading) -> IndexSpectrum:
    """Index of a free-standing layer from T alone, k = 0 assumed."""
    found, t = _lossless(transmittance), transmittance.value
    none = np.full(t.shape, np.nan)
    told = [*_unstated([_Input("T", transmittance, 0.0, 1.0)]), *transmittance.remarks, *masked_at(found, "n")]
    return IndexSpectrum(
        mode="lossless",
        measurement=True,
        wavelength_nm=np.asarray(wavelength_nm, dtype=float),
        n=found,
        k=nothing(np.where(found.known, Why.ASSUMED, found.why).astype(np.int8)),
        k_low95=none,
        k_high95=none,
        correlation=none,
        lossless=found,
        reflectance=1.0 - t,
        transmittance=t,
        thickness=None,
        warnings=(_assumed(t[found.known]), *told),
    )


def is_absorbance(
    a: FloatArray, transmittance: FloatArray, base: float = np.log(10.0), tolerance: float = _ALIKE
) -> bool:
    """Whether A is −ln T over ``base`` rather than an absorptance: the two agree at most wavelengths, to 2 %.

    With a tolerance of 0 they agree to rounding, as where one was computed from the other.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = -np.log(np.where(transmittance > 0.0, transmittance, np.nan)) / base
        gap = np.abs(a - expected)
    seen = np.isfinite(gap)
    if not seen.any():
        return False
    return bool(np.median(gap[seen]) <= tolerance * np.median(np.abs(expected[seen])) + _ROUNDED)


def no_reflectance(what: str, wavelength_nm: ArrayLike, transmittance: Reading) -> DataError:
    """Refusal of a measured index where all that is known is T; what T alone gives is told in it."""
    found, nm = _lossless(transmittance), np.asarray(wavelength_nm, dtype=float)
    at = np.flatnonzero(found.known)
    instead = ""
    if at.size:
        middle = at[at.size // 2]
        instead = f"; T alone, k = 0 assumed, gives n({nm[middle]:g} nm) = {found.value[middle]:.4f}"
        known = band(nm[middle], package=False)
        if np.isfinite(known.low[0]):
            instead += f", where acrylates and photoresins have {known.low[0]:.2f} to {known.high[0]:.2f}"
    return DataError(
        "a measured index",
        limit=f"does not follow from {what} which says nothing of the reflectance{instead}",
        remedy="measure R; or take --mode lossless; or --mode as-published, which is labelled as no measurement",
    )


def lossless_index(transmittance: ArrayLike) -> FloatArray:
    """Index of a clear slab in air that transmits this, (1 + √(1 − T²))/T; NaN outside 0 < T < 1."""
    t = np.asarray(transmittance, dtype=float)
    with np.errstate(all="ignore"):
        n = (1.0 + np.sqrt((1.0 - t) * (1.0 + t))) / t
    return np.asarray(np.where((t > 0.0) & (t < 1.0), n, np.nan))


def _inverse(
    mode: str, wavelength_nm: ArrayLike, r: FloatArray, t: FloatArray, inputs: Sequence[_Input], thickness: Length
) -> IndexSpectrum:
    found, slope = invert(r, t, thickness.um, wavelength_nm), slopes(r, t, thickness.um, wavelength_nm)
    n, k, correlation = _propagated(inputs, slope, thickness, r.size)
    u_t = _sum(inputs, 0.0, 1.0, r.size)
    no_n = masks.why_no_n(r, t, _sum(inputs, 1.0, 1.0, r.size), found)
    no_k = masks.why_no_k(no_n, found.k, k, t, u_t)
    estimates = estimate(found.n, n, no_n), estimate(found.k, k, no_k)
    remarks = [remark for one in inputs for remark in one.reading.remarks]
    warnings = [*_unstated(inputs), *remarks, *masked_at(estimates[0], "n"), *masked_at(estimates[1], "k", no_n)]
    return IndexSpectrum(
        mode,
        True,
        np.asarray(wavelength_nm, dtype=float),
        *estimates,
        *k_bounds(found, k, no_k, t, u_t, slope),
        correlation,
        _lossless(next(one.reading for one in inputs if one.name == "T")),
        r,
        t,
        thickness,
        tuple(warnings),
    )


def _propagated(
    inputs: Sequence[_Input], slope: Slopes, thickness: Length, points: int
) -> tuple[Combined, Combined, FloatArray]:
    """Uncertainty of n and of k, and the correlation of their errors."""
    n_parts, k_parts = [], []
    for one in inputs:
        n_parts += one.reading.shares(_along(slope.n_by_r, slope.n_by_t, one))
        k_parts += one.reading.shares(_along(slope.k_by_r, slope.k_by_t, one))
    u_h = thickness.u_um or 0.0
    n_parts.append(Share(slope.n_by_h * u_h, np.inf, True))
    k_parts.append(Share(slope.k_by_h * u_h, np.inf, True))
    together = np.array([n.u * k.u for n, k in zip(n_parts, k_parts, strict=True)]).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = together / np.sqrt(sum(n.u**2 for n in n_parts) * sum(k.u**2 for k in k_parts))
    return combined(n_parts, points), combined(k_parts, points), np.asarray(correlation)


def _along(by_r: FloatArray, by_t: FloatArray, one: _Input) -> FloatArray:
    """Slope by an input; where R or T does not depend on it, an endless slope by that counts nothing."""
    return (by_r * one.r_by if one.r_by else 0.0) + (by_t * one.t_by if one.t_by else np.zeros_like(by_t))


def _sum(inputs: Sequence[_Input], r_share: float, t_share: float, points: int) -> Combined:
    """Uncertainty of a sum of R and T with these shares."""
    parts = [part for one in inputs for part in one.reading.shares(one.r_by * r_share + one.t_by * t_share)]
    return combined(parts, points)


def k_bounds(
    found: Inverted, k: Combined, no_k: Codes, t: FloatArray, u_t: Combined, slope: Slopes
) -> tuple[FloatArray, FloatArray]:
    """95 % bounds of k. Where it is not resolved they are 0 and what a normal error cut off at 0 leaves above 5 %."""
    unresolved, u, u95 = np.isin(no_k, UNRESOLVED), k.u, k.bound(0.95)
    with np.errstate(all="ignore"):
        above = found.k - u * ndtri(0.05 * ndtr(found.k / u))
        darkest = found.k + slope.k_by_t * t * np.log1p(u_t.bound(0.90) / t)  # k runs with ln T there
    seen = (unresolved | (no_k == Why.FINE)) & ~np.isnan(u)
    low = np.where(unresolved, 0.0, np.maximum(found.k - u95, 0.0))
    high = np.where(unresolved, above, found.k + u95)
    low = np.where(seen, low, np.where(no_k == Why.DARK, darkest, np.nan))
    return low, np.where(seen, high, np.nan)


def _lossless(transmittance: Reading) -> Estimate:
    t = transmittance.value
    tests = {Why.MISSING: ~np.isfinite(t), Why.TRANSMITTANCE: ~(t > 0.0), Why.NO_REFLECTION: ~(t < 1.0)}
    why = masks.first(tests)
    u = combined(transmittance.shares(_lossless_slope(t)), t.size)
    return estimate(lossless_index(t), u, why)


def _lossless_slope(t: FloatArray | float) -> FloatArray:
    """Derivative of the lossless index by T."""
    with np.errstate(all="ignore"):
        return np.asarray(-(1.0 + 1.0 / np.sqrt((1.0 - t) * (1.0 + t))) / t**2)


def _assumed(t: FloatArray) -> str:
    """What assuming k = 0 does to n, by the transmittance in the middle."""
    told = "lossless: k = 0 is assumed, so that n is an upper bound"
    if not t.size:
        return told
    middle = float(np.median(t))
    by = -0.001 * float(_lossless_slope(middle))
    return f"{told}; 0.1 % of the light absorbed or scattered raises it by {by:.4f} at T = {middle:.4f}"


def _unstated(inputs: Sequence[_Input]) -> list[str]:
    names = [one.name for one in inputs if not one.reading.known]
    by = {"R": "0.0039 in R", "A": "0.0039 in A", "T": "0.0003 in T" if inputs[0].name == "R" else "0.0042 in T"}
    moves = " and by ".join(by[name] for name in names)
    if not names:
        alone = [one.name for one in inputs if one.reading.repeats > 1 and not one.reading.u_common[1].any()]
        told = "the instrument's own accuracy is not in the uncertainty: only the repeats of {} are; state it with {}"
        return [told.format(" and ".join(alone), _options(alone))] if alone else []
    return [
        f"no uncertainty of {' and '.join(names)} is known, so none of n and k: state it with {_options(names)}, or "
        f"give repeats; near n = 1.5 an error of 0.001 moves n by {moves}"
    ]


def _options(names: Sequence[str]) -> str:
    return " and ".join(f"--u-{name}" for name in names)


def masked_at(one: Estimate, name: str, beside: Codes | None = None) -> list[str]:
    """How many points are masked, by reason; those that are masked in n already are not told again for k."""
    codes = one.why if beside is None else np.where(one.why == beside, Why.FINE, one.why)
    counts = Counter(Why(code) for code in codes.tolist() if code != Why.FINE)
    return [f"{name} is masked at {count} of {codes.size} wavelengths: {WORDS[why]}" for why, count in counts.items()]
