"""Masks, with reasons, where R and T determine no index or no extinction; nothing is ever clipped.

n and k are masked separately. Noise raises R + T slightly above 1 at half the points of a clear sample. k is negative
at these points, so it is not resolved, but n depends only on k² and is kept: masking n would discard half of the points
and bias the others. n is masked only where R + T exceeds 1 by more than three standard uncertainties. In a long
spectrum, noise alone causes a few such points; if there are no more than expected, the limit is raised to one that
noise crosses once in a hundred spectra.

`why_no_n` and `why_no_k` return the reason at each wavelength; `reasons` converts it to words, and `counted` summarises
it.
"""

from collections import Counter
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtrik

from solen.arrays import BoolArray, FloatArray
from solen.material.index.inversion import Inverted
from solen.material.index.reading import Combined, student
from solen.material.warning_prefixes import K_MASKED
from solen.ranks import Caution, warning

Codes = NDArray[np.int8]

ASSUMED_U = 0.003
"""Uncertainty of R and of T assumed for judging R + T > 1 if none is specified: 0.3 %, typical of instruments."""
THREE_SIGMAS = 0.99730020393674
"""Fraction of a normal distribution within three standard deviations."""
STRONG_K, POSSIBLE_N = 0.1, 0.8
"""An index down to 0.8 occurs close to absorption bands with k above 0.1, and not elsewhere."""
ROUNDING = 1e-12
"""Rounding error of R, T and k."""


class Why(IntEnum):
    """Why n or k is masked: a code, and the reason in words."""

    words: str

    def __new__(cls, code: int, words: str = "") -> Self:
        """Create a member with its words."""
        member = int.__new__(cls, code)
        member._value_, member.words = code, words
        return member

    FINE = 0
    MISSING = 1, "no number was measured here"
    REFLECTANCE = 2, "R is not between 0 and 1"
    TRANSMITTANCE = 3, "T is not above 0"
    OPAQUE = 4, "R does not exceed R_F: no light was transmitted"
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
    BRIGHT = 16, "more light came out than went in, by more than three standard uncertainties"
    TOO_CLEAR = 17, "T is above the largest value that any layer can have on this substrate"
    TOO_DARK = 18, ("T is below the value for a lossless layer with an index of up to 3 on this substrate")
    BELOW = 19, "not resolved: k is below 0, but within its uncertainty"


UNRESOLVED = (Why.SMALL, Why.NEGATIVE, Why.BELOW)
"""Reasons for which k keeps its uncertainty and an upper bound."""


def why_no_n(reflectance: FloatArray, transmittance: FloatArray, u_sum: Combined, index: Inverted) -> Codes:
    """Return the reason why n is masked at each wavelength, `Why.FINE` where it is not.

    Parameters
    ----------
    reflectance, transmittance
        The inverted readings.
    u_sum
        Uncertainty of R + T; `ASSUMED_U` of each is used where it is NaN.
    found
        The result of the inversion.
    """
    tests = {
        Why.MISSING: ~(np.isfinite(reflectance) & np.isfinite(transmittance)),
        Why.REFLECTANCE: ~((reflectance > 0.0) & (reflectance < 1.0)),
        Why.TRANSMITTANCE: ~(transmittance > 0.0),
        Why.OPAQUE: ~(index.tau > np.finfo(float).tiny),
        Why.ENERGY: _beyond(reflectance + transmittance - 1.0, u_sum),
        Why.DISCRIMINANT: ~np.isfinite(index.n),
        Why.AMBIGUOUS: (index.k > STRONG_K) & (index.other_n > POSSIBLE_N),
    }
    return first(tests)


def why_no_k(no_n: Codes, k: FloatArray, u_k: Combined, transmittance: FloatArray, u_t: Combined) -> Codes:
    """Return the reason why k is masked at each wavelength; a second index that fits is not a reason.

    If the uncertainty is unknown, k is not tested against it.
    """
    with np.errstate(invalid="ignore"):
        tests = {
            Why.DARK: transmittance <= u_t.bound(THREE_SIGMAS),
            Why.NEGATIVE: k < 0.0,
            Why.SMALL: unresolved(k, u_k),
        }
    lost = (no_n != Why.FINE) & (no_n != Why.AMBIGUOUS)
    return np.where(lost, no_n, first(tests)).astype(np.int8)


def unresolved(k: FloatArray, u_k: Combined) -> BoolArray:
    """Return where k may be 0: below three standard uncertainties, or above at no more points than expected by chance.

    If the uncertainty is unknown, k is not tested against it.
    """
    with np.errstate(invalid="ignore"):
        small = k <= u_k.bound(THREE_SIGMAS)
        if np.sum(k > u_k.bound(THREE_SIGMAS)) <= _by_chance(k):
            small = k <= u_k.bound(_surer(k))
    return np.asarray(small)


def first(tests: dict[Why, BoolArray]) -> Codes:
    """Return the first applicable reason at each wavelength."""
    codes = np.full(next(iter(tests.values())).shape, int(Why.FINE), dtype=np.int8)
    for why, applies in reversed(tests.items()):
        codes[applies] = why
    return codes


def reasons(no_n: Codes, no_k: Codes) -> tuple[str | None, ...]:
    """Return reasons in words, ``n, k: …`` or ``k: …``, or None if neither is masked."""
    return tuple(_reason(Why(n), Why(k)) for n, k in zip(no_n.tolist(), no_k.tolist(), strict=True))


def _reason(no_n: Why, no_k: Why) -> str | None:
    if no_n and no_k == no_n:
        return f"n, k: {no_n.words}"
    return "; ".join(f"{name}: {why.words}" for name, why in (("n", no_n), ("k", no_k)) if why) or None


def counted(name: str, why: Codes, beside: Codes | None = None) -> list[Caution]:
    """Return the number of masked points by reason, except those that ``beside`` masks for the same reason."""
    codes = why if beside is None else np.where(why == beside, Why.FINE, why)
    counts = Counter(Why(code) for code in codes.tolist() if code != Why.FINE)
    begins = K_MASKED if name == "k" else f"{name} is masked"
    return [warning(f"{begins} at {count} of {codes.size} wavelengths: {one.words}") for one, count in counts.items()]


def _beyond(excess: FloatArray, u_sum: Combined) -> BoolArray:
    """Return where R + T exceeds 1 by more than its uncertainty explains."""
    beyond = _exceeds(excess, u_sum, THREE_SIGMAS)
    return beyond if beyond.sum() > _by_chance(excess) else _exceeds(excess, u_sum, _surer(excess))


def _by_chance(values: FloatArray) -> int:
    """Return the number of points beyond three uncertainties that noise alone exceeds in one spectrum of a thousand."""
    return int(np.ceil(pdtrik(0.999, max(int(np.isfinite(values).sum()), 1) * 0.5 * (1.0 - THREE_SIGMAS))))


def _surer(values: FloatArray) -> float:
    """Return the level that noise crosses once in a hundred spectra, at least three standard uncertainties."""
    return max(THREE_SIGMAS, 1.0 - 0.02 / max(int(np.isfinite(values).sum()), 1))


def _exceeds(excess: FloatArray, u_sum: Combined, level: float) -> BoolArray:
    bound = u_sum.bound(level)
    assumed = student(level, np.inf) * np.sqrt(2.0) * ASSUMED_U
    with np.errstate(invalid="ignore"):
        return np.asarray(excess - ROUNDING > np.where(np.isnan(bound), assumed, bound))
