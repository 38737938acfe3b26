"""A brute-force tracer of prismatic bodies in space, independent of the engine: the reference for responses.

Walls are chains of short chords, between whose ends the normals of the curve are interpolated. A ray carries two
mutually incoherent fields as complex vectors; at every face, also at the top and the bottom, Fresnel's amplitude
coefficients are applied to their components perpendicular and parallel to the plane of incidence. Rays start at Sobol'
points of the chip and of a Lambertian pattern.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.stats import qmc

from solen.arrays import FloatArray
from solen.curve import Curve
from solen.sensor import Sensor

SAGITTA_MM, BLOCK = 1e-5, 16
MIN_POWER, MAX_HITS, STACK = 1e-6, 400, 64


@dataclass(frozen=True)
class LitChip:
    """A Lambertian chip: decentre, width and height in mm."""

    offset_mm: float
    width_mm: float
    height_mm: float


def powers(
    sensor: Sensor, chip: LitChip, angle_deg: float, log2_rays: int, seed: int, exponent: float = 1.0
) -> FloatArray:
    """Return the fractions of the emitted power at the right and the left receiver (2,), at an angle of the motion.

    The sensor specifies the body, the motion, an index-matched face for each receiver, and a clear material; its
    emitter is replaced by the chip. The sensitivity of a receiver is the cosine of the angle in air to the power of
    ``exponent``.
    """
    body = sensor.body(angle_deg)
    walls = [(face.curve, _receiver(face.label) if face.part == "receiver" else -1) for face in body.all_faces]
    chords, normals, owner = (np.concatenate(part) for part in zip(*(_chords(*wall) for wall in walls), strict=True))
    u = qmc.Sobol(4, rng=np.random.default_rng(seed)).random_base2(log2_rays)
    received = _traced(
        chords, normals, owner, _boxes(chords), u,
        np.array([*body.emitter.point, math.radians(body.emitter.axis_deg)]),
        np.array([chip.offset_mm - sensor.design.emitter.offset_mm, chip.width_mm, chip.height_mm]),
        float(sensor.material.index), 0.5 * sensor.design.body.thickness_mm, exponent,
    )  # fmt: skip
    return np.asarray(received.sum(axis=0) / len(u))


def _receiver(side: str) -> int:
    return ("right", "left").index(side)


def _chords(curve: Curve, owner: int) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Return the chords (n, 4) of a curve, its unit normals at their ends (n, 4), and the index of their receiver."""
    coarse, tangents = curve.points(np.linspace(0.0, 1.0, 65)), curve.velocities(np.array([0.0, 0.5, 1.0]))
    length = float(np.hypot(*np.diff(coarse, axis=0).T).sum())
    turn = float(np.abs(np.diff(np.unwrap(np.arctan2(tangents[:, 0], tangents[:, 1])))).sum())
    u = np.linspace(0.0, 1.0, 2 + math.ceil(math.sqrt(length * turn / (8.0 * SAGITTA_MM))))
    points, tangents = curve.points(u), curve.velocities(u)
    normals = np.column_stack([tangents[:, 1], -tangents[:, 0]]) / np.hypot(*tangents.T)[:, None]
    return np.hstack([points[:-1], points[1:]]), np.hstack([normals[:-1], normals[1:]]), np.full(len(u) - 1, owner)


def _boxes(chords: FloatArray) -> FloatArray:
    """Return bounding boxes (m, 4) of successive groups of chords: smallest x and z, largest x and z."""
    blocks = [chords[i : i + BLOCK] for i in range(0, len(chords), BLOCK)]
    ends = [np.vstack([block[:, :2], block[:, 2:]]) for block in blocks]
    return np.array([[*end.min(axis=0) - 1e-9, *end.max(axis=0) + 1e-9] for end in ends])


@njit(cache=True)
def _nearest(chords: Any, boxes: Any, x: Any, z: Any, dx: Any, dz: Any) -> Any:
    """Return the distance to the nearest chord along a ray, its index, and the fraction of its length at the hit."""
    best, hit, fraction = math.inf, -1, 0.0
    ix = 1.0 / dx if dx != 0.0 else 1e300
    iz = 1.0 / dz if dz != 0.0 else 1e300
    for b in range(len(boxes)):
        a1, a2 = (boxes[b, 0] - x) * ix, (boxes[b, 2] - x) * ix
        c1, c2 = (boxes[b, 1] - z) * iz, (boxes[b, 3] - z) * iz
        near = max(min(a1, a2), min(c1, c2))
        far = min(max(a1, a2), max(c1, c2))
        if far < 0.0 or near > far or near > best:
            continue
        for i in range(b * BLOCK, min((b + 1) * BLOCK, len(chords))):
            ex, ez = chords[i, 2] - chords[i, 0], chords[i, 3] - chords[i, 1]
            cross = dx * ez - dz * ex
            if cross == 0.0:
                continue
            px, pz = chords[i, 0] - x, chords[i, 1] - z
            t, s = (px * ez - pz * ex) / cross, (px * dz - pz * dx) / cross
            if 1e-9 < t < best and 0.0 <= s <= 1.0:
                best, hit, fraction = t, i, s
    return best, hit, fraction


@njit(cache=True)
def _power(state: Any, k: Any) -> Any:
    total = 0.0
    for j in range(6):
        total += abs(state[k, 6 + j]) ** 2
    return total


@njit(cache=True)
def _cross(a: Any, b: Any) -> Any:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _split(state: Any, k: Any, other: Any, n: Any, n1: Any, n2: Any) -> Any:
    """Replace the ray in row k by the reflected ray, and write the refracted ray to row ``other``.

    The unit normal n of the face points in the direction of propagation. Return whether there is a refracted ray.
    """
    d = (state[k, 3].real, state[k, 4].real, state[k, 5].real)
    cos = d[0] * n[0] + d[1] * n[1] + d[2] * n[2]
    s = _cross(d, n)
    sine = math.sqrt(s[0] ** 2 + s[1] ** 2 + s[2] ** 2)
    if sine < 1e-12:  # any perpendicular direction
        s = (-n[2], 0.0, n[0]) if abs(n[1]) < 0.9 else (1.0, 0.0, 0.0)
    else:
        s = (s[0] / sine, s[1] / sine, s[2] / sine)
    sine_t = n1 / n2 * sine
    cos_t = np.sqrt(complex(1.0 - sine_t**2))
    rs = (n1 * cos - n2 * cos_t) / (n1 * cos + n2 * cos_t)
    rp = (n2 * cos - n1 * cos_t) / (n2 * cos + n1 * cos_t)
    ratio, normal = n1 / n2, cos_t.real - n1 / n2 * cos
    reflected = (d[0] - 2.0 * cos * n[0], d[1] - 2.0 * cos * n[1], d[2] - 2.0 * cos * n[2])
    refracted = (ratio * d[0] + normal * n[0], ratio * d[1] + normal * n[1], ratio * d[2] + normal * n[2])
    transmits = sine_t < 1.0
    scale = math.sqrt(n2 * cos_t.real / (n1 * cos)) if transmits else 0.0  # so that |field|² is a power
    ts, tp = scale * (1.0 + rs), scale * (1.0 + rp) * n1 / n2
    p_in, p_reflected, p_refracted = _cross(s, d), _cross(s, reflected), _cross(s, refracted)
    for f in range(2):
        es, ep = 0.0j, 0.0j
        for j in range(3):
            es += state[k, 6 + 3 * f + j] * s[j]
            ep += state[k, 6 + 3 * f + j] * p_in[j]
        for j in range(3):
            state[k, 6 + 3 * f + j] = rs * es * s[j] + rp * ep * p_reflected[j]
            state[other, 6 + 3 * f + j] = (ts * es * s[j] + tp * ep * p_refracted[j]) if transmits else 0.0
    for j in range(3):
        state[other, j], state[k, 3 + j], state[other, 3 + j] = state[k, j], reflected[j], refracted[j]
    return transmits


@njit(cache=True)
def _ray(  # noqa: C901  one loop
    chords: Any,
    normals: Any,
    owner: Any,
    boxes: Any,
    state: Any,
    inside: Any,
    index: Any,
    half: Any,
    exponent: Any,
    received: Any,
) -> Any:
    """Follow the ray in row 0 of ``state`` and all rays into which it splits; add the received powers."""
    count, hits = 1, 0
    while count > 0 and hits < 50 * MAX_HITS:
        k = count - 1
        hits += 1
        if _power(state, k) < MIN_POWER or count + 1 >= STACK:
            count -= 1
            continue
        x, y, z = state[k, 0].real, state[k, 1].real, state[k, 2].real
        dx, dy, dz = state[k, 3].real, state[k, 4].real, state[k, 5].real
        t, hit, fraction = _nearest(chords, boxes, x, z, dx, dz)
        to_plane = math.inf  # distance to the top or bottom face
        if dy != 0.0:
            to_plane = (math.copysign(half, dy) - y) / dy
        if not inside[k]:
            if hit < 0 or to_plane < t:
                count -= 1
                continue
        elif to_plane < t:
            t, hit = to_plane, -2
        state[k, 0], state[k, 1], state[k, 2] = x + t * dx, y + t * dy, z + t * dz
        if hit == -2:
            n = (0.0, math.copysign(1.0, dy), 0.0)
        elif hit == -1:
            count -= 1
            continue
        else:
            nx = (1.0 - fraction) * normals[hit, 0] + fraction * normals[hit, 2]
            nz = (1.0 - fraction) * normals[hit, 1] + fraction * normals[hit, 3]
            size = math.copysign(math.sqrt(nx**2 + nz**2), nx * dx + nz * dz)
            n = (nx / size, 0.0, nz / size)
            if owner[hit] >= 0:
                if inside[k]:
                    square = 1.0 - index**2 * (1.0 - (n[0] * dx + n[2] * dz) ** 2)
                    received[owner[hit]] += _power(state, k) * max(square, 1e-12) ** (0.5 * (exponent - 1.0))
                count -= 1
                continue
        was_inside = inside[k]
        n1, n2 = (index, 1.0) if was_inside else (1.0, index)
        transmits = _split(state, k, count, n, n1, n2)
        if transmits and hit == -2:
            continue  # light transmitted through the top or bottom is lost; the reflected ray is followed
        if transmits:
            inside[count] = not was_inside
            count += 1


@njit(parallel=True, cache=True)
def _traced(
    chords: Any,
    normals: Any,
    owner: Any,
    boxes: Any,
    u: Any,
    pose: Any,
    chip: Any,
    index: Any,
    half: Any,
    exponent: Any,
) -> Any:
    parts = 64
    received = np.zeros((parts, 2))
    ca, sa = math.cos(pose[2]), math.sin(pose[2])
    for part in prange(parts):
        state, inside, powers = np.zeros((STACK, 12), np.complex128), np.zeros(STACK, np.bool_), np.zeros(2)
        for r in range(part, len(u), parts):
            position = chip[0] + chip[1] * (u[r, 2] - 0.5)
            sine, azimuth = math.sqrt(u[r, 0]), 2.0 * math.pi * u[r, 1]
            across, up, ahead = sine * math.cos(azimuth), sine * math.sin(azimuth), math.sqrt(1.0 - u[r, 0])
            state[0, 0], state[0, 1], state[0, 2] = (
                pose[0] + ca * position,
                chip[2] * (u[r, 3] - 0.5),
                pose[1] + sa * position,
            )
            d = np.array([ca * across - sa * ahead, up, sa * across + ca * ahead])
            e1 = np.array([d[2], 0.0, -d[0]]) if abs(d[1]) < 0.9 else np.array([0.0, d[2], -d[1]])
            e1 /= math.sqrt((e1**2).sum())
            e2 = np.cross(d, e1)
            for j in range(3):
                state[0, 3 + j] = d[j]
                state[0, 6 + j], state[0, 9 + j] = math.sqrt(0.5) * e1[j], math.sqrt(0.5) * e2[j]
            inside[0] = False
            _ray(chords, normals, owner, boxes, state, inside, index, half, exponent, powers)
        received[part] = powers
    return received
