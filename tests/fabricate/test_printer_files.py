"""Files for printers, read by independent readers, agree with the solid and the settings."""

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
    lift_of,
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
TOLERANCE = 5e-3
"""Maximum relative error of an area."""


def rectangular_printer(columns: int = 700, rows: int = 300, **tables: Any) -> Printer:
    """Return a printer with pixels of 40 by 60 µm."""
    return printer(40.0, columns, rows, pitch_y_um={"typical": 60.0}, lift=LIFT, **tables)


def cone() -> trimesh.Trimesh:
    """Return a cone of 16 mm by 8 mm with a square hole next to its axis, without mirror symmetry."""
    shape = trimesh.creation.cone(8.0, 8.0, sections=90)
    cut = trimesh.creation.box(bounds=[(1.0, 0.5, -1.0), (3.0, 2.5, 2.0)])
    return trimesh.boolean.difference([shape, cut], engine="manifold")


def solid_cone() -> Solid:
    return mesh_solid(closed(cone()), orientation("flat"))


def sections_mm2(mesh: trimesh.Trimesh, heights_mm: NDArray[Any]) -> Iterator[float]:
    """Yield the area of a mesh at each height, by trimesh and shapely."""
    for height in heights_mm:
        outlines = mesh.section(plane_origin=(0.0, 0.0, height), plane_normal=(0.0, 0.0, 1.0)).discrete
        rings = [Polygon(outline[:, :2]) for outline in outlines]
        yield sum(
            ring.area * (-1) ** sum(other.contains(ring) for other in rings if other is not ring) for ring in rings
        )


@pytest.mark.parametrize("kind", ["goo", "zip"])
def test_areas_agree_with_the_solid(tmp_path: Path, kind: str) -> None:
    job = Job(solid_cone(), rectangular_printer(), Slicing(layer_um=400.0, burn_in_layers=3, phase_px=(0.3, 0.7)))
    assert {"goo": write_goo, "zip": write_archive}[kind](tmp_path / "a", job).layers == 20
    stack = read_goo(tmp_path / "a") if kind == "goo" else read_zip(tmp_path / "a")
    expected = list(sections_mm2(cone(), 0.4 * (np.arange(20) + 0.5)))
    assert stack.pixel_mm == pytest.approx((0.04, 0.06))
    assert stack.areas_mm2[:-1] == pytest.approx(expected[:-1], rel=TOLERANCE)
    assert stack.areas_mm2[-1] == pytest.approx(expected[-1], rel=0.05), "the tip is 0.4 mm wide"


def test_header_and_layers_of_goo_have_the_settings(tmp_path: Path) -> None:
    """The reader checks that the layers repeat the values of the header."""
    mirrored = rectangular_printer(mirror={"axis": "x"})
    job = Job(solid_cone(), mirrored, Slicing(layer_um=400.0, burn_in_layers=3, burn_in_s=3.5, exposure_s=2.25))
    write_goo(tmp_path / "a.goo", job)
    stack = read_goo(tmp_path / "a.goo")
    expected = {
        "bottom_layers": 3, "bottom_exposure_s": 3.5, "exposure_s": 2.25, "advance_mode": 0, "transition_layers": 0,
        "x_resolution": 700, "y_resolution": 300, "total_layers": 20, "layer_thickness_mm": 0.4, "z_size_mm": 100.0,
        "x_size_mm": 28.0, "y_size_mm": 18.0, "x_mirror": 1, "y_mirror": 0, "grey_scale_level": 1,
        "bottom_light_pwm": 255, "light_pwm": 255, "bottom_lift_mm": 7.0, "lift_mm": 5.0, "retract_mm_per_min": 150.0,
        "bottom_after_retract_s": 3.0, "after_retract_s": 2.5, "total_volume_mm3": job.volume_mm3,
    }  # fmt: skip
    assert {name: stack.header[name] for name in expected} == pytest.approx(expected, rel=1e-6)
    assert [layer.fields["exposure_s"] for layer in stack.layers] == [3.5] * 3 + [2.25] * 17
    for read, layer in zip(stack.layers, job.layers(), strict=True):
        assert (read.image == layer.image).all()


def test_the_printing_time_includes_lifts_and_pauses(tmp_path: Path) -> None:
    job = Job(
        solid_cone(), rectangular_printer(), Slicing(layer_um=400.0, burn_in_layers=3, burn_in_s=3.5, exposure_s=2.25)
    )
    write_goo(tmp_path / "a.goo", job)
    seconds = 3 * (3.5 + 7 / 80 * 60 + 7 / 150 * 60 + 3.0) + 17 * (2.25 + 5 / 100 * 60 + 5 / 150 * 60 + 2.5)
    assert read_goo(tmp_path / "a.goo").header["printing_time_s"] == round(seconds)
    assert job.seconds == pytest.approx(seconds)


def test_previews_show_the_part_from_above(tmp_path: Path) -> None:
    """A right-angled triangle of 16 by 8 mm, with its corner at the lower left."""
    triangle = trimesh.creation.extrude_polygon(Polygon([(0.0, 0.0), (16.0, 0.0), (0.0, 8.0)]), 0.8)
    solid = mesh_solid(closed(triangle), orientation("flat"))
    write_goo(tmp_path / "a.goo", Job(solid, rectangular_printer(), Slicing(layer_um=400.0)))
    for name, side in (("small_preview", 116), ("big_preview", 290)):
        lit = read_goo(tmp_path / "a.goo").preview(name) > 0.5
        assert lit.shape == (side, side, 3)
        assert lit.mean() == pytest.approx(0.25, abs=0.01)
        low, high, right = 3 * side // 4 - 5, side // 4 + 5, side // 2 + 10
        assert [lit[low, 5].all(), lit[high, 5].all(), lit[low, right].all()] == [True, True, True]
        assert not lit[high, right].any()
        assert not lit[: side // 4 - 1].any()


def test_the_manifest_has_the_elements_of_uvtools(tmp_path: Path) -> None:
    write_archive(tmp_path / "a.zip", Job(solid_cone(), rectangular_printer(), Slicing(layer_um=400.0)))
    elements = {key: value for key, value in read_zip(tmp_path / "a.zip").manifest.items() if not key.endswith("By")}
    sizes = {"ResolutionX": 700, "ResolutionY": 300, "DisplayWidth": 28.0, "DisplayHeight": 18.0, "MachineZ": 100.0}
    assert elements == {"LayerHeight": 0.4} | sizes


def test_encodes_runs_of_all_lengths() -> None:
    """Random runs near the lengths at which the number of bytes changes."""
    rng = np.random.default_rng(7)
    lengths = np.array([1, 15, 16, 17, 4095, 4096, 4097, 1 << 20, (1 << 20) - 1, (1 << 20) + 1, 3, 250])
    for _ in range(5):
        rng.shuffle(lengths)
        image = np.repeat(rng.choice([0, 1, 7, 128, 254, 255], len(lengths)), lengths).astype(np.uint8)
        assert (np.repeat(*decoded(encoded(image)[1:-1], image.size, 255)) == image).all()


PILLARS_MM = (1.00, 0.80, 0.60, 0.50, 0.40, 0.30, 0.25, 0.20, 0.18, 0.16, 0.14, 0.12, 0.10, 0.08, 0.06)
"""Diameters of group A in the publication."""


def small_printer(folder: Path) -> str:
    """Write the file of a shipped printer with rectangular pixels, reduced to a screen of 26.6 by 14.4 mm."""
    text = (files("solen.parts") / "printers" / "elegoo-saturn-3-ultra.toml").read_text(encoding="utf-8")
    small = text.replace("columns = 11520", "columns = 1400").replace("rows = 5120", "rows = 600")
    (folder / "small.toml").write_text(small, encoding="utf-8")
    return str(folder / "small.toml")


def test_the_goo_file_of_a_coupon_agrees_with_the_publication(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_command(["print", "coupons", "--out", str(tmp_path), "--only", "group-a", "--exposure-s", "2.5"]) == 0
    capfd.readouterr()
    options = ("--printer", small_printer(tmp_path), "--format", "goo", "--out", str(tmp_path / "print"))
    result = answered(capfd, "print", "layers", str(tmp_path / "group-a.json"), *options)
    stack = read_goo(result["files"]["layers"])
    assert not stack.header["profile_name"].strip(b"\0"), "the resin is unknown"
    settings = result["settings"]
    assert [layer.fields["exposure_s"] for layer in stack.layers] == settings["layer_exposures_s"]
    assert settings["layer_exposures_s"][:8] == [3.0] * 6 + [2.5] * 2
    assert stack.layers[-1].fields["position_mm"] == pytest.approx(result["height_mm"])
    assert stack.header["printing_time_s"] == round(settings["estimated_time_s"])
    marks_mm = (1.0, 1.0, 1.0)
    assert stack.areas_mm2[40:] == pytest.approx(np.pi / 4.0 * np.square([*PILLARS_MM, *marks_mm]).sum(), rel=TOLERANCE)


GOO = ("--format", "goo", "--printer")
COMMANDS = {
    "flat": ("sensor.toml", *GOO, "elegoo-saturn-3-ultra", "--copies", "3"),
    "no anti-aliasing": ("sensor.toml", *GOO, "elegoo-mars-4-ultra", "--no-anti-aliasing"),
    "upright": ("sensor.toml", *GOO, "elegoo-mars-4-ultra", "--orientation", "upright", "--layer-um", "100"),
    "on edge": ("sensor.toml", *GOO, "elegoo-saturn-3-ultra", "--orientation", "on-edge", "--layer-um", "50"),
    "on edge, zip": ("sensor.toml", "--orientation", "on-edge", "--layer-um", "50", "--mark"),
    "group-a": ("group-a.json", *GOO, "elegoo-mars-4-ultra"),
    "group-c, zip": ("group-c.json",),
    "holes": ("holes.json", *GOO, "elegoo-saturn-3-ultra"),
    "layer on film": ("film-layer.json", "--run", "layer", *GOO, "elegoo-mars-4-ultra"),
}


@pytest.mark.evidence
@pytest.mark.parametrize("name", COMMANDS)
def test_all_layers_agree_with_the_placed_stl(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    """For shipped designs and coupons on shipped printers."""
    monkeypatch.chdir(tmp_path)
    Path("sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    assert run_command(["print", "coupons", "--out", ".", "--only", "group-a,group-c,holes,film-layer"]) == 0
    capfd.readouterr()
    result = answered(capfd, "print", "layers", *COMMANDS[name], "--out", "print")
    path = Path(result["files"]["layers"])
    stack = read_goo(path) if path.suffix == ".goo" else read_zip(path)
    heights_mm = 1e-3 * result["layer_um"] * (np.arange(result["layers"]) + 0.5)
    placed = trimesh.load_mesh(result["files"]["placed"])
    expected = result["copies"] * np.array(list(sections_mm2(placed, heights_mm)))
    errors = np.abs(stack.areas_mm2 / expected - 1.0)
    with capfd.disabled():
        print(f"{name}: {result['layers']} layers, errors of areas up to {100.0 * errors.max():.4f} %")
    assert errors.max() < TOLERANCE


def test_goo_files_are_reproducible(tmp_path: Path) -> None:
    job = Job(solid_of(part_of(seated()), np.eye(3)), rectangular_printer(900, 700), Slicing(layer_um=1000.0))
    for name in "ab":
        write_goo(tmp_path / name, job)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def discs() -> Exposures:
    left = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
    right = left + np.array((3.0, 0.0))
    return Exposures((5.0, 2.0, 0.1), (0.0, 0.0), 0.8, (0.0, 0.1), ("left", "right"), ([left], [right]), (1.0, 4.0))


def test_separate_exposures_in_goo_require_evidence(tmp_path: Path) -> None:
    job = Job(discs(), rectangular_printer(), Slicing(layer_um=100.0))
    with pytest.raises(SpecError, match="exposure of each image"):
        write_goo(tmp_path / "a.goo", job)
    assert not (tmp_path / "a.goo").exists()
    proven = rectangular_printer(layer_exposures={"source": "cure discs of 1 to 4 s on a film"})
    write_goo(tmp_path / "a.goo", Job(discs(), proven, Slicing(layer_um=100.0)))
    stack = read_goo(tmp_path / "a.goo")
    assert stack.header["advance_mode"] == 1
    assert [layer.fields["exposure_s"] for layer in stack.layers] == [1.0, 4.0]
    assert len({layer.fields["position_mm"] for layer in stack.layers}) == 1, "at the same height"


def test_refuses_goo_for_a_printer_without_a_lift(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="generic"):
        write_goo(tmp_path / "a.goo", Job(solid_cone(), library_printer("generic"), Slicing(layer_um=100.0)))


def test_images_are_mirrored_as_specified_by_printer_or_option() -> None:
    mirroring = rectangular_printer(mirror={"axis": "x"})

    def image_of(machine: Printer, **options: Any) -> NDArray[np.uint8]:
        return next(Job(solid_cone(), machine, Slicing(layer_um=400.0, **options)).layers()).image

    image = image_of(rectangular_printer())
    assert not np.array_equal(image[:, ::-1], image)
    assert (image_of(mirroring) == image[:, ::-1]).all()
    assert (image_of(mirroring, mirror="none") == image).all(), "the option has priority"


def test_the_position_in_the_pixel_is_that_of_the_option() -> None:
    """A square is shifted by a quarter of a pixel along x and half a pixel along y."""
    box = mesh_solid(closed(trimesh.creation.box(bounds=[(0.1, 0.1, 0), (0.5, 0.5, 1)])), orientation("flat"))
    job = Job(box, printer(100.0, 21, 21), Slicing(layer_um=1000.0, phase_px=(0.25, 0.5)))
    image = job.copy_of_layer(0)
    assert image[2].tolist()[:5] == [191, 255, 255, 255, 64]
    assert image[:, 2].tolist()[:5] == pytest.approx([127.5, 255, 255, 255, 127.5], abs=0.6)


def test_pixels_are_binary_without_anti_aliasing() -> None:
    box = mesh_solid(closed(trimesh.creation.box(bounds=[(0.1, 0.1, 0), (0.5, 0.5, 1)])), orientation("flat"))
    slicing = Slicing(layer_um=1000.0, phase_px=(0.25, 0.0), no_anti_aliasing=True)
    job = Job(box, printer(100.0, 21, 21), slicing)
    image = job.copy_of_layer(0)
    assert image[1].tolist()[:5] == [255, 255, 255, 255, 0]
    assert next(job.layers()).area_mm2 == pytest.approx(16 * 0.01), "the area of lit pixels"


def test_shipped_printers_with_a_lift_can_use_goo() -> None:
    with_lift = [name for name in printers() if library_printer(name).lift is not None]
    assert len(with_lift) >= 12
    for name in with_lift:
        lift_of(Job(solid_cone(), library_printer(name), Slicing(layer_um=50.0)))
