"""Two descriptions of a curve, fans and samples, and splitting and roulette give the same results."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pytest

from solen.curve import Arc, Bezier, CartesianOval, Conic, Curve, Parabola, Segment, Spline
from solen.plane import along, cross, minus, right_of
from solen.scene import Chip, Fan, Interface, Rays, Scene
from solen.trace import Limits, Mode, Path, Trace, trace
from tests.agreement.compare_support import ROTATION_RAD, compare, with_rotated_rays
from tests.agreement.random_scene_support import motley_scene, one_body, random_scene
from tests.agreement.scenes_support import AIR, body, box, glass

FEW = Limits(min_weight=1e-3, max_hits=6)
Change = Callable[[Curve], Curve]


def as_conic(curve: Curve) -> Curve:
    """Return an arc as the conic with K = 0, and a parabola as the conic with K = −1."""
    if isinstance(curve, Arc) and curve.half_deg < 88.0:
        axis = (-curve.middle[0], -curve.middle[1])
        half = math.copysign(curve.radius_mm * math.sin(math.radians(curve.half_deg)), curve.sweep_deg)
        return Conic(curve.middle_point, axis, 1.0 / curve.radius_mm, 0.0, -half, half)
    if isinstance(curve, Parabola):
        return Conic(curve.vertex, right_of(curve.axis), 2.0 * curve.curve_per_mm, -1.0, -curve.from_mm, -curve.to_mm)
    return curve


def as_bezier(first: float, second: float) -> Change:
    """Return a function that converts segments to Bézier curves with control points at these fractions."""

    def change(curve: Curve) -> Curve:
        if not isinstance(curve, Segment):
            return curve
        a, b = curve.a, curve.b
        inner = [(a[0] + u * (b[0] - a[0]), a[1] + u * (b[1] - a[1])) for u in (first, second)]
        return Bezier(a, inner[0], inner[1], b)

    return change


def as_spline(curve: Curve) -> Curve:
    """Return a segment as a spline through some of its points."""
    return Spline.through(curve.points(np.array([0.0, 0.1, 0.45, 0.8, 1.0]))) if isinstance(curve, Segment) else curve


def changed(scene: Scene, change: Change) -> Scene:
    faces = tuple(dataclasses.replace(face, curve=change(face.curve)) for face in scene.interfaces)
    assert faces != scene.interfaces
    return dataclasses.replace(scene, interfaces=faces)


def without_corner_rays(scene: Scene) -> Scene:
    """Return a scene without the rays that almost meet corners, whose positions agree only to rounding errors."""
    return dataclasses.replace(scene, sources=(*scene.sources[:3], *scene.sources[4:]))


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize(
    ("change", "seed"),
    [(as_conic, 1), (as_conic, 3), (as_bezier(1 / 3, 2 / 3), 5), (as_bezier(0.15, 0.45), 6), (as_spline, 7)],
)
def test_curves_described_as_others(change: Change, seed: int, mode: Mode) -> None:
    for scene in (without_corner_rays(random_scene(seed, 20)), without_corner_rays(motley_scene(seed, 20))):
        reference, *rotated = (
            trace(with_rotated_rays(scene, angle) if angle else scene, mode, FEW, segments=True)
            for angle in (0.0, ROTATION_RAD, -ROTATION_RAD)
        )
        result = trace(changed(scene, change), mode, FEW, segments=True)
        comparison = compare(reference, tuple(rotated), result)
        assert comparison.excluded < 0.1 * comparison.segments
        assert comparison.deviation_power < 1e-9


def paths_through(curve: Curve, rays: Rays) -> list[Path]:
    """Return the paths of rays through a face between air below and glass above."""
    face = Interface("face", curve, "glass", "air")
    return trace(Scene((AIR, glass(1.5)), (face,), (rays,), open_media=True), segments=True).paths()


def beam(half_mm: float, z_mm: float, rays: int = 101) -> Rays:
    origins = tuple((float(x), z_mm) for x in np.linspace(-half_mm, half_mm, rays))
    return Rays(origins, ((0.1, 1.0),) * rays)


def deviation(a: list[Path], b: list[Path]) -> tuple[float, float]:
    """Return the largest distance between hits, and the largest angle in rad between the refracted rays."""
    distance = max(math.dist(p.points_mm[1], q.points_mm[1]) for p, q in zip(a, b, strict=True))
    directions = [(p.exit_direction, q.exit_direction) for p, q in zip(a, b, strict=True)]
    return distance, max(abs(math.asin(cross(d, e))) for d, e in directions if d is not None and e is not None)


PAIRS = {
    "arc and conic with K = 0": (
        Arc((0.0, 6.0), 6.0, -135.0, 90.0),
        Conic((0.0, 0.0), (0.0, 1.0), 1 / 6, 0.0, -6 * math.sin(math.pi / 4), 6 * math.sin(math.pi / 4)),
    ),
    "parabola and conic with K = -1": (
        Parabola((0.0, 0.0), (-1.0, 0.0), 0.08, 4.0, -4.0),
        Conic((0.0, 0.0), (0.0, 1.0), 0.16, -1.0, -4.0, 4.0),
    ),
    "concave parabola and conic with K = -1": (
        Parabola((0.0, 0.0), (-1.0, 0.0), -0.08, 4.0, -4.0),
        Conic((0.0, 0.0), (0.0, 1.0), -0.16, -1.0, -4.0, 4.0),
    ),
    "segment and straight Bézier curve": (
        Segment((-4.0, -1.0), (4.0, 1.5)),
        Bezier((-4.0, -1.0), (-4.0 + 8 * 0.2, -1.0 + 2.5 * 0.2), (-4.0 + 8 * 0.55, -1.0 + 2.5 * 0.55), (4.0, 1.5)),
    ),
    "parabola and Bézier curve": (  # a quadratic curve with elevated degree
        Parabola((0.0, 0.0), (-1.0, 0.0), 0.08, 4.0, -4.0),
        Bezier((-4.0, 1.28), (-4.0 / 3, 1.28 / 3 - 2 * 1.28 / 3), (4.0 / 3, 1.28 / 3 - 2 * 1.28 / 3), (4.0, 1.28)),
    ),
}


@pytest.mark.parametrize("pair", PAIRS)
def test_same_curve_in_two_classes(pair: str) -> None:
    a, b = PAIRS[pair]
    assert math.dist(a.start, b.start) < 1e-13
    assert math.dist(a.end, b.end) < 1e-13
    distance, angle = deviation(*(paths_through(curve, beam(3.0, -4.0)) for curve in (a, b)))
    assert distance < 1e-12
    assert angle < 1e-12


def convergence_orders(errors: Sequence[float]) -> list[float]:
    """Return the orders of convergence between errors for which the point spacing is halved."""
    return [math.log2(a / b) for a, b in pairwise(errors)]


@pytest.mark.parametrize("constant", [-2.5, -1.0, -0.6, 0.0, 1.5])
def test_spline_converges_to_a_conic(constant: float) -> None:
    """Far from its ends, positions converge with order four in the point spacing, directions with order three."""
    conic = Conic((0.0, 0.0), (0.0, 1.0), 0.15, constant, -4.0, 4.0)
    rays = beam(1.5, -3.0)
    exact = paths_through(conic, rays)
    splines = [Spline.through(conic.points(np.linspace(0, 1, n))) for n in (17, 33, 65, 129)]
    distances, angles = zip(*(deviation(exact, paths_through(spline, rays)) for spline in splines), strict=True)
    assert min(convergence_orders(distances)) > 3.5
    assert min(convergence_orders(angles)) > 2.6
    assert distances[-1] < 1e-8
    assert angles[-1] < 1e-6


def test_focus_of_a_spline_converges_to_that_of_an_oval() -> None:
    oval = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.5, 1.0, 20.0, 30.0, -30.0)
    fan = Rays(((0.0, -1.0),) * 81, tuple((math.sin(a), math.cos(a)) for a in np.linspace(-0.3, 0.3, 81)))
    radii = []
    for points in (33, 65, 129, 257):
        paths = paths_through(Spline.through(oval.points(np.linspace(0, 1, points))), fan)
        offsets = [
            cross(path.exit_direction, minus((0.0, 20.0), (float(path.points_mm[1][0]), float(path.points_mm[1][1]))))
            for path in paths
            if path.exit_direction is not None
        ]
        assert len(offsets) == 81
        radii.append(max(map(abs, offsets)))
    assert min(convergence_orders(radii)) > 2.6
    assert radii[-1] < 1e-6


@pytest.mark.parametrize("mode", ["count", "power"])
def test_circle_and_closed_spline(mode: Mode) -> None:
    """The detected powers agree within the power of a few rays."""
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
    """Return a body of mixed curves inside a circle of four receivers."""
    scene = one_body(seed, rays)
    ring = tuple(
        Interface(f"ring-{i}", Arc((0.0, 0.0), 8.0, 90.0 * i + 7.0, 90.0), "air", "air", "receiver", f"quarter {i}")
        for i in range(4)
    )
    medium = dataclasses.replace(scene.regions[1], absorption_per_mm=absorption_per_mm)
    return dataclasses.replace(scene, regions=(scene.regions[0], medium), interfaces=(*scene.interfaces[:-1], *ring))


def standard_scores(trace: Trace, exact: Trace) -> list[float]:
    """Return the deviation of each receiver in standard errors."""
    return [
        (reading.power - exact.detectors[name].power)
        / math.hypot(reading.u_power, exact.detectors[name].u_power, 1e-12)
        for name, reading in trace.detectors.items()
    ]


def check_scores(scores: list[float], title: str, max_score: float) -> str:
    """Check that no score is too large, and that their RMS is plausible; return a summary."""
    rms = math.sqrt(sum(score**2 for score in scores) / len(scores))
    line = f"{title}: {len(scores)} readings, {max(map(abs, scores)):.1f} standard errors at most, {rms:.2f} RMS"
    assert max(map(abs, scores)) < max_score, line
    assert 0.3 < rms < 1.6, line
    return line


def check_roulette(seeds: range, rays: int, max_score: float) -> str:
    """Compare roulette with splitting, for the same rays."""
    scores = []
    for seed in seeds:
        scene = quarters(seed, rays, 0.02)
        split = trace(scene, "power", Limits(min_weight=1e-7, max_hits=400))
        roulette = trace(scene, "roulette", Limits(max_hits=400), seed=seed)
        assert split.undefined == roulette.undefined == 0
        scores += standard_scores(roulette, split)
    return check_scores(scores, "roulette against splitting", max_score)


def check_sobol(seeds: range, rays: int, max_score: float) -> str:
    """Compare Sobol' samples with a fan of 64 times as many rays."""
    scores, limits = [], Limits(min_weight=1e-4, max_hits=50)
    for seed in seeds:
        fan = trace(quarters(seed, 64 * rays), "power", limits)
        sobol = trace(quarters(seed, rays), "power", limits, sampling="sobol", seed=seed)
        scores += standard_scores(sobol, fan)
    return check_scores(scores, "Sobol' against fan", max_score)


def test_splitting_and_roulette() -> None:
    check_roulette(range(12), 2000, 4.0)


def test_sobol_and_fan() -> None:
    check_sobol(range(8), 512, 4.0)


@pytest.mark.evidence
def test_splitting_roulette_sobol_and_fan_in_a_hundred_scenes() -> None:
    print(f"\n  {check_roulette(range(100, 200), 8000, 5.0)}\n  {check_sobol(range(100, 200), 1024, 5.0)}")


def check_precisions(seeds: range, rays: int) -> str:
    """Compare the precisions; the error of single precision is estimated from few rays, so others may deviate more."""
    largest = estimated = 0.0
    for seed in seeds:
        scene = quarters(seed, rays, 0.02)
        double = trace(scene, "roulette", Limits(max_hits=300), seed=seed)
        single = trace(scene, "roulette", Limits(max_hits=300), seed=seed, precision="single")
        assert single.single_error is not None
        assert double.single_error is None
        error = max(abs(single.detectors[name].power - r.power) for name, r in double.detectors.items())
        assert error <= 3 * single.single_error + 5 / rays, seed
        largest, estimated = max(largest, error), max(estimated, single.single_error)
    return f"single precision: error {largest:.1e} at most, estimate {estimated:.1e}; power of a ray {1 / rays:.1e}"


def test_single_and_double_precision() -> None:
    check_precisions(range(10), 20_000)


@pytest.mark.evidence
def test_single_and_double_precision_with_many_rays() -> None:
    print(f"\n  {check_precisions(range(100, 150), 400_000)}")


def test_chip_is_the_mean_of_fans() -> None:
    """Compare a chip 1 mm wide with 250 fans of 2000 rays, to 1e-4."""
    eye = Interface("eye", Segment((1.7, 5.0), (-0.6, 5.0)), "air", "air", "receiver", "eye")
    ball = Interface("ball", Arc.circle((0.2, 0.0), 2.5), "glass", "air")
    chip = Chip((0.1, -4.0), 1.0, 12.0, 110.0, 2**18)
    faces, limits = (ball, eye), Limits(min_weight=1e-4)
    left = (-math.cos(math.radians(12.0)), -math.sin(math.radians(12.0)))
    positions = (np.arange(250) - 124.5) / 250
    fans = tuple(Fan(along(chip.point, left, float(x)), 12.0, 110.0, 2000) for x in positions)
    mean = trace(Scene((AIR, glass(1.5)), faces, fans), "power", limits)
    sobol = trace(Scene((AIR, glass(1.5)), faces, (chip,)), "power", limits, sampling="sobol", seed=1)
    lattice = trace(Scene((AIR, glass(1.5)), faces, (chip,)), "power", limits)
    assert sobol.rays == 2**18
    assert sobol.detectors["eye"].u_power < 1e-4
    for result in (sobol, lattice):
        assert result.detectors["eye"].power == pytest.approx(mean.detectors["eye"].power, abs=1e-4)
    by_source = mean.detectors["eye"].power_by_source
    assert len(by_source) == 250
    assert sum(by_source) == pytest.approx(mean.detectors["eye"].power, abs=1e-12)
