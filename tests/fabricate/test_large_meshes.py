"""Large meshes: their sections agree with another program, in limited memory."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from shapely.geometry import Polygon

from solen.fabricate import Mesh
from solen.fabricate.label import Label
from solen.fabricate.layers import Slicing, mesh_solid, orientation, printable_mesh
from solen.fabricate.meshfiles import as_stl, as_threemf
from solen.fabricate.stl import read_stl
from solen.fabricate.threemf import read_threemf
from tests.fabricate.test_layers import closed

FLAT = orientation("flat")
LABEL = Label("a ball", "0" * 64, "a test")


def ball(rows: int, columns: int) -> Mesh:
    """Return a corrugated ball of 2 (rows - 1) columns triangles."""
    theta = np.linspace(0.0, np.pi, rows + 1)[1:-1, None]
    phi = np.linspace(0.0, 2.0 * np.pi, columns, endpoint=False)[None]
    radius = 10.0 + 0.4 * np.sin(9.0 * theta) * np.cos(7.0 * phi)
    sine, cosine = np.sin(theta), np.broadcast_to(np.cos(theta), radius.shape)
    points = np.stack([radius * sine * np.cos(phi), radius * sine * np.sin(phi), radius * cosine], -1).reshape(-1, 3)
    vertices = np.vstack([points, [(0.0, 0.0, 10.0), (0.0, 0.0, -10.0)]])
    i, j = np.arange(rows - 2)[:, None] * columns, np.arange(columns)
    k, top, last = (j + 1) % columns, len(points), (rows - 2) * columns
    a, b, c, d = (np.ravel(corner) for corner in (i + j, i + k, i + columns + j, i + columns + k))
    pole = np.full(columns, top)
    faces = [(a, c, b), (b, c, d), (pole, j, k), (pole + 1, last + k, last + j)]
    return Mesh(vertices, np.concatenate([np.column_stack(face) for face in faces]), 0.0)


def area_mm2(rings: list[np.ndarray]) -> float:
    polygons = [Polygon(ring) for ring in rings if len(ring) > 2]
    return float(sum(polygon.area if polygon.exterior.is_ccw else -polygon.area for polygon in polygons))


def test_sections_agree_with_trimesh() -> None:
    mesh = ball(60, 80)
    solid = mesh_solid(mesh, FLAT)
    reference = trimesh.Trimesh(mesh.vertices - mesh.vertices.min(axis=0), mesh.triangles, process=False)
    for z in np.linspace(0.3, solid.size_mm[2] - 0.3, 50).tolist():
        section = reference.section(plane_origin=(0.0, 0.0, z), plane_normal=(0.0, 0.0, 1.0))
        assert area_mm2(list(solid.section(z)[1])) == pytest.approx(float(section.to_2D()[0].area), rel=1e-9)


def test_sections_through_vertices_and_horizontal_faces_are_closed() -> None:
    """At a horizontal face, the section is that of an adjacent height."""
    solids = [
        trimesh.creation.box(bounds=[(0, 0, 0), (6, 6, 2)]),
        trimesh.creation.box(bounds=[(1, 1, 2), (5, 5, 4)]),
    ]
    hole = trimesh.creation.box(bounds=[(2, 2, -1), (3, 3, 5)])
    shape = trimesh.boolean.difference([trimesh.boolean.union(solids, engine="manifold"), hole], engine="manifold")
    solid = mesh_solid(closed(shape), FLAT)
    areas = [area_mm2(list(solid.section(z)[1])) for z in (1e-9, 1.0, 2.0, 2.0 + 1e-9, 3.0, 4.0, 4.1)]
    assert areas == pytest.approx([35.0, 35.0, 35.0, 15.0, 15.0, 15.0, 0.0], abs=1e-6)
    sphere = mesh_solid(closed(trimesh.creation.icosphere(3, 5.0)), FLAT)
    equator = 0.5 * sphere.size_mm[2]
    exact, near = (area_mm2(list(sphere.section(z)[1])) for z in (equator, equator + 1e-7))
    assert exact == pytest.approx(near, rel=1e-5)


def test_keeps_separate_shells_and_cavities() -> None:
    balls = [trimesh.creation.icosphere(2, 2.0) for _ in range(2)]
    separate = trimesh.util.concatenate([balls[0], balls[1].apply_translation((5.0, 0.0, 0.0))])
    assert mesh_solid(closed(separate), FLAT).volume_mm3 == pytest.approx(float(separate.volume), rel=1e-9)
    inner = trimesh.creation.icosphere(3, 1.0)
    inner.invert()
    hollow = trimesh.util.concatenate([trimesh.creation.icosphere(3, 2.0), inner])
    solid = mesh_solid(closed(hollow), FLAT)
    assert len(solid.section(2.0)[1]) == 2
    assert solid.volume_mm3 == pytest.approx(float(hollow.volume), rel=1e-9)


@pytest.mark.parametrize("kind", ["stl", "3mf"])
def test_memory_per_triangle_is_limited(tmp_path: Path, kind: str) -> None:
    """To read, check, slice and write a mesh requires at most 300 bytes per triangle: 300 MB for a million."""
    mesh = ball(120, 130)
    path = tmp_path / f"ball.{kind}"
    path.write_bytes({"stl": as_stl, "3mf": as_threemf}[kind](mesh, LABEL))
    count = len(mesh.triangles)
    small = tmp_path / f"small.{kind}"
    small.write_bytes({"stl": as_stl, "3mf": as_threemf}[kind](ball(20, 20), LABEL))
    printable_mesh(small, Slicing()).solid.section(5.0)  # loads libraries
    tracemalloc.start()
    part = printable_mesh(path, Slicing())
    areas = [area_mm2(list(part.solid.section(z)[1])) for z in (4.0, 10.0)]
    part.write_stl(tmp_path / "placed.stl")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert areas[1] > areas[0] > 100.0
    assert read_stl(tmp_path / "placed.stl").volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-6)
    assert peak / count < 300.0


def test_files_written_in_several_blocks_are_complete(tmp_path: Path) -> None:
    mesh = ball(250, 260)
    assert len(mesh.triangles) > 100_000
    (tmp_path / "a.stl").write_bytes(as_stl(mesh, LABEL))
    (tmp_path / "a.3mf").write_bytes(as_threemf(mesh, LABEL))
    for copy in (read_stl(tmp_path / "a.stl"), read_threemf(tmp_path / "a.3mf")):
        assert copy.open_edges() == 0
        assert len(copy.triangles) == len(mesh.triangles)
        assert copy.volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-6)
