"""Finding a coupon in a picture: which spots are which features.

Two spots that might be two of the largest features, by their sizes and their distance, place the whole coupon, once as
it is and once mirrored. Each such guess is scored by how many features have a spot where they should, and the best are
fitted by least squares. What decides in the end are places, sizes but for a common offset, as print and light change
all alike, and the marks. A second guess that puts the features elsewhere and is nearly as good makes it ambiguous.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.geometry.coupons import Coupon, Feature
from solen.metrology.coupons.blobs import Blobs, blobs
from solen.metrology.pose import Placement, fitted, flat, places

WINDOW = 1.0
"""Window of the top hat, in diameters of the largest feature: a disc holds no square as wide as 0.71 of them."""
LARGEST = 9
"""Features that are tried for the two spots of a guess."""
SCALE = 0.06
"""By how much print and scale may differ from the layout together."""
SIZE = 0.5
"""Natural logarithm of how much a spot may differ in size from its feature."""
SHORT = 0.12
"""Share of the coupon's extent that two features of a guess are apart at least."""
NEAR_MM, NEARER_MM = 0.25, 0.12
"""How far a spot may be from where its feature should be, at first and after the fit."""
PLACE_MM, DIAMETER_MM = 0.02, 0.04
"""What counts as one standard deviation of a spot's place and size."""
GROWN_MM, STRETCHED = 0.06, 0.015
"""The same for all sizes together, and for the scale: a shift by one feature would be a print of another size."""
MISSING, MARK = 4.0, 4.0
"""Cost of a feature without its spot, and how much more a mark counts."""
CLEAR = 4.0
"""By how much the best guess must be better than another."""
MOST_GUESSES, FITTED = 4000, 40
FEWEST = 3


@dataclass(frozen=True)
class Registration:
    """Where the coupon was found.

    Attributes
    ----------
    placement
        From the layout to the picture.
    bright
        Whether its features are brighter than what surrounds them.
    matched
        Names of the features that have a spot.
    oriented
        Whether the marks tell a mirror image from the coupon itself.
    rms_mm
        Root of the mean square distance of the spots from the features' places.
    """

    placement: Placement
    bright: bool
    matched: tuple[str, ...]
    oriented: bool
    rms_mm: float


@dataclass(frozen=True)
class _Guess:
    placement: Placement
    pairs: tuple[tuple[int, int], ...]
    cost: float
    rms_mm: float
    bright: bool


def register(grey: FloatArray, coupon: Coupon, px_per_mm: float, what: str) -> Registration:
    """Find a coupon of round features in a picture.

    Parameters
    ----------
    grey
        Shape (rows, columns).
    coupon
        What was printed.
    px_per_mm
        Scale of the picture.
    what
        The picture, as errors name it.

    Raises
    ------
    DataError
        Where the coupon is not found, or could lie in two ways.
    """
    features = [one for one in coupon.features if one.round]
    window = WINDOW * px_per_mm * max(one.diameter_mm for one in features)
    guesses: list[_Guess] = []
    for bright in (True, False):
        spots = blobs(grey, window, bright=bright)
        guesses += _guesses(spots, features, px_per_mm, grey.shape, bright=bright)
    guesses.sort(key=lambda one: one.cost)
    if not guesses or len(guesses[0].pairs) < FEWEST:
        limit = f"shows no {coupon.name}: fewer than {FEWEST} of its features are found where they should be"
        remedy = "check --coupon and --um-per-px, and that the marks or the largest features are in the picture"
        raise DataError(what, limit=limit, remedy=remedy)
    best = guesses[0]
    _check_clear(best, guesses, features, what, coupon.name)
    matched = tuple(features[i].name for i, _ in best.pairs)
    flipped = [one.cost for one in guesses if one.placement.mirrored != best.placement.mirrored]
    oriented = not flipped or min(flipped) - best.cost >= CLEAR
    return Registration(best.placement, best.bright, matched, oriented, best.rms_mm)


def _check_clear(best: _Guess, guesses: list[_Guess], features: list[Feature], what: str, name: str) -> None:
    """`DataError` where another guess, nearly as good, puts what is measured elsewhere."""
    measured = places([one for one in features if one.kind != "mark"])
    here = best.placement.px(measured)
    for other in guesses[1:]:
        if other.cost - best.cost >= CLEAR:
            return
        there = other.placement.px(measured)
        if np.hypot(*(here - there).T).max() > NEAR_MM * best.placement.px_per_mm:
            limit = f"the {name} could lie in two ways: its marks or largest features are not to be seen"
            raise DataError(what, limit=limit, remedy="take a picture with the marks in it")


def _guesses(
    spots: Blobs, features: Sequence[Feature], px_per_mm: float, shape: tuple[int, ...], *, bright: bool
) -> list[_Guess]:
    if len(spots.diameter_px) < FEWEST:
        return []
    at, sizes = places(features), np.array([one.diameter_mm for one in features])
    seen = spots.places_px[:, 0] + 1j * spots.places_px[:, 1]
    rough = _rough(at, sizes, seen, spots.diameter_px / px_per_mm, px_per_mm)
    return [_refined(one, at, sizes, spots, features, shape, px_per_mm, bright=bright) for one in rough]


def _rough(
    at: FloatArray, sizes: FloatArray, seen: NDArray[np.complex128], seen_mm: FloatArray, px_per_mm: float
) -> list[Placement]:
    """Placements of pairs of spots, best first by how many features they explain."""
    extent = float(np.ptp(at, axis=0).max())
    order = np.argsort(-sizes, kind="stable")[:LARGEST]
    apart = np.abs(seen[None, :] - seen[:, None])
    alike = np.abs(np.log(seen_mm[None, :] / sizes[:, None])) < SIZE
    found: list[tuple[complex, complex, bool]] = []
    for i, k in combinations(order.tolist(), 2):
        distance = float(np.hypot(*(at[i] - at[k])))
        if distance < SHORT * extent:
            continue
        near = np.abs(apart / (px_per_mm * distance) - 1.0) < SCALE
        for a, b in np.argwhere(near & alike[i][:, None] & alike[k][None, :]).tolist():
            for mirrored in (False, True):
                p = flat(at[[i, k]], mirrored=mirrored)
                factor = (seen[b] - seen[a]) / (p[1] - p[0])
                found.append((complex(factor), complex(seen[a] - factor * p[0]), mirrored))
    if len(found) > MOST_GUESSES:
        found = found[:: len(found) // MOST_GUESSES + 1]
    scores = [_score(one, at, seen, alike, px_per_mm) for one in found]
    best: list[int] = np.argsort(-np.array(scores, dtype=float), kind="stable").tolist()
    chosen: list[Placement] = []
    for number in best:
        one = Placement.of(found[number][0], found[number][1], mirrored=found[number][2])
        if not any(_same(one, other, extent) for other in chosen):
            chosen.append(one)
        if len(chosen) == FITTED:
            break
    return chosen


def _same(one: Placement, other: Placement, extent: float) -> bool:
    if one.mirrored != other.mirrored:
        return False
    turned = abs(one.factor - other.factor) * extent
    moved = abs(complex(*one.middle_px) - complex(*other.middle_px))
    return turned + moved < NEAR_MM * one.px_per_mm


def _score(
    guess: tuple[complex, complex, bool],
    at: FloatArray,
    seen: NDArray[np.complex128],
    alike: NDArray[np.bool_],
    px_per_mm: float,
) -> int:
    """How many features have a spot of about their size where they should."""
    factor, shift, mirrored = guess
    expected = factor * flat(at, mirrored=mirrored) + shift
    near = np.abs(expected[:, None] - seen[None, :]) < NEAR_MM * px_per_mm
    return int(np.count_nonzero((near & alike).any(axis=1)))


def _refined(
    placement: Placement,
    at: FloatArray,
    sizes: FloatArray,
    spots: Blobs,
    features: Sequence[Feature],
    shape: tuple[int, ...],
    px_per_mm: float,
    *,
    bright: bool,
) -> _Guess:
    """A placement fitted to its spots, and what it costs."""
    pairs: list[tuple[int, int]] = []
    for near_mm in (NEAR_MM, NEARER_MM, NEARER_MM):
        pairs = _pairs(placement, at, sizes, spots, near_mm)
        if len(pairs) < 2:
            break
        i, j = np.array(pairs).T
        placement = fitted(at[i], spots.places_px[j], mirrored=placement.mirrored)
    cost, rms = _cost(placement, pairs, at, sizes, spots, features, shape, px_per_mm)
    return _Guess(placement, tuple(pairs), cost, rms, bright)


def _pairs(
    placement: Placement, at: FloatArray, sizes: FloatArray, spots: Blobs, near_mm: float
) -> list[tuple[int, int]]:
    """Features and spots that are each other's nearest."""
    expected = placement.px(at)
    apart = np.hypot(*(expected[:, None, :] - spots.places_px[None, :, :]).transpose(2, 0, 1))
    ratio = np.abs(np.log(spots.diameter_px[None, :] / (placement.px_per_mm * sizes[:, None])))
    apart = np.where(ratio < SIZE, apart, np.inf)
    nearest = apart.argmin(axis=1)
    back = apart.argmin(axis=0)
    return [(i, int(j)) for i, j in enumerate(nearest) if back[j] == i and apart[i, j] < near_mm * placement.px_per_mm]


def _cost(
    placement: Placement,
    pairs: list[tuple[int, int]],
    at: FloatArray,
    sizes: FloatArray,
    spots: Blobs,
    features: Sequence[Feature],
    shape: tuple[int, ...],
    px_per_mm: float,
) -> tuple[float, float]:
    """Cost of a placement.

    It is the sum of squares of deviations, each `MISSING` at most, and `MISSING` for each feature that is not found
    though it should be in the picture, less `MISSING` for each spot that is explained.
    """
    weight = np.array([MARK if one.kind == "mark" else 1.0 for one in features])
    expected = placement.px(at)
    reach = 0.6 * placement.px_per_mm * sizes
    inside = (expected > reach[:, None]).all(axis=1) & (expected < np.array(shape[::-1]) - reach[:, None]).all(axis=1)
    lost = MISSING * weight * inside
    if not pairs:
        return float(lost.sum()), float("inf")
    i, j = np.array(pairs).T
    away = np.hypot(*(expected[i] - spots.places_px[j]).T) / placement.px_per_mm
    larger = spots.diameter_px[j] / placement.px_per_mm - sizes[i]
    off = (away / PLACE_MM) ** 2 + ((larger - np.median(larger)) / DIAMETER_MM) ** 2
    kept = np.minimum(off, MISSING) * weight[i]
    rest = lost.sum() - lost[i].sum() - MISSING * len(pairs)
    rest += (float(np.median(larger)) / GROWN_MM) ** 2 + ((placement.px_per_mm / px_per_mm - 1.0) / STRETCHED) ** 2
    return float(kept.sum() + rest), float(np.sqrt(np.mean(away**2)))
