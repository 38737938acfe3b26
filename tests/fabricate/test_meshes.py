"""Meshes: closed, within their tolerance, of the right volume; their files as trimesh, which wrote none, opens them."""

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

from solen import __version__
from solen.curve import Arc, Segment
from solen.errors import DesignError, SpecError
from solen.fabricate import Mesh, Part, Prism, as_glb, as_stl, as_threemf, label_of, mesh_of
from solen.geometry import Face
from solen.spec import Design
from tests.fabricate.solid_support import body_of, design, off_the_oval_mm, part_of, seated

FLOAT32 = 2.0**-23
"""Relative rounding of STL and GLB."""
DESIGNS: dict[str, Callable[[], Design]] = {
    "bare": design,
    "seated": seated,
    "450 nm": lambda: design(material__index=1.54),
    "no lens": lambda: design(lens__shape="none"),
    "thin": lambda: design(body__thickness_mm=0.025),
    "walls": lambda: design(wall=[{"face": "stem-*", "from_mm": 2.0, "to_mm": 6.0, "finish": "black"}]),
}
every_design = pytest.mark.parametrize("name", DESIGNS)


def opened(data: bytes, kind: str) -> Any:
    """Mesh as trimesh reads it, in mm."""
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind)
    found = scene.to_mesh()
    if kind == "glb":  # glTF is in metres
        found.apply_scale(1000.0)
    return found


def check_closed(found: Any) -> None:
    assert found.is_watertight
    assert found.is_winding_consistent
    assert found.is_volume, "and the outside is out"


@every_design
@pytest.mark.parametrize("tolerance_mm", [0.3, 1e-3, 1e-4])
def test_a_mesh_is_closed_and_its_volume_within_the_bound(name: str, tolerance_mm: float) -> None:
    part = part_of(DESIGNS[name]())
    mesh = mesh_of(part, tolerance_mm)
    assert mesh.open_edges() == 0
    check_closed(trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False))
    assert abs(mesh.volume_mm3 - part.volume_mm3) <= part.wall_mm2 * tolerance_mm


@pytest.mark.parametrize("tolerance_mm", [1e-2, 1e-3, 1e-4])
def test_a_mesh_keeps_its_tolerance(tolerance_mm: float) -> None:
    """Along every upright edge of two triangles of the lens, and between them, by bisection of the oval's equation."""
    mesh = mesh_of(part_of(design()), tolerance_mm)
    base = mesh.vertices[np.isclose(mesh.vertices[:, 2], 0.0)]
    lens = base[(np.abs(base[:, 0]) <= 2.0) & (base[:, 1] <= 1.8109)]
    lens = lens[np.argsort(lens[:, 0])]
    share = np.linspace(0.0, 1.0, 33)[:, None, None]
    between = ((1 - share) * lens[:-1, :2] + share * lens[1:, :2]).reshape(-1, 2)
    slope = np.abs(np.diff(lens[:, 1]) / np.diff(lens[:, 0])).max()
    assert off_the_oval_mm(between) <= tolerance_mm * np.hypot(1.0, slope)
    assert len(lens) < 40 / np.sqrt(tolerance_mm), "no more points than it takes"


def test_the_size_is_that_of_the_body() -> None:
    mesh = mesh_of(part_of(design(body__thickness_mm=3.0)), 1e-3)
    outline = body_of(design()).outline(1e-4)
    assert mesh.size_mm == pytest.approx((*np.ptp(outline, axis=0), 3.0), abs=1e-3)
    assert mesh.vertices[:, 2].min() == 0.0


@settings(max_examples=15, deadline=None)
@given(st.floats(0.5, 3.0), st.floats(5.0, 30.0), st.floats(0.001, 0.01), st.floats(1.0, 3.0), st.floats(0.1, 10.0))
def test_other_bodies_are_closed_too(
    half_mm: float, stem_mm: float, curve_per_mm: float, arm_mm: float, thickness_mm: float
) -> None:
    lens = {"half_width_mm": min(half_mm, 2.5)}
    body = {"stem_length_mm": stem_mm, "arm_width_mm": arm_mm, "stem_curve_per_mm": curve_per_mm}
    try:
        part = part_of(design(lens=lens, body=body | {"thickness_mm": thickness_mm}))
    except DesignError:
        return
    mesh = mesh_of(part, 1e-3)
    check_closed(opened(as_stl(mesh, label_of(design(), "")), "stl"))
    assert abs(mesh.volume_mm3 - part.volume_mm3) <= part.wall_mm2 * 1e-3


def test_holes_and_bodies_in_them() -> None:
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
    found = opened(as_stl(mesh, label_of(design(), "")), "stl")
    check_closed(found)
    assert found.body_count == 2


def square(x: float, size: float) -> tuple[Face, ...]:
    corners = [(x, 0.0), (x + size, 0.0), (x + size, size), (x, size)]
    sides = zip(corners, [*corners[1:], corners[0]], strict=True)
    return tuple(Face(f"side-{i}", Segment(a, b)) for i, (a, b) in enumerate(sides))


def test_prisms_that_touch_become_one() -> None:
    base, pillar = Prism("base", (square(0.0, 10.0),), 0.0, 0.8), Prism("pillar", (square(3.0, 3.0),), 0.8, 1.8)
    part = Part("z reference", (base, pillar))
    mesh = mesh_of(part, 1e-3)
    assert mesh.volume_mm3 == pytest.approx(80.0 + 9.0, rel=1e-9)
    assert part.volume_mm3 == pytest.approx(89.0, rel=1e-12)
    found = opened(as_threemf(mesh, label_of(design(), "")), "3mf")
    check_closed(found)
    assert found.body_count == 1


def test_prisms_that_overlap_are_refused() -> None:
    prisms = (Prism("base", (square(0.0, 10.0),), 0.0, 0.8), Prism("pillar", (square(9.0, 3.0),), 0.5, 1.8))
    with pytest.raises(DesignError, match=r"^one = 'base and pillar'; overlap$"):
        Part("one", prisms)


@pytest.mark.parametrize("height", [0.0, -1.0, float("nan"), float("inf")])
def test_a_prism_has_a_height(height: float) -> None:
    with pytest.raises(DesignError, match="must be above 0"):
        Prism("thickness", (square(0.0, 1.0),), 0.0, height)


@pytest.mark.parametrize("tolerance_mm", [0.0, -1.0, 1e-6, 2.0, float("nan"), float("inf")])
def test_a_tolerance_out_of_range_is_refused(tolerance_mm: float) -> None:
    with pytest.raises(SpecError, match=r"^--tolerance-mm = .*; must be from 0.0001 to 1 mm for this part$"):
        mesh_of(part_of(design()), tolerance_mm)


def test_a_large_part_needs_a_coarser_tolerance_than_32_bits_can_tell() -> None:
    part = Part("large", (Prism("large", (square(5e4, 10.0),), 0.0, 1.0),))
    with pytest.raises(SpecError, match=r"must be from 0\.0625 to 1 mm"):
        mesh_of(part, 1e-3)
    check_closed(opened(as_stl(mesh_of(part, 0.1), label_of(design(), "")), "stl"))


def test_a_tolerance_at_which_outlines_would_cross_is_refused() -> None:
    rings = (Arc.circle((0.0, 0.0), 5.0), Arc((0.0, 0.0), 4.99, 22.5, -360.0))
    part = Part("thin", (Prism("thin", tuple((Face("ring", ring),) for ring in rings), 0.0, 2.0),))
    with pytest.raises(SpecError, match="is too coarse for the outlines of thin, which would intersect"):
        mesh_of(part, 0.5)
    assert mesh_of(part, 1e-3).open_edges() == 0


@every_design
@pytest.mark.parametrize(("kind", "write"), [("stl", as_stl), ("3mf", as_threemf), ("glb", as_glb)])
def test_a_file_opens_closed_and_of_the_same_volume(name: str, kind: str, write: Callable[..., bytes]) -> None:
    chosen = DESIGNS[name]()
    mesh = mesh_of(part_of(chosen), 1e-3)
    found = opened(write(mesh, label_of(chosen, "")), kind)
    check_closed(found)
    assert found.body_count == 1
    assert len(found.faces) == len(mesh.triangles)
    # every place is rounded by at most half of this; the surface times it bounds the volume
    rounding_mm = 1e-8 if kind == "3mf" else 41.0 * FLOAT32
    assert found.volume == pytest.approx(mesh.volume_mm3, abs=rounding_mm * found.area)
    size = sorted(mesh.size_mm)
    assert sorted(found.extents) == pytest.approx(size, abs=2 * rounding_mm)


def plain() -> Mesh:
    return mesh_of(part_of(design()), 1e-3)


def test_stl_says_what_it_is() -> None:
    chosen = design(name="µ-sensor " + "long " * 20)
    label = label_of(chosen, "")
    data = as_stl(plain(), label)
    head = data[:80].decode("ascii")
    assert head.startswith(f"solen {__version__}; mm; ?-sensor long")
    assert label.sha256[:16] in head
    (count,) = struct.unpack("<I", data[80:84])
    assert len(data) == 84 + 50 * count
    normals = np.frombuffer(data, np.dtype([("v", "<f4", 12), ("a", "<u2")]), offset=84)["v"][:, :3]
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-6)


def test_3mf_says_what_it_is() -> None:
    chosen = design(name='<b>&" Ω')
    label = label_of(chosen, "thickness 4 mm")
    with zipfile.ZipFile(io.BytesIO(as_threemf(plain(), label))) as archive:
        assert archive.testzip() is None
        root = ET.fromstring(archive.read("3D/3dmodel.model"))  # noqa: S314  it is our own
    assert root.get("unit") == "millimeter"
    space = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    told = {element.get("name"): element.text for element in root.findall(f"{space}metadata")}
    assert told["Title"] == chosen.name
    assert told["Application"] == f"solen {__version__}"
    assert label.sha256 in str(told["Description"])
    assert "thickness 4 mm" in str(told["Description"])


def test_glb_stands_up_in_metres_and_says_what_it_is() -> None:
    label = label_of(design(), "thickness 4 mm")
    data = as_glb(plain(), label)
    magic, version, length, text_length, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    assert length % 4 == 0
    document = json.loads(data[20 : 20 + text_length])
    assert document["meshes"][0]["extras"]["sha256"] == label.sha256
    assert document["asset"]["generator"] == f"solen {__version__}"
    low, high = trimesh.load_scene(io.BytesIO(data), file_type="glb").bounds
    assert high - low == pytest.approx([0.011806, 0.004, 0.040412], abs=1e-6), "Y is up"


@pytest.mark.parametrize("write", [as_stl, as_threemf, as_glb])
def test_the_same_design_gives_the_same_file(write: Callable[..., bytes]) -> None:
    label = label_of(design(), "")
    assert write(plain(), label) == write(plain(), label)


def test_a_label_knows_designs_apart_and_not_their_comments() -> None:
    label = label_of(design(), "")
    assert label_of(design(), "").sha256 == label.sha256
    assert label_of(design(body__arm_width_mm=2.9), "").sha256 != label.sha256
    assert len(label.sha256) == 64


def test_open_edges_are_counted_as_their_definition_says() -> None:
    """Against a count edge by edge, for a closed mesh, with triangles missing, turned over and twice there."""
    mesh = mesh_of(part_of(seated()), 1e-2)
    some = mesh.triangles
    for triangles in (some, some[2:], np.vstack([some[:1, ::-1], some[1:]]), np.vstack([some, some[5:6]]), some[:1]):
        ways = [(int(t[i]), int(t[(i + 1) % 3])) for t in triangles for i in range(3)]
        expected = sum(ways.count(way) != 1 or ways.count(way[::-1]) != 1 for way in set(ways))
        assert Mesh(mesh.vertices, triangles, 1e-2).open_edges() == expected
