"""`solen print layers`, `solen print printers` and `solen export --layers`: files, printed lines and errors."""

import json
import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from solen.cli import run_command
from solen.fabricate.layers import archive, as_png
from solen.spec import template
from tests.command_support import answered, refusal, snapshot
from tests.fabricate.zip_reader import read_zip

Run = Callable[..., Any]
COARSE = ("--layer-um", "100", "--printer", "small.toml")


def small_printer() -> str:
    """Return the generic printer with fewer and larger pixels: 30 × 45 mm."""
    text = (files("solen.parts") / "printers" / "generic.toml").read_text(encoding="utf-8")
    for old, new in (
        ("typical = 50", "typical = 100"),
        ("columns = 1920", "columns = 300"),
        ("rows = 1080", "rows = 450"),
    ):
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "a folder's name"
    folder.mkdir()
    (folder / "my sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    (folder / "small.toml").write_text(small_printer(), encoding="utf-8")
    trimesh.creation.box((10.0, 10.0, 2.0)).export(folder / "box.stl")
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def command(capfd: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: str) -> dict[str, Any]:
        return answered(capfd, *arguments)

    return run


@pytest.fixture
def error_of(folder: Path, capfd: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: str) -> str:
        return refusal(capfd, folder, *arguments)

    return run


def images(path: str) -> list[Any]:
    stack = read_zip(path)
    return [stack.layer(index).image for index in range(stack.count)]


def test_writes_layers_stl_and_settings_of_a_design(command: Run) -> None:
    result = command(
        "print", "layers", "my sensor.toml", "--out", "out", *COARSE, "--figure", "f.svg", "--resin", "noa61"
    )
    names = {kind: Path(path).name for kind, path in result["files"].items()}
    assert names == {
        "layers": "my-sensor-layers.zip",
        "placed": "my-sensor-placed.stl",
        "sheet": "my-sensor-settings.md",
        "settings": "my-sensor-settings.json",
        "figure": "f.svg",
    }
    assert {path.name for path in Path("out").iterdir()} == set(names.values()) - {"f.svg"}
    stack = images(result["files"]["layers"])
    assert len(stack) == result["layers"] == 40
    assert stack[0].shape == (450, 300)
    volume = sum(image.sum(dtype=int) for image in stack) / 255 * 0.1**2 * 0.1
    assert result["stack_volume_mm3"] == pytest.approx(volume, rel=1e-12)
    assert abs(result["volume_error"]) < 1e-4
    assert result["settings"]["material"].startswith("NOA")
    assert result["sources"][0]["file"] == "my sensor.toml"
    assert any("are estimates" in line for line in result["warnings"])
    assert any("13 mW/cm²" in line for line in result["warnings"])
    assert Path("f.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_no_pixel_is_grey_without_anti_aliasing(command: Run) -> None:
    result = command("print", "layers", "my sensor.toml", "--out", "out", *COARSE, "--no-anti-aliasing")
    assert set(np.unique(images(result["files"]["layers"])[0])) == {0, 255}
    with zipfile.ZipFile(result["files"]["layers"]) as opened:
        assert json.loads(opened.read("job.json"))["anti_aliasing"] is False


def test_the_sheet_lists_the_settings_of_the_slicer(command: Run) -> None:
    options = ("--copies", "2", "--z-offset-um", "600", "--irradiance-mW-per-cm2", "12", "--orientation", "upright")
    result = command("print", "layers", "my sensor.toml", "--out", "out", "--sheet-only", "--gap-mm", "3", *options)
    assert result["stack_volume_mm3"] is None
    assert "layers" not in result["files"]
    sheet = Path(result["files"]["sheet"]).read_text(encoding="utf-8")
    for row in (
        "| STL to load | `my-sensor-placed.stl`, in **mm**",
        "| Copies | 2 |",
        "| Layer (slice) thickness | 25 µm |",
        "| Burn-in layers | 6 |",
        "| Burn-in exposure | 3 s = 36 mJ/cm² per layer |",
        "| Exposure of all other layers | 2 s = 24 mJ/cm² per layer |",
        "| Light intensity | 12 mW/cm²",
        "| Z offset | 600 µm",
        "| Orientation | upright",
        "| Layers | 1616, 40.4 mm high |",
        "385 nm",
    ):
        assert row in sheet
    settings = json.loads(Path(result["files"]["settings"]).read_text(encoding="utf-8"))
    assert settings["expected_layers"] == 1616
    assert settings["estimated_time_s"] == 6 * 3 + 1610 * 2 + 1616 * 6
    assert not any("13 mW/cm²" in line for line in result["warnings"])
    placed = trimesh.load_mesh(result["files"]["placed"])
    assert placed.is_watertight
    assert placed.bounds == pytest.approx(np.array([(0, 0, 0), (11.806, 4.0, 40.412)]), abs=1e-3)


def test_the_placed_stl_has_the_same_layers(command: Run) -> None:
    """Rounding to 32 bits changes the images by 2 grey levels at most."""
    first = command("print", "layers", "my sensor.toml", "--out", "a", *COARSE, "--orientation", "on-edge")
    second = command("print", "layers", first["files"]["placed"], "--out", "b", *COARSE)
    pairs = zip(images(first["files"]["layers"]), images(second["files"]["layers"]), strict=True)
    assert max(int(np.abs(image.astype(int) - copy).max()) for image, copy in pairs) <= 2
    assert second["sources"][0]["format"] == "stl"
    assert "--resin" in second["settings"]["material"]


def test_cure_depths_are_those_of_a_resin_file(command: Run) -> None:
    text = 'schema = 1\nname = "thin"\n[cure]\nDp_um = 50\nEc_mJ_per_cm2 = 20\nwavelength_nm = 405\n'
    text += 'warnings = ["one disc"]\n'
    Path("thin.toml").write_text(text, encoding="utf-8")
    result = command("print", "layers", "my sensor.toml", "--out", "out", "--sheet-only", "--resin", "thin.toml")
    assert result["settings"]["cure_depth_um"] == pytest.approx(50 * np.log(26 / 20))
    assert "cure: one disc" in result["warnings"]
    assert result["settings"]["burn_in_cure_depth_um"] == pytest.approx(50 * np.log(39 / 20))
    assert any("13 µm" in line and "25 µm" in line for line in result["warnings"])
    assert any("405 nm" in line and "385 nm" in line for line in result["warnings"])


def test_export_writes_layers(command: Run) -> None:
    result = command("export", "my sensor.toml", "--out", "out", "--stl", "--layers", *COARSE, "--pockets")
    assert set(result["files"]) == {"stl", "layers", "placed", "sheet", "settings"}
    assert result["layers"]["layers"] == 40
    assert abs(result["layers"]["volume_error"]) < 0.005
    assert len(list(Path("out").iterdir())) == 5
    assert "| Pockets and slots | pocket-right, pocket-left |" in Path(result["files"]["sheet"]).read_text("utf-8")
    layers = command("export", "my sensor.toml", "--out", "other", "--layers", *COARSE)
    assert set(layers["files"]) == {"layers", "placed", "sheet", "settings"}
    assert len(list(Path("other").iterdir())) == 4
    assert "| Pockets and slots | none |" in Path(layers["files"]["sheet"]).read_text("utf-8")


def test_files_are_reproducible(command: Run, folder: Path) -> None:
    for out in ("a", "b"):
        command("print", "layers", "box.stl", "--out", out, *COARSE)
    assert snapshot(folder / "a") == snapshot(folder / "b")


def test_printed_lines(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command(["print", "layers", "box.stl", "--out", "out", *COARSE]) == 0
    assert "volume_error" in capfd.readouterr().out
    assert run_command(["export", "my sensor.toml", "--out", "out", "--layers", *COARSE]) == 0
    assert "my-sensor-layers.zip" in capfd.readouterr().out
    assert run_command(["print", "printers"]) == 0
    assert "asiga-ultra-32" in capfd.readouterr().out
    assert run_command(["print", "printers", "generic"]) == 0
    assert "pitch_um: typical 50 (estimate: chosen)" in capfd.readouterr().out


def test_lists_printers_as_json(command: Run) -> None:
    rows = {row["printer"]: row for row in command("print", "printers")["printers"]}
    assert rows["generic"]["size_mm"] == [96.0, 54.0, 100.0]
    assert command("print", "printers", "asiga-max-x27")["file"]["pitch_um"]["basis"] == "estimate"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--printer", "asiga-max-x27"], "Asiga MAX X27, 51.84 x 29.16 x 75 mm; rotate"),
        (["--printer", "asiga-max-x72"], "did you mean asiga-max-x27?"),
        (["--printer", "none.toml"], "no such file"),
        (["--layer-um", "5"], "--layer-um = 5.0; must be 10 to 200 µm"),
        (["--layer-um", "0"], "--layer-um = 0.0"),
        (["--orientation", "sideways"], "--orientation = 'sideways'"),
        (["--rotate-deg", "nan", "0", "0"], "--rotate-deg"),
        (["--rotate-deg", "1", "2"], "--rotate-deg"),
        (["--copies", "300"], "--copies = 300"),
        (["--exposure-s", "-2"], "--exposure-s = '-2'"),
        (["--burn-in-s", "inf"], "--burn-in-s = 'inf'"),
        (["--irradiance-mW-per-cm2", "0"], "--irradiance-mW-per-cm2 = '0'"),
        (["--z-offset-um", "nan"], "--z-offset-um = 'nan'"),
        (["--mirror", "both"], "--mirror = 'both'"),
        (["--resin", "noa16"], "did you mean noa61?"),
        (["--set", "body.thickness_mm=0"], "body.thickness_mm = 0"),
        (["--set", "body.thickness_mm=0.01"], "half a layer of 25 µm"),
        (["--figure", "f.jpg"], "a figure must end in"),
        (["--figure", "f.svg", "--sheet-only"], "--figure; cannot be combined with --sheet-only"),
    ],
)
def test_refuses_invalid_values(error_of: Run, arguments: list[str], line: str) -> None:
    assert line in error_of("print", "layers", "my sensor.toml", "--out", "out", *arguments)


def test_refuses_invalid_files(error_of: Run, folder: Path) -> None:
    data = (folder / "box.stl").read_bytes()
    (folder / "cut.stl").write_bytes(data[:-20])
    (folder / "open.stl").write_bytes(data[:80] + (11).to_bytes(4, "little") + data[84:-50])
    (folder / "mesh.obj").write_text("v 0 0 0", encoding="utf-8")
    assert "is truncated" in error_of("print", "layers", "cut.stl", "--out", "out")
    assert "open.stl; is not watertight: 3 edges" in error_of("print", "layers", "open.stl", "--out", "out")
    assert "must be a design (.toml) or a mesh (.stl, .3mf)" in error_of("print", "layers", "mesh.obj", "--out", "out")
    assert "no such file" in error_of("print", "layers", "none.stl", "--out", "out")
    assert "--set" in error_of("print", "layers", "box.stl", "--out", "out", "--set", "body.thickness_mm=1")
    assert "--layers; is missing" in error_of("export", "my sensor.toml", "--out", "out", "--copies", "2")


def test_reverses_an_inside_out_mesh_and_warns_of_a_mesh_in_metres(command: Run, folder: Path) -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.05))
    trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False).export(folder / "inverted.stl")
    result = command("print", "layers", "inverted.stl", "--out", "out")
    assert result["volume_error"] == pytest.approx(0.0, abs=1e-6)
    assert any("inside out" in line for line in result["warnings"])
    assert any("read in mm" in line for line in result["warnings"])


def test_warns_of_horizontal_faces_within_layers(command: Run) -> None:
    """The faces of pockets at 1.325 and 2.675 mm are boundaries of layers of 25 µm, but not of 50 µm."""
    arguments = ("print", "layers", "my sensor.toml", "--out", "out", "--sheet-only", "--set", "fabricate.pockets=true")
    assert not any("horizontal faces" in line for line in command(*arguments)["warnings"])
    result = command(*arguments, "--layer-um", "50")
    (line,) = (line for line in result["warnings"] if "horizontal faces" in line)
    assert re.search(r"2 horizontal.*1\.325 mm.*25\.0 µm", line)
    mesh = ("print", "layers", result["files"]["placed"], "--out", "mesh", "--sheet-only", "--layer-um", "50")
    assert line in command(*mesh)["warnings"]


def test_an_interruption_leaves_no_files(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = snapshot(folder)
    calls = []

    def interrupted(image: Any, pitches_mm: tuple[float, float]) -> bytes:
        calls.append(image)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return as_png(image, pitches_mm)

    monkeypatch.setattr(archive, "as_png", interrupted)
    assert (
        run_command(["print", "layers", "my sensor.toml", "--out", "out", *COARSE, "--orientation", "upright"]) == 130
    )
    assert len(calls) == 3
    assert snapshot(folder) == before


SCRIPT = """
import resource, sys
from pathlib import Path
from solen.pipeline.print.layers import layers
from solen.fabricate.layers import Slicing
slicing = Slicing(printer="asiga-ultra-32", orientation="upright", copies=12)
result = layers(Path("my sensor.toml"), out=Path("out"), slicing=slicing, set_=["body.stem_length_mm=25.9"]).result
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6
print(result.layers, peak, result.volume_error)
"""


@pytest.mark.evidence
def test_memory_of_2000_layers_of_3840_by_2160_pixels_is_below_500_mb() -> None:
    """Twelve upright sensors, 50 mm high in layers of 25 µm; the memory is that of the process with all libraries."""
    pytest.importorskip("resource")
    child = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, env=os.environ, check=False)
    assert child.returncode == 0, child.stderr
    count, peak_mb, error = child.stdout.split()
    size_mb = Path("out/my-sensor-layers.zip").stat().st_size / 1e6
    print(f"{count} layers: at most {float(peak_mb):.0f} MB, a file of {size_mb:.0f} MB, volume error {error}")
    assert int(count) >= 2000
    assert float(peak_mb) < 500.0
    assert abs(float(error)) < 0.005
