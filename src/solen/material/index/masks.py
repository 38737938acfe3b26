"""Where R and T carry no index, and where they carry no extinction: masks with their reasons; nothing is ever clipped.

The idea: n and k are masked apart. R + T a little above 1 is what noise makes of half the points of a clear sample; k
is negative there, so not resolved, but n depends on k² alone and stays: to mask it would throw away half of the points
and bias the rest. n goes only where R + T exceeds 1 by more than three standard uncertainties. In a long spectrum noise
alone puts a few points there; where there are no more than that, the bound is the one that noise crosses once in a
hundred spectra.

The interface: `why_no_n` and `why_no_k` find the reason at each wavelength, `told` puts them in words.
"""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtrik

from solen.arrays import FloatArray
from solen.material.index.inversion import Inverted
from solen.material.index.reading import Combined, student

Codes = NDArray[np.int8]

ASSUMED_U = 0.003
"""Uncertainty of R and of T that R + T > 1 is judged by where none is stated: that of usual instruments, 0.3 %."""
THREE_SIGMAS = 0.99730020393674
"""Share of a normal distribution within three standard deviations."""
STRONG_K, POSSIBLE_N = 0.1, 0.8
"""An index down to 0.8 occurs beside absorption bands with k above 0.1, and not elsewhere."""
_ROUNDING = 1e-12  # of R + T


class Why(IntEnum):
    """Why n or k is masked."""

    FINE = 0
    MISSING = 1
    REFLECTANCE = 2
    TRANSMITTANCE = 3
    OPAQUE = 4
    ENERGY = 5
    DISCRIMINANT = 6
    AMBIGUOUS = 7
    NO_REFLECTION = 8
    NEGATIVE = 9
    SMALL = 10
    DARK = 11
    ASSUMED = 12
    PUBLISHED = 13
    NO_FIT = 14
    INDISTINCT = 15
    BRIGHT = 16
    TOO_CLEAR = 17
    TOO_DARK = 18
    BELOW = 19


WORDS = {
    Why.MISSING: "no number was measured here",
    Why.REFLECTANCE: "R is not between 0 and 1",
    Why.TRANSMITTANCE: "T is not above 0",
    Why.OPAQUE: "R does not exceed R_F: no light came through",
    Why.ENERGY: "R + T exceeds 1 by more than three standard uncertainties",
    Why.DISCRIMINANT: "no index fits: the square in n is negative",
    Why.AMBIGUOUS: "two indices fit as well, as happens inside strong absorption bands",
    Why.NO_REFLECTION: "T is not below 1: no reflection is left for an index",
    Why.NEGATIVE: "not resolved: R + T exceeds 1, within its uncertainty",
    Why.SMALL: "not resolved: k is below its own uncertainty",
    Why.DARK: "not resolved: T is within three standard uncertainties of 0, so k has a lower bound only",
    Why.ASSUMED: "not measured: this route assumes k = 0",
    Why.PUBLISHED: "no measurement: R was made of T alone",
    Why.NO_FIT: "no index from 1 to 3 reads this T and R on this substrate",
    Why.INDISTINCT: "two indices fit T and R on this substrate within three standard uncertainties",
    Why.BRIGHT: "more light came out than went in, by more than three standard uncertainties",
    Why.TOO_CLEAR: "T is above the most that a layer of any index reads on this substrate",
    Why.BELOW: "not resolved: k is below 0, within its uncertainty",
    Why.TOO_DARK: "T is below what a lossless layer of an index up to 3 reads on this substrate",
}


def why_no_n(reflectance: FloatArray, transmittance: FloatArray, u_sum: Combined, found: Inverted) -> Codes:
    """Reason at each wavelength why n is masked, `Why.FINE` where it is not.

    Parameters
    ----------
    reflectance, transmittance
        What was inverted.
    u_sum
        Uncertainty of R + T, NaN where none is known: then `ASSUMED_U` of each is taken.
    found
        What came of it.
    """
    tests = {
        Why.MISSING: ~(np.isfinite(reflectance) & np.isfinite(transmittance)),
        Why.REFLECTANCE: ~((reflectance > 0.0) & (reflectance < 1.0)),
        Why.TRANSMITTANCE: ~(transmittance > 0.0),
        Why.OPAQUE: ~(found.tau > np.finfo(float).tiny),
        Why.ENERGY: _beyond(reflectance + transmittance - 1.0, u_sum),
        Why.DISCRIMINANT: ~np.isfinite(found.n),
        Why.AMBIGUOUS: (found.k > STRONG_K) & (found.other_n > POSSIBLE_N),
    }
    return first(tests)


def why_no_k(no_n: Codes, k: FloatArray, u_k: Combined, transmittance: FloatArray, u_t: Combined) -> Codes:
    """Reason at each wavelength why k is masked; that two indices fit is none.

    Where no uncertainty is known, k is not judged by it.
    """
    with np.errstate(invalid="ignore"):
        tests = {
            Why.DARK: transmittance <= u_t.bound(THREE_SIGMAS),
            Why.NEGATIVE: k < 0.0,
            Why.SMALL: k <= u_k.u,
        }
    lost = (no_n != Why.FINE) & (no_n != Why.AMBIGUOUS)
    return np.where(lost, no_n, first(tests)).astype(np.int8)


def first(tests: dict[Why, NDArray[np.bool_]]) -> Codes:
    """First reason that applies, at each wavelength."""
    found = np.full(next(iter(tests.values())).shape, int(Why.FINE), dtype=np.int8)
    for why, applies in reversed(tests.items()):
        found[applies] = why
    return found


def told(no_n: Codes, no_k: Codes) -> tuple[str | None, ...]:
    """Reasons in words, ``n, k: …`` or ``k: …``, None where neither is masked."""
    return tuple(_told(Why(n), Why(k)) for n, k in zip(no_n.tolist(), no_k.tolist(), strict=True))


def _told(no_n: Why, no_k: Why) -> str | None:
    parts = {f"n{', k' if no_k == no_n else ''}: {WORDS[no_n]}"} if no_n else set()
    parts |= {f"k: {WORDS[no_k]}"} if no_k and no_k != no_n else set()
    return "; ".join(sorted(parts, reverse=True)) or None


def _beyond(excess: FloatArray, u_sum: Combined) -> NDArray[np.bool_]:
    """Where R + T exceeds 1 by more than its uncertainty explains."""
    points = max(int(np.isfinite(excess).sum()), 1)
    beyond = _exceeds(excess, u_sum, THREE_SIGMAS)
    if beyond.sum() > np.ceil(pdtrik(0.999, points * 0.5 * (1.0 - THREE_SIGMAS))):
        return beyond
    return _exceeds(excess, u_sum, max(THREE_SIGMAS, 1.0 - 0.02 / points))


def _exceeds(excess: FloatArray, u_sum: Combined, level: float) -> NDArray[np.bool_]:
    bound = u_sum.bound(level)
    assumed = student(level, np.inf) * np.sqrt(2.0) * ASSUMED_U
    with np.errstate(invalid="ignore"):
        return np.asarray(excess - _ROUNDING > np.where(np.isnan(bound), assumed, bound))
