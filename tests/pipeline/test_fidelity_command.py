"""`solen print fidelity`: the result, the result file and the figure of an image or height map, and refused input."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image as Pillow
from PIL import PngImagePlugin

from solen.cli import run_command
from solen.geometry.coupons import CouponOptions, layout
from tests.command_support import answered
from tests.metrology.coupon_support import Camera, Print

Run = Callable[..., Any]
UM_PER_PX = 14.0


def png(path: Path, grey: Any) -> None:
    metadata = PngImagePlugin.PngInfo()
    metadata.add_text("Description", "simulated micrograph")
    Pillow.fromarray(np.rint(255 * grey).astype(np.uint8)).save(path, pnginfo=metadata)


@pytest.fixture
def printed_result(capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> dict[str, Any]:
        return answered(capfd, *arguments)

    return run


def test_measures_image_of_group_a(printed_result: Run, capfd: pytest.CaptureFixture[str]) -> None:
    coupon = layout("group-a")
    part = Print(coupon, size_mm=lambda feature: feature.diameter_mm + 0.02, missing=frozenset({"d-0.06", "d-0.08"}))
    png(Path("a.png"), Camera(UM_PER_PX, 3.0, blur_px=1.2).image(part))
    options = ("print", "fidelity", "a.png", "--coupon", "group-a", "--um-per-px", "14")
    result = printed_result(*options, "--figure", "a.svg", "--out", "a.json")
    assert result["minimum"]["positive_diameter"]["nominal_mm"] == 0.1
    assert result["minimum"]["positive_diameter"]["next_mm"] == 0.08
    assert result["simulated"] is True
    assert [source["file"] for source in result["sources"]] == ["a.png"]
    written = json.loads(Path("a.json").read_text(encoding="utf-8"))
    assert written["kind"] == "fidelity"
    assert written["coupon"] == "group-a"
    for feature in written["features"]:
        assert feature["kind"] == "pillar"
        assert feature["resolved"] is (feature["measured_mm"] is not None)
        if feature["resolved"]:
            assert feature["measured_mm"] == pytest.approx(
                feature["nominal_mm"] + 0.02, abs=5 * feature["u_measured_mm"]
            )
    assert "simulated: a.png" in Path("a.svg").read_text(encoding="utf-8")
    assert run_command([*options]) == 0
    lines = capfd.readouterr().out
    assert lines.startswith("simulated: group-a")
    assert "smallest standing pillar: 0.1 mm, printed 0.12" in lines
    assert "0.08 mm is not" in lines


def test_job_defines_layout(printed_result: Run) -> None:
    """A coupon with other dimensions is recognised with its job, and not without it."""
    printed_result(
        "print", "coupons", "--out", "print", "--only", "group-b", "--spacing-mm", "1.6", "--gap-reading", "row"
    )
    coupon = layout("group-b", CouponOptions(spacing_mm=1.6, gap_reading="row"))
    png(Path("b.png"), Camera(8.0, blur_px=1.2).image(Print(coupon)))
    result = printed_result("print", "fidelity", "b.png", "--job", "print/group-b.json", "--um-per-px", "8")
    assert result["coupon"] == "group-b"
    assert {feature["diameter_mm"] for feature in result["features"] if feature["kind"] == "gap"} == {0.3}
    assert {feature["name"] for feature in result["features"] if feature["kind"] == "gap" and feature["resolved"]} >= {
        "g-0.5",
        "g-0.1",
    }
    assert run_command(["print", "fidelity", "b.png", "--coupon", "group-b", "--um-per-px", "8"]) == 2


def test_measures_height_map_of_z_reference(printed_result: Run) -> None:
    z = Camera(20.0, 5.0).height_map(Print(layout("z-reference")))
    tifffile.imwrite("z.tif", (1e3 * z).astype(np.float32))
    result = printed_result(
        "print", "fidelity", "z.tif", "--coupon", "z-reference", "--um-per-px", "20", "--z-um", "1", "--figure", "z.png"
    )
    assert result["image"] == "height map"
    assert result["minimum"]["z_step"]["nominal_mm"] == pytest.approx(0.025)
    assert [feature["measured_mm"] for feature in result["heights"]] == pytest.approx([1.0, 1.025, 0.025], abs=1e-3)
    assert Path("z.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["a.png", "--coupon", "group-a"], "does not specify the pixel size"),
        (["a.png", "--um-per-px", "14"], "--coupon; is missing"),
        (["a.png", "--coupon", "group-x", "--um-per-px", "14"], "must be one of group-a"),
        (["a.png", "--coupon", "group-a", "--um-per-px", "0"], "--um-per-px = '0'; must be at least 0.0001"),
        (["a.png", "--coupon", "group-a", "--um-per-px", "14"], "shows no group-a"),
        (["a.png", "--coupon", "group-c", "--um-per-px", "14"], "--z-um"),
        (["a.png", "--coupon", "cubes", "--um-per-px", "14"], "has no features that an image shows"),
        (["a.png", "--coupon", "group-a", "--um-per-px", "14", "--z-um", "1"], "neither a TIFF nor a table"),
        (["none.png", "--coupon", "group-a", "--um-per-px", "14"], "no such file"),
        (["z.csv", "--coupon", "z-reference", "--um-per-px", "14"], "--z-um; is required"),
        (["a.png", "--job", "none.json", "--um-per-px", "14"], "no such file"),
        (["a.png", "--job", "job.json", "--um-per-px", "14"], "job.json"),
        (["a.png", "--coupon", "group-a", "--um-per-px", "14", "--figure", "a.gif"], "a figure must end in"),
        (["a.png", "--coupon", "group-a", "--um-per-px", "14", "--out", "a.txt"], "a result must end in .json"),
        (["a.png", "--coupon", "group-a", "--um-per-px", "14", "--set", "spacing=2"], "spacing"),
    ],
)
def test_refuses_bad_input_in_one_line(
    arguments: list[str], part: str, capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    png(Path("a.png"), 0.5 + 0.05 * np.random.default_rng(1).standard_normal((200, 300)))
    Path("job.json").write_text("{}", encoding="utf-8")
    Path("z.csv").write_text("1,2\n3,4\n", encoding="utf-8")
    files_before = sorted(path.name for path in tmp_path.iterdir())
    assert run_command(["print", "fidelity", *arguments]) == 2
    printed = capfd.readouterr()
    assert part in printed.err
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == files_before
