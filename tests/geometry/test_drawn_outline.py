"""Drawn outlines in DXF, SVG and JSON: closed bodies with named faces, or errors with the position of the fault."""

import json
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.curve import Arc, Bezier, Curve, Segment, Spline
from solen.errors import DataError, DesignError, SolenError
from solen.geometry import Body, outline_body
from solen.geometry.drawing import read_drawing
from solen.plane import Point
from solen.sensor import Sensor
from solen.spec import Design, dumps, load, save

ezdxf = pytest.importorskip("ezdxf")

HEIGHT, HALF_WIDTH = 20.0, 2.0
SAG = 6.25 - math.sqrt(6.25**2 - HALF_WIDTH**2)
LENS_DEG = (math.degrees(math.atan2(SAG - 6.25, -HALF_WIDTH)), math.degrees(math.atan2(SAG - 6.25, HALF_WIDTH)))


def design(file: Path | str, **tables: Any) -> Design:
    body = {"kind": "outline", "file": str(file)} | tables.pop("body", {})
    return Design.model_validate({"name": "test", "material": {"index": 1.49}, "body": body} | tables)


def body_of(file: Path, angle_deg: float = 0.0, **tables: Any) -> Body:
    return outline_body(design(file, **tables), angle_deg)


def error_line(file: Path, **tables: Any) -> str:
    with pytest.raises(SolenError) as raised:
        body_of(file, **tables)
    line = str(raised.value)
    assert len(line.splitlines()) == 1
    return line


Drawer = Callable[[Any], None]


def dxf(path: Path, *draws: Drawer, units: int | None = 4) -> Path:
    """Write a DXF file with the strokes drawn into a new modelspace, by default in mm; return its path."""
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = units or 0
    for draw in draws:
        draw(document.modelspace())
    document.saveas(path)
    return path


def line(layer: str, *points: Point) -> Drawer:
    def draw(space: Any) -> None:
        for a, b in pairwise(points):
            space.add_line(a, b, dxfattribs={"layer": layer})

    return draw


def lens(space: Any) -> None:
    space.add_arc((0, 6.25), 6.25, *LENS_DEG, dxfattribs={"layer": "Lens"})


SIDES = (
    line("wall", (HALF_WIDTH, SAG), (3.0, HEIGHT)),
    line("receiver-right", (3.0, HEIGHT), (0.2, HEIGHT)),
    line("wall", (0.2, HEIGHT), (0.0, 19.0), (-0.2, HEIGHT)),
    line("receiver-left", (-0.2, HEIGHT), (-3.0, HEIGHT)),
    line("wall", (-3.0, HEIGHT), (-HALF_WIDTH, SAG)),
)
EMITTER = line("emitter", (-0.1, -2.0), (0.1, -2.0))


@pytest.fixture
def sensor_dxf(tmp_path: Path) -> Path:
    return dxf(tmp_path / "sensor.dxf", SIDES[3], lens, *SIDES[:3], SIDES[4], EMITTER)


def test_reads_dxf_with_named_faces_in_any_order(sensor_dxf: Path) -> None:
    body = body_of(sensor_dxf)
    names = ["lens", "wall.1", "receiver-right", "wall.2", "wall.3", "receiver-left", "wall.4"]
    assert [face.name for face in body.faces] == names
    assert [face.part for face in body.faces][:3] == ["lens", "wall", "receiver"]
    assert body.face("receiver-left").label == "left"
    front = body.face("lens").curve
    assert isinstance(front, Arc)
    assert front.center == pytest.approx((0.0, 6.25), abs=1e-12)
    assert front.radius_mm == pytest.approx(6.25, abs=1e-12)
    for face, following in pairwise((*body.faces, body.faces[0])):
        assert math.dist(face.curve.end, following.curve.start) < 1e-11


def test_emitter_line_is_chip_facing_body(sensor_dxf: Path) -> None:
    emitter = body_of(sensor_dxf).emitter
    assert emitter.point == (0.0, -2.0)
    assert emitter.width_mm == pytest.approx(0.2)
    assert emitter.axis_deg == pytest.approx(0.0, abs=1e-12)


def test_design_may_specify_emitter_position(sensor_dxf: Path, tmp_path: Path) -> None:
    specified = body_of(sensor_dxf, emitter={"point_mm": [0.5, -1.0], "axis_deg": 10.0}).emitter
    assert (specified.point, specified.axis_deg, specified.width_mm) == ((0.5, -1.0), 10.0, 0.0)
    decentred = body_of(sensor_dxf, emitter={"offset_mm": 0.05}).emitter
    assert decentred.point == pytest.approx((0.05, -2.0))
    dark = dxf(tmp_path / "dark.dxf", lens, *SIDES)
    assert error_line(dark).startswith("emitter; the drawing contains 0")
    assert body_of(dark, emitter={"point_mm": [0.0, -2.0]}).emitter.axis_deg == 0.0


def cad(path: Path, units: int = 1, scale: float = 25.4) -> Path:
    """Write a DXF file as CAD programs do: in inches, with blocks, splines, bulges, ellipses, mirrored planes, text."""

    def at(*points: Point) -> list[Point]:
        return [(x / scale, y / scale) for x, y in points]

    def draw(space: Any) -> None:
        document = space.doc
        document.layers.add("WALL")
        document.layers.add("Hidden").off()
        space.add_spline(dxfattribs={"layer": "LENS"}).set_open_uniform(at((-2, 1), (-1, -0.4), (1, -0.4), (2, 1)), 3)
        block = document.blocks.new("ARMS")
        (ends,) = [at((2, 1), (4, 9), (4, 20), (1, 20))]
        block.add_lwpolyline([(*ends[0], 0.1), (*ends[1], 0.0), (*ends[2], 0.0)], format="xyb")
        space.add_blockref("ARMS", (0, 0), dxfattribs={"layer": "WALL"})
        space.add_line(*at((4, 20), (1, 20)), dxfattribs={"layer": "Receiver-Right"})
        top = at((0, 20))[0]
        space.add_ellipse(top, (-1 / scale, 0), 0.5, 0, math.pi, dxfattribs={"layer": "WALL"})
        space.add_line(*at((-1, 20), (-4, 20)), dxfattribs={"layer": "Receiver-Left"})
        space.add_line(*at((-4, 20), (-4, 9)), dxfattribs={"layer": "WALL"})
        curve = space.add_spline(dxfattribs={"layer": "WALL"})
        curve.set_open_rational(at((-4, 9), (-3.5, 5), (-2, 1)), weights=[1, 0.8, 1], degree=2)
        flat = space.add_circle(at((0, 10))[0], 0.5 / scale, dxfattribs={"layer": "MIRROR", "extrusion": (0, 0, -1)})
        flat.dxf.center = (-flat.dxf.center[0], flat.dxf.center[1], 0)
        space.add_point(at((0, -1.5))[0], dxfattribs={"layer": "EMITTER"})
        space.add_point(at((0, 1))[0], dxfattribs={"layer": "PIVOT"})
        space.add_text("a note", dxfattribs={"layer": "WALL"})
        space.add_line((0, 0), (9, 9), dxfattribs={"layer": "Hidden"})
        space.add_line((0, 0), (9, 9), dxfattribs={"layer": "_axis"})

    return dxf(path, draw, units=units)


def test_reads_dxf_with_conventions_of_cad_programs(tmp_path: Path) -> None:
    body = body_of(cad(tmp_path / "cad.dxf"))
    kinds = {face.name: type(face.curve) for face in body.all_faces}
    assert kinds.pop("mirror") is Arc
    assert set(kinds.values()) == {Bezier, Segment, Arc, Spline}
    assert kinds["lens"] is Bezier
    assert {"receiver-right", "receiver-left"} <= set(kinds)
    assert body.marks["stem-base"] == pytest.approx((0.0, 1.0), abs=1e-12)
    front = body.face("lens").curve
    assert isinstance(front, Bezier)
    assert np.array(front.controls[0]) == pytest.approx(np.array([[-2, 1], [-1, -0.4], [1, -0.4], [2, 1]]), abs=1e-12)
    low, high = body.outline().min(axis=0), body.outline().max(axis=0)
    assert high == pytest.approx((4.0, 20.0), abs=2e-3)
    assert low[0] == pytest.approx(-4.0, abs=1e-6)
    assert len(body.outlines) == 2


def test_design_overrides_unit_of_header(tmp_path: Path) -> None:
    inches = body_of(cad(tmp_path / "inches.dxf"))
    wrong = body_of(cad(tmp_path / "wrong.dxf", units=4), body={"units": "in"})
    assert wrong.area_mm2() == pytest.approx(inches.area_mm2(), rel=1e-12)
    line = error_line(cad(tmp_path / "silent.dxf", units=0))
    assert "does not specify its unit" in line
    assert line.endswith('body.units = "mm"')


def distance_mm(curve: Curve, points: list[Point]) -> float:
    dense = curve.points(np.linspace(0.0, 1.0, 20_001))
    return max(float(np.hypot(*(dense - np.asarray(point)).T).min()) for point in points)


def test_ellipse_and_rational_spline_are_within_tolerance(tmp_path: Path) -> None:
    """The points satisfy the equations of the ellipse, and of the circle that the rational spline represents."""

    def draw(space: Any) -> None:
        space.add_ellipse((1, 2), (3, 0), 0.5, dxfattribs={"layer": "a"})
        spline = space.add_spline(dxfattribs={"layer": "b"})
        corner = math.sqrt(0.5)
        points = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
        weights = [1, corner, 1, corner, 1, corner, 1, corner, 1]
        knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
        spline.dxf.degree = 2
        spline.control_points = [(2 * x, 2 * y, 0) for x, y in points]
        spline.weights, spline.knots = weights, knots

    curves = {s.name: s.curve for s in read_drawing(dxf(tmp_path / "round.dxf", draw)).strokes}
    u = np.linspace(0.0, 1.0, 1001)
    x, z = (curves["a"].points(u) - np.array([1.0, 2.0])).T
    assert np.abs(np.hypot(x / 3.0, z / 1.5) - 1.0).max() < 1e-8
    assert np.abs(np.hypot(*curves["b"].points(u).T) - 2.0).max() < 1e-8


def test_fifth_degree_spline_follows_de_boor_points(tmp_path: Path) -> None:
    points = [(0, 0), (1, 3), (2, -2), (4, 4), (5, 0), (6, 3), (8, 1)]

    def draw(space: Any) -> None:
        space.add_spline(dxfattribs={"layer": "a"}).set_open_uniform(points, degree=5)

    (stroke,) = read_drawing(dxf(tmp_path / "five.dxf", draw)).strokes
    from scipy.interpolate import BSpline

    knots = [0.0] * 6 + [1.0] + [2.0] * 6
    exact = BSpline(np.array(knots), np.array(points, dtype=float), 5)(np.linspace(0.0, 2.0, 33))
    assert (
        distance_mm(stroke.curve, [(float(x), float(z)) for x, z in exact]) < 1e-3
    )  # the spacing of the 20,001 points
    assert stroke.curve.start == pytest.approx((0.0, 0.0), abs=1e-12)


def test_refuses_open_outline_with_position_and_gap(tmp_path: Path) -> None:
    open_file = dxf(
        tmp_path / "open.dxf", lens, *SIDES[:4], line("wall", (-3.0, HEIGHT), (-HALF_WIDTH, SAG + 0.25)), EMITTER
    )
    message = error_line(open_file)
    assert message.startswith("body outline; is open at the end of ")
    assert "(x = -2, " in message
    assert "0.25 mm from the end of" in message
    assert "lens" in message
    assert "wall" in message


@pytest.mark.parametrize(
    ("layer", "intended"),
    [
        ("Reciever-Right", "receiver-right"),
        ("receivers", "receiver"),
        ("receiverright", "receiver-right"),
        ("miror", "mirror"),
        ("balck_3", "black-3"),
        ("emiter", "emitter"),
    ],
)
def test_refuses_misspelt_reserved_name(tmp_path: Path, layer: str, intended: str) -> None:
    """A misspelt receiver, mirror or black face would be a bare wall, and a misspelt emitter an open outline."""
    draws = [lens, *SIDES[:3], line(layer, (-0.2, HEIGHT), (-3.0, HEIGHT)), SIDES[4], EMITTER]
    message = error_line(dxf(tmp_path / "slip.dxf", *draws))
    assert message.startswith(
        f"name in the drawing = {layer.lower()!r}; is read as a bare wall; did you mean {intended}?"
    )


def test_refuses_misspelt_emitter_point(tmp_path: Path) -> None:
    def point(space: Any) -> None:
        space.add_point((0.0, -1.0), dxfattribs={"layer": "emmiter"})

    assert "did you mean emitter?" in error_line(dxf(tmp_path / "slip.dxf", lens, *SIDES, point))


@pytest.mark.parametrize(
    "layer", ["back", "block-2", "wall", "front", "lense", "detector", "reflector", "path1234", "0"]
)
def test_other_names_are_bare_walls(tmp_path: Path, layer: str) -> None:
    draws = [lens, line(layer, (HALF_WIDTH, SAG), (3.0, HEIGHT)), *SIDES[1:], EMITTER]
    assert "receiver" in {face.part for face in body_of(dxf(tmp_path / "named.dxf", *draws)).all_faces}


def test_joins_gaps_within_tolerance(tmp_path: Path) -> None:
    sloppy = dxf(
        tmp_path / "sloppy.dxf", lens, *SIDES[:4], line("wall", (-3.0, HEIGHT), (-HALF_WIDTH, SAG + 5e-4)), EMITTER
    )
    for face, following in pairwise(body_of(sloppy).faces):
        assert math.dist(face.curve.end, following.curve.start) < 1e-11
    large_gap = dxf(
        tmp_path / "wide.dxf", lens, *SIDES[:4], line("wall", (-3.0, HEIGHT), (-HALF_WIDTH, SAG + 5e-3)), EMITTER
    )
    assert "open at the end" in error_line(large_gap)
    assert body_of(large_gap, body={"join_mm": 0.01}).area_mm2() == pytest.approx(body_of(sloppy).area_mm2(), rel=1e-3)


def test_refuses_intersecting_outline_with_position(tmp_path: Path) -> None:
    crossing = (line("wall", (HALF_WIDTH, SAG), (-3.5, 12.0), (3.0, HEIGHT)), *SIDES[1:])
    message = error_line(dxf(tmp_path / "crossing.dxf", lens, *crossing, EMITTER))
    assert message.startswith("body outline; intersects itself at x = -2.")
    assert "wall.1 and wall.5 meet" in message or "wall.2 and wall.5 meet" in message


def test_refuses_duplicate_and_branch_with_position(tmp_path: Path) -> None:
    duplicate = error_line(dxf(tmp_path / "twice.dxf", lens, *SIDES, SIDES[1], EMITTER))
    assert duplicate.startswith("body outline; receiver-right is drawn twice")
    assert "x = 1.6, z = 20 mm" in duplicate
    branch = error_line(dxf(tmp_path / "branch.dxf", lens, *SIDES, line("wall", (3.0, HEIGHT), (5.0, 25.0)), EMITTER))
    assert "open at the end of wall" in branch
    theta = dxf(tmp_path / "theta.dxf", lens, *SIDES, line("wall", (HALF_WIDTH, SAG), (-HALF_WIDTH, SAG)), EMITTER)
    assert "3 curves meet at x = " in error_line(theta)


def test_orientation_of_holes_and_separate_bodies(tmp_path: Path) -> None:
    def rings(space: Any) -> None:
        space.add_circle((0, 10), 1.0, dxfattribs={"layer": "hole"})
        space.add_circle((0, 10), 0.5, dxfattribs={"layer": "core"})
        space.add_circle((9, 10), 1.0, dxfattribs={"layer": "post"})

    body = body_of(dxf(tmp_path / "rings.dxf", rings, lens, *SIDES, EMITTER))
    sweeps = {face.name: face.curve.sweep_deg for face in body.all_faces if isinstance(face.curve, Arc)}
    assert (sweeps["hole"], sweeps["core"], sweeps["post"]) == (-360.0, 360.0, 360.0)
    plain = body_of(dxf(tmp_path / "whole.dxf", lens, *SIDES, EMITTER))
    assert body.area_mm2() == pytest.approx(plain.area_mm2() + math.pi * (-1 + 0.25 + 1), abs=2e-2)


def test_receivers_and_mirrors_may_be_in_air(tmp_path: Path) -> None:
    sides = (SIDES[0], line("end", (3.0, HEIGHT), (0.2, HEIGHT)), *SIDES[2:])
    separate = (line("receiver-far", (0.2, 20.5), (3.0, 20.5)), line("mirror", (5.0, 0.0), (5.0, 20.0)))
    file = dxf(tmp_path / "apart.dxf", lens, *sides, *separate, EMITTER)
    body = body_of(file)
    assert {face.name for face in body.separate} == {"receiver-far", "mirror"}
    receiver = body.face("receiver-far").curve
    assert receiver.normal_at(receiver.start) == pytest.approx((0.0, -1.0), abs=1e-12)  # it faces the body
    rotated = body_of(file, -10.0, motion={"moves": ["mirrors"], "pivot": [5.0, 0.0]})
    assert rotated.face("mirror").curve.end == pytest.approx(
        (5.0 + 20.0 * math.sin(math.radians(10.0)), 20.0 * math.cos(math.radians(10.0)))
    )
    assert rotated.face("receiver-far") == body.face("receiver-far")
    inside = dxf(tmp_path / "inside.dxf", lens, *SIDES, line("mirror", (0.0, 5.0), (9.0, 5.0)), EMITTER)
    assert error_line(inside).startswith("mirror; must be in air, but touches the body")


def test_rotates_emitter_but_not_part_of_outline(sensor_dxf: Path) -> None:
    rotated, rest = body_of(sensor_dxf, 3.0, motion={"pivot": [0.0, SAG]}), body_of(sensor_dxf)
    assert rotated.faces == rest.faces
    assert rotated.emitter.axis_deg == pytest.approx(3.0)
    assert math.dist(rotated.emitter.point, (0.0, SAG)) == pytest.approx(2.0 + SAG)
    moves = {"motion": {"moves": ["lens", "emitter"]}}
    assert body_of(sensor_dxf, 0.0, **moves).faces == rest.faces
    with pytest.raises(DesignError, match="would tear lens from wall"):
        body_of(sensor_dxf, 1.0, **moves)
    with pytest.raises(DesignError, match="no face that begins with mirror"):
        body_of(sensor_dxf, 1.0, motion={"moves": ["mirrors"]})


def test_rotates_separate_lens_with_emitter(tmp_path: Path) -> None:
    def ball(space: Any) -> None:
        space.add_circle((0, -3), 1.0, dxfattribs={"layer": "lens-ball"})

    flat = line("front", (-HALF_WIDTH, SAG), (HALF_WIDTH, SAG))
    emitter_line = line("emitter", (-0.1, -5.0), (0.1, -5.0))
    file = dxf(tmp_path / "ball.dxf", flat, *SIDES, ball, emitter_line)
    rotated = body_of(file, 5.0, motion={"moves": ["lens", "emitter"], "pivot": [0.0, 0.0]})
    lens_curve = rotated.face("lens-ball").curve
    assert isinstance(lens_curve, Arc)
    assert lens_curve.center == pytest.approx((3 * math.sin(math.radians(5)), -3 * math.cos(math.radians(5))))


@pytest.mark.parametrize("angle_deg", [0.0, 5.0, -20.0])
def test_bends_outline_between_two_heights(sensor_dxf: Path, angle_deg: float) -> None:
    motion = {"kind": "bend", "bend_mm": [2.0, 14.0]}
    body, rest = body_of(sensor_dxf, angle_deg, motion=motion), body_of(sensor_dxf)
    if angle_deg == 0.0:
        assert body.faces == rest.faces
        return
    assert body.face("receiver-right") == rest.face("receiver-right")
    assert body.emitter.axis_deg == pytest.approx(angle_deg)
    front = body.face("lens").curve
    assert isinstance(front, Arc)
    assert front.radius_mm == pytest.approx(6.25, abs=1e-12)
    kinds = [type(face.curve) for face in body.faces if face.name.startswith("wall.1")]
    assert kinds == [Segment, Spline, Segment]


def test_wall_tables_match_names_with_or_without_number(sensor_dxf: Path) -> None:
    wall = {"outside": "skin", "index": 1.4, "depth_mm": 0.1}
    body = body_of(sensor_dxf, wall=[{"face": "wall", "finish": "black"}, {"face": "wall.1", "to_mm": 5.0, **wall}])
    covered = {face.name: face.wall for face in body.faces if face.wall is not None}
    assert covered == {"wall.1.1": 1, "wall.1.2": 0, "wall.2": 0, "wall.3": 0, "wall.4": 0}


SVG = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"
 width="80mm" height="250mm" viewBox="-40 -230 80 250">
<g id="layer1" inkscape:label="Wall" inkscape:groupmode="layer">
<path id="path12" d="M 20,{z} L 30,-200 M 2,-200 0,-190 l -2 -10 M -30,-200 L -20,{z}"/>
<path id="lens" d="M -20 {z} A 62.5 62.5 0 0 0 20 {z}"/>
<line class="receiver-right" x1="30" y1="-200" x2="2" y2="-200"/>
<line class="receiver-left" x1="-30" y1="-200" x2="-2" y2="-200" id="line7"/></g>
<line id="emitter" x1="-1" y1="20" x2="1" y2="20"/>
<rect id="note-frame" x="-40" y="-230" width="80" height="250"/><text x="0" y="0">a note</text></svg>"""


def test_svg_and_dxf_of_same_outline_agree(sensor_dxf: Path, tmp_path: Path) -> None:
    file = tmp_path / "sensor.svg"
    text = SVG.format(z=-10 * SAG).replace('height="250mm"', 'height="25mm"').replace('width="80mm"', 'width="8mm"')
    file.write_text(text, encoding="utf-8")
    body, dxf_body = body_of(file), body_of(sensor_dxf)
    assert {face.label for face in body.faces} == {face.label for face in dxf_body.faces}
    assert [face.part for face in body.faces] == [face.part for face in dxf_body.faces]
    for svg_face, dxf_face in zip(body.faces, dxf_body.faces, strict=True):
        u = np.linspace(0.0, 1.0, 9)
        assert svg_face.curve.points(u) == pytest.approx(dxf_face.curve.points(u), abs=1e-9)
    assert body.emitter.width_mm == pytest.approx(0.2)
    assert body.emitter.point == pytest.approx((0.0, -2.0))


def test_smoothly_joined_curves_of_path_are_one_face(tmp_path: Path) -> None:
    """The path has two cubics and a quadratic without a corner between them, then a corner and a single cubic."""
    path = "M0 0C1 -1 2 -1 3 0C4 1 5 1 6 0Q7 -1 8 0C8 -2 9 -4 8 -5L0 -5Z"
    file = tmp_path / "smooth.svg"
    svg = f'<svg width="20mm" height="20mm" viewBox="0 0 20 20"><path id="edge" d="{path}"/>'
    file.write_text(svg + '<circle class="emitter" cx="4" cy="3" r="0.1"/></svg>', encoding="utf-8")
    faces = body_of(file).faces
    kinds = sorted((type(face.curve).__name__, len(getattr(face.curve, "controls", ()))) for face in faces)
    assert kinds == [("Bezier", 1), ("Segment", 0), ("Segment", 0), ("Spline", 3)]


def test_refuses_svg_without_unit_or_with_distortion(tmp_path: Path) -> None:
    file = tmp_path / "px.svg"
    file.write_text(SVG.format(z=-10 * SAG).replace('"80mm"', '"80"').replace('"250mm"', '"250"'), encoding="utf-8")
    assert "does not specify its unit" in error_line(file)
    assert body_of(file, body={"units": "um"}).area_mm2() > 0.0
    file.write_text(SVG.format(z=0).replace('"80mm"', '"160mm"'), encoding="utf-8")
    assert "distorts the drawing" in error_line(file)


def test_reads_any_curve_from_json_exactly(tmp_path: Path) -> None:
    corners: list[Point] = [(-2.0, 0.0), (2.0, 0.0), (2.5, 8.0), (-2.5, 8.0)]
    names = ["lens", "wall", "receiver-3", "wall"]
    faces: list[dict[str, Any]] = [
        {"name": name, "curve": {"kind": "segment", "a": a, "b": b}}
        for name, (a, b) in zip(names, pairwise([*corners, corners[0]]), strict=True)
    ]
    parabola: dict[str, Any] = {
        "kind": "parabola",
        "vertex": [2.0, 0.0],
        "axis": [0.0, 1.0],
        "curve_per_mm": 0.5 / 64,
        "from_mm": 0.0,
        "to_mm": 8.0,
    }
    faces[1]["curve"] = parabola
    data = {"solen_outline": 1, "faces": faces, "emitters": [{"point": [0.0, -1.0], "width_mm": 0.3}]}
    file = tmp_path / "own.json"
    file.write_text(json.dumps(data), encoding="utf-8")
    body = body_of(file)
    assert [face.name for face in body.faces] == ["lens", "wall.1", "receiver-3", "wall.2"]
    assert body.face("receiver-3").label == "3"
    assert body.emitter.width_mm == 0.3
    parabola["to_mm"] = 7.9999
    file.write_text(json.dumps(data), encoding="utf-8")
    shorter = body_of(file)  # the segment is deformed to meet the exact curve
    assert shorter.face("receiver-3").curve.start == shorter.face("wall.1").curve.end
    faces[2]["curve"] = parabola | {"vertex": [2.5, 8.0], "axis": [-1.0, 0.0], "to_mm": 5.0, "curve_per_mm": 0.0}
    file.write_text(json.dumps(data), encoding="utf-8")
    assert "a Parabola from x = 2.5, z = 8 mm does not meet its neighbours" in error_line(file)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.step", "", "must end in .dxf, .svg, .json"),
        ("a.dxf", "not a drawing", "cannot be read as DXF"),
        ("a.svg", "<svg", "not SVG"),
        ("a.svg", "<html/>", "must be an SVG file"),
        ("a.svg", '<svg width="1mm" height="1mm"><path d="M 0 0 L 1"/></svg>', "command L requires another"),
        ("a.svg", '<svg width="1mm"><g transform="turn(3)"><path d="M0 0L1 1"/></g></svg>', "transform = 'turn(3)'"),
        ("a.svg", '<svg width="1mm"></svg>', "contains no curves"),
        ("a.svg", '<svg width="1mm"><circle class="emitter" cx="1"/></svg>', "has no size"),
        ("a.svg", '<svg width="1mm" viewBox="0 0 0 0"><path d="M0 0L1 1"/></svg>', "must have a size above 0"),
        ("a.svg", '<svg width="1mm"><path d="M0 0L1e300 1"/></svg>', "between ±1e+09"),
        ("a.json", "{", "not valid JSON"),
        ("a.json", "{}", "solen_outline is missing"),
        ("a.json", '{"solen_outline": 1, "faces": [{"name": "a"}]}', "faces[0]: curve; is missing"),
        ("a.json", '{"solen_outline": 2, "faces": []}', "must be 1 for this version of solen"),
        ("a.json", '{"solen_outline": 1, "faces": [], "emitters": [{"pt": 1}]}', "emitters[0]: pt; unknown key"),
    ],
)
def test_refuses_invalid_drawing_in_one_line(tmp_path: Path, name: str, text: str, words: str) -> None:
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    assert words in error_line(file)


def test_refuses_missing_file(tmp_path: Path) -> None:
    assert "no such file" in error_line(tmp_path / "none.dxf")


def test_outline_file_is_relative_to_design(sensor_dxf: Path) -> None:
    folder = sensor_dxf.parent
    (folder / "sensor.toml").write_text(dumps(design("sensor.dxf")), encoding="utf-8")
    loaded = load(folder / "sensor.toml")
    assert loaded.outline_file == sensor_dxf
    (folder / "other").mkdir()
    moved = load(save(folder / "other" / "sensor.toml", loaded))
    assert moved.body.file == "../sensor.dxf"
    assert outline_body(moved).faces == outline_body(loaded).faces


def test_traces_other_receivers_but_refuses_response(tmp_path: Path) -> None:
    sides = (SIDES[0], line("receiver-top", (3.0, HEIGHT), (-3.0, HEIGHT)), SIDES[4])
    sensor = Sensor.of(design(dxf(tmp_path / "one.dxf", lens, *sides, EMITTER)))
    sensor.check()
    result = sensor.trace(0.0, "power")
    assert set(result.detectors) == {"top"}
    assert result.detectors["top"].power > 0.3
    assert result.ledger.total == pytest.approx(1.0, abs=1e-9)
    with pytest.raises(DesignError, match="receivers = 'top'; a response needs two, right and left"):
        sensor.count([0.0])
    with pytest.raises(DesignError, match="the lens of an outline is drawn"):
        _ = sensor.lens


def test_reading_error_is_data_error(tmp_path: Path) -> None:
    with pytest.raises(DataError):
        read_drawing(tmp_path / "none.svg")
