"""A bend: none at zero angle, arcs of straight walls, and closed outlines at any angle."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from solen.arrays import FloatArray
from solen.curve import Arc, ArcLength, Curve, Parabola, Segment, Spline
from solen.errors import DesignError
from solen.geometry import Body, bend_of, bent, y_body
from solen.geometry.bend import BEND_TOLERANCE_MM
from solen.lens import lens_of
from solen.plane import Point, heading
from solen.spec import Design

S_LINE = [[0.0, 0.0], [0.5, 3.0], [-0.5, 8.0], [0.0, 12.0]]
HOOK = [[0.0, 0.0], [0.1, 4.0], [0.8, 8.0], [3.0, 11.0]]


def design(**tables: Any) -> Design:
    return Design.model_validate({"name": "test", "material": {"index": 1.44}} | tables)


def bent_body(angle_deg: float, motion: dict[str, Any] | None = None, **tables: Any) -> Body:
    sensor_design = design(motion={"kind": "bend"} | (motion or {}), **tables)
    return y_body(sensor_design, lens_of(sensor_design, 1.44), angle_deg)


def straight_body(**tables: Any) -> Body:
    sensor_design = design(**tables)
    return y_body(sensor_design, lens_of(sensor_design, 1.44), 0.0)


def integrated_position(x: float, z: float, angle_deg: float, from_mm: float, to_mm: float) -> Point:
    """Return the position of a point in a uniform bend, by straight steps down the centre line from the fork."""
    steps = 20_000
    step_mm = (to_mm - z) / steps
    turns = np.radians(angle_deg * (np.arange(steps) + 0.5) * step_mm / (to_mm - from_mm))
    axis_point = (float(step_mm * np.sin(turns).sum()), to_mm - float(step_mm * np.cos(turns).sum()))
    turn = math.radians(angle_deg * (to_mm - z) / (to_mm - from_mm))
    return (axis_point[0] + x * math.cos(turn), axis_point[1] + x * math.sin(turn))


def test_bend_by_zero_is_straight_body() -> None:
    for motion in ({}, {"centre_line": HOOK}):
        assert bent_body(0.0, motion) == straight_body()


@pytest.mark.parametrize("motion", [{}, {"centre_line": HOOK}, {"centre_line": S_LINE}])
def test_vanishing_bend_is_straight_body(motion: dict[str, Any]) -> None:
    u, rest = np.linspace(0.0, 1.0, 65), straight_body()
    for angle_deg in (1e-13, -1e-13):
        for face, straight_face in zip(bent_body(angle_deg, motion).faces, rest.faces, strict=True):
            assert np.abs(face.curve.points(u) - straight_face.curve.points(u)).max() < 1e-12


@pytest.mark.parametrize("angle_deg", [-3.0, 10.0, 60.0])
def test_straight_wall_becomes_exact_arc(angle_deg: float) -> None:
    body = bent_body(angle_deg, body={"stem_curve_per_mm": 0.0, "arm_angle_deg": 8.0})
    base = straight_body(body={"stem_curve_per_mm": 0.0, "arm_angle_deg": 8.0}).marks["stem-base"][1]
    for name, x in (("stem-right", 2.0), ("stem-left", -2.0)):
        wall = body.face(name).curve
        assert isinstance(wall, Arc)
        assert wall.radius_mm == pytest.approx(abs(16.2 / math.radians(angle_deg) - x), rel=1e-14)
        for z in (base, base + 5.0, base + 16.2):
            position = integrated_position(x, z, angle_deg, base, base + 16.2)
            assert math.dist(position, wall.center) == pytest.approx(wall.radius_mm, abs=2e-7)
    assert body.marks["stem-base"] == pytest.approx(
        integrated_position(0.0, base, angle_deg, base, base + 16.2), abs=2e-7
    )


@pytest.mark.parametrize("angle_deg", [-3.0, 0.5, 25.0])
def test_flared_wall_becomes_spline_within_tolerance(angle_deg: float) -> None:
    base = straight_body().marks["stem-base"][1]
    bend = bend_of(None, base, base + 16.2, angle_deg)
    wall = straight_body().face("stem-right").curve
    spline = bent_body(angle_deg).face("stem-right").curve
    assert isinstance(spline, Spline)
    positions = bend.bent_points(wall.points(np.linspace(0.0, 1.0, 501)))
    assert max_distance_mm(spline, positions) <= BEND_TOLERANCE_MM
    x, z = wall.points(np.array([0.3]))[0]
    position = bend.bent_points(np.array([[x, z]]))[0]
    assert position == pytest.approx(integrated_position(float(x), float(z), angle_deg, base, base + 16.2), abs=1e-6)


def max_distance_mm(curve: Curve, points: FloatArray) -> float:
    """Return the largest distance of points from a curve, along its normals through them."""
    distances = []
    for x, z in points:
        point = (float(x), float(z))
        normal = curve.normal_at(point)
        back = (point[0] - normal[0], point[1] - normal[1])
        distances.append(min((abs(t - 1.0) for t in curve.hits(back, normal)), default=math.dist(point, curve.end)))
    return max(distances)


def test_lens_and_emitter_move_with_base_and_arms_are_fixed() -> None:
    body, rest = bent_body(-3.0), straight_body()
    assert body.emitter.axis_deg == -3.0
    base = body.marks["stem-base"]
    assert base[0] < 0.0  # the stem leans to the right: its base moves to the left
    depth = rest.marks["stem-base"][1]
    direction = heading(-3.0)
    assert math.dist(body.emitter.point, base) == pytest.approx(1.0 + depth, abs=1e-12)
    assert body.emitter.point[0] == pytest.approx(base[0] - (1.0 + depth) * direction[0], abs=1e-12)
    for name in ("outer-right", "receiver-left", "inner-left"):
        assert body.face(name).curve == rest.face(name).curve


@pytest.mark.parametrize("motion", [{}, {"centre_line": HOOK}, {"centre_line": S_LINE}])
def test_centre_line_keeps_length_and_sections_stay_perpendicular(motion: dict[str, Any]) -> None:
    bend = bend_of(motion.get("centre_line"), 1.0, 13.0, 20.0)
    z = np.linspace(1.0, 13.0, 2001)
    line = bend.bent_points(np.column_stack([np.zeros_like(z), z]))
    assert float(np.hypot(*np.diff(line, axis=0).T).sum()) == pytest.approx(12.0, abs=1e-6)
    for height in (1.0, 4.2, 11.0):
        at, above, beside = bend.bent_points(np.array([[0.0, height], [0.0, height + 1e-6], [1.0, height]]))
        along, sideways = (above - at) / 1e-6, beside - at
        assert float(np.hypot(*sideways)) == pytest.approx(1.0, abs=1e-12)
        assert float(along @ sideways) == pytest.approx(0.0, abs=1e-6)
        section = bend.section_motion(height)
        assert section.point((1.0, height)) == pytest.approx(tuple(beside), abs=1e-12)


def test_follows_drawn_centre_line_at_its_own_angle() -> None:
    """At the angle by which the drawn line turns, the bent axis is that line, scaled to the length of the stem."""
    line = Spline.through(HOOK)
    first, last = (heading_deg(line, u) for u in (0.0, 1.0))
    measure = ArcLength(line)
    bend = bend_of([(x, z) for x, z in HOOK], 0.0, measure.length_mm, first - last)
    turn = math.radians(last)
    for fraction in (0.0, 0.3, 0.8):
        x, z = line.points(np.array([measure.u_at(fraction * measure.length_mm)]))[0] - np.asarray(line.end)
        drawn_point = (x * math.cos(turn) + z * math.sin(turn), -x * math.sin(turn) + z * math.cos(turn))
        bent_point = bend.bent_points(np.array([[0.0, fraction * measure.length_mm]]))[0] - np.array(
            [0.0, measure.length_mm]
        )
        assert bent_point == pytest.approx(drawn_point, abs=1e-6)


def heading_deg(line: Spline, u: float) -> float:
    x, z = line.velocities(np.array([u]))[0]
    return math.degrees(math.atan2(-x, z))


def bent_body_or_none(angle_deg: float, motion: dict[str, Any], **tables: Any) -> Body | None:
    try:
        return bent_body(angle_deg, motion, **tables)
    except DesignError:
        return None


@settings(max_examples=50, deadline=None)
@example(angle=5e-324, length=8.0, curve=0.0, centre_line=None, shape="none")
@given(
    angle=st.floats(-60, 60),
    length=st.floats(8, 40),
    curve=st.floats(-0.002, 0.01),
    centre_line=st.sampled_from([None, HOOK, S_LINE]),
    shape=st.sampled_from(["cartesian-oval", "none"]),
)
def test_bent_outlines_are_closed_and_simple(
    angle: float, length: float, curve: float, centre_line: list[list[float]] | None, shape: str
) -> None:
    motion = {} if centre_line is None else {"centre_line": centre_line}
    tables = {
        "body": {"stem_length_mm": length, "stem_curve_per_mm": curve, "arm_angle_deg": 12.0, "arm_width_mm": 1.5},
        "lens": {"shape": shape},
    }
    body = bent_body_or_none(angle, motion, **tables)
    if body is None:
        rest = bent_body_or_none(0.0, motion, **tables)
        # if the crotch reaches far down, the fixed inner edges of the arms leave the stem no room to bend
        assert abs(angle) > 20.0 or rest is None or rest.marks["crotch"][1] < rest.marks["fork-left"][1] - 0.25 * length
        return
    for face, following in pairwise((*body.faces, body.faces[0])):
        assert math.dist(face.curve.end, following.curve.start) < 1e-11
    assert body.area_mm2() > 0.0


def test_refuses_bend_that_folds_inner_wall() -> None:
    with pytest.raises(DesignError, match="folds the inner wall over"):
        bent_body(80.0, body={"stem_length_mm": 2.0, "arm_angle_deg": 8.0, "stem_curve_per_mm": 0.0})


def test_refuses_straight_centre_line() -> None:
    with pytest.raises(DesignError, match=r"motion\.centre_line; must change direction"):
        bent_body(3.0, {"centre_line": [[0, 0], [0, 1], [0, 2]]})


def test_divides_curve_at_ends_of_bent_segment() -> None:
    bend = bend_of(None, 2.0, 8.0, 12.0)
    below, within, above = bent(Segment((1.5, 0.0), (1.5, 10.0)), bend)
    assert [type(piece) for piece in (below, within, above)] == [Segment, Arc, Segment]
    assert below.end == pytest.approx(within.start, abs=1e-12)
    assert within.end == pytest.approx(above.start, abs=1e-12)
    assert above == Segment((1.5, 8.0), (1.5, 10.0))
    assert math.dist(below.start, below.end) == pytest.approx(2.0, abs=1e-12)
    horizontal = bent(Segment((-1.0, 5.0), (1.0, 5.0)), bend)
    assert len(horizontal) == 1
    assert isinstance(horizontal[0], Segment)
    crossing = bent(Parabola((0.0, 0.0), (1.0, 0.0), 0.5, -5.0, 5.0), bend)
    assert len(crossing) == 1 or all(a.end == pytest.approx(b.start, abs=1e-11) for a, b in pairwise(crossing))


def test_limits_of_wall_table_move_with_material() -> None:
    wall = [{"face": "stem-right", "from_mm": 4.0, "to_mm": 8.0}]
    rest, body = straight_body(wall=wall), bent_body(5.0, wall=wall)
    names = [face.name for face in body.faces if face.name.startswith("stem-right")]
    assert names == ["stem-right.1", "stem-right.2", "stem-right.3"]
    assert ArcLength(rest.face("stem-right.1").curve).length_mm == pytest.approx(4.0, abs=1e-9)
    assert ArcLength(rest.face("stem-right.2").curve).length_mm == pytest.approx(4.0, abs=1e-9)
    assert body.face("stem-right.2").wall == 0
    assert body.face("stem-right.1").wall is None
    base = rest.marks["stem-base"][1]
    bend = bend_of(None, base, base + 16.2, 5.0)
    start = rest.face("stem-right.2").curve.start
    assert body.face("stem-right.2").curve.start == pytest.approx(
        tuple(bend.bent_points(np.array([start]))[0]), abs=1e-12
    )
