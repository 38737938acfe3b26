"""What a trace promises, of the reference and of the compiled engine alike."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.plane import Point, heading
from solen.scene import Beam, Fan, Interface, Monitor, Rays, Region, Scene, Source
from solen.scene.model import Behaviour
from solen.trace import Limits, Mode, Trace, trace, trace_reference
from solen.trace.result import MODES

Tracer = Callable[..., Trace]

AIR, GLASS, SMOKE = Region("air", 1.0), Region("glass", 1.5), Region("smoke", 1.0, 0.25)
UP = Rays(((0.0, -1.0),), ((0.0, 1.0),))
NORMAL = 0.04
"""Reflectance of glass at normal incidence."""
both = pytest.mark.parametrize("tracer", [trace, trace_reference], ids=["engine", "reference"])
modes = pytest.mark.parametrize("mode", MODES)
all_of_it = pytest.mark.parametrize("mode", ["count", "power"])
"""Where a partial reflection has its own share rather than its chance."""


def line(
    name: str,
    z: float,
    left: str = "air",
    right: str = "air",
    behaviour: Behaviour = "refracting",
    receiver: str | None = None,
    half: float = 10.0,
) -> Interface:
    """Horizontal face at z from −half to half: its left, and a receiver's face, looks up."""
    return Interface(name, Segment((-half, z), (half, z)), left, right, behaviour, receiver)


def scene(*interfaces: Interface, source: Source = UP, monitors: tuple[Monitor, ...] = ()) -> Scene:
    """Faces here stand for endless ones: media behind them are open."""
    return Scene((AIR, GLASS, SMOKE), interfaces, (source,), monitors, open_media=True)


def slab(source: Source = UP, inside: str = "glass", *more: Interface) -> Scene:
    """Plate between z = 0 and z = 1."""
    return scene(line("front", 0.0, inside, "air"), line("back", 1.0, "air", inside), *more, source=source)


def box(source: Source, behaviour: Behaviour = "mirror", medium: str = "air") -> Scene:
    """Closed unit square, its inside on the left."""
    corners: list[Point] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)]
    sides = [Interface(f"side-{i}", Segment(corners[i], corners[i + 1]), medium, "air", behaviour) for i in range(4)]
    return scene(*sides, source=source)


def parts(result: Trace) -> tuple[float, float, float, float]:
    return (result.ledger.detected, result.ledger.escaped, result.ledger.absorbed, result.ledger.truncated)


@both
@modes
def test_rays_that_meet_nothing_escape(tracer: Tracer, mode: Mode) -> None:
    result = tracer(scene(), mode)
    assert parts(result) == (0.0, 1.0, 0.0, 0.0)
    assert (result.mode, result.rays, result.hits, result.undefined) == (mode, 1, 0, 0)
    assert (result.detectors, result.monitors, result.undefined_at_mm) == ({}, {}, ())
    assert result.legs is None
    assert result.paths() == []


@both
@modes
def test_a_receiver_detects_on_its_left_and_absorbs_on_its_right(tracer: Tracer, mode: Mode) -> None:
    down = Rays(((0.0, 5.0),), ((0.0, -1.0),))
    eye = line("eye", 2.0, behaviour="receiver", receiver="eye")
    seen, behind = tracer(scene(eye, source=down), mode), tracer(scene(eye), mode)
    assert parts(seen) == (1.0, 0.0, 0.0, 0.0)
    assert (seen.detectors["eye"].power, seen.detectors["eye"].rays) == (1.0, 1)
    assert parts(behind) == (0.0, 0.0, 1.0, 0.0)
    assert (behind.detectors["eye"].power, behind.detectors["eye"].rays) == (0.0, 0)


@both
def test_one_receiver_of_two_faces_adds_them_up(tracer: Tracer) -> None:
    low = Interface("low", Segment((1.0, 2.0), (-1.0, 2.0)), "air", "air", "receiver", "eye")
    high = Interface("high", Segment((3.0, 4.0), (1.5, 4.0)), "air", "air", "receiver", "eye")
    result = tracer(scene(high, low, source=Rays(((0.0, 0.0), (2.0, 0.0)), ((0.0, 1.0),) * 2, power=4.0)))
    assert (result.detectors["eye"].power, result.detectors["eye"].rays) == (1.0, 2)


@both
@modes
@pytest.mark.parametrize("down", [False, True])
def test_an_absorbing_face_absorbs_on_both_sides(tracer: Tracer, mode: Mode, down: bool) -> None:
    source = Rays(((0.0, 5.0),), ((0.0, -1.0),)) if down else UP
    assert parts(tracer(scene(line("wall", 2.0, behaviour="absorbing"), source=source), mode)) == (0.0, 0.0, 1.0, 0.0)


@both
@modes
@pytest.mark.parametrize("down", [False, True])
def test_a_mirror_reflects_all_on_both_sides(tracer: Tracer, mode: Mode, down: bool) -> None:
    ray = Rays(((0.0, 5.0),), ((0.6, -0.8),)) if down else Rays(((0.0, -1.0),), ((0.6, 0.8),))
    result = tracer(scene(line("wall", 2.0, "glass", "air", "mirror"), source=ray), mode, legs=True)
    (path,) = result.paths()
    assert path.exit_direction == pytest.approx((0.6, 0.8 if down else -0.8), abs=1e-15)
    assert path.fate == "escaped"
    assert path.interfaces == (0,)
    assert parts(result) == (0.0, 1.0, 0.0, 0.0)


@both
def test_counting_refracts_and_never_splits(tracer: Tracer) -> None:
    ray = Rays(((0.0, -1.0),), (heading(-30.0),))
    (path,) = tracer(slab(ray), legs=True).paths()
    inside = math.asin(0.5 / 1.5)
    assert path.points_mm[1] == pytest.approx([math.tan(math.radians(30)), 0.0], abs=1e-15)
    assert path.points_mm[2] == pytest.approx([math.tan(math.radians(30)) + math.tan(inside), 1.0], abs=1e-15)
    assert path.exit_direction == pytest.approx(heading(-30.0), abs=1e-15)
    assert path.interfaces == (0, 1)
    assert (path.ray, path.branch, path.power) == (0, 0, 1.0)


@both
def test_counting_reflects_totally_beyond_the_critical_angle(tracer: Tracer) -> None:
    ray = Rays(((0.0, 0.5),), (heading(-50.0),))
    result = tracer(slab(ray), limits=Limits(max_hits=5), legs=True)
    assert parts(result) == (0.0, 0.0, 0.0, 1.0)
    assert result.hits == 5
    (path,) = result.paths()
    assert path.points_mm[1:, 1] == pytest.approx([1.0, 0.0, 1.0, 0.0, 1.0], abs=1e-14)
    assert path.fate == "truncated"
    assert path.exit_direction is None


@both
def test_the_incoherent_slab_shares_power_as_its_closed_form(tracer: Tracer) -> None:
    eye = line("eye", -2.0, behaviour="receiver", receiver="eye")
    result = tracer(slab(UP, "glass", eye), "power", Limits(min_weight=1e-12))
    assert result.detectors["eye"].power == pytest.approx(2 * NORMAL / (1 + NORMAL), abs=1e-11)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert result.ledger.escaped == pytest.approx((1 - NORMAL) / (1 + NORMAL), abs=1e-11)


@both
@pytest.mark.parametrize(("s_share", "reflected"), [(1.0, ((1.5**2 - 1) / (1.5**2 + 1)) ** 2), (0.0, 0.0)])
def test_polarisations_are_carried_apart(tracer: Tracer, s_share: float, reflected: float) -> None:
    brewster_deg = math.degrees(math.atan(1.5))
    ray = Rays(((0.0, -1.0),), (heading(-brewster_deg),), s_share=s_share)
    eye = line("eye", -2.0, behaviour="receiver", receiver="eye")
    result = tracer(scene(line("front", 0.0, "glass", "air"), eye, source=ray), "power")
    assert result.detectors["eye"].power == pytest.approx(reflected, abs=1e-15)


@both
def test_roulette_follows_one_way_with_all_of_the_power(tracer: Tracer) -> None:
    """A ray that loses nothing on its way ends with what it was launched with, in one branch."""
    made = slab(Fan((0.0, -1.0), 0.0, 160.0, 40))
    result = tracer(made, "roulette", legs=True)
    assert result.legs is not None
    assert not np.any(result.legs["branch"])
    assert result.legs["power_s"] + result.legs["power_p"] == pytest.approx(1 / 40, abs=1e-15)
    assert parts(result) == pytest.approx((0.0, 1.0, 0.0, 0.0), abs=1e-14)
    upwards = sum(path.exit_direction is not None and path.exit_direction[1] > 0.0 for path in result.paths())
    assert 0 < upwards < 40


@pytest.mark.parametrize("s_share", [0.0, 0.5, 1.0])
def test_roulette_draws_parts_by_their_powers(s_share: float) -> None:
    """Oblique light through a plate: its mean is that of following both parts, within 5 standard errors."""
    eye = line("eye", 5.0, behaviour="receiver", receiver="eye", half=50.0)
    eye = dataclasses.replace(eye, curve=eye.curve.reversed())
    rays = 40_000
    made = slab(Beam((-1.0, -1.0), (1.0, -1.0), 70.0, rays, s_share=s_share), "glass", eye)
    exact = trace(
        dataclasses.replace(made, sources=(Beam((0.0, -1.0), (0.0, -1.0), 70.0, 1, s_share=s_share),)), "power"
    )
    share, drawn = exact.detectors["eye"].power, trace(made, "roulette", seed=7).detectors["eye"]
    sigma = math.sqrt(share * (1.0 - share) / rays)
    assert 0.4 < share < 0.999
    assert drawn.power == pytest.approx(share, abs=5.0 * sigma + 1e-6)
    assert 0.4 * sigma < drawn.u_power < 2.0 * sigma  # of sixteen groups, which know it to about a fifth


def test_roulette_is_the_same_in_both_tracers_and_another_with_another_seed() -> None:
    made = slab(Fan((0.0, -1.0), 0.0, 160.0, 300))
    ways = [
        [(path.ray, path.interfaces, path.fate) for path in tracer(made, "roulette", seed=seed, legs=True).paths()]
        for tracer, seed in ((trace, 3), (trace_reference, 3), (trace, 4), (trace_reference, 4), (trace, 2**62))
    ]
    assert ways[0] == ways[1]
    assert ways[2] == ways[3]
    assert ways[0] != ways[2] != ways[4] != ways[0]


@both
def test_power_is_absorbed_on_the_way_and_counting_knows_no_absorption(tracer: Tracer) -> None:
    made = slab(UP, "smoke")
    kept = math.exp(-0.25)
    for mode in ("power", "roulette"):
        assert parts(tracer(made, mode)) == pytest.approx((0.0, kept, 1 - kept, 0.0), abs=1e-15)
    assert parts(tracer(made, "count")) == (0.0, 1.0, 0.0, 0.0)


@both
def test_what_leaves_into_an_absorbing_medium_for_ever_is_absorbed(tracer: Tracer) -> None:
    made = scene(line("front", 0.0, "smoke", "air"))
    for mode in ("power", "roulette"):
        assert parts(tracer(made, mode)) == (0.0, 0.0, 1.0, 0.0)
    assert parts(tracer(made, "count")) == (0.0, 1.0, 0.0, 0.0)


@both
@modes
@pytest.mark.parametrize("max_hits", [1, 2, 17])
def test_hits_are_limited_and_what_is_cut_is_reported(tracer: Tracer, mode: Mode, max_hits: int) -> None:
    result = tracer(box(Fan((0.31, 0.42), 10.0, 50.0, 9)), mode, Limits(max_hits=max_hits))
    assert parts(result) == pytest.approx((0.0, 0.0, 0.0, 1.0), abs=1e-15)
    assert result.hits == 9 * max_hits


@both
def test_branches_below_the_least_weight_are_cut_and_reported(tracer: Tracer) -> None:
    coarse = tracer(slab(), "power", Limits(min_weight=0.05))
    assert parts(coarse) == pytest.approx((0.0, 0.96 * 0.96, 0.0, NORMAL + 0.96 * NORMAL), abs=1e-15)
    finer = tracer(slab(), "power", Limits(min_weight=1e-3))
    assert 0 < finer.ledger.truncated < 0.002
    assert finer.ledger.total == pytest.approx(1.0, abs=1e-14)


@both
def test_a_weight_is_of_the_rays_own_power_and_readings_are_of_the_whole(tracer: Tracer) -> None:
    weak = Fan((0.0, -1.0), 0.0, 1.0, 1, power=1e-9)
    made = slab(weak)
    result = tracer(dataclasses.replace(made, sources=(weak, Fan((0.0, -1.0), 0.0, 1.0, 3, power=9.0))), "power")
    assert result.ledger.total == pytest.approx(1.0, abs=1e-14)
    assert result.ledger.truncated < 1e-5
    assert result.rays == 4


@both
@all_of_it
def test_rays_in_the_wrong_medium_are_counted_and_located(tracer: Tracer, mode: Mode) -> None:
    wrong = scene(line("front", 0.0, "glass", "air"), line("back", 1.0, "air", "smoke"))
    result = tracer(wrong, mode, legs=True)
    assert result.undefined == 1
    assert len(result.undefined_at_mm) == 1
    assert result.undefined_at_mm[0] == pytest.approx((0.0, 1.0), abs=1e-15)
    lost = 1.0 if mode == "count" else 1 - NORMAL
    assert result.ledger.truncated == pytest.approx(lost, abs=1e-15)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-15)
    assert result.legs is not None
    assert 4 in result.legs["fate"]


@both
def test_no_more_than_sixteen_places_are_kept_of_any_number(tracer: Tracer) -> None:
    wrong = (line("front", 0.0, "glass", "air"), line("back", 1.0, "air", "smoke"))
    result = tracer(scene(*wrong, source=Beam((-1.0, -1.0), (1.0, -1.0), 0.0, 40)))
    assert result.undefined == 40
    assert len(result.undefined_at_mm) == 16
    assert result.undefined_at_mm[0] == pytest.approx((-0.975, 1.0))


@both
def test_an_unmarked_ray_takes_the_medium_of_the_first_face(tracer: Tracer) -> None:
    result = tracer(slab(Rays(((0.0, 0.5),), ((0.0, 1.0),))), "power", Limits(min_weight=1e-12))
    assert result.undefined == 0
    assert result.ledger.escaped == pytest.approx(1.0, abs=1e-11)


MONITOR = Monitor("m", (-2.0, 0.5), (2.0, 0.5), 4)


@both
@all_of_it
def test_a_monitor_counts_towards_its_left_and_changes_nothing(tracer: Tracer, mode: Mode) -> None:
    beam = Beam((-1.0, -1.0), (1.0, -1.0), 0.0, 8)
    bare = tracer(slab(beam), mode)
    turned = Monitor("back", MONITOR.end, MONITOR.start, 4)
    made = slab(beam)
    seen = tracer(dataclasses.replace(made, monitors=(MONITOR, turned)), mode)
    assert parts(seen) == pytest.approx(parts(bare), abs=1e-14)
    assert seen.hits == bare.hits
    net = 1.0 if mode == "count" else (1 - NORMAL) / (1 + NORMAL)
    assert seen.monitors["m"].power == pytest.approx(net, abs=2e-6)
    assert seen.monitors["back"].power == pytest.approx(-net, abs=2e-6)
    assert seen.monitors["m"].power_by_bin == pytest.approx([0.0, net / 2, net / 2, 0.0], abs=2e-6)
    assert seen.monitors["back"].power_by_bin == pytest.approx(-seen.monitors["m"].power_by_bin[::-1], abs=1e-15)
    assert seen.monitors["m"].rays >= 8
    assert seen.detectors == {}


@both
def test_a_monitors_bins_are_equal_and_end_with_it(tracer: Tracer) -> None:
    monitor = Monitor("m", (0.0, 0.0), (3.0, 4.0), 5)
    rays = Rays(tuple((0.6 * t, 0.8 * t - 1.0) for t in (0.5, 1.5, 1.6, 4.5, 5.5)), ((0.0, 1.0),) * 5)
    result = tracer(scene(source=rays, monitors=(monitor,)))
    assert result.monitors["m"].power_by_bin == pytest.approx([0.2, 0.4, 0.0, 0.0, 0.2], abs=1e-15)
    assert result.monitors["m"].power == pytest.approx(0.8, abs=1e-15)
    assert result.monitors["m"].rays == 4


@both
def test_a_monitor_sees_the_power_left_at_its_place(tracer: Tracer) -> None:
    made = slab(UP, "smoke")
    monitors = (MONITOR, Monitor("beyond", (-2.0, 3.0), (2.0, 3.0)))
    seen = tracer(dataclasses.replace(made, monitors=monitors), "power")
    assert seen.monitors["m"].power == pytest.approx(math.exp(-0.125), abs=1e-15)
    assert seen.monitors["beyond"].power == pytest.approx(math.exp(-0.25), abs=1e-15)
    assert seen.monitors["beyond"].power_by_bin.shape == (0,)


@both
def test_a_monitor_behind_a_wall_sees_nothing(tracer: Tracer) -> None:
    wall = line("wall", 0.2, behaviour="absorbing")
    result = tracer(scene(wall, monitors=(MONITOR,)), "power")
    assert (result.monitors["m"].power, result.monitors["m"].rays) == (0.0, 0)


@both
@modes
def test_paths_tell_the_way_of_every_branch(tracer: Tracer, mode: Mode) -> None:
    made = slab(Fan((0.0, -1.0), 0.0, 60.0, 6))
    result = tracer(made, mode, Limits(min_weight=1e-3), legs=True)
    paths = result.paths()
    assert [(path.ray, path.branch) for path in paths] == sorted({(path.ray, path.branch) for path in paths})
    assert {path.ray for path in paths} == set(range(6))
    ends = {"escaped", "truncated"} if mode == "power" else {"escaped"}
    assert result.legs is not None
    for leg in result.legs:
        assert math.hypot(leg["dx"], leg["dz"]) == pytest.approx(1.0, abs=1e-12)
    for path in paths:
        assert path.fate in ends
        assert (path.exit_direction is None) == (path.fate != "escaped")
        for point, interface in zip(path.points_mm[1:], path.interfaces, strict=False):
            assert point[1] == pytest.approx(float(interface), abs=1e-12)  # front at 0, back at 1
    assert all(path.power == pytest.approx(1 / 6) for path in paths if path.branch == 0)


@both
def test_a_path_that_escapes_along_an_axis_is_reported_without_a_warning(tracer: Tracer) -> None:
    (path,) = tracer(scene(line("front", 0.0, "glass", "air")), legs=True).paths()
    assert path.points_mm.tolist() == [[0.0, -1.0], [0.0, 0.0]]
    assert path.exit_direction == (0.0, 1.0)


@both
def test_legs_add_up_to_the_ledger(tracer: Tracer) -> None:
    made = slab(Fan((0.0, -1.0), 0.0, 60.0, 5), "glass", line("eye", 3.0, behaviour="absorbing"))
    result = tracer(made, "power", legs=True)
    assert result.legs is not None
    power = result.legs["power_s"] + result.legs["power_p"]
    assert power[result.legs["fate"] == 3].sum() == pytest.approx(result.ledger.absorbed, abs=1e-12)
    assert power[result.legs["fate"] == 2].sum() == pytest.approx(result.ledger.escaped, abs=1e-12)


@both
@settings(max_examples=25, deadline=None)
@given(
    n=st.floats(1.0, 3.0),
    loss=st.floats(0.0, 2.0),
    axis=st.floats(-180, 180),
    radius=st.floats(0.2, 2.0),
    shares=st.tuples(st.floats(0.1, 10), st.floats(0, 1)),
)
def test_the_ledger_always_adds_up(
    tracer: Tracer, n: float, loss: float, axis: float, radius: float, shares: tuple[float, float]
) -> None:
    regions = (AIR, Region("ball", n, loss))
    ball = Interface("ball", Arc.circle((0.0, 0.0), radius), "ball", "air")
    eye = Interface("eye", Segment((3.0, 3.0), (-3.0, 3.0)), "air", "air", "receiver", "eye")
    source = Fan((0.5, -2.5), axis, 90.0, 7, power=shares[0], s_share=shares[1])
    for mode in MODES:
        result = tracer(Scene(regions, (ball, eye), (source,)), mode, Limits(max_hits=60))
        assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
        assert result.undefined == 0
        assert result.ledger.detected == pytest.approx(result.detectors["eye"].power, abs=1e-14)
        assert min(parts(result)) >= 0.0


@pytest.mark.parametrize("min_weight", [0.0, 1e-16, 1.0, -1e-6, math.nan, math.inf])
def test_a_least_weight_out_of_range_is_refused(min_weight: float) -> None:
    with pytest.raises(DesignError, match="min_weight"):
        Limits(min_weight=min_weight)


@pytest.mark.parametrize("max_hits", [0, -3, math.nan, 2.5])
def test_a_number_of_hits_that_is_none_is_refused(max_hits: int) -> None:
    with pytest.raises(DesignError, match="max_hits"):
        Limits(max_hits=max_hits)


@both
def test_an_unknown_mode_is_refused(tracer: Tracer) -> None:
    with pytest.raises(DesignError, match="must be one of count, power"):
        tracer(scene(), "guess")


@both
def test_nothing_escapes_from_a_closed_mirror(tracer: Tracer) -> None:
    circle = Interface("c", Arc.circle((0.0, 0.0), 1.0), "air", "air", "mirror")
    sine, cosine = math.sin(math.radians(60)), math.cos(math.radians(60))
    triangle = Rays(((1 - 0.5 * sine, 0.5 * cosine),), ((-sine, cosine),))
    result = tracer(scene(circle, source=triangle), limits=Limits(max_hits=2000))
    assert result.ledger.escaped == 0.0


@both
def test_nothing_escapes_from_a_closed_square_of_mirrors(tracer: Tracer) -> None:
    result = tracer(box(Fan((0.3, 0.4), 0.0, 360.0, 31)), limits=Limits(max_hits=1000))
    assert result.ledger.truncated == pytest.approx(1.0, abs=1e-12)
    assert result.undefined == 0


@pytest.mark.parametrize("z", [0.0, 1e-10])
def test_a_monitor_on_an_interface_is_refused(z: float) -> None:
    with pytest.raises(DesignError, match="monitor m; must not overlap an interface, but lies on front"):
        scene(line("front", 0.0, "glass", "air"), monitors=(Monitor("m", (-9.0, z), (9.0, z)),))


@pytest.mark.parametrize("angle_deg", [-11.0, -7.0, -3.0, 3.0, 7.0, 11.0])
@pytest.mark.parametrize("beside_mm", [1e-6, -1e-6])
@both
def test_a_monitor_just_beside_an_interface_counts_every_ray(
    tracer: Tracer, angle_deg: float, beside_mm: float
) -> None:
    monitor = Monitor("m", (-9.0, beside_mm), (9.0, beside_mm))
    for rays in range(1, 40):
        ray = Fan((0.1, -1.0), angle_deg, 20.0, rays)
        made = scene(line("front", 0.0, "glass", "air"), source=ray, monitors=(monitor,))
        assert tracer(made).monitors["m"].rays == rays
