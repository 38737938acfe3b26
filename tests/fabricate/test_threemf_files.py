"""Reading of 3MF files with several objects and units, and errors for damaged ones."""

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
ASSEMBLY = (
    f'<resources><object id="1">{TETRA}</object><object id="2"><components><component objectid="1"/>'
    '<component objectid="1" transform="2 0 0 0 2 0 0 0 2 5 0 0"/></components></object></resources>'
    '<build><item objectid="2" transform="0 1 0 -1 0 0 0 0 1 0 0 7"/></build>'
)


def threemf_file(path: Path, body: str, attributes: str = 'unit="millimeter"', name: str = MODEL) -> Path:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr(name, f'<?xml version="1.0"?><model {attributes} xmlns="{CORE}">{body}</model>')
    path.write_bytes(data.getvalue())
    return path


def test_reads_the_files_of_solen_and_trimesh(tmp_path: Path) -> None:
    mesh = mesh_of(part_of(seated()), 1e-2)
    (tmp_path / "a.3mf").write_bytes(as_threemf(mesh, label_of(design(), "")))
    read = read_threemf(tmp_path / "a.3mf")
    assert read.open_edges() == 0
    assert read.volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-7)
    trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).export(tmp_path / "b.3mf")
    assert read_threemf(tmp_path / "b.3mf").volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-6)


@pytest.mark.parametrize(("unit", "mm"), [("micron", 1e-3), ("inch", 25.4), ("meter", 1000.0), ("centimeter", 10.0)])
def test_units_and_nested_components(tmp_path: Path, unit: str, mm: float) -> None:
    """A tetrahedron and one of twice its size, 5 farther along x, both rotated by 90° about z and raised by 7."""
    mesh = read_threemf(threemf_file(tmp_path / "c.3mf", ASSEMBLY, f'unit="{unit}"', "3D/other.model"))
    assert mesh.volume_mm3 == pytest.approx((1 + 8) / 6 * mm**3, rel=1e-12)
    assert mesh.vertices.min(axis=0) == pytest.approx([-2 * mm, 0, 7 * mm], abs=1e-12)
    assert mesh.vertices.max(axis=0) == pytest.approx([0, 7 * mm, 9 * mm], abs=1e-12)
    assert mesh.open_edges() == 0


def test_a_mirrored_component_is_not_inside_out(tmp_path: Path) -> None:
    body = ASSEMBLY.replace("0 1 0 -1 0 0 0 0 1 0 0 7", "-1 0 0 0 1 0 0 0 1 0 0 0")
    assert read_threemf(threemf_file(tmp_path / "d.3mf", body)).volume_mm3 == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("body", "attributes", "text"),
    [
        (ASSEMBLY, 'unit="cubit"', "unit = 'cubit'; must be one of micron"),
        (ASSEMBLY, 'requiredextensions="p"', "requires the extension p"),
        (
            ASSEMBLY.replace("<build>", "<built>").replace("</build>", "</built>").replace("item", "thing"),
            "",
            "no triangles",
        ),
        (ASSEMBLY.replace('objectid="2"', 'objectid="9"'), "", "model is damaged"),
        (ASSEMBLY.replace('objectid="1"/>', 'objectid="2"/>'), "", "model is damaged"),
        (ASSEMBLY.replace('v3="1"', 'v3="40"'), "", "is damaged"),
        (ASSEMBLY.replace('x="1"', 'x="one"'), "", "is damaged"),
        (ASSEMBLY.replace('x="1"', 'x="inf"'), "", "is damaged"),
        (ASSEMBLY.replace('x="1"', ""), "", "is damaged"),
        (ASSEMBLY.replace("2 0 0 0 2 0 0 0 2 5 0 0", "2 0 0"), "", "is damaged"),
        (ASSEMBLY.replace("</build>", ""), "", "model is damaged"),
    ],
)
def test_refuses_damaged_models(tmp_path: Path, body: str, attributes: str, text: str) -> None:
    with pytest.raises(DataError) as error:
        read_threemf(threemf_file(tmp_path / "bad.3mf", body, attributes))
    assert text in str(error.value)
    assert "\n" not in str(error.value)


def test_refuses_excessively_nested_components(tmp_path: Path) -> None:
    """Twelve levels of ten components are 10¹² tetrahedra in a small file."""
    levels = "".join(
        f'<object id="{k}"><components>' + f'<component objectid="{k - 1}"/>' * 10 + "</components></object>"
        for k in range(2, 14)
    )
    body = f'<resources><object id="1">{TETRA}</object>{levels}</resources><build><item objectid="13"/></build>'
    with pytest.raises(DataError, match="is damaged"):
        read_threemf(threemf_file(tmp_path / "e.3mf", body))


def test_refuses_files_that_are_not_3mf(tmp_path: Path) -> None:
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
