"""The four motions with a chip, against a brute force that shares nothing with solen.

Rays from a grid over the chip and the cone are taken into the lens's frame, meet the oval by halving along the ray, and
are refracted with a normal by finite differences. Then they go straight to the crotch, mirrored where they meet the
stem's walls, which are polylines: for a bend, of points found by walking down the centre line. What passes right of the
crotch counts as right.
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
POINTS, ANGLES, WALL_POINTS = 25, 401, 801


def turned(points: FloatArray, about: tuple[float, float], angle: float) -> FloatArray:
    """Points (2, …) turned counter-clockwise about a point."""
    x, z = points[0] - about[0], points[1] - about[1]
    c, s = math.cos(angle), math.sin(angle)
    return np.array([about[0] + c * x - s * z, about[1] + s * x + c * z])


def oval(x: FloatArray, z: FloatArray) -> FloatArray:
    """Negative inside the lens, in its own frame."""
    return np.hypot(x, z + DISTANCE_MM) + N * np.hypot(x, FOCUS_MM - z) - DISTANCE_MM - N * FOCUS_MM


def chip() -> tuple[FloatArray, FloatArray]:
    """Origins and directions (2, rays) at rest."""
    x = CHIP_MM * ((np.arange(POINTS) + 0.5) / POINTS - 0.5)
    angle = np.radians(HALF_CONE_DEG * (2.0 * (np.arange(ANGLES) + 0.5) / ANGLES - 1.0))
    x, angle = (grid.ravel() for grid in np.meshgrid(x, angle))
    return np.array([x, np.full_like(x, -DISTANCE_MM)]), np.array([np.sin(angle), np.cos(angle)])


def through_the_lens(origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place, direction and transmittance behind the oval, in the lens's frame, of the rays that meet it."""
    steps = np.arange(0.3, 6.0, 0.02)
    along = origin[:, None] + direction[:, None] * steps[:, None]
    inside = oval(along[0], along[1]) < 0.0
    met = inside.any(axis=0)
    origin, direction = origin[:, met], direction[:, met]
    high = steps[inside[:, met].argmax(axis=0)]
    low = high - 0.02
    for _ in range(60):
        middle = 0.5 * (low + high)
        within = oval(*(origin + direction * middle)) < 0.0
        low, high = np.where(within, low, middle), np.where(within, middle, high)
    place = origin + direction * high
    h = 1e-6
    normal = np.array(
        [
            oval(place[0] + h, place[1]) - oval(place[0] - h, place[1]),
            oval(place[0], place[1] + h) - oval(place[0], place[1] - h),
        ]
    )
    normal /= -np.hypot(*normal)
    cos_in = np.sum(normal * direction, axis=0)
    cos_out = np.sqrt(1.0 - (1.0 - cos_in**2) / N**2)
    out = direction / N + (cos_out - cos_in / N) * normal
    s = ((cos_in - N * cos_out) / (cos_in + N * cos_out)) ** 2
    p = ((N * cos_in - cos_out) / (N * cos_in + cos_out)) ** 2
    enters = (np.abs(place[0]) < HALF_MM) & (cos_in > 0.0)
    return place[:, enters], out[:, enters], (1.0 - 0.5 * (s + p))[enters]


def bent(points: FloatArray, angle: float) -> FloatArray:
    """Points (2, N) of the stem after an even bend, by walking down the centre line in straight steps."""
    found = []
    for x, z in points.T:
        length = BASE_MM + STEM_MM - z
        turns = angle / STEM_MM * length * (np.arange(2000) + 0.5) / 2000
        down = np.array([np.sin(turns).sum(), -np.cos(turns).sum()]) * length / 2000
        turn = angle * length / STEM_MM
        found.append([down[0] + x * math.cos(turn), BASE_MM + STEM_MM + down[1] + x * math.sin(turn)])
    return np.array(found).T


def at_the_crotch(place: FloatArray, direction: FloatArray, walls: list[FloatArray]) -> FloatArray:
    """x (rays,) at the crotch's height, after mirroring at the walls."""
    place, direction = place.copy(), direction.copy()
    moving = np.ones(place.shape[1], dtype=bool)
    for _ in range(6):
        distance = np.where(moving, (CROTCH_MM - place[1]) / direction[1], 0.0)
        normal = np.zeros_like(direction)
        for one in walls:
            a, step = one[:, :-1], np.diff(one, axis=1)
            across = direction[0][:, None] * step[1] - direction[1][:, None] * step[0]
            to_x, to_z = a[0] - place[0][:, None], a[1] - place[1][:, None]
            t = (to_x * step[1] - to_z * step[0]) / across
            share = (to_x * direction[1][:, None] - to_z * direction[0][:, None]) / across
            t[(share < 0.0) | (share >= 1.0) | (t < 1e-3)] = np.inf
            nearest = t.argmin(axis=1)
            t_min = t[np.arange(len(nearest)), nearest]
            first = t_min < distance
            distance = np.where(first, t_min, distance)
            side = np.array([-step[1], step[0]])[:, nearest] / np.hypot(*step)[nearest]
            normal = np.where(first, side, normal)
        place = place + direction * distance
        direction = direction - 2.0 * np.sum(direction * normal, axis=0) * normal
        moving = np.hypot(*normal) > 0.0
        if not moving.any():
            break
    return np.asarray(place[0])


def wall(side: float, edge: FloatArray) -> FloatArray:
    """Points of the stem's side from the lens's edge on, which may have sunk or risen."""
    rise = np.linspace(max(0.0, float(edge[1, 0]) - BASE_MM), STEM_MM, WALL_POINTS)
    side_of_stem = np.array([side * (HALF_MM + FLARE * rise**2), BASE_MM + rise])
    apart = float(np.hypot(*(side_of_stem[:, 0] - edge[:, 0])))
    return np.hstack([edge, side_of_stem]) if apart > 1e-9 else side_of_stem


def contrast(motion: str, angle_deg: float) -> float:
    angle, (origin, direction) = math.radians(angle_deg), chip()
    pivot = (0.0, -DISTANCE_MM) if motion == "about the emitter" else (0.0, BASE_MM)
    if motion == "the emitter alone":
        origin, direction = turned(origin, pivot, angle), turned(direction, (0.0, 0.0), angle)
    place, direction, weight = through_the_lens(origin, direction)
    leans = 0.0 if motion in ("the emitter alone", "a bend") else angle
    walls = [wall(side, turned(np.array([[side * HALF_MM], [BASE_MM]]), pivot, leans)) for side in (1.0, -1.0)]
    if motion == "a bend":
        base = bent(np.array([[0.0], [BASE_MM]]), angle)[:, 0]
        place = turned(place, (0.0, BASE_MM), angle) + (base - np.array([0.0, BASE_MM]))[:, None]
        walls = [bent(one[:, ::4], angle) for one in walls]
    elif motion != "the emitter alone":
        place = turned(place, pivot, angle)
    if motion != "the emitter alone":
        direction = turned(direction, (0.0, 0.0), angle)
    x = at_the_crotch(place, direction, walls)
    right, left = float(weight[x > 0.0].sum()), float(weight[x < 0.0].sum())
    return (right - left) / (right + left)


@pytest.fixture(scope="module")
def example() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "examples" / "four_motions.py"))


@pytest.fixture(scope="module")
def found(example: dict[str, Any]) -> dict[str, tuple[float, ...]]:
    result: dict[str, tuple[float, ...]] = example["main"]()
    return result


@pytest.mark.parametrize("motion", ["about the stem base", "about the emitter", "the emitter alone", "a bend"])
def test_the_brute_force_finds_the_same(
    motion: str, example: dict[str, Any], found: dict[str, tuple[float, ...]]
) -> None:
    assert set(found) == set(example["MOTIONS"])
    for angle_deg, value in zip(example["ANGLES_DEG"], found[motion], strict=True):
        # where the lens stands beside the stem, 1 % of the light enters by the step that joins the two
        aside = motion == "about the emitter" and abs(angle_deg) > 2.0
        assert contrast(motion, angle_deg) == pytest.approx(value, abs=0.025 if aside else 6e-3)


def test_they_are_different_calibrations(found: dict[str, tuple[float, ...]]) -> None:
    at_half = [contrasts[0] for contrasts in found.values()]
    assert min(abs(a - b) for i, a in enumerate(at_half) for b in at_half[:i]) > 0.02
    assert found["a bend"][1] / found["about the stem base"][1] == pytest.approx(0.5, abs=0.02)
