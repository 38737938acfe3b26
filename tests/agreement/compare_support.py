"""Comparison of two traces segment by segment, where rounding permits it.

Each segment has a key that does not depend on the order in which branches are followed: the key of its branch, followed
by its hit number; the key of a branch is that of its parent, followed by the hit at which it was split off. The
reference is traced three times: with the launch directions of the scene, and with all of them rotated by ±1e-13 rad. A
segment is compared only if all three references contain it, with the same interface and fate and, within 1e-9 mm, the
same end, and if this is true of all segments before it. All other segments are *excluded*, and counted. The engine must
have every compared segment, with the same interface and fate, and with its end within 1e-9 mm; if none is excluded, it
must have no other segments. The largest deviations of the powers, relative to the power of the segment, and of the
optical paths are returned.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.scene import Scene
from solen.scene.sources import Placed, Source
from solen.trace import Limits, Mode, Trace, trace, trace_reference
from solen.trace.result import MAX_LOCATIONS

ROTATION_RAD = 1e-13
TOLERANCE_MM = 1e-9
Key = tuple[int, ...]


@dataclass(frozen=True)
class RaySegment:
    """A segment: the interface at its end, its fate, its end point (its direction if it escapes) and its power."""

    interface: int
    fate: int
    end: tuple[float, float]
    power: tuple[float, float]
    optical_path_mm: float

    def agrees_with(self, other: "RaySegment") -> bool:
        """Whether interface and fate are the same, and the ends agree within the tolerance."""
        same = (self.interface, self.fate) == (other.interface, other.fate)
        return same and math.dist(self.end, other.end) <= TOLERANCE_MM


@dataclass(frozen=True)
class Comparison:
    """Number of segments of the reference, number of those excluded, and the largest deviations of the others."""

    segments: int
    excluded: int
    deviation_mm: float
    deviation_power: float
    deviation_optical_mm: float


@dataclass(frozen=True)
class RotatedSource(Source):
    """Another source, with every ray rotated about its starting point."""

    source: Source
    angle_rad: float
    rays: int

    @property
    def shape_dimensions(self) -> int:
        return self.source.shape_dimensions

    def place(self, u: FloatArray) -> Placed:
        x, z, dx, dz = self.source.place(u)
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return x, z, c * dx - s * dz, s * dx + c * dz


def with_rotated_rays(scene: Scene, angle_rad: float) -> Scene:
    """Return a scene with all launch directions rotated by a small angle."""
    sources = tuple(
        RotatedSource(s, angle_rad, s.rays, power=s.power, s_share=s.s_share, spectrum=s.spectrum)
        for s in scene.sources
    )
    return dataclasses.replace(scene, sources=sources)


def segments_by_key(trace: Trace) -> dict[Key, RaySegment]:
    """Return all segments keyed by ray, by the hits at which the branch and its parents were split off, and by hit."""
    assert trace.segments is not None
    segments: dict[Key, RaySegment] = {}
    branches: dict[tuple[int, int], Key] = {}
    for row in trace.segments:  # parents come before their children
        ray, branch, parent, hit = (int(row[name]) for name in ("ray", "branch", "parent", "hit"))
        if (ray, branch) not in branches:
            branches[ray, branch] = (ray,) if parent < 0 else (*branches[ray, parent], hit - 1)
        segments[(*branches[ray, branch], hit)] = _segment(row)
    return segments


def compare(reference: Trace, rotated: tuple[Trace, ...], engine: Trace) -> Comparison:
    """Compare the engine with the reference; a failing assertion names the segment."""
    expected, actual = segments_by_key(reference), segments_by_key(engine)
    others = [segments_by_key(other) for other in rotated]
    compared: set[Key] = set()
    deviation_mm = deviation_power = deviation_optical = 0.0
    for key, segment in expected.items():  # parents come before their children
        is_stable = all(key in other and segment.agrees_with(other[key]) for other in others)
        if not is_stable or not _continues(key, compared):
            continue
        compared.add(key)
        assert key in actual, f"the engine has no segment {key}: {segment}"
        assert segment.agrees_with(actual[key]), f"segment {key}: reference {segment}, engine {actual[key]}"
        deviation_mm = max(deviation_mm, math.dist(segment.end, actual[key].end))
        deviation_power = max(deviation_power, *_relative_deviation(segment.power, actual[key].power))
        deviation_optical = max(deviation_optical, abs(segment.optical_path_mm - actual[key].optical_path_mm))
    excluded = len(expected) - len(compared)
    assert excluded or len(actual) == len(expected), "the engine has segments that the reference does not have"
    return Comparison(len(expected), excluded, deviation_mm, deviation_power, deviation_optical)


def compare_tracers(scene: Scene, mode: Mode, limits: Limits, seed: int = 0) -> tuple[Trace, Trace, Comparison]:
    """Trace a scene with the reference and with the engine, and compare them."""
    reference, *rotated = (
        trace_reference(with_rotated_rays(scene, angle) if angle else scene, mode, limits, seed=seed, segments=True)
        for angle in (0.0, ROTATION_RAD, -ROTATION_RAD)
    )
    engine = trace(scene, mode, limits, seed=seed, segments=True)
    return reference, engine, compare(reference, tuple(rotated), engine)


def check_scene(scene: Scene, mode: Mode, limits: Limits, seed: int = 0) -> Comparison:
    """Check that the engine agrees with the reference on a scene: segments, powers, optical paths and readings."""
    reference, engine, comparison = compare_tracers(scene, mode, limits, seed)
    assert comparison.deviation_power < 1e-9, scene.name
    assert comparison.deviation_optical_mm < 1e-8, scene.name
    for result in (reference, engine):
        assert result.undefined == 0, f"{scene.name}: {result.undefined_at_mm}"
        assert result.ledger.total == pytest.approx(1.0, abs=1e-12), scene.name
    if comparison.excluded == 0:
        check_readings(reference, engine)
    return comparison


def check_readings(reference: Trace, engine: Trace) -> None:
    """Check that all sums of two tracers agree; called if no segment is excluded."""
    assert (engine.hits, engine.truncated) == (reference.hits, reference.truncated)
    for name, expected in reference.detectors.items():
        detected = engine.detectors[name]
        assert detected.rays == expected.rays
        assert detected.power == pytest.approx(expected.power, rel=1e-9, abs=1e-12)
        assert detected.power_by_source == pytest.approx(expected.power_by_source, rel=1e-9, abs=1e-12)
        assert detected.optical_path_mm == pytest.approx(expected.optical_path_mm, rel=1e-9, nan_ok=True)
    for name, crossed in reference.monitors.items():
        assert engine.monitors[name].rays == crossed.rays
        assert engine.monitors[name].power == pytest.approx(crossed.power, rel=1e-9, abs=1e-12)
        np.testing.assert_allclose(engine.monitors[name].power_by_bin, crossed.power_by_bin, rtol=1e-9, atol=1e-12)
    for actual, locations in (
        (engine.truncated_at_mm, reference.truncated_at_mm),
        (engine.undefined_at_mm, reference.undefined_at_mm),
    ):
        assert len(actual) == len(locations)
        if reference.truncated < MAX_LOCATIONS:  # of more, each tracer stores those that it encounters first
            np.testing.assert_allclose(sorted(actual), sorted(locations), atol=1e-9)


def summary(mode: Mode, comparisons: Sequence[Comparison]) -> tuple[float, str]:
    """Return the excluded fraction of all segments, and a line for the log."""
    total, excluded = sum(c.segments for c in comparisons), sum(c.excluded for c in comparisons)
    line = (
        f"{mode}: {len(comparisons)} scenes, {total} segments, {excluded} excluded ({excluded / total:.2%}), "
        f"none in {complete(comparisons)}; largest deviations {max(c.deviation_mm for c in comparisons):.1e} mm, "
        f"{max(c.deviation_power for c in comparisons):.1e} of the power, "
        f"{max(c.deviation_optical_mm for c in comparisons):.1e} mm of optical path"
    )
    return excluded / total, line


def complete(comparisons: Sequence[Comparison]) -> int:
    """Return the number of scenes of which no segment is excluded, so that their readings are compared."""
    return sum(c.excluded == 0 for c in comparisons)


def _segment(row: np.void) -> RaySegment:
    length = float(row["length_mm"])
    x, z, dx, dz = (float(row[name]) for name in ("x_mm", "z_mm", "dx", "dz"))
    end = (x + length * dx, z + length * dz) if math.isfinite(length) else (dx, dz)
    power = (float(row["power_s"]), float(row["power_p"]))
    return RaySegment(int(row["interface"]), int(row["fate"]), end, power, float(row["optical_path_mm"]))


def _continues(key: Key, compared: set[Key]) -> bool:
    """Return whether a segment is the first of its ray, or continues a compared segment of its branch or parent."""
    branch, hit = key[:-1], key[-1] - 1
    if hit < 0:
        return True
    return branch in compared if len(branch) > 1 and branch[-1] == hit else (*branch, hit) in compared


def _relative_deviation(a: tuple[float, float], b: tuple[float, float]) -> FloatArray:
    """Return the deviations of two powers as fractions of the power of the segment."""
    return np.abs(np.subtract(a, b)) / max(sum(a), 1e-300)
