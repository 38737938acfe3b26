"""Location of a coupon in an image or a height map, from the blobs of its features or from its slab.

Two blobs whose sizes and distance match two of the largest features fix the pose of the entire coupon, once as in the
layout and once mirrored. Each hypothesis is scored by the number of features with a blob at the expected position, and
the best hypotheses are fitted by least squares. The final choice is based on positions, marks, and sizes up to a common
offset, because print and illumination change all sizes alike. The pose is ambiguous if another pose with different
positions fits nearly as well.

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
MAX_SCALE_ERROR = 0.06
"""Largest relative deviation of distances in the image from the layout, due to print and scale together."""
MAX_LOG_SIZE = 0.5
"""Largest magnitude of the natural logarithm of the ratio of a blob's size to its feature's."""
MIN_SPAN = 0.12
"""Minimum distance between the two features of a hypothesis, as a fraction of the coupon's extent."""
MATCH_MM, REFINED_MATCH_MM = 0.25, 0.12
"""Largest distance of a blob from the position of its feature, before and after the first fit."""
U_POSITION_MM, U_DIAMETER_MM = 0.02, 0.04
"""Assumed standard deviations of a blob's position and diameter."""
U_GROWTH_MM, U_SCALE = 0.06, 0.015
"""Assumed standard deviations of a size offset common to all features, and of the scale. A pose shifted by one feature
of a graded row implies such an offset.
"""
MISSING_COST, MARK_WEIGHT = 4.0, 4.0
"""Cost of a feature without a blob, and the extra weight of a mark."""
MIN_COST_DIFFERENCE = 4.0
"""Minimum cost difference between the best hypothesis and any other."""
POSE_PARAMETERS, MIN_FREEDOM, MIN_RMS_MM = 4, 8, 0.003
"""Number of pose parameters, minimum number of degrees of freedom for an estimate of the position scatter, and lower
limit of this estimate.
"""
MAX_PAIRS, MAX_FITTED = 4000, 40
MIN_FEATURES = 3
MAX_AREA_ERROR, MAX_ASPECT_ERROR = 0.15, 0.1
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
        RMS distance of the blobs from the positions of their features.
    """

    pose: Pose
    bright: bool
    matched: tuple[str, ...]
    oriented: bool
    rms_mm: float


@dataclass(frozen=True)
class _Hypothesis:
    pose: Pose
    pairs: tuple[tuple[int, int], ...]
    cost: float
    rms_mm: float
    bright: bool


@dataclass(frozen=True, eq=False)
class _Search:
    """A coupon's round features, and the blobs of an image that may be images of them."""

    features: Sequence[Feature]
    blobs: Blobs
    px_per_mm: float
    shape: tuple[int, ...]
    bright: bool

    @property
    def centres_mm(self) -> FloatArray:
        return centres_of(self.features)

    @property
    def sizes_mm(self) -> FloatArray:
        return np.array([feature.diameter_mm for feature in self.features])

    def similar_sizes(self, px_per_mm: float) -> BoolArray:
        """Return a mask of features (rows) and blobs (columns) of about the same size."""
        ratio = self.blobs.diameter_px[None, :] / (px_per_mm * self.sizes_mm[:, None])
        return np.asarray(np.abs(np.log(ratio)) < MAX_LOG_SIZE)

    def hypotheses(self) -> list[_Hypothesis]:
        """Return hypotheses of the coupon's pose, each fitted to its blobs."""
        if len(self.blobs.diameter_px) < MIN_FEATURES:
            return []
        return [self._refined(pose) for pose in self._rough()]

    def _rough(self) -> list[Pose]:
        """Return poses from pairs of blobs, ordered by the number of features that they explain."""
        centres, blob_centres = self.centres_mm, self.blobs.centres_px
        extent = float(np.ptp(centres, axis=0).max())
        order = np.argsort(-self.sizes_mm, kind="stable")[:TRIED_FEATURES]
        distances = np.hypot(*(blob_centres[None, :] - blob_centres[:, None]).transpose(2, 0, 1))
        similar_sizes = self.similar_sizes(self.px_per_mm)
        pairs: list[tuple[int, int, int, int, bool]] = []
        for i, k in combinations(order.tolist(), 2):
            distance = float(np.hypot(*(centres[i] - centres[k])))
            if distance < MIN_SPAN * extent:
                continue
            is_plausible = np.abs(distances / (self.px_per_mm * distance) - 1.0) < MAX_SCALE_ERROR
            both = np.argwhere(is_plausible & similar_sizes[i][:, None] & similar_sizes[k][None, :]).tolist()
            pairs += [(i, k, first, second, mirrored) for first, second in both for mirrored in (False, True)]
        if len(pairs) > MAX_PAIRS:
            pairs = pairs[:: len(pairs) // MAX_PAIRS + 1]
        poses = [
            Pose.fitted(centres[[i, k]], blob_centres[[first, second]], mirrored=m) for i, k, first, second, m in pairs
        ]
        explained = [self._explained(pose, similar_sizes) for pose in poses]
        return _distinct([poses[k] for k in np.argsort(-np.array(explained, dtype=float), kind="stable")], extent)

    def _explained(self, pose: Pose, similar_sizes: BoolArray) -> int:
        """Return the number of features that have a blob of about the right size at their position."""
        return int(
            np.count_nonzero(((self._distances_px(pose) < MATCH_MM * self.px_per_mm) & similar_sizes).any(axis=1))
        )

    def _distances_px(self, pose: Pose) -> FloatArray:
        """Return the distances between feature positions (rows) and blobs (columns)."""
        offsets = pose.to_px(self.centres_mm)[:, None, :] - self.blobs.centres_px[None, :, :]
        return np.asarray(np.hypot(offsets[..., 0], offsets[..., 1]))

    def _refined(self, pose: Pose) -> _Hypothesis:
        """Fit a pose to its blobs, and compute its cost."""
        pairs: list[tuple[int, int]] = []
        for near_mm in (MATCH_MM, REFINED_MATCH_MM, REFINED_MATCH_MM):
            pairs = self._pairs(pose, near_mm)
            if len(pairs) < 2:
                break
            i, j = np.array(pairs).T
            pose = Pose.fitted(self.centres_mm[i], self.blobs.centres_px[j], mirrored=pose.mirrored)
        cost, rms = self._cost(pose, pairs)
        return _Hypothesis(pose, tuple(pairs), cost, rms, self.bright)

    def _pairs(self, pose: Pose, near_mm: float) -> list[tuple[int, int]]:
        """Return pairs of features and blobs that are mutual nearest neighbours."""
        distances = np.where(self.similar_sizes(pose.px_per_mm), self._distances_px(pose), np.inf)
        nearest_blob, nearest_feature = distances.argmin(axis=1), distances.argmin(axis=0)
        max_px = near_mm * pose.px_per_mm
        return [(i, int(j)) for i, j in enumerate(nearest_blob) if nearest_feature[j] == i and distances[i, j] < max_px]

    def _cost(self, pose: Pose, pairs: list[tuple[int, int]]) -> tuple[float, float]:
        """Return the cost of a pose, and the RMS distance of its blobs from the features.

        The cost is the sum of squared deviations, each at most `MISSING_COST`, plus `MISSING_COST` for each feature
        without a blob that should be in the image, minus `MISSING_COST` for each blob that is explained.
        """
        weight = np.array([MARK_WEIGHT if feature.kind == "mark" else 1.0 for feature in self.features])
        expected, scale, sizes = pose.to_px(self.centres_mm), pose.px_per_mm, self.sizes_mm
        reach = 0.6 * scale * sizes[:, None]
        inside = (expected > reach).all(axis=1) & (expected < np.array(self.shape[::-1]) - reach).all(axis=1)
        missing = MISSING_COST * weight * inside
        if not pairs:
            return float(missing.sum()), float("inf")
        i, j = np.array(pairs).T
        distance = np.hypot(*(expected[i] - self.blobs.centres_px[j]).T) / scale
        excess = self.blobs.diameter_px[j] / scale - sizes[i]
        deviations = (distance / U_POSITION_MM) ** 2 + ((excess - np.median(excess)) / U_DIAMETER_MM) ** 2
        limited = np.minimum(deviations, MISSING_COST) * weight[i]
        remainder = missing.sum() - missing[i].sum() - MISSING_COST * len(pairs)
        remainder += (float(np.median(excess)) / U_GROWTH_MM) ** 2 + ((scale / self.px_per_mm - 1.0) / U_SCALE) ** 2
        return float(limited.sum() + remainder), float(np.sqrt(np.mean(distance**2)))


def centres_of(features: Sequence[Feature]) -> FloatArray:
    """Return the centres (N, 2) of features, mm."""
    return np.array([(feature.x_mm, feature.y_mm) for feature in features])


def locate(grey: FloatArray, coupon: Coupon, px_per_mm: float, what: str, *, max_rise: float = math.inf) -> Location:
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
    max_rise
        Rise above the surroundings to which higher rises are clipped, so that tall and low features look alike.

    Raises
    ------
    DataError
        If the coupon is not found, or its pose is ambiguous.
    """
    features = [feature for feature in coupon.features if feature.round]
    window = WINDOW * px_per_mm * max(feature.diameter_mm for feature in features)
    hypotheses: list[_Hypothesis] = []
    for bright in (True, False):
        candidates = blobs(grey, window, bright=bright, max_rise=max_rise)
        search = _Search(features, candidates, px_per_mm, grey.shape, bright)
        hypotheses += search.hypotheses()
    hypotheses.sort(key=lambda hypothesis: hypothesis.cost)
    if not hypotheses or len(hypotheses[0].pairs) < MIN_FEATURES:
        limit = f"shows no {coupon.name}: fewer than {MIN_FEATURES} of its features are at the expected positions"
        remedy = "check --coupon and --um-per-px, and that the marks or the largest features are in the image"
        raise DataError(what, limit=limit, remedy=remedy)
    best = hypotheses[0]
    _check_unambiguous(
        best, hypotheses, centres_of([feature for feature in features if feature.kind != "mark"]), what, coupon.name
    )
    flipped = [hypothesis.cost for hypothesis in hypotheses if hypothesis.pose.mirrored != best.pose.mirrored]
    oriented = not flipped or min(flipped) - best.cost >= MIN_COST_DIFFERENCE
    return Location(best.pose, best.bright, tuple(features[i].name for i, _ in best.pairs), oriented, best.rms_mm)


def _check_unambiguous(
    best: _Hypothesis, hypotheses: list[_Hypothesis], measured_mm: FloatArray, what: str, name: str
) -> None:
    """Raise `DataError` if another pose fits nearly as well and would measure other positions."""
    positions = best.pose.to_px(measured_mm)
    for other in hypotheses[1:]:
        if other.cost - best.cost >= MIN_COST_DIFFERENCE:
            return
        elsewhere = np.hypot(*(positions - other.pose.to_px(measured_mm)).T).max() > MATCH_MM * best.pose.px_per_mm
        if elsewhere and other.cost - best.cost + _position_cost(other, best) < MIN_COST_DIFFERENCE:
            limit = f"shows {name} in an ambiguous pose: its marks or largest features are not visible"
            raise DataError(what, limit=limit, remedy="take an image that shows the marks")


def _position_cost(other: _Hypothesis, best: _Hypothesis) -> float:
    """Return a pose's additional cost if positions scatter as in the best pose; `_cost` assumes more scatter."""
    free = 2 * len(best.pairs) - POSE_PARAMETERS
    if free < MIN_FREEDOM:
        return 0.0
    return free * (other.rms_mm**2 - best.rms_mm**2) / max(best.rms_mm, MIN_RMS_MM) ** 2


def _distinct(poses: Sequence[Pose], extent_mm: float) -> list[Pose]:
    """Return the first `MAX_FITTED` poses that differ by more than `MATCH_MM`."""
    chosen: list[Pose] = []
    for pose in poses:
        if not any(_same(pose, other, extent_mm) for other in chosen):
            chosen.append(pose)
        if len(chosen) == MAX_FITTED:
            break
    return chosen


def _same(pose: Pose, other: Pose, extent_mm: float) -> bool:
    if pose.mirrored != other.mirrored:
        return False
    corner = np.array([[extent_mm, 0.0]])
    turned = math.dist(pose.direction_px(corner)[0] * pose.px_per_mm, other.direction_px(corner)[0] * other.px_per_mm)
    return turned + math.dist(pose.origin_px, other.origin_px) < MATCH_MM * pose.px_per_mm


def locate_slab(z_mm: FloatArray, coupon: Coupon, px_per_mm: float, what: str) -> Location:
    """Find a coupon whose slab is entirely in a height map and rises above its surroundings.

    Raises
    ------
    DataError
        If there is no such slab.
    """
    slab = coupon.slab
    if slab is None:
        raise DataError(what, limit=f"cannot be located: the coupon {coupon.name} has no slab")
    low = float(np.nanpercentile(z_mm, 1.0))
    raised = np.nan_to_num(z_mm, nan=low) > low + 0.5 * slab.thickness_mm
    labels, _ = ndimage.label(ndimage.binary_opening(raised, iterations=2))
    sizes = np.bincount(labels.ravel())[1:]
    expected = slab.width_mm * slab.depth_mm * px_per_mm**2
    if sizes.size and abs(float(sizes.max()) / expected - 1.0) <= MAX_AREA_ERROR:
        piece = np.argwhere(labels == int(sizes.argmax()) + 1).astype(float)[:, ::-1]
        moments, axes = np.linalg.eigh(np.cov(piece.T))
        if abs(math.sqrt(moments[1] / moments[0]) / (slab.width_mm / slab.depth_mm) - 1.0) <= MAX_ASPECT_ERROR:
            x, y = piece.mean(axis=0).tolist()
            angle = -math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
            poses = [Pose(angle + turn, (x, y), 1e3 / px_per_mm) for turn in (0.0, 180.0)]
            best = max(poses, key=lambda pose: _covariance(z_mm, coupon, pose))
            return Location(best, True, tuple(feature.name for feature in coupon.features), True, 0.0)
    limit = f"shows no {coupon.name}: no slab of {slab.width_mm:g} x {slab.depth_mm:g} mm is visible"
    raise DataError(what, limit=limit, remedy="check --um-per-px and --z-um; the entire slab must be in the map")


def _covariance(z_mm: FloatArray, coupon: Coupon, pose: Pose) -> float:
    """Return the unnormalised covariance of the blocks' nominal heights with the heights measured at their centres."""
    reach = max(1, int(0.2 * min(feature.depth_mm for feature in coupon.features) * pose.px_per_mm))
    heights = [
        float(np.nanmedian(z_mm[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1]))
        for x, y in pose.to_px(centres_of(coupon.features)).round().astype(int).tolist()
    ]
    nominal = np.array([feature.height_mm for feature in coupon.features])
    return float(np.sum((nominal - nominal.mean()) * np.array(heights)))
