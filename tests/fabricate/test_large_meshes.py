"""Large meshes: cut as their plane sections are, in memory that a laptop has."""

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
    """A dented ball of 2 (rows - 1) columns triangles."""
    theta = np.linspace(0.0, np.pi, rows + 1)[1:-1, None]
    phi = np.linspace(0.0, 2.0 * np.pi, columns, endpoint=False)[None]
    radius = 10.0 + 0.4 * np.sin(9.0 * theta) * np.cos(7.0 * phi)
    wide, high = np.sin(theta), np.broadcast_to(np.cos(theta), radius.shape)
    places = np.stack([radius * wide * np.cos(phi), radius * wide * np.sin(phi), radius * high], -1).reshape(-1, 3)
    vertices = np.vstack([places, [(0.0, 0.0, 10.0), (0.0, 0.0, -10.0)]])
    i, j = np.arange(rows - 2)[:, None] * columns, np.arange(columns)
    k, top, low = (j + 1) % columns, len(places), (rows - 2) * columns
    a, b, c, d = (np.ravel(one) for one in (i + j, i + k, i + columns + j, i + columns + k))
    pole = np.full(columns, top)
    faces = [(a, c, b), (b, c, d), (pole, j, k), (pole + 1, low + k, low + j)]
    return Mesh(vertices, np.concatenate([np.column_stack(face) for face in faces]), 0.0)


def area_mm2(rings: list[np.ndarray]) -> float:
    signed = [(Polygon(ring), ring) for ring in rings if len(ring) > 2]
    return float(sum(polygon.area if polygon.exterior.is_ccw else -polygon.area for polygon, _ in signed))


def test_sections_are_those_of_another_program() -> None:
    """Fifty heights of a dented ball, against trimesh's sections."""
    mesh = ball(60, 80)
    solid = mesh_solid(mesh, FLAT)
    theirs = trimesh.Trimesh(mesh.vertices - mesh.vertices.min(axis=0), mesh.triangles, process=False)
    for z in np.linspace(0.3, solid.size_mm[2] - 0.3, 50).tolist():
        section = theirs.section(plane_origin=(0.0, 0.0, z), plane_normal=(0.0, 0.0, 1.0))
        assert area_mm2(list(solid.section(z)[1])) == pytest.approx(float(section.to_2D()[0].area), rel=1e-9)


def test_a_plane_through_corners_and_level_faces_leaves_closed_rings() -> None:
    """A box on a larger box, with a hole: at a level face the section is that beside it."""
    solids = [
        trimesh.creation.box(bounds=[(0, 0, 0), (6, 6, 2)]),
        trimesh.creation.box(bounds=[(1, 1, 2), (5, 5, 4)]),
    ]
    hole = trimesh.creation.box(bounds=[(2, 2, -1), (3, 3, 5)])
    shape = trimesh.boolean.difference([trimesh.boolean.union(solids, engine="manifold"), hole], engine="manifold")
    solid = mesh_solid(closed(shape), FLAT)
    found = [area_mm2(list(solid.section(z)[1])) for z in (1e-9, 1.0, 2.0, 2.0 + 1e-9, 3.0, 4.0, 4.1)]
    assert found == pytest.approx([35.0, 35.0, 35.0, 15.0, 15.0, 15.0, 0.0], abs=1e-6)
    around = trimesh.creation.icosphere(3, 5.0)
    equator = mesh_solid(closed(around), FLAT)
    middle = 0.5 * equator.size_mm[2]
    at, near = (area_mm2(list(equator.section(z)[1])) for z in (middle, middle + 1e-7))
    assert at == pytest.approx(near, rel=1e-5)


def test_shells_apart_are_not_united_and_a_hollow_stays_one() -> None:
    balls = [trimesh.creation.icosphere(2, 2.0) for _ in range(2)]
    apart = trimesh.util.concatenate([balls[0], balls[1].apply_translation((5.0, 0.0, 0.0))])
    assert mesh_solid(closed(apart), FLAT).volume_mm3 == pytest.approx(float(apart.volume), rel=1e-9)
    inner = trimesh.creation.icosphere(3, 1.0)
    inner.invert()
    hollow = trimesh.util.concatenate([trimesh.creation.icosphere(3, 2.0), inner])
    solid = mesh_solid(closed(hollow), FLAT)
    assert len(solid.section(2.0)[1]) == 2
    assert solid.volume_mm3 == pytest.approx(float(hollow.volume), rel=1e-9)


@pytest.mark.parametrize("kind", ["stl", "3mf"])
def test_memory_grows_by_little_for_each_triangle(tmp_path: Path, kind: str) -> None:
    """Read, checked, placed, cut and written again: at most 300 bytes a triangle, 300 MB for a million."""
    mesh = ball(250, 260)
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


def test_files_written_in_pieces_are_whole(tmp_path: Path) -> None:
    """More triangles than are written at a time."""
    mesh = ball(250, 260)
    assert len(mesh.triangles) > 100_000
    (tmp_path / "a.stl").write_bytes(as_stl(mesh, LABEL))
    (tmp_path / "a.3mf").write_bytes(as_threemf(mesh, LABEL))
    for again in (read_stl(tmp_path / "a.stl"), read_threemf(tmp_path / "a.3mf")):
        assert again.open_edges() == 0
        assert len(again.triangles) == len(mesh.triangles)
        assert again.volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-6)
