"""Wavelengths, histograms, powers by source, optical paths, seeds and locations agree with closed forms."""

import dataclasses
import math

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import Arc, Bezier, CartesianOval, Conic, Curve, Parabola, Segment, Spline
from solen.errors import DesignError
from solen.material.dispersion import Cauchy
from solen.plane import along, cross
from solen.scene import Beam, Chip, Fan, Interface, Rays, Region, Scene
from solen.scene.sources import Line, Source
from solen.trace import Limits, Mode, Trace, trace, trace_reference
from solen.trace.kernel.surface import uniform
from tests.agreement.bits_support import bits
from tests.agreement.random_scene_support import motley_scene, one_body
from tests.agreement.scenes_support import AIR, FINE, body, glass, slab

# ---------------------------------------------------------------------------------------------------------- dispersion

CAUCHY = Cauchy(A=1.45, B_um2=0.006)
SPECTRUM: tuple[Line, ...] = ((486.0, 1.0), (589.0, 2.0), (656.0, 5.0))


def index_at(nm: float) -> float:
    """Return n = A + B/λ² with λ in µm."""
    return 1.45 + 0.006 / (1e-3 * nm) ** 2


def prism(rays: int) -> tuple[Scene, float]:
    """Return a 60 degree prism with identical rays at three wavelengths, and their angle of incidence in rad."""
    half = math.radians(30.0)
    apex, left, right = (0.0, 10.0), (-10 * math.tan(half), 0.0), (10 * math.tan(half), 0.0)
    incidence = math.radians(48.0)
    direction = (math.cos(incidence - half), math.sin(incidence - half))
    middle = (0.5 * (apex[0] + left[0]), 0.5 * (apex[1] + left[1]))
    source = Rays((along(middle, direction, -3.0),) * rays, (direction,) * rays, spectrum=SPECTRUM)
    faces = [Segment(left, right), Segment(right, apex), Segment(apex, left)]
    return Scene((AIR, Region("glass", CAUCHY)), body([*faces]), (source,)), incidence


def deviations(result: Trace, scene: Scene) -> list[float]:
    """Return the deviation of each ray by the prism in rad."""
    (source,) = scene.sources
    assert isinstance(source, Rays)
    exits = [path.exit_direction for path in result.paths()]
    return [math.asin(abs(cross(source.directions[0], exit_d))) for exit_d in exits if exit_d is not None]


@pytest.mark.parametrize("tracer", ["engine", "reference", "sobol"])
def test_prism_separates_wavelengths(tracer: str) -> None:
    scene, incidence = prism(2048)
    result = {
        "engine": lambda: trace(scene, segments=True),
        "reference": lambda: trace_reference(scene, segments=True),
        "sobol": lambda: trace(scene, segments=True, sampling="sobol"),
    }[tracer]()
    deviation = np.array(deviations(result, scene))
    assert len(deviation) == 2048
    has_wavelength = []
    for nm, weight in SPECTRUM:
        n = index_at(nm)
        exit_angle = math.asin(n * math.sin(math.radians(60.0) - math.asin(math.sin(incidence) / n)))
        rays = np.abs(deviation - (incidence + exit_angle - math.radians(60.0))) < 1e-12
        assert rays.mean() == pytest.approx(weight / 8.0, abs=5 / 2048)
        has_wavelength.append(rays)
    assert np.sum(has_wavelength, axis=0).tolist() == [1] * 2048


def test_reflection_depends_on_the_index_at_each_wavelength() -> None:
    """A slab transmits 2 n/(n² + 1) of each spectral line."""
    source = Beam((-1.0, -3.0), (1.0, -3.0), 0.0, 4000, spectrum=SPECTRUM)
    scene = slab(source, 1.5, 2.0)
    scene = dataclasses.replace(scene, regions=(AIR, Region("glass", CAUCHY)))
    expected = sum(w * 2 * index_at(nm) / (index_at(nm) ** 2 + 1) for nm, w in SPECTRUM) / 8.0
    assert trace(scene, "power", FINE).monitors["behind"].power == pytest.approx(expected, abs=1e-5)
    for nm, _ in SPECTRUM:
        single = dataclasses.replace(source, spectrum=((nm, 3.0),))
        result, n = trace(dataclasses.replace(scene, sources=(single,)), "power", FINE), index_at(nm)
        assert result.monitors["behind"].power == pytest.approx(2 * n / (n * n + 1), abs=1e-12)


def test_sources_with_different_wavelengths() -> None:
    source = Beam((-1.0, -3.0), (1.0, -3.0), 0.0, 10)
    blue, red = (dataclasses.replace(source, spectrum=((nm, 1.0),), power=p) for nm, p in ((450.0, 1.0), (700.0, 3.0)))
    eye = Interface("eye", Segment((9.0, 5.0), (-9.0, 5.0)), "air", "air", "receiver", "eye")
    base = slab(red, 1.5, 2.0)
    scene = dataclasses.replace(
        base, regions=(AIR, Region("glass", CAUCHY)), sources=(red, blue), interfaces=(*base.interfaces, eye)
    )
    result = trace(scene, "power", FINE)
    expected = [p / 4.0 * 2 * n / (n * n + 1) for n, p in ((index_at(700.0), 3.0), (index_at(450.0), 1.0))]
    assert result.detectors["eye"].power_by_source == pytest.approx(expected, abs=1e-12)
    assert result.detectors["eye"].power == pytest.approx(sum(expected), abs=1e-12)


# ---------------------------------------------------------------------------------------------------------- histograms


def trace_receiver(curve: Curve, source: Source, mode: Mode = "count") -> Trace:
    """Trace a scene with one receiver and a source."""
    eye = Interface("eye", curve, "air", "air", "receiver", "eye")
    return trace(Scene((AIR,), (eye,), (source,)), mode, position_bins=40, angle_bins=36)


BEAM = Beam((-2.2, 9.0), (3.0, 9.0), 180.0, 80_000)
POSITIONS: dict[str, tuple[Curve, Source, float, float]] = {
    # curve, source that illuminates it uniformly in its parameter, and the range of the parameter
    "tilted segment": (Segment((-4.0, -3.0), (4.0, 3.0)), BEAM, 0.225, 0.875),
    "conic": (Conic((0.0, 0.0), (0.0, 1.0), 0.2, -0.5, -4.0, 4.0), BEAM, 0.225, 0.875),
    "parabola": (Parabola((0.0, 0.0), (-1.0, 0.0), 0.1, 4.0, -4.0), BEAM, 0.225, 0.875),
    "straight Bézier curve": (
        Bezier((-4.0, -3.0), (-4.0 / 3, -1.0), (4.0 / 3, 1.0), (4.0, 3.0)),
        BEAM,
        0.225,
        0.875,
    ),
    "straight spline": (
        Spline.through([(-4.0, -3.0), (-2.0, -1.5), (0.0, 0.0), (2.0, 1.5), (4.0, 3.0)]),
        BEAM,
        0.225,
        0.875,
    ),
    "arc": (Arc((1.0, -2.0), 3.0, -40.0, 200.0), Fan((1.0, -2.0), -30.0, 90.0, 80_000), 0.275, 0.725),
    "circle": (Arc((1.0, -2.0), 3.0, 10.0, 360.0), Fan((1.0, -2.0), 20.0, 90.0, 80_000), 55 / 360, 145 / 360),
    "oval": (
        CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.5, 2.0, 20.0, -25.0, 25.0),
        Fan((0.0, -2.0), 5.0, 30.0, 80_000),
        0.3,
        0.9,
    ),
}


def uniform_bins(low: float, high: float, bins: int) -> FloatArray:
    """Return the fractions of a uniform distribution from ``low`` to ``high`` in equal bins of [0, 1]."""
    return np.diff(np.clip(np.linspace(0.0, 1.0, bins + 1), low, high)) / (high - low)


@pytest.mark.parametrize("kind", POSITIONS)
def test_position_histogram_of_uniform_light(kind: str) -> None:
    curve, source, low, high = POSITIONS[kind]
    reading = trace_receiver(curve, source).detectors["eye"]
    assert reading.power == pytest.approx(1.0, abs=1e-12)
    assert reading.power_by_position.shape == (1, 40)
    np.testing.assert_allclose(reading.power_by_position[0], uniform_bins(low, high, 40), atol=3 / 80_000)
    assert reading.power_by_position.sum() == pytest.approx(reading.power, abs=1e-12)
    assert reading.power_by_angle.sum() == pytest.approx(reading.power, abs=1e-12)


@pytest.mark.parametrize("kind", POSITIONS)
def test_reversed_receiver_has_reversed_bins(kind: str) -> None:
    """It detects light from the other side only."""
    curve, source, low, high = POSITIONS[kind]
    assert trace_receiver(curve.reversed(), source).ledger.absorbed == pytest.approx(1.0, abs=1e-12)
    if isinstance(source, Beam):
        below = dataclasses.replace(source, start=(-2.2, -9.0), end=(3.0, -9.0), direction_deg=0.0)
        reading = trace_receiver(curve.reversed(), below).detectors["eye"]
        expected = uniform_bins(1.0 - high, 1.0 - low, 40)
        np.testing.assert_allclose(reading.power_by_position[0], expected, atol=3 / 80_000)


def test_position_histogram_of_a_receiver_with_several_faces() -> None:
    """The middle face is a spline of two cubics of equal or unequal length, each of which has half of the bins."""
    even = Spline(((3.0, 2.0), (2.0, 2.0), (1.0, 2.0), (0.0, 2.0), (-1.0, 2.0), (-2.0, 2.0), (-3.0, 2.0)))
    uneven = Spline(((3.0, 2.0), (2.8, 2.0), (2.6, 2.0), (2.4, 2.0), (0.6, 2.0), (-1.2, 2.0), (-3.0, 2.0)))
    for top, fraction in ((even, 0.5), (uneven, 0.1)):
        curves = (Segment((3.0, -9.0), (3.0, 2.0)), top, Segment((-3.0, 2.0), (-3.0, -9.0)))
        faces = tuple(Interface(f"e{i}", curve, "air", "air", "receiver", "eye") for i, curve in enumerate(curves))
        other = Interface("other", Segment((-3.0, -9.5), (3.0, -9.5)), "air", "air", "receiver", "other")
        scene = Scene((AIR,), (faces[0], other, *faces[1:]), (Beam((-3.0, 0.0), (3.0, 0.0), 0.0, 60_000),))
        reading = trace(scene, position_bins=10).detectors["eye"]
        assert reading.power_by_position.shape == (3, 10)
        np.testing.assert_allclose(reading.power_by_position[[0, 2]], 0.0, atol=1e-15)
        expected = [fraction / 5] * 5 + [(1 - fraction) / 5] * 5
        np.testing.assert_allclose(reading.power_by_position[1], expected, atol=3 / 60_000)


def test_angle_histogram_on_a_circle() -> None:
    """For a fan at distance a from the centre, sin i = (a/R) sin φ: P(|i| < x) = (2/π) arcsin(min(1, (R/a) sin x))."""
    a, radius, rays = 1.5, 4.0, 200_000
    reading = trace_receiver(Arc.circle((0.0, 0.0), radius), Fan((a, 0.0), 0.0, 360.0, rays)).detectors["eye"]
    edges = np.radians(np.linspace(-90.0, 90.0, 37))
    cumulative = np.arcsin(np.clip(radius / a * np.sin(edges), -1.0, 1.0)) / math.pi + 0.5
    assert reading.power == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(reading.power_by_angle, np.diff(cumulative), atol=4 / rays)


def test_angle_is_positive_for_light_towards_the_end_of_the_receiver() -> None:
    floor = Segment((-50.0, 0.0), (50.0, 0.0))
    for axis_deg, incidence_deg in ((-160.0, 20.0), (160.0, -20.0)):  # down and to the right, down and to the left
        reading = trace_receiver(floor, Fan((0.0, 5.0), axis_deg, 20.0, 3600)).detectors["eye"]
        middle_deg = 5.0 * (np.arange(36) - 17.5)
        np.testing.assert_allclose(
            reading.power_by_angle, np.where(np.abs(middle_deg - incidence_deg) < 10.0, 0.25, 0.0), atol=1e-3
        )


def test_angle_histogram_of_a_fan_on_a_wide_plane_is_uniform() -> None:
    for curve in (Segment((-1e6, 0.0), (1e6, 0.0)), Conic((0.0, 0.0), (0.0, 1.0), 1e-13, 0.0, -1e6, 1e6)):
        reading = trace_receiver(curve, Fan((0.0, 5.0), 180.0, 120.0, 48_000)).detectors["eye"]
        expected = np.where(np.abs(np.arange(36) - 17.5) < 12.0, 1 / 24, 0.0)
        np.testing.assert_allclose(reading.power_by_angle, expected, atol=3 / 48_000)


# ------------------------------------------------------------------------------------------- sources and optical paths


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize("sampling", ["fan", "sobol"])
def test_powers_by_source(mode: Mode, sampling: str) -> None:
    scene = motley_scene(16, 64)
    limits = Limits(min_weight=1e-3, max_hits=40)
    combined = trace(scene, mode, limits, sampling=sampling)  # type: ignore[arg-type]
    for reading in combined.detectors.values():
        assert len(reading.power_by_source) == len(scene.sources)
        assert sum(reading.power_by_source) == pytest.approx(reading.power, abs=1e-13)
    if mode == "roulette" or sampling == "sobol":
        return  # random numbers depend on the numbers of the ray and of the source
    for i, source in enumerate(scene.sources):
        single = trace(dataclasses.replace(scene, sources=(source,)), mode, limits)
        for name, reading in single.detectors.items():
            weight = source.power / scene.emitted
            assert combined.detectors[name].power_by_source[i] == pytest.approx(weight * reading.power, abs=1e-12)


def test_optical_path_through_a_slab() -> None:
    """The mean over two sources is weighted by power."""
    angle = math.radians(30.0)
    inside = math.asin(math.sin(angle) / 1.5)
    expected = 5.0 / math.cos(angle) + 1.5 * 2.0 / math.cos(inside)
    eye = Interface("eye", Segment((90.0, 6.0), (-90.0, 6.0)), "air", "air", "receiver", "eye")
    oblique = Rays(((0.0, -1.0),), ((math.sin(angle), math.cos(angle)),))
    straight = Rays(((0.0, -1.0),), ((0.0, 1.0),), power=3.0)
    base = slab(oblique, 1.5, 2.0)
    faces = (*base.interfaces, eye)
    for tracer in (trace, trace_reference):
        single = tracer(Scene(base.regions, faces, (oblique,)), "count")
        assert single.detectors["eye"].optical_path_mm == pytest.approx(expected, abs=1e-12)
        both = tracer(Scene(base.regions, faces, (oblique, straight)), "count")
        assert both.detectors["eye"].optical_path_mm == pytest.approx(0.25 * expected + 0.75 * 8.0, abs=1e-12)
    dark = trace(Scene((AIR,), (eye,), (Fan((0.0, 0.0), 180.0, 10.0, 3),)))
    assert math.isnan(dark.detectors["eye"].optical_path_mm)


def test_optical_path_to_the_focus_of_an_oval() -> None:
    """n1 |P − F1| + n2 |P − F2| is the same for all rays."""
    oval = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.5, 1.0, 20.0, 30.0, -30.0)
    dot = Interface("dot", Arc.circle((0.0, 20.0), 1e-3), "glass", "glass", "receiver", "dot")
    outward = dataclasses.replace(dot, curve=dot.curve.reversed())
    lens = Scene(
        (AIR, glass(1.5)),
        (Interface("front", oval, "glass", "air"), outward),
        (Fan((0.0, -1.0), 0.0, 40.0, 51),),
        open_media=True,
    )
    result = trace(lens, segments=True)
    assert result.segments is not None
    ends = result.segments[result.segments["fate"] == 1]
    assert len(ends) == 51
    paths = ends["optical_path_mm"] + 1.5 * ends["length_mm"]
    np.testing.assert_allclose(paths, oval.constant_mm - 1.5 * 1e-3, atol=1e-11)
    assert result.detectors["dot"].optical_path_mm == pytest.approx(oval.constant_mm - 1.5e-3, abs=1e-11)


def test_optical_path_to_the_focus_of_an_elliptic_mirror() -> None:
    """|P − F1| + |P − F2| is the same for all rays."""
    # an ellipse with half axes 5 and 3: vertex radius b²/a at the end of the major axis, K = −e²
    half = Conic((0.0, 0.0), (0.0, 1.0), 5.0 / 9.0, -16.0 / 25.0, -2.9, 2.9)
    spot = Interface("spot", Arc.circle((0.0, 9.0), 1e-3).reversed(), "air", "air", "receiver", "spot")
    mirror = Interface("mirror", half, "air", "air", "mirror")
    result = trace(Scene((AIR,), (mirror, spot), (Fan((0.0, 1.0), 180.0, 100.0, 101),)), segments=True)
    assert result.detectors["spot"].power == pytest.approx(1.0, abs=1e-12)
    assert result.detectors["spot"].optical_path_mm == pytest.approx(10.0 - 1e-3, abs=1e-11)


# ---------------------------------------------------------------------------------------------------- seeds, locations


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize(("mode", "sampling"), [("roulette", "fan"), ("roulette", "sobol"), ("power", "sobol")])
def test_result_depends_on_seed_but_not_on_threads(mode: Mode, sampling: str, precision: str) -> None:
    scene = motley_scene(17, 4_500)

    def run(seed: int, threads: int | None) -> Trace:
        limits = Limits(min_weight=3e-2, max_hits=20)
        options = {"sampling": sampling, "precision": precision, "position_bins": 9, "angle_bins": 7}
        return trace(scene, mode, limits, seed=seed, threads=threads, **options)  # type: ignore[arg-type]

    first, other = run(3, 1), run(4, 2)
    assert bits(first) == bits(run(3, 2)) == bits(run(3, 5)) != bits(other)
    for name, reading in first.detectors.items():
        tolerance = 5.0 * math.hypot(reading.u_power, other.detectors[name].u_power) + 1e-12
        assert other.detectors[name].power == pytest.approx(reading.power, abs=tolerance)


def test_seeds_do_not_only_permute_random_numbers() -> None:
    """The rays are identical, so if the same numbers were only assigned to other rays, the sum would not change."""
    eye = Interface("eye", Segment((9.0, 3.0), (-9.0, 3.0)), "air", "air", "receiver", "eye")
    surface = Interface("surface", Segment((-9.0, 0.0), (9.0, 0.0)), "air", "glass")
    source = Beam((-1.0, -3.0), (1.0, -3.0), 0.0, 4096)
    scene = Scene((AIR, glass(2.5)), (surface, eye), (source,), open_media=True)
    transmittance = 1.0 - (1.5 / 3.5) ** 2
    readings = [trace(scene, "roulette", seed=seed).detectors["eye"] for seed in range(40)]
    powers = [reading.power for reading in readings]
    assert len(set(powers)) > 20
    sigma = math.sqrt(transmittance * (1.0 - transmittance) / 4096)
    assert np.std(powers, ddof=1) == pytest.approx(sigma, rel=0.3)
    assert np.mean(powers) == pytest.approx(transmittance, abs=4 * sigma / math.sqrt(40))
    assert np.mean([reading.u_power for reading in readings]) == pytest.approx(sigma, rel=0.15)


def test_largest_seed() -> None:
    scene = one_body(3, 32)
    for sampling in ("fan", "sobol"):
        result = trace(scene, "roulette", seed=2**63 - 1, sampling=sampling)
        assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(DesignError, match="seed"):
        trace(scene, "roulette", seed=2**63)


def test_random_numbers_are_uniform_and_uncorrelated() -> None:
    """Check mean, variance, and the products for adjacent rays, hits and seeds, within four standard errors."""
    table = np.array([[[uniform(seed, ray, hit) for hit in range(12)] for ray in range(40)] for seed in range(40)])
    assert table.min() >= 0.0
    assert table.max() < 1.0
    n = table.size
    assert table.mean() == pytest.approx(0.5, abs=4 * math.sqrt(1 / 12 / n))
    assert table.var() == pytest.approx(1 / 12, abs=4 * math.sqrt(1 / 180 / n))
    centred = table - 0.5
    for axis in range(3):
        products = np.delete(centred, 0, axis) * np.delete(centred, -1, axis)
        assert products.mean() == pytest.approx(0.0, abs=4 / 12 / math.sqrt(products.size))
    assert len(np.unique(table)) == n


def two_mirrors() -> Scene:
    """Return a ray that is reflected up and down between two mirrors."""
    mirrors = tuple(
        Interface(f"m{i}", Segment((-3.0, z), (3.0, z)), "air", "air", "mirror") for i, z in enumerate((-1.0, 2.0))
    )
    return Scene((AIR,), mirrors, (Rays(((0.5, 0.0),), ((0.0, 1.0),)),))


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize("max_hits", [1, 2, 7])
def test_location_of_rays_truncated_after_max_hits(mode: Mode, max_hits: int) -> None:
    for tracer in (trace, trace_reference):
        result = tracer(two_mirrors(), mode, Limits(max_hits=max_hits))
        assert result.truncated == 1
        ((x, z),) = result.truncated_at_mm
        assert (x, z) == pytest.approx((0.5, 2.0 if max_hits % 2 else -1.0), abs=1e-12)
        assert (result.undefined, result.undefined_at_mm) == (0, ())


@pytest.mark.parametrize("threads", [1, 2])
def test_locations_of_branches_below_the_minimum_weight(threads: int) -> None:
    scene = slab(Beam((-1.0, -3.0), (1.0, -3.0), 0.0, 20_000), 1.5, 2.0)
    result = trace(scene, "power", Limits(min_weight=0.05), threads=threads)
    assert result.truncated == 40_000  # reflected at the front and at the back
    assert len(result.truncated_at_mm) == 16
    assert {round(z, 9) for _, z in result.truncated_at_mm} <= {0.0, 2.0}
    front_x = [x for x, z in result.truncated_at_mm if z < 1.0]
    assert front_x == pytest.approx(-1.0 + (np.arange(0, 2 * len(front_x), 2) + 0.5) * 1e-4, abs=1e-9)


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
def test_locations_of_undefined_rays(mode: Mode) -> None:
    """The glass has an open side, so that rays that pass beside its front meet its back from air."""
    front = Interface("front", Segment((0.0, 0.0), (5.0, 0.0)), "glass", "air")
    back = Interface("back", Segment((-5.0, 1.0), (5.0, 1.0)), "air", "glass")
    first = Interface("first", Segment((-5.0, -1.0), (5.0, -1.0)), "air", "air")
    rays = Rays(tuple((-4.5 + i, -2.0) for i in range(9)), ((0.0, 1.0),) * 9)
    scene = Scene((AIR, glass(1.5)), (front, back, first), (rays,), open_media=True)
    for tracer in (trace, trace_reference):
        result = tracer(scene, mode)
        assert result.undefined == 5
        expected = [(-4.5 + i, 1.0) for i in range(5)]
        np.testing.assert_allclose(sorted(result.undefined_at_mm), expected, atol=1e-12)
        assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
        if mode == "count":
            assert result.ledger.truncated == pytest.approx(5 / 9, abs=1e-12)


def test_chip_without_width_is_a_fan() -> None:
    scene = one_body(4, 2)
    by_position = []
    for source in (Chip((0.01, 0.02), 0.0, 30.0, 200.0, 5000), Fan((0.01, 0.02), 30.0, 200.0, 5000)):
        result = trace(dataclasses.replace(scene, sources=(source,)), position_bins=8)
        by_position.append(result.detectors["ring"].power_by_position)
        assert by_position[-1].sum() == pytest.approx(result.ledger.detected, abs=1e-12)
    np.testing.assert_allclose(by_position[0], by_position[1], atol=1e-12)
