"""The four motions with a chip agree with a brute-force model that shares no code with solen.

Rays from a grid over the chip and the cone are transformed to the lens frame. They meet the oval, which is located by
bisection along each ray, and are refracted with a normal from finite differences. They continue in straight lines to
the crotch, with reflections at the walls of the stem, which are polylines; for a bend, their points are computed by
integration along the centre line. Light that passes on the right of the crotch is taken to reach the right receiver.
"""

import math
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray

ROOT = Path(__file__).resolve().parents[2]
N, DISTANCE_MM, FOCUS_MM, HALF_MM = 1.44, 1.0, 20.0, 2.0
BASE_MM, STEM_MM, FLARE, CROTCH_MM = 1.810852142230, 16.2, 0.004, 17.820492
CHIP_MM, HALF_CONE_DEG = 0.2, 60.0
POINTS, ANGLES, WALL_POINTS = 25, 401, 401


def rotated(points: FloatArray, about: tuple[float, float], angle: float) -> FloatArray:
    """Return points (2, …) rotated counter-clockwise about a point."""
    x, z = points[0] - about[0], points[1] - about[1]
    c, s = math.cos(angle), math.sin(angle)
    return np.array([about[0] + c * x - s * z, about[1] + s * x + c * z])


def oval(x: FloatArray, z: FloatArray) -> FloatArray:
    """Return the residual of the oval equation in the lens frame, negative inside the lens."""
    return np.hypot(x, z + DISTANCE_MM) + N * np.hypot(x, FOCUS_MM - z) - DISTANCE_MM - N * FOCUS_MM


def chip() -> tuple[FloatArray, FloatArray]:
    """Return origins and directions (2, rays) at rest."""
    x = CHIP_MM * ((np.arange(POINTS) + 0.5) / POINTS - 0.5)
    angle = np.radians(HALF_CONE_DEG * (2.0 * (np.arange(ANGLES) + 0.5) / ANGLES - 1.0))
    x, angle = (grid.ravel() for grid in np.meshgrid(x, angle))
    return np.array([x, np.full_like(x, -DISTANCE_MM)]), np.array([np.sin(angle), np.cos(angle)])


def through_the_lens(origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, direction and transmittance behind the oval, in the lens frame, of the rays that meet it."""
    steps = np.arange(0.3, 6.0, 0.02)
    along = origin[:, None] + direction[:, None] * steps[:, None]
    inside = oval(along[0], along[1]) < 0.0
    is_hit = inside.any(axis=0)
    origin, direction = origin[:, is_hit], direction[:, is_hit]
    high = steps[inside[:, is_hit].argmax(axis=0)]
    low = high - 0.02
    for _ in range(60):
        middle = 0.5 * (low + high)
        is_inside = oval(*(origin + direction * middle)) < 0.0
        low, high = np.where(is_inside, low, middle), np.where(is_inside, middle, high)
    x, z = origin + direction * high
    h = 1e-6
    normal = np.array([oval(x + h, z) - oval(x - h, z), oval(x, z + h) - oval(x, z - h)])
    normal /= -np.hypot(*normal)
    cos_in = np.sum(normal * direction, axis=0)
    cos_out = np.sqrt(1.0 - (1.0 - cos_in**2) / N**2)
    refracted = direction / N + (cos_out - cos_in / N) * normal
    s = ((cos_in - N * cos_out) / (cos_in + N * cos_out)) ** 2
    p = ((N * cos_in - cos_out) / (N * cos_in + cos_out)) ** 2
    enters = (np.abs(x) < HALF_MM) & (cos_in > 0.0)
    return np.array([x, z])[:, enters], refracted[:, enters], (1.0 - 0.5 * (s + p))[enters]


def bent(points: FloatArray, angle: float) -> FloatArray:
    """Return points (2, N) of the stem after a uniform bend, by summation of straight steps along the centre line."""
    x, z = points
    length = BASE_MM + STEM_MM - z
    directions = angle / STEM_MM * length * (np.arange(2000)[:, None] + 0.5) / 2000
    centre_x = np.sin(directions).mean(axis=0) * length
    centre_z = BASE_MM + STEM_MM - np.cos(directions).mean(axis=0) * length
    rotation = angle * length / STEM_MM
    return np.array([centre_x + x * np.cos(rotation), centre_z + x * np.sin(rotation)])


def x_at_crotch(position: FloatArray, direction: FloatArray, walls: list[FloatArray]) -> FloatArray:
    """Return x (rays,) at the height of the crotch, after reflections at the walls."""
    position, direction = position.copy(), direction.copy()
    moving = np.ones(position.shape[1], dtype=bool)
    for _ in range(6):
        distance = np.where(moving, (CROTCH_MM - position[1]) / direction[1], 0.0)
        normal = np.zeros_like(direction)
        for points in walls:
            a, step = points[:, :-1], np.diff(points, axis=1)
            across = direction[0][:, None] * step[1] - direction[1][:, None] * step[0]
            to_x, to_z = a[0] - position[0][:, None], a[1] - position[1][:, None]
            t = (to_x * step[1] - to_z * step[0]) / across
            u = (to_x * direction[1][:, None] - to_z * direction[0][:, None]) / across
            t[(u < 0.0) | (u >= 1.0) | (t < 1e-3)] = np.inf
            nearest = t.argmin(axis=1)
            t_min = t[np.arange(len(nearest)), nearest]
            first = t_min < distance
            distance = np.where(first, t_min, distance)
            side = np.array([-step[1], step[0]])[:, nearest] / np.hypot(*step)[nearest]
            normal = np.where(first, side, normal)
        position = position + direction * distance
        direction = direction - 2.0 * np.sum(direction * normal, axis=0) * normal
        moving = np.hypot(*normal) > 0.0
        if not moving.any():
            break
    return np.asarray(position[0])


def wall(side: float, edge: FloatArray) -> FloatArray:
    """Return points of a side of the stem, beginning at the edge of the lens, which may be lower or higher."""
    rise = np.linspace(max(0.0, float(edge[1, 0]) - BASE_MM), STEM_MM, WALL_POINTS)
    stem_side = np.array([side * (HALF_MM + FLARE * rise**2), BASE_MM + rise])
    gap = float(np.hypot(*(stem_side[:, 0] - edge[:, 0])))
    return np.hstack([edge, stem_side]) if gap > 1e-9 else stem_side


def contrast(motion: str, angle_deg: float) -> float:
    angle, (origin, direction) = math.radians(angle_deg), chip()
    pivot = (0.0, -DISTANCE_MM) if motion == "about the emitter" else (0.0, BASE_MM)
    if motion == "the emitter alone":
        origin, direction = rotated(origin, pivot, angle), rotated(direction, (0.0, 0.0), angle)
    position, direction, weight = through_the_lens(origin, direction)
    edge_angle = 0.0 if motion in ("the emitter alone", "a bend") else angle
    walls = [wall(side, rotated(np.array([[side * HALF_MM], [BASE_MM]]), pivot, edge_angle)) for side in (1.0, -1.0)]
    if motion == "a bend":
        base = bent(np.array([[0.0], [BASE_MM]]), angle)[:, 0]
        position = rotated(position, (0.0, BASE_MM), angle) + (base - np.array([0.0, BASE_MM]))[:, None]
        walls = [bent(points, angle) for points in walls]
    elif motion != "the emitter alone":
        position = rotated(position, pivot, angle)
    if motion != "the emitter alone":
        direction = rotated(direction, (0.0, 0.0), angle)
    x = x_at_crotch(position, direction, walls)
    right, left = float(weight[x > 0.0].sum()), float(weight[x < 0.0].sum())
    return (right - left) / (right + left)


@pytest.fixture(scope="module")
def example() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "examples" / "four_motions.py"))


@pytest.fixture(scope="module")
def contrasts(example: dict[str, Any]) -> dict[str, tuple[float, ...]]:
    result: dict[str, tuple[float, ...]] = example["main"]()
    return result


@pytest.mark.parametrize("motion", ["about the stem base", "about the emitter", "the emitter alone", "a bend"])
def test_brute_force(motion: str, example: dict[str, Any], contrasts: dict[str, tuple[float, ...]]) -> None:
    assert set(contrasts) == set(example["MOTIONS"])
    for angle_deg, value in zip(example["ANGLES_DEG"], contrasts[motion], strict=True):
        # if the lens is displaced from the stem, 1 % of the light enters through the step between them
        is_displaced = motion == "about the emitter" and abs(angle_deg) > 2.0
        assert contrast(motion, angle_deg) == pytest.approx(value, abs=0.025 if is_displaced else 6e-3)


def test_motions_have_different_calibrations(contrasts: dict[str, tuple[float, ...]]) -> None:
    first = [values[0] for values in contrasts.values()]
    assert min(abs(a - b) for i, a in enumerate(first) for b in first[:i]) > 0.02
    assert contrasts["a bend"][1] / contrasts["about the stem base"][1] == pytest.approx(0.5, abs=0.02)
