"""Coupons as solids, jobs and plans: closed, of the layout's volume, opened again by others; the command's refusals."""

import importlib.util
import io
import json
import math
import re
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import trimesh

from solen.cli import run_command
from solen.errors import DataError
from solen.fabricate import Label, as_step, as_stl, mesh_of
from solen.fabricate.coupons import as_job, as_plan, cautions, coupon_parts, read_job
from solen.geometry.coupons import COUPONS, Coupon, CouponOptions, Feature, coupon_of, layout
from tests.command_support import answered

HAS_KERNEL = importlib.util.find_spec("OCP") is not None
TOLERANCE_MM = 1e-3
LABEL = Label("a coupon", "0" * 64, "test")
every_coupon = pytest.mark.parametrize("name", COUPONS)
Run = Callable[..., Any]


def area_mm2(one: Feature) -> float:
    """From the layout alone."""
    if one.round:
        return math.pi * one.diameter_mm**2 / 4
    return one.width_mm * one.depth_mm - one.bevel_mm**2 / 2


def volume_mm3(coupon: Coupon, stage: str) -> float:
    features = [one for one in coupon.features if one.stage == stage]
    found = sum((-1 if one.kind == "hole" else 1) * area_mm2(one) * one.height_mm for one in features)
    if coupon.slab is not None:
        slab = coupon.slab
        found += (slab.width_mm * slab.depth_mm - slab.bevel_mm**2 / 2) * slab.thickness_mm
    return found


@every_coupon
def test_the_solid_is_the_layouts(name: str) -> None:
    coupon = layout(name)
    for stage, part in coupon_parts(coupon).items():
        assert part.volume_mm3 == pytest.approx(volume_mm3(coupon, stage), rel=1e-9)
        mesh = mesh_of(part, TOLERANCE_MM)
        found = trimesh.load_mesh(io.BytesIO(as_stl(mesh, LABEL)), file_type="stl")
        assert found.is_watertight
        assert found.is_volume
        assert abs(found.volume - part.volume_mm3) <= part.wall_mm2 * TOLERANCE_MM
        pieces = (
            1 if coupon.slab is not None else sum(one.stage == stage and not one.is_stacked for one in coupon.features)
        )
        assert found.body_count == pieces


@pytest.mark.parametrize("name", ["group-a", "holes"])
def test_the_solid_stands_where_the_layout_says(name: str) -> None:
    """By cuts through the mesh: whether material is at each feature's middle, and right beside it."""
    coupon = layout(name)
    mesh = mesh_of(coupon_parts(coupon)[""], TOLERANCE_MM)
    solid = trimesh.Trimesh(mesh.vertices, mesh.triangles)
    assert coupon.slab is not None
    for one in coupon.features:
        cut = sliced(solid, one.from_mm + 0.5 * one.height_mm)
        inside, beside = (cut(one.x_mm, one.y_mm + up) for up in (0.0, 0.5 * one.depth_mm + 0.02))
        assert (inside, beside) == ((False, True) if one.kind == "hole" else (True, False)), one.name
    x, y = 0.5 * coupon.slab.width_mm - 0.1, 0.5 * coupon.slab.depth_mm - 0.1
    cut = sliced(solid, 0.4)
    assert [cut(x, y), cut(x, -y), cut(-x, y), cut(-x, -y)] == [False, True, True, True], "right and back is bevelled"


def sliced(solid: trimesh.Trimesh, height_mm: float) -> Callable[[float, float], bool]:
    """Whether a place lies in the cut at a height, by the number of outlines around it."""
    import shapely

    rings = [shapely.Polygon(ring[:, :2]) for ring in solid.section([0, 0, 1], [0, 0, height_mm]).discrete]
    return lambda x, y: sum(ring.contains(shapely.Point(x, y)) for ring in rings) % 2 == 1


@pytest.mark.skipif(not HAS_KERNEL, reason="needs Open CASCADE")
@pytest.mark.parametrize("name", ["group-b", "holes", "cubes"])
def test_a_step_file_has_the_volume(name: str, tmp_path: Path) -> None:
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.STEPControl import STEPControl_Reader

    part = coupon_parts(layout(name))[""]
    (tmp_path / "part.step").write_bytes(as_step(part, LABEL))
    reader = STEPControl_Reader()
    reader.ReadFile(str(tmp_path / "part.step"))
    reader.TransferRoots()
    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(reader.OneShape(), found)
    assert found.Mass() == pytest.approx(part.volume_mm3, rel=1e-6)


@every_coupon
def test_a_job_holds_the_layout(name: str, tmp_path: Path) -> None:
    coupon, choices = layout(name), CouponOptions()
    path = tmp_path / "job.json"
    path.write_bytes(as_job(coupon, choices, {}))
    found, job = read_job(path)
    assert found == coupon
    assert job["print"]["energy_mJ_per_cm2"] == 26.0
    assert job["print"]["burn_in_energy_mJ_per_cm2"] == 39.0
    if name == "group-a":
        assert job["stages"][0]["layers"] == 152, "3.8 mm of 25 µm"
    if name == "cure-discs":
        assert [one["energy_mJ_per_cm2"] for one in job["stages"][0]["exposures"]][:3] == [13.0, 19.5, 26.0]


@every_coupon
def test_a_plan_is_at_true_scale(name: str) -> None:
    coupon = layout(name)
    root = ET.fromstring(as_plan(coupon, LABEL))  # noqa: S314  it is our own
    space = "{http://www.w3.org/2000/svg}"
    _, _, wide, high = (float(number) for number in root.attrib["viewBox"].split())
    assert root.attrib["width"] == f"{wide:g}mm"
    assert root.attrib["height"] == f"{high:g}mm"
    circles = {one.attrib["id"]: one for one in root.iter(f"{space}circle")}
    for one in coupon.features:
        if one.round:
            assert 2 * float(circles[one.name].attrib["r"]) == pytest.approx(one.diameter_mm)
            assert float(circles[one.name].attrib["cx"]) == pytest.approx(one.x_mm, abs=1e-8)
            assert float(circles[one.name].attrib["cy"]) == pytest.approx(-one.y_mm, abs=1e-8)


def test_what_a_printer_cannot_make_is_reported() -> None:
    choices = CouponOptions(layer_um=50.0, pitch_um=62.0)
    told = " ".join(cautions(layout("group-c", choices), choices))
    assert "steps of 25 µm are below the layer thickness of 50 µm" in told
    told = " ".join(cautions(layout("group-b", choices), choices))
    assert "g-0.06, g-0.05, g-0.04, g-0.03, g-0.02: gaps below a pixel of 62 µm" in told
    assert cautions(layout("group-c"), CouponOptions()) == [], "25 µm divides every height"
    thick = CouponOptions(layer_um=30.0)
    assert "a multiple of the layer thickness of 30 µm" in cautions(layout("group-a", thick), thick)[0]


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda data: data.pop("name"), "name; is missing"),
        (lambda data: data.update(colour="red"), "colour = 'red'; unknown name"),
        (lambda data: data["features"][0].update(width_mm="wide"), "must be a number"),
        (lambda data: data["features"][0].update(kind="tower"), "kind = 'tower'"),
        (lambda data: data["features"][0].update(to_mm=0.8), "must be above 0"),
        (lambda data: data.update(features=3), "features = 3"),
        (lambda data: data["features"].append(3), "features[18] = 3"),
    ],
)
def test_a_damaged_job_is_refused_in_one_line(change: Callable[[Any], object], part: str) -> None:
    data = json.loads(json.dumps(asdict(layout("group-a"))))
    change(data)
    with pytest.raises(DataError) as told:
        coupon_of(data, "job.json")
    assert part in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"kind": "cure"}', '{"kind": "coupon-job", "schema": 9}', '{"a": NaN}']
)
def test_a_file_that_is_no_job_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "job.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataError):
        read_job(path)


@pytest.fixture
def told(capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> dict[str, Any]:
        return answered(capfd, "print", "coupons", *arguments)

    return run


def test_the_command_writes_what_it_tells(told: Run) -> None:
    found = told("--out", "print", "--only", "holes,film-layer", "--pitch-um", "62", "--figure", "plans.svg")
    assert [one["name"] for one in found["coupons"]] == ["holes", "film-layer"]
    for path in found["files"].values():
        assert Path(path).stat().st_size > 100
    for one in found["coupons"]:
        job = json.loads(Path(found["files"][f"{one['name']}.json"]).read_text(encoding="utf-8"))
        assert job["sha256"] == one["sha256"]
        assert job["choices"]["pitch_um"] == 62.0
    written = sorted(path.name for path in Path("print").iterdir())
    assert len(written) == 4 + 6
    assert "film-layer-base.stl" in written
    first = {path.name: path.read_bytes() for path in Path("print").iterdir()}
    told("--out", "print", "--only", "holes,film-layer", "--pitch-um", "62")
    assert first == {path.name: path.read_bytes() for path in Path("print").iterdir()}, "no date, no chance"


def test_a_printer_gives_its_pixel(told: Run) -> None:
    found = told("--out", "print", "--only", "group-b", "--printer", "asiga-max-uv")
    assert found["options"]["pitch_um"] == 62.0
    assert any("gaps below a pixel of 62 µm" in line for line in found["coupons"][0]["warnings"])


def test_the_list_says_what_was_read_into_the_source(told: Run) -> None:
    found = told("--list", "--hole-reading", "tenths")
    assert [one["name"] for one in found["coupons"]] == list(COUPONS)
    (holes,) = [one for one in found["coupons"] if one["name"] == "holes"]
    assert "2.10 mm" in holes["readings"][0]["taken"]
    assert not list(Path().iterdir())


def test_a_reader_gets_lines(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert run_command(["print", "coupons", "--list"]) == 0
    assert "printed: " not in capfd.readouterr().err
    assert run_command(["print", "coupons", "--out", str(tmp_path / "p"), "--only", "z-reference"]) == 0
    assert re.search(r"z-reference: 3 features, 44\.05 mm3", capfd.readouterr().out)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--out", "p", "--only", "group-x"], "--only = 'group-x'; must be one or more of group-a"),
        (["--out", "p", "--only", ""], "--only = ''"),
        ([], "--out; is missing"),
        (["--out", "p", "--layer-um", "0"], "--layer-um = '0'"),
        (["--out", "p", "--pitch-um", "nan"], "--pitch-um = 'nan'"),
        (["--out", "p", "--spacing-mm", "0"], "--spacing-mm = '0'"),
        (["--out", "p", "--spacing", "1"], "--spacing-mm"),
        (["--out", "p", "--spacing-mm", "wide"], "wide"),
        (["--out", "p", "--marks=3"], "3"),
        (["--out", "p", "--cubes", "1.5"], "1.5"),
        (["--out", "p", "--cubes", "1000"], "must be at most 100"),
        (["--out", "p", "--bevel-mm", "50"], "must be smaller than the sides of the slab"),
        (["--out", "p", "--hole-reading", "fifths"], "fifths"),
        (["--out", "p", "--plate-mm", "24", "50"], "does not fit on a plate of 24 x 50 mm"),
        (["--out", "p", "--plate-mm", "0", "50"], "--plate-mm"),
        (["--out", "p", "--only", "cubes", "--printer", "asiga-pico2-hd-27"], "does not fit on a plate of"),
        (["--out", "p", "--printer", "asiga-none"], "asiga"),
        (["--out", "p", "--tolerance-mm", "5"], "--tolerance-mm = 5.0"),
        (["--out", "p", "--figure", "p.bmp"], "a figure must end in .svg, .pdf"),
        (["--out", "p", "--only", "holes", "--figure", "p/holes.svg"], "is also another output of this command"),
    ],
)
def test_bad_input_ends_in_one_line_and_writes_nothing(
    arguments: list[str],
    part: str,
    capfd: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command(["print", "coupons", *arguments]) == 2
    printed = capfd.readouterr()
    assert part in printed.err
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert not list(tmp_path.iterdir())
