"""`solen print inspect`: from a file of an image to numbers, a figure and a profile, or to one line."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.cli import run_command
from solen.errors import SolenError
from solen.lens.profile import read_profile
from solen.metrology import InspectOptions
from solen.pipeline.print.inspect import inspect
from solen.spec import dumps
from tests.metrology.lens_support import OUTLINE, PLACING, SHAPE, UM_PER_PX, printed
from tests.metrology.render.camera import ome_tiff, png
from tests.metrology.render.micrograph import Scene, reflected
from tests.metrology.render.shape import bump, shipped


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An image with its scale, one without, and the designs."""
    at = tmp_path_factory.mktemp("inspect")
    levels = Scene(SHAPE, reflected(printed(bump(0.8, 25.0, 0.15)), PLACING)).taken(3)
    (at / "lens.ome.tif").write_bytes(ome_tiff(levels, UM_PER_PX))
    (at / "bare.png").write_bytes(png(levels))
    (at / "design.toml").write_text(dumps(shipped()), encoding="utf-8")
    (at / "other.toml").write_text(dumps(shipped(lens__focus_mm=15.0)), encoding="utf-8")
    (at / "flat.toml").write_text(dumps(shipped(lens__shape="none")), encoding="utf-8")
    return at


def asked(
    folder: Path, capsys: pytest.CaptureFixture[str], *options: str, name: str = "lens.ome.tif"
) -> dict[str, Any]:
    assert (
        run_command(
            ["print", "inspect", str(folder / name), "--design", str(folder / "design.toml"), "--json", *options]
        )
        == 0
    )
    printed_lines = capsys.readouterr().out.splitlines()
    assert len(printed_lines) == 1
    return dict(json.loads(printed_lines[0]))


def test_everything_that_is_asked_for_is_reported_and_written(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figure, out = tmp_path / "f.svg", tmp_path / "lens.json"
    look = ("--figure", str(figure), "--panels", "A", "--letters", "E")
    found = asked(folder, capsys, "--u-um-per-px", "0.01", *look, "--out", str(out))
    assert found["scale"]["um_per_px"] == UM_PER_PX
    assert found["scale"]["origin"] == "OME-XML PhysicalSizeX"
    assert found["nearest"] == "n = 1.44"
    assert found["designs"]["n = 1.44"]["probability"] > 0.99
    off = found["deviation"]
    assert off["max_um"] == pytest.approx(25.0, abs=5.0)
    assert off["max_x_mm"] == pytest.approx(0.8, abs=0.05)
    assert off["rms_um"] == pytest.approx(float(np.sqrt(np.mean(np.square(found["outline_deviation_um"])))), rel=1e-3)
    assert 0.0 < off["u_rms_um"] < 1.0
    assert found["rotation_deg"] == pytest.approx(PLACING.angle_deg, abs=0.5)
    assert found["width_mm"] == pytest.approx(4.0, abs=0.02)
    assert found["edge"]["points_used"] == len(found["outline_mm"]) == len(found["u_outline_deviation_um"])
    assert [edge["name"] for edge in found["edges"]] == ["single"]
    assert found["sources"][0]["file"] == "lens.ome.tif"
    drawn = figure.read_text(encoding="utf-8")
    for words in ("deviation, + outwards (µm)", "n = 1.44", "rival: n = 1.49", ">E<"):
        assert words in drawn, "the image alone keeps its colour bar and names the indices"
    profile = read_profile(out)
    assert profile.edge == "mean"
    points = np.asarray(found["outline_mm"])
    np.testing.assert_allclose(np.interp(profile.x_mm, *points[np.argsort(points[:, 0])].T), profile.z_mm, atol=1e-5)


def test_lines_for_a_reader(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["print", "inspect", str(folder / "lens.ome.tif"), "--design", str(folder / "design.toml")]) == 0
    text = capsys.readouterr().out
    assert "µm (rms) from" in text
    assert "nearest of 3 designs: n = 1.44" in text
    assert "--u-um-per-px" in text, "an unstated uncertainty of the scale is told"


def test_designs_of_ones_own_are_compared(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = asked(folder, capsys, "--against", str(folder / "other.toml"))
    assert set(found["designs"]) == {shipped().name, "other"}
    assert found["nearest"] == shipped().name


def test_a_wrong_scale_is_recognised_by_the_width(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = asked(folder, capsys, "--um-per-px", "5.3")
    assert found["scale"]["um_per_px"] == 5.3
    assert found["width_mm"] == pytest.approx(4.24, abs=0.03)
    said = " ".join(found["warnings"])
    assert "--um-per-px 5.3 is used although OME-XML PhysicalSizeX specifies 5 (+6.0 %)" in said
    assert "the scale or the size of the print" in said


def test_an_index_between_the_papers_joins_the_comparison(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = asked(folder, capsys, "--set", "lens.design_index=1.46")
    assert set(found["designs"]) == {"n = 1.46", "n = 1.44", "n = 1.49", "n = 1.54"}
    assert found["nearest"] == "n = 1.44"


BAD = {
    "no scale": (["bare.png"], "--um-per-px"),
    "no such image": (["none.png"], "no such file"),
    "no lens": (["lens.ome.tif", "--design", "flat.toml"], "no lens"),
    "no such design": (["lens.ome.tif", "--design", "none.toml"], "no such file"),
    "other width": (["lens.ome.tif", "--um-per-px", "8"], "shows no lens"),
    "too coarse": (["lens.ome.tif", "--um-per-px", "100"], "pixels wide"),
    "edge": (["lens.ome.tif", "--edge", "upper"], "outer"),
    "figure": (["lens.ome.tif", "--figure", "a.txt"], "figure must end in"),
    "out": (["lens.ome.tif", "--out", "a.csv"], ".json"),
    "u": (["lens.ome.tif", "--u-um-per-px", "-1"], "--u-um-per-px"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line(
    case: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.iterdir())
    arguments, expected = BAD[case]
    if "--design" not in arguments:
        arguments = [*arguments, "--design", "design.toml"]
    assert run_command(["print", "inspect", *arguments]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert expected in said.err
    assert sorted(folder.iterdir()) == before


def test_a_simulated_image_is_called_so(tmp_path: Path, folder: Path) -> None:
    from PIL import Image as Pillow
    from PIL import PngImagePlugin

    levels = Scene(SHAPE, reflected(OUTLINE, PLACING)).taken(1)
    about = PngImagePlugin.PngInfo()
    about.add_text("Description", "simulated micrograph")
    Pillow.fromarray(levels).save(tmp_path / "a.png", pnginfo=about)
    out = tmp_path / "lens.json"
    found = inspect(
        tmp_path / "a.png", design=folder / "design.toml", options=InspectOptions(um_per_px=UM_PER_PX), out=out
    ).result
    assert found.simulated
    assert read_profile(out).simulated


def test_a_missing_extra_is_one_line(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "tifffile", None)
    with pytest.raises(SolenError, match=r'pip install "ome-types\S+" "scikit-image\S+" "tifffile\S+"$'):
        inspect(folder / "lens.ome.tif", design=folder / "design.toml")
