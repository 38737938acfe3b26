"""Reading of binary and text STL files, and errors for damaged ones."""

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from solen.errors import DataError
from solen.fabricate import Mesh, as_stl, label_of, mesh_of
from solen.fabricate.stl import read_stl
from tests.fabricate.solid_support import design, part_of, seated


@pytest.fixture
def sensor() -> Mesh:
    return mesh_of(part_of(seated()), 1e-2)


def test_reads_the_files_of_solen(tmp_path: Path, sensor: Mesh) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(as_stl(sensor, label_of(design(), "")))
    mesh = read_stl(path)
    assert mesh.open_edges() == 0
    assert len(mesh.triangles) == len(sensor.triangles)
    assert len(mesh.vertices) == len(sensor.vertices)
    assert mesh.volume_mm3 == pytest.approx(sensor.volume_mm3, rel=1e-5)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_reads_the_files_of_trimesh(tmp_path: Path, sensor: Mesh, kind: str) -> None:
    path = tmp_path / "b.stl"
    trimesh.Trimesh(sensor.vertices, sensor.triangles, process=False).export(path, file_type=kind)
    mesh = read_stl(path)
    assert mesh.open_edges() == 0
    assert mesh.volume_mm3 == pytest.approx(sensor.volume_mm3, rel=1e-5)


def test_reads_a_binary_file_that_begins_with_solid(tmp_path: Path, sensor: Mesh) -> None:
    data = as_stl(sensor, label_of(design(), ""))
    path = tmp_path / "c.stl"
    path.write_bytes(b"solid of another program".ljust(80) + data[80:])
    assert len(read_stl(path).triangles) == len(sensor.triangles)


def test_reads_a_text_file_with_windows_line_ends_and_exponents(tmp_path: Path) -> None:
    corners = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    faces = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
    lines = ["solid tetra"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(f"{value:.3E}" for value in corners[i]) for i in face]
        lines += ["endloop", "endfacet"]
    path = tmp_path / "d.stl"
    path.write_bytes("\r\n".join([*lines, "endsolid tetra"]).encode())
    mesh = read_stl(path)
    assert mesh.open_edges() == 0
    assert mesh.volume_mm3 == pytest.approx(1.0 / 6.0, rel=1e-15)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "is empty"),
        (b"<html>not found</html>", "not an STL"),
        (bytes(80) + struct.pack("<I", 0), "no triangles"),
        (bytes(80) + struct.pack("<I", 3) + bytes(50), "134 bytes.* 234"),
        (bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(50), "134 bytes.* 200000000084"),
        (b"solid a\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n", "is truncated"),
        (b"solid a\nendsolid a\n", "no triangles"),
        (b"solid a\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 x 0\nendsolid a\n", "not a number"),
        (b"solid a\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 nan 0\nendsolid a\n", "not finite"),
        (bytes(80) + struct.pack("<I12fH", 1, *([np.inf] * 12), 0), "not finite"),
    ],
)
def test_refuses_damaged_files(tmp_path: Path, content: bytes, text: str) -> None:
    path = tmp_path / "bad.stl"
    path.write_bytes(content)
    with pytest.raises(DataError, match=text) as error:
        read_stl(path)
    assert "\n" not in str(error.value)


def test_refuses_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        read_stl(tmp_path / "none.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(DataError, match="is a folder"):
        read_stl(tmp_path / "folder.stl")
