"""`solen print inspect`: numbers, figure and profile from an image file, or a one-line error."""

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
    folder_ = tmp_path_factory.mktemp("inspect")
    levels = Scene(SHAPE, reflected(printed(bump(0.8, 25.0, 0.15)), PLACING)).taken(3)
    (folder_ / "lens.ome.tif").write_bytes(ome_tiff(levels, UM_PER_PX))
    (folder_ / "bare.png").write_bytes(png(levels))
    (folder_ / "design.toml").write_text(dumps(shipped()), encoding="utf-8")
    (folder_ / "other.toml").write_text(dumps(shipped(lens__focus_mm=15.0)), encoding="utf-8")
    (folder_ / "flat.toml").write_text(dumps(shipped(lens__shape="none")), encoding="utf-8")
    return folder_


def inspected(
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


def test_reports_and_writes_all_outputs(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figure, out = tmp_path / "f.svg", tmp_path / "lens.json"
    look = ("--figure", str(figure), "--panels", "A", "--letters", "E")
    result = inspected(folder, capsys, "--u-um-per-px", "0.01", *look, "--out", str(out))
    assert result["scale"]["um_per_px"] == UM_PER_PX
    assert result["scale"]["origin"] == "OME-XML PhysicalSizeX"
    assert result["nearest"] == "n = 1.44"
    assert result["designs"]["n = 1.44"]["probability"] > 0.99
    deviation = result["deviation"]
    assert deviation["max_um"] == pytest.approx(25.0, abs=5.0)
    assert deviation["max_x_mm"] == pytest.approx(0.8, abs=0.05)
    assert deviation["rms_um"] == pytest.approx(
        float(np.sqrt(np.mean(np.square(result["outline_deviation_um"])))), rel=1e-3
    )
    assert 0.0 < deviation["u_rms_um"] < 1.0
    assert result["rotation_deg"] == pytest.approx(PLACING.angle_deg, abs=0.5)
    assert result["width_mm"] == pytest.approx(4.0, abs=0.02)
    assert result["edge"]["points_used"] == len(result["outline_mm"]) == len(result["u_outline_deviation_um"])
    assert [edge["name"] for edge in result["edges"]] == ["single"]
    assert result["sources"][0]["file"] == "lens.ome.tif"
    drawn = figure.read_text(encoding="utf-8")
    for words in ("deviation (µm), positive outwards", "n = 1.44", "rival: n = 1.49", ">E<"):
        assert words in drawn, "a single panel keeps the colour bar and names the indices"
    profile = read_profile(out)
    assert profile.edge == "mean"
    points = np.asarray(result["outline_mm"])
    np.testing.assert_allclose(np.interp(profile.x_mm, *points[np.argsort(points[:, 0])].T), profile.z_mm, atol=1e-5)


def test_printed_lines(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["print", "inspect", str(folder / "lens.ome.tif"), "--design", str(folder / "design.toml")]) == 0
    text = capsys.readouterr().out
    assert "µm RMS from" in text
    assert "nearest of 3 designs: n = 1.44" in text
    assert "--u-um-per-px" in text, "a warning names the missing scale uncertainty"


def test_compares_user_designs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = inspected(folder, capsys, "--against", str(folder / "other.toml"))
    assert set(result["designs"]) == {shipped().name, "other"}
    assert result["nearest"] == shipped().name


def test_width_reveals_wrong_scale(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = inspected(folder, capsys, "--um-per-px", "5.3")
    assert result["scale"]["um_per_px"] == 5.3
    assert result["width_mm"] == pytest.approx(4.24, abs=0.03)
    printed = " ".join(result["warnings"])
    assert "--um-per-px 5.3 is used although OME-XML PhysicalSizeX specifies 5 (+6.0 %)" in printed
    assert "the scale or the size of the print" in printed


def test_compares_design_index_with_those_of_paper(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = inspected(folder, capsys, "--set", "lens.design_index=1.46")
    assert set(result["designs"]) == {"n = 1.46", "n = 1.44", "n = 1.49", "n = 1.54"}
    assert result["nearest"] == "n = 1.44"


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
def test_invalid_input_gives_one_line(
    case: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.iterdir())
    arguments, expected = BAD[case]
    if "--design" not in arguments:
        arguments = [*arguments, "--design", "design.toml"]
    assert run_command(["print", "inspect", *arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
    assert expected in printed.err
    assert sorted(folder.iterdir()) == before


def test_simulated_image_is_marked(tmp_path: Path, folder: Path) -> None:
    from PIL import Image as Pillow
    from PIL import PngImagePlugin

    levels = Scene(SHAPE, reflected(OUTLINE, PLACING)).taken(1)
    metadata = PngImagePlugin.PngInfo()
    metadata.add_text("Description", "simulated micrograph")
    Pillow.fromarray(levels).save(tmp_path / "a.png", pnginfo=metadata)
    out = tmp_path / "lens.json"
    result = inspect(
        tmp_path / "a.png", design=folder / "design.toml", options=InspectOptions(um_per_px=UM_PER_PX), out=out
    ).result
    assert result.simulated
    assert read_profile(out).simulated


def test_missing_extra_gives_one_line(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "tifffile", None)
    with pytest.raises(SolenError, match=r'pip install "ome-types\S+" "scikit-image\S+" "tifffile\S+"$'):
        inspect(folder / "lens.ome.tif", design=folder / "design.toml")
