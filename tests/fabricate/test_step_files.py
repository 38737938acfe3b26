"""STEP files, read by Open CASCADE: validity, volume, curves and names."""

import math
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen import __version__
from solen.curve import Arc, Segment, Spline
from solen.errors import DesignError, OutputError
from solen.fabricate import Part, Prism, as_step, label_of
from solen.geometry import Face
from solen.spec import Design
from tests.fabricate.solid_support import HALF, design, oval_distance_mm, oval_z, part_of, seated

pytest.importorskip("OCP", reason="needs the extra cad")

from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.GeomAbs import GeomAbs_BSplineCurve, GeomAbs_Cylinder, GeomAbs_Plane, GeomAbs_SurfaceOfExtrusion
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_RetDone
from OCP.STEPControl import STEPControl_Reader
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_SHELL, TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS

QUADRATURE = 1e-9
"""Relative tolerance of the adaptive Gauss-Kronrod quadrature."""


def read(data: bytes, folder: Path) -> Any:
    target = folder / "part.step"
    target.write_bytes(data)
    reader = STEPControl_Reader()
    assert reader.ReadFile(str(target)) == IFSelect_RetDone
    reader.TransferRoots()
    return reader.OneShape()


CASTS = {TopAbs_EDGE: TopoDS.Edge, TopAbs_FACE: TopoDS.Face, TopAbs_SHELL: TopoDS.Shell, TopAbs_SOLID: TopoDS.Solid}


def pieces(shape: Any, kind: Any) -> list[Any]:
    shapes, explorer = [], TopExp_Explorer(shape, kind)
    while explorer.More():
        shapes.append(CASTS[kind](explorer.Current()))
        explorer.Next()
    return shapes


def volume(shape: Any, eps: float | None = QUADRATURE) -> float:
    properties = GProp_GProps()
    if eps is None:
        BRepGProp.VolumeProperties_s(shape, properties)
    else:
        BRepGProp.VolumePropertiesGK_s(shape, properties, eps, False, False, False, False, False)
    return float(properties.Mass())


def written(sensor: Design, folder: Path) -> tuple[Part, Any]:
    """Write the STEP file of a part; return the part and the shape that is read back."""
    part = part_of(sensor)
    return part, read(as_step(part, label_of(sensor, "")), folder)


@pytest.mark.parametrize(
    "sensor",
    [
        *(pytest.param(design(material__index=n), id=f"n = {n}") for n in (1.44, 1.49, 1.54)),
        pytest.param(seated(), id="seated"),
        pytest.param(design(lens__shape="none", body__thickness_mm=0.1), id="flat and thin"),
        pytest.param(design(wall=[{"face": "stem-*", "from_mm": 2, "to_mm": 6, "finish": "black"}]), id="walls"),
    ],
)
def test_files_contain_a_valid_solid_with_the_exact_volume(sensor: Design, tmp_path: Path) -> None:
    part, shape = written(sensor, tmp_path)
    assert len(pieces(shape, TopAbs_SOLID)) == 1
    (shell,) = pieces(shape, TopAbs_SHELL)
    assert shell.Closed()
    assert BRepCheck_Analyzer(shape).IsValid()
    assert volume(shape) == pytest.approx(part.volume_mm3, rel=1e-8)
    # the default quadrature, which CAD programs use, has 18 nodes along the lens
    assert volume(shape, None) == pytest.approx(part.volume_mm3, rel=1e-6)


@pytest.mark.parametrize("index", [1.44, 1.49, 1.54])
def test_the_spline_of_a_lens_is_accurate_to_10_nm(index: float, tmp_path: Path) -> None:
    _, shape = written(design(material__index=index), tmp_path)
    count = 0
    for edge in pieces(shape, TopAbs_EDGE):
        curve = BRepAdaptor_Curve(edge)
        if curve.GetType() != GeomAbs_BSplineCurve or curve.BSpline().Degree() != 3:
            continue
        parameters = np.linspace(curve.FirstParameter(), curve.LastParameter(), 5001)
        points = np.array([(point.X(), point.Y()) for point in map(curve.Value, parameters.tolist())])
        assert oval_distance_mm(points, index) < 1e-5
        assert np.abs(points[[0, -1], 0]) == pytest.approx(2.0, abs=1e-9)
        count += 1
    assert count >= 2, "at the bottom and at the top"


def test_faces_are_planes_and_surfaces_of_extrusion(tmp_path: Path) -> None:
    _, shape = written(design(), tmp_path)
    kinds = [BRepAdaptor_Surface(face).GetType() for face in pieces(shape, TopAbs_FACE)]
    assert len(kinds) == 11
    assert kinds.count(GeomAbs_SurfaceOfExtrusion) == 3, "the lens and both sides of the stem"
    assert kinds.count(GeomAbs_Plane) == 8


def directions(shape: Any, corner: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the unit tangents of the horizontal edges that end at a corner of the bottom face."""
    tangents = []
    for edge in pieces(shape, TopAbs_EDGE):
        curve = BRepAdaptor_Curve(edge)
        for parameter in (curve.FirstParameter(), curve.LastParameter()):
            point, tangent = curve.Value(parameter), curve.DN(parameter, 1)
            if math.dist((point.X(), point.Y(), point.Z()), (*corner, 0.0)) < 1e-6 and abs(tangent.Z()) < 0.5:
                length = math.hypot(tangent.X(), tangent.Y())
                tangents.append((tangent.X() / length, tangent.Y() / length))
    return tangents


def test_stem_and_arm_have_the_same_tangent(tmp_path: Path) -> None:
    _, shape = written(design(), tmp_path)
    tangents = directions(shape, (2.0 + 0.004 * 16.2**2, float(oval_z(np.array([HALF]))[0]) + 16.2))
    assert len(tangents) == 4, "two edges, each of the bottom and of a side"
    slope = 2 * 0.004 * 16.2
    for x, z in tangents:
        assert x / z == pytest.approx(slope, abs=1e-9)


def test_corners_are_exact(tmp_path: Path) -> None:
    """No edge has a tolerance above the minimum of the kernel."""
    _, shape = written(design(), tmp_path)
    for edge in pieces(shape, TopAbs_EDGE):
        assert BRep_Tool.Tolerance_s(edge) <= 1.1e-7


def test_names_of_faces_and_header() -> None:
    sensor = seated(name="Sensor µ 1")
    label = label_of(sensor, "thickness 4 mm")
    text = as_step(part_of(sensor), label).decode("ascii")
    names = re.findall(r"ADVANCED_FACE\('([^']*)'", text)
    assert {"lens", "stem-right", "receiver-left", "top", "bottom", "pocket-right", "slot-emitter"} <= set(names)
    assert names.count("pocket-left") == 5
    assert "" not in names
    line = re.sub(r"\s+", " ", text)
    assert label.sha256 in line
    assert f"'solen {__version__}'" in line
    assert "PRODUCT('Sensor ? 1'" in line
    assert ".MILLI.,.METRE." in line


def test_files_are_reproducible() -> None:
    label = label_of(seated(), "")
    assert as_step(part_of(seated()), label) == as_step(part_of(seated()), label)


def test_bodies_in_holes(tmp_path: Path) -> None:
    rings = [
        Arc.circle((0.0, 0.0), 5.0),
        Arc.circle((0.5, 0.0), 3.0).reversed(),
        Arc.circle((0.5, 0.0), 1.0),
    ]
    part = Part("rings", (Prism("rings", tuple((Face(f"ring-{i}", ring),) for i, ring in enumerate(rings)), 1.0, 3.0),))
    shape = read(as_step(part, label_of(design(), "")), tmp_path)
    assert len(pieces(shape, TopAbs_SOLID)) == 2
    assert BRepCheck_Analyzer(shape).IsValid()
    assert volume(shape) == pytest.approx(2.0 * math.pi * (25.0 - 9.0 + 1.0), rel=1e-9)
    kinds = [BRepAdaptor_Surface(face).GetType() for face in pieces(shape, TopAbs_FACE)]
    assert kinds.count(GeomAbs_Cylinder) == 3


@pytest.mark.parametrize("rise_mm", [1.0, -1.0])
def test_convex_and_concave_arcs_and_splines(rise_mm: float, tmp_path: Path) -> None:
    arc = Arc.through((4.0, 0.0), (4.0 + rise_mm, 2.0), (4.0, 4.0))
    wave = Spline(((0, 4), (0.5, 3), (-0.5, 3), (0, 2), (0.5, 1.5), (0.4, 0.5), (0, 0)))
    faces = (
        Face("base", Segment((0.0, 0.0), (4.0, 0.0))),
        Face("arc", arc),
        Face("lid", Segment((4.0, 4.0), (0.0, 4.0))),
        Face("wave", wave),
    )
    part = Part("box", (Prism("box", (faces,), 0.0, 1.5),))
    shape = read(as_step(part, label_of(design(), "")), tmp_path)
    assert BRepCheck_Analyzer(shape).IsValid()
    assert volume(shape) == pytest.approx(part.volume_mm3, rel=1e-9)
    assert len(pieces(shape, TopAbs_FACE)) == 7, "a corner divides the wave"


def test_touching_prisms_are_united(tmp_path: Path) -> None:
    def square(x: float, size: float) -> tuple[Face, ...]:
        corners = [(x, 0.0), (x + size, 0.0), (x + size, size), (x, size)]
        sides = zip(corners, [*corners[1:], corners[0]], strict=True)
        return tuple(Face(f"side-{i}", Segment(a, b)) for i, (a, b) in enumerate(sides))

    part = Part("steps", (Prism("base", (square(0.0, 9.0),), 0.0, 0.8), Prism("pillar", (square(3.0, 3.0),), 0.8, 2.0)))
    shape = read(as_step(part, label_of(design(), "")), tmp_path)
    assert len(pieces(shape, TopAbs_SOLID)) == 1
    assert volume(shape) == pytest.approx(81 * 0.8 + 9 * 1.2, rel=1e-9)


def test_the_kernel_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    as_step(part_of(design()), label_of(design(), ""))
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "")


def test_the_extra_is_named_if_the_kernel_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "OCP", None)
    with pytest.raises(OutputError, match=r'^--step; .* is not installed; pip install "cadquery-ocp-novtk\S+"$'):
        as_step(part_of(design()), label_of(design(), ""))


def test_refuses_an_open_outline() -> None:
    faces = (
        Face("a", Segment((0.0, 0.0), (1.0, 0.0))),
        Face("b", Segment((1.0, 0.5), (0.0, 1.0))),
        Face("c", Segment((0.0, 1.0), (0.0, 0.0))),
    )
    part = Part("open", (Prism("open", (faces,), 0.0, 1.0),))
    with pytest.raises(DesignError):
        as_step(part, label_of(design(), ""))
