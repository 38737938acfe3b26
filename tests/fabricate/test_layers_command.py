"""`solen print layers`, `solen print printers` and `solen export --layers` from the command line to the files."""

import json
import os
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
QUICK = ("--layer-um", "100", "--printer", "small.toml")


def small_printer() -> str:
    """The generic printer with fewer and larger pixels: 30 × 45 mm."""
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
    home = tmp_path / "a folder of one's own"
    home.mkdir()
    (home / "my sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    (home / "small.toml").write_text(small_printer(), encoding="utf-8")
    trimesh.creation.box((10.0, 10.0, 2.0)).export(home / "box.stl")
    monkeypatch.chdir(home)
    return home


@pytest.fixture
def told(capfd: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: str) -> dict[str, Any]:
        return answered(capfd, *arguments)

    return run


@pytest.fixture
def refused(folder: Path, capfd: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: str) -> str:
        return refusal(capfd, folder, *arguments)

    return run


def images(path: str) -> list[Any]:
    stack = read_zip(path)
    return [stack.layer(index).image for index in range(stack.count)]


def test_a_design_becomes_layers_stl_and_settings(told: Run) -> None:
    found = told("print", "layers", "my sensor.toml", "--out", "out", *QUICK, "--figure", "f.svg", "--resin", "noa61")
    names = {kind: Path(path).name for kind, path in found["files"].items()}
    assert names == {
        "layers": "my-sensor-layers.zip",
        "placed": "my-sensor-placed.stl",
        "sheet": "my-sensor-settings.md",
        "settings": "my-sensor-settings.json",
        "figure": "f.svg",
    }
    assert {path.name for path in Path("out").iterdir()} == set(names.values()) - {"f.svg"}
    stack = images(found["files"]["layers"])
    assert len(stack) == found["layers"] == 40
    assert stack[0].shape == (450, 300)
    volume = sum(image.sum(dtype=int) for image in stack) / 255 * 0.1**2 * 0.1
    assert found["stack_volume_mm3"] == pytest.approx(volume, rel=1e-12)
    assert abs(found["volume_error"]) < 1e-4
    assert found["settings"]["material"].startswith("NOA")
    assert found["sources"][0]["file"] == "my sensor.toml"
    assert any("are estimates" in line for line in found["warnings"])
    assert any("13 mW/cm²" in line for line in found["warnings"])
    assert Path("f.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_without_anti_aliasing_no_pixel_is_grey(told: Run) -> None:
    found = told("print", "layers", "my sensor.toml", "--out", "out", *QUICK, "--no-anti-aliasing")
    assert set(np.unique(images(found["files"]["layers"])[0])) == {0, 255}
    with zipfile.ZipFile(found["files"]["layers"]) as opened:
        assert json.loads(opened.read("job.json"))["anti_aliasing"] is False


def test_the_sheet_says_what_to_type_in(told: Run) -> None:
    options = ("--copies", "2", "--z-offset-um", "600", "--irradiance-mW-per-cm2", "12", "--orientation", "upright")
    found = told("print", "layers", "my sensor.toml", "--out", "out", "--sheet-only", "--gap-mm", "3", *options)
    assert found["stack_volume_mm3"] is None
    assert "layers" not in found["files"]
    sheet = Path(found["files"]["sheet"]).read_text(encoding="utf-8")
    for words in (
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
        assert words in sheet
    settings = json.loads(Path(found["files"]["settings"]).read_text(encoding="utf-8"))
    assert settings["expected_layers"] == 1616
    assert settings["estimated_time_s"] == 6 * 3 + 1610 * 2 + 1616 * 6
    assert not any("13 mW/cm²" in line for line in found["warnings"])
    placed = trimesh.load_mesh(found["files"]["placed"])
    assert placed.is_watertight
    assert placed.bounds == pytest.approx(np.array([(0, 0, 0), (11.806, 4.0, 40.412)]), abs=1e-3)


def test_the_placed_stl_gives_the_same_layers_again(told: Run) -> None:
    """Round by way of the STL, which is flat as it stands: no more than a grey value or two of 32-bit rounding."""
    first = told("print", "layers", "my sensor.toml", "--out", "a", *QUICK, "--orientation", "on-edge")
    second = told("print", "layers", first["files"]["placed"], "--out", "b", *QUICK)
    one, other = (images(found["files"]["layers"]) for found in (first, second))
    assert max(int(np.abs(a.astype(int) - b).max()) for a, b in zip(one, other, strict=True)) <= 2
    assert second["sources"][0]["format"] == "stl"
    assert second["settings"]["material"] == "not named: give --resin"


def test_a_cure_depth_from_a_resin_of_ones_own(told: Run) -> None:
    text = 'schema = 1\nname = "thin"\n[cure]\nDp_um = 50\nEc_mJ_per_cm2 = 20\nwavelength_nm = 405\n'
    text += 'warnings = ["one disc"]\n'
    Path("thin.toml").write_text(text, encoding="utf-8")
    found = told("print", "layers", "my sensor.toml", "--out", "out", "--sheet-only", "--resin", "thin.toml")
    assert found["settings"]["cure_depth_um"] == pytest.approx(50 * np.log(26 / 20))
    assert "cure: one disc" in found["warnings"]
    assert found["settings"]["burn_in_cure_depth_um"] == pytest.approx(50 * np.log(39 / 20))
    assert any("cures 13 µm, while a layer is 25 µm thick" in line for line in found["warnings"])
    assert any("405 nm, while the printer uses 385 nm" in line for line in found["warnings"])


def test_export_writes_layers_beside_the_solid(told: Run) -> None:
    found = told("export", "my sensor.toml", "--out", "out", "--stl", "--layers", *QUICK, "--pockets")
    assert set(found["files"]) == {"stl", "layers", "placed", "sheet", "settings"}
    assert found["layers"]["layers"] == 40
    assert abs(found["layers"]["volume_error"]) < 0.005
    assert len(list(Path("out").iterdir())) == 5
    assert "| Pockets and slots | pocket-right, pocket-left |" in Path(found["files"]["sheet"]).read_text("utf-8")
    alone = told("export", "my sensor.toml", "--out", "other", "--layers", *QUICK)
    assert set(alone["files"]) == {"layers", "placed", "sheet", "settings"}
    assert len(list(Path("other").iterdir())) == 4
    assert "| Pockets and slots | none |" in Path(alone["files"]["sheet"]).read_text("utf-8")


def test_two_runs_give_the_same_files(told: Run, folder: Path) -> None:
    for out in ("a", "b"):
        told("print", "layers", "box.stl", "--out", out, *QUICK)
    assert snapshot(folder / "a") == snapshot(folder / "b")


def test_lines_for_a_reader(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command(["print", "layers", "box.stl", "--out", "out", *QUICK]) == 0
    assert "volume_error" in capfd.readouterr().out
    assert run_command(["export", "my sensor.toml", "--out", "out", "--layers", *QUICK]) == 0
    assert "my-sensor-layers.zip" in capfd.readouterr().out
    assert run_command(["print", "printers"]) == 0
    assert "asiga-ultra-32" in capfd.readouterr().out
    assert run_command(["print", "printers", "generic"]) == 0
    assert "pitch_um: typical 50 (estimate: chosen)" in capfd.readouterr().out


def test_printers_as_json(told: Run) -> None:
    rows = {row["printer"]: row for row in told("print", "printers")["printers"]}
    assert rows["generic"]["size_mm"] == [96.0, 54.0, 100.0]
    assert told("print", "printers", "asiga-max-x27")["file"]["pitch_um"]["basis"] == "estimate"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ["--printer", "asiga-max-x27"],
            "x 40.41 x 4 mm'; Asiga MAX X27 builds 51.84 x 29.16 x 75 mm; rotate",
        ),
        (["--printer", "asiga-max-x72"], "did you mean asiga-max-x27?"),
        (["--printer", "none.toml"], "no such file"),
        (["--layer-um", "5"], "makes layers of 10 to 200 µm"),
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
        (["--figure", "f.svg", "--sheet-only"], "draws layers"),
    ],
)
def test_a_bad_value_is_one_line(refused: Run, arguments: list[str], line: str) -> None:
    assert line in refused("print", "layers", "my sensor.toml", "--out", "out", *arguments)


def test_bad_files_are_one_line(refused: Run, folder: Path) -> None:
    data = (folder / "box.stl").read_bytes()
    (folder / "cut.stl").write_bytes(data[:-20])
    (folder / "open.stl").write_bytes(data[:80] + (11).to_bytes(4, "little") + data[84:-50])
    (folder / "mesh.obj").write_text("v 0 0 0", encoding="utf-8")
    assert "is truncated" in refused("print", "layers", "cut.stl", "--out", "out")
    assert "open.stl = '3 open edges'; must be watertight" in refused("print", "layers", "open.stl", "--out", "out")
    assert "must be a design (.toml) or a mesh (.stl, .3mf)" in refused("print", "layers", "mesh.obj", "--out", "out")
    assert "no such file" in refused("print", "layers", "none.stl", "--out", "out")
    assert "--set" in refused("print", "layers", "box.stl", "--out", "out", "--set", "body.thickness_mm=1")
    assert "without --layers" in refused("export", "my sensor.toml", "--out", "out", "--copies", "2")


def test_a_mesh_that_is_inside_out_is_turned_and_one_in_metres_is_reported(told: Run, folder: Path) -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.05))
    trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False).export(folder / "inverted.stl")
    found = told("print", "layers", "inverted.stl", "--out", "out")
    assert found["volume_error"] == pytest.approx(0.0, abs=1e-6)
    assert any("inside out" in line for line in found["warnings"])
    assert any("an STL contains no unit and is read as mm" in line for line in found["warnings"])


def test_level_faces_between_layers_are_reported(told: Run) -> None:
    """Pockets from 1.325 to 2.675 mm are whole layers of 25 µm; of 50 µm, both faces lie in the middle of one."""
    arguments = ("print", "layers", "my sensor.toml", "--out", "out", "--sheet-only", "--set", "fabricate.pockets=true")
    assert not any("horizontal faces" in line for line in told(*arguments)["warnings"])
    line = "2 horizontal faces are within a layer (the first at 1.325 mm) and move by up to 25.0 µm"
    assert line in told(*arguments, "--layer-um", "50")["warnings"]
    first = told(*arguments[:-1], "fabricate.pockets=true")["files"]["placed"]
    assert line in told("print", "layers", first, "--out", "again", "--sheet-only", "--layer-um", "50")["warnings"]


def test_whoever_is_interrupted_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = snapshot(folder)
    calls = []

    def interrupted(image: Any, pitches_mm: tuple[float, float]) -> bytes:
        calls.append(image)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return as_png(image, pitches_mm)

    monkeypatch.setattr(archive, "as_png", interrupted)
    assert run_command(["print", "layers", "my sensor.toml", "--out", "out", *QUICK, "--orientation", "upright"]) == 130
    assert len(calls) == 3
    assert snapshot(folder) == before


JOB = """
import resource, sys, time
from pathlib import Path
from solen.pipeline.print.layers import layers
from solen.fabricate.layers import Slicing
begun = time.perf_counter()
how = Slicing(printer="asiga-ultra-32", orientation="upright", copies=12)
found = layers(Path("my sensor.toml"), out=Path("out"), slicing=how, set_=["body.stem_length_mm=25.9"])
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6
print(found.result.layers, peak, time.perf_counter() - begun, found.result.volume_error)
"""


@pytest.mark.evidence
def test_two_thousand_layers_of_3840_by_2160_stay_under_500_mb() -> None:
    """Twelve sensors upright, 50 mm high at 25 µm: the whole process, all its libraries included."""
    pytest.importorskip("resource")
    done = subprocess.run([sys.executable, "-c", JOB], capture_output=True, text=True, env=os.environ, check=False)
    assert done.returncode == 0, done.stderr
    count, peak_mb, seconds, error = done.stdout.split()
    size_mb = Path("out/my-sensor-layers.zip").stat().st_size / 1e6
    print(
        f"{count} layers: at most {float(peak_mb):.0f} MB, {float(seconds):.0f} s, a file of {size_mb:.0f} MB, {error}"
    )
    assert int(count) >= 2000
    assert float(peak_mb) < 500.0
    assert abs(float(error)) < 0.005
