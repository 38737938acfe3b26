"""3MF files read: as solen and as trimesh write them, in other units, of several parts; what is damaged is one line."""

import io
import zipfile
from pathlib import Path

import pytest
import trimesh

from solen.errors import DataError
from solen.fabricate import as_threemf, label_of, mesh_of
from solen.fabricate.meshfiles import CORE, MODEL
from solen.fabricate.threemf import read_threemf
from tests.fabricate.solid_support import design, part_of, seated

TETRA = (
    "<mesh><vertices>"
    '<vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/><vertex x="0" y="0" z="1"/>'
    "</vertices><triangles>"
    '<triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/>'
    '<triangle v1="1" v2="2" v3="3"/><triangle v1="0" v2="3" v3="2"/>'
    "</triangles></mesh>"
)
TWO = (
    f'<resources><object id="1">{TETRA}</object><object id="2"><components><component objectid="1"/>'
    '<component objectid="1" transform="2 0 0 0 2 0 0 0 2 5 0 0"/></components></object></resources>'
    '<build><item objectid="2" transform="0 1 0 -1 0 0 0 0 1 0 0 7"/></build>'
)


def written(path: Path, body: str, head: str = 'unit="millimeter"', name: str = MODEL) -> Path:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr(name, f'<?xml version="1.0"?><model {head} xmlns="{CORE}">{body}</model>')
    path.write_bytes(data.getvalue())
    return path


def test_what_solen_and_trimesh_write_is_read(tmp_path: Path) -> None:
    mesh = mesh_of(part_of(seated()), 1e-2)
    (tmp_path / "a.3mf").write_bytes(as_threemf(mesh, label_of(design(), "")))
    found = read_threemf(tmp_path / "a.3mf")
    assert found.open_edges() == 0
    assert found.volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-7)
    trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).export(tmp_path / "b.3mf")
    assert read_threemf(tmp_path / "b.3mf").volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-6)


@pytest.mark.parametrize(("unit", "mm"), [("micron", 1e-3), ("inch", 25.4), ("meter", 1000.0), ("centimeter", 10.0)])
def test_units_and_parts_of_parts(tmp_path: Path, unit: str, mm: float) -> None:
    """A tetrahedron, and one of twice its size 5 farther along x, both turned by 90° about z and lifted by 7."""
    found = read_threemf(written(tmp_path / "c.3mf", TWO, f'unit="{unit}"', "3D/other.model"))
    assert found.volume_mm3 == pytest.approx((1 + 8) / 6 * mm**3, rel=1e-12)
    assert found.vertices.min(axis=0) == pytest.approx([-2 * mm, 0, 7 * mm], abs=1e-12)
    assert found.vertices.max(axis=0) == pytest.approx([0, 7 * mm, 9 * mm], abs=1e-12)
    assert found.open_edges() == 0


def test_a_mirrored_part_is_not_inside_out(tmp_path: Path) -> None:
    body = TWO.replace("0 1 0 -1 0 0 0 0 1 0 0 7", "-1 0 0 0 1 0 0 0 1 0 0 0")
    assert read_threemf(written(tmp_path / "d.3mf", body)).volume_mm3 == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("body", "head", "line"),
    [
        (TWO, 'unit="cubit"', "unit = 'cubit'; must be one of micron"),
        (TWO, 'requiredextensions="p"', "requires the extension p"),
        (TWO.replace("<build>", "<built>").replace("</build>", "</built>").replace("item", "thing"), "", "is empty"),
        (TWO.replace('objectid="2"', 'objectid="9"'), "", "its model'; is damaged"),
        (TWO.replace('objectid="1"/>', 'objectid="2"/>'), "", "its model'; is damaged"),
        (TWO.replace('v3="1"', 'v3="40"'), "", "is damaged"),
        (TWO.replace('x="1"', 'x="one"'), "", "is damaged"),
        (TWO.replace('x="1"', 'x="inf"'), "", "is damaged"),
        (TWO.replace('x="1"', ""), "", "is damaged"),
        (TWO.replace("2 0 0 0 2 0 0 0 2 5 0 0", "2 0 0"), "", "is damaged"),
        (TWO.replace("</build>", ""), "", "its model is damaged"),
    ],
)
def test_what_is_damaged_is_one_line(tmp_path: Path, body: str, head: str, line: str) -> None:
    with pytest.raises(DataError) as bad:
        read_threemf(written(tmp_path / "bad.3mf", body, head))
    assert line in str(bad.value)
    assert "\n" not in str(bad.value)


def test_objects_without_end_are_refused(tmp_path: Path) -> None:
    """Ten of ten of ten ..., twelve deep: a million million tetrahedra in a small file."""
    levels = "".join(
        f'<object id="{k}"><components>' + f'<component objectid="{k - 1}"/>' * 10 + "</components></object>"
        for k in range(2, 14)
    )
    body = f'<resources><object id="1">{TETRA}</object>{levels}</resources><build><item objectid="13"/></build>'
    with pytest.raises(DataError, match="is damaged"):
        read_threemf(written(tmp_path / "e.3mf", body))


def test_what_is_no_3mf(tmp_path: Path) -> None:
    for name, data in (("a.3mf", b""), ("b.3mf", b"PK\x03\x04 and no more"), ("c.3mf", b"solid\nendsolid")):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(DataError, match="not a 3MF"):
            read_threemf(tmp_path / name)
    with zipfile.ZipFile(tmp_path / "d.3mf", "w") as archive:
        archive.writestr("readme.txt", "nothing")
    with pytest.raises(DataError, match="not a 3MF"):
        read_threemf(tmp_path / "d.3mf")
    with pytest.raises(DataError, match="no such file"):
        read_threemf(tmp_path / "none.3mf")
