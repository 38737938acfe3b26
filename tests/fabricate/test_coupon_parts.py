"""Coupons as solids, jobs and plans agree with their layout; `solen print coupons` and its errors."""

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


def area_mm2(feature: Feature) -> float:
    if feature.round:
        return math.pi * feature.diameter_mm**2 / 4
    return feature.width_mm * feature.depth_mm - feature.bevel_mm**2 / 2


def volume_mm3(coupon: Coupon, stage: str) -> float:
    """Return the volume of a stage according to the layout."""
    features = [feature for feature in coupon.features if feature.stage == stage]
    volume = sum((-1 if each.kind == "hole" else 1) * area_mm2(each) * each.height_mm for each in features)
    if coupon.slab is not None:
        slab = coupon.slab
        volume += (slab.width_mm * slab.depth_mm - slab.bevel_mm**2 / 2) * slab.thickness_mm
    return volume


@every_coupon
def test_solids_have_the_volume_of_the_layout(name: str) -> None:
    coupon = layout(name)
    for stage, part in coupon_parts(coupon).items():
        assert part.volume_mm3 == pytest.approx(volume_mm3(coupon, stage), rel=1e-9)
        mesh = mesh_of(part, TOLERANCE_MM)
        solid = trimesh.load_mesh(io.BytesIO(as_stl(mesh, LABEL)), file_type="stl")
        assert solid.is_watertight
        assert solid.is_volume
        assert abs(solid.volume - part.volume_mm3) <= part.wall_mm2 * TOLERANCE_MM
        separate = [feature for feature in coupon.features if feature.stage == stage and not feature.is_stacked]
        assert solid.body_count == (len(separate) if coupon.slab is None else 1)


@pytest.mark.parametrize("name", ["group-a", "holes"])
def test_features_are_at_their_positions(name: str) -> None:
    """A section of the mesh has material at the centre of each feature and none next to it; for a hole, vice versa."""
    coupon = layout(name)
    mesh = mesh_of(coupon_parts(coupon)[""], TOLERANCE_MM)
    solid = trimesh.Trimesh(mesh.vertices, mesh.triangles)
    assert coupon.slab is not None
    for feature in coupon.features:
        contains = section(solid, feature.from_mm + 0.5 * feature.height_mm)
        is_hole = feature.kind == "hole"
        assert contains(feature.x_mm, feature.y_mm) != is_hole, feature.name
        assert contains(feature.x_mm, feature.y_mm + 0.5 * feature.depth_mm + 0.02) == is_hole, feature.name
    x, y = 0.5 * coupon.slab.width_mm - 0.1, 0.5 * coupon.slab.depth_mm - 0.1
    contains = section(solid, 0.4)
    corners = [contains(x, y), contains(x, -y), contains(-x, y), contains(-x, -y)]
    assert corners == [False, True, True, True], "the rear right corner is chamfered"


def section(solid: trimesh.Trimesh, height_mm: float) -> Callable[[float, float], bool]:
    """Return a function that is true at points of a section, according to the number of outlines around them."""
    import shapely

    rings = [shapely.Polygon(ring[:, :2]) for ring in solid.section([0, 0, 1], [0, 0, height_mm]).discrete]
    return lambda x, y: sum(ring.contains(shapely.Point(x, y)) for ring in rings) % 2 == 1


@pytest.mark.skipif(not HAS_KERNEL, reason="needs Open CASCADE")
@pytest.mark.parametrize("name", ["group-b", "holes", "cubes"])
def test_step_files_have_the_volume(name: str, tmp_path: Path) -> None:
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.STEPControl import STEPControl_Reader

    part = coupon_parts(layout(name))[""]
    (tmp_path / "part.step").write_bytes(as_step(part, LABEL))
    reader = STEPControl_Reader()
    reader.ReadFile(str(tmp_path / "part.step"))
    reader.TransferRoots()
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(reader.OneShape(), properties)
    assert properties.Mass() == pytest.approx(part.volume_mm3, rel=1e-6)


@every_coupon
def test_a_job_contains_the_layout(name: str, tmp_path: Path) -> None:
    coupon, options = layout(name), CouponOptions()
    path = tmp_path / "job.json"
    path.write_bytes(as_job(coupon, options, {}))
    job_coupon, job = read_job(path)
    assert job_coupon == coupon
    assert job["print"]["energy_mJ_per_cm2"] == 26.0
    assert job["print"]["burn_in_energy_mJ_per_cm2"] == 39.0
    if name == "group-a":
        assert job["stages"][0]["layers"] == 152, "3.8 mm in layers of 25 µm"
    if name == "cure-discs":
        assert [exposure["energy_mJ_per_cm2"] for exposure in job["stages"][0]["exposures"]][:3] == [13.0, 19.5, 26.0]


@every_coupon
def test_plans_are_to_scale(name: str) -> None:
    coupon = layout(name)
    root = ET.fromstring(as_plan(coupon, LABEL))  # noqa: S314 - written by the test
    space = "{http://www.w3.org/2000/svg}"
    _, _, width, height = (float(number) for number in root.attrib["viewBox"].split())
    assert root.attrib["width"] == f"{width:g}mm"
    assert root.attrib["height"] == f"{height:g}mm"
    circles = {circle.attrib["id"]: circle.attrib for circle in root.iter(f"{space}circle")}
    for feature in coupon.features:
        if feature.round:
            circle = circles[feature.name]
            assert 2 * float(circle["r"]) == pytest.approx(feature.diameter_mm)
            assert float(circle["cx"]) == pytest.approx(feature.x_mm, abs=1e-8)
            assert float(circle["cy"]) == pytest.approx(-feature.y_mm, abs=1e-8)


def test_warns_of_features_below_the_resolution_of_the_printer() -> None:
    options = CouponOptions(layer_um=50.0, pitch_um=62.0)
    warnings = " ".join(cautions(layout("group-c", options), options))
    assert "steps of 25 µm are lower than a layer of 50 µm" in warnings
    warnings = " ".join(cautions(layout("group-b", options), options))
    assert re.search("g-0.06, g-0.05, g-0.04, g-0.03, g-0.02.*62 µm", warnings)
    assert cautions(layout("group-c"), CouponOptions()) == [], "all heights are multiples of 25 µm"
    options = CouponOptions(layer_um=30.0)
    assert "not multiples of the layer thickness, 30 µm" in cautions(layout("group-a", options), options)[0]


@pytest.mark.parametrize(
    ("change", "text"),
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
def test_refuses_a_damaged_job(change: Callable[[Any], object], text: str) -> None:
    data = json.loads(json.dumps(asdict(layout("group-a"))))
    change(data)
    with pytest.raises(DataError) as error:
        coupon_of(data, "job.json")
    assert text in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"kind": "cure"}', '{"kind": "coupon-job", "schema": 9}', '{"a": NaN}']
)
def test_refuses_a_file_that_is_not_a_job(text: str, tmp_path: Path) -> None:
    path = tmp_path / "job.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataError):
        read_job(path)


@pytest.fixture
def coupons(capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> dict[str, Any]:
        return answered(capfd, "print", "coupons", *arguments)

    return run


def test_the_command_writes_the_listed_files(coupons: Run) -> None:
    result = coupons("--out", "print", "--only", "holes,film-layer", "--pitch-um", "62", "--figure", "plans.svg")
    assert [coupon["name"] for coupon in result["coupons"]] == ["holes", "film-layer"]
    for path in result["files"].values():
        assert Path(path).stat().st_size > 100
    for coupon in result["coupons"]:
        job = json.loads(Path(result["files"][f"{coupon['name']}.json"]).read_text(encoding="utf-8"))
        assert job["sha256"] == coupon["sha256"]
        assert job["choices"]["pitch_um"] == 62.0
    written = sorted(path.name for path in Path("print").iterdir())
    assert len(written) == 4 + 6
    assert "film-layer-base.stl" in written
    first = {path.name: path.read_bytes() for path in Path("print").iterdir()}
    coupons("--out", "print", "--only", "holes,film-layer", "--pitch-um", "62")
    assert first == {path.name: path.read_bytes() for path in Path("print").iterdir()}, "files contain no dates"


def test_pixels_are_those_of_the_selected_printer(coupons: Run) -> None:
    result = coupons("--out", "print", "--only", "group-b", "--printer", "asiga-max-uv")
    assert result["options"]["pitch_um"] == 62.0
    assert any("62 µm" in warning for warning in result["coupons"][0]["warnings"])


def test_the_list_contains_the_assumptions_about_the_publication(coupons: Run) -> None:
    result = coupons("--list", "--hole-reading", "tenths")
    assert [coupon["name"] for coupon in result["coupons"]] == list(COUPONS)
    (holes,) = [coupon for coupon in result["coupons"] if coupon["name"] == "holes"]
    assert "2.10 mm" in holes["readings"][0]["taken"]
    assert not list(Path().iterdir())


def test_printed_lines(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert run_command(["print", "coupons", "--list"]) == 0
    assert "printed: " not in capfd.readouterr().err
    assert run_command(["print", "coupons", "--out", str(tmp_path / "p"), "--only", "z-reference"]) == 0
    assert re.search(r"z-reference: 3 features, 44\.05 mm3", capfd.readouterr().out)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--out", "p", "--only", "group-x"], "--only = 'group-x'; must be one or more of group-a"),
        (["--out", "p", "--only", ""], "--only = ''"),
        ([], "--out; missing"),
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
def test_refuses_invalid_options_without_writing(
    arguments: list[str],
    text: str,
    capfd: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command(["print", "coupons", *arguments]) == 2
    printed = capfd.readouterr()
    assert text in printed.err
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert not list(tmp_path.iterdir())
