"""The rays of a batch: for each position bin in front of the lens, a lattice of angles and positions.

Rays are uniform in the angle from the emitter axis (in space, in the projected angle and in the sine of the
out-of-plane angle) and are weighted by the emitter's intensity. They are launched only at angles at which part of the
sensor lies, and in space only at slopes that reach the sensor between bottom and top. The random shift depends only on
the seed, the angle of the motion and the lattice. It is the same for all designs, so differences between designs have
less noise than the powers themselves.
"""

import math
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.trace.kernel.buffers import Rows
from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.extruded import RowsInSpace
from solen.trace.kernel.rows import CONIC, OVAL, SEGMENT
from solen.trace.kernel.surface import scrambled
from solen.trace.kernel.y_tables import Pose
from solen.trace.tables import Tables

GOLDEN = 0.6180339887498949
RATIO_3 = 1.2207440846057596
"""Root of x⁴ = x + 1; multiples of 1/x, 1/x², 1/x³ fill a cube uniformly (M. Roberts, 2018)."""
MAX_SENSOR_ANGLE = 1.2
"""Largest angle in radians of the sensor from the axis at which rays are limited to the sensor."""
ANGLE_MARGIN = 1e-6
"""Margin of the angular range in radians, which exceeds the extension of curves beyond their ends."""


class Light(NamedTuple):
    """Parameters of an emitter."""

    half: float
    """half the cone angle in radians"""
    exponent: float
    """exponent m of cos^m; 0 for a uniform pattern, negative for a table"""
    integral: float
    """integral of the intensity, over angles in the plane or over directions in space"""
    height: float
    y: float
    first: float
    rows: float
    """number of rows in the pattern table"""
    flat: float
    """1 if the light is only in the plane"""


@compiled
def light_row(numbers: FloatArray, d: int) -> Light:
    """Return the row of an emitter."""
    n = numbers[d]
    return Light(n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7])


@compiled
def lattice_shift(seed: int, angle: int, bin_index: int, axis: int) -> float:
    """Random number in [0, 1) by which the lattice of a bin at an angle is shifted along one axis."""
    key = scrambled(np.uint64(seed) ^ scrambled(np.uint64(angle) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(1)))
    key = scrambled(key ^ scrambled(np.uint64(bin_index) * np.uint64(4) + np.uint64(axis) + np.uint64(0x51ED270B)))
    return float(key >> np.uint64(11)) * 2.0**-53


@compiled
def intensity(light: Light, table: FloatArray, cos: float) -> float:
    """Relative intensity at the angle with this cosine."""
    if light.exponent == 0.0:
        return 1.0 if cos >= math.cos(light.half) else 0.0
    if light.exponent > 0.0:
        return max(cos, 0.0) ** light.exponent if cos >= math.cos(light.half) else 0.0
    angle = math.acos(min(max(cos, -1.0), 1.0))
    if angle > light.half:
        return 0.0
    first, last = int(light.first), int(light.first + light.rows) - 1
    if angle > table[last, 0]:
        return 0.0
    low, high = first, last
    while high - low > 1:
        middle = (low + high) // 2
        if table[middle, 0] <= angle:
            low = middle
        else:
            high = middle
    fraction = (angle - table[low, 0]) / (table[high, 0] - table[low, 0])
    value: float = table[low, 1] + fraction * (table[high, 1] - table[low, 1])
    return value


class AngularRange(NamedTuple):
    """Angles in radians from the axis between which a sensor lies, and its smallest distance along the axis."""

    low: float
    high: float
    near: float


@compiled
def widened(a: AngularRange, x: float, z: float, sin: float, cos: float, px: float, pz: float) -> AngularRange:
    """Return the range extended to include another point."""
    forward, left = -sin * (px - x) + cos * (pz - z), -cos * (px - x) - sin * (pz - z)
    if not forward > 0.0:
        return AngularRange(-math.inf, math.inf, 0.0)
    angle = math.atan2(left, forward)
    return AngularRange(min(a.low, angle), max(a.high, angle), min(a.near, forward))


@compiled
def angular_range(t: Tables, first: int, last: int, pose: Pose, x: float, z: float) -> AngularRange:
    """Return the angular range of the curves in rows ``first`` to ``last``, viewed from a point."""
    sin, cos = math.sin(pose.axis), math.cos(pose.axis)
    a = AngularRange(math.inf, -math.inf, math.inf)
    for p in range(first, last):
        row, kind = t.shape[p], t.kind[p]
        if kind == SEGMENT:
            a = widened(a, x, z, sin, cos, row[0], row[1])
            a = widened(a, x, z, sin, cos, row[0] + row[4] * row[2], row[1] + row[4] * row[3])
        elif kind == CONIC:
            box = t.box[p]
            for i in range(4):
                a = widened(a, x, z, sin, cos, box[i % 2], box[2 + i // 2])
        elif kind == OVAL:
            for i in range(18, 26, 2):
                a = widened(a, x, z, sin, cos, row[i], row[i + 1])
        else:
            for i in range(0, 8, 2):
                a = widened(a, x, z, sin, cos, row[i], row[i + 1])
    return a


@compiled
def bin_range(t: Tables, first: int, last: int, pose: Pose, light: Light, low: float, high: float) -> AngularRange:
    """Return the angles within the cone at which the sensor is visible from any position in a bin."""
    sin, cos = math.sin(pose.axis), math.cos(pose.axis)
    a = angular_range(t, first, last, pose, pose.x + low * cos, pose.z + low * sin)
    b = angular_range(t, first, last, pose, pose.x + high * cos, pose.z + high * sin)
    low_angle, high_angle = min(a.low, b.low) - ANGLE_MARGIN, max(a.high, b.high) + ANGLE_MARGIN
    half_cone = light.half if light.flat == 1.0 or light.half <= 0.5 * math.pi else math.pi
    if not (low_angle > -MAX_SENSOR_ANGLE and high_angle < MAX_SENSOR_ANGLE):
        return AngularRange(-half_cone, half_cone, 0.0)
    return AngularRange(max(low_angle, -half_cone), min(high_angle, half_cone), min(a.near, b.near))


@called
def launch(
    t: Tables, first: int, last: int, pose: Pose, light: Light, table: FloatArray, low: float, high: float, seed: int,
    angle: int, bin_index: int, rays: Rows, begin: int, count: int,
) -> None:  # fmt: skip
    """Write ``count`` rays for a position bin from ``low`` to ``high``, in mm to the right of the axis.

    The sensor's curves are the rows from ``first`` up to ``last``; ``angle`` and ``bin_index`` are indices.
    The ray powers add up to the power that an emitter at those positions sends towards the sensor, as a fraction of its
    total emitted power.
    """
    a = bin_range(t, first, last, pose, light, low, high)
    width = max(a.high - a.low, 0.0)
    shift_1, shift_2 = lattice_shift(seed, angle, bin_index, 0), lattice_shift(seed, angle, bin_index, 1)
    sin, cos = math.sin(pose.axis), math.cos(pose.axis)
    for j in range(count):
        ray_angle = a.low + width * (j + shift_1) / count
        fraction = (shift_2 + (j + 1) * GOLDEN) % 1.0
        position = low + (high - low) * fraction
        power = 0.5 * width / count * intensity(light, table, math.cos(ray_angle)) / light.integral
        i = begin + j
        rays.x[i], rays.z[i] = pose.x + position * cos, pose.z + position * sin
        rays.dx[i], rays.dz[i] = -math.sin(pose.axis + ray_angle), math.cos(pose.axis + ray_angle)
        rays.s[i], rays.p[i], rays.colour[i] = power, power, 0


@called
def launch_in_space(
    t: Tables, first: int, last: int, pose: Pose, light: Light, table: FloatArray, half: float, low: float, high: float,
    seed: int, angle: int, bin_index: int, rays: RowsInSpace, begin: int, count: int,
) -> None:  # fmt: skip
    """As `launch`, in a body from y = −half to half; if possible, a ray also represents its mirror image in y = 0."""
    a = bin_range(t, first, last, pose, light, low, high)
    width = max(a.high - a.low, 0.0)
    shift_1, shift_2 = lattice_shift(seed, angle, bin_index, 0), lattice_shift(seed, angle, bin_index, 1)
    shift_3, shift_4 = lattice_shift(seed, angle, bin_index, 2), lattice_shift(seed, angle, bin_index, 3)
    sin, cos, flat, symmetric = math.sin(pose.axis), math.cos(pose.axis), light.flat == 1.0, light.y == 0.0
    for j in range(count):
        ray_angle = a.low + width * (j + shift_1) / count
        position = low + (high - low) * ((shift_2 + (j + 1) / RATIO_3) % 1.0)
        y, rise, power = 0.0, 0.0, 0.5 * width / count / light.integral
        if flat:
            power *= intensity(light, table, math.cos(ray_angle))
        else:
            y = light.y + light.height * ((shift_3 + (j + 1) / (RATIO_3 * RATIO_3)) % 1.0 - 0.5)
            near = a.near / math.cos(ray_angle) if a.near > 0.0 else 0.0
            up, down = max_rise(half - y, near), 0.0 if symmetric else -max_rise(half + y, near)
            rise = down + (up - down) * ((shift_4 + (j + 1) / (RATIO_3 * RATIO_3 * RATIO_3)) % 1.0)
            flat_length = math.sqrt(1.0 - rise * rise)
            power *= (2.0 if symmetric else 1.0) * (up - down)
            power *= intensity(light, table, flat_length * math.cos(ray_angle))
        flat_length = math.sqrt(1.0 - rise * rise)
        i = begin + j
        rays.x[i], rays.y[i], rays.z[i] = pose.x + position * cos, y, pose.z + position * sin
        rays.dx[i], rays.dy[i] = -flat_length * math.sin(pose.axis + ray_angle), rise
        rays.dz[i] = flat_length * math.cos(pose.axis + ray_angle)
        rays.s[i], rays.p[i], rays.cr[i], rays.ci[i], rays.optical[i] = power, power, 0.0, 0.0, 0.0
        rays.colour[i] = 0


@compiled
def max_rise(rise_mm: float, near: float) -> float:
    """Sine of the largest out-of-plane angle at which a ray rises by at most ``rise_mm`` over ``near`` mm."""
    if rise_mm <= 0.0:
        return 0.0
    return rise_mm / math.sqrt(rise_mm * rise_mm + near * near)
