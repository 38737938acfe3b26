"""The Y at rest and turned: closed, simple, counter-clockwise, or refused in one line; its faces, marks and joins."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from solen.curve import Segment
from solen.errors import DesignError, SpecError
from solen.geometry import Body, arm_angle_deg, y_body
from solen.lens import OvalLens, lens_of
from solen.plane import Point, Rigid
from solen.spec import Design, with_values

REST = ("lens", "stem-right", "outer-right", "receiver-right", "inner-right")
REST_LEFT = ("inner-left", "receiver-left", "outer-left", "stem-left")


def design(**tables: Any) -> Design:
    return Design.model_validate({"name": "test", "material": {"index": 1.44}} | tables)


def built(angle_deg: float = 0.0, **tables: Any) -> Body:
    made = design(**tables)
    return y_body(made, lens_of(made, 1.44), angle_deg)


@pytest.mark.parametrize(
    ("tables", "same"),
    [
        ({"emitter": {"width_mm": 0.2, "pattern": "lambertian"}, "trace": {"dimension": "extruded"}}, True),
        ({"material": {"index": 1.44, "absorption_per_mm": 0.1}, "name": "other"}, True),
        ({"emitter": {"offset_mm": 0.01}}, False),
        ({"emitter": {"distance_mm": 1.1}}, False),
        ({"body": {"arm_length_mm": 20.0}}, False),
        ({"receivers": {"coupling": "air-gap", "gap_mm": 0.5}}, False),
        ({"wall": [{"face": "stem-*", "finish": "mirror"}]}, False),
        ({"motion": {"pivot": "emitter"}}, False),
        ({"motion": {"kind": "bend"}}, False),
        ({"lens": {"half_width_mm": 1.9}}, False),
    ],
    ids=str,
)
def test_designs_share_a_body_where_nothing_that_makes_it_differs(tables: dict[str, Any], same: bool) -> None:
    one, other = built(1.5), built(1.5, **tables)
    assert (one is other) == same
    assert one is built(1.5)
    assert one is not built(1.25)
    if not same:
        assert one != other


def built_or_refused(angle_deg: float, **tables: Any) -> Body | None:
    """The body, or None where it was refused in one line; no other error passes."""
    try:
        return built(angle_deg, **tables)
    except (DesignError, SpecError) as told:
        line = str(told)
    assert len(line.splitlines()) == 1
    return None


def mirror_distance_mm(one: Body, other: Body) -> float:
    """How far one body is from the mirror image of the other, face by face, each sampled along its curve."""
    swap = {"right": "left", "left": "right"}
    u, apart = np.linspace(0.0, 1.0, 33), [0.0]
    assert len(one.faces) == len(other.faces)
    for face in one.faces:
        part, _, side = face.name.partition("-")
        twin = other.face(f"{part}-{swap[side]}" if side else part).curve
        gap = face.curve.points(u) - twin.points(1.0 - u) * np.array([-1.0, 1.0])
        apart.append(float(np.hypot(*gap.T).max()))
    return max(apart)


def polygon(body: Body) -> shapely.Polygon:
    """Outline sampled evenly in each curve's own parameter: not the polyline that the body checks itself with."""
    u = np.linspace(0.0, 1.0, 301)[:-1]
    return shapely.Polygon(np.vstack([face.curve.points(u) for face in body.faces]))


@st.composite
def tables(draw: st.DrawFn) -> dict[str, Any]:
    """Designs round the paper's and far from it; many cannot be built."""
    stem_length = draw(st.floats(0.5, 60))
    pivot = draw(st.one_of(st.sampled_from(["stem-base", "emitter"]), st.tuples(st.floats(-5, 5), st.floats(-5, 30))))
    body: dict[str, Any] = {
        "stem_length_mm": stem_length,
        "stem_curve_per_mm": draw(st.one_of(st.floats(0.001, 0.02), st.floats(-0.005, 0.0))),
        "arm_length_mm": draw(st.floats(5, 60)),
        "arm_width_mm": draw(st.floats(0.1, 4)),
    }
    if draw(st.booleans()):
        body["arm_angle_deg"] = draw(st.floats(3, 89.5))
    return {
        "emitter": {"distance_mm": draw(st.floats(0.2, 3)), "offset_mm": draw(st.floats(-1, 1))},
        "lens": {
            "shape": draw(st.sampled_from(["cartesian-oval", "none"])),
            "half_width_mm": draw(st.floats(0.2, 2)),
            "focus_mm": draw(st.floats(12, 60)),
        },
        "body": body,
        "motion": {"pivot": pivot, "moves": draw(st.sampled_from([["lens", "emitter"], ["emitter"]]))},
    }


@settings(max_examples=150, deadline=None)
@given(values=tables(), angle=st.one_of(st.just(0.0), st.floats(-10, 10), st.floats(-89, 89)))
def test_a_body_is_closed_simple_and_counter_clockwise_or_refused(values: dict[str, Any], angle: float) -> None:
    body = built_or_refused(angle, **values)
    if body is None:
        return
    for face, following in pairwise((*body.faces, body.faces[0])):
        assert math.dist(face.curve.end, following.curve.start) < 2e-9
    outline = polygon(body)
    assert outline.is_valid
    assert shapely.is_ccw(outline.exterior)
    assert body.area_mm2() == pytest.approx(outline.area, abs=2e-3 * outline.length)
    assert not outline.contains(shapely.Point(body.emitter.point))
    names = [face.name for face in body.faces]
    assert len(set(names)) == len(names)


@settings(max_examples=60, deadline=None)
@given(values=tables(), angle=st.floats(-6, 6))
def test_turning_one_way_is_the_mirror_image_of_turning_the_other(values: dict[str, Any], angle: float) -> None:
    values["motion"]["pivot"] = "stem-base"
    opposite = {**values, "emitter": {**values["emitter"], "offset_mm": -values["emitter"]["offset_mm"]}}
    try:
        one = built(angle, **values)
    except DesignError:
        with pytest.raises(DesignError):
            built(-angle, **opposite)
        return
    other = built(-angle, **opposite)
    assert mirror_distance_mm(one, other) < 1e-9
    x, z = one.emitter.point
    assert math.dist(other.emitter.point, (-x, z)) < 1e-12
    assert other.emitter.axis_deg == -one.emitter.axis_deg


def test_the_faces_of_the_papers_body_in_order() -> None:
    assert tuple(face.name for face in built().faces) == REST + REST_LEFT


def test_the_papers_measures() -> None:
    body, made = built(), design()
    fork_right, fork_left = body.marks["fork-right"], body.marks["fork-left"]
    depth = body.marks["stem-base"][1]
    assert fork_right[0] - fork_left[0] == pytest.approx(2 * (2 + 0.004 * 16.2**2), abs=1e-12)
    assert fork_right[0] - fork_left[0] == pytest.approx(6.0995, abs=5e-5)
    assert fork_right[1] == pytest.approx(depth + 16.2, abs=1e-12)
    assert depth == pytest.approx(1.810852142230, abs=1e-11)
    assert arm_angle_deg(made) == pytest.approx(7.384, abs=5e-4)
    assert arm_angle_deg(design(body={"arm_angle_deg": 12.0})) == 12.0
    for side in ("right", "left"):
        outer, receiver, inner = (body.face(f"{part}-{side}").curve for part in ("outer", "receiver", "inner"))
        assert math.dist(outer.start, outer.end) == pytest.approx(22.2, abs=1e-12)
        assert math.dist(receiver.start, receiver.end) == pytest.approx(3.0, abs=1e-12)
        assert np.dot(outer.normal_at(outer.start), inner.normal_at(inner.start)) == pytest.approx(-1, abs=1e-12)
        assert np.dot(outer.normal_at(outer.start), receiver.normal_at(receiver.start)) == pytest.approx(0, abs=1e-12)


def test_the_default_arm_continues_the_stem_without_a_kink() -> None:
    stem, outer = built().face("stem-right").curve, built().face("outer-right").curve
    assert math.dist(stem.normal_at(stem.end), outer.normal_at(outer.start)) < 1e-12


def test_the_crotch_is_on_the_axis_where_both_inner_edges_end() -> None:
    body = built()
    crotch = body.marks["crotch"]
    assert crotch[0] == 0.0
    assert body.face("inner-right").curve.end == crotch == body.face("inner-left").curve.start
    assert body.marks["fork-right"][1] - 3 < crotch[1] < body.face("receiver-right").curve.start[1]


def test_the_body_at_rest_is_its_own_mirror_image() -> None:
    assert mirror_distance_mm(built(), built()) < 1e-12


def test_a_face_is_found_by_name() -> None:
    assert built().face("lens").name == "lens"
    with pytest.raises(KeyError, match="nose"):
        built().face("nose")


def test_the_lens_and_the_emitter_turn_about_the_stems_base() -> None:
    turned, rest = built(-3.0), built()
    base = rest.marks["stem-base"]
    motion = Rigid.about(base, -3.0)
    assert math.dist(turned.face("lens").curve.start, motion.point(rest.face("lens").curve.start)) < 1e-12
    assert math.dist(turned.emitter.point, motion.point(rest.emitter.point)) < 1e-12
    assert turned.emitter.axis_deg == -3.0
    assert turned.emitter.point[0] < 0  # below the pivot: what leans to the right above stands to the left below
    for name in ("outer-right", "receiver-left", "inner-left"):
        assert turned.face(name).curve == rest.face(name).curve


def test_turning_about_the_emitter_leaves_it_where_it_is() -> None:
    turned = built(2.0, motion={"pivot": "emitter"}, emitter={"offset_mm": 0.0})
    assert turned.emitter.point == pytest.approx((0.0, -1.0), abs=1e-15)
    lens = turned.face("lens").curve
    assert math.dist(lens.start, (0.0, -1.0)) == pytest.approx(math.hypot(2, 1 + turned.marks["stem-base"][1]))


def test_turning_about_a_point_of_ones_own() -> None:
    point: Point = (0.3, 1.0)
    turned = built(1.5, motion={"pivot": list(point)})
    assert math.dist(turned.emitter.point, point) == pytest.approx(math.dist((0.0, -1.0), point), abs=1e-12)


@pytest.mark.parametrize("lens", [{}, {"shape": "none"}])
def test_the_emitter_alone_turns_round_a_sensor_that_stands_still(lens: dict[str, Any]) -> None:
    motion = {"moves": ["emitter"]}
    turned, rest = built(2.5, motion=motion, lens=lens), built(motion=motion, lens=lens)
    assert turned.faces == rest.faces
    assert turned.emitter != rest.emitter


def test_a_flat_face_stands_still() -> None:
    flat = {"shape": "none"}
    turned, rest = built(2.5, lens=flat), built(lens=flat)
    assert turned.faces == rest.faces
    assert isinstance(rest.face("lens").curve, Segment)
    assert turned.emitter.axis_deg == 2.5


@pytest.mark.parametrize("angle_deg", [3.0, -3.0])
def test_a_turned_lens_is_joined_on_both_sides_and_a_resting_one_on_none(angle_deg: float) -> None:
    assert {"join-right", "join-left"} <= {face.name for face in built(angle_deg).faces}
    risen = "join-right" if angle_deg > 0 else "join-left"
    join = built(angle_deg).face(risen).curve
    assert abs(join.start[0] - join.end[0]) == pytest.approx(2.7e-3 + 4e-5, abs=5e-5)  # 2 (1 − cos 3°), and the flare
    assert join.start[1] == pytest.approx(join.end[1], abs=1e-12)


@pytest.mark.parametrize("pivot", ["stem-base", "emitter", [0.0, 8.0]], ids=str)
@pytest.mark.parametrize("join", ["bridge", "seam", "smooth"])
def test_every_join_closes_the_outline_and_vanishes_at_rest(join: str, pivot: Any) -> None:
    motion = {"join": join, "pivot": pivot}
    rest = polygon(built())
    assert polygon(built(motion=motion)).equals(rest)
    for angle_deg in (-3.0, -0.3, -1e-3, -1e-5, -1e-7, 1e-9, 2.0):
        turned = polygon(built(angle_deg, motion=motion))
        assert shapely.hausdorff_distance(turned.exterior, rest.exterior) < 0.2 * abs(angle_deg) + 1e-5


def test_a_seam_runs_to_the_stem_s_corners() -> None:
    body = built(-3.0, motion={"join": "seam", "pivot": "emitter"})
    corner = (2.0, body.marks["stem-base"][1])
    assert body.face("join-right").curve.end == corner
    assert body.face("join-left").curve.start == (-2.0, corner[1])
    assert body.face("join-left").curve.end[1] > corner[1] + 0.09


@pytest.mark.parametrize("angle_deg", [-3.0, -1e-3])
def test_a_smooth_join_leaves_along_the_lens_s_axis_and_runs_into_the_side(angle_deg: float) -> None:
    body = built(angle_deg, motion={"join": "smooth", "pivot": "emitter"})
    join, stem = body.face("join-right").curve, body.face("stem-right").curve
    out, into, side = (
        np.arctan2(*v) for v in (*join.velocities(np.array([0.0, 1.0])), stem.velocities(np.zeros(1))[0])
    )
    assert math.degrees(-out) == pytest.approx(angle_deg, abs=1e-9)
    assert into == pytest.approx(side, abs=1e-9)
    at_rest = built().face("stem-right").curve
    run = join.points(np.linspace(0.0, 1.0, 9))
    bent = run[:, 0] - np.interp(run[:, 1], *at_rest.points(np.linspace(0.0, 1.0, 20_001)).T[::-1])
    assert np.abs(bent).max() < 0.06 * abs(angle_deg) + 1e-6


def test_the_outline_changes_continuously_as_the_angle_goes_to_nothing() -> None:
    rest = polygon(built())
    for angle_deg in (1.0, 1e-1, 1e-2, 1e-4, 1e-6, 1e-7, 1e-8, 1e-10, 1e-14):
        for sign in (-1, 1):
            turned = polygon(built(sign * angle_deg))
            assert turned.symmetric_difference(rest).area < 0.2 * angle_deg + 1e-9
            assert shapely.hausdorff_distance(turned.exterior, rest.exterior) < 0.05 * angle_deg + 1e-8


REFUSED: list[tuple[dict[str, Any], float, str]] = [
    ({"body": {"stem_curve_per_mm": 0.0}}, 0.0, "body.arm_angle_deg"),
    ({"body": {"stem_curve_per_mm": -0.004}}, 0.0, "body.arm_angle_deg"),
    ({"body": {"stem_curve_per_mm": -0.02, "arm_angle_deg": 60.0}}, 0.0, "intersect"),
    ({"body": {"arm_width_mm": 9.0}}, 0.0, "body.arm_width_mm"),
    ({"emitter": {"distance_mm": 0.1}, "motion": {"pivot": [0.0, 8.0], "moves": ["emitter"]}}, 20.0, "emitter"),
    ({"body": {"stem_length_mm": 0.5, "arm_angle_deg": 20.0}}, 30.0, "motion"),
    ({}, 180.0, "motion"),
    ({}, 89.0, "motion"),
]


@pytest.mark.parametrize(("values", "angle_deg", "words"), REFUSED)
def test_a_body_that_cannot_be_says_why(values: dict[str, Any], angle_deg: float, words: str) -> None:
    with pytest.raises(DesignError, match=words) as refusal:
        built(angle_deg, **values)
    assert len(str(refusal.value).splitlines()) == 1


def test_the_remedy_for_arms_too_wide_is_the_limit() -> None:
    with pytest.raises(DesignError, match="must be below") as refusal:
        built(body={"arm_width_mm": 9.0})
    limit = float(str(refusal.value).split("must be below ")[1].split()[0])
    assert built(body={"arm_width_mm": limit - 0.01}).area_mm2() > 0
    with pytest.raises(DesignError, match="arm_width_mm"):
        built(body={"arm_width_mm": limit + 0.01})


def test_arms_that_never_part_have_no_negative_width() -> None:
    with pytest.raises(DesignError) as refusal:
        built(body={"stem_curve_per_mm": -0.02, "arm_angle_deg": 8.0})
    assert "-" not in str(refusal.value).split("must be")[-1].split("mm")[0]


@pytest.mark.parametrize("angle_deg", [math.nan, math.inf])
def test_an_angle_that_is_no_number_is_refused(angle_deg: float) -> None:
    with pytest.raises(DesignError):
        built(angle_deg)


LIMITED: list[tuple[str, float, float]] = [  # key, least, most
    ("body.stem_length_mm", 1e-6, 1e6),
    ("body.arm_length_mm", 1e-6, 1e6),
    ("body.arm_width_mm", 1e-6, 1e6),
    ("body.stem_curve_per_mm", -1e3, 1e3),
    ("lens.half_width_mm", 1e-6, 1e6),
    ("lens.focus_mm", 1e-6, 1e6),
    ("emitter.distance_mm", 1e-6, 1e6),
    ("emitter.offset_mm", -1e6, 1e6),
]


@pytest.mark.parametrize(("key", "least", "most"), LIMITED)
def test_huge_numbers_are_refused_by_the_design_in_one_line(key: str, least: float, most: float) -> None:
    for value in (1e200, 1e300, 1.001 * most, -1e300, least - 1e-3 * abs(least)):
        with pytest.raises(SpecError, match=key) as refusal:
            with_values(design(), {key: value})
        assert len(str(refusal.value).splitlines()) == 1


def test_a_pivot_out_of_reach_is_refused_by_the_design_in_one_line() -> None:
    with pytest.raises(SpecError, match=r"motion\.pivot") as refusal:
        with_values(design(), {"motion.pivot": [1e308, 1e308]})
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("lens", ["cartesian-oval", "none"])
@pytest.mark.parametrize(("key", "least", "most"), LIMITED)
def test_what_a_design_may_hold_is_built_or_refused_in_one_line(key: str, least: float, most: float, lens: str) -> None:
    table, _, name = key.partition(".")
    for value in (least, most):
        values: dict[str, Any] = {"lens": {"shape": lens}}
        values[table] = values.get(table, {}) | {name: value}
        for angle_deg in (0.0, 1.0, -60.0):
            built_or_refused(angle_deg, **values)


@pytest.mark.parametrize("pivot", [(1e6, 1e6), (-1e6, 0.0), (0.0, -1e6)])
def test_a_pivot_far_away_is_built_or_refused_in_one_line(pivot: Point) -> None:
    for angle_deg in (0.0, 1e-9, 1.0, -60.0):
        built_or_refused(angle_deg, motion={"pivot": list(pivot)})


def test_the_lens_given_is_the_one_built() -> None:
    lens = OvalLens(1.0, 15.0, 1.5, 1.5)
    assert y_body(design(), lens).face("lens").curve == lens.front
