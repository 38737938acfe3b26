"""The Y at rest and rotated: closed, simple and counter-clockwise, or refused in one line; faces, marks and joins."""

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

RIGHT_FACES = ("lens", "stem-right", "outer-right", "receiver-right", "inner-right")
LEFT_FACES = ("inner-left", "receiver-left", "outer-left", "stem-left")


def design(**tables: Any) -> Design:
    return Design.model_validate({"name": "test", "material": {"index": 1.44}} | tables)


def body_of(angle_deg: float = 0.0, **tables: Any) -> Body:
    y_design = design(**tables)
    return y_body(y_design, lens_of(y_design, 1.44), angle_deg)


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
def test_equal_geometry_shares_cached_body(tables: dict[str, Any], same: bool) -> None:
    body, other = body_of(1.5), body_of(1.5, **tables)
    assert (body is other) == same
    assert body is body_of(1.5)
    assert body is not body_of(1.25)
    if not same:
        assert body != other


def body_or_none(angle_deg: float, **tables: Any) -> Body | None:
    """Return the body, or None if it was refused in one line; no other error passes."""
    try:
        return body_of(angle_deg, **tables)
    except (DesignError, SpecError) as error:
        line = str(error)
    assert len(line.splitlines()) == 1
    return None


def mirror_distance_mm(first: Body, other: Body) -> float:
    """Return the largest distance of one body from the mirror image of another, sampled along each face."""
    swap = {"right": "left", "left": "right"}
    u, distances = np.linspace(0.0, 1.0, 33), [0.0]
    assert len(first.faces) == len(other.faces)
    for face in first.faces:
        part, _, side = face.name.partition("-")
        mirrored_curve = other.face(f"{part}-{swap[side]}" if side else part).curve
        difference = face.curve.points(u) - mirrored_curve.points(1.0 - u) * np.array([-1.0, 1.0])
        distances.append(float(np.hypot(*difference.T).max()))
    return max(distances)


def polygon(body: Body) -> shapely.Polygon:
    """Return the outline, sampled uniformly in the parameter of each curve, unlike the polyline that a body checks."""
    u = np.arange(300) / 300
    return shapely.Polygon(np.vstack([face.curve.points(u) for face in body.faces]))


def are_within(first: shapely.Polygon, second: shapely.Polygon, distance_mm: float) -> bool:
    """Return whether the Hausdorff distance of two outlines is at most a distance."""
    lines = (first.exterior, second.exterior)
    shapely.prepare(lines)
    corners = [shapely.points(line.coords) for line in lines]
    return all(shapely.dwithin(lines[i], corners[1 - i], distance_mm).all() for i in (0, 1))


@st.composite
def tables(draw: st.DrawFn) -> dict[str, Any]:
    """Draw designs similar to that of the paper and very different ones, many of which cannot be built."""
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
def test_body_is_closed_simple_and_counter_clockwise_or_refused(values: dict[str, Any], angle: float) -> None:
    body = body_or_none(angle, **values)
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
def test_opposite_rotations_are_mirror_images(values: dict[str, Any], angle: float) -> None:
    values["motion"]["pivot"] = "stem-base"
    opposite = {**values, "emitter": {**values["emitter"], "offset_mm": -values["emitter"]["offset_mm"]}}
    try:
        body = body_of(angle, **values)
    except DesignError:
        with pytest.raises(DesignError):
            body_of(-angle, **opposite)
        return
    other = body_of(-angle, **opposite)
    assert mirror_distance_mm(body, other) < 1e-9
    x, z = body.emitter.point
    assert math.dist(other.emitter.point, (-x, z)) < 1e-12
    assert other.emitter.axis_deg == -body.emitter.axis_deg


def test_faces_of_body_of_paper_in_order() -> None:
    assert tuple(face.name for face in body_of().faces) == RIGHT_FACES + LEFT_FACES


def test_dimensions_of_body_of_paper() -> None:
    body, y_design = body_of(), design()
    fork_right, fork_left = body.marks["fork-right"], body.marks["fork-left"]
    depth = body.marks["stem-base"][1]
    assert fork_right[0] - fork_left[0] == pytest.approx(2 * (2 + 0.004 * 16.2**2), abs=1e-12)
    assert fork_right[0] - fork_left[0] == pytest.approx(6.0995, abs=5e-5)
    assert fork_right[1] == pytest.approx(depth + 16.2, abs=1e-12)
    assert depth == pytest.approx(1.810852142230, abs=1e-11)
    assert arm_angle_deg(y_design) == pytest.approx(7.384, abs=5e-4)
    assert arm_angle_deg(design(body={"arm_angle_deg": 12.0})) == 12.0
    for side in ("right", "left"):
        outer, receiver, inner = (body.face(f"{part}-{side}").curve for part in ("outer", "receiver", "inner"))
        assert math.dist(outer.start, outer.end) == pytest.approx(22.2, abs=1e-12)
        assert math.dist(receiver.start, receiver.end) == pytest.approx(3.0, abs=1e-12)
        assert np.dot(outer.normal_at(outer.start), inner.normal_at(inner.start)) == pytest.approx(-1, abs=1e-12)
        assert np.dot(outer.normal_at(outer.start), receiver.normal_at(receiver.start)) == pytest.approx(0, abs=1e-12)


def test_default_arm_continues_stem_tangentially() -> None:
    stem, outer = body_of().face("stem-right").curve, body_of().face("outer-right").curve
    assert math.dist(stem.normal_at(stem.end), outer.normal_at(outer.start)) < 1e-12


def test_crotch_is_on_axis_at_ends_of_inner_edges() -> None:
    body = body_of()
    crotch = body.marks["crotch"]
    assert crotch[0] == 0.0
    assert body.face("inner-right").curve.end == crotch == body.face("inner-left").curve.start
    assert body.marks["fork-right"][1] - 3 < crotch[1] < body.face("receiver-right").curve.start[1]


def test_body_at_rest_is_symmetric() -> None:
    assert mirror_distance_mm(body_of(), body_of()) < 1e-12


def test_face_by_name() -> None:
    assert body_of().face("lens").name == "lens"
    with pytest.raises(KeyError, match="nose"):
        body_of().face("nose")


def test_lens_and_emitter_rotate_about_stem_base() -> None:
    rotated, rest = body_of(-3.0), body_of()
    base = rest.marks["stem-base"]
    motion = Rigid.about(base, -3.0)
    assert math.dist(rotated.face("lens").curve.start, motion.point(rest.face("lens").curve.start)) < 1e-12
    assert math.dist(rotated.emitter.point, motion.point(rest.emitter.point)) < 1e-12
    assert rotated.emitter.axis_deg == -3.0
    assert rotated.emitter.point[0] < 0  # below the pivot, a rotation to the right moves to the left
    for name in ("outer-right", "receiver-left", "inner-left"):
        assert rotated.face(name).curve == rest.face(name).curve


def test_emitter_is_fixed_if_it_is_the_pivot() -> None:
    rotated = body_of(2.0, motion={"pivot": "emitter"}, emitter={"offset_mm": 0.0})
    assert rotated.emitter.point == pytest.approx((0.0, -1.0), abs=1e-15)
    lens = rotated.face("lens").curve
    assert math.dist(lens.start, (0.0, -1.0)) == pytest.approx(math.hypot(2, 1 + rotated.marks["stem-base"][1]))


def test_rotates_about_specified_point() -> None:
    point: Point = (0.3, 1.0)
    rotated = body_of(1.5, motion={"pivot": list(point)})
    assert math.dist(rotated.emitter.point, point) == pytest.approx(math.dist((0.0, -1.0), point), abs=1e-12)


@pytest.mark.parametrize("lens", [{}, {"shape": "none"}])
def test_emitter_alone_rotates_about_fixed_body(lens: dict[str, Any]) -> None:
    motion = {"moves": ["emitter"]}
    rotated, rest = body_of(2.5, motion=motion, lens=lens), body_of(motion=motion, lens=lens)
    assert rotated.faces == rest.faces
    assert rotated.emitter != rest.emitter


def test_flat_face_is_fixed() -> None:
    flat = {"shape": "none"}
    rotated, rest = body_of(2.5, lens=flat), body_of(lens=flat)
    assert rotated.faces == rest.faces
    assert isinstance(rest.face("lens").curve, Segment)
    assert rotated.emitter.axis_deg == 2.5


@pytest.mark.parametrize("angle_deg", [3.0, -3.0])
def test_rotated_lens_is_joined_on_both_sides(angle_deg: float) -> None:
    assert {"join-right", "join-left"} <= {face.name for face in body_of(angle_deg).faces}
    raised_join = "join-right" if angle_deg > 0 else "join-left"
    join = body_of(angle_deg).face(raised_join).curve
    assert abs(join.start[0] - join.end[0]) == pytest.approx(
        2.7e-3 + 4e-5, abs=5e-5
    )  # 2 (1 − cos 3°), and the flare of the stem
    assert join.start[1] == pytest.approx(join.end[1], abs=1e-12)


@pytest.mark.parametrize("pivot", ["stem-base", "emitter", [0.0, 8.0]], ids=str)
@pytest.mark.parametrize("join", ["bridge", "seam", "smooth"])
def test_every_join_closes_outline_and_vanishes_at_rest(join: str, pivot: Any) -> None:
    motion = {"join": join, "pivot": pivot}
    rest = polygon(body_of())
    assert polygon(body_of(motion=motion)).equals(rest)
    for angle_deg in (-3.0, -0.3, -1e-3, -1e-5, -1e-7, 1e-9, 2.0):
        rotated = polygon(body_of(angle_deg, motion=motion))
        assert are_within(rotated, rest, 0.2 * abs(angle_deg) + 1e-5)


def test_seam_ends_at_corners_of_stem() -> None:
    body = body_of(-3.0, motion={"join": "seam", "pivot": "emitter"})
    corner = (2.0, body.marks["stem-base"][1])
    assert body.face("join-right").curve.end == corner
    assert body.face("join-left").curve.start == (-2.0, corner[1])
    assert body.face("join-left").curve.end[1] > corner[1] + 0.09


@pytest.mark.parametrize("angle_deg", [-3.0, -1e-3])
def test_smooth_join_is_tangent_to_lens_axis_and_stem(angle_deg: float) -> None:
    body = body_of(angle_deg, motion={"join": "smooth", "pivot": "emitter"})
    join, stem = body.face("join-right").curve, body.face("stem-right").curve
    start_angle, end_angle, side = (
        np.arctan2(*v) for v in (*join.velocities(np.array([0.0, 1.0])), stem.velocities(np.zeros(1))[0])
    )
    assert math.degrees(-start_angle) == pytest.approx(angle_deg, abs=1e-9)
    assert end_angle == pytest.approx(side, abs=1e-9)
    at_rest = body_of().face("stem-right").curve
    points = join.points(np.linspace(0.0, 1.0, 9))
    offset = points[:, 0] - np.interp(points[:, 1], *at_rest.points(np.linspace(0.0, 1.0, 20_001)).T[::-1])
    assert np.abs(offset).max() < 0.06 * abs(angle_deg) + 1e-6


def test_outline_changes_continuously_to_zero_angle() -> None:
    rest = polygon(body_of())
    for angle_deg in (1.0, 1e-1, 1e-2, 1e-4, 1e-6, 1e-7, 1e-8, 1e-10, 1e-14):
        for sign in (-1, 1):
            rotated = polygon(body_of(sign * angle_deg))
            assert rotated.symmetric_difference(rest).area < 0.2 * angle_deg + 1e-9
            assert are_within(rotated, rest, 0.05 * angle_deg + 1e-8)


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
def test_refuses_impossible_body_in_one_line(values: dict[str, Any], angle_deg: float, words: str) -> None:
    with pytest.raises(DesignError, match=words) as raised:
        body_of(angle_deg, **values)
    assert len(str(raised.value).splitlines()) == 1


def test_message_about_wide_arms_contains_exact_limit() -> None:
    with pytest.raises(DesignError, match="must be below") as raised:
        body_of(body={"arm_width_mm": 9.0})
    limit = float(str(raised.value).split("must be below ")[1].split()[0])
    assert body_of(body={"arm_width_mm": limit - 0.01}).area_mm2() > 0
    with pytest.raises(DesignError, match="arm_width_mm"):
        body_of(body={"arm_width_mm": limit + 0.01})


def test_message_about_arms_that_never_separate_has_no_negative_width() -> None:
    with pytest.raises(DesignError) as raised:
        body_of(body={"stem_curve_per_mm": -0.02, "arm_angle_deg": 8.0})
    assert "-" not in str(raised.value).split("must be")[-1].split("mm")[0]


@pytest.mark.parametrize("angle_deg", [math.nan, math.inf])
def test_refuses_angle_that_is_not_finite(angle_deg: float) -> None:
    with pytest.raises(DesignError):
        body_of(angle_deg)


LIMITS: list[tuple[str, float, float]] = [  # key, min_value, max_value
    ("body.stem_length_mm", 1e-6, 1e6),
    ("body.arm_length_mm", 1e-6, 1e6),
    ("body.arm_width_mm", 1e-6, 1e6),
    ("body.stem_curve_per_mm", -1e3, 1e3),
    ("lens.half_width_mm", 1e-6, 1e6),
    ("lens.focus_mm", 1e-6, 1e6),
    ("emitter.distance_mm", 1e-6, 1e6),
    ("emitter.offset_mm", -1e6, 1e6),
]


@pytest.mark.parametrize(("key", "min_value", "max_value"), LIMITS)
def test_design_refuses_huge_numbers_in_one_line(key: str, min_value: float, max_value: float) -> None:
    for value in (1e200, 1e300, 1.001 * max_value, -1e300, min_value - 1e-3 * abs(min_value)):
        with pytest.raises(SpecError, match=key) as raised:
            with_values(design(), {key: value})
        assert len(str(raised.value).splitlines()) == 1


def test_design_refuses_huge_pivot_in_one_line() -> None:
    with pytest.raises(SpecError, match=r"motion\.pivot") as raised:
        with_values(design(), {"motion.pivot": [1e308, 1e308]})
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize("lens", ["cartesian-oval", "none"])
@pytest.mark.parametrize(("key", "min_value", "max_value"), LIMITS)
def test_limits_are_built_or_refused_in_one_line(key: str, min_value: float, max_value: float, lens: str) -> None:
    table, _, name = key.partition(".")
    for value in (min_value, max_value):
        values: dict[str, Any] = {"lens": {"shape": lens}}
        values[table] = values.get(table, {}) | {name: value}
        for angle_deg in (0.0, 1.0, -60.0):
            body_or_none(angle_deg, **values)


@pytest.mark.parametrize("pivot", [(1e6, 1e6), (-1e6, 0.0), (0.0, -1e6)])
def test_distant_pivot_is_built_or_refused_in_one_line(pivot: Point) -> None:
    for angle_deg in (0.0, 1e-9, 1.0, -60.0):
        body_or_none(angle_deg, motion={"pivot": list(pivot)})


def test_builds_specified_lens() -> None:
    lens = OvalLens(1.0, 15.0, 1.5, 1.5)
    assert y_body(design(), lens).face("lens").curve == lens.front
