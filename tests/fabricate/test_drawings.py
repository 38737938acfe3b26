"""Drawings and point lists, read by solen, by ezdxf and by a simple parser, agree with the curves within 10 nm."""

import io
import math
import re
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from solen import __version__
from solen.curve import Arc, Bezier, Conic, Curve, Segment, Spline
from solen.errors import DesignError, OutputError
from solen.fabricate import area_mm2, as_comsol, as_dxf, as_svg, label_of, sensor_part
from solen.fabricate.numbers import numbered
from solen.geometry import Body, Face, Pose, outline_body
from solen.geometry.network import network_body
from solen.sensor import Sensor
from solen.spec import Design
from tests.curve.test_every_curve import distance_to
from tests.fabricate.solid_support import body_of, design, oval_distance_mm
from tests.geometry.network_support import three_guides

ezdxf = pytest.importorskip("ezdxf", reason="needs the extra dxf")

TOLERANCE_MM = 1e-5
WRITERS = {"dxf": as_dxf, "svg": as_svg}
both_kinds = pytest.mark.parametrize("kind", WRITERS)
LABEL = label_of(design(), "thickness 4 mm")


def read_back(body: Body, kind: str, folder: Path, **tables: Any) -> tuple[Design, Body]:
    """Write the drawing of a body, and return a design that uses it with the body of that design."""
    (folder / f"drawing.{kind}").write_bytes(WRITERS[kind](body, LABEL))
    values = {"body": {"kind": "outline", "file": f"drawing.{kind}"}, "material": {"index": 1.44}} | tables
    copy = Design.model_validate({"name": "copy", **values}).in_folder(folder)
    return copy, outline_body(copy)


@both_kinds
@pytest.mark.parametrize("index", [1.44, 1.54])
def test_the_drawing_of_a_sensor_is_accurate_to_10_nm(kind: str, index: float, tmp_path: Path) -> None:
    body = body_of(design(material__index=index))
    _, back = read_back(body, kind, tmp_path)
    assert [face.name for face in back.faces] == [face.name for face in body.faces]
    assert back.emitter.point == pytest.approx(body.emitter.point, abs=1e-11)
    assert back.marks["stem-base"] == pytest.approx(body.marks["stem-base"], abs=1e-11)
    u = np.linspace(0.0, 1.0, 2001)
    assert oval_distance_mm(back.face("lens").curve.points(u), index) < TOLERANCE_MM
    for face in body.faces:
        for x, z in back.face(face.name).curve.points(u[::400]).tolist():
            assert distance_to(face.curve, (x, z)) < TOLERANCE_MM
    assert area_mm2(back.outlines) == pytest.approx(area_mm2(body.outlines), abs=1e-6)


@both_kinds
def test_a_drawing_of_a_sensor_has_the_powers_of_the_sensor(kind: str, tmp_path: Path) -> None:
    values = {"material": {"index": 1.44}, "motion": {"moves": ["emitter"]}}
    original = Design.model_validate({"name": "original", **values})
    copy, _ = read_back(Sensor.of(original).body(), kind, tmp_path, motion={"moves": ["emitter"]})
    for angle_deg in (-3.0, 0.0, 1.0):
        expected, actual = (Sensor.of(each).integrate(angle_deg).detectors for each in (original, copy))
        for name in ("right", "left"):
            assert actual[name].power == pytest.approx(expected[name].power, abs=3e-6)


def shapes() -> list[Curve]:
    """Return an outline with the kinds of curve that do not occur in shipped designs."""
    conic = Conic((6.0, 1.0), (-1.0, 0.0), 0.4, -0.5, -1.0, 1.0)
    low, high = conic.start, conic.end
    convex = Arc.through((4.0, 4.0), (2.0, 5.0), (0.0, 4.0))
    concave = Arc.through((high[0], 2.0), (5.0, 2.5), (4.0, 4.0))
    wave = Spline(((0, 4), (0.5, 3), (-0.5, 3), (0, 2), (0.5, 1.0), (0.4, 0.5), (0, 0)))
    tail = Bezier((0.0, 0.0), (1.0, -1.0), (3.0, 1.0), (low[0], low[1]))
    return [conic, concave, convex, wave, tail]


def mixed_body() -> Body:
    """Return a body of that outline with a round hole, a separate receiver, and an emitter with a chip."""
    faces = tuple(Face(f"face-{i}", curve) for i, curve in enumerate(shapes()))
    hole = (Face("hole", Arc((2.0, 2.0), 0.5, 30.0, -360.0)),)
    separate = (Face("receiver-far", Segment((9.0, 0.0), (9.0, 2.0))),)
    return Body(faces, Pose((2.0, -3.0), 0.0, 0.2), {}, (hole,), separate)


@both_kinds
def test_drawings_of_all_kinds_of_curve_are_accurate_to_10_nm(kind: str, tmp_path: Path) -> None:
    body = mixed_body().check()
    copy, back = read_back(body, kind, tmp_path)
    assert len(back.outlines) == 2
    assert [face.name for face in back.separate] == ["receiver-far"]
    assert back.emitter.point == pytest.approx((2.0, -3.0), abs=1e-11)
    assert (back.emitter.axis_deg, back.emitter.width_mm) == pytest.approx((0.0, 0.2), abs=1e-9)
    tolerance_mm2 = 1e-6 * 2.5  # the conic is 2.5 mm long, and its B-spline accurate to 1 nm
    assert area_mm2(back.outlines) == pytest.approx(area_mm2(body.outlines), abs=tolerance_mm2)
    for face in back.all_faces:
        drawn = re.sub(r"\.\d+$", "", face.name)
        curve = body.face(drawn).curve
        for x, z in face.curve.points(np.linspace(0.0, 1.0, 7)).tolist():
            assert distance_to(curve, (x, z)) < TOLERANCE_MM
    assert Sensor.of(copy).body().faces == back.faces


def test_dxf_has_splines_on_layers_in_mm() -> None:
    document = ezdxf.read(io.StringIO(as_dxf(body_of(design()), LABEL).decode("utf-8")))
    assert document.header["$INSUNITS"] == 4
    properties = dict(document.header.custom_vars)
    assert (properties["Design"], properties["Design SHA-256"]) == (LABEL.name, LABEL.sha256)
    assert properties["Written by"] == f"written by solen {__version__}"
    entities = {(entity.dxf.layer, entity.dxftype()) for entity in document.modelspace()}
    assert {("lens", "SPLINE"), ("stem-right", "SPLINE"), ("outer-left", "LINE"), ("emitter", "POINT")} <= entities
    assert not document.audit().errors
    (lens,) = (entity for entity in document.modelspace() if entity.dxf.layer == "lens")
    tool = lens.construction_tool()
    points = tool.points(np.linspace(0.0, tool.max_t, 3001).tolist())
    assert oval_distance_mm(np.array([(point.x, point.y) for point in points])) < TOLERANCE_MM


def test_dxf_has_arcs_in_both_directions_and_circles() -> None:
    document = ezdxf.read(io.StringIO(as_dxf(mixed_body(), LABEL).decode("utf-8")))
    kinds = {(entity.dxf.layer, entity.dxftype()) for entity in document.modelspace()}
    assert {("face-1", "ARC"), ("face-2", "ARC"), ("hole", "CIRCLE"), ("emitter", "LINE")} <= kinds


def test_dxf_layers_have_valid_names() -> None:
    body = body_of(design())
    faces = tuple(Face(f'{face.name}: "a|b"', face.curve) for face in body.faces)
    document = ezdxf.read(io.StringIO(as_dxf(Body(faces, body.emitter, {}), LABEL).decode("utf-8")))
    assert {entity.dxf.layer for entity in document.modelspace()} >= {"lens- -a-b-"}
    assert not document.audit().errors


def test_svg_is_in_mm_and_names_the_faces() -> None:
    body = body_of(design())
    root = ET.fromstring(as_svg(body, LABEL))  # noqa: S314 - written by the test
    assert str(root.get("width")).endswith("mm")
    box = [float(number) for number in str(root.get("viewBox")).split()]
    assert float(str(root.get("width")).removesuffix("mm")) == box[2]
    low, high = body.outline(1e-3).min(axis=0), body.outline(1e-3).max(axis=0)
    assert box[0] < low[0]
    assert box[0] + box[2] > high[0]
    assert -box[1] > high[1], "y of SVG points downwards"
    space = "{http://www.w3.org/2000/svg}"
    assert [path.get("id") for path in root.iter(f"{space}path")] == [face.name for face in body.faces]
    assert LABEL.sha256 in str(root.findtext(f"{space}desc"))
    assert root.findtext(f"{space}title") == LABEL.name


def sections(text: str) -> tuple[NDArray[np.float64], NDArray[np.int64], list[tuple[str, int, int]]]:
    """Return coordinates, elements and named curves of a sectionwise file."""
    head, _, rest = text.partition("% Coordinates\n")
    coordinates, _, elements = rest.partition("% Elements (lines)\n")
    named = [
        (name, int(first), int(last))
        for name, first, last in re.findall(r"% Curve: (\S+), points (\d+) to (\d+)", head)
    ]
    rows = [[float(word) for word in line.split()] for line in coordinates.splitlines()]
    pairs = [[int(word) for word in line.split()] for line in elements.splitlines()]
    return np.array(rows), np.array(pairs), named


def spline_points(points: NDArray[np.float64], ends: Any, per_span: int = 9) -> NDArray[np.float64]:
    """Return points of a cubic spline through points, as a function of the length of the chords."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    fraction = np.linspace(0.0, 1.0, per_span, endpoint=False)
    positions = (length[:-1, None] + fraction * np.diff(length)[:, None]).ravel()
    return np.asarray(CubicSpline(length, points, bc_type=ends)(positions))


@pytest.mark.parametrize("index", [1.44, 1.49, 1.54])
@pytest.mark.parametrize("ends", ["natural", "not-a-knot"])
def test_comsol_points_and_splines_through_them_are_accurate_to_10_nm(index: float, ends: str) -> None:
    body = body_of(design(material__index=index))
    points, pairs, named = sections(as_comsol(body, LABEL).decode("ascii"))
    assert [name for name, _, _ in named] == [face.name for face in body.faces]
    for name, first, last in named:
        rows = points[first - 1 : last]
        inside = pairs[(pairs[:, 0] >= first) & (pairs[:, 1] <= last)]
        assert inside.tolist() == [[i, i + 1] for i in range(first, last)], "a polyline"
        curve = body.face(name).curve
        assert rows[[0, -1]] == pytest.approx(np.array([curve.start, curve.end]), abs=1e-12)
        if name == "lens":
            middles = (rows[1:] + rows[:-1]) / 2
            chord = np.diff(rows, axis=0)
            slope = np.abs(chord[:, 1] / chord[:, 0]).max()
            assert oval_distance_mm(middles, index) < TOLERANCE_MM * math.hypot(1.0, slope)
            assert oval_distance_mm(spline_points(rows, ends), index) < TOLERANCE_MM
        elif len(rows) > 2:
            for x, z in spline_points(rows, ends, 2)[::40].tolist():
                assert distance_to(curve, (x, z)) < TOLERANCE_MM
    assert len(pairs) == len(points) - len(named)


def test_comsol_files_state_unit_and_size() -> None:
    text = as_comsol(body_of(design()), LABEL).decode("ascii")
    points, pairs, _ = sections(text)
    assert "% Length unit: mm\n" in text
    assert f"% Nodes: {len(points)}\n" in text
    assert f"% Elements: {len(pairs)}\n" in text
    assert LABEL.sha256 in text


def test_comsol_files_contain_holes() -> None:
    _, pairs, named = sections(as_comsol(mixed_body(), LABEL).decode("ascii"))
    assert [name for name, _, _ in named] == [*(f"face-{i}" for i in range(5)), "hole"]
    assert pairs.min() == 1


@pytest.mark.parametrize("write", [as_dxf, as_svg, as_comsol])
def test_files_are_reproducible(write: Any) -> None:
    assert write(body_of(design()), LABEL) == write(body_of(design()), LABEL)


def test_the_extra_is_named_if_ezdxf_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(OutputError, match=r'^--dxf; .* is not installed; pip install "ezdxf\S+"$'):
        as_dxf(body_of(design()), LABEL)


@both_kinds
def test_drawings_number_and_list_the_parts_of_a_network(kind: str, tmp_path: Path) -> None:
    network = three_guides()
    body = network_body(network)
    parts = numbered(network, body)
    assert [(part.number, part.kind, part.name) for part in parts[:4]] == [
        (1, "guide", "trunk"),
        (2, "guide", "branch"),
        (3, "guide", "other"),
        (4, "lens", "main"),
    ]
    (tmp_path / f"drawing.{kind}").write_bytes(WRITERS[kind](body, LABEL, parts))
    text = (tmp_path / f"drawing.{kind}").read_text()
    assert all(part.row in text for part in parts)
    outline = shapely.Polygon(body.outline(1e-3))
    inside = {
        part.name: outline.contains(shapely.Point(part.position))
        for part in parts
        if part.kind in ("guide", "receiver")
    }
    assert inside == {"trunk": True, "branch": True, "other": True, "end": False, "side": False}
    keys = {"emitters": {"name", "lens"}, "lenses": {"name"}, "receivers": {"name"}}
    lists = {
        name: [table.model_dump(include=included) for table in getattr(network.network, name)]
        for name, included in keys.items()
    }
    values = {"body": {"kind": "network", "file": f"drawing.{kind}"}, "material": {"index": 1.44}, "network": lists}
    back = network_body(Design.model_validate({"name": "copy", **values}).in_folder(tmp_path))
    assert [face.name for face in back.faces] == [face.name for face in body.faces]


def test_refuses_a_pocket_on_a_curved_face() -> None:
    straight = three_guides(receivers=[{"name": "end", "node": "end"}])
    pockets = {"fabricate.pockets": True}
    curved = three_guides().set({"network.guides[0].width_mm": [3.0, 0.0, 0.004]})
    with pytest.raises(DesignError, match=r"receiver-side is curved at x = .*z = "):
        sensor_part(curved.set(pockets), network_body(curved))
    straight = straight.set(pockets | {"network.guides[2].width_mm": 4.0})
    assert len(sensor_part(straight, network_body(straight)).cuts) == 1
