"""One physics described in two ways: a curve as another one, light as fans or samples, splitting or chance."""

import dataclasses
import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from solen.curve import Arc, Bezier, CartesianOval, Conic, Curve, Parabola, Segment, Spline
from solen.plane import along, cross, minus, right_of
from solen.scene import Chip, Fan, Interface, Rays, Scene
from solen.trace import Limits, Mode, Path, Trace, trace
from tests.agreement.compare_support import TURN_RAD, compared, turned
from tests.agreement.random_scene_support import motley_scene, one_body, random_scene
from tests.agreement.scenes_support import AIR, body, box, glass

FEW = Limits(min_weight=1e-3, max_hits=6)
Change = Callable[[Curve], Curve]


def as_conic(curve: Curve) -> Curve:
    """An arc as the conic with K = 0, a parabola as the one with K = −1."""
    if isinstance(curve, Arc) and curve.half_deg < 88.0:
        inwards = (-curve.middle[0], -curve.middle[1])
        half = math.copysign(curve.radius_mm * math.sin(math.radians(curve.half_deg)), curve.sweep_deg)
        return Conic(curve.middle_point, inwards, 1.0 / curve.radius_mm, 0.0, -half, half)
    if isinstance(curve, Parabola):
        return Conic(curve.vertex, right_of(curve.axis), 2.0 * curve.curve_per_mm, -1.0, -curve.from_mm, -curve.to_mm)
    return curve


def as_bezier(first: float, second: float) -> Change:
    """A straight line as a Bézier curve with its handles at these shares."""

    def change(curve: Curve) -> Curve:
        if not isinstance(curve, Segment):
            return curve
        a, b = curve.a, curve.b
        one, other = ((a[0] + u * (b[0] - a[0]), a[1] + u * (b[1] - a[1])) for u in (first, second))
        return Bezier(a, one, other, b)

    return change


def as_spline(curve: Curve) -> Curve:
    """A straight line as a spline through some of its points."""
    return Spline.through(curve.points(np.array([0.0, 0.1, 0.45, 0.8, 1.0]))) if isinstance(curve, Segment) else curve


def changed(scene: Scene, change: Change) -> Scene:
    faces = tuple(dataclasses.replace(face, curve=change(face.curve)) for face in scene.interfaces)
    assert faces != scene.interfaces
    return dataclasses.replace(scene, interfaces=faces)


def smooth(scene: Scene) -> Scene:
    """Without the rays that are aimed at corners: one description's corner is another's to rounding only."""
    return dataclasses.replace(scene, sources=(*scene.sources[:3], *scene.sources[4:]))


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize(
    ("change", "seed"),
    [(as_conic, 1), (as_conic, 3), (as_bezier(1 / 3, 2 / 3), 5), (as_bezier(0.15, 0.45), 6), (as_spline, 7)],
)
def test_a_curve_may_be_described_as_another_one(change: Change, seed: int, mode: Mode) -> None:
    for scene in (smooth(random_scene(seed, 20)), smooth(motley_scene(seed, 20))):
        truth, more, less = (
            trace(turned(scene, angle) if angle else scene, mode, FEW, legs=True)
            for angle in (0.0, TURN_RAD, -TURN_RAD)
        )
        comparison = compared(truth, (more, less), trace(changed(scene, change), mode, FEW, legs=True))
        assert comparison.left_out < 0.1 * comparison.stretches
        assert comparison.deviation_power < 1e-9


def only(curve: Curve, rays: Rays) -> list[Path]:
    """Ways through one face of glass, first from below."""
    face = Interface("face", curve, "glass", "air")
    return trace(Scene((AIR, glass(1.5)), (face,), (rays,), open_media=True), legs=True).paths()


def upwards(half_mm: float, z_mm: float, rays: int = 101) -> Rays:
    places = tuple((float(x), z_mm) for x in np.linspace(-half_mm, half_mm, rays))
    return Rays(places, ((0.1, 1.0),) * rays)


def deviation(one: list[Path], other: list[Path]) -> tuple[float, float]:
    """Largest distance of the places of the first hits, and largest angle between the ways on, in rad."""
    places = max(math.dist(a.points_mm[1], b.points_mm[1]) for a, b in zip(one, other, strict=True))
    ways = [(a.exit_direction, b.exit_direction) for a, b in zip(one, other, strict=True)]
    return places, max(abs(math.asin(cross(a, b))) for a, b in ways if a is not None and b is not None)


PAIRS = {
    "an arc and a conic with K = 0": (
        Arc((0.0, 6.0), 6.0, -135.0, 90.0),
        Conic((0.0, 0.0), (0.0, 1.0), 1 / 6, 0.0, -6 * math.sin(math.pi / 4), 6 * math.sin(math.pi / 4)),
    ),
    "a parabola and a conic with K = -1": (
        Parabola((0.0, 0.0), (-1.0, 0.0), 0.08, 4.0, -4.0),
        Conic((0.0, 0.0), (0.0, 1.0), 0.16, -1.0, -4.0, 4.0),
    ),
    "a hollow parabola and a conic with K = -1": (
        Parabola((0.0, 0.0), (-1.0, 0.0), -0.08, 4.0, -4.0),
        Conic((0.0, 0.0), (0.0, 1.0), -0.16, -1.0, -4.0, 4.0),
    ),
    "a segment and a straight Bézier curve": (
        Segment((-4.0, -1.0), (4.0, 1.5)),
        Bezier((-4.0, -1.0), (-4.0 + 8 * 0.2, -1.0 + 2.5 * 0.2), (-4.0 + 8 * 0.55, -1.0 + 2.5 * 0.55), (4.0, 1.5)),
    ),
    "a parabola and a Bézier curve": (  # handles of a quadratic curve raised to a cubic one
        Parabola((0.0, 0.0), (-1.0, 0.0), 0.08, 4.0, -4.0),
        Bezier((-4.0, 1.28), (-4.0 / 3, 1.28 / 3 - 2 * 1.28 / 3), (4.0 / 3, 1.28 / 3 - 2 * 1.28 / 3), (4.0, 1.28)),
    ),
}


@pytest.mark.parametrize("pair", PAIRS)
def test_two_formulas_of_one_curve_agree_to_1e_12(pair: str) -> None:
    one, other = (only(curve, upwards(3.0, -4.0)) for curve in PAIRS[pair])
    places, ways = deviation(one, other)
    assert places < 1e-12
    assert ways < 1e-12


def orders(errors: list[float]) -> list[float]:
    """Powers by which errors fall when the distance of the points is halved."""
    return [math.log2(a / b) for a, b in pairwise(errors)]


@pytest.mark.parametrize("constant", [-2.5, -1.0, -0.6, 0.0, 1.5])
def test_a_spline_converges_to_the_conic_that_it_runs_through(constant: float) -> None:
    """Places by the fourth power of the distance of its points, directions by the third; away from its free ends."""
    conic = Conic((0.0, 0.0), (0.0, 1.0), 0.15, constant, -4.0, 4.0)
    rays = upwards(1.5, -3.0)
    truth = only(conic, rays)
    found = [
        deviation(truth, only(Spline.through(conic.points(np.linspace(0, 1, n))), rays)) for n in (17, 33, 65, 129)
    ]
    places, ways = zip(*found, strict=True)
    assert min(orders(list(places))) > 3.5
    assert min(orders(list(ways))) > 2.6
    assert places[-1] < 1e-8
    assert ways[-1] < 1e-6


def test_a_spline_through_points_of_an_oval_gathers_light_as_the_oval_does() -> None:
    oval = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.5, 1.0, 20.0, 30.0, -30.0)
    fan = Rays(((0.0, -1.0),) * 81, tuple((math.sin(a), math.cos(a)) for a in np.linspace(-0.3, 0.3, 81)))
    spreads = []
    for points in (33, 65, 129, 257):
        ways = only(Spline.through(oval.points(np.linspace(0, 1, points))), fan)
        offsets = [
            cross(way.exit_direction, minus((0.0, 20.0), (float(way.points_mm[1][0]), float(way.points_mm[1][1]))))
            for way in ways
            if way.exit_direction is not None
        ]
        assert len(offsets) == 81
        spreads.append(max(map(abs, offsets)))
    assert min(orders(spreads)) > 2.6
    assert spreads[-1] < 1e-6


@pytest.mark.parametrize("mode", ["count", "power"])
def test_a_closed_spline_through_points_of_a_circle_is_as_good_as_the_circle(mode: Mode) -> None:
    """Along the axis of points it stands for a ball: detected power agrees to the share of one ray."""
    angles = np.arange(256) * math.tau / 256
    outline = Spline.through(np.column_stack([0.5 + 3.0 * np.cos(angles), 3.0 * np.sin(angles)]), closed=True)
    ball, spline = (
        trace(Scene((AIR, glass(1.5, 0.01)), (*body([curve]), *box(9.0)), (Fan((-6.0, 0.4), -90.0, 60.0, 4000),)), mode)
        for curve in (Arc.circle((0.5, 0.0), 3.0), outline)
    )
    assert spline.undefined == 0
    for name, reading in ball.detectors.items():
        assert spline.detectors[name].power == pytest.approx(reading.power, abs=3 / 4000)


def quarters(seed: int, rays: int, absorption_per_mm: float = 0.0) -> Scene:
    """A body of mixed curves, in four receivers that share the ring around it."""
    scene = one_body(seed, rays)
    ring = tuple(
        Interface(f"ring-{i}", Arc((0.0, 0.0), 8.0, 90.0 * i + 7.0, 90.0), "air", "air", "receiver", f"quarter {i}")
        for i in range(4)
    )
    medium = dataclasses.replace(scene.regions[1], absorption_per_mm=absorption_per_mm)
    return dataclasses.replace(scene, regions=(scene.regions[0], medium), interfaces=(*scene.interfaces[:-1], *ring))


def standard_scores(found: Trace, truth: Trace) -> list[float]:
    """Deviation of each receiver in standard errors."""
    return [
        (reading.power - truth.detectors[name].power)
        / math.hypot(reading.u_power, truth.detectors[name].u_power, 1e-12)
        for name, reading in found.detectors.items()
    ]


def judged(scores: list[float], what: str, most: float = 4.0) -> str:
    """All within so many standard errors, and these neither far too small nor far too large."""
    rms = math.sqrt(sum(score**2 for score in scores) / len(scores))
    line = f"{what}: {len(scores)} readings, largest {max(map(abs, scores)):.1f} and rms {rms:.2f} standard errors"
    assert max(map(abs, scores)) < most, line
    assert 0.3 < rms < 1.6, line
    return line


def split_or_drawn(seeds: range, rays: int) -> str:
    """Following both parts of the light, or one by chance, of the very same rays."""
    scores = []
    for seed in seeds:
        scene = quarters(seed, rays, 0.02)
        truth = trace(scene, "power", Limits(min_weight=1e-7, max_hits=400))
        found = trace(scene, "roulette", Limits(max_hits=400), seed=seed)
        assert truth.undefined == found.undefined == 0
        scores += standard_scores(found, truth)
    return judged(scores, "roulette against splitting", 4.0 if len(seeds) < 50 else 5.0)


def sampled_or_fanned(seeds: range, rays: int) -> str:
    """Sobol' samples of so many rays, and a fan of 64 times as many."""
    scores = []
    for seed in seeds:
        truth = trace(quarters(seed, 64 * rays), "power", Limits(min_weight=1e-4, max_hits=50))
        found = trace(quarters(seed, rays), "power", Limits(min_weight=1e-4, max_hits=50), sampling="sobol", seed=seed)
        scores += standard_scores(found, truth)
    return judged(scores, "Sobol' against fan", 4.0 if len(seeds) < 50 else 5.0)


def test_splitting_and_roulette_agree_within_four_standard_errors() -> None:
    split_or_drawn(range(12), 2000)


def test_sobol_and_fan_agree_within_four_standard_errors() -> None:
    sampled_or_fanned(range(8), 512)


@pytest.mark.evidence
def test_a_hundred_scenes_agree_whichever_way_light_is_followed_and_sampled() -> None:
    print(f"\n  {split_or_drawn(range(100, 200), 8000)}\n  {sampled_or_fanned(range(100, 200), 1024)}")


def in_both_precisions(seeds: range, rays: int) -> str:
    """The stated error comes from some thousand rays; of all of them, a few may end elsewhere."""
    worst = stated = 0.0
    for seed in seeds:
        scene = quarters(seed, rays, 0.02)
        double = trace(scene, "roulette", Limits(max_hits=300), seed=seed)
        single = trace(scene, "roulette", Limits(max_hits=300), seed=seed, precision="single")
        assert single.single_error is not None
        assert double.single_error is None
        off = max(abs(single.detectors[name].power - r.power) for name, r in double.detectors.items())
        assert off <= 3 * single.single_error + 5 / rays, seed
        worst, stated = max(worst, off), max(stated, single.single_error)
    return f"single precision: off by at most {worst:.1e}, stated {stated:.1e}; one ray is {1 / rays:.1e}"


def test_single_precision_is_off_by_what_it_states_and_a_few_rays() -> None:
    in_both_precisions(range(10), 20_000)


@pytest.mark.evidence
def test_single_precision_is_off_by_what_it_states_on_many_rays() -> None:
    print(f"\n  {in_both_precisions(range(100, 150), 400_000)}")


def test_a_chip_is_the_average_of_fans_along_it() -> None:
    """Sobol' samples of a chip 1 mm wide against 500 fans of 4000 rays along it, to 1e-4."""
    eye = Interface("eye", Segment((1.7, 5.0), (-0.6, 5.0)), "air", "air", "receiver", "eye")
    ball = Interface("ball", Arc.circle((0.2, 0.0), 2.5), "glass", "air")
    chip = Chip((0.1, -4.0), 1.0, 12.0, 110.0, 2**18)
    faces, limits = (ball, eye), Limits(min_weight=1e-4)
    leftwards = (-math.cos(math.radians(12.0)), -math.sin(math.radians(12.0)))
    fans = tuple(Fan(along(chip.point, leftwards, float(x)), 12.0, 110.0, 4000) for x in (np.arange(500) - 249.5) / 500)
    found = trace(Scene((AIR, glass(1.5)), faces, (chip,)), "power", limits, sampling="sobol", seed=1)
    truth = trace(Scene((AIR, glass(1.5)), faces, fans), "power", limits)
    lattice = trace(Scene((AIR, glass(1.5)), faces, (chip,)), "power", limits)
    assert found.rays == 2**18
    assert found.detectors["eye"].u_power < 1e-4
    for result in (found, lattice):
        assert result.detectors["eye"].power == pytest.approx(truth.detectors["eye"].power, abs=1e-4)
    by_place = truth.detectors["eye"].power_by_source
    assert len(by_place) == 500
    assert sum(by_place) == pytest.approx(truth.detectors["eye"].power, abs=1e-12)


def test_the_pairs_start_and_end_together() -> None:
    for one, other in PAIRS.values():
        assert math.dist(one.start, other.start) < 1e-13
        assert math.dist(one.end, other.end) < 1e-13
