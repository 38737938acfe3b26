"""Layers of a print: their volume, the rule of the middle, copies, images as Pillow opens them, and memory."""

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

from solen.errors import DataError, DesignError, SpecError
from solen.fabricate import Mesh, Part, Prism, mesh_of
from solen.fabricate.layers import (
    Job,
    Orientation,
    Slicing,
    Solid,
    mesh_solid,
    orientation,
    solid_of,
    turned,
    write_archive,
)
from solen.parts import Printer, Quantity, library_printer
from solen.parts.printer import Pixels
from tests.fabricate.solid_support import design, part_of, seated

FLAT = orientation("flat")
GREY = 0.5 / 255.0
"""What rounding to a grey value may shift a pixel's share by."""


def printer(
    pitch_um: float = 50.0, columns: int = 1200, rows: int = 1000, height_mm: float = 100.0, **more: Any
) -> Printer:
    said = {"basis": "measured", "source": "here"}
    return Printer(
        name="test",
        maker="test",
        document="test",
        pitch_um=Quantity(typical=pitch_um, **said).model_dump(),
        pixels=Pixels(columns=columns, rows=rows, **said).model_dump(),
        build_height_mm=Quantity(typical=height_mm, **said).model_dump(),
        layer_um=Quantity(min=10, max=2000, **said).model_dump(),
        **{key: {**said, **table} for key, table in more.items()},
    )


def job_of(solid: Solid, place: Printer, **options: Any) -> Job:
    """A job with some options of slicing."""
    return Job(solid, place, Slicing(**options))


def stack_mm3(job: Job) -> float:
    return sum(layer.area_mm2 for layer in job.layers()) * job.layer_mm


def closed(shape: object) -> Mesh:
    """Mesh of a body that trimesh makes."""
    assert isinstance(shape, trimesh.Trimesh)
    return Mesh(np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int64), 0.0)


@pytest.mark.parametrize("name", ["flat", "upright", "on-edge"])
@pytest.mark.parametrize("seats", [False, True])
def test_the_stack_has_the_volume_of_the_solid(name: Orientation, seats: bool) -> None:
    """Within 0.05 %, a tenth of what is asked: edges are exact in a layer, and its middle stands for all of it."""
    part = part_of(seated() if seats else design())
    job = job_of(solid_of(part, orientation(name)), printer(100.0, 600, 500), layer_um=100.0)
    assert stack_mm3(job) == pytest.approx(part.volume_mm3, rel=5e-4)


def test_any_rotation_keeps_the_volume() -> None:
    part = part_of(design())
    job = job_of(solid_of(part, orientation("upright", (20.0, -35.0, 110.0))), printer(200.0, 400, 400), layer_um=200.0)
    assert stack_mm3(job) == pytest.approx(part.volume_mm3, rel=1e-3)


def test_a_sensor_that_lies_flat_is_cut_as_its_mesh_is() -> None:
    """From exact outlines and from triangles within 0.1 µm: not a grey value's difference that more could explain."""
    part, place = part_of(seated()), printer(80.0, 600, 600)
    exact = job_of(solid_of(part, FLAT), place, layer_um=100.0)
    meshed = job_of(mesh_solid(mesh_of(part, 1e-4), FLAT), place, layer_um=100.0)
    assert exact.count == meshed.count
    for one, other in zip(exact.layers(), meshed.layers(), strict=True):
        assert np.abs(one.image.astype(int) - other.image).max() <= 2


def test_pockets_and_slots_are_where_they_are_cut() -> None:
    """4 mm at 50 µm: the slots of 0.1 mm are the last two layers, the pockets 1.35 mm about the middle."""
    job = job_of(solid_of(part_of(seated()), FLAT), printer(), layer_um=50.0)
    areas = np.array([layer.area_mm2 for layer in job.layers()])
    whole, (pocketed,), (slotted,) = areas[0], set(areas[27:53].tolist()), set(areas[78:].tolist())
    assert whole - pocketed == pytest.approx(2 * 2.1 * 0.85, rel=0.02), "pixels round at most half a grey value each"
    assert slotted < whole - 5.0
    assert (areas[:26] == whole).all()
    assert (areas[54:78] == whole).all()


def test_the_middle_of_a_layer_counts() -> None:
    """A pyramid of 10 mm by 10 mm: layer i has the square of side 10 (1 − (i + ½) / 40) exactly."""
    side = 10.0
    corners = np.array([(0, 0, 0), (side, 0, 0), (side, side, 0), (0, side, 0), (side / 2, side / 2, side)], float)
    faces = np.array([(0, 2, 1), (0, 3, 2), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)], np.int64)
    job = job_of(mesh_solid(Mesh(corners, faces, 0.0), FLAT), printer(25.0), layer_um=250.0)
    assert job.count == 40
    areas = [layer.area_mm2 for layer in job.layers()]
    sides = side * (1.0 - (np.arange(40) + 0.5) / 40)
    rounding = GREY * 4 * (sides / 0.025 + 1) * 0.025**2
    assert (np.abs(areas - sides**2) <= rounding).all()


@pytest.mark.parametrize(
    ("height_mm", "count"),
    [(0.1, 4), (0.1124, 4), (0.1126, 5), (0.0876, 4), (0.0874, 3), (0.0126, 1), (4.0, 160), (0.3, 12)],
)
def test_a_last_layer_is_whole_or_left_out(height_mm: float, count: int) -> None:
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


def test_upright_the_lens_comes_last_and_nothing_begins_in_the_air() -> None:
    layers = list(
        job_of(solid_of(part_of(design()), orientation("upright")), printer(100.0, 200, 100), layer_um=200.0).layers()
    )
    assert layers[-1].area_mm2 < 0.25 * max(layer.area_mm2 for layer in layers)
    widths = [np.ptp(np.argwhere(layer.image)[:, 1]) for layer in layers]
    assert widths[2] > 3 * widths[-1], "two arms stand on the plate"
    assert sum(layer.islands for layer in layers) == 0


def test_pieces_that_begin_in_the_air_are_counted() -> None:
    """A table on one leg, with a lamp that hangs from its edge beside the leg."""
    leg = trimesh.creation.box(bounds=[(0, 0, 0), (1, 1, 4)])
    top = trimesh.creation.box(bounds=[(0, 0, 4), (6, 1, 5)])
    lamp = trimesh.creation.box(bounds=[(5, 0, 2), (6, 1, 4)])
    shape = closed(trimesh.boolean.union([leg, top, lamp], engine="manifold"))
    layers = list(job_of(mesh_solid(shape, FLAT), printer(), layer_um=500.0).layers())
    assert [layer.index for layer in layers if layer.islands] == [4]
    assert layers[4].islands == 1


def test_exposures_and_doses_are_the_papers() -> None:
    job = job_of(solid_of(part_of(design(body__thickness_mm=0.25)), FLAT), printer())
    layers = list(job.layers())
    assert [layer.exposure_s for layer in layers] == [3.0] * 6 + [2.0] * 4
    assert [layer.dose_mJ_per_cm2 for layer in layers] == [39.0] * 6 + [26.0] * 4
    assert job.slicing.total_s(10) == 26.0
    assert job.slicing.total_s(3) == 9.0
    assert job.seconds is None, "this printer's pause is not known"
    other = job_of(job.solid, library_printer("generic"))
    assert other.seconds == 26.0 + 10 * 6.0


def test_every_copy_is_drawn_by_the_same_pixels() -> None:
    part = part_of(design())
    one, several = (
        job_of(solid_of(part, FLAT), printer(50.0, 1600), layer_um=1000.0, copies=copies) for copies in (1, 5)
    )
    single, plate = next(one.layers()), next(several.layers())
    assert plate.area_mm2 == pytest.approx(5 * single.area_mm2, rel=1e-12)
    rows, columns = several.tile
    image = plate.image[::-1]
    tiles = [image[row : row + rows, column : column + columns] for row, column in several.corners]
    assert all((tile == one.copy_of_layer(0)).all() for tile in tiles)
    assert (several.copy_of_layer(0) == tiles[0]).all()
    assert image.sum(dtype=int) == 5 * single.image.sum(dtype=int), "and nothing lies between them"
    places = np.array(several.places_mm)
    apart = np.abs(places[:, None] - places[None]) - np.array(several.solid.size_mm[:2])
    assert (apart.max(axis=2)[~np.eye(5, dtype=bool)] >= 2.0 - 0.051).all(), "2 mm but for whole pixels"


def test_a_symmetric_part_gives_a_symmetric_image() -> None:
    """The lens' axis lies between two pixels, so its two halves are the same to one grey value, at any pitch."""
    for pitch_um in (27.0, 50.0, 62.0):
        job = job_of(solid_of(part_of(design()), FLAT), printer(pitch_um, 2500, 2500), layer_um=1000.0)
        image = job.copy_of_layer(0).astype(int)
        assert np.abs(image - image[:, ::-1]).max() <= 1


def test_the_origin_lies_on_a_corner_of_pixels() -> None:
    """A square from 0.1 to 0.5 mm of the origin on pixels of 0.1 mm: 4 by 4 of them are lit, none partly."""
    box = trimesh.creation.box(bounds=[(0.1, 0.1, 0), (0.5, 0.5, 1)])
    job = job_of(mesh_solid(closed(box), FLAT), printer(100.0, 21, 21), layer_um=1000.0)
    image = next(job.layers()).image
    assert set(np.unique(image).tolist()) == {0, 255}
    assert (image == 255).sum() == 16
    (x, y), lit = job.places_mm[0], np.argwhere(image[::-1])
    middle = (lit.mean(axis=0) + 0.5 - 10.5) * 0.1
    assert (y, x) == pytest.approx(tuple(middle), abs=1e-12)


def mirrored(job: Job, mirror: str) -> Job:
    return job_of(job.solid, job.printer, layer_um=job.slicing.layer_um, mirror=mirror)


def test_mirrors_flip_the_image() -> None:
    job = job_of(solid_of(part_of(design()), orientation("flat", (0.0, 0.0, 30.0))), printer(), layer_um=1000.0)
    plain = next(job.layers()).image
    assert (next(mirrored(job, "x").layers()).image == plain[:, ::-1]).all()
    assert (next(mirrored(job, "y").layers()).image == plain[::-1]).all()


def test_rotations_are_those_of_their_axes() -> None:
    assert turned((90.0, 0.0, 0.0)) @ (0, 1, 0) == pytest.approx((0, 0, 1))
    assert turned((0.0, 90.0, 0.0)) @ (0, 0, 1) == pytest.approx((1, 0, 0))
    assert turned((0.0, 0.0, 90.0)) @ (1, 0, 0) == pytest.approx((0, 1, 0))
    assert turned((90.0, 0.0, 90.0)) @ (0, 0, 1) == pytest.approx((1, 0, 0)), "X first: (0, -1, 0)"
    assert orientation("upright") @ (0, -1, 0) == pytest.approx((0, 0, 1))
    assert orientation("on-edge") @ (1, 0, 0) == pytest.approx((0, 0, 1))
    for angles in ((10.0, 20.0, 30.0), (-170.0, 360.0, 45.0)):
        found = turned(angles)
        assert found @ found.T == pytest.approx(np.eye(3), abs=1e-15)
        assert np.linalg.det(found) == pytest.approx(1.0)


def test_touching_prisms_are_cut_between_their_heights() -> None:
    def square(x: float, size: float) -> NDArray[np.float64]:
        return np.array([(x, 0.0), (x + size, 0.0), (x + size, size), (x, size)])

    from solen.curve import Segment
    from solen.geometry import Face

    def prism(name: str, ring: NDArray[np.float64], low: float, high: float) -> Prism:
        sides = zip(ring.tolist(), np.roll(ring, -1, axis=0).tolist(), strict=True)
        return Prism(name, (tuple(Face("side", Segment((*a,), (*b,))) for a, b in sides),), low, high)

    part = Part("z reference", (prism("base", square(0, 10), 0.0, 0.8), prism("pillar", square(3, 3), 0.8, 1.8)))
    areas = [layer.area_mm2 for layer in job_of(solid_of(part, FLAT), printer(), layer_um=100.0).layers()]
    assert areas == pytest.approx([100.0] * 8 + [9.0] * 10, rel=1e-9)


def archive(job: Job, path: Path) -> dict[str, bytes]:
    write_archive(path, job)
    with zipfile.ZipFile(path) as opened:
        assert opened.testzip() is None
        return {name: opened.read(name) for name in opened.namelist()}


def test_the_archive_holds_the_layers_as_pillow_opens_them(tmp_path: Path) -> None:
    job = job_of(solid_of(part_of(seated()), FLAT), printer(), layer_um=500.0, copies=2)
    found = archive(job, tmp_path / "a.zip")
    told = json.loads(found["job.json"])
    layers = list(job.layers())
    assert [row["file"] for row in told["layers"]] == [f"{number}.png" for number in range(1, 9)]
    for row, layer in zip(told["layers"], layers, strict=True):
        (tmp_path / "one.png").write_bytes(found[row["file"]])
        with Image.open(tmp_path / "one.png") as image:
            assert image.mode == "L"
            assert image.info["dpi"] == pytest.approx((508.0, 508.0), abs=0.01), "50 µm"
            assert (np.asarray(image) == layer.image).all()
        assert (row["exposure_s"], row["dose_mJ_per_cm2"]) == (layer.exposure_s, layer.dose_mJ_per_cm2)
        assert row["area_mm2"] == layer.area_mm2
        assert row["to_mm"] - row["from_mm"] == pytest.approx(0.5, abs=1e-9)
    assert told["stack_volume_mm3"] == pytest.approx(stack_mm3(job), rel=1e-12)
    assert told["solid_volume_mm3"] == pytest.approx(job.volume_mm3, rel=1e-12)
    assert told["pixels"] == {"columns": 1200, "rows": 1000}
    assert told["pitch_mm"] == [0.05, 0.05]
    assert "mid-height of the layer" in told["rule"]


def test_the_same_job_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.zip", "b.zip"):
        job = job_of(solid_of(part_of(seated()), orientation("on-edge")), printer(), layer_um=1000.0)
        write_archive(tmp_path / name, job)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


def test_more_layers_need_no_more_memory(tmp_path: Path) -> None:
    """120 layers of a cone, each another one, on 960 × 540 pixels, which is 0.5 MB an image."""
    cone = closed(trimesh.creation.cone(20.0, 12.0, sections=60))
    place, peaks = printer(100.0, 960, 540), []
    solid = mesh_solid(cone, FLAT)
    for layer_um in (400.0, 100.0):
        job = job_of(solid, place, layer_um=layer_um)
        tracemalloc.start()
        write_archive(tmp_path / "a.zip", job)
        peaks.append(tracemalloc.get_traced_memory()[1] / 1e6)
        tracemalloc.stop()
    assert job.count == 120
    assert peaks[1] < peaks[0] + 1.0, "MB: four times the layers add their rows in job.json"
    assert peaks[1] < 15.0


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"layer_um": 5.0}, "--layer-um = 5.0; test makes layers of 10 to 2000 µm; choose another printer"),
        ({"layer_um": float("nan")}, "layer_um = nan"),
        ({"copies": 0}, "copies = 0; must be"),
        (
            {"copies": 5},
            "--copies = 5; test builds 60 x 50 x 100 mm, which has space for at most 4 copies 2 mm apart; print fewer",
        ),
        ({"gap_mm": -1.0}, "gap_mm = -1.0; must be"),
        ({"mirror": "z"}, "mirror = 'z'; must be 'none', 'x' or 'y'"),
        ({"printer": printer(50.0, 1000, 800)}, "builds 50 x 40 x 100 mm; rotate the part with --rotate-deg 0 0 90"),
        ({"printer": printer(50.0, 1200, 1000, 3.0)}, "4 mm'; test builds 60 x 50 x 3 mm; choose a larger printer"),
        ({"printer": printer(50.0, 100, 300, 45.0)}, "builds 5 x 15 x 45 mm; print the part in another --orientation"),
        ({"printer": printer(10.0, 1180, 4100)}, "part = '11.81 x 40.41 x 4 mm'; test builds 11.8 x 41 x 100 mm"),
    ],
)
def test_a_job_that_cannot_be_is_one_line(change: dict[str, Any], line: str) -> None:
    solid = solid_of(part_of(design()), FLAT)
    with pytest.raises((SpecError, DesignError), match=re.escape(line)) as bad:
        job_of(solid, change.pop("printer", None) or printer(), **change)
    assert "\n" not in str(bad.value)


def test_a_part_fits_to_the_pixel() -> None:
    """11.806 mm on 1182 pixels of 10 µm, with the 2 on its edges partly lit."""
    image = next(job_of(solid_of(part_of(design()), FLAT), printer(10.0, 1182, 4042), layer_um=2000.0).layers()).image
    assert image[:, 0].any()
    assert image[:, -1].any()


def test_a_part_that_no_printer_builds() -> None:
    box = mesh_solid(closed(trimesh.creation.box((900.0, 900.0, 3.0))), FLAT)
    with pytest.raises(DesignError, match="or divide it"):
        job_of(box, printer())


def test_what_is_thinner_than_half_a_layer_is_none() -> None:
    solid = solid_of(part_of(design(body__thickness_mm=0.02)), FLAT)
    with pytest.raises(DesignError, match=r"part = '20 µm high'; must be at least half a layer of 50 µm"):
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
def test_an_option_out_of_range_is_refused(option: str, value: object) -> None:
    with pytest.raises(SpecError, match=option):
        Slicing(**{option: value})


def test_open_empty_and_inverted_meshes_are_refused() -> None:
    box = closed(trimesh.creation.box((1.0, 2.0, 3.0)))
    with pytest.raises(DataError, match=r"x\.stl = '3 open edges'; must be watertight"):
        mesh_solid(Mesh(box.vertices, box.triangles[1:], 0.0), FLAT, "x.stl")
    sheet = Mesh(box.vertices * (1.0, 1.0, 0.0), box.triangles, 0.0)
    with pytest.raises(DataError, match="encloses no volume"):
        mesh_solid(sheet, FLAT)
    with pytest.raises(DataError, match="is empty"):
        mesh_solid(Mesh(box.vertices, box.triangles[:0], 0.0), FLAT)
    with pytest.raises(DataError, match="is inside out"):
        mesh_solid(Mesh(box.vertices, box.triangles[:, ::-1], 0.0), FLAT)


def test_two_bodies_that_overlap_are_lit_once() -> None:
    boxes = [closed(trimesh.creation.box(bounds=[(x, 0, 0), (x + 2, 2, 1)])) for x in (0.0, 1.0)]
    both = Mesh(
        np.vstack([box.vertices for box in boxes]), np.vstack([boxes[0].triangles, boxes[1].triangles + 8]), 0.0
    )
    solid: Solid = mesh_solid(both, FLAT)
    layer = next(job_of(solid, printer(), layer_um=500.0).layers())
    assert layer.area_mm2 == pytest.approx(6.0, rel=1e-9)
