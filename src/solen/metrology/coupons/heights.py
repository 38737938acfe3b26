"""Column heights from a height map, and the significance of the steps between columns.

The top of a column, excluding its edge region, is divided into twelve sectors of equal angle. The column height is the
mean of the sector medians above the fitted plane of the surrounding ground, so dust and a tilted or bent slab have
little effect. The scatter of the medians, which includes the roughness of the print over relevant distances, gives the
uncertainty; the uncertainty of the ground is determined in the same way.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import BoolArray, FloatArray, IntArray
from solen.geometry.coupons import Coupon, Feature
from solen.metrology.coupons.limits import OUTSIDE, SIGNIFICANCE, MeasuredSize, rise_by_chance
from solen.metrology.pose import Pose

TOP_FRACTION = 0.65
"""Fraction of a column's radius within which its top is evaluated."""
INNER_RADIUS, OUTER_RADIUS = 1.25, 2.2
"""Inner and outer radius of the evaluated ground around a feature, in radii of the feature."""
EDGE_MM = 0.03
"""Minimum distance of the evaluated ground from the edges of slab and blocks."""
SECTORS = 12
MIN_SECTORS = 6
MIN_VALID = 0.3
"""Minimum fraction of a top's pixels that must have a height."""
MIN_PX = 24
"""Minimum number of evaluated pixels of a top or of the ground."""
FREEDOM = float(SECTORS - 1)


@dataclass(frozen=True)
class Height:
    """Nominal height of a column, its measured height above the surrounding ground, and its standard uncertainty."""

    name: str
    nominal_mm: float
    measured_mm: float
    u_measured_mm: float


def height_of(z_mm: FloatArray, coupon: Coupon, feature: Feature, pose: Pose) -> Height | str:
    """Return the height of a column, or the reason why it could not be measured.

    ``z_mm`` has shape (rows, columns) and NaN for pixels without a measurement.
    """
    window = _window(z_mm.shape, feature, pose)
    if window is None:
        return OUTSIDE
    rows, columns = window
    x_mm, y_mm = np.moveaxis(pose.to_mm(np.stack(np.meshgrid(columns, rows), axis=-1)), -1, 0)
    z = z_mm[np.ix_(rows, columns)]
    dx, dy = x_mm - feature.x_mm, y_mm - feature.y_mm
    top = _within(dx, dy, feature, TOP_FRACTION)
    ground = _within(dx, dy, feature, OUTER_RADIUS) & _is_ground(x_mm, y_mm, coupon)
    valid = np.isfinite(z)
    if np.count_nonzero(top & valid) < max(MIN_VALID * np.count_nonzero(top), MIN_PX):
        return "too few heights were measured on its top"
    if np.count_nonzero(ground & valid) < MIN_PX:
        return "too few heights were measured on the ground around it"
    plane, u_ground = _plane(dx[ground & valid], dy[ground & valid], z[ground & valid])
    above = z - plane[0] - plane[1] * dx - plane[2] * dy
    medians = _sector_medians(dx[top & valid], dy[top & valid], above[top & valid])
    if len(medians) < MIN_SECTORS:
        return "too few heights were measured on its top"
    u_top = float(np.std(medians, ddof=1)) / math.sqrt(len(medians))
    return Height(feature.name, feature.height_mm, float(np.mean(medians)), math.hypot(u_top, u_ground))


def steps_of(coupon: Coupon, heights: dict[str, Height | str], u_scale: float = 0.0) -> list[MeasuredSize]:
    """Return the steps of the coupon, each with its rise and whether the rise is significant.

    ``u_scale`` is the relative standard uncertainty of the height scale.
    """
    steps = []
    for step in coupon.steps:
        low, high = (heights[name] for name in step.between)
        if isinstance(low, str) or isinstance(high, str):
            reason = low if isinstance(low, str) else str(high)
            steps.append(MeasuredSize(step.name, "step", step.step_mm, reason=reason))
            continue
        count = sum(abs(other.step_mm - step.step_mm) < 1e-6 for other in coupon.steps)
        rise, (u_low, u_high) = high.measured_mm - low.measured_mm, (low.u_measured_mm, high.u_measured_mm)
        resolved = rise_by_chance(rise, u_low, u_high, FREEDOM) < SIGNIFICANCE / count
        reason = "" if resolved else "the rise is not significant"
        u_own = math.hypot(u_low, u_high)
        u_rise = math.hypot(u_own, rise * u_scale)
        steps.append(MeasuredSize(step.name, "step", step.step_mm, rise, u_rise, resolved, reason, u_own_mm=u_own))
    return steps


def _window(shape: tuple[int, ...], feature: Feature, pose: Pose) -> tuple[IntArray, IntArray] | None:
    """Return the rows and columns around a feature, or None if part of its top is outside the map."""
    x, y = pose.to_px(np.array([feature.x_mm, feature.y_mm])).tolist()
    half = 0.5 * max(feature.width_mm, feature.depth_mm) * pose.px_per_mm
    rows, columns = shape
    if x < half or y < half or x > columns - 1 - half or y > rows - 1 - half:
        return None
    reach = OUTER_RADIUS * 0.5 * math.hypot(feature.width_mm, feature.depth_mm) * pose.px_per_mm
    return (
        np.arange(max(0, math.floor(y - reach)), min(rows, math.ceil(y + reach) + 1)),
        np.arange(max(0, math.floor(x - reach)), min(columns, math.ceil(x + reach) + 1)),
    )


def _within(dx: FloatArray, dy: FloatArray, feature: Feature, factor: float) -> BoolArray:
    """Return whether points are inside a feature enlarged by a factor."""
    if feature.round:
        return np.hypot(dx, dy) < 0.5 * factor * feature.diameter_mm
    return (np.abs(dx) < 0.5 * factor * feature.width_mm) & (np.abs(dy) < 0.5 * factor * feature.depth_mm)


def _is_ground(x_mm: FloatArray, y_mm: FloatArray, coupon: Coupon) -> BoolArray:
    """Return whether points are on the slab and outside all features."""
    ground = np.ones(x_mm.shape, dtype=bool)
    if coupon.slab is not None:
        ground &= np.abs(x_mm) < 0.5 * coupon.slab.width_mm - EDGE_MM
        ground &= np.abs(y_mm) < 0.5 * coupon.slab.depth_mm - EDGE_MM
    for other in coupon.features:
        factor = INNER_RADIUS if other.round else 1.0 + 2.0 * EDGE_MM / min(other.width_mm, other.depth_mm)
        ground &= ~_within(x_mm - other.x_mm, y_mm - other.y_mm, other, factor)
    return ground


def _plane(dx: FloatArray, dy: FloatArray, z: FloatArray) -> tuple[FloatArray, float]:
    """Fit a plane a + b dx + c dy to heights, without outliers; return it and the uncertainty of a, from sectors."""
    columns = np.column_stack([np.ones(len(z)), dx, dy])
    kept = np.ones(len(z), dtype=bool)
    plane: FloatArray = np.zeros(3)
    for _ in range(4):
        plane = np.asarray(np.linalg.lstsq(columns[kept], z[kept], rcond=None)[0])
        residuals = z - columns @ plane
        spread = 1.4826 * float(np.median(np.abs(residuals[kept]))) + 1e-12
        kept = np.abs(residuals) < 4.0 * spread
    medians = _sector_medians(dx[kept], dy[kept], residuals[kept])
    u_plane = (
        float(np.std(medians, ddof=1)) / math.sqrt(len(medians)) if len(medians) > 2 else float(np.std(residuals[kept]))
    )
    return plane, u_plane


def _sector_medians(dx: FloatArray, dy: FloatArray, values: FloatArray) -> FloatArray:
    """Return the medians of the sectors that contain more than two values."""
    number = np.floor((np.arctan2(dy, dx) / math.tau + 0.5) * SECTORS).astype(int) % SECTORS
    sectors = (values[number == sector] for sector in range(SECTORS))
    return np.array([np.median(sector) for sector in sectors if len(sector) > 2])
