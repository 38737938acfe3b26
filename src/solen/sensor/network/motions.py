"""Motions of a network that its readings distinguish, and how well, from one reading of every receiver per emitter.

For small motions m, the readings change by J m, with noise of covariance C. In units of the noise the matrix is W J,
with W C Wᵀ = 1. Each of its singular values is the change of all readings together, in standard deviations, per degree
of a combination of motions. The best linear unbiased estimate of the motions has the covariance (Jᵀ C⁻¹ J)⁻¹
(Gauss-Markov), which for normal noise is the Cramér-Rao bound. A combination whose singular value is less than
`MIN_SIGNIFICANCE` times its uncertainty is not determined, nor is any motion with a component in it.

Public names: `determined`, `Determination`, `Combination`, `Suggestion`, `undetermined_sentences` and
`combination_text`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.results import Result, reported

MIN_SIGNIFICANCE = 2.0
"""Multiple of its uncertainty that a singular value must exceed for its combination of motions to be determined."""
MIN_EIGENVALUE = 1e-12
"""Smallest eigenvalue of the correlation matrix, relative to the largest, of an independent combination of readings."""
MIN_COMPONENT, MAX_DIFFERENCE = 0.1, 0.1
"""Smallest component of a motion named in a sentence, and largest difference of components treated as equal."""


@dataclass(frozen=True)
class Combination:
    """A combination of motions, given by the components of a unit vector, and its effect on all readings together.

    Attributes
    ----------
    shares
        Components, keyed by motion: angles whose squares add up to 1 deg².
    singular_per_deg, u_singular_per_deg
        Change of all readings together per degree, in standard deviations of their noise; its uncertainty is a bound.
    """

    shares: dict[str, float]
    singular_per_deg: float
    u_singular_per_deg: float

    @property
    def is_determined(self) -> bool:
        """Whether the readings determine the combination: they change by more than twice their uncertainty."""
        return self.singular_per_deg > MIN_SIGNIFICANCE * self.u_singular_per_deg

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
        infinite and NaN for a motion that the readings do not determine.
    covariance_deg2
        Covariance (motions, motions) of the determined combinations.
    combinations
        Combinations of the motions, the best determined first.
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
        """Return whether this determines more combinations than ``other``, or the worst motion significantly better."""
        if self.rank != other.rank or not math.isfinite(self.worst_sd_deg):
            return self.rank > other.rank
        if not math.isfinite(other.worst_sd_deg):
            return True
        gain = other.worst_sd_deg - self.worst_sd_deg
        return gain > math.hypot(*(float(each.u_sd_deg[each.sd_deg.argmax()]) for each in (self, other)))

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
        Description of the part's position.
    tables
        TOML tables to add to the design file.
    worst_sd_deg
        Largest standard deviation of a motion with the part; infinite if one is still not determined.
    rank
        Number of combinations of motions that are determined with the part.
    by_voltages
        Determination of the motions by all voltages, with the part.
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
    whitening = _whitening(covariance)
    jacobian, u_squared = whitening @ slope_per_deg, whitening**2 @ u_slope_per_deg**2
    _, values, directions = np.linalg.svd(jacobian)
    largest = directions[np.arange(len(directions)), np.abs(directions).argmax(axis=1), None]
    directions *= np.sign(largest)  # the largest component is positive
    singular = np.zeros(len(motions))
    singular[: len(values)] = values
    u_singular = np.sqrt((u_squared @ directions.T**2).sum(axis=0))
    combinations = tuple(
        Combination(dict(zip(motions, direction.tolist(), strict=True)), float(value), float(u))
        for direction, value, u in zip(directions, singular, u_singular, strict=True)
    )
    is_determined = np.array([combination.is_determined for combination in combinations], dtype=bool)
    scaled = directions[is_determined] / singular[is_determined, None]
    covariance_deg2 = scaled.T @ scaled
    variance = np.diag(covariance_deg2)
    # first order: d(var_i) = -2 Σ J⁺_in dJ_nm (J⁺J⁺ᵀ)_mi
    inverse = covariance_deg2 @ jacobian.T
    u_variance = 2.0 * np.sqrt(np.einsum("in,nm,mi->i", inverse**2, u_squared, covariance_deg2**2))
    undetermined = _has_undetermined_component(directions, singular, u_singular, is_determined)
    with np.errstate(divide="ignore", invalid="ignore"):
        u_sd = np.where(undetermined, np.nan, 0.5 * u_variance / np.sqrt(variance))
    return Determination(
        motions=tuple(motions),
        sd_deg=np.where(undetermined, np.inf, np.sqrt(variance)),
        u_sd_deg=u_sd,
        covariance_deg2=covariance_deg2,
        combinations=combinations,
    )


def _whitening(covariance: FloatArray) -> FloatArray:
    """Return a matrix (K, N) that turns noise of covariance (N, N) and rank K into independent unit noise."""
    sd = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
    kept = values > MIN_EIGENVALUE * values.max(initial=0.0)
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T / sd)


def _has_undetermined_component(
    directions: FloatArray, singular: FloatArray, u_singular: FloatArray, is_determined: BoolArray
) -> BoolArray:
    """Return whether each motion (M,) has a component, above its uncertainty, in a combination that is not determined.

    The uncertainty of a combination's direction is the uncertainty of its singular value divided by the difference of
    the singular values.
    """
    has_component = np.zeros(directions.shape[1], dtype=bool)
    smallest = float(singular[is_determined].min(initial=np.inf))
    rows = (directions[~is_determined], singular[~is_determined], u_singular[~is_determined])
    for direction, value, u in zip(*rows, strict=True):
        has_component |= np.abs(direction) > (u / (smallest - value) if math.isfinite(smallest) else 0.0)
    return has_component


def undetermined_sentences(determination: Determination) -> Iterator[str]:
    """Yield sentences about the combinations of motions that readings do not determine."""
    undetermined = [combination for combination in determination.combinations if not combination.is_determined]
    if not undetermined:
        return
    components = {name: value for name, value in undetermined[0].shares.items() if abs(value) >= MIN_COMPONENT}
    if len(undetermined) > 1:
        known = "; ".join(
            f"{combination_text(combination)} to ± {combination.sd_deg:.2g}°"
            for combination in determination.combinations
            if combination.is_determined
        )
        count = f"{determination.rank} combination{'s' * (determination.rank != 1)}"
        yield f"only {count} of the {len(determination.motions)} motions can be measured: {known or 'none'}"
    elif len(components) == 1:
        yield (
            f"{next(iter(components))} changes the readings by no more than their uncertainty: it cannot be measured"
        )
    elif len(components) == 2:
        yield _two_motion_sentence(determination, *components.items())
    else:
        yield (
            f"{', '.join(components)} cannot be determined separately: the readings do not change if they move "
            f"together as {combination_text(undetermined[0])}, so this combination cannot be measured"
        )


def _two_motion_sentence(determination: Determination, first: tuple[str, float], second: tuple[str, float]) -> str:
    """Return a sentence about two motions of which one combination does not change the readings."""
    (a, component_a), (b, component_b) = (first, second) if abs(first[1]) <= abs(second[1]) else (second, first)
    weight = -component_a / component_b  # of b, for a weight of 1 of a
    opposite = weight < 0.0
    if abs(abs(weight) - 1.0) <= MAX_DIFFERENCE:
        weight, target = math.copysign(1.0, weight), "their difference" if opposite else "their sum"
    else:
        target = f"{a} {'-' if opposite else '+'} {abs(weight):.2g} {b}"
    weights = np.array([{a: 1.0, b: weight}.get(name, 0.0) for name in determination.motions])
    sd = math.sqrt(float(weights @ determination.covariance_deg2 @ weights))
    effect = "opposite" if opposite else "the same"
    return f"{a} and {b} have {effect} effects on the readings: only {target} can be measured, to ± {sd:.2g}°"


def combination_text(combination: Combination) -> str:
    """Format a combination of motions: ``+0.71 index, -0.70 ring``."""
    return ", ".join(f"{share:+.2f} {name}" for name, share in combination.shares.items())
