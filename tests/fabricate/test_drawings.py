"""Drawings and points: read back by solen's own reader, by ezdxf, by a plain parser, all within 10 nm of the curves."""

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
from tests.fabricate.solid_support import body_of, design, off_the_oval_mm
from tests.geometry.network_support import three_guides

ezdxf = pytest.importorskip("ezdxf", reason="needs the extra dxf")

NEAR_MM = 1e-5
"""10 nm."""
WRITERS = {"dxf": as_dxf, "svg": as_svg}
both = pytest.mark.parametrize("kind", WRITERS)
LABEL = label_of(design(), "thickness 4 mm")


def read_back(body: Body, kind: str, folder: Path, **tables: Any) -> tuple[Design, Body]:
    """Body of a drawing that was written, by solen's own door for outlines."""
    (folder / f"own.{kind}").write_bytes(WRITERS[kind](body, LABEL))
    told = {"body": {"kind": "outline", "file": f"own.{kind}"}, "material": {"index": 1.44}} | tables
    chosen = Design.model_validate({"name": "read back", **told}).in_folder(folder)
    return chosen, outline_body(chosen)


@both
@pytest.mark.parametrize("index", [1.44, 1.54])
def test_a_sensor_comes_back_within_10_nm(kind: str, index: float, tmp_path: Path) -> None:
    body = body_of(design(material__index=index))
    _, back = read_back(body, kind, tmp_path)
    assert [face.name for face in back.faces] == [face.name for face in body.faces]
    assert back.emitter.point == pytest.approx(body.emitter.point, abs=1e-11)
    assert back.marks["stem-base"] == pytest.approx(body.marks["stem-base"], abs=1e-11)
    u = np.linspace(0.0, 1.0, 2001)
    assert off_the_oval_mm(back.face("lens").curve.points(u), index) < NEAR_MM
    for face in body.faces:
        for x, z in back.face(face.name).curve.points(u[::400]).tolist():
            assert distance_to(face.curve, (x, z)) < NEAR_MM
    assert area_mm2(back.outlines) == pytest.approx(area_mm2(body.outlines), abs=1e-6)


@both
def test_a_drawing_traces_as_the_sensor_does(kind: str, tmp_path: Path) -> None:
    values = {"material": {"index": 1.44}, "motion": {"moves": ["emitter"]}}
    own = Design.model_validate({"name": "own", **values})
    chosen, _ = read_back(Sensor.of(own).body(), kind, tmp_path, motion={"moves": ["emitter"]})
    for angle_deg in (-3.0, 0.0, 1.0):
        ours, theirs = (Sensor.of(one).integrate(angle_deg) for one in (own, chosen))
        for name in ("right", "left"):
            assert theirs.detectors[name].power == pytest.approx(ours.detectors[name].power, abs=3e-6)


def shapes() -> list[Curve]:
    """An outline with a curve of every kind that the shipped designs lack."""
    conic = Conic((6.0, 1.0), (-1.0, 0.0), 0.4, -0.5, -1.0, 1.0)
    low, high = conic.start, conic.end
    bow = Arc.through((4.0, 4.0), (2.0, 5.0), (0.0, 4.0))
    bay = Arc.through((high[0], 2.0), (5.0, 2.5), (4.0, 4.0))
    wave = Spline(((0, 4), (0.5, 3), (-0.5, 3), (0, 2), (0.5, 1.0), (0.4, 0.5), (0, 0)))
    tail = Bezier((0.0, 0.0), (1.0, -1.0), (3.0, 1.0), (low[0], low[1]))
    return [conic, bay, bow, wave, tail]


def motley() -> Body:
    """That outline with a round hole, a receiver in the air and a chip that looks at it."""
    faces = tuple(Face(f"face-{i}", curve) for i, curve in enumerate(shapes()))
    hole = (Face("hole", Arc((2.0, 2.0), 0.5, 30.0, -360.0)),)
    apart = (Face("receiver-far", Segment((9.0, 0.0), (9.0, 2.0))),)
    return Body(faces, Pose((2.0, -3.0), 0.0, 0.2), {}, (hole,), apart)


@both
def test_every_kind_of_curve_comes_back(kind: str, tmp_path: Path) -> None:
    body = motley().check()
    chosen, back = read_back(body, kind, tmp_path)
    assert len(back.outlines) == 2
    assert [face.name for face in back.separate] == ["receiver-far"]
    assert back.emitter.point == pytest.approx((2.0, -3.0), abs=1e-11)
    assert (back.emitter.axis_deg, back.emitter.width_mm) == pytest.approx((0.0, 0.2), abs=1e-9)
    fitted_mm2 = 1e-6 * 2.5  # the conic is 2.5 mm long, its B-spline within 1 nm
    assert area_mm2(back.outlines) == pytest.approx(area_mm2(body.outlines), abs=fitted_mm2)
    for face in back.all_faces:
        drawn = re.sub(r"\.\d+$", "", face.name)
        curve = body.face(drawn).curve
        for x, z in face.curve.points(np.linspace(0.0, 1.0, 7)).tolist():
            assert distance_to(curve, (x, z)) < NEAR_MM
    assert Sensor.of(chosen).body().faces == back.faces


def test_dxf_holds_splines_on_layers_in_mm() -> None:
    document = ezdxf.read(io.StringIO(as_dxf(body_of(design()), LABEL).decode("utf-8")))
    assert document.header["$INSUNITS"] == 4
    told = dict(document.header.custom_vars)
    assert (told["Design"], told["Design SHA-256"]) == (LABEL.name, LABEL.sha256)
    assert told["Written by"] == f"written by solen {__version__}"
    entities = {(entity.dxf.layer, entity.dxftype()) for entity in document.modelspace()}
    assert {("lens", "SPLINE"), ("stem-right", "SPLINE"), ("outer-left", "LINE"), ("emitter", "POINT")} <= entities
    assert not document.audit().errors
    (lens,) = (one for one in document.modelspace() if one.dxf.layer == "lens")
    tool = lens.construction_tool()
    places = tool.points(np.linspace(0.0, tool.max_t, 3001).tolist())
    assert off_the_oval_mm(np.array([(p.x, p.y) for p in places])) < NEAR_MM


def test_dxf_holds_arcs_of_either_way_and_whole_circles() -> None:
    document = ezdxf.read(io.StringIO(as_dxf(motley(), LABEL).decode("utf-8")))
    kinds = {(entity.dxf.layer, entity.dxftype()) for entity in document.modelspace()}
    assert {("face-1", "ARC"), ("face-2", "ARC"), ("hole", "CIRCLE"), ("emitter", "LINE")} <= kinds


def test_layers_have_names_that_dxf_allows() -> None:
    body = body_of(design())
    faces = tuple(Face(f'{face.name}: "a|b"', face.curve) for face in body.faces)
    document = ezdxf.read(io.StringIO(as_dxf(Body(faces, body.emitter, {}), LABEL).decode("utf-8")))
    assert {entity.dxf.layer for entity in document.modelspace()} >= {"lens- -a-b-"}
    assert not document.audit().errors


def test_svg_is_in_mm_and_names_its_faces() -> None:
    body = body_of(design())
    root = ET.fromstring(as_svg(body, LABEL))  # noqa: S314  it is our own
    assert str(root.get("width")).endswith("mm")
    box = [float(number) for number in str(root.get("viewBox")).split()]
    assert float(str(root.get("width")).removesuffix("mm")) == box[2]
    low, high = body.outline(1e-3).min(axis=0), body.outline(1e-3).max(axis=0)
    assert box[0] < low[0]
    assert box[0] + box[2] > high[0]
    assert -box[1] > high[1], "z up is y down"
    space = "{http://www.w3.org/2000/svg}"
    assert [path.get("id") for path in root.iter(f"{space}path")] == [face.name for face in body.faces]
    assert LABEL.sha256 in str(root.findtext(f"{space}desc"))
    assert root.findtext(f"{space}title") == LABEL.name


def sections(text: str) -> tuple[NDArray[np.float64], NDArray[np.int64], list[tuple[str, int, int]]]:
    """Coordinates, elements and named curves of a sectionwise text, read without solen."""
    head, _, rest = text.partition("% Coordinates\n")
    coordinates, _, elements = rest.partition("% Elements (lines)\n")
    named = [
        (name, int(first), int(last))
        for name, first, last in re.findall(r"% Curve: (\S+), points (\d+) to (\d+)", head)
    ]
    rows = [[float(word) for word in line.split()] for line in coordinates.splitlines()]
    pairs = [[int(word) for word in line.split()] for line in elements.splitlines()]
    return np.array(rows), np.array(pairs), named


def through(points: NDArray[np.float64], ends: Any, per_span: int = 9) -> NDArray[np.float64]:
    """Points of a cubic spline over the length of the chords."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    share = np.linspace(0.0, 1.0, per_span, endpoint=False)
    at = (length[:-1, None] + share * np.diff(length)[:, None]).ravel()
    return np.asarray(CubicSpline(length, points, bc_type=ends)(at))


@pytest.mark.parametrize("index", [1.44, 1.49, 1.54])
@pytest.mark.parametrize("ends", ["natural", "not-a-knot"])
def test_comsol_points_and_splines_through_them_are_within_10_nm(index: float, ends: str) -> None:
    body = body_of(design(material__index=index))
    points, pairs, named = sections(as_comsol(body, LABEL).decode("ascii"))
    assert [name for name, _, _ in named] == [face.name for face in body.faces]
    for name, first, last in named:
        rows = points[first - 1 : last]
        inside = pairs[(pairs[:, 0] >= first) & (pairs[:, 1] <= last)]
        assert inside.tolist() == [[i, i + 1] for i in range(first, last)], "one line from end to end"
        curve = body.face(name).curve
        assert rows[[0, -1]] == pytest.approx(np.array([curve.start, curve.end]), abs=1e-12)
        if name == "lens":
            middles = (rows[1:] + rows[:-1]) / 2
            chord = np.diff(rows, axis=0)
            slope = np.abs(chord[:, 1] / chord[:, 0]).max()
            assert off_the_oval_mm(middles, index) < NEAR_MM * math.hypot(1.0, slope)
            assert off_the_oval_mm(through(rows, ends), index) < NEAR_MM
        elif len(rows) > 2:
            for x, z in through(rows, ends, 2)[::40].tolist():
                assert distance_to(curve, (x, z)) < NEAR_MM
    assert len(pairs) == len(points) - len(named)


def test_comsol_text_says_its_unit_and_its_size() -> None:
    text = as_comsol(body_of(design()), LABEL).decode("ascii")
    points, pairs, _ = sections(text)
    assert "% Length unit: mm\n" in text
    assert f"% Nodes: {len(points)}\n" in text
    assert f"% Elements: {len(pairs)}\n" in text
    assert LABEL.sha256 in text


def test_comsol_text_holds_holes_too() -> None:
    _, pairs, named = sections(as_comsol(motley(), LABEL).decode("ascii"))
    assert [name for name, _, _ in named] == [*(f"face-{i}" for i in range(5)), "hole"]
    assert pairs.min() == 1


@pytest.mark.parametrize("write", [as_dxf, as_svg, as_comsol])
def test_the_same_design_gives_the_same_file(write: Any) -> None:
    assert write(body_of(design()), LABEL) == write(body_of(design()), LABEL)


def test_without_ezdxf_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(OutputError, match=r'^--dxf; .* is not installed; pip install "ezdxf\S+"$'):
        as_dxf(body_of(design()), LABEL)


@both
def test_parts_of_a_network_have_numbers_and_a_table(kind: str, tmp_path: Path) -> None:
    network = three_guides()
    body = network_body(network)
    parts = numbered(network, body)
    assert [(one.number, one.kind, one.name) for one in parts[:4]] == [
        (1, "guide", "trunk"),
        (2, "guide", "branch"),
        (3, "guide", "other"),
        (4, "lens", "main"),
    ]
    (tmp_path / f"own.{kind}").write_bytes(WRITERS[kind](body, LABEL, parts))
    text = (tmp_path / f"own.{kind}").read_text()
    assert all(one.row in text for one in parts)
    outline = shapely.Polygon(body.outline(1e-3))
    inside = {
        one.name: outline.contains(shapely.Point(one.place)) for one in parts if one.kind in ("guide", "receiver")
    }
    assert inside == {"trunk": True, "branch": True, "other": True, "end": False, "side": False}
    keys = {"emitters": {"name", "lens"}, "lenses": {"name"}, "receivers": {"name"}}
    lists = {key: [one.model_dump(include=own) for one in getattr(network.network, key)] for key, own in keys.items()}
    told = {"body": {"kind": "network", "file": f"own.{kind}"}, "material": {"index": 1.44}, "network": lists}
    back = network_body(Design.model_validate({"name": "read back", **told}).in_folder(tmp_path))
    assert [face.name for face in back.faces] == [face.name for face in body.faces]


def test_a_pocket_on_a_curved_side_is_refused_with_its_place() -> None:
    straight = three_guides(receivers=[{"name": "end", "node": "end"}])
    pockets = {"fabricate.pockets": True}
    curved = three_guides().set({"network.guides[0].width_mm": [3.0, 0.0, 0.004]})
    with pytest.raises(DesignError, match=r"receiver-side'; is curved at x = .*z = "):
        sensor_part(curved.set(pockets), network_body(curved))
    straight = straight.set(pockets | {"network.guides[2].width_mm": 4.0})
    assert len(sensor_part(straight, network_body(straight)).cuts) == 1
