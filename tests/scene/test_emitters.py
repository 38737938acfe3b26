"""Emitters: the angles and positions of rays follow the specified distributions, in the plane and in space."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from solen.errors import DesignError
from solen.plane import heading
from solen.scene import Chip, CosinePower, Emitter, Fan, Isotropic, PatternTable
from solen.scene.sources import Pattern

SIDE_LIGHT = PatternTable((0.0, 20.0, 60.0, 90.0, 130.0, 180.0), (1.0, 0.9, 0.5, 0.35, 0.1, 0.0))
RING = PatternTable((0.0, 30.0, 50.0, 90.0), (0.0, 1.0, 0.2, 0.0))
PATTERNS: dict[str, Pattern] = {
    "uniform": Isotropic(),
    "lambertian": CosinePower(),
    "narrow": CosinePower(7.3),
    "broad": CosinePower(0.25),
    "side light": SIDE_LIGHT,
    "ring": RING,
}
CASES = [(pattern, half) for pattern in PATTERNS.values() for half in (0.4, 1.2, math.pi / 2, math.pi)]
every_case = pytest.mark.parametrize(("pattern", "half"), CASES)
U = (np.arange(4001) + 0.5) / 4001


def integral(function: Callable[[float], float], low: float, high: float) -> float:
    """Integral, divided at 90° and at the corners of the tables in this file."""
    corners = [math.radians(a) for a in (20, 30, 50, 60, 90, 130)]
    cuts = [low, *(c for c in corners if low < c < high), high]
    return sum(float(integrate.quad(function, a, b, epsabs=1e-13)[0]) for a, b in pairwise(cuts))


def value(pattern: Pattern, angle: float) -> float:
    return float(pattern.intensity(np.array([abs(angle)]))[0])


@every_case
def test_angle_in_plane_inverts_cumulative_intensity(pattern: Pattern, half: float) -> None:
    """At ten fractions, the integral of the intensity up to the angle is that fraction of the total."""
    fractions = np.array([0.0, 0.03, 0.1, 0.33, 0.48, 0.5, 0.6, 0.77, 0.95, 1.0])
    angles = pattern.in_plane(fractions, half)
    total = 2.0 * integral(lambda t: value(pattern, t), 0.0, half)
    assert pattern.plane_angle(half) == pytest.approx(total, rel=1e-9)
    for fraction, angle in zip(fractions, angles, strict=True):
        partial = math.copysign(integral(lambda t: value(pattern, t), 0.0, abs(angle)), angle)
        assert 0.5 + partial / total == pytest.approx(fraction, abs=1e-9)


@every_case
def test_angle_in_space_inverts_cumulative_power(pattern: Pattern, half: float) -> None:
    fractions = np.array([0.0, 1e-6, 0.03, 0.33, 0.5, 0.77, 0.95, 1.0])
    angles = pattern.in_space(fractions, half)
    total = integral(lambda t: value(pattern, t) * math.sin(t), 0.0, half)
    for fraction, angle in zip(fractions, angles, strict=True):
        partial = integral(lambda t: value(pattern, t) * math.sin(t), 0.0, float(angle))
        assert partial / total == pytest.approx(fraction, abs=1e-9)
    if value(pattern, 0.0) > 0.0:
        assert pattern.solid_angle_sr(half) == pytest.approx(2.0 * math.pi * total / value(pattern, 0.0), rel=1e-9)
    else:
        assert pattern.solid_angle_sr(half) == math.inf


@every_case
def test_intervals_reproduce_pattern(pattern: Pattern, half: float) -> None:
    """Intervals are in order and do not overlap; their intensity is that of the pattern, as is their integral."""
    intervals = pattern.intervals(half)
    total = 0.0
    for interval in intervals:
        for fraction in (0.1, 0.5, 0.9):
            angle = interval.low + fraction * (interval.high - interval.low)
            intensity = (interval.base + interval.slope * angle) * math.cos(angle) ** interval.power
            assert intensity == pytest.approx(value(pattern, angle), rel=1e-12, abs=1e-14)
            assert intensity <= interval.max_intensity * (1.0 + 1e-12)
        total += integrate.quad(
            lambda t, interval=interval: (interval.base + interval.slope * t) * max(math.cos(t), 0.0) ** interval.power,
            interval.low,
            interval.high,
        )[0]
    assert total == pytest.approx(pattern.plane_angle(half), rel=1e-8)
    assert all(a.high <= b.low + 1e-15 for a, b in pairwise(intervals))


def test_moments_of_lambertian_emitter() -> None:
    """⟨cos θ⟩ is 2/3 in space and π/4 in the plane; half of the power is within 45°, half of the intensity at 60°."""
    emitter = Emitter((0.0, 0.0), 0.0, 20_001, CosinePower())
    deep, flat = emitter.launch(in_space=True), emitter.launch()
    assert np.mean(deep.dz) == pytest.approx(2.0 / 3.0, abs=1e-6)
    assert np.mean(deep.dz > math.sqrt(0.5)) == pytest.approx(0.5, abs=1e-4)
    assert value(emitter.pattern, math.radians(60.0)) == pytest.approx(0.5, abs=1e-15)
    assert np.mean(flat.dz) == pytest.approx(math.pi / 4.0, abs=1e-5)
    assert CosinePower().solid_angle_sr(math.pi / 2) == pytest.approx(math.pi, rel=1e-15)
    assert Isotropic().solid_angle_sr(math.pi) == pytest.approx(4.0 * math.pi, rel=1e-15)


@pytest.mark.parametrize("pattern", PATTERNS.values(), ids=PATTERNS)
def test_directions_in_space_are_unit_and_uniform_in_azimuth(pattern: Pattern) -> None:
    emitter = Emitter((1.0, 2.0), 20.0, 8192, pattern, 300.0, 0.3, 0.5, 0.25)
    middles, generator = (np.arange(8192) + 0.5) / 8192, np.random.default_rng(3)
    launch = emitter.launch_at(np.column_stack([generator.permutation(middles) for _ in range(4)]), 8192, in_space=True)
    assert launch.y_mm is not None
    assert launch.dy is not None
    assert launch.dx**2 + launch.dy**2 + launch.dz**2 == pytest.approx(1.0, abs=1e-14)
    (ax, az), (lx, lz) = heading(20.0), heading(110.0)
    cosine = launch.dx * ax + launch.dz * az
    azimuth = np.arctan2(launch.dy, launch.dx * lx + launch.dz * lz)
    assert stats.kstest(azimuth / (2.0 * math.pi) + 0.5, "uniform").statistic < 8.0 / 8192
    theta = np.arccos(np.clip(cosine, -1.0, 1.0))
    assert np.sort(theta) == pytest.approx(pattern.in_space(middles, emitter.half_rad), abs=1e-7)
    across, along = (launch.x_mm - 1.0) * lx + (launch.z_mm - 2.0) * lz, (launch.x_mm - 1.0) * ax
    assert np.ptp(across) == pytest.approx(0.3, abs=1e-3)
    assert along + (launch.z_mm - 2.0) * az == pytest.approx(0.0, abs=1e-15)
    assert np.mean(launch.y_mm) == pytest.approx(0.25, abs=1e-3)
    assert np.ptp(launch.y_mm) == pytest.approx(0.5, abs=1e-3)


def test_dimensions_depend_on_size() -> None:
    point = Emitter((0.0, 0.0), 0.0, 5)
    assert (point.dimensions(), point.dimensions(in_space=True)) == (1, 2)
    chip = Emitter((0.0, 0.0), 0.0, 5, width_mm=0.2, height_mm=0.1)
    assert (chip.dimensions(), chip.dimensions(in_space=True)) == (2, 4)
    bar = Emitter((0.0, 0.0), 0.0, 5, height_mm=0.1).with_spectrum(((850.0, 1.0), (860.0, 1.0)))
    assert (bar.dimensions(), bar.dimensions(in_space=True)) == (2, 4)


@given(axis=st.floats(-360, 360), cone=st.floats(0.1, 360))
def test_uniform_emitters_equal_fans_and_chips(axis: float, cone: float) -> None:
    for width in (0.0, 0.3):
        emitter = Emitter((0.3, -0.7), axis, 57, cone_deg=cone, width_mm=width).launch()
        other = (Chip((0.3, -0.7), width, axis, cone, 57) if width else Fan((0.3, -0.7), axis, cone, 57)).launch()
        for name in ("x_mm", "z_mm", "dx", "dz"):
            assert getattr(emitter, name) == pytest.approx(getattr(other, name), abs=1e-12)


def test_emission_has_same_points_and_axes_as_rays() -> None:
    """The point sources used for integration have the same positions and axes as the rays."""
    for source in (
        Fan((0.3, -0.7), 11.0, 77.0, 9),
        Chip((0.3, -0.7), 0.4, 11.0, 77.0, 9),
        Emitter((0.3, -0.7), 11.0, 9, SIDE_LIGHT, 250.0, 0.4),
    ):
        emission = source.emission()
        assert emission is not None
        u = np.array([[0.5, 0.0], [0.5, 0.3], [0.5, 1.0]])
        launch = source.launch_at(u, 3)
        for i, position in enumerate(u[:, 1]):
            x, z, axis_deg = emission.at(position)
            assert (x, z) == pytest.approx((launch.x_mm[i], launch.z_mm[i]), abs=1e-15)
            assert heading(axis_deg) == pytest.approx((launch.dx[i], launch.dz[i]), abs=1e-12)
        assert emission.panels == (0 if isinstance(source, Fan) else 1)


INVALID: list[tuple[Callable[[], object], str]] = [
    (lambda: CosinePower(-1.0), "exponent"),
    (lambda: PatternTable((0.0, 10.0), (1.0,)), "as many intensities as angles"),
    (lambda: PatternTable((1.0, 10.0), (1.0, 1.0)), "ascending order from 0"),
    (lambda: PatternTable((0.0, 50.0, 50.0), (1.0, 1.0, 1.0)), "ascending order"),
    (lambda: PatternTable((0.0, 190.0), (1.0, 1.0)), "180"),
    (lambda: PatternTable((0.0, 90.0), (0.0, 0.0)), "above 0 at some angle"),
    (lambda: PatternTable((0.0, 90.0), (1.0, -0.1)), "at least 0"),
    (lambda: Emitter((0.0, 0.0), 0.0, 5, width_mm=-0.1).check(), "width_mm"),
    (lambda: Emitter((0.0, 0.0), 0.0, 5, height_mm=math.inf).check(), "height_mm"),
    (lambda: Emitter((0.0, 0.0), 0.0, 5, cone_deg=361.0).check(), "cone_deg"),
    (
        lambda: Emitter((0.0, 0.0), 0.0, 5, PatternTable((0.0, 30.0, 60.0), (0.0, 0.0, 1.0)), cone_deg=40.0).check(),
        "must include angles at which the pattern emits",
    ),
]


@pytest.mark.parametrize(("make", "message"), INVALID)
def test_refuses_invalid_emitter(make: Callable[[], object], message: str) -> None:
    with pytest.raises(DesignError, match=message) as refusal:
        make()
    assert len(str(refusal.value).splitlines()) == 1
