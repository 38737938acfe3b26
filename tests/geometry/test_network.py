"""Networks of guides: agreement with the Y, closed outlines that cover exactly their guides, and refused networks."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import shapely

from solen.curve import Arc, ArcLength, Parabola, Segment
from solen.errors import DesignError, SolenError, SpecError
from solen.geometry import Body, body_of, y_body
from solen.geometry.body import polyline
from solen.geometry.network import Plan, plan_of
from solen.lens import lens_of
from solen.plane import Rigid
from solen.spec import Design, dumps, loads, with_values
from tests.geometry.network_support import random_network, y_network

FLAT_MM = 1e-5
SIDE_RECEIVER = [{"name": "r", "guide": "out", "side": "left", "from_mm": 3.0, "to_mm": 4.0}]
PLACES = np.linspace(0.0, 1.0, 33)


def body_of_network(design: Design) -> Body:
    return body_of(design, None)


def y_design(**tables: Any) -> Design:
    return Design(name="y", material={"index": 1.44}, **tables)


Y_DESIGNS = {
    "paper": {},
    "narrow": {"body": {"stem_curve_per_mm": 0.003, "arm_width_mm": 2.3, "arm_angle_deg": 11.0}},
    "flat": {"lens": {"shape": "none", "half_width_mm": 1.7}},
}


@pytest.mark.parametrize("tables", Y_DESIGNS.values(), ids=list(Y_DESIGNS))
def test_network_of_y_is_identical(tables: Any) -> None:
    design = y_design(**tables)
    y, network = y_body(design, lens_of(design, 1.44)), body_of_network(y_network(design))
    assert [face.curve for face in network.faces] == [face.curve for face in y.faces]
    assert network.emitter == y.emitter


@pytest.mark.parametrize("angle_deg", [-7.0, 0.5])
def test_bent_network_of_y_agrees(angle_deg: float) -> None:
    design = y_design(motion={"kind": "bend"})
    bends = {"name": "bends", "kind": "bend", "part": "stem", "at_deg": angle_deg, "from_deg": -10.0, "to_deg": 10.0}
    y = y_body(design, lens_of(design, 1.44), angle_deg)
    network = body_of_network(y_network(design, fixed="fork", motion=[bends]))
    for face, y_face in zip(network.faces, y.faces, strict=True):
        distance = shapely.LineString(face.curve.flattened(1e-6)).hausdorff_distance(
            shapely.LineString(y_face.curve.flattened(1e-6))
        )
        assert distance < 1e-5, face.name
        assert np.allclose([face.curve.start, face.curve.end], [y_face.curve.start, y_face.curve.end], atol=2e-9)
    assert network.emitter.point == pytest.approx(y.emitter.point, abs=1e-10)
    assert network.emitter.axis_deg == pytest.approx(y.emitter.axis_deg, abs=1e-10)


@pytest.mark.parametrize("angle_deg", [-3.0, 1.0])
@pytest.mark.parametrize("join", ["seam", "bridge", "smooth"])
@pytest.mark.parametrize("pivot", [None, "emitter", (0.3, 0.0)])
def test_network_of_y_with_rotated_lens_agrees(angle_deg: float, join: str, pivot: Any) -> None:
    design = y_design(motion={"join": join} | ({} if pivot is None else {"pivot": pivot}))
    rotation = {"kind": "rotation", "at_deg": angle_deg, "join": join} | ({} if pivot is None else {"pivot": pivot})
    motion = [{"name": part, "part": part} | rotation for part in ("main",)]
    y, network = y_body(design, lens_of(design, 1.44), angle_deg), body_of_network(y_network(design, motion=motion))
    middles = [face.curve.middle_point for face in y.faces]
    assert np.allclose([face.curve.middle_point for face in network.faces], middles, atol=1e-12)
    ends = [(face.curve.start, face.curve.end) for face in y.faces]
    assert np.allclose([(face.curve.start, face.curve.end) for face in network.faces], ends, atol=1e-13)
    assert network.emitter.point == pytest.approx(y.emitter.point, abs=1e-13)


def test_bent_spline_keeps_length_and_turns_uniformly() -> None:
    points = {"at_mm": [3.0, 12.0], "through_mm": [[1.5, 5.0], [3.5, 8.0]]}
    tables: Any = {
        "nodes": [{"name": "n"}, {"name": "m", "at_mm": points["at_mm"]}],
        "guides": [{"name": "g", "nodes": ("n", "m"), "width_mm": [1.5, 0.02], "through_mm": points["through_mm"]}],
        "emitters": [{"name": "e", "node": "n"}],
        "receivers": [{"name": "r", "node": "m"}],
    }

    def bent_spine(at_deg: float, fixed: str = "n") -> Any:
        motion = {"name": "b", "kind": "bend", "part": "g", "from_deg": -40.0, "to_deg": 40.0, "at_deg": at_deg}
        design = Design(
            name="s",
            material={"index": 1.44},
            body={"kind": "network"},
            network=tables | {"motion": [motion], "fixed": fixed},
        )
        assert body_of_network(design).area_mm2() > 0.0
        return plan_of(design).paths["g"].spine

    rest, bent = bent_spine(0.0), bent_spine(25.0)
    assert bent.end_direction == pytest.approx(Rigid.about((0.0, 0.0), 25.0).vector(rest.end_direction), abs=1e-12)
    measure, wall = ArcLength(rest.free), ArcLength(bent.wall((0.0,), "g"))
    assert wall.length_mm == pytest.approx(measure.length_mm, abs=1e-8)
    for fraction in (0.3, 0.8):
        lines = [
            (spine.wall((0.0,), "g"), lengths.u_at(fraction * lengths.length_mm))
            for spine, lengths in ((rest, measure), (bent, wall))
        ]
        headings = [math.degrees(math.atan2(*line.velocity_at(u))) for line, u in lines]
        assert headings[0] - headings[1] == pytest.approx(25.0 * fraction, abs=1e-5)
    steps = (np.arange(9000) + 0.5) / 9000  # small steps, a third of them along each of the three cubics
    turn = math.radians(25.0) * measure.lengths_at(steps) / measure.length_mm
    (x, z), cos, sin = rest.free.velocities(steps).T, np.cos(turn), np.sin(turn)
    expected_end = np.array(rest.start) + np.column_stack([x * cos - z * sin, x * sin + z * cos]).mean(axis=0)
    assert np.allclose(expected_end, bent.end, atol=1e-6)
    assert bent_spine(25.0, "m").end == pytest.approx(rest.end, abs=1e-9)


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ({"part": "main", "pivot": (0.0, 60.0), "at_deg": 3.0}, r"would tear lens main from x = .*z = .*mm"),
        ({"part": "arm-left", "pivot": (0.0, -60.0), "at_deg": 3.0}, r"would tear arm-left from x = .*mm"),
        ({"part": "stem", "join": "bridge"}, r"motion\[0\]\.join = 'bridge'; applies only to a lens"),
        ({"part": "stem", "pivot": "emitter"}, r"motion\[0\]\.pivot = 'emitter'; applies only to a lens or an emitter"),
        ({"part": "stem", "kind": "bend", "pivot": (0.0, 1.0)}, r"pivot = .*does not apply to a bend"),
    ],
)
def test_refuses_invalid_motion_with_position(motion: dict[str, Any], message: str) -> None:
    with pytest.raises((SpecError, DesignError), match=message):
        body_of_network(y_network(y_design(), motion=[{"name": "m", "kind": "rotation"} | motion]))


def test_guide_rotates_about_pivot_with_parts_beyond() -> None:
    rotation = {"name": "m", "kind": "rotation", "part": "arm-left", "pivot": (-3.0, 18.0), "at_deg": 2.0}
    rest, moved = body_of_network(y_network(y_design())), body_of_network(y_network(y_design(), motion=[rotation]))
    turn = Rigid.about((-3.0, 18.0), 2.0)
    end = rest.face("receiver-left").curve
    assert moved.face("receiver-left").curve.start == pytest.approx(turn.point(end.start), abs=1e-12)
    assert moved.face("receiver-right").curve == rest.face("receiver-right").curve


def area_differences(plan: Plan, body: Body) -> tuple[float, float]:
    """Return the areas that a body lacks of the union of its guides, and that it has beyond the union.

    Areas added by corners are allowed: triangles between a node and two sections that do not meet, fillets and lenses.
    So is a section that protrudes on the far side of a narrower guide, within half its width of the node.
    """
    guides, corners = [], []
    for path in plan.paths.values():
        sides = [path.walls[side].flattened(FLAT_MM) for side in ("right", "left")]
        guides.append(shapely.Polygon(np.vstack([sides[0], sides[1][::-1]])).buffer(0.0))
    node_areas = [
        shapely.Point(at).buffer(0.5 * max(path.guide.widths[0] + 0.5 for path in plan.at(node)))
        for node, at in plan.positions.items()
    ]
    for face in body.all_faces:
        if face.part == "join":
            node = face.name.removeprefix("join-").split(".")[0]
            corners.append(shapely.Polygon([face.curve.start, face.curve.end, plan.positions[node]]).buffer(0.0))
        elif face.part in ("fillet", "lens"):
            corners.append(shapely.LineString(face.curve.flattened(FLAT_MM)).convex_hull.buffer(1.0))
    solid: shapely.Geometry = shapely.Polygon(polyline(body.faces, FLAT_MM))
    for hole in body.others:
        solid = shapely.difference(solid, shapely.Polygon(polyline(hole, FLAT_MM)))
    missing_mm2, extra_mm2 = shapely.difference(shapely.union_all(guides), solid), solid
    for place in node_areas:
        missing_mm2 = shapely.difference(missing_mm2, place)
    for part in (*guides, *corners):
        extra_mm2 = shapely.difference(extra_mm2, part)
    return float(shapely.area(missing_mm2)), float(shapely.area(extra_mm2))


def has_crossing(plan: Plan) -> bool:
    """Return whether guides that share no node overlap."""
    sides = {
        name: shapely.Polygon(
            np.vstack([path.walls["right"].flattened(1e-3), path.walls["left"].flattened(1e-3)[::-1]])
        )
        for name, path in plan.paths.items()
    }
    names = list(sides)
    pairs = ((a, b) for i, a in enumerate(names) for b in names[i + 1 :])
    return any(
        sides[a].buffer(0.0).intersects(sides[b].buffer(0.0))
        for a, b in pairs
        if not set(plan.paths[a].guide.nodes) & set(plan.paths[b].guide.nodes)
    )


def check_random(seeds: range) -> Iterator[Body]:
    for seed in seeds:
        design = random_network(seed)
        plan = plan_of(design)
        if has_crossing(plan):
            with pytest.raises(DesignError, match="intersects itself"):
                body_of_network(design)
            continue
        body = body_of_network(design)
        missing_mm2, extra_mm2 = area_differences(plan, body)
        assert missing_mm2 < 1e-3, (seed, missing_mm2)
        assert extra_mm2 < 1e-3, (seed, extra_mm2)
        yield body


def test_random_networks_cover_exactly_their_guides() -> None:
    assert len(list(check_random(range(5)))) >= 4


@pytest.mark.evidence
def test_two_hundred_random_networks_cover_exactly_their_guides() -> None:
    bodies = list(check_random(range(230)))
    print(
        f"{len(bodies)} of 230 random networks are closed, simple and cover their guides; in the others, guides cross"
    )
    assert len(bodies) >= 200


def test_walls_are_exact_curves() -> None:
    guides = [
        {"name": "a", "nodes": ("n", "m"), "width_mm": 2.0, "direction_deg": 0.0, "length_mm": 9.0, "turn_deg": 50.0},
        {"name": "b", "nodes": ("m", "o"), "width_mm": (2.0, 0.0, 0.02), "direction_deg": 50.0, "length_mm": 9.0},
    ]
    parts = {"emitters": [{"name": "e", "node": "n"}], "receivers": [{"name": "r", "node": "o"}]}
    tables = {"nodes": [{"name": name} for name in "nmo"], "guides": guides} | parts
    body = body_of_network(Design(name="arc", material={"index": 1.44}, body={"kind": "network"}, network=tables))
    right_arc, left_arc = body.face("a-right").curve, body.face("a-left").curve
    assert isinstance(right_arc, Arc)
    assert isinstance(left_arc, Arc)
    assert right_arc.radius_mm - left_arc.radius_mm == pytest.approx(2.0, abs=1e-12)
    assert right_arc.center == left_arc.center
    assert isinstance(body.face("b-right").curve, Parabola)
    assert body.emitter.point == pytest.approx((0.0, -1.0), abs=1e-15)


def test_loop_has_hole_and_refuses_bend() -> None:
    corners = {"a": (0.0, 0.0), "b": (12.0, 4.0), "c": (-8.0, 9.0), "d": (3.0, 20.0)}
    between = [("a", "b"), ("b", "d"), ("d", "c"), ("c", "a")]
    guides = [{"name": f"{m}{n}", "nodes": (m, n), "width_mm": 2.0} for m, n in between]
    guides.append({"name": "out", "nodes": ("d", "e"), "width_mm": 2.0, "direction_deg": 0.0, "length_mm": 6.0})
    nodes = [{"name": name, "at_mm": at, "fillet_mm": 0.5} for name, at in corners.items()] + [{"name": "e"}]
    tables: Any = {
        "nodes": nodes,
        "guides": guides,
        "emitters": [{"name": "e", "node": "e"}],
        "receivers": SIDE_RECEIVER,
    }
    design = Design(name="ring", material={"index": 1.44}, body={"kind": "network"}, network=tables)
    body, plan = body_of_network(design), plan_of(design)
    assert len(body.others) == 1
    assert max(area_differences(plan, body)) < 1e-6
    motion = {"name": "m", "kind": "bend", "part": "ab", "at_deg": 2.0}
    with pytest.raises(DesignError, match=r"tear .* at x = .*z = "):
        body_of_network(
            Design(
                name="ring", material={"index": 1.44}, body={"kind": "network"}, network=tables | {"motion": [motion]}
            )
        )
    bend = {"name": "m", "kind": "bend", "part": "out", "at_deg": 30.0, "from_deg": -30.0, "to_deg": 30.0}
    bent = body_of_network(
        Design(name="ring", material={"index": 1.44}, body={"kind": "network"}, network=tables | {"motion": [bend]})
    )
    assert bent.emitter.axis_deg == pytest.approx(body.emitter.axis_deg + 30.0)


def test_fillet_is_tangent_to_both_walls() -> None:
    design = y_network(y_design())
    body = body_of_network(with_values(design, {"network.nodes[1].fillet_mm": 0.05}))
    number = next(i for i, face in enumerate(body.faces) if face.part == "fillet")
    first, arc, second = (face.curve for face in body.faces[number - 1 : number + 2])
    assert isinstance(arc, Arc)
    for arriving, departing in ((first, arc), (arc, second)):
        along, onwards = np.array(arriving.velocity_at(1.0)), np.array(departing.velocity_at(0.0))
        assert np.dot(along, onwards) == pytest.approx(np.hypot(*along) * np.hypot(*onwards), rel=1e-12)


def test_network_design_round_trip() -> None:
    design = with_values(y_network(y_design()), {"network.lenses[0].focus_mm": 20.0, "lens.focus_mm": 25.0})
    reloaded = loads(dumps(design))
    assert reloaded == design
    assert reloaded.network.lenses[0].focus_mm == 20.0


INVALID = {
    "lens wider": (
        {"network.lenses[0].half_width_mm": 2.2},
        r"^network\.lenses\[0\]\.half_width_mm = 2\.2; .*2 mm.*x = ",
    ),
    "fillet": ({"network.nodes[1].fillet_mm": 30.0}, r"fillet_mm = 30\.0; .*room at x = "),
    "two names": (
        {"network.guides[2].name": "stem"},
        r"^network\.guides\[2\]\.name = 'stem'; is also the name of guides\[0\]",
    ),
    "unconnected": (
        {
            "network.nodes": [{"name": n} for n in ("base", "fork", "tip-right", "tip-left")]
            + [{"name": "x", "at_mm": [9.0, 1.0]}]
        },
        r"^network\.nodes\[4\] = 'x'; is not connected.*x = 9, z = 1",
    ),
    "unknown": (
        {"network.receivers[0].node": "tip"},
        r"^network\.receivers\[0\]\.node = 'tip'; is not the name of a node",
    ),
    "occupied": (
        {"network.receivers[1].node": "tip-right"},
        r"^network\.nodes\[2\] = 'tip-right'; right and left are on the same end, at x = ",
    ),
    "crowded": (
        {"network.receivers[1].node": "fork"},
        r"^network\.receivers\[1\]\.node = 'fork'; .*3 guides meet at x = ",
    ),
    "moved twice": (
        {"network.motion": [{"name": n, "kind": "bend", "part": "stem"} for n in "ab"]},
        r"^network\.motion\[1\]\.part = 'stem'; is already moved by a",
    ),
    "dark": (
        {"network.nodes[2].end": "mirror"},
        r"^network\.nodes\[2\]\.end = 'mirror'; .*right is at x = ",
    ),
    "in space": (
        {"lens.shape": "line-focus", "trace.dimension": "extruded", "emitter.pattern": "lambertian"},
        r"^lens\.shape = ",
    ),
    "measured": ({"lens.shape": "measured", "lens.profile": "lens.json"}, r"^lens\.(shape|profile) = "),
    "ambient": ({"ambient.power": 0.1}, r"^ambient\.power = 0\.1; does not apply with body\.kind"),
    "no receivers": ({"network.receivers": []}, r"^network\.receivers; is missing"),
    "face": ({"network.guides[0].name": "mirror-a"}, r"^network\.guides\[0\]\.name = 'mirror-a'; must not begin"),
}


@pytest.mark.parametrize(("values", "message"), INVALID.values(), ids=list(INVALID))
def test_refuses_invalid_network_with_position(values: Any, message: str) -> None:
    with pytest.raises((SpecError, DesignError), match=message):
        body_of_network(with_values(y_network(y_design()), values))


def test_refuses_crossing_guides_with_position() -> None:
    guides = [
        {"name": "a", "nodes": ("n", "m"), "width_mm": 2.0, "direction_deg": 0.0, "length_mm": 20.0},
        {"name": "b", "nodes": ("m", "o"), "width_mm": 2.0, "direction_deg": -120.0, "length_mm": 15.0},
        {"name": "c", "nodes": ("o", "p"), "width_mm": 2.0, "direction_deg": 90.0, "length_mm": 30.0},
    ]
    parts = {"emitters": [{"name": "e", "node": "n"}], "receivers": [{"name": "r", "node": "p"}]}
    tables = {"nodes": [{"name": name} for name in "nmop"], "guides": guides} | parts
    with pytest.raises(SolenError, match=r"intersects itself.* x = .*, where .* meet"):
        body_of_network(Design(name="arc", material={"index": 1.44}, body={"kind": "network"}, network=tables))


def test_lens_on_side_of_guide() -> None:
    design = y_network(y_design())
    lens = {"name": "aside", "guide": "arm-right", "side": "right", "at_mm": 10.0, "half_width_mm": 1.5}
    network = design.network.model_dump(exclude_defaults=True) | {
        "lenses": [{"name": "main", "node": "base"}, lens],
        "emitters": [{"name": "led", "lens": "main"}, {"name": "two", "lens": "aside"}],
        "lit": "two",
    }
    body = body_of_network(with_values(design, {"network": network}))
    wall, front = body.face("arm-right-right.1").curve, body.face("lens-aside").curve
    assert isinstance(wall, Segment)
    middle = np.mean([front.start, front.end], axis=0)
    assert math.dist(wall.start, middle) == pytest.approx(10.0, abs=1e-12)
    axis = np.array([-math.sin(math.radians(body.emitter.axis_deg)), math.cos(math.radians(body.emitter.axis_deg))])
    assert abs(float(axis @ np.subtract(wall.end, wall.start))) < 1e-12
