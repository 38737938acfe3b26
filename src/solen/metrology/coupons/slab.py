"""Finding a coupon of blocks in a z map: its slab as a rectangle, and which way round by the heights of its blocks."""

import math

import numpy as np
from scipy import ndimage

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.geometry.coupons import Coupon, Slab
from solen.metrology.pose import Placement
from solen.metrology.coupons.locate import Registration

AREA = 0.15
"""Relative: how much the slab's area may differ from the layout's."""
SIDES = 0.1
"""Relative: how much the ratio of its sides may."""


def register_slab(z_mm: FloatArray, coupon: Coupon, px_per_mm: float, what: str) -> Registration:
    """Place of a coupon whose slab lies wholly in a z map, above what surrounds it.

    Raises
    ------
    DataError
        Where no such rectangle stands out.
    """
    slab = coupon.slab
    if slab is None:
        raise DataError(what, limit=f"a {coupon.name} has no slab to be found by")
    low = float(np.nanpercentile(z_mm, 1.0))
    raised = np.nan_to_num(z_mm, nan=low) > low + 0.5 * slab.thickness_mm
    labels, count = ndimage.label(ndimage.binary_opening(raised, iterations=2))
    sizes = ndimage.sum_labels(np.ones(labels.shape), labels, np.arange(1, count + 1)) if count else np.zeros(0)
    expected = slab.width_mm * slab.depth_mm * px_per_mm**2
    if not count or abs(float(sizes.max()) / expected - 1.0) > AREA:
        raise _not_found(coupon, slab, what)
    piece = np.argwhere(labels == int(sizes.argmax()) + 1).astype(float)[:, ::-1]
    middle = piece.mean(axis=0)
    moments, ways = np.linalg.eigh(np.cov(piece.T))
    if abs(math.sqrt(moments[1] / moments[0]) / (slab.width_mm / slab.depth_mm) - 1.0) > SIDES:
        raise _not_found(coupon, slab, what)
    angle = -math.degrees(math.atan2(ways[1, 1], ways[0, 1]))
    ways_round = [Placement(px_per_mm, angle + turn, (float(middle[0]), float(middle[1]))) for turn in (0.0, 180.0)]
    best = max(ways_round, key=lambda one: _agreement(z_mm, coupon, one))
    return Registration(
        best, bright=True, matched=tuple(one.name for one in coupon.features), oriented=True, rms_mm=0.0
    )


def _agreement(z_mm: FloatArray, coupon: Coupon, placement: Placement) -> float:
    """Covariance of nominal heights with those in the middle of each block."""
    places = placement.px(np.array([(one.x_mm, one.y_mm) for one in coupon.features])).round().astype(int)
    reach = max(1, int(0.2 * min(one.depth_mm for one in coupon.features) * placement.px_per_mm))
    found = [
        float(np.nanmedian(z_mm[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1]))
        for x, y in places.tolist()
    ]
    nominal = np.array([one.height_mm for one in coupon.features])
    return float(np.sum((nominal - nominal.mean()) * np.array(found)))


def _not_found(coupon: Coupon, slab: Slab, what: str) -> DataError:
    limit = (
        f"shows no {coupon.name}: no slab of {slab.width_mm:g} x {slab.depth_mm:g} mm stands out of its surroundings"
    )
    return DataError(what, limit=limit, remedy="check --um-per-px and --z-um; the whole slab must be in the map")
