"""Motions of a network that its readings distinguish, and how well, from one reading of every receiver per emitter.

Readings r follow small motions as J m, with noise of covariance C. In units of the noise, W J with W C Wᵀ = 1, each
singular value is the change of all readings together per degree of a combination of motions, in standard deviations.
The best estimate of the motions has the covariance (Jᵀ C⁻¹ J)⁻¹ (Gauss, Markov; for normal noise no estimate is better:
Cramér, Rao). A combination whose singular value is less than `SURE` times its uncertainty is not determined, nor is any
motion with a component in it.

Public names: `determined`, `Determination` and `in_words`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.results import Result, reported

SURE = 2.0
"""Multiple of its uncertainty that a singular value must exceed for its combination of motions to be determined."""
RANK = 1e-12
"""Smallest eigenvalue of a correlation, relative to the largest, for an independent combination of readings."""
SHOWN, ALIKE = 0.1, 0.1
"""Smallest component of a motion that is named in a sentence, and largest difference of two components that count as
equal.
"""


@dataclass(frozen=True)
class Combination:
    """A combination of motions, given by the components of a unit vector, and its effect on all readings together.

    Attributes
    ----------
    shares
        Components by motion: angles whose squares add up to 1 deg².
    singular_per_deg, u_singular_per_deg
        Change of all readings together per degree, in standard deviations of their noise; its uncertainty is a bound.
    """

    shares: dict[str, float]
    singular_per_deg: float
    u_singular_per_deg: float

    @property
    def is_determined(self) -> bool:
        """Whether the readings determine the combination: their change exceeds `SURE` times its uncertainty."""
        return self.singular_per_deg > SURE * self.u_singular_per_deg

    @property
    def sd_deg(self) -> float:
        """Standard deviation of the combination from one reading of all receivers; infinite if it is not determined."""
        return 1.0 / self.singular_per_deg if self.is_determined else math.inf


class Determination(Result):
    """How well readings determine motions, from one reading of every receiver with every emitter in turn.

    Attributes
    ----------
    motions
        Names of the motions.
    sd_deg, u_sd_deg
        Standard deviation (motions,) of each motion if all are unknown, and its uncertainty due to the simulated light;
        infinite and NaN if the readings do not determine the motion.
    covariance_deg2
        Covariance (motions, motions) of the determined combinations.
    combinations
        Combinations of the motions, from the best determined to the worst.
    """

    motions: tuple[str, ...]
    sd_deg: FloatArray
    u_sd_deg: FloatArray
    covariance_deg2: FloatArray
    combinations: tuple[Combination, ...]

    @reported
    def worst_sd_deg(self) -> float:
        """Largest standard deviation of a motion; infinite if one is not determined."""
        return float(self.sd_deg.max(initial=0.0))

    @reported
    def rank(self) -> int:
        """Number of combinations that the readings determine."""
        return sum(combination.is_determined for combination in self.combinations)

    def improves_on(self, other: "Determination") -> bool:
        """Return whether this determines more combinations, or the worst motion better beyond both uncertainties."""
        if self.rank != other.rank or not math.isfinite(self.worst_sd_deg):
            return self.rank > other.rank
        if not math.isfinite(other.worst_sd_deg):
            return True
        gain = other.worst_sd_deg - self.worst_sd_deg
        return gain > math.hypot(*(float(one.u_sd_deg[one.sd_deg.argmax()]) for one in (self, other)))

    @property
    def all_distinguished(self) -> bool:
        """Whether every combination is determined."""
        return self.rank == len(self.motions)


@dataclass(frozen=True)
class Suggestion:
    """A part added to a network, and how well its readings then determine the motions.

    Attributes
    ----------
    part
        ``"receiver"`` or ``"emitter"``.
    place
        Position of the part, in words.
    tables
        Addition to the design file, as TOML.
    worst_sd_deg
        Largest standard deviation of a motion with the part; infinite if one is still not determined.
    rank
        Number of combinations of motions that are determined with the part.
    by_voltages
        Determination of the motions by all voltages with the part.
    """

    part: str
    place: str
    tables: str
    worst_sd_deg: float
    rank: int
    by_voltages: Determination


def determined(
    motions: Sequence[str], slope_per_deg: FloatArray, u_slope_per_deg: FloatArray, covariance: FloatArray
) -> Determination:
    """Return how well readings determine motions.

    Parameters
    ----------
    motions
        Names of M motions.
    slope_per_deg, u_slope_per_deg
        Change (N, M) of each reading per degree, and its uncertainty.
    covariance
        Covariance (N, N) of the readings' noise, in squares of their unit.
    """
    white = _whitening(covariance)
    jacobian, u_squared = white @ slope_per_deg, white**2 @ u_slope_per_deg**2
    _, found, rows = np.linalg.svd(jacobian)
    rows *= np.sign(rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1), None])  # the largest share is positive
    singular = np.zeros(len(motions))
    singular[: len(found)] = found
    u_singular = np.sqrt((u_squared @ rows.T**2).sum(axis=0))
    combinations = tuple(
        Combination(dict(zip(motions, row.tolist(), strict=True)), float(value), float(u))
        for row, value, u in zip(rows, singular, u_singular, strict=True)
    )
    kept = np.array([combination.is_determined for combination in combinations], dtype=bool)
    scaled = rows[kept] / singular[kept, None]
    covariance_deg2 = scaled.T @ scaled
    variance = np.diag(covariance_deg2)
    # first order: d(var_i) = -2 Σ J⁺_in dJ_nm (J⁺J⁺ᵀ)_mi
    inverse = covariance_deg2 @ jacobian.T
    u_variance = 2.0 * np.sqrt(np.einsum("in,nm,mi->i", inverse**2, u_squared, covariance_deg2**2))
    lost = _has_share(rows, singular, u_singular, kept)
    with np.errstate(divide="ignore", invalid="ignore"):
        u_sd = np.where(lost, np.nan, 0.5 * u_variance / np.sqrt(variance))
    return Determination(
        motions=tuple(motions),
        sd_deg=np.where(lost, np.inf, np.sqrt(variance)),
        u_sd_deg=u_sd,
        covariance_deg2=covariance_deg2,
        combinations=combinations,
    )


def _whitening(covariance: FloatArray) -> FloatArray:
    """Return a matrix (K, N) that turns noise of covariance (N, N) and rank K into independent unit noise."""
    sd = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
    kept = values > RANK * values.max(initial=0.0)
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T / sd)


def _has_share(rows: FloatArray, singular: FloatArray, u_singular: FloatArray, kept: BoolArray) -> BoolArray:
    """Return whether each motion (M,) has a component, beyond its uncertainty, in a combination that is not determined.

    The uncertainty of a combination's direction is the uncertainty of its singular value divided by the difference of
    the singular values.
    """
    lost = np.zeros(rows.shape[1], dtype=bool)
    least = float(singular[kept].min(initial=np.inf))
    for row, value, u in zip(rows[~kept], singular[~kept], u_singular[~kept], strict=True):
        lost |= np.abs(row) > (u / (least - value) if math.isfinite(least) else 0.0)
    return lost


def in_words(found: Determination) -> Iterator[str]:
    """Yield sentences about combinations of motions that readings do not determine."""
    lost = [combination for combination in found.combinations if not combination.is_determined]
    if not lost:
        return
    shares = {name: share for name, share in lost[0].shares.items() if abs(share) >= SHOWN}
    if len(lost) > 1:
        known = "; ".join(
            f"{words(combination)} to ± {combination.sd_deg:.2g}°"
            for combination in found.combinations
            if combination.is_determined
        )
        count = f"{found.rank} combination{'s' * (found.rank != 1)}"
        yield f"of the {len(found.motions)} motions only {count} can be measured: {known or 'none'}"
    elif len(shares) == 1:
        yield (f"{next(iter(shares))} changes the readings by no more than its uncertainty, so it cannot be measured")
    elif len(shares) == 2:
        yield _of_two(found, *shares.items())
    else:
        yield (
            f"{', '.join(shares)} change the readings in the same way: the readings do not change "
            f"if these move together as {words(lost[0])}, and this combination cannot be measured"
        )


def _of_two(found: Determination, one: tuple[str, float], other: tuple[str, float]) -> str:
    """Return a sentence about two motions of which one combination changes nothing."""
    (a, share_a), (b, share_b) = (one, other) if abs(one[1]) <= abs(other[1]) else (other, one)
    weight = -share_a / share_b  # of b; a counts as 1
    opposite = weight < 0.0
    if abs(abs(weight) - 1.0) <= ALIKE:
        weight, what = math.copysign(1.0, weight), "their difference" if opposite else "their sum"
    else:
        what = f"{a} {'-' if opposite else '+'} {abs(weight):.2g} {b}"
    w = np.array([{a: 1.0, b: weight}.get(name, 0.0) for name in found.motions])
    sd = math.sqrt(float(w @ found.covariance_deg2 @ w))
    way = "in opposite ways" if opposite else "in the same way"
    return f"{a} and {b} change the readings {way}: only {what} can be measured, to ± {sd:.2g}°"


def words(combination: Combination) -> str:
    """Format a combination of motions: ``+0.71 index, -0.70 ring``."""
    return ", ".join(f"{share:+.2f} {name}" for name, share in combination.shares.items())
