"""Masks, with reasons, where R and T determine no index or no extinction; values are never clipped.

n and k are masked separately. Noise raises R + T slightly above 1 at half of the points of a clear sample. k is
negative at these points, so it is not resolved, but n depends only on k² and is kept: masking n would discard half of
the points and bias the others. n is masked only where R + T exceeds 1 by more than three standard uncertainties. In a
long spectrum, noise alone causes a few such points; if there are no more than expected, the limit is raised to one that
noise exceeds once in a hundred spectra.

`n_codes` and `k_codes` return the reason at each wavelength; `reasons` converts it to words, and `mask_warnings`
summarises it.
"""

from collections import Counter
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtrik

from solen.arrays import BoolArray, FloatArray
from solen.material.index.inversion import AirInversion
from solen.material.index.reading import Combined, student_t
from solen.material.warning_prefixes import K_MASKED
from solen.ranks import Caution, warning

Codes = NDArray[np.int8]

ASSUMED_U = 0.003
"""Uncertainty of R and of T assumed in the test of R + T > 1 if none is specified: 0.3 %, typical of instruments."""
THREE_SIGMAS = 0.99730020393674
"""Fraction of a normal distribution within three standard deviations."""
STRONG_K, POSSIBLE_N = 0.1, 0.8
"""A second index is possible if k and the second index exceed these values: close to strong absorption bands only."""
ROUNDING = 1e-12
"""Rounding error of R, T and k."""


class Reason(IntEnum):
    """Reason why n or k is masked: a code with words."""

    words: str

    def __new__(cls, code: int, words: str = "") -> Self:
        """Create a member with its words."""
        member = int.__new__(cls, code)
        member._value_, member.words = code, words
        return member

    NONE = 0
    MISSING = 1, "R or T was not measured"
    REFLECTANCE = 2, "R is not between 0 and 1"
    TRANSMITTANCE = 3, "T is not above 0"
    OPAQUE = 4, "no light was transmitted: R does not exceed the reflectance of one face"
    ENERGY = 5, "R + T exceeds 1 by more than three standard uncertainties"
    DISCRIMINANT = 6, "no index fits: the expression under the square root in n is negative"
    AMBIGUOUS = 7, "two indices fit equally well, as happens inside strong absorption bands"
    NO_REFLECTION = 8, "T is not below 1: no reflection remains to determine an index"
    NEGATIVE = 9, "not resolved: R + T exceeds 1, but within its uncertainty"
    SMALL = 10, "not resolved: k is below three of its standard uncertainties"
    DARK = 11, "not resolved: T is within three standard uncertainties of 0, so k has only a lower bound"
    ASSUMED = 12, "not measured: this route assumes k = 0"
    PUBLISHED = 13, "not measured: R was computed from T alone"
    NO_FIT = 14, "no index from 1 to 3 produces this T and R on this substrate"
    INDISTINCT = 15, "two indices fit T and R on this substrate within three standard uncertainties"
    BRIGHT = 16, "k is below 0 by more than three standard uncertainties"
    TOO_CLEAR = 17, "T is above the largest value that any layer can have on this substrate"
    TOO_DARK = 18, "T is below that of any lossless layer with an index of up to 3 on this substrate"
    BELOW = 19, "not resolved: k is below 0, but within its uncertainty"


UNRESOLVED = (Reason.SMALL, Reason.NEGATIVE, Reason.BELOW)
"""Reasons for masking k without removing its uncertainty and upper bound."""


def n_codes(reflectance: FloatArray, transmittance: FloatArray, u_sum: Combined, index: AirInversion) -> Codes:
    """Return, for each wavelength, the code of the reason why n is masked; `Reason.NONE` where n is not masked.

    Parameters
    ----------
    reflectance, transmittance
        R and T.
    u_sum
        Uncertainty of R + T; where it is NaN, an uncertainty of `ASSUMED_U` is assumed for both R and T.
    index
        The result of the inversion.
    """
    tests = {
        Reason.MISSING: ~(np.isfinite(reflectance) & np.isfinite(transmittance)),
        Reason.REFLECTANCE: ~((reflectance > 0.0) & (reflectance < 1.0)),
        Reason.TRANSMITTANCE: ~(transmittance > 0.0),
        Reason.OPAQUE: ~(index.tau > np.finfo(float).tiny),
        Reason.ENERGY: _violates_energy(reflectance + transmittance - 1.0, u_sum),
        Reason.DISCRIMINANT: ~np.isfinite(index.n),
        Reason.AMBIGUOUS: (index.k > STRONG_K) & (index.other_n > POSSIBLE_N),
    }
    return first_code(tests)


def k_codes(no_n: Codes, k: FloatArray, u_k: Combined, transmittance: FloatArray, u_t: Combined) -> Codes:
    """Return, for each wavelength, the code of the reason why k is masked; a second index that fits is not a reason.

    If the uncertainty is unknown, k is not tested against it.
    """
    with np.errstate(invalid="ignore"):
        tests = {
            Reason.DARK: transmittance <= u_t.bound(THREE_SIGMAS),
            Reason.NEGATIVE: k < 0.0,
            Reason.SMALL: unresolved(k, u_k),
        }
    lost = (no_n != Reason.NONE) & (no_n != Reason.AMBIGUOUS)
    return np.where(lost, no_n, first_code(tests)).astype(np.int8)


def unresolved(k: FloatArray, u_k: Combined) -> BoolArray:
    """Return a mask of the points at which k may be 0: k is at most three standard uncertainties.

    If no more points exceed this limit than expected by chance, the limit is raised to one that noise exceeds once in a
    hundred spectra. If the uncertainty is unknown, k is not tested against it.
    """
    with np.errstate(invalid="ignore"):
        small = k <= u_k.bound(THREE_SIGMAS)
        if np.sum(k > u_k.bound(THREE_SIGMAS)) <= _expected_by_chance(k):
            small = k <= u_k.bound(_strict_level(k))
    return np.asarray(small)


def first_code(tests: dict[Reason, BoolArray]) -> Codes:
    """Return the code of the first reason that applies at each wavelength."""
    codes = np.full(next(iter(tests.values())).shape, int(Reason.NONE), dtype=np.int8)
    for reason, applies in reversed(tests.items()):
        codes[applies] = reason
    return codes


def reasons(no_n: Codes, no_k: Codes) -> tuple[str | None, ...]:
    """Return the reasons in words, ``n, k: …`` or ``k: …``, or None if neither is masked."""
    return tuple(_in_words(Reason(n), Reason(k)) for n, k in zip(no_n.tolist(), no_k.tolist(), strict=True))


def _in_words(no_n: Reason, no_k: Reason) -> str | None:
    if no_n and no_k == no_n:
        return f"n, k: {no_n.words}"
    return "; ".join(f"{name}: {reason.words}" for name, reason in (("n", no_n), ("k", no_k)) if reason) or None


def mask_warnings(name: str, codes: Codes, other: Codes | None = None) -> list[Caution]:
    """Return warnings with the number of masked points for each reason, without those that ``other`` also masks."""
    codes = codes if other is None else np.where(codes == other, Reason.NONE, codes)
    counts = Counter(Reason(code) for code in codes.tolist() if code != Reason.NONE)
    prefix = K_MASKED if name == "k" else f"{name} is masked"
    return [
        warning(f"{prefix} at {count} of {codes.size} wavelengths: {reason.words}") for reason, count in counts.items()
    ]


def _violates_energy(excess: FloatArray, u_sum: Combined) -> BoolArray:
    """Return a mask of the points at which R + T exceeds 1 by more than its uncertainty explains."""
    violates = _exceeds(excess, u_sum, THREE_SIGMAS)
    if violates.sum() > _expected_by_chance(excess):
        return violates
    return _exceeds(excess, u_sum, _strict_level(excess))


def _expected_by_chance(values: FloatArray) -> int:
    """Return the number of points above three uncertainties that is exceeded in 0.1 % of spectra with noise alone."""
    return int(np.ceil(pdtrik(0.999, max(int(np.isfinite(values).sum()), 1) * 0.5 * (1.0 - THREE_SIGMAS))))


def _strict_level(values: FloatArray) -> float:
    """Return the coverage, at least `THREE_SIGMAS`, of the limit that noise exceeds in one spectrum of a hundred."""
    return max(THREE_SIGMAS, 1.0 - 0.02 / max(int(np.isfinite(values).sum()), 1))


def _exceeds(excess: FloatArray, u_sum: Combined, level: float) -> BoolArray:
    bound = u_sum.bound(level)
    assumed = student_t(level, np.inf) * np.sqrt(2.0) * ASSUMED_U
    with np.errstate(invalid="ignore"):
        return np.asarray(excess - ROUNDING > np.where(np.isnan(bound), assumed, bound))
