"""Location of a coupon in an image or a height map, from the blobs of its features or from the slab.

Two blobs whose sizes and distance match two of the largest features fix the pose of the entire coupon, once as drawn
and once mirrored. Each hypothesis is scored by the number of features with a blob at the expected position, and the
best ones are fitted by least squares. The final choice is based on positions, marks, and sizes up to a common offset,
because print and illumination change all sizes alike. The pose is ambiguous if another pose with different positions
fits nearly as well.

A coupon of blocks is located in a height map by its rectangular slab, and oriented by the blocks' heights.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import ndimage

from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError
from solen.geometry.coupons import Coupon, Feature
from solen.metrology.coupons.blobs import Blobs, blobs
from solen.metrology.pose import Pose

WINDOW = 1.0
"""Window of the top hat, in diameters of the largest feature: a disc contains no square wider than 0.71 of its
diameter.
"""
TRIED_FEATURES = 9
"""Number of the largest features that are tried as the two blobs of a hypothesis."""
SCALE = 0.06
"""Largest combined relative deviation of print and scale from the layout."""
SIZE = 0.5
"""Largest natural logarithm of the ratio of a blob's size to its feature's."""
SHORT = 0.12
"""Minimum distance between the two features of a hypothesis, as a fraction of the coupon's extent."""
NEAR_MM, NEARER_MM = 0.25, 0.12
"""Largest distance of a blob from the position of its feature, before and after the fit."""
PLACE_MM, DIAMETER_MM = 0.02, 0.04
"""Assumed standard deviations of a blob's position and diameter."""
GROWN_MM, STRETCHED = 0.06, 0.015
"""Assumed standard deviations of a size offset common to all features, and of the scale: a shift by one feature would
imply a print of another size.
"""
MISSING, MARK = 4.0, 4.0
"""Cost of a feature without a blob, and the extra weight of a mark."""
CLEAR = 4.0
"""Minimum cost difference between the best hypothesis and any other."""
PARAMETERS, MANY, PLACED_MM = 4, 8, 0.003
"""Number of pose parameters; number of further positions above which their scatter is reliable; and its minimum
value.
"""
MAX_GUESSES, FITTED = 4000, 40
MIN_FEATURES = 3
AREA, SIDES = 0.15, 0.1
"""Largest relative deviations of a slab's area and side ratio from the layout."""


@dataclass(frozen=True)
class Location:
    """Pose of the located coupon.

    Attributes
    ----------
    pose
        Pose of the layout in the image, at the scale that fits the positions of the features.
    bright
        Whether its features are brighter than their surroundings.
    matched
        Names of the features that have a blob.
    oriented
        Whether the marks distinguish the coupon from its mirror image.
    rms_mm
        Root mean square distance of the blobs from the positions of their features.
    """

    pose: Pose
    bright: bool
    matched: tuple[str, ...]
    oriented: bool
    rms_mm: float


@dataclass(frozen=True)
class _Guess:
    pose: Pose
    pairs: tuple[tuple[int, int], ...]
    cost: float
    rms_mm: float
    bright: bool


@dataclass(frozen=True, eq=False)
class _Search:
    """A coupon's round features and the image blobs that they are matched with."""

    features: Sequence[Feature]
    blobs: Blobs
    px_per_mm: float
    shape: tuple[int, ...]
    bright: bool

    @property
    def places_mm(self) -> FloatArray:
        return places(self.features)

    @property
    def sizes_mm(self) -> FloatArray:
        return np.array([feature.diameter_mm for feature in self.features])

    def alike(self, px_per_mm: float) -> BoolArray:
        """Return whether features (rows) and blobs (columns) are of about the same size."""
        ratio = self.blobs.diameter_px[None, :] / (px_per_mm * self.sizes_mm[:, None])
        return np.asarray(np.abs(np.log(ratio)) < SIZE)

    def guesses(self) -> list[_Guess]:
        """Return fitted hypotheses of the coupon's pose."""
        if len(self.blobs.diameter_px) < MIN_FEATURES:
            return []
        return [self._refined(pose) for pose in self._rough()]

    def _rough(self) -> list[Pose]:
        """Return poses from pairs of blobs, those that explain the most features first."""
        at, seen = self.places_mm, self.blobs.places_px
        extent = float(np.ptp(at, axis=0).max())
        order = np.argsort(-self.sizes_mm, kind="stable")[:TRIED_FEATURES]
        apart = np.hypot(*(seen[None, :] - seen[:, None]).transpose(2, 0, 1))
        alike = self.alike(self.px_per_mm)
        pairs: list[tuple[int, int, int, int, bool]] = []
        for i, k in combinations(order.tolist(), 2):
            distance = float(np.hypot(*(at[i] - at[k])))
            if distance < SHORT * extent:
                continue
            near = np.abs(apart / (self.px_per_mm * distance) - 1.0) < SCALE
            both = np.argwhere(near & alike[i][:, None] & alike[k][None, :]).tolist()
            pairs += [(i, k, first, second, mirrored) for first, second in both for mirrored in (False, True)]
        if len(pairs) > MAX_GUESSES:
            pairs = pairs[:: len(pairs) // MAX_GUESSES + 1]
        poses = [Pose.fitted(at[[i, k]], seen[[first, second]], mirrored=m) for i, k, first, second, m in pairs]
        explained = [self._explained(pose, alike) for pose in poses]
        return _distinct([poses[k] for k in np.argsort(-np.array(explained, dtype=float), kind="stable")], extent)

    def _explained(self, pose: Pose, alike: BoolArray) -> int:
        """Return the number of features that have a blob of about the right size at their position."""
        return int(np.count_nonzero(((self._apart_px(pose) < NEAR_MM * self.px_per_mm) & alike).any(axis=1)))

    def _apart_px(self, pose: Pose) -> FloatArray:
        """Return the distances between feature positions (rows) and blobs (columns)."""
        apart = pose.to_px(self.places_mm)[:, None, :] - self.blobs.places_px[None, :, :]
        return np.asarray(np.hypot(apart[..., 0], apart[..., 1]))

    def _refined(self, pose: Pose) -> _Guess:
        """Fit a pose to its blobs, and compute its cost."""
        pairs: list[tuple[int, int]] = []
        for near_mm in (NEAR_MM, NEARER_MM, NEARER_MM):
            pairs = self._pairs(pose, near_mm)
            if len(pairs) < 2:
                break
            i, j = np.array(pairs).T
            pose = Pose.fitted(self.places_mm[i], self.blobs.places_px[j], mirrored=pose.mirrored)
        cost, rms = self._cost(pose, pairs)
        return _Guess(pose, tuple(pairs), cost, rms, self.bright)

    def _pairs(self, pose: Pose, near_mm: float) -> list[tuple[int, int]]:
        """Return pairs of features and blobs that are mutual nearest neighbours."""
        apart = np.where(self.alike(pose.px_per_mm), self._apart_px(pose), np.inf)
        nearest, back = apart.argmin(axis=1), apart.argmin(axis=0)
        most = near_mm * pose.px_per_mm
        return [(i, int(j)) for i, j in enumerate(nearest) if back[j] == i and apart[i, j] < most]

    def _cost(self, pose: Pose, pairs: list[tuple[int, int]]) -> tuple[float, float]:
        """Return the cost of a pose, and the rms distance of its blobs from the features.

        The cost is the sum of squared deviations, each at most `MISSING`, plus `MISSING` for each feature without a
        blob though it should be in the image, minus `MISSING` for each blob that is explained.
        """
        weight = np.array([MARK if feature.kind == "mark" else 1.0 for feature in self.features])
        expected, scale, sizes = pose.to_px(self.places_mm), pose.px_per_mm, self.sizes_mm
        reach = 0.6 * scale * sizes[:, None]
        inside = (expected > reach).all(axis=1) & (expected < np.array(self.shape[::-1]) - reach).all(axis=1)
        lost = MISSING * weight * inside
        if not pairs:
            return float(lost.sum()), float("inf")
        i, j = np.array(pairs).T
        away = np.hypot(*(expected[i] - self.blobs.places_px[j]).T) / scale
        larger = self.blobs.diameter_px[j] / scale - sizes[i]
        off = (away / PLACE_MM) ** 2 + ((larger - np.median(larger)) / DIAMETER_MM) ** 2
        kept = np.minimum(off, MISSING) * weight[i]
        rest = lost.sum() - lost[i].sum() - MISSING * len(pairs)
        rest += (float(np.median(larger)) / GROWN_MM) ** 2 + ((scale / self.px_per_mm - 1.0) / STRETCHED) ** 2
        return float(kept.sum() + rest), float(np.sqrt(np.mean(away**2)))


def places(features: Sequence[Feature]) -> FloatArray:
    """Return the centres (N, 2) of features, mm."""
    return np.array([(feature.x_mm, feature.y_mm) for feature in features])


def locate(grey: FloatArray, coupon: Coupon, px_per_mm: float, what: str, *, most_rise: float = math.inf) -> Location:
    """Find a coupon of round features in an image.

    Parameters
    ----------
    grey
        Shape (rows, columns).
    coupon
        The printed coupon.
    px_per_mm
        Scale of the image.
    what
        Name of the image in errors.
    most_rise
        Grey value above the surroundings beyond which features count as equally bright.

    Raises
    ------
    DataError
        If the coupon is not found, or its pose is ambiguous.
    """
    features = [feature for feature in coupon.features if feature.round]
    window = WINDOW * px_per_mm * max(feature.diameter_mm for feature in features)
    guesses: list[_Guess] = []
    for bright in (True, False):
        found = blobs(grey, window, bright=bright, most_rise=most_rise)
        search = _Search(features, found, px_per_mm, grey.shape, bright)
        guesses += search.guesses()
    guesses.sort(key=lambda guess: guess.cost)
    if not guesses or len(guesses[0].pairs) < MIN_FEATURES:
        limit = f"shows no {coupon.name}: fewer than {MIN_FEATURES} of its features are at the expected positions"
        remedy = "check --coupon and --um-per-px, and that the marks or the largest features are in the image"
        raise DataError(what, limit=limit, remedy=remedy)
    best = guesses[0]
    _check_clear(best, guesses, places([feature for feature in features if feature.kind != "mark"]), what, coupon.name)
    flipped = [guess.cost for guess in guesses if guess.pose.mirrored != best.pose.mirrored]
    oriented = not flipped or min(flipped) - best.cost >= CLEAR
    return Location(best.pose, best.bright, tuple(features[i].name for i, _ in best.pairs), oriented, best.rms_mm)


def _check_clear(best: _Guess, guesses: list[_Guess], measured_mm: FloatArray, what: str, name: str) -> None:
    """Raise `DataError` if another pose fits nearly as well and would measure other positions."""
    here = best.pose.to_px(measured_mm)
    for other in guesses[1:]:
        if other.cost - best.cost >= CLEAR:
            return
        elsewhere = np.hypot(*(here - other.pose.to_px(measured_mm)).T).max() > NEAR_MM * best.pose.px_per_mm
        if elsewhere and other.cost - best.cost + _farther(other, best) < CLEAR:
            limit = f"the {name} has an ambiguous pose: its marks or largest features are not visible"
            raise DataError(what, limit=limit, remedy="take an image that shows the marks")


def _farther(other: _Guess, best: _Guess) -> float:
    """Return additional evidence from positions; the cost assumes larger errors than this coupon may have."""
    free = 2 * len(best.pairs) - PARAMETERS
    if free < MANY:
        return 0.0
    return free * (other.rms_mm**2 - best.rms_mm**2) / max(best.rms_mm, PLACED_MM) ** 2


def _distinct(poses: Sequence[Pose], extent_mm: float) -> list[Pose]:
    """Return the first poses that differ by more than `NEAR_MM`."""
    chosen: list[Pose] = []
    for pose in poses:
        if not any(_same(pose, other, extent_mm) for other in chosen):
            chosen.append(pose)
        if len(chosen) == FITTED:
            break
    return chosen


def _same(pose: Pose, other: Pose, extent_mm: float) -> bool:
    if pose.mirrored != other.mirrored:
        return False
    corner = np.array([[extent_mm, 0.0]])
    turned = math.dist(pose.direction_px(corner)[0] * pose.px_per_mm, other.direction_px(corner)[0] * other.px_per_mm)
    return turned + math.dist(pose.origin_px, other.origin_px) < NEAR_MM * pose.px_per_mm


def locate_slab(z_mm: FloatArray, coupon: Coupon, px_per_mm: float, what: str) -> Location:
    """Find a coupon whose slab is entirely in a height map and above its surroundings.

    Raises
    ------
    DataError
        If there is no such rectangle.
    """
    slab = coupon.slab
    if slab is None:
        raise DataError(what, limit=f"cannot be located: a {coupon.name} has no slab")
    low = float(np.nanpercentile(z_mm, 1.0))
    raised = np.nan_to_num(z_mm, nan=low) > low + 0.5 * slab.thickness_mm
    labels, _ = ndimage.label(ndimage.binary_opening(raised, iterations=2))
    sizes = np.bincount(labels.ravel())[1:]
    expected = slab.width_mm * slab.depth_mm * px_per_mm**2
    if sizes.size and abs(float(sizes.max()) / expected - 1.0) <= AREA:
        piece = np.argwhere(labels == int(sizes.argmax()) + 1).astype(float)[:, ::-1]
        moments, ways = np.linalg.eigh(np.cov(piece.T))
        if abs(math.sqrt(moments[1] / moments[0]) / (slab.width_mm / slab.depth_mm) - 1.0) <= SIDES:
            x, y = piece.mean(axis=0).tolist()
            angle = -math.degrees(math.atan2(ways[1, 1], ways[0, 1]))
            both = [Pose(angle + turn, (x, y), 1e3 / px_per_mm) for turn in (0.0, 180.0)]
            best = max(both, key=lambda pose: _covariance(z_mm, coupon, pose))
            return Location(best, True, tuple(feature.name for feature in coupon.features), True, 0.0)
    limit = f"shows no {coupon.name}: no slab of {slab.width_mm:g} x {slab.depth_mm:g} mm is visible"
    raise DataError(what, limit=limit, remedy="check --um-per-px and --z-um; the entire slab must be in the map")


def _covariance(z_mm: FloatArray, coupon: Coupon, pose: Pose) -> float:
    """Return the covariance of the nominal heights with the heights measured at the centres of the blocks."""
    reach = max(1, int(0.2 * min(feature.depth_mm for feature in coupon.features) * pose.px_per_mm))
    heights = [
        float(np.nanmedian(z_mm[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1]))
        for x, y in pose.to_px(places(coupon.features)).round().astype(int).tolist()
    ]
    nominal = np.array([feature.height_mm for feature in coupon.features])
    return float(np.sum((nominal - nominal.mean()) * np.array(heights)))
