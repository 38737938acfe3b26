"""The batch makes the tables of scenes: rays meet the same curves, and its numbers are those of integration."""

import math

import numpy as np
import pytest

from solen.curve import END_TOLERANCE_MM
from solen.errors import SolenError
from solen.sensor import Sensor, numbers_of
from solen.spec import Design
from solen.trace import batch
from solen.trace.kernel import loop, tally
from solen.trace.kernel.room import BLOCK, Rows, room
from solen.trace.tables import Tables, compile_scene

ANGLES = np.array([-2.5, 0.0, 1.25])
BASE = Design.model_validate({"name": "paper", "material": {"index": 1.44}, "emitter": {"width_mm": 0.2}})
HITS = 20
"""Meetings after which rounding may have grown to anything, and powers alone are compared."""
EDGE = 1e-12
"""How near to an edge a ray must pass to be let off, in mm or as a cosine."""


def random_sensors(many: int, seed: int) -> list[Sensor]:
    """Designs drawn at random that can be built at `ANGLES`."""
    draw, found = np.random.default_rng(seed), []
    while len(found) < many:
        flat, gapped = draw.random() < 0.2, draw.random() < 0.3
        values = {
            "material.index": draw.uniform(1.35, 1.6),
            "material.absorption_per_mm": draw.choice([0.0, 0.01]),
            "emitter.distance_mm": draw.uniform(0.5, 2.0),
            "lens.focus_mm": draw.uniform(8.0, 60.0),
            "lens.half_width_mm": draw.uniform(0.8, 2.6),
            "lens.shape": "none" if flat else "cartesian-oval",
            "body.stem_length_mm": draw.uniform(6.0, 30.0),
            "body.stem_curve_per_mm": draw.uniform(0.002, 0.01),
            "body.arm_length_mm": draw.uniform(8.0, 30.0),
            "body.arm_width_mm": draw.uniform(0.8, 4.0),
            "motion.pivot": draw.choice(["stem-base", "emitter"]) if draw.random() < 0.8 else (0.1, 3.0),
            "motion.moves": ("emitter",) if draw.random() < 0.2 else ("lens", "emitter"),
            "motion.join": draw.choice(["bridge", "seam"]),
        }
        if draw.random() < 0.3:
            values["body.arm_angle_deg"] = draw.uniform(4.0, 25.0)
        if not flat and draw.random() < 0.3:
            values["lens.design_index"] = draw.uniform(1.4, 1.6)
        if gapped:
            values |= {"receivers.coupling": "air-gap", "receivers.gap_mm": draw.uniform(0.1, 1.0)}
        try:
            sensor = Sensor.of(
                BASE.set({key: v.item() if isinstance(v, np.generic) else v for key, v in values.items()})
            )
            for angle in ANGLES.tolist():
                sensor.scene(angle)
        except SolenError:
            continue
        found.append(sensor)
    return found


class Legs:
    """The first stretches of all rays through tables, ray by ray, and the powers at both receivers."""

    def __init__(self, tables: Tables, rays: Rows, lot: batch.Lot) -> None:
        sums = batch.empty_sums(1)
        self.sums = tally.Sums(
            sums.fate[0], sums.detected, sums.arrived, sums.optical, sums.position, sums.angle, sums.crossed,
            sums.crossings, sums.maps, sums.counts[0], sums.place[0], np.empty((512 * len(rays.x), tally.LEG_WIDTH)),
        )  # fmt: skip
        space = room(len(rays.x), np.float64, 64 * BLOCK)
        assert loop.trace_rays(batch.DOUBLE, tables, self.sums, rays, lot.rules, space, None)
        rows = self.sums.legs[: self.sums.counts[tally.LEGS]]
        assert len(rows) == self.sums.counts[tally.LEGS] <= len(self.sums.legs)
        rows = rows[rows[:, 3] < HITS]
        self.rows = rows[np.lexsort((rows[:, 3], rows[:, 1], rows[:, 0]))]
        self.power = self.sums.detected

    def without_joins(self, sensor: Sensor, angle: float, pieces: int) -> None:
        """Number interfaces as if there were no joins, where a scene has some that rounding alone opened."""
        faces = sensor.scene(angle).interfaces
        if len(faces) != pieces:
            kept = [face.name for face in faces if not face.name.startswith("join")]
            assert len(kept) == pieces
            assert angle == 0.0
            number = [kept.index(face.name) if face.name in kept else -2 for face in faces] + [-1]
            self.rows[:, 4] = np.array(number)[self.rows[:, 4].astype(int)]

    def of_ray(self, ray: int) -> np.ndarray:
        return self.rows[self.rows[:, 0] == ray]


def tables_of(lot: batch.Lot, a: int) -> Tables:
    """Tables that a lot has made of a scene."""
    p, q = lot.starts.piece[a : a + 2]
    by_piece = {name: getattr(lot.tables, name)[p:q] for name in Tables._fields[:12]}
    by_colour = {name: getattr(lot.tables, name)[a : a + 1] for name in Tables._fields[12:17]}
    whole = {name: getattr(lot.tables, name) for name in Tables._fields[17:22]}
    grid = {name: getattr(lot.tables, name)[2 * a : 2 * a + 2] for name in Tables._fields[22:26]}
    return Tables(**by_piece, **by_colour, **whole, **grid, grid_item=lot.tables.grid_item)


def from_an_edge(sensor: Sensor, angle: float, here: np.ndarray, there: np.ndarray) -> float:
    """How far from an edge two rays of one launch pass where they part, beyond what they are apart by themselves.

    An edge is an end of a curve, in mm, or the critical angle, as a cosine.
    """
    scene = sensor.scene(angle)
    ends = np.array([end for face in scene.interfaces for end in (face.curve.start, face.curve.end)])
    nearest, apart = math.inf, 0.0
    for mine, its in zip(here, there, strict=False):
        apart = max(
            apart, float(np.abs(np.nan_to_num(mine[6:11], posinf=0.0) - np.nan_to_num(its[6:11], posinf=0.0)).max())
        )
        for leg in (mine, its):
            if leg[4] < 0:
                continue
            at, towards = (leg[6] + leg[10] * leg[8], leg[7] + leg[10] * leg[9]), leg[8:10]
            nearest = min(nearest, float(np.min(np.hypot(*(ends - at).T))) - END_TOLERANCE_MM)
            cos = float(np.dot(scene.interfaces[int(leg[4])].curve.normal_at(at), towards))
            index = sensor.material.index
            nearest = min(nearest, abs(abs(cos) - math.sqrt(1.0 - 1.0 / index**2)))
        if not np.array_equal(mine[1:6], its[1:6]):
            break
    return nearest - 10.0 * apart


def compare(sensors: list[Sensor], bins: int, each: int) -> tuple[int, int, float]:
    """Rays, those that go other ways or end with other powers, and by how much powers differ where ways are the same.

    Other powers differ by more than 1e-12 of the emitted light.
    """
    numbers, edges = numbers_of(sensors), np.linspace(-0.15, 0.15, bins + 1)
    lot = batch.Lot(ANGLES, bins, each, 0, "power", False)
    many, others, most = 0, 0, 0.0
    for d, sensor in enumerate(sensors):
        found = lot.traced(numbers, d, batch.Bins(edges[:-1], edges[1:]), d)
        for a, angle in enumerate(ANGLES.tolist()):
            begin, end = a * bins * each, (a + 1) * bins * each
            rays = Rows(*(column[begin:end] for column in lot.rays))
            mine, its = Legs(tables_of(lot, a), rays, lot), Legs(compile_scene(sensor.scene(angle)), rays, lot)
            assert found.power[a].sum(axis=0) == pytest.approx(its.power, abs=1e-8)
            its.without_joins(sensor, angle, lot.starts.piece[a + 1] - lot.starts.piece[a])
            many += end - begin
            if mine.rows.shape == its.rows.shape and np.array_equal(mine.rows[:, :6], its.rows[:, :6]):
                apart = np.abs(mine.rows[:, 11:13] - its.rows[:, 11:13]).max(axis=1)
                others += len(np.unique(mine.rows[apart > EDGE, 0]))
                most = max(most, float(apart.max()))
                continue
            for ray in range(end - begin):
                here, there = mine.of_ray(ray), its.of_ray(ray)
                if not (len(here) == len(there) and np.array_equal(here[:, 1:6], there[:, 1:6])):
                    others += 1
                    assert from_an_edge(sensor, angle, here, there) < EDGE, (d, angle, ray)
    return many, others, most


def test_rays_of_a_batch_go_as_those_of_scenes_do() -> None:
    many, others, most = compare(random_sensors(6, 1), 4, 64)
    assert (many, others) == (6 * 3 * 256, 0)
    assert most < 1e-12


@pytest.mark.evidence
def test_rays_of_500_random_designs_go_as_those_of_scenes_do() -> None:
    many, others, most = compare(random_sensors(500, 2), 4, 64)
    print(f"{many} rays, {others} of other ways or powers; those of the same ways agree within {most:.1e}")
    assert others <= 1e-5 * many
    assert most < 1e-11
