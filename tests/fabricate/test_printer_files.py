"""Files for printers, read back by readers written from the formats' descriptions; areas against the solid."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from shapely.geometry import Polygon

from solen.errors import SpecError
from solen.fabricate.layers import (
    Job,
    Slicing,
    Solid,
    checked_for_goo,
    mesh_solid,
    orientation,
    solid_of,
    write_archive,
    write_goo,
)
from solen.fabricate.layers.goo import encoded
from solen.fabricate.layers.solid import Exposures
from solen.parts import Printer, library_printer, printers
from tests.fabricate.solid_support import part_of, seated
from tests.fabricate.stack_readers import Read, read_goo, read_uvtools_zip
from tests.fabricate.test_layers import closed, printer

LIFT: dict[str, Any] = {
    "bottom_height_mm": 7, "height_mm": 5, "bottom_speed_mm_per_min": 80, "speed_mm_per_min": 100,
    "retract_mm_per_min": 150, "bottom_wait_before_s": 3, "wait_before_s": 2.5,
}  # fmt: skip
WITHIN = 5e-3
"""Relative difference of an area that is allowed."""


def place(columns: int = 700, rows: int = 300, **more: Any) -> Printer:
    """Pixels of 40 by 60 µm."""
    return printer(40.0, columns, rows, pitch_y_um={"typical": 60.0}, lift=LIFT, **more)


def cone() -> Solid:
    """A cone of 16 mm by 8 mm with a square of 2 mm cut out beside its axis: no section is its mirror image."""
    shape = trimesh.creation.cone(8.0, 8.0, sections=90)
    cut = trimesh.creation.box(bounds=[(1.0, 0.5, -1.0), (3.0, 2.5, 2.0)])
    return mesh_solid(closed(trimesh.boolean.difference([shape, cut], engine="manifold")), orientation("flat"))


def sections_mm2(job: Job) -> Iterator[float]:
    """Area of the solid at the middle of each layer, by shapely."""
    for index in range(job.count):
        rings = job.solid.section((index + 0.5) * job.layer_mm)[1]
        yield sum(_signed_mm2(ring) for ring in rings)


def _signed_mm2(ring: NDArray[np.float64]) -> float:
    polygon = Polygon(ring)
    return float(polygon.area if polygon.exterior.is_ccw else -polygon.area)


def areas_mm2(read: Read, pixel_mm2: float) -> list[float]:
    return [float(picture.sum(dtype=np.int64)) / 255.0 * pixel_mm2 for _, picture in read.layers]


@pytest.mark.parametrize("whose", ["goo", "zip"])
def test_areas_read_back_are_those_of_the_solid(tmp_path: Path, whose: str) -> None:
    job = Job(cone(), place(), Slicing(layer_um=400.0, burn_in_layers=3, phase_px=(0.3, 0.7)))
    write, read = {"goo": (write_goo, read_goo), "zip": (write_archive, read_uvtools_zip)}[whose]
    stack = write(tmp_path / "a", job)
    found = areas_mm2(read(tmp_path / "a"), 0.04 * 0.06)
    expected = list(sections_mm2(job))
    assert len(found) == stack.layers == len(expected) == 20
    assert found[:-1] == pytest.approx(expected[:-1], rel=WITHIN)
    assert found[-1] == pytest.approx(expected[-1], rel=0.05), "the tip is 0.4 mm wide"


def test_a_goo_states_burn_in_by_its_bottom_layers(tmp_path: Path) -> None:
    wide = place(mirror={"axis": "x"})
    job = Job(cone(), wide, Slicing(layer_um=400.0, burn_in_layers=3, burn_in_s=3.5, exposure_s=2.25))
    write_goo(tmp_path / "a.goo", job)
    read = read_goo(tmp_path / "a.goo")
    header = read.header
    assert (header["bottom_layers"], header["bottom_exposure_s"], header["exposure_s"]) == (3, 3.5, 2.25)
    assert header["each_layer"] is False
    assert header["transition_layers"] == 0
    assert (header["columns"], header["rows"], header["layers"]) == (700, 300, 20)
    assert (header["width_mm"], header["depth_mm"], header["height_mm"]) == pytest.approx((28.0, 18.0, 100.0))
    assert header["layer_mm"] == pytest.approx(0.4)
    assert (header["mirror_x"], header["mirror_y"]) == (True, False)
    assert header["full_grey"] == 1
    assert (header["bottom_light"], header["light"]) == (255, 255)
    assert (header["bottom_lift_mm"], header["lift_mm"], header["retract_speed"]) == (7.0, 5.0, 150.0)
    assert (header["bottom_retract_mm"], header["retract_mm"]) == (7.0, 5.0), "down as far as up"
    assert header["volume_mm3"] == pytest.approx(job.volume_mm3, rel=1e-6)
    entries = [entry for entry, _ in read.layers]
    assert [entry["exposure_s"] for entry in entries] == [3.5] * 3 + [2.25] * 17
    assert [entry["lift_mm"] for entry in entries] == [7.0] * 3 + [5.0] * 17
    assert [entry["before_cure_s"] for entry in entries] == [3.0] * 3 + [2.5] * 17
    rises = [after["z_mm"] - before["z_mm"] for before, after in pairwise(entries)]
    assert rises == pytest.approx([0.4] * 19, abs=1e-5)
    for (_, picture), layer in zip(read.layers, job.layers(), strict=True):
        assert (picture == layer.image).all()


def test_the_manifest_is_what_uvtools_looks_for(tmp_path: Path) -> None:
    write_archive(tmp_path / "a.zip", Job(cone(), place(), Slicing(layer_um=400.0)))
    read = read_uvtools_zip(tmp_path / "a.zip")
    about = {key: float(value) for key, value in read.header.items() if not key.endswith("By")}
    sizes = {"ResolutionX": 700, "ResolutionY": 300, "DisplayWidth": 28.0, "DisplayHeight": 18.0, "MachineZ": 100.0}
    assert about == {"LayerHeight": 0.4} | sizes
    assert {picture.shape for _, picture in read.layers} == {(300, 700)}
    assert {picture.dtype for _, picture in read.layers} == {np.dtype("uint8")}


def test_runs_of_every_length_come_back(tmp_path: Path) -> None:
    """Random runs about the lengths at which the number of bytes changes, and of each kind."""
    rng = np.random.default_rng(7)
    lengths = np.array([1, 15, 16, 17, 4095, 4096, 4097, 1 << 20, (1 << 20) - 1, (1 << 20) + 1, 3, 250])
    for _ in range(5):
        rng.shuffle(lengths)
        flat = np.repeat(rng.choice([0, 1, 7, 128, 254, 255], len(lengths)), lengths).astype(np.uint8)
        image = np.append(flat, np.zeros(-flat.size % 1000, np.uint8)).reshape(-1, 1000)
        header = read_of(image, tmp_path)
        assert (header == image).all()


def read_of(image: NDArray[np.uint8], folder: Path) -> NDArray[np.uint8]:
    """One picture through a whole file: a layer of a box whose runs are replaced."""
    rows, columns = image.shape
    box = mesh_solid(closed(trimesh.creation.box((1.0, 1.0, 1.0))), orientation("flat"))
    write_goo(folder / "box.goo", Job(box, place(columns, rows), Slicing(layer_um=1000.0)))
    data = (folder / "box.goo").read_bytes()
    start, runs = 195477 + 70, encoded(image)
    head = data[: start - 4] + len(runs).to_bytes(4, "big")
    (folder / "own.goo").write_bytes(head + runs + b"\r\n" + data[-11:])
    return read_goo(folder / "own.goo").layers[0][1]


def test_the_same_job_gives_the_same_goo(tmp_path: Path) -> None:
    for name in "ab":
        write_goo(
            tmp_path / name, Job(solid_of(part_of(seated()), np.eye(3)), place(900, 700), Slicing(layer_um=1000.0))
        )
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def discs() -> Exposures:
    ring = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
    shifted = ring + np.array((3.0, 0.0))
    return Exposures((5.0, 2.0, 0.1), (0.0, 0.0), 0.8, (0.0, 0.1), ("one", "two"), ([ring], [shifted]), (1.0, 4.0))


def test_exposures_of_single_pictures_need_a_proof(tmp_path: Path) -> None:
    job = Job(discs(), place(), Slicing(layer_um=100.0))
    with pytest.raises(SpecError, match="not proven to keep an exposure for each picture"):
        write_goo(tmp_path / "a.goo", job)
    assert not (tmp_path / "a.goo").exists()
    proven = place(layer_exposures={"source": "cure discs of 1 to 4 s on a film"})
    write_goo(tmp_path / "a.goo", Job(discs(), proven, Slicing(layer_um=100.0)))
    read = read_goo(tmp_path / "a.goo")
    assert read.header["each_layer"] is True
    assert [entry["exposure_s"] for entry, _ in read.layers] == [1.0, 4.0]
    assert len({entry["z_mm"] for entry, _ in read.layers}) == 1, "both at one height"


def test_a_printer_whose_plate_is_not_known_gets_no_goo(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="generic"):
        write_goo(tmp_path / "a.goo", Job(cone(), library_printer("generic"), Slicing(layer_um=100.0)))


def test_pictures_are_mirrored_as_the_printer_wants_them() -> None:
    plain, mirrored = (Job(cone(), where, Slicing(layer_um=400.0)) for where in (place(), place(mirror={"axis": "x"})))
    (one, other) = (next(job.layers()).image for job in (plain, mirrored))
    assert (one[:, ::-1] == other).all()
    assert not np.array_equal(one, other)
    stated = Job(cone(), mirrored.printer, Slicing(layer_um=400.0, mirror="none"))
    assert (next(stated.layers()).image == one).all(), "an option goes before the printer's file"


def test_the_origin_stands_where_it_is_asked_to() -> None:
    """A square of 0.1 to 0.5 mm about pixels of 0.1 mm, moved by a quarter and by a half of one: grey on two sides."""
    box = mesh_solid(closed(trimesh.creation.box(bounds=[(0.1, 0.1, 0), (0.5, 0.5, 1)])), orientation("flat"))
    job = Job(box, printer(100.0, 21, 21), Slicing(layer_um=1000.0, phase_px=(0.25, 0.5)))
    picture = job.copy_of_layer(0)
    assert picture[2].tolist()[:5] == [191, 255, 255, 255, 64]
    assert picture[:, 2].tolist()[:5] == pytest.approx([127.5, 255, 255, 255, 127.5], abs=0.6)


def test_without_anti_aliasing_pixels_are_lit_or_dark() -> None:
    box = mesh_solid(closed(trimesh.creation.box(bounds=[(0.1, 0.1, 0), (0.5, 0.5, 1)])), orientation("flat"))
    slicing = Slicing(layer_um=1000.0, phase_px=(0.25, 0.0), no_anti_aliasing=True)
    job = Job(box, printer(100.0, 21, 21), slicing)
    picture = job.copy_of_layer(0)
    assert picture[1].tolist()[:5] == [255, 255, 255, 255, 0]
    assert next(job.layers()).area_mm2 == pytest.approx(16 * 0.01), "what is lit counts"


def test_every_shipped_printer_with_a_lift_gets_a_goo() -> None:
    known = [name for name in printers() if library_printer(name).lift is not None]
    assert len(known) >= 12
    for name in known:
        checked_for_goo(Job(cone(), library_printer(name), Slicing(layer_um=50.0)))
