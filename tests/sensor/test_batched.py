"""The batch makes the tables of scenes: rays meet the same curves, and its numbers are those of integration."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import END_TOLERANCE_MM
from solen.errors import DesignError, SolenError
from solen.sensor import Responses, Sensor, numbers_of, respond, why_not_batched
from solen.spec import Design
from solen.trace import batch
from solen.trace.kernel import loop, tally
from solen.trace.kernel.buffers import BLOCK, Rows, new_buffers
from solen.trace.sums import of_tasks
from solen.trace.tables import Tables, compile_scene
from tests.lens.measured_support import X, lens, profile

ANGLES = np.array([-2.5, 0.0, 1.25])
BASE = Design.model_validate({"name": "paper", "material": {"index": 1.44}, "emitter": {"width_mm": 0.2}})
HITS = 20
"""Meetings after which rounding may have grown to anything, and powers alone are compared."""
EDGE = 1e-12
"""How near to an edge a ray must pass to be let off, in mm or as a cosine."""


def random_sensors(many: int, seed: int) -> list[Sensor]:
    """Designs drawn at random that can be built at `ANGLES`."""
    draw = np.random.default_rng(seed)
    found: list[Sensor] = []
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

    def __init__(self, tables: Tables, rays: Rows, lot: batch.DesignBatch) -> None:
        sums = of_tasks(1, 2)
        self.sums = tally.Sums(
            sums.fate[0], sums.detected, sums.arrived, sums.optical, sums.position, sums.angle, sums.crossed,
            sums.crossings, sums.maps, sums.counts[0], sums.place[0], np.empty((512 * len(rays.x), tally.LEG_WIDTH)),
        )  # fmt: skip
        space = new_buffers(len(rays.x), np.float64, 64 * BLOCK)
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

    def of_ray(self, ray: int) -> FloatArray:
        own: FloatArray = self.rows[self.rows[:, 0] == ray]
        return own


def tables_of(lot: batch.DesignBatch, a: int) -> Tables:
    """Tables that a lot has made of a scene."""
    p, q = lot.starts.piece[a : a + 2]
    parts: list[Any] = list(lot.tables)
    parts[:12] = [column[p:q] for column in parts[:12]]
    parts[12:17] = [column[a : a + 1] for column in parts[12:17]]
    parts[22:26] = [column[2 * a : 2 * a + 2] for column in parts[22:26]]
    return Tables(*parts)


def from_an_edge(sensor: Sensor, angle: float, here: FloatArray, there: FloatArray) -> float:
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
    lot = batch.DesignBatch(ANGLES, bins, each, 0, "power", False)
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


FEW_ANGLES = (-2.5, -0.75, 0.75)
CHIPS = ((0.2, 0.0), (0.15, 0.04), (0.25, -0.03))
IN_SPACE = {"trace.dimension": "extruded", "emitter.pattern": "lambertian", "emitter.height_mm": 0.2}


def off_by(found: Responses, sensor: Sensor, angles: tuple[float, ...], tolerance: float) -> list[float]:
    """Errors of a batch's powers over what they are known to, against integration at some angles."""
    ratios = []
    for k, (width, offset) in enumerate(CHIPS):
        chip = sensor.set({"emitter.width_mm": width, "emitter.offset_mm": offset})
        for a, angle in enumerate(angles):
            exact = chip.integrate(angle, tolerance=tolerance)
            u = math.hypot(found.u_power[0, k, a], exact.u_power)
            ratios += [(found.right[0, k, a] - exact.detectors["right"].power) / u]
            ratios += [(found.left[0, k, a] - exact.detectors["left"].power) / u]
    return ratios


def responded(sensor: Sensor, angles: tuple[float, ...], rays: int, seed: int = 0) -> Responses:
    width, offset = zip(*CHIPS, strict=True)
    return respond([sensor], angles, width, offset, rays=rays, seed=seed)


@pytest.mark.parametrize(
    "values",
    [
        {"material.absorption_per_mm": 0.01},
        {"lens.shape": "none", "receivers.coupling": "air-gap", "receivers.gap_mm": 0.5},
        {"motion.moves": ("emitter",), "motion.pivot": (0.1, 3.0), "emitter.pattern": "lambertian"},
    ],
    ids=["loss", "flat and gap", "emitter alone"],
)
def test_powers_are_those_of_integration_within_their_uncertainty(values: dict[str, object]) -> None:
    sensor = Sensor.of(BASE.set(values))
    found = responded(sensor, FEW_ANGLES[1:], 2**12)
    assert found.u_power.max() < 6e-3
    assert max(map(abs, off_by(found, sensor, FEW_ANGLES[1:], 2e-4))) < 4.0
    assert found.truncated.max() < 1e-4


@pytest.mark.evidence
@pytest.mark.parametrize("values", [{}, IN_SPACE], ids=["plane", "space"])
def test_two_uncertainties_hold_95_percent(values: dict[str, object]) -> None:
    rng, ratios = np.random.default_rng(3), []
    for number in range(12):
        numbers = {"lens.focus_mm": rng.uniform(12, 30), "material.index": rng.uniform(1.4, 1.5)}
        sensor = Sensor.of(BASE.set(numbers | values))
        found = responded(sensor, FEW_ANGLES, 2 ** int(rng.integers(11, 14)), number)
        ratios += off_by(found, sensor, FEW_ANGLES, 2e-4)
    within = float(np.mean(np.abs(ratios) < 2.0))
    print(f"{within:.3f} of {len(ratios)} powers within 2 u, {np.mean(np.abs(ratios) < 1.0):.3f} within 1")
    assert within > 0.93


def test_powers_in_space_are_those_of_integration() -> None:
    sensor = Sensor.of(BASE.set(IN_SPACE))
    found = responded(sensor, (0.75,), 2**13)
    assert found.u_power.max() < 3e-3
    assert max(map(abs, off_by(found, sensor, (0.75,), 1e-3))) < 4.0


def test_many_chips_are_interpolated_within_their_uncertainty() -> None:
    sensor = Sensor.of(BASE)
    offset, width = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.06, 0.06, 20), [0.16, 0.2, 0.24]))
    found = respond([sensor], FEW_ANGLES, width, offset, rays=2**14)
    for k in (7, 31):
        alone = respond([sensor], FEW_ANGLES, width[k], offset[k], rays=2**14, seed=1)
        apart = np.abs(found.right[0, k] - alone.right[0, 0]) / np.hypot(found.u_power[0, k], alone.u_power[0, 0])
        assert apart.max() < 4.0


def test_points_are_counted_as_integration_counts_them() -> None:
    sensor = Sensor.of(BASE.set({"emitter.width_mm": 0.0}))
    found = respond([sensor], FEW_ANGLES, rays=2**12, mode="count")
    for a, angle in enumerate(FEW_ANGLES):
        exact = sensor.integrate(angle, "count").detectors["right"].power
        assert found.right[0, 0, a] == pytest.approx(exact, abs=4.0 * found.u_power[0, 0, a])
    assert 0.0 < found.u_power.max() < 2e-3


def test_a_symmetric_sensor_has_mirrored_powers_and_each_sensor_its_own_chip() -> None:
    one, other = (Sensor.of(BASE.set({"emitter.width_mm": width})) for width in (0.2, 0.1))
    both = respond([one, other], (-2.0, 0.0, 2.0), rays=512)
    assert both.right == pytest.approx(both.left[..., ::-1], abs=1e-12)
    assert both.contrast[..., 1] == pytest.approx(0.0, abs=1e-12)
    alone = respond([other], (-2.0, 0.0, 2.0), 0.1, rays=512)
    assert both.right[1] == pytest.approx(alone.right[0], abs=0.01)
    threads = respond([one, other], (-2.0, 0.0, 2.0), rays=512, threads=1)
    assert np.array_equal(both.right, threads.right)


def test_a_measured_lens_has_the_powers_of_its_scenes() -> None:
    designed = Sensor.of(BASE)
    measured = replace(designed, cut=lens(profile(5.0 * np.cos(X + 0.5))))
    numbers = numbers_of([measured])
    lot = batch.DesignBatch(np.array([1.0]), 1, 16, int(numbers.body[0, -1]), "power", False)
    lot.prepare(numbers, 0, batch.Bins(np.zeros(1), np.zeros(1)), 0)
    mine, its = tables_of(lot, 0), compile_scene(measured.scene(1.0))
    assert mine.shape == pytest.approx(its.shape, abs=1e-12)
    assert np.array_equal(mine.before, its.before)
    found = respond([measured], (1.0,), rays=2**12)
    exact = measured.integrate(1.0, tolerance=1e-3)
    for name, power in (("right", found.right), ("left", found.left)):
        u = math.hypot(found.u_power[0, 0, 0], exact.u_power)
        assert abs(power[0, 0, 0] - exact.detectors[name].power) < 4.0 * u


@pytest.mark.parametrize(
    "values",
    [
        {"motion.kind": "bend"},
        {"motion.join": "smooth"},
        {"wall": [{"face": "outer-right", "finish": "black"}]},
        IN_SPACE | {"lens.shape": "line-focus"},
    ],
)
def test_what_the_batch_does_not_know_is_refused_by_name(values: dict[str, object]) -> None:
    sensor = Sensor.of(BASE.set(values))
    assert why_not_batched(sensor)
    with pytest.raises(DesignError, match="paper"):
        respond([sensor], (0.0,), rays=64)


def test_what_cannot_be_is_refused() -> None:
    sensor = Sensor.of(BASE)
    found = respond([sensor, Sensor.of(BASE.set({"body.arm_width_mm": 9.0}))], (1.0, 80.0), rays=64)
    assert "motion" in found.why[0]
    assert "body.arm_width_mm" in found.why[1]
    assert np.isnan(found.right).all()
    with pytest.raises(DesignError, match="extruded"):
        respond([sensor, Sensor.of(BASE.set(IN_SPACE))], (0.0,), rays=64)
    with pytest.raises(DesignError, match="widths_mm"):
        respond([sensor], (0.0,), (0.0, 0.1), rays=64)
    with pytest.raises(DesignError, match="offsets_mm"):
        respond([sensor], (0.0,), ((0.1,), (0.2,)), rays=64)
