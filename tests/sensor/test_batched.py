"""The batch makes the same tables as scenes: its rays meet the same curves, and its powers agree with integration."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import END_TOLERANCE_MM
from solen.errors import DesignError, SolenError
from solen.sensor import Responses, Sensor, batch_input, respond, why_not_batched
from solen.spec import Design
from solen.trace import batch
from solen.trace.kernel import loop, tally
from solen.trace.kernel.buffers import BLOCK, Rows, new_buffers
from solen.trace.sums import of_tasks
from solen.trace.tables import Tables, compile_scene
from tests.lens.measured_support import X, lens, profile

ANGLES = np.array([-2.5, 0.0, 1.25])
BASE = Design.model_validate({"name": "paper", "material": {"index": 1.44}, "emitter": {"width_mm": 0.2}})
MAX_HITS = 20
"""Number of hits after which rounding errors may be large, so that only powers are compared."""
EDGE_TOLERANCE = 1e-12
"""Distance from an edge, in mm or as a cosine, within which a ray may take different paths."""


def random_sensors(count: int, seed: int) -> list[Sensor]:
    """Sensors of random designs that can be built at `ANGLES`."""
    rng = np.random.default_rng(seed)
    sensors: list[Sensor] = []
    while len(sensors) < count:
        is_flat, has_gap = rng.random() < 0.2, rng.random() < 0.3
        values = {
            "material.index": rng.uniform(1.35, 1.6),
            "material.absorption_per_mm": rng.choice([0.0, 0.01]),
            "emitter.distance_mm": rng.uniform(0.5, 2.0),
            "lens.focus_mm": rng.uniform(8.0, 60.0),
            "lens.half_width_mm": rng.uniform(0.8, 2.6),
            "lens.shape": "none" if is_flat else "cartesian-oval",
            "body.stem_length_mm": rng.uniform(6.0, 30.0),
            "body.stem_curve_per_mm": rng.uniform(0.002, 0.01),
            "body.arm_length_mm": rng.uniform(8.0, 30.0),
            "body.arm_width_mm": rng.uniform(0.8, 4.0),
            "motion.pivot": rng.choice(["stem-base", "emitter"]) if rng.random() < 0.8 else (0.1, 3.0),
            "motion.moves": ("emitter",) if rng.random() < 0.2 else ("lens", "emitter"),
            "motion.join": rng.choice(["bridge", "seam"]),
        }
        if rng.random() < 0.3:
            values["body.arm_angle_deg"] = rng.uniform(4.0, 25.0)
        if not is_flat and rng.random() < 0.3:
            values["lens.design_index"] = rng.uniform(1.4, 1.6)
        if has_gap:
            values |= {"receivers.coupling": "air-gap", "receivers.gap_mm": rng.uniform(0.1, 1.0)}
        try:
            sensor = Sensor.of(
                BASE.set({key: v.item() if isinstance(v, np.generic) else v for key, v in values.items()})
            )
            for angle in ANGLES.tolist():
                sensor.scene(angle)
        except SolenError:
            continue
        sensors.append(sensor)
    return sensors


class TracedSegments:
    """The first segments of all rays through tables, ray by ray, and the powers at both receivers."""

    def __init__(self, tables: Tables, rays: Rows, workspace: batch.DesignBatch) -> None:
        sums = of_tasks(1, 2)
        self.sums = tally.Sums(
            sums.fate[0], sums.detected, sums.arrived, sums.optical, sums.position, sums.angle, sums.crossed,
            sums.crossings, sums.maps, sums.counts[0], sums.location[0],
            np.empty((512 * len(rays.x), tally.SEGMENT_WIDTH)),
        )  # fmt: skip
        space = new_buffers(len(rays.x), np.float64, 64 * BLOCK)
        assert loop.trace_rays(batch.DOUBLE, tables, self.sums, rays, workspace.rules, space, None)
        rows = self.sums.segments[: self.sums.counts[tally.SEGMENTS]]
        assert len(rows) == self.sums.counts[tally.SEGMENTS] <= len(self.sums.segments)
        rows = rows[rows[:, 3] < MAX_HITS]
        self.rows = rows[np.lexsort((rows[:, 3], rows[:, 1], rows[:, 0]))]
        self.power = self.sums.detected

    def without_joins(self, sensor: Sensor, angle: float, pieces: int) -> None:
        """Renumber the interfaces without joins, if a scene has joins that exist only by rounding."""
        faces = sensor.scene(angle).interfaces
        if len(faces) != pieces:
            kept = [face.name for face in faces if not face.name.startswith("join")]
            assert len(kept) == pieces
            assert angle == 0.0
            number = [kept.index(face.name) if face.name in kept else -2 for face in faces] + [-1]
            self.rows[:, 4] = np.array(number)[self.rows[:, 4].astype(int)]

    def of_ray(self, ray: int) -> FloatArray:
        rows: FloatArray = self.rows[self.rows[:, 0] == ray]
        return rows


def tables_of(workspace: batch.DesignBatch, a: int) -> Tables:
    """Tables that a workspace has made of a scene."""
    p, q = workspace.starts.piece[a : a + 2]
    parts: list[Any] = list(workspace.tables)
    parts[:12] = [column[p:q] for column in parts[:12]]
    parts[12:17] = [column[a : a + 1] for column in parts[12:17]]
    parts[22:26] = [column[2 * a : 2 * a + 2] for column in parts[22:26]]
    return Tables(*parts)


def distance_from_an_edge(sensor: Sensor, angle: float, first_ray: FloatArray, second_ray: FloatArray) -> float:
    """Distance from an edge at which two rays of one launch separate, less ten times the distance between them.

    An edge is an end of a curve, in mm, or the critical angle, as a cosine.
    """
    scene = sensor.scene(angle)
    ends = np.array([end for face in scene.interfaces for end in (face.curve.start, face.curve.end)])
    nearest, difference = math.inf, 0.0
    for first_segment, second_segment in zip(first_ray, second_ray, strict=False):
        difference = max(
            difference,
            float(
                np.abs(
                    np.nan_to_num(first_segment[6:11], posinf=0.0) - np.nan_to_num(second_segment[6:11], posinf=0.0)
                ).max()
            ),
        )
        for segment in (first_segment, second_segment):
            if segment[4] < 0:
                continue
            at, towards = (segment[6] + segment[10] * segment[8], segment[7] + segment[10] * segment[9]), segment[8:10]
            nearest = min(nearest, float(np.min(np.hypot(*(ends - at).T))) - END_TOLERANCE_MM)
            cos = float(np.dot(scene.interfaces[int(segment[4])].curve.normal_at(at), towards))
            index = sensor.material.index
            nearest = min(nearest, abs(abs(cos) - math.sqrt(1.0 - 1.0 / index**2)))
        if not np.array_equal(first_segment[1:6], second_segment[1:6]):
            break
    return nearest - 10.0 * difference


def compare(sensors: list[Sensor], bins: int, rays_per_bin: int) -> tuple[int, int, float]:
    """Number of rays, number of those with different paths or powers, and largest difference of powers on equal paths.

    Powers are different if they differ by more than 1e-12 of the emitted power.
    """
    numbers, edges = batch_input(sensors), np.linspace(-0.15, 0.15, bins + 1)
    workspace = batch.DesignBatch(ANGLES, bins, rays_per_bin, 0, "power", False)
    count, different, largest = 0, 0, 0.0
    for d, sensor in enumerate(sensors):
        result = workspace.trace(numbers, d, batch.Bins(edges[:-1], edges[1:]), d)
        for a, angle in enumerate(ANGLES.tolist()):
            begin, end = a * bins * rays_per_bin, (a + 1) * bins * rays_per_bin
            rays = Rows(*(column[begin:end] for column in workspace.rays))
            batch_segments, scene_segments = (
                TracedSegments(tables_of(workspace, a), rays, workspace),
                TracedSegments(compile_scene(sensor.scene(angle)), rays, workspace),
            )
            assert result.power[a].sum(axis=0) == pytest.approx(scene_segments.power, abs=1e-8)
            scene_segments.without_joins(sensor, angle, workspace.starts.piece[a + 1] - workspace.starts.piece[a])
            count += end - begin
            if batch_segments.rows.shape == scene_segments.rows.shape and np.array_equal(
                batch_segments.rows[:, :6], scene_segments.rows[:, :6]
            ):
                difference = np.abs(batch_segments.rows[:, 11:13] - scene_segments.rows[:, 11:13]).max(axis=1)
                different += len(np.unique(batch_segments.rows[difference > EDGE_TOLERANCE, 0]))
                largest = max(largest, float(difference.max()))
                continue
            for ray in range(end - begin):
                first_ray, second_ray = batch_segments.of_ray(ray), scene_segments.of_ray(ray)
                if not (len(first_ray) == len(second_ray) and np.array_equal(first_ray[:, 1:6], second_ray[:, 1:6])):
                    different += 1
                    assert distance_from_an_edge(sensor, angle, first_ray, second_ray) < EDGE_TOLERANCE, (d, angle, ray)
    return count, different, largest


def test_rays_of_a_batch_follow_those_of_scenes() -> None:
    count, different, largest = compare(random_sensors(6, 1), 4, 64)
    assert (count, different) == (6 * 3 * 256, 0)
    assert largest < 1e-12


@pytest.mark.evidence
def test_rays_of_500_random_designs_follow_those_of_scenes() -> None:
    count, different, largest = compare(random_sensors(500, 2), 4, 64)
    print(f"{count} rays, {different} with different paths or powers; powers on equal paths agree within {largest:.1e}")
    assert different <= 1e-5 * count
    assert largest < 1e-11


THREE_ANGLES = (-2.5, -0.75, 0.75)
CHIPS = ((0.2, 0.0), (0.15, 0.04), (0.25, -0.03))
IN_SPACE = {"trace.dimension": "extruded", "emitter.pattern": "lambertian", "emitter.height_mm": 0.2}


def errors_over_u(result: Responses, sensor: Sensor, angles: tuple[float, ...], tolerance: float) -> list[float]:
    """Errors of a batch's powers, relative to their uncertainties, from integration at some angles."""
    ratios = []
    for k, (width, offset) in enumerate(CHIPS):
        chip = sensor.set({"emitter.width_mm": width, "emitter.offset_mm": offset})
        for a, angle in enumerate(angles):
            exact = chip.integrate(angle, tolerance=tolerance)
            u = math.hypot(result.u_power[0, k, a], exact.u_power)
            ratios += [(result.right[0, k, a] - exact.detectors["right"].power) / u]
            ratios += [(result.left[0, k, a] - exact.detectors["left"].power) / u]
    return ratios


def respond_with_chips(sensor: Sensor, angles: tuple[float, ...], rays: int, seed: int = 0) -> Responses:
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
def test_powers_agree_with_integration_within_their_uncertainty(values: dict[str, object]) -> None:
    sensor = Sensor.of(BASE.set(values))
    result = respond_with_chips(sensor, THREE_ANGLES[1:], 2**12)
    assert result.u_power.max() < 6e-3
    assert max(map(abs, errors_over_u(result, sensor, THREE_ANGLES[1:], 1e-3))) < 4.0
    assert result.truncated.max() < 1e-4


@pytest.mark.evidence
@pytest.mark.parametrize("values", [{}, IN_SPACE], ids=["plane", "space"])
def test_two_uncertainties_cover_95_percent(values: dict[str, object]) -> None:
    rng, ratios = np.random.default_rng(3), []
    for draw in range(12):
        numbers = {"lens.focus_mm": rng.uniform(12, 30), "material.index": rng.uniform(1.4, 1.5)}
        sensor = Sensor.of(BASE.set(numbers | values))
        result = respond_with_chips(sensor, THREE_ANGLES, 2 ** int(rng.integers(11, 14)), draw)
        ratios += errors_over_u(result, sensor, THREE_ANGLES, 2e-4)
    within = float(np.mean(np.abs(ratios) < 2.0))
    print(f"{within:.3f} of {len(ratios)} powers within 2 u, {np.mean(np.abs(ratios) < 1.0):.3f} within 1")
    assert within > 0.93


def test_powers_in_space_agree_with_integration() -> None:
    sensor = Sensor.of(BASE.set(IN_SPACE))
    result = respond_with_chips(sensor, (0.75,), 2**13)
    assert result.u_power.max() < 3e-3
    assert max(map(abs, errors_over_u(result, sensor, (0.75,), 1e-3))) < 4.0


def test_many_chips_agree_with_single_chips() -> None:
    sensor = Sensor.of(BASE)
    offset, width = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.06, 0.06, 20), [0.16, 0.2, 0.24]))
    result = respond([sensor], THREE_ANGLES, width, offset, rays=2**14)
    for k in (7, 31):
        single = respond([sensor], THREE_ANGLES, width[k], offset[k], rays=2**14, seed=1)
        difference = np.abs(result.right[0, k] - single.right[0, 0]) / np.hypot(
            result.u_power[0, k], single.u_power[0, 0]
        )
        assert difference.max() < 4.0


def test_counts_of_points_agree_with_integration() -> None:
    sensor = Sensor.of(BASE.set({"emitter.width_mm": 0.0}))
    result = respond([sensor], THREE_ANGLES, rays=2**12, mode="count")
    for a, angle in enumerate(THREE_ANGLES):
        exact = sensor.integrate(angle, "count").detectors["right"].power
        assert result.right[0, 0, a] == pytest.approx(exact, abs=4.0 * result.u_power[0, 0, a])
    assert 0.0 < result.u_power.max() < 2e-3


def test_symmetric_sensors_have_mirrored_powers_of_their_own_chips() -> None:
    wide, narrow = (Sensor.of(BASE.set({"emitter.width_mm": width})) for width in (0.2, 0.1))
    both = respond([wide, narrow], (-2.0, 0.0, 2.0), rays=512)
    assert both.right == pytest.approx(both.left[..., ::-1], abs=1e-12)
    assert both.contrast[..., 1] == pytest.approx(0.0, abs=1e-12)
    single = respond([narrow], (-2.0, 0.0, 2.0), 0.1, rays=512)
    assert both.right[1] == pytest.approx(single.right[0], abs=0.01)
    threads = respond([wide, narrow], (-2.0, 0.0, 2.0), rays=512, threads=1)
    assert np.array_equal(both.right, threads.right)


def test_measured_lens_has_the_powers_of_its_scenes() -> None:
    designed = Sensor.of(BASE)
    measured = replace(designed, cut=lens(profile(5.0 * np.cos(X + 0.5))))
    numbers = batch_input([measured])
    workspace = batch.DesignBatch(np.array([1.0]), 1, 16, int(numbers.body[0, -1]), "power", False)
    workspace.prepare(numbers, 0, batch.Bins(np.zeros(1), np.zeros(1)), 0)
    batch_tables, scene_tables = tables_of(workspace, 0), compile_scene(measured.scene(1.0))
    assert batch_tables.shape == pytest.approx(scene_tables.shape, abs=1e-12)
    assert np.array_equal(batch_tables.previous, scene_tables.previous)
    result = respond([measured], (1.0,), rays=2**12)
    exact = measured.integrate(1.0, tolerance=1e-3)
    for name, power in (("right", result.right), ("left", result.left)):
        u = math.hypot(result.u_power[0, 0, 0], exact.u_power)
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
def test_refuses_unsupported_sensors(values: dict[str, object]) -> None:
    sensor = Sensor.of(BASE.set(values))
    assert why_not_batched(sensor)
    with pytest.raises(DesignError, match="paper"):
        respond([sensor], (0.0,), rays=64)


def test_refuses_invalid_bodies_and_chips() -> None:
    sensor = Sensor.of(BASE)
    result = respond([sensor, Sensor.of(BASE.set({"body.arm_width_mm": 9.0}))], (1.0, 80.0), rays=64)
    assert "motion" in result.why[0]
    assert "body.arm_width_mm" in result.why[1]
    assert np.isnan(result.right).all()
    with pytest.raises(DesignError, match="extruded"):
        respond([sensor, Sensor.of(BASE.set(IN_SPACE))], (0.0,), rays=64)
    with pytest.raises(DesignError, match="widths_mm"):
        respond([sensor], (0.0,), (0.0, 0.1), rays=64)
    with pytest.raises(DesignError, match="offsets_mm"):
        respond([sensor], (0.0,), ((0.1,), (0.2,)), rays=64)
