"""Files for printers, read back by readers written from the formats' descriptions; areas against the solid."""

from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from shapely.geometry import Polygon

from solen.cli import run_command
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
from solen.spec import template
from tests.command_support import answered
from tests.fabricate.goo_reader import decoded, read_goo
from tests.fabricate.solid_support import part_of, seated
from tests.fabricate.test_layers import closed, printer
from tests.fabricate.zip_reader import read_zip

LIFT: dict[str, Any] = {
    "bottom_height_mm": 7, "height_mm": 5, "bottom_speed_mm_per_min": 80, "speed_mm_per_min": 100,
    "retract_mm_per_min": 150, "bottom_wait_before_s": 3, "wait_before_s": 2.5,
}  # fmt: skip
WITHIN = 5e-3
"""Relative difference of an area that is allowed."""


def place(columns: int = 700, rows: int = 300, **more: Any) -> Printer:
    """Pixels of 40 by 60 µm."""
    return printer(40.0, columns, rows, pitch_y_um={"typical": 60.0}, lift=LIFT, **more)


def cone() -> trimesh.Trimesh:
    """A cone of 16 mm by 8 mm with a square of 2 mm cut out beside its axis: no section is its mirror image."""
    shape = trimesh.creation.cone(8.0, 8.0, sections=90)
    cut = trimesh.creation.box(bounds=[(1.0, 0.5, -1.0), (3.0, 2.5, 2.0)])
    return trimesh.boolean.difference([shape, cut], engine="manifold")


def solid_cone() -> Solid:
    return mesh_solid(closed(cone()), orientation("flat"))


def sections_mm2(mesh: trimesh.Trimesh, heights_mm: NDArray[Any]) -> Iterator[float]:
    """Area of a mesh at each height, by trimesh and shapely; what lies in another outline is a hole."""
    for height in heights_mm:
        outlines = mesh.section(plane_origin=(0.0, 0.0, height), plane_normal=(0.0, 0.0, 1.0)).discrete
        rings = [Polygon(outline[:, :2]) for outline in outlines]
        yield sum(
            ring.area * (-1) ** sum(other.contains(ring) for other in rings if other is not ring) for ring in rings
        )


@pytest.mark.parametrize("whose", ["goo", "zip"])
def test_areas_read_back_are_those_of_the_solid(tmp_path: Path, whose: str) -> None:
    job = Job(solid_cone(), place(), Slicing(layer_um=400.0, burn_in_layers=3, phase_px=(0.3, 0.7)))
    assert {"goo": write_goo, "zip": write_archive}[whose](tmp_path / "a", job).layers == 20
    found = read_goo(tmp_path / "a") if whose == "goo" else read_zip(tmp_path / "a")
    expected = list(sections_mm2(cone(), 0.4 * (np.arange(20) + 0.5)))
    assert found.pixel_mm == pytest.approx((0.04, 0.06))
    assert found.areas_mm2[:-1] == pytest.approx(expected[:-1], rel=WITHIN)
    assert found.areas_mm2[-1] == pytest.approx(expected[-1], rel=0.05), "the tip is 0.4 mm wide"


def test_a_goo_states_burn_in_by_its_bottom_layers(tmp_path: Path) -> None:
    """That each layer repeats what the header states for it is the reader's own check."""
    wide = place(mirror={"axis": "x"})
    job = Job(solid_cone(), wide, Slicing(layer_um=400.0, burn_in_layers=3, burn_in_s=3.5, exposure_s=2.25))
    write_goo(tmp_path / "a.goo", job)
    read = read_goo(tmp_path / "a.goo")
    expected = {
        "bottom_layers": 3, "bottom_exposure_s": 3.5, "exposure_s": 2.25, "advance_mode": 0, "transition_layers": 0,
        "x_resolution": 700, "y_resolution": 300, "total_layers": 20, "layer_thickness_mm": 0.4, "z_size_mm": 100.0,
        "x_size_mm": 28.0, "y_size_mm": 18.0, "x_mirror": 1, "y_mirror": 0, "grey_scale_level": 1,
        "bottom_light_pwm": 255, "light_pwm": 255, "bottom_lift_mm": 7.0, "lift_mm": 5.0, "retract_mm_per_min": 150.0,
        "bottom_after_retract_s": 3.0, "after_retract_s": 2.5, "total_volume_mm3": job.volume_mm3,
    }  # fmt: skip
    assert {name: read.header[name] for name in expected} == pytest.approx(expected, rel=1e-6)
    assert [layer.fields["exposure_s"] for layer in read.layers] == [3.5] * 3 + [2.25] * 17
    for layer, drawn in zip(read.layers, job.layers(), strict=True):
        assert (layer.image == drawn.image).all()


def test_the_printing_time_holds_lifts_and_rests(tmp_path: Path) -> None:
    """3 bottom layers of 3.5 s, with 7 mm up at 80 and down at 150 mm/min and 3 s of rest; 17 of 2.25 s with 5 mm."""
    job = Job(solid_cone(), place(), Slicing(layer_um=400.0, burn_in_layers=3, burn_in_s=3.5, exposure_s=2.25))
    write_goo(tmp_path / "a.goo", job)
    seconds = 3 * (3.5 + 7 / 80 * 60 + 7 / 150 * 60 + 3.0) + 17 * (2.25 + 5 / 100 * 60 + 5 / 150 * 60 + 2.5)
    assert read_goo(tmp_path / "a.goo").header["printing_time_s"] == round(seconds)
    assert job.seconds == pytest.approx(seconds)


def test_the_previews_show_the_part_from_above(tmp_path: Path) -> None:
    """A right-angled triangle with its corner at the lower left, 16 by 8 mm on pixels that are not squares."""
    corner = trimesh.creation.extrude_polygon(Polygon([(0.0, 0.0), (16.0, 0.0), (0.0, 8.0)]), 0.8)
    write_goo(
        tmp_path / "a.goo", Job(mesh_solid(closed(corner), orientation("flat")), place(), Slicing(layer_um=400.0))
    )
    for name, side in (("small_preview", 116), ("big_preview", 290)):
        lit = read_goo(tmp_path / "a.goo").preview(name) > 0.5
        assert lit.shape == (side, side, 3)
        assert lit.mean() == pytest.approx(0.25, abs=0.01)
        low, high, middle = 3 * side // 4 - 5, side // 4 + 5, side // 2 + 10
        assert [bool(lit[at].all()) for at in ((low, 5), (high, 5), (low, middle), (high, middle))] == [True] * 3 + [
            False
        ]
        assert not lit[: side // 4 - 1].any()


def test_the_manifest_is_what_uvtools_looks_for(tmp_path: Path) -> None:
    write_archive(tmp_path / "a.zip", Job(solid_cone(), place(), Slicing(layer_um=400.0)))
    about = {key: value for key, value in read_zip(tmp_path / "a.zip").manifest.items() if not key.endswith("By")}
    sizes = {"ResolutionX": 700, "ResolutionY": 300, "DisplayWidth": 28.0, "DisplayHeight": 18.0, "MachineZ": 100.0}
    assert about == {"LayerHeight": 0.4} | sizes


def test_runs_of_every_length_come_back() -> None:
    """Random runs about the lengths at which the number of bytes changes, and of each kind."""
    rng = np.random.default_rng(7)
    lengths = np.array([1, 15, 16, 17, 4095, 4096, 4097, 1 << 20, (1 << 20) - 1, (1 << 20) + 1, 3, 250])
    for _ in range(5):
        rng.shuffle(lengths)
        flat = np.repeat(rng.choice([0, 1, 7, 128, 254, 255], len(lengths)), lengths).astype(np.uint8)
        assert (np.repeat(*decoded(encoded(flat)[1:-1], flat.size, 255)) == flat).all()


PILLARS_MM = (1.00, 0.80, 0.60, 0.50, 0.40, 0.30, 0.25, 0.20, 0.18, 0.16, 0.14, 0.12, 0.10, 0.08, 0.06)
"""Group A, as it is published."""


def fewer_pixels(folder: Path) -> str:
    """A shipped printer of rectangular pixels with a smaller screen, 26.6 by 14.4 mm."""
    text = (files("solen.parts") / "printers" / "elegoo-saturn-3-ultra.toml").read_text(encoding="utf-8")
    small = text.replace("columns = 11520", "columns = 1400").replace("rows = 5120", "rows = 600")
    (folder / "small.toml").write_text(small, encoding="utf-8")
    return str(folder / "small.toml")


def test_a_coupon_comes_back_from_the_file_of_its_job(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Pillars and marks by their published diameters, on rectangular pixels; exposures as the command states them."""
    assert run_command(["print", "coupons", "--out", str(tmp_path), "--only", "group-a", "--exposure-s", "2.5"]) == 0
    capfd.readouterr()
    to_goo = ("--printer", fewer_pixels(tmp_path), "--format", "goo", "--out", str(tmp_path / "print"))
    said = answered(capfd, "print", "layers", str(tmp_path / "group-a.json"), *to_goo)
    read = read_goo(said["files"]["layers"])
    assert not read.header["profile_name"].strip(b"\0"), "no resin is named"
    settings = said["settings"]
    assert [layer.fields["exposure_s"] for layer in read.layers] == settings["layer_exposures_s"]
    assert settings["layer_exposures_s"][:8] == [3.0] * 6 + [2.5] * 2
    assert read.layers[-1].fields["position_mm"] == pytest.approx(said["height_mm"])
    assert read.header["printing_time_s"] == round(settings["estimated_time_s"])
    marks_mm = (1.0, 1.0, 1.0)
    assert read.areas_mm2[40:] == pytest.approx(np.pi / 4.0 * np.square([*PILLARS_MM, *marks_mm]).sum(), rel=WITHIN)


GOO = ("--format", "goo", "--printer")
WHOLE = {
    "flat": ("sensor.toml", *GOO, "elegoo-saturn-3-ultra", "--copies", "3"),
    "lit or dark": ("sensor.toml", *GOO, "elegoo-mars-4-ultra", "--no-anti-aliasing"),
    "upright": ("sensor.toml", *GOO, "elegoo-mars-4-ultra", "--orientation", "upright", "--layer-um", "100"),
    "on edge": ("sensor.toml", *GOO, "elegoo-saturn-3-ultra", "--orientation", "on-edge", "--layer-um", "50"),
    "on edge, zip": ("sensor.toml", "--orientation", "on-edge", "--layer-um", "50", "--mark"),
    "group-a": ("group-a.json", *GOO, "elegoo-mars-4-ultra"),
    "group-c, zip": ("group-c.json",),
    "holes": ("holes.json", *GOO, "elegoo-saturn-3-ultra"),
    "layer on film": ("film-layer.json", "--run", "layer", *GOO, "elegoo-mars-4-ultra"),
}


@pytest.mark.evidence
@pytest.mark.parametrize("which", WHOLE)
def test_whole_parts_come_back_as_their_placed_solids(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], which: str
) -> None:
    """Every layer of shipped designs and coupons on shipped printers, against sections of the STL beside it."""
    monkeypatch.chdir(tmp_path)
    Path("sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    assert run_command(["print", "coupons", "--out", ".", "--only", "group-a,group-c,holes,film-layer"]) == 0
    capfd.readouterr()
    said = answered(capfd, "print", "layers", *WHOLE[which], "--out", "print")
    path = Path(said["files"]["layers"])
    read = read_goo(path) if path.suffix == ".goo" else read_zip(path)
    heights_mm = 1e-3 * said["layer_um"] * (np.arange(said["layers"]) + 0.5)
    placed = trimesh.load_mesh(said["files"]["placed"])
    exact = said["copies"] * np.array(list(sections_mm2(placed, heights_mm)))
    off = np.abs(read.areas_mm2 / exact - 1.0)
    with capfd.disabled():
        print(f"{which}: {said['layers']} layers, areas off by at most {100.0 * off.max():.4f} %")
    assert off.max() < WITHIN


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


def test_exposures_of_single_images_need_a_proof(tmp_path: Path) -> None:
    job = Job(discs(), place(), Slicing(layer_um=100.0))
    with pytest.raises(SpecError, match="not been proven to follow individual exposures"):
        write_goo(tmp_path / "a.goo", job)
    assert not (tmp_path / "a.goo").exists()
    proven = place(layer_exposures={"source": "cure discs of 1 to 4 s on a film"})
    write_goo(tmp_path / "a.goo", Job(discs(), proven, Slicing(layer_um=100.0)))
    read = read_goo(tmp_path / "a.goo")
    assert read.header["advance_mode"] == 1
    assert [layer.fields["exposure_s"] for layer in read.layers] == [1.0, 4.0]
    assert len({layer.fields["position_mm"] for layer in read.layers}) == 1, "both at one height"


def test_a_printer_whose_plate_is_not_known_gets_no_goo(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="generic"):
        write_goo(tmp_path / "a.goo", Job(solid_cone(), library_printer("generic"), Slicing(layer_um=100.0)))


def test_images_are_mirrored_as_the_printer_wants_them() -> None:
    plain, mirrored = (
        Job(solid_cone(), where, Slicing(layer_um=400.0)) for where in (place(), place(mirror={"axis": "x"}))
    )
    (one, other) = (next(job.layers()).image for job in (plain, mirrored))
    assert (one[:, ::-1] == other).all()
    assert not np.array_equal(one, other)
    stated = Job(solid_cone(), mirrored.printer, Slicing(layer_um=400.0, mirror="none"))
    assert (next(stated.layers()).image == one).all(), "an option goes before the printer's file"


def test_the_origin_stands_where_it_is_asked_to() -> None:
    """A square of 0.1 to 0.5 mm about pixels of 0.1 mm, moved by a quarter and by a half of one: grey on two sides."""
    box = mesh_solid(closed(trimesh.creation.box(bounds=[(0.1, 0.1, 0), (0.5, 0.5, 1)])), orientation("flat"))
    job = Job(box, printer(100.0, 21, 21), Slicing(layer_um=1000.0, phase_px=(0.25, 0.5)))
    image = job.copy_of_layer(0)
    assert image[2].tolist()[:5] == [191, 255, 255, 255, 64]
    assert image[:, 2].tolist()[:5] == pytest.approx([127.5, 255, 255, 255, 127.5], abs=0.6)


def test_without_anti_aliasing_pixels_are_lit_or_dark() -> None:
    box = mesh_solid(closed(trimesh.creation.box(bounds=[(0.1, 0.1, 0), (0.5, 0.5, 1)])), orientation("flat"))
    slicing = Slicing(layer_um=1000.0, phase_px=(0.25, 0.0), no_anti_aliasing=True)
    job = Job(box, printer(100.0, 21, 21), slicing)
    image = job.copy_of_layer(0)
    assert image[1].tolist()[:5] == [255, 255, 255, 255, 0]
    assert next(job.layers()).area_mm2 == pytest.approx(16 * 0.01), "what is lit counts"


def test_every_shipped_printer_with_a_lift_gets_a_goo() -> None:
    known = [name for name in printers() if library_printer(name).lift is not None]
    assert len(known) >= 12
    for name in known:
        checked_for_goo(Job(solid_cone(), library_printer(name), Slicing(layer_um=50.0)))
