"""Layers of a print: volume, sections at mid-height, copies, images, archives and memory."""

import io
import json
import re
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image

from solen.curve import Segment
from solen.errors import DataError, DesignError, SpecError
from solen.fabricate import Mesh, Part, Prism, mesh_of
from solen.fabricate.layers import (
    Job,
    Orientation,
    Slicing,
    Solid,
    mesh_solid,
    orientation,
    rotation,
    solid_of,
    write_archive,
)
from solen.geometry import Face
from solen.parts import Printer, Quantity, library_printer
from solen.parts.printer import Pixels
from tests.fabricate.solid_support import design, part_of, seated

FLAT = orientation("flat")
ROUNDING = 0.5 / 255.0
"""Maximum error of the covered fraction of a pixel due to rounding to grey levels."""


def printer(
    pitch_um: float = 50.0, columns: int = 1200, rows: int = 1000, height_mm: float = 100.0, **tables: Any
) -> Printer:
    basis = {"basis": "measured", "source": "here"}
    return Printer(
        name="test",
        maker="test",
        document="test",
        pitch_um=Quantity(typical=pitch_um, **basis).model_dump(),
        pixels=Pixels(columns=columns, rows=rows, **basis).model_dump(),
        build_height_mm=Quantity(typical=height_mm, **basis).model_dump(),
        layer_um=Quantity(min=10, max=2000, **basis).model_dump(),
        **{key: {**basis, **table} for key, table in tables.items()},
    )


def job_of(solid: Solid, machine: Printer, **options: Any) -> Job:
    return Job(solid, machine, Slicing(**options))


def stack_mm3(job: Job) -> float:
    return sum(layer.area_mm2 for layer in job.layers()) * job.layer_mm


def closed(shape: object) -> Mesh:
    """Return the mesh of a trimesh body."""
    assert isinstance(shape, trimesh.Trimesh)
    return Mesh(np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int64), 0.0)


@pytest.mark.parametrize("name", ["flat", "upright", "on-edge"])
@pytest.mark.parametrize("seats", [False, True])
def test_a_stack_has_the_volume_of_the_solid(name: Orientation, seats: bool) -> None:
    """They agree within 0.05 %: edges are exact in a layer, which has the section at mid-height."""
    part = part_of(seated() if seats else design())
    job = job_of(solid_of(part, orientation(name)), printer(100.0, 600, 500), layer_um=100.0)
    assert stack_mm3(job) == pytest.approx(part.volume_mm3, rel=5e-4)


def test_a_stack_of_a_rotated_part_has_its_volume() -> None:
    part = part_of(design())
    job = job_of(solid_of(part, orientation("upright", (20.0, -35.0, 110.0))), printer(200.0, 400, 400), layer_um=200.0)
    assert stack_mm3(job) == pytest.approx(part.volume_mm3, rel=1e-3)


def test_layers_of_exact_outlines_agree_with_those_of_a_mesh() -> None:
    """For a tolerance of the mesh of 0.1 µm, they differ by 2 grey levels at most."""
    part, machine = part_of(seated()), printer(80.0, 600, 600)
    exact = job_of(solid_of(part, FLAT), machine, layer_um=100.0)
    meshed = job_of(mesh_solid(mesh_of(part, 1e-4), FLAT), machine, layer_um=100.0)
    assert exact.count == meshed.count
    for layer, mesh_layer in zip(exact.layers(), meshed.layers(), strict=True):
        assert np.abs(layer.image.astype(int) - mesh_layer.image).max() <= 2


def test_pockets_and_slots_are_in_the_correct_layers() -> None:
    """Of 80 layers, the slots are in the last two, and the pockets, 1.35 mm wide, in the middle."""
    job = job_of(solid_of(part_of(seated()), FLAT), printer(), layer_um=50.0)
    areas = np.array([layer.area_mm2 for layer in job.layers()])
    full, (with_pockets,), (with_slots,) = areas[0], set(areas[27:53].tolist()), set(areas[78:].tolist())
    assert full - with_pockets == pytest.approx(2 * 2.1 * 0.85, rel=0.02)
    assert with_slots < full - 5.0
    assert (areas[:26] == full).all()
    assert (areas[54:78] == full).all()


def test_layers_have_the_section_at_mid_height() -> None:
    """Layer i of a pyramid is a square with a side of 10 (1 − (i + ½) / 40)."""
    side = 10.0
    corners = np.array([(0, 0, 0), (side, 0, 0), (side, side, 0), (0, side, 0), (side / 2, side / 2, side)], float)
    faces = np.array([(0, 2, 1), (0, 3, 2), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)], np.int64)
    job = job_of(mesh_solid(Mesh(corners, faces, 0.0), FLAT), printer(25.0), layer_um=250.0)
    assert job.count == 40
    areas = [layer.area_mm2 for layer in job.layers()]
    sides = side * (1.0 - (np.arange(40) + 0.5) / 40)
    rounding = ROUNDING * 4 * (sides / 0.025 + 1) * 0.025**2
    assert (np.abs(areas - sides**2) <= rounding).all()


@pytest.mark.parametrize(
    ("height_mm", "count"),
    [(0.1, 4), (0.1124, 4), (0.1126, 5), (0.0876, 4), (0.0874, 3), (0.0126, 1), (4.0, 160), (0.3, 12)],
)
def test_the_last_layer_is_complete_or_omitted(height_mm: float, count: int) -> None:
    part = part_of(design(body__thickness_mm=height_mm))
    coarse = printer(400.0, 200, 150)
    job = job_of(solid_of(part, FLAT), coarse)
    layers = list(job.layers())
    assert job.count == len(layers) == count
    assert all(layer.area_mm2 > 200.0 for layer in layers)
    assert abs(job.height_mm - height_mm) <= 0.0125 + 1e-9
    meshed = job_of(mesh_solid(mesh_of(part, 1e-3), FLAT), printer())
    assert [layer.area_mm2 for layer in meshed.layers()] == pytest.approx(
        [layer.area_mm2 for layer in layers], rel=1e-4
    )


def test_an_upright_part_has_the_lens_last_and_no_islands() -> None:
    layers = list(
        job_of(solid_of(part_of(design()), orientation("upright")), printer(100.0, 200, 100), layer_um=200.0).layers()
    )
    assert layers[-1].area_mm2 < 0.25 * max(layer.area_mm2 for layer in layers)
    widths = [np.ptp(np.argwhere(layer.image)[:, 1]) for layer in layers]
    assert widths[2] > 3 * widths[-1], "the two arms are on the plate"
    assert sum(layer.islands for layer in layers) == 0


def test_counts_islands() -> None:
    """A table on one leg, with a lamp that hangs from its edge."""
    leg = trimesh.creation.box(bounds=[(0, 0, 0), (1, 1, 4)])
    top = trimesh.creation.box(bounds=[(0, 0, 4), (6, 1, 5)])
    lamp = trimesh.creation.box(bounds=[(5, 0, 2), (6, 1, 4)])
    shape = closed(trimesh.boolean.union([leg, top, lamp], engine="manifold"))
    layers = list(job_of(mesh_solid(shape, FLAT), printer(), layer_um=500.0).layers())
    assert [layer.index for layer in layers if layer.islands] == [4]
    assert layers[4].islands == 1


def test_default_exposures_and_doses_are_those_of_the_publication() -> None:
    job = job_of(solid_of(part_of(design(body__thickness_mm=0.25)), FLAT), printer())
    layers = list(job.layers())
    assert [layer.exposure_s for layer in layers] == [3.0] * 6 + [2.0] * 4
    assert [layer.dose_mJ_per_cm2 for layer in layers] == [39.0] * 6 + [26.0] * 4
    assert job.slicing.total_s(10) == 26.0
    assert job.slicing.total_s(3) == 9.0
    assert job.seconds is None, "the pause of this printer is unknown"
    generic = job_of(job.solid, library_printer("generic"))
    assert generic.seconds == 26.0 + 10 * 6.0


def test_copies_have_identical_pixels() -> None:
    part = part_of(design())
    single, multiple = (
        job_of(solid_of(part, FLAT), printer(50.0, 1600), layer_um=1000.0, copies=copies) for copies in (1, 5)
    )
    layer, plate = next(single.layers()), next(multiple.layers())
    assert plate.area_mm2 == pytest.approx(5 * layer.area_mm2, rel=1e-12)
    rows, columns = multiple.tile
    image = plate.image[::-1]
    tiles = [image[row : row + rows, column : column + columns] for row, column in multiple.corners]
    assert all((tile == single.copy_of_layer(0)).all() for tile in tiles)
    assert (multiple.copy_of_layer(0) == tiles[0]).all()
    assert image.sum(dtype=int) == 5 * layer.image.sum(dtype=int)
    positions = np.array(multiple.positions_mm)
    gaps = np.abs(positions[:, None] - positions[None]) - np.array(multiple.solid.size_mm[:2])
    assert (gaps.max(axis=2)[~np.eye(5, dtype=bool)] >= 2.0 - 0.051).all(), "2 mm, rounded to pixels"


def test_a_symmetric_part_has_a_symmetric_image() -> None:
    """The axis of the lens is between two pixels: its halves agree to one grey level for any pitch."""
    for pitch_um in (27.0, 50.0, 62.0):
        job = job_of(solid_of(part_of(design()), FLAT), printer(pitch_um, 2500, 2500), layer_um=1000.0)
        image = job.copy_of_layer(0).astype(int)
        assert np.abs(image - image[:, ::-1]).max() <= 1


def test_the_origin_is_at_a_corner_of_pixels() -> None:
    """A square from 0.1 to 0.5 mm lights 4 by 4 pixels of 0.1 mm, none of them partly."""
    box = trimesh.creation.box(bounds=[(0.1, 0.1, 0), (0.5, 0.5, 1)])
    job = job_of(mesh_solid(closed(box), FLAT), printer(100.0, 21, 21), layer_um=1000.0)
    image = next(job.layers()).image
    assert set(np.unique(image).tolist()) == {0, 255}
    assert (image == 255).sum() == 16
    (x, y), lit = job.positions_mm[0], np.argwhere(image[::-1])
    centre = (lit.mean(axis=0) + 0.5 - 10.5) * 0.1
    assert (y, x) == pytest.approx(tuple(centre), abs=1e-12)


def mirrored(job: Job, mirror: str) -> Job:
    return job_of(job.solid, job.printer, layer_um=job.slicing.layer_um, mirror=mirror)


def test_mirrors_flip_the_image() -> None:
    job = job_of(solid_of(part_of(design()), orientation("flat", (0.0, 0.0, 30.0))), printer(), layer_um=1000.0)
    image = next(job.layers()).image
    assert (next(mirrored(job, "x").layers()).image == image[:, ::-1]).all()
    assert (next(mirrored(job, "y").layers()).image == image[::-1]).all()


def test_rotations_about_axes() -> None:
    assert rotation((90.0, 0.0, 0.0)) @ (0, 1, 0) == pytest.approx((0, 0, 1))
    assert rotation((0.0, 90.0, 0.0)) @ (0, 0, 1) == pytest.approx((1, 0, 0))
    assert rotation((0.0, 0.0, 90.0)) @ (1, 0, 0) == pytest.approx((0, 1, 0))
    assert rotation((90.0, 0.0, 90.0)) @ (0, 0, 1) == pytest.approx((1, 0, 0)), "X first, to (0, -1, 0)"
    assert orientation("upright") @ (0, -1, 0) == pytest.approx((0, 0, 1))
    assert orientation("on-edge") @ (1, 0, 0) == pytest.approx((0, 0, 1))
    for angles in ((10.0, 20.0, 30.0), (-170.0, 360.0, 45.0)):
        matrix = rotation(angles)
        assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-15)
        assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_layers_of_stacked_prisms() -> None:
    def square(x: float, size: float) -> NDArray[np.float64]:
        return np.array([(x, 0.0), (x + size, 0.0), (x + size, size), (x, size)])

    def prism(name: str, ring: NDArray[np.float64], low: float, high: float) -> Prism:
        sides = zip(ring.tolist(), np.roll(ring, -1, axis=0).tolist(), strict=True)
        return Prism(name, (tuple(Face("side", Segment((*a,), (*b,))) for a, b in sides),), low, high)

    part = Part("z reference", (prism("base", square(0, 10), 0.0, 0.8), prism("pillar", square(3, 3), 0.8, 1.8)))
    areas = [layer.area_mm2 for layer in job_of(solid_of(part, FLAT), printer(), layer_um=100.0).layers()]
    assert areas == pytest.approx([100.0] * 8 + [9.0] * 10, rel=1e-9)


def archived_files(job: Job, path: Path) -> dict[str, bytes]:
    write_archive(path, job)
    with zipfile.ZipFile(path) as opened:
        assert opened.testzip() is None
        return {name: opened.read(name) for name in opened.namelist()}


def test_the_archive_contains_layers_that_pillow_reads(tmp_path: Path) -> None:
    job = job_of(solid_of(part_of(seated()), FLAT), printer(), layer_um=500.0, copies=2)
    contents = archived_files(job, tmp_path / "a.zip")
    table = json.loads(contents["job.json"])
    layers = list(job.layers())
    assert [row["file"] for row in table["layers"]] == [f"{number}.png" for number in range(1, 9)]
    for row, layer in zip(table["layers"], layers, strict=True):
        with Image.open(io.BytesIO(contents[row["file"]])) as image:
            assert image.mode == "L"
            assert image.info["dpi"] == pytest.approx((508.0, 508.0), abs=0.01), "50 µm"
            assert (np.asarray(image) == layer.image).all()
        assert (row["exposure_s"], row["dose_mJ_per_cm2"]) == (layer.exposure_s, layer.dose_mJ_per_cm2)
        assert row["area_mm2"] == layer.area_mm2
        assert row["to_mm"] - row["from_mm"] == pytest.approx(0.5, abs=1e-9)
    assert table["stack_volume_mm3"] == pytest.approx(stack_mm3(job), rel=1e-12)
    assert table["solid_volume_mm3"] == pytest.approx(job.volume_mm3, rel=1e-12)
    assert table["pixels"] == {"columns": 1200, "rows": 1000}
    assert table["pitch_mm"] == [0.05, 0.05]
    assert "mid-height of the layer" in table["rule"]


def test_archives_are_reproducible(tmp_path: Path) -> None:
    for name in ("a.zip", "b.zip"):
        job = job_of(solid_of(part_of(seated()), orientation("on-edge")), printer(), layer_um=1000.0)
        write_archive(tmp_path / name, job)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


def test_memory_does_not_grow_with_the_number_of_layers(tmp_path: Path) -> None:
    """A cone has 30 or 120 different layers on 960 × 540 pixels, 0.5 MB per image."""
    cone = closed(trimesh.creation.cone(20.0, 12.0, sections=60))
    machine, peaks = printer(100.0, 960, 540), []
    solid = mesh_solid(cone, FLAT)
    for layer_um in (400.0, 100.0):
        job = job_of(solid, machine, layer_um=layer_um)
        tracemalloc.start()
        write_archive(tmp_path / "a.zip", job)
        peaks.append(tracemalloc.get_traced_memory()[1] / 1e6)
        tracemalloc.stop()
    assert job.count == 120
    assert peaks[1] < peaks[0] + 1.0, "in MB; the rows in job.json require some memory"
    assert peaks[1] < 15.0


@pytest.mark.parametrize(
    ("change", "texts"),
    [
        ({"layer_um": 5.0}, "--layer-um = 5.0; ... 10 to 2000 µm ... test"),
        ({"layer_um": float("nan")}, "layer_um = nan"),
        ({"copies": 0}, "copies = 0; must be"),
        ({"copies": 5}, "--copies = 5; ... at most 4 ... 60 x 50 x 100 mm"),
        ({"gap_mm": -1.0}, "gap_mm = -1.0; must be"),
        ({"mirror": "z"}, "mirror = 'z'; must be 'none', 'x' or 'y'"),
        ({"printer": printer(50.0, 1000, 800)}, "50 x 40 x 100 mm; ... --rotate-deg 0 0 90"),
        ({"printer": printer(50.0, 1200, 1000, 3.0)}, "4 mm ... 60 x 50 x 3 mm; choose a larger printer"),
        ({"printer": printer(50.0, 100, 300, 45.0)}, "5 x 15 x 45 mm; ... another --orientation"),
        ({"printer": printer(10.0, 1180, 4100)}, "part; ... 11.81 x 40.41 x 4 mm ... 11.8 x 41 x 100 mm"),
    ],
)
def test_refuses_jobs_that_cannot_be_printed(change: dict[str, Any], texts: str) -> None:
    solid, options = solid_of(part_of(design()), FLAT), {"printer": printer()} | change
    pattern = ".*".join(re.escape(text) for text in texts.split(" ... "))
    with pytest.raises((SpecError, DesignError), match=pattern) as error:
        job_of(solid, options.pop("printer"), **options)
    assert "\n" not in str(error.value)


def test_a_part_may_fill_the_build_area() -> None:
    """11.806 mm require 1182 pixels of 10 µm, of which those at the edges are partly lit."""
    image = next(job_of(solid_of(part_of(design()), FLAT), printer(10.0, 1182, 4042), layer_um=2000.0).layers()).image
    assert image[:, 0].any()
    assert image[:, -1].any()


def test_refuses_a_part_too_large_for_all_printers() -> None:
    box = mesh_solid(closed(trimesh.creation.box((900.0, 900.0, 3.0))), FLAT)
    with pytest.raises(DesignError, match="or divide it"):
        job_of(box, printer())


def test_refuses_a_part_thinner_than_half_a_layer() -> None:
    solid = solid_of(part_of(design(body__thickness_mm=0.02)), FLAT)
    with pytest.raises(DesignError, match=r"part; .*20 µm.*half a layer of 50 µm"):
        job_of(solid, printer(), layer_um=50.0)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("burn_in_layers", -1),
        ("burn_in_s", 0.0),
        ("exposure_s", float("inf")),
        ("irradiance_mW_per_cm2", -13.0),
        ("rotate_deg", (0.0, float("nan"), 0.0)),
        ("orientation", "sideways"),
    ],
)
def test_refuses_options_outside_their_range(option: str, value: object) -> None:
    with pytest.raises(SpecError, match=option):
        Slicing(**{option: value})


def test_refuses_open_empty_and_inverted_meshes() -> None:
    box = closed(trimesh.creation.box((1.0, 2.0, 3.0)))
    with pytest.raises(DataError, match=r"x\.stl; .*watertight: 3 edges"):
        mesh_solid(Mesh(box.vertices, box.triangles[1:], 0.0), FLAT, "x.stl")
    sheet = Mesh(box.vertices * (1.0, 1.0, 0.0), box.triangles, 0.0)
    with pytest.raises(DataError, match="encloses no volume"):
        mesh_solid(sheet, FLAT)
    with pytest.raises(DataError, match="no triangles"):
        mesh_solid(Mesh(box.vertices, box.triangles[:0], 0.0), FLAT)
    with pytest.raises(DataError, match="is inside out"):
        mesh_solid(Mesh(box.vertices, box.triangles[:, ::-1], 0.0), FLAT)


def test_overlapping_bodies_are_united() -> None:
    boxes = [trimesh.creation.box(bounds=[(x, 0, 0), (x + 2, 2, 1)]) for x in (0.0, 1.0)]
    solid = mesh_solid(closed(trimesh.util.concatenate(boxes)), FLAT)
    layer = next(job_of(solid, printer(), layer_um=500.0).layers())
    assert layer.area_mm2 == pytest.approx(6.0, rel=1e-9)
