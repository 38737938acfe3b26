"""A brute-force tracer of upright walls in space, of nothing that the engine is made of: for what a design must give.

Walls are chains of short chords with the curves' own normals between them. A ray carries two fields that know nothing
of each other as complex vectors; at every face these are split into their parts across and in the plane of incidence by
Fresnel's amplitudes, at top and bottom too. Rays start at Sobol' points of the chip and of Lambert's law.
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
    """Shares of the emitted power that the right and the left receiver see (2,), at an angle of the motion.

    The sensor states its body and motion, a matched face for each receiver, and a clear material; its emitter is
    replaced by the chip. A receiver sees a beam as the cosine of its angle in air to the ``exponent``.
    """
    body = sensor.body(angle_deg)
    walls = [(face.curve, _receiver(face.label) if face.part == "receiver" else -1) for face in body.all_faces]
    chords, normals, owner = (np.concatenate(part) for part in zip(*(_chords(*wall) for wall in walls), strict=True))
    u = qmc.Sobol(4, rng=np.random.default_rng(seed)).random_base2(log2_rays)
    found = _traced(
        chords, normals, owner, _boxes(chords), u,
        np.array([*body.emitter.point, math.radians(body.emitter.axis_deg)]),
        np.array([chip.offset_mm - sensor.design.emitter.offset_mm, chip.width_mm, chip.height_mm]),
        float(sensor.material.index), 0.5 * sensor.design.body.thickness_mm, exponent,
    )  # fmt: skip
    return np.asarray(found.sum(axis=0) / len(u))


def _receiver(side: str) -> int:
    return ("right", "left").index(side)


def _chords(curve: Curve, owner: int) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Chords (n, 4) of a curve and its unit normals at their ends (n, 4)."""
    coarse, ways = curve.points(np.linspace(0.0, 1.0, 65)), curve.velocities(np.array([0.0, 0.5, 1.0]))
    length = float(np.hypot(*np.diff(coarse, axis=0).T).sum())
    turns = float(np.abs(np.diff(np.unwrap(np.arctan2(ways[:, 0], ways[:, 1])))).sum())
    u = np.linspace(0.0, 1.0, 2 + math.ceil(math.sqrt(length * turns / (8.0 * SAGITTA_MM))))
    points, along = curve.points(u), curve.velocities(u)
    across = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]
    return np.hstack([points[:-1], points[1:]]), np.hstack([across[:-1], across[1:]]), np.full(len(u) - 1, owner)


def _boxes(chords: FloatArray) -> FloatArray:
    """Boxes (m, 4) about every few chords: least x and z, greatest x and z."""
    blocks = [chords[i : i + BLOCK] for i in range(0, len(chords), BLOCK)]
    ends = [np.vstack([block[:, :2], block[:, 2:]]) for block in blocks]
    return np.array([[*end.min(axis=0) - 1e-9, *end.max(axis=0) + 1e-9] for end in ends])


@njit(cache=True)
def _nearest(chords: Any, boxes: Any, x: Any, z: Any, dx: Any, dz: Any) -> Any:
    """Way to the nearest chord, which one, and where on it."""
    best, which, at = math.inf, -1, 0.0
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
                best, which, at = t, i, s
    return best, which, at


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
    """Row k becomes the reflected ray at a face whose unit normal n points along it; ``other`` the refracted one."""
    d = (state[k, 3].real, state[k, 4].real, state[k, 5].real)
    cos = d[0] * n[0] + d[1] * n[1] + d[2] * n[2]
    s = _cross(d, n)
    sine = math.sqrt(s[0] ** 2 + s[1] ** 2 + s[2] ** 2)
    if sine < 1e-12:  # any direction across it will do
        s = (-n[2], 0.0, n[0]) if abs(n[1]) < 0.9 else (1.0, 0.0, 0.0)
    else:
        s = (s[0] / sine, s[1] / sine, s[2] / sine)
    sine_t = n1 / n2 * sine
    cos_t = np.sqrt(complex(1.0 - sine_t**2))
    rs = (n1 * cos - n2 * cos_t) / (n1 * cos + n2 * cos_t)
    rp = (n2 * cos - n1 * cos_t) / (n2 * cos + n1 * cos_t)
    ratio, more = n1 / n2, cos_t.real - n1 / n2 * cos
    back = (d[0] - 2.0 * cos * n[0], d[1] - 2.0 * cos * n[1], d[2] - 2.0 * cos * n[2])
    on = (ratio * d[0] + more * n[0], ratio * d[1] + more * n[1], ratio * d[2] + more * n[2])
    passes = sine_t < 1.0
    size = math.sqrt(n2 * cos_t.real / (n1 * cos)) if passes else 0.0
    ts, tp = size * (1.0 + rs), size * (1.0 + rp) * n1 / n2
    p_in, p_back, p_on = _cross(s, d), _cross(s, back), _cross(s, on)
    for f in range(2):
        es, ep = 0.0j, 0.0j
        for j in range(3):
            es += state[k, 6 + 3 * f + j] * s[j]
            ep += state[k, 6 + 3 * f + j] * p_in[j]
        for j in range(3):
            state[k, 6 + 3 * f + j] = rs * es * s[j] + rp * ep * p_back[j]
            state[other, 6 + 3 * f + j] = (ts * es * s[j] + tp * ep * p_on[j]) if passes else 0.0
    for j in range(3):
        state[other, j], state[k, 3 + j], state[other, 3 + j] = state[k, j], back[j], on[j]
    return passes


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
    found: Any,
) -> Any:
    """Follow the ray in row 0 of ``state`` with all that it is divided into."""
    count, hits = 1, 0
    while count > 0 and hits < 50 * MAX_HITS:
        k = count - 1
        hits += 1
        if _power(state, k) < MIN_POWER or count + 1 >= STACK:
            count -= 1
            continue
        x, y, z = state[k, 0].real, state[k, 1].real, state[k, 2].real
        dx, dy, dz = state[k, 3].real, state[k, 4].real, state[k, 5].real
        t, which, at = _nearest(chords, boxes, x, z, dx, dz)
        lid = math.inf
        if dy != 0.0:
            lid = (math.copysign(half, dy) - y) / dy
        if not inside[k]:
            if which < 0 or lid < t:
                count -= 1
                continue
        elif lid < t:
            t, which = lid, -2
        state[k, 0], state[k, 1], state[k, 2] = x + t * dx, y + t * dy, z + t * dz
        if which == -2:
            n = (0.0, math.copysign(1.0, dy), 0.0)
        elif which == -1:
            count -= 1
            continue
        else:
            nx = (1.0 - at) * normals[which, 0] + at * normals[which, 2]
            nz = (1.0 - at) * normals[which, 1] + at * normals[which, 3]
            size = math.copysign(math.sqrt(nx**2 + nz**2), nx * dx + nz * dz)
            n = (nx / size, 0.0, nz / size)
            if owner[which] >= 0:
                if inside[k]:
                    square = 1.0 - index**2 * (1.0 - (n[0] * dx + n[2] * dz) ** 2)
                    found[owner[which]] += _power(state, k) * max(square, 1e-12) ** (0.5 * (exponent - 1.0))
                count -= 1
                continue
        here = inside[k]
        n1, n2 = (index, 1.0) if here else (1.0, index)
        passes = _split(state, k, count, n, n1, n2)
        if passes and which == -2:
            continue  # what leaves through top or bottom is gone; what is reflected goes on
        if passes:
            inside[count] = not here
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
    found = np.zeros((parts, 2))
    ca, sa = math.cos(pose[2]), math.sin(pose[2])
    for part in prange(parts):
        state, inside, mine = np.zeros((STACK, 12), np.complex128), np.zeros(STACK, np.bool_), np.zeros(2)
        for r in range(part, len(u), parts):
            place = chip[0] + chip[1] * (u[r, 2] - 0.5)
            sine, turn = math.sqrt(u[r, 0]), 2.0 * math.pi * u[r, 1]
            across, up, ahead = sine * math.cos(turn), sine * math.sin(turn), math.sqrt(1.0 - u[r, 0])
            state[0, 0], state[0, 1], state[0, 2] = (
                pose[0] + ca * place,
                chip[2] * (u[r, 3] - 0.5),
                pose[1] + sa * place,
            )
            d = np.array([ca * across - sa * ahead, up, sa * across + ca * ahead])
            one = np.array([d[2], 0.0, -d[0]]) if abs(d[1]) < 0.9 else np.array([0.0, d[2], -d[1]])
            one /= math.sqrt((one**2).sum())
            two = np.cross(d, one)
            for j in range(3):
                state[0, 3 + j] = d[j]
                state[0, 6 + j], state[0, 9 + j] = math.sqrt(0.5) * one[j], math.sqrt(0.5) * two[j]
            inside[0] = False
            _ray(chords, normals, owner, boxes, state, inside, index, half, exponent, mine)
        found[part] = mine
    return found
