"""Colours, histograms, shares by source, optical paths, seeds and places, each against what follows by hand."""

import dataclasses
import math

import numpy as np
import pytest

from solen.curve import Arc, Bezier, CartesianOval, Conic, Curve, Parabola, Segment, Spline
from solen.errors import DesignError
from solen.material.dispersion import Cauchy
from solen.plane import along, cross
from solen.scene import Beam, Chip, Fan, Interface, Rays, Region, Scene
from solen.scene.sources import Line, Source
from solen.trace import Limits, Mode, Trace, trace, trace_reference
from solen.trace.kernel.surface import chance
from tests.agreement.random_scene_support import motley_scene, one_body
from tests.agreement.scenes_support import AIR, FINE, body, glass, slab

# ---------------------------------------------------------------------------------------------------------- dispersion

CAUCHY = Cauchy(A=1.45, B_um2=0.006)
SPECTRUM: tuple[Line, ...] = ((486.0, 1.0), (589.0, 2.0), (656.0, 5.0))


def index_at(nm: float) -> float:
    """n = A + B/λ² with λ in µm."""
    return 1.45 + 0.006 / (1e-3 * nm) ** 2


def prism(rays: int) -> tuple[Scene, float]:
    """A 60 degree prism under identical rays of three colours, and their angle of incidence in rad."""
    half = math.radians(30.0)
    apex, left, right = (0.0, 10.0), (-10 * math.tan(half), 0.0), (10 * math.tan(half), 0.0)
    incidence = math.radians(48.0)
    direction = (math.cos(incidence - half), math.sin(incidence - half))
    middle = (0.5 * (apex[0] + left[0]), 0.5 * (apex[1] + left[1]))
    source = Rays((along(middle, direction, -3.0),) * rays, (direction,) * rays, spectrum=SPECTRUM)
    faces = [Segment(left, right), Segment(right, apex), Segment(apex, left)]
    return Scene((AIR, Region("glass", CAUCHY)), body([*faces]), (source,)), incidence


def deviations(result: Trace, scene: Scene) -> list[float]:
    """Angle by which each ray leaves the prism off its first direction, rad."""
    (source,) = scene.sources
    assert isinstance(source, Rays)
    exits = [path.exit_direction for path in result.paths()]
    return [math.asin(abs(cross(source.directions[0], out))) for out in exits if out is not None]


@pytest.mark.parametrize("tracer", ["engine", "reference", "sobol"])
def test_a_prism_parts_three_colours_as_snell_says_and_in_their_shares(tracer: str) -> None:
    scene, incidence = prism(2048)
    result = {
        "engine": lambda: trace(scene, legs=True),
        "reference": lambda: trace_reference(scene, legs=True),
        "sobol": lambda: trace(scene, legs=True, sampling="sobol"),
    }[tracer]()
    found = np.array(deviations(result, scene))
    assert len(found) == 2048
    apart = []
    for nm, weight in SPECTRUM:
        n = index_at(nm)
        out = math.asin(n * math.sin(math.radians(60.0) - math.asin(math.sin(incidence) / n)))
        mine = np.abs(found - (incidence + out - math.radians(60.0))) < 1e-12
        assert mine.mean() == pytest.approx(weight / 8.0, abs=5 / 2048)
        apart.append(mine)
    assert np.sum(apart, axis=0).tolist() == [1] * 2048


def test_colours_reflect_and_absorb_by_their_own_index() -> None:
    """A slab passes 2 n/(n² + 1) of each line of the spectrum."""
    source = Beam((-1.0, -3.0), (1.0, -3.0), 0.0, 4000, spectrum=SPECTRUM)
    scene = slab(source, 1.5, 2.0)
    scene = dataclasses.replace(scene, regions=(AIR, Region("glass", CAUCHY)))
    asked = sum(w * 2 * index_at(nm) / (index_at(nm) ** 2 + 1) for nm, w in SPECTRUM) / 8.0
    assert trace(scene, "power", FINE).monitors["behind"].power == pytest.approx(asked, abs=1e-5)
    alone = [
        trace(dataclasses.replace(scene, sources=(dataclasses.replace(source, spectrum=((nm, 3.0),)),)), "power", FINE)
        for nm, _ in SPECTRUM
    ]
    for (nm, _), result in zip(SPECTRUM, alone, strict=True):
        n = index_at(nm)
        assert result.monitors["behind"].power == pytest.approx(2 * n / (n * n + 1), abs=1e-12)


def test_sources_of_one_scene_may_have_different_colours() -> None:
    source = Beam((-1.0, -3.0), (1.0, -3.0), 0.0, 10)
    blue, red = (dataclasses.replace(source, spectrum=((nm, 1.0),), power=p) for nm, p in ((450.0, 1.0), (700.0, 3.0)))
    eye = Interface("eye", Segment((9.0, 5.0), (-9.0, 5.0)), "air", "air", "receiver", "eye")
    made = slab(red, 1.5, 2.0)
    scene = dataclasses.replace(
        made, regions=(AIR, Region("glass", CAUCHY)), sources=(red, blue), interfaces=(*made.interfaces, eye)
    )
    result = trace(scene, "power", FINE)
    asked = [p / 4.0 * 2 * n / (n * n + 1) for n, p in ((index_at(700.0), 3.0), (index_at(450.0), 1.0))]
    assert result.detectors["eye"].power_by_source == pytest.approx(asked, abs=1e-12)
    assert result.detectors["eye"].power == pytest.approx(sum(asked), abs=1e-12)


# ---------------------------------------------------------------------------------------------------------- histograms


def lit(curve: Curve, source: Source, mode: Mode = "count") -> Trace:
    """A receiver of one curve under a source."""
    eye = Interface("eye", curve, "air", "air", "receiver", "eye")
    return trace(Scene((AIR,), (eye,), (source,)), mode, position_bins=40, angle_bins=36)


BEAM = Beam((-2.2, 9.0), (3.0, 9.0), 180.0, 80_000)
POSITIONS: dict[str, tuple[Curve, Source, float, float]] = {
    # curve, source that lights it evenly in its parameter, parameters between which it does
    "a tilted segment": (Segment((-4.0, -3.0), (4.0, 3.0)), BEAM, 0.225, 0.875),
    "a conic": (Conic((0.0, 0.0), (0.0, 1.0), 0.2, -0.5, -4.0, 4.0), BEAM, 0.225, 0.875),
    "a parabola": (Parabola((0.0, 0.0), (-1.0, 0.0), 0.1, 4.0, -4.0), BEAM, 0.225, 0.875),
    "a straight Bézier curve": (
        Bezier((-4.0, -3.0), (-4.0 / 3, -1.0), (4.0 / 3, 1.0), (4.0, 3.0)),
        BEAM,
        0.225,
        0.875,
    ),
    "a straight spline": (
        Spline.through([(-4.0, -3.0), (-2.0, -1.5), (0.0, 0.0), (2.0, 1.5), (4.0, 3.0)]),
        BEAM,
        0.225,
        0.875,
    ),
    "an arc": (Arc((1.0, -2.0), 3.0, -40.0, 200.0), Fan((1.0, -2.0), -30.0, 90.0, 80_000), 0.275, 0.725),
    "a whole circle": (Arc((1.0, -2.0), 3.0, 10.0, 360.0), Fan((1.0, -2.0), 20.0, 90.0, 80_000), 55 / 360, 145 / 360),
    "an oval": (
        CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.5, 2.0, 20.0, -25.0, 25.0),
        Fan((0.0, -2.0), 5.0, 30.0, 80_000),
        0.3,
        0.9,
    ),
}


def share_of_bins(low: float, high: float, bins: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """What equal bins of [0, 1] hold of something even between two places."""
    edges = np.linspace(0.0, 1.0, bins + 1)
    inside = np.clip(edges, low, high)
    return np.diff(inside) / (high - low)


@pytest.mark.parametrize("kind", POSITIONS)
def test_even_light_fills_the_bins_between_its_edges(kind: str) -> None:
    curve, source, low, high = POSITIONS[kind]
    reading = lit(curve, source).detectors["eye"]
    assert reading.power == pytest.approx(1.0, abs=1e-12)
    assert reading.power_by_position.shape == (1, 40)
    np.testing.assert_allclose(reading.power_by_position[0], share_of_bins(low, high, 40), atol=3 / 80_000)
    assert reading.power_by_position.sum() == pytest.approx(reading.power, abs=1e-12)
    assert reading.power_by_angle.sum() == pytest.approx(reading.power, abs=1e-12)


@pytest.mark.parametrize("kind", POSITIONS)
def test_a_receiver_walked_the_other_way_has_its_bins_the_other_way_round(kind: str) -> None:
    """And its face on the other side, so that it detects nothing until the light comes from there."""
    curve, source, low, high = POSITIONS[kind]
    assert lit(curve.reversed(), source).ledger.absorbed == pytest.approx(1.0, abs=1e-12)
    if isinstance(source, Beam):
        below = dataclasses.replace(source, start=(-2.2, -9.0), end=(3.0, -9.0), direction_deg=0.0)
        reading = lit(curve.reversed(), below).detectors["eye"]
        np.testing.assert_allclose(
            reading.power_by_position[0], share_of_bins(1.0 - high, 1.0 - low, 40), atol=3 / 80_000
        )


def test_each_interface_of_a_receiver_has_its_own_bins_and_cubics_their_own_share() -> None:
    """Three faces of a box under a fan, one of them a spline of two unequal cubics, each an equal share."""
    bent = Spline(((3.0, 2.0), (2.0, 2.0), (1.0, 2.0), (0.0, 2.0), (-1.0, 2.0), (-2.0, 2.0), (-3.0, 2.0)))
    uneven = Spline(((3.0, 2.0), (2.8, 2.0), (2.6, 2.0), (2.4, 2.0), (0.6, 2.0), (-1.2, 2.0), (-3.0, 2.0)))
    for top, first in ((bent, 0.5), (uneven, 0.1)):
        faces = (Segment((3.0, -9.0), (3.0, 2.0)), top, Segment((-3.0, 2.0), (-3.0, -9.0)))
        eyes = tuple(Interface(f"e{i}", face, "air", "air", "receiver", "eye") for i, face in enumerate(faces))
        other = Interface("other", Segment((-3.0, -9.5), (3.0, -9.5)), "air", "air", "receiver", "other")
        scene = Scene((AIR,), (eyes[0], other, *eyes[1:]), (Beam((-3.0, 0.0), (3.0, 0.0), 0.0, 60_000),))
        reading = trace(scene, position_bins=10).detectors["eye"]
        assert reading.power_by_position.shape == (3, 10)
        np.testing.assert_allclose(reading.power_by_position[[0, 2]], 0.0, atol=1e-15)
        np.testing.assert_allclose(
            reading.power_by_position[1], [first / 5] * 5 + [(1 - first) / 5] * 5, atol=3 / 60_000
        )


def test_angles_on_a_circle_are_those_of_an_eccentric_source() -> None:
    """sin i = (a/R) sin φ for a fan at a from the centre: P(|i| < x) = (2/π) arcsin(min(1, (R/a) sin x))."""
    a, radius, rays = 1.5, 4.0, 200_000
    reading = lit(Arc.circle((0.0, 0.0), radius), Fan((a, 0.0), 0.0, 360.0, rays)).detectors["eye"]
    edges = np.radians(np.linspace(-90.0, 90.0, 37))
    below = np.arcsin(np.clip(radius / a * np.sin(edges), -1.0, 1.0)) / math.pi + 0.5
    assert reading.power == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(reading.power_by_angle, np.diff(below), atol=4 / rays)


def test_angles_are_positive_where_light_runs_towards_the_end() -> None:
    floor = Segment((-50.0, 0.0), (50.0, 0.0))
    for turn, incidence_deg in ((-160.0, 20.0), (160.0, -20.0)):  # down and to the right, down and to the left
        reading = lit(floor, Fan((0.0, 5.0), turn, 20.0, 3600)).detectors["eye"]
        middle_deg = 5.0 * (np.arange(36) - 17.5)
        np.testing.assert_allclose(
            reading.power_by_angle, np.where(np.abs(middle_deg - incidence_deg) < 10.0, 0.25, 0.0), atol=1e-3
        )


def test_angles_of_a_fan_on_a_wide_plane_are_even() -> None:
    for curve in (Segment((-1e6, 0.0), (1e6, 0.0)), Conic((0.0, 0.0), (0.0, 1.0), 1e-13, 0.0, -1e6, 1e6)):
        reading = lit(curve, Fan((0.0, 5.0), 180.0, 120.0, 48_000)).detectors["eye"]
        asked = np.where(np.abs(np.arange(36) - 17.5) < 12.0, 1 / 24, 0.0)
        np.testing.assert_allclose(reading.power_by_angle, asked, atol=3 / 48_000)


# ------------------------------------------------------------------------------------------- sources and optical paths


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize("sampling", ["fan", "sobol"])
def test_shares_by_source_add_up_and_are_those_of_each_alone(mode: Mode, sampling: str) -> None:
    scene = motley_scene(16, 64)
    limits = Limits(min_weight=1e-3, max_hits=40)
    whole = trace(scene, mode, limits, sampling=sampling)  # type: ignore[arg-type]
    for reading in whole.detectors.values():
        assert len(reading.power_by_source) == len(scene.sources)
        assert sum(reading.power_by_source) == pytest.approx(reading.power, abs=1e-13)
    if (mode, sampling) == ("roulette", "fan") or sampling == "sobol":
        return  # another number of a ray or of a source is another draw
    for i, source in enumerate(scene.sources):
        alone = trace(dataclasses.replace(scene, sources=(source,)), mode, limits)
        for name, reading in alone.detectors.items():
            share = source.power / scene.emitted
            assert whole.detectors[name].power_by_source[i] == pytest.approx(share * reading.power, abs=1e-12)


def test_the_optical_path_is_the_sum_of_index_times_length() -> None:
    """Through a slab, at an angle; the mean of two sources is weighted by what arrives."""
    angle = math.radians(30.0)
    inside = math.asin(math.sin(angle) / 1.5)
    asked = 5.0 / math.cos(angle) + 1.5 * 2.0 / math.cos(inside)
    eye = Interface("eye", Segment((90.0, 6.0), (-90.0, 6.0)), "air", "air", "receiver", "eye")
    slanted = Rays(((0.0, -1.0),), ((math.sin(angle), math.cos(angle)),))
    straight = Rays(((0.0, -1.0),), ((0.0, 1.0),), power=3.0)
    made = slab(slanted, 1.5, 2.0)
    faces = made.interfaces
    for tracer in (trace, trace_reference):
        one = tracer(Scene(made.regions, (*faces, eye), (slanted,)), "count")
        assert one.detectors["eye"].optical_path_mm == pytest.approx(asked, abs=1e-12)
        both = tracer(Scene(made.regions, (*faces, eye), (slanted, straight)), "count")
        assert both.detectors["eye"].optical_path_mm == pytest.approx(0.25 * asked + 0.75 * 8.0, abs=1e-12)
    nothing = trace(Scene((AIR,), (eye,), (Fan((0.0, 0.0), 180.0, 10.0, 3),)))
    assert math.isnan(nothing.detectors["eye"].optical_path_mm)


def test_an_oval_keeps_the_optical_path_to_its_focus_and_a_mirror_ellipse_too() -> None:
    """n1 |P − F1| + n2 |P − F2| is the same for all rays; in an ellipse |P − F1| + |P − F2| is."""
    oval = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.5, 1.0, 20.0, 30.0, -30.0)
    dot = Interface("dot", Arc.circle((0.0, 20.0), 1e-3), "glass", "glass", "receiver", "dot")
    outward = dataclasses.replace(dot, curve=dot.curve.reversed())
    lens = Scene(
        (AIR, glass(1.5)),
        (Interface("front", oval, "glass", "air"), outward),
        (Fan((0.0, -1.0), 0.0, 40.0, 51),),
        open_media=True,
    )
    result = trace(lens, legs=True)
    assert result.legs is not None
    ends = result.legs[result.legs["fate"] == 1]
    assert len(ends) == 51
    paths = ends["optical_path_mm"] + 1.5 * ends["length_mm"]
    np.testing.assert_allclose(paths, oval.constant_mm - 1.5 * 1e-3, atol=1e-11)
    assert result.detectors["dot"].optical_path_mm == pytest.approx(oval.constant_mm - 1.5e-3, abs=1e-11)
    # an ellipse of half axes 5 and 3: vertex radius b²/a at the end of the long axis, K = −e²
    half = Conic((0.0, 0.0), (0.0, 1.0), 5.0 / 9.0, -16.0 / 25.0, -2.9, 2.9)
    spot = Interface("spot", Arc.circle((0.0, 9.0), 1e-3).reversed(), "air", "air", "receiver", "spot")
    mirror = Interface("mirror", half, "air", "air", "mirror")
    found = trace(Scene((AIR,), (mirror, spot), (Fan((0.0, 1.0), 180.0, 100.0, 101),)), legs=True)
    assert found.detectors["spot"].power == pytest.approx(1.0, abs=1e-12)
    assert found.detectors["spot"].optical_path_mm == pytest.approx(10.0 - 1e-3, abs=1e-11)


# ------------------------------------------------------------------------------------------------------- seeds, places


def same(a: Trace, b: Trace) -> bool:
    """Whether two results are equal to the last bit."""
    equal = (a.ledger, a.hits, a.undefined_at_mm, a.truncated_at_mm) == (
        b.ledger,
        b.hits,
        b.undefined_at_mm,
        b.truncated_at_mm,
    )
    for name, reading in a.detectors.items():
        other = b.detectors[name]
        equal &= (reading.power, reading.u_power, reading.rays, reading.power_by_source) == (
            other.power,
            other.u_power,
            other.rays,
            other.power_by_source,
        )
        equal &= np.array_equal(reading.power_by_position, other.power_by_position) and np.array_equal(
            reading.power_by_angle, other.power_by_angle
        )
        equal &= np.array_equal([reading.optical_path_mm], [other.optical_path_mm], equal_nan=True)
    for name, crossed in a.monitors.items():
        equal &= (crossed.power, crossed.u_power) == (b.monitors[name].power, b.monitors[name].u_power)
        equal &= np.array_equal(crossed.power_by_bin, b.monitors[name].power_by_bin)
    return bool(equal)


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize(("mode", "sampling"), [("roulette", "fan"), ("roulette", "sobol"), ("power", "sobol")])
def test_a_seed_gives_the_same_bits_on_any_threads_and_another_seed_others(
    mode: Mode, sampling: str, precision: str
) -> None:
    scene = motley_scene(17, 6_000)

    def run(seed: int, threads: int | None) -> Trace:
        limits = Limits(min_weight=3e-2, max_hits=20)
        more = {"sampling": sampling, "precision": precision, "position_bins": 9, "angle_bins": 7}
        return trace(scene, mode, limits, seed=seed, threads=threads, **more)  # type: ignore[arg-type]

    one = run(3, 1)
    assert same(one, run(3, 2))
    assert same(one, run(3, 5))
    other = run(4, 2)
    assert not same(one, other)
    for name, reading in one.detectors.items():
        off = 5.0 * math.hypot(reading.u_power, other.detectors[name].u_power)
        assert other.detectors[name].power == pytest.approx(reading.power, abs=off + 1e-12)


def test_another_seed_deals_other_numbers_and_not_the_same_ones_to_other_rays() -> None:
    """Identical rays on one surface: were the numbers only dealt in another order, the sum could not change."""
    eye = Interface("eye", Segment((9.0, 3.0), (-9.0, 3.0)), "air", "air", "receiver", "eye")
    surface = Interface("surface", Segment((-9.0, 0.0), (9.0, 0.0)), "air", "glass")
    source = Beam((-1.0, -3.0), (1.0, -3.0), 0.0, 4096)
    scene = Scene((AIR, glass(2.5)), (surface, eye), (source,), open_media=True)
    through = 1.0 - (1.5 / 3.5) ** 2
    found = [trace(scene, "roulette", seed=seed).detectors["eye"] for seed in range(40)]
    powers = [reading.power for reading in found]
    assert len(set(powers)) > 20
    spread = math.sqrt(through * (1.0 - through) / 4096)
    assert np.std(powers, ddof=1) == pytest.approx(spread, rel=0.3)
    assert np.mean(powers) == pytest.approx(through, abs=4 * spread / math.sqrt(40))
    assert np.mean([reading.u_power for reading in found]) == pytest.approx(spread, rel=0.15)


def test_a_seed_may_be_as_large_as_a_whole_number_of_the_machine() -> None:
    scene = one_body(3, 32)
    for sampling in ("fan", "sobol"):
        result = trace(scene, "roulette", seed=2**63 - 1, sampling=sampling)
        assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(DesignError, match="seed"):
        trace(scene, "roulette", seed=2**63)


def test_the_roulettes_numbers_are_even_and_unrelated() -> None:
    """Mean, variance, and products of neighbouring rays, hits and seeds, within four standard errors."""
    table = np.array([[[chance(seed, ray, hit) for hit in range(12)] for ray in range(40)] for seed in range(40)])
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


def in_a_box(max_hits: int) -> Scene:
    """A ray that goes up and down between two mirrors."""
    mirrors = tuple(
        Interface(f"m{i}", Segment((-3.0, z), (3.0, z)), "air", "air", "mirror") for i, z in enumerate((-1.0, 2.0))
    )
    return Scene((AIR,), mirrors, (Rays(((0.5, 0.0),), ((0.0, 1.0),)),), name=f"{max_hits}")


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize("max_hits", [1, 2, 7])
def test_what_is_cut_after_so_many_hits_is_located_there(mode: Mode, max_hits: int) -> None:
    for tracer in (trace, trace_reference):
        result = tracer(in_a_box(max_hits), mode, Limits(max_hits=max_hits))
        assert result.truncated == 1
        ((x, z),) = result.truncated_at_mm
        assert (x, z) == pytest.approx((0.5, 2.0 if max_hits % 2 else -1.0), abs=1e-12)
        assert (result.undefined, result.undefined_at_mm) == (0, ())


@pytest.mark.parametrize("threads", [1, 2])
def test_branches_below_the_least_weight_are_located_where_they_were_cut(threads: int) -> None:
    scene = slab(Beam((-1.0, -3.0), (1.0, -3.0), 0.0, 20_000), 1.5, 2.0)
    result = trace(scene, "power", Limits(min_weight=0.05), threads=threads)
    assert result.truncated == 40_000  # what comes back from the front, and from the back
    assert len(result.truncated_at_mm) == 16
    assert {round(z, 9) for _, z in result.truncated_at_mm} <= {0.0, 2.0}
    assert [x for x, z in result.truncated_at_mm if z < 1.0] == pytest.approx(
        -1.0 + (np.arange(0, 2 * sum(z < 1.0 for _, z in result.truncated_at_mm), 2) + 0.5) * 1e-4, abs=1e-9
    )


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
def test_rays_in_the_wrong_medium_are_located_where_they_met_it(mode: Mode) -> None:
    """Glass that ends in nothing: what goes round its end meets its back from air."""
    front = Interface("front", Segment((0.0, 0.0), (5.0, 0.0)), "glass", "air")
    back = Interface("back", Segment((-5.0, 1.0), (5.0, 1.0)), "air", "glass")
    first = Interface("first", Segment((-5.0, -1.0), (5.0, -1.0)), "air", "air")
    rays = Rays(tuple((-4.5 + i, -2.0) for i in range(9)), ((0.0, 1.0),) * 9)
    scene = Scene((AIR, glass(1.5)), (front, back, first), (rays,), open_media=True)
    for tracer in (trace, trace_reference):
        result = tracer(scene, mode)
        assert result.undefined == 5
        asked = [(-4.5 + i, 1.0) for i in range(5)]
        np.testing.assert_allclose(sorted(result.undefined_at_mm), asked, atol=1e-12)
        assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
        if mode == "count":
            assert result.ledger.truncated == pytest.approx(5 / 9, abs=1e-12)


def test_a_chip_without_width_is_a_fan_and_power_by_place_is_even() -> None:
    scene = one_body(4, 2)
    for source in (Chip((0.01, 0.02), 0.0, 30.0, 200.0, 5000), Fan((0.01, 0.02), 30.0, 200.0, 5000)):
        result = trace(dataclasses.replace(scene, sources=(source,)), position_bins=8)
        assert result.detectors["ring"].power_by_position.sum() == pytest.approx(result.ledger.detected, abs=1e-12)
    chip, fan = (
        trace(dataclasses.replace(scene, sources=(source,)), position_bins=8).detectors["ring"].power_by_position
        for source in (Chip((0.01, 0.02), 0.0, 30.0, 200.0, 5000), Fan((0.01, 0.02), 30.0, 200.0, 5000))
    )
    np.testing.assert_allclose(chip, fan, atol=1e-12)
