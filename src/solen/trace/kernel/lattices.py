"""The rays of a batch: for each position bin in front of the lens, a lattice of angles and positions.

Rays are uniform in the angle from the emitter axis (in space, in the projected angle and in the sine of the
out-of-plane angle) and are weighted by the emitter's intensity. Only angles at which part of the sensor lies are
launched, and only slopes that pass between bottom and top. The random shift depends only on the seed, the angle and the
lattice. It is the same for all designs, so differences between designs have less noise than the powers themselves.
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
"""Root of x⁴ = x + 1: steps 1/x, 1/x², 1/x³ fill a cube uniformly (M. Roberts, 2018)."""
AROUND = 1.2
"""Maximum angle in radians between sensor and axis for which angles beyond the sensor are not launched."""
WIDER = 1e-6
"""Margin of the angular range in radians, larger than the extension of curves beyond their ends."""


class Light(NamedTuple):
    """Parameters of an emitter."""

    half: float
    """half the cone angle in radians"""
    exponent: float
    """m of cos^m, 0 for a uniform pattern; negative for a table"""
    whole: float
    """integral of the intensity, over angles in the plane or over directions in space"""
    height: float
    y: float
    first: float
    many: float
    """number of rows in the pattern table"""
    flat: float
    """1 if the emitter emits only in the plane, or is traced there"""


@compiled
def light_row(numbers: FloatArray, d: int) -> Light:
    """Return the row of an emitter."""
    n = numbers[d]
    return Light(n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7])


@compiled
def chance(seed: int, angle: int, place: int, which: int) -> float:
    """Random number in [0, 1) for a bin at an angle."""
    key = scrambled(np.uint64(seed) ^ scrambled(np.uint64(angle) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(1)))
    key = scrambled(key ^ scrambled(np.uint64(place) * np.uint64(4) + np.uint64(which) + np.uint64(0x51ED270B)))
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
    first, last = int(light.first), int(light.first + light.many) - 1
    if angle > table[last, 0]:
        return 0.0
    low, high = first, last
    while high - low > 1:
        middle = (low + high) // 2
        if table[middle, 0] <= angle:
            low = middle
        else:
            high = middle
    share = (angle - table[low, 0]) / (table[high, 0] - table[low, 0])
    value: float = table[low, 1] + share * (table[high, 1] - table[low, 1])
    return value


class Ahead(NamedTuple):
    """Angles in radians from the axis between which a sensor lies, and its distance along the axis."""

    low: float
    high: float
    near: float


@compiled
def widened(a: Ahead, x: float, z: float, sin: float, cos: float, px: float, pz: float) -> Ahead:
    """Return the range extended to include another point."""
    forward, left = -sin * (px - x) + cos * (pz - z), -cos * (px - x) - sin * (pz - z)
    if not forward > 0.0:
        return Ahead(-math.inf, math.inf, 0.0)
    angle = math.atan2(left, forward)
    return Ahead(min(a.low, angle), max(a.high, angle), min(a.near, forward))


@compiled
def ahead_of(t: Tables, first: int, last: int, pose: Pose, x: float, z: float) -> Ahead:
    """Return the angular range of the curves in rows ``first`` to ``last``, viewed from a point."""
    sin, cos = math.sin(pose.axis), math.cos(pose.axis)
    a = Ahead(math.inf, -math.inf, math.inf)
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
def range_of(t: Tables, first: int, last: int, pose: Pose, light: Light, low: float, high: float) -> Ahead:
    """Angles at which the sensor is visible from any position in a bin, within the cone."""
    sin, cos = math.sin(pose.axis), math.cos(pose.axis)
    a = ahead_of(t, first, last, pose, pose.x + low * cos, pose.z + low * sin)
    b = ahead_of(t, first, last, pose, pose.x + high * cos, pose.z + high * sin)
    least, most = min(a.low, b.low) - WIDER, max(a.high, b.high) + WIDER
    around = light.half if light.flat == 1.0 or light.half <= 0.5 * math.pi else math.pi
    if not (least > -AROUND and most < AROUND):
        return Ahead(-around, around, 0.0)
    return Ahead(max(least, -around), min(most, around), min(a.near, b.near))


@called
def launch(
    t: Tables, first: int, last: int, pose: Pose, light: Light, table: FloatArray, low: float, high: float, seed: int,
    angle: int, place: int, rays: Rows, begin: int, many: int,
) -> None:  # fmt: skip
    """Write ``many`` rays for a position bin from ``low`` to ``high``, in mm to the right of the axis.

    ``first`` and ``last`` are rows of the sensor's curves; ``angle`` and ``place`` are the indices of angle and bin.
    The ray powers add up to the power that an emitter at those positions sends towards the sensor, as a fraction of its
    total emitted power.
    """
    a = range_of(t, first, last, pose, light, low, high)
    wide = max(a.high - a.low, 0.0)
    one, two = chance(seed, angle, place, 0), chance(seed, angle, place, 1)
    sin, cos = math.sin(pose.axis), math.cos(pose.axis)
    for j in range(many):
        towards = a.low + wide * (j + one) / many
        share = (two + (j + 1) * GOLDEN) % 1.0
        at = low + (high - low) * share
        power = 0.5 * wide / many * intensity(light, table, math.cos(towards)) / light.whole
        i = begin + j
        rays.x[i], rays.z[i] = pose.x + at * cos, pose.z + at * sin
        rays.dx[i], rays.dz[i] = -math.sin(pose.axis + towards), math.cos(pose.axis + towards)
        rays.s[i], rays.p[i], rays.colour[i] = power, power, 0


@called
def launch_in_space(
    t: Tables, first: int, last: int, pose: Pose, light: Light, table: FloatArray, half: float, low: float, high: float,
    seed: int, angle: int, place: int, rays: RowsInSpace, begin: int, many: int,
) -> None:  # fmt: skip
    """As `launch`, in a body from y = −half to half; a ray and its mirror image in y = 0 are combined if possible."""
    a = range_of(t, first, last, pose, light, low, high)
    wide = max(a.high - a.low, 0.0)
    one, two = chance(seed, angle, place, 0), chance(seed, angle, place, 1)
    three, four = chance(seed, angle, place, 2), chance(seed, angle, place, 3)
    sin, cos, flat, even = math.sin(pose.axis), math.cos(pose.axis), light.flat == 1.0, light.y == 0.0
    for j in range(many):
        towards = a.low + wide * (j + one) / many
        at = low + (high - low) * ((two + (j + 1) / RATIO_3) % 1.0)
        y, rise, power = 0.0, 0.0, 0.5 * wide / many / light.whole
        if flat:
            power *= intensity(light, table, math.cos(towards))
        else:
            y = light.y + light.height * ((three + (j + 1) / (RATIO_3 * RATIO_3)) % 1.0 - 0.5)
            near = a.near / math.cos(towards) if a.near > 0.0 else 0.0
            up, down = steepest(half - y, near), 0.0 if even else -steepest(half + y, near)
            rise = down + (up - down) * ((four + (j + 1) / (RATIO_3 * RATIO_3 * RATIO_3)) % 1.0)
            within = math.sqrt(1.0 - rise * rise)
            power *= (2.0 if even else 1.0) * (up - down)
            power *= intensity(light, table, within * math.cos(towards))
        within = math.sqrt(1.0 - rise * rise)
        i = begin + j
        rays.x[i], rays.y[i], rays.z[i] = pose.x + at * cos, y, pose.z + at * sin
        rays.dx[i], rays.dy[i] = -within * math.sin(pose.axis + towards), rise
        rays.dz[i] = within * math.cos(pose.axis + towards)
        rays.s[i], rays.p[i], rays.cr[i], rays.ci[i], rays.optical[i] = power, power, 0.0, 0.0, 0.0
        rays.colour[i] = 0


@compiled
def steepest(rise_mm: float, near: float) -> float:
    """Largest out-of-plane slope, as a sine, at which a ray rises by at most ``rise_mm`` over ``near``."""
    if rise_mm <= 0.0:
        return 0.0
    return rise_mm / math.sqrt(rise_mm * rise_mm + near * near)
