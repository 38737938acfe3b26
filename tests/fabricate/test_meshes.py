"""Meshes are closed and accurate, and their files have the same volume when read by trimesh."""

import io
import json
import struct
import zipfile
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import Manifold

from solen import __version__
from solen.curve import Arc, Segment
from solen.errors import DesignError, SpecError
from solen.fabricate import Mesh, Part, Prism, as_glb, as_stl, as_threemf, label_of, mesh_of
from solen.fabricate.layers.solid import fine_mesh
from solen.fabricate.mesh import closed_mesh
from solen.geometry import Face
from solen.spec import Design
from tests.fabricate.solid_support import body_of, design, oval_distance_mm, part_of, seated

FLOAT32 = 2.0**-23
"""Relative rounding error of STL and GLB files."""
DESIGNS: dict[str, Callable[[], Design]] = {
    "bare": design,
    "seated": seated,
    "450 nm": lambda: design(material__index=1.54),
    "no lens": lambda: design(lens__shape="none"),
    "thin": lambda: design(body__thickness_mm=0.025),
    "walls": lambda: design(wall=[{"face": "stem-*", "from_mm": 2.0, "to_mm": 6.0, "finish": "black"}]),
}
every_design = pytest.mark.parametrize("name", DESIGNS)


def read_back(data: bytes, kind: str) -> Any:
    """Return the mesh in mm that trimesh reads."""
    mesh = trimesh.load_scene(io.BytesIO(data), file_type=kind).to_mesh()
    if kind == "glb":  # glTF is in metres
        mesh.apply_scale(1000.0)
    return mesh


def check_closed(mesh: Any) -> None:
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.is_volume, "normals point outwards"


@every_design
@pytest.mark.parametrize("tolerance_mm", [0.3, 1e-3, 1e-4])
def test_meshes_are_closed_with_an_error_of_volume_within_the_bound(name: str, tolerance_mm: float) -> None:
    part = part_of(DESIGNS[name]())
    mesh = mesh_of(part, tolerance_mm)
    assert mesh.open_edges() == 0
    check_closed(trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False))
    assert abs(mesh.volume_mm3 - part.volume_mm3) <= part.wall_mm2 * tolerance_mm


@pytest.mark.parametrize("tolerance_mm", [1e-2, 1e-3, 1e-4])
def test_meshes_are_within_their_tolerance(tolerance_mm: float) -> None:
    """At vertices of the lens and between them, compared with the oval by bisection."""
    mesh = mesh_of(part_of(design()), tolerance_mm)
    base = mesh.vertices[np.isclose(mesh.vertices[:, 2], 0.0)]
    lens = base[(np.abs(base[:, 0]) <= 2.0) & (base[:, 1] <= 1.8109)]
    lens = lens[np.argsort(lens[:, 0])]
    fraction = np.linspace(0.0, 1.0, 33)[:, None, None]
    points = ((1 - fraction) * lens[:-1, :2] + fraction * lens[1:, :2]).reshape(-1, 2)
    slope = np.abs(np.diff(lens[:, 1]) / np.diff(lens[:, 0])).max()
    assert oval_distance_mm(points) <= tolerance_mm * np.hypot(1.0, slope)
    assert len(lens) < 40 / np.sqrt(tolerance_mm), "not more points than necessary"


def test_size_and_origin_of_a_mesh() -> None:
    mesh = mesh_of(part_of(design(body__thickness_mm=3.0)), 1e-3)
    outline = body_of(design()).outline(1e-4)
    assert mesh.size_mm == pytest.approx((*np.ptp(outline, axis=0), 3.0), abs=1e-3)
    assert mesh.vertices[:, 2].min() == 0.0


@settings(max_examples=15, deadline=None)
@given(st.floats(0.5, 3.0), st.floats(5.0, 30.0), st.floats(0.001, 0.01), st.floats(1.0, 3.0), st.floats(0.1, 10.0))
def test_meshes_of_random_bodies_are_closed(
    half_mm: float, stem_mm: float, curve_per_mm: float, arm_mm: float, thickness_mm: float
) -> None:
    lens = {"half_width_mm": min(half_mm, 2.5)}
    body = {"stem_length_mm": stem_mm, "arm_width_mm": arm_mm, "stem_curve_per_mm": curve_per_mm}
    try:
        part = part_of(design(lens=lens, body=body | {"thickness_mm": thickness_mm}))
    except DesignError:
        return
    mesh = mesh_of(part, 1e-3)
    check_closed(read_back(as_stl(mesh, label_of(design(), "")), "stl"))
    assert abs(mesh.volume_mm3 - part.volume_mm3) <= part.wall_mm2 * 1e-3


def test_bodies_in_holes() -> None:
    rings = [
        Arc.circle((0.0, 0.0), 5.0),
        Arc.circle((0.5, 0.0), 3.0).reversed(),
        Arc.circle((0.5, 0.0), 1.0),
    ]
    prism = Prism("rings", tuple((Face(f"ring-{i}", ring),) for i, ring in enumerate(rings)), 0.0, 2.0)
    part = Part("rings", (prism,))
    assert part.volume_mm3 == pytest.approx(2.0 * np.pi * (25 - 9 + 1), rel=1e-12)
    mesh = mesh_of(part, 1e-3)
    assert abs(mesh.volume_mm3 - part.volume_mm3) <= part.wall_mm2 * 1e-3
    read = read_back(as_stl(mesh, label_of(design(), "")), "stl")
    check_closed(read)
    assert read.body_count == 2


def square(x: float, size: float) -> tuple[Face, ...]:
    corners = [(x, 0.0), (x + size, 0.0), (x + size, size), (x, size)]
    sides = zip(corners, [*corners[1:], corners[0]], strict=True)
    return tuple(Face(f"side-{i}", Segment(a, b)) for i, (a, b) in enumerate(sides))


def test_touching_prisms_are_united() -> None:
    base, pillar = Prism("base", (square(0.0, 10.0),), 0.0, 0.8), Prism("pillar", (square(3.0, 3.0),), 0.8, 1.8)
    part = Part("z reference", (base, pillar))
    mesh = mesh_of(part, 1e-3)
    assert mesh.volume_mm3 == pytest.approx(80.0 + 9.0, rel=1e-9)
    assert part.volume_mm3 == pytest.approx(89.0, rel=1e-12)
    read = read_back(as_threemf(mesh, label_of(design(), "")), "3mf")
    check_closed(read)
    assert read.body_count == 1


def test_refuses_overlapping_prisms() -> None:
    prisms = (Prism("base", (square(0.0, 10.0),), 0.0, 0.8), Prism("pillar", (square(9.0, 3.0),), 0.5, 1.8))
    with pytest.raises(DesignError, match=r"^part; .*base and pillar overlap$"):
        Part("part", prisms)


@pytest.mark.parametrize("height", [0.0, -1.0, float("nan"), float("inf")])
def test_refuses_an_invalid_height(height: float) -> None:
    with pytest.raises(DesignError, match="must be above 0"):
        Prism("thickness", (square(0.0, 1.0),), 0.0, height)


@pytest.mark.parametrize("tolerance_mm", [0.0, -1.0, 1e-6, 2.0, float("nan"), float("inf")])
def test_refuses_an_invalid_tolerance(tolerance_mm: float) -> None:
    with pytest.raises(SpecError, match=r"^--tolerance-mm = .*; must be 0\.0001 to 1 mm"):
        mesh_of(part_of(design()), tolerance_mm)


def test_the_minimum_tolerance_of_a_large_part_is_that_of_32_bit_numbers() -> None:
    part = Part("large", (Prism("large", (square(5e4, 10.0),), 0.0, 1.0),))
    with pytest.raises(SpecError, match=r"must be 0\.0625 to 1 mm"):
        mesh_of(part, 1e-3)
    check_closed(read_back(as_stl(mesh_of(part, 0.1), label_of(design(), "")), "stl"))


def test_refuses_a_tolerance_with_which_outlines_would_intersect() -> None:
    rings = (Arc.circle((0.0, 0.0), 5.0), Arc((0.0, 0.0), 4.99, 22.5, -360.0))
    part = Part("thin", (Prism("thin", tuple((Face("ring", ring),) for ring in rings), 0.0, 2.0),))
    with pytest.raises(SpecError, match="is too coarse for the outlines of thin, which would intersect"):
        mesh_of(part, 0.5)
    assert mesh_of(part, 1e-3).open_edges() == 0


def test_the_mesh_for_layers_names_no_option_if_the_tolerance_is_too_coarse() -> None:
    part = Part("large", (Prism("large", (square(5e4, 10.0),), 0.0, 1.0),))
    with pytest.raises(DesignError, match=r"^large; has no closed mesh within 0\.0002 mm; simplify the outline$"):
        fine_mesh(part)


@every_design
@pytest.mark.parametrize(("kind", "write"), [("stl", as_stl), ("3mf", as_threemf), ("glb", as_glb)])
def test_files_are_closed_and_have_the_volume(name: str, kind: str, write: Callable[..., bytes]) -> None:
    sensor_design = DESIGNS[name]()
    mesh = mesh_of(part_of(sensor_design), 1e-3)
    read = read_back(write(mesh, label_of(sensor_design, "")), kind)
    check_closed(read)
    assert read.body_count == 1
    assert len(read.faces) == len(mesh.triangles)
    # coordinates are rounded by at most half of this, so its product with the surface is a bound of the volume
    rounding_mm = 1e-8 if kind == "3mf" else 41.0 * FLOAT32
    assert read.volume == pytest.approx(mesh.volume_mm3, abs=rounding_mm * read.area)
    size = sorted(mesh.size_mm)
    assert sorted(read.extents) == pytest.approx(size, abs=2 * rounding_mm)


def default_mesh() -> Mesh:
    return mesh_of(part_of(design()), 1e-3)


def test_header_and_normals_of_stl() -> None:
    label = label_of(design(name="µ-sensor " + "long " * 20), "")
    data = as_stl(default_mesh(), label)
    header = data[:80].decode("ascii")
    assert header.startswith(f"solen {__version__}; mm; ?-sensor long")
    assert label.sha256[:16] in header
    (count,) = struct.unpack("<I", data[80:84])
    assert len(data) == 84 + 50 * count
    normals = np.frombuffer(data, np.dtype([("v", "<f4", 12), ("a", "<u2")]), offset=84)["v"][:, :3]
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-6)


def test_metadata_of_3mf() -> None:
    name = '<b>&" Ω'
    label = label_of(design(name=name), "thickness 4 mm")
    with zipfile.ZipFile(io.BytesIO(as_threemf(default_mesh(), label))) as archive:
        assert archive.testzip() is None
        root = ET.fromstring(archive.read("3D/3dmodel.model"))  # noqa: S314 - written by the test
    assert root.get("unit") == "millimeter"
    space = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    metadata = {element.get("name"): str(element.text) for element in root.findall(f"{space}metadata")}
    assert metadata["Title"] == name
    assert metadata["Application"] == f"solen {__version__}"
    assert label.sha256 in metadata["Description"]
    assert "thickness 4 mm" in metadata["Description"]


def test_metadata_and_orientation_of_glb() -> None:
    label = label_of(design(), "thickness 4 mm")
    data = as_glb(default_mesh(), label)
    magic, version, length, text_length, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    assert length % 4 == 0
    document = json.loads(data[20 : 20 + text_length])
    assert document["meshes"][0]["extras"]["sha256"] == label.sha256
    assert document["asset"]["generator"] == f"solen {__version__}"
    low, high = trimesh.load_scene(io.BytesIO(data), file_type="glb").bounds
    assert high - low == pytest.approx([0.011806, 0.004, 0.040412], abs=1e-6), "Y points upwards"


@pytest.mark.parametrize("write", [as_stl, as_threemf, as_glb])
def test_files_are_reproducible(write: Callable[..., bytes]) -> None:
    label = label_of(design(), "")
    assert write(default_mesh(), label) == write(default_mesh(), label)


def test_labels_identify_designs() -> None:
    label = label_of(design(), "")
    assert label_of(design(), "").sha256 == label.sha256
    assert label_of(design(body__arm_width_mm=2.9), "").sha256 != label.sha256
    assert len(label.sha256) == 64


def test_counts_open_edges() -> None:
    """The counts are those edge by edge: for a closed mesh, and with triangles missing, reversed and duplicated."""
    mesh = mesh_of(part_of(seated()), 1e-2)
    closed = mesh.triangles
    reversed_triangle, duplicate = np.vstack([closed[:1, ::-1], closed[1:]]), np.vstack([closed, closed[5:6]])
    for triangles in (closed, closed[2:], reversed_triangle, duplicate, closed[:1]):
        edges = [(int(t[i]), int(t[(i + 1) % 3])) for t in triangles for i in range(3)]
        expected = sum(edges.count(edge) != 1 or edges.count(edge[::-1]) != 1 for edge in set(edges))
        assert Mesh(mesh.vertices, triangles, 1e-2).open_edges() == expected


def test_error_for_an_open_mesh_names_no_option_without_one() -> None:
    with pytest.raises(DesignError, match=r"^print; has no closed mesh within 0\.001 mm; simplify the outline$"):
        closed_mesh(Manifold(), 1e-3, "print")
