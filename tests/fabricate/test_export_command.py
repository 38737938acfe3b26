"""`solen export`: files, printed lines and errors."""

import importlib.util
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from solen.cli import run_command
from solen.extras import PACKAGES
from solen.spec import template
from tests.command_support import answered, refusal

HAS_KERNEL = importlib.util.find_spec("OCP") is not None
HAS_DXF = importlib.util.find_spec("ezdxf") is not None
ALL = ["--stl", "--3mf", "--glb", "--comsol", "--svg"]
ALL += (["--step"] if HAS_KERNEL else []) + (["--dxf"] if HAS_DXF else [])
Sides = list[tuple[str, list[float], list[float]]]
SQUARE: Sides = [
    ("wall", [0, 0], [4, 0]),
    ("receiver", [4, 0], [4, 4]),
    ("wall", [4, 4], [0, 4]),
    ("wall", [0, 4], [0, 0]),
]
CROSSING: Sides = [
    ("wall", [0, 0], [4, 4]),
    ("wall", [4, 4], [4, 0]),
    ("wall", [4, 0], [0, 4]),
    ("wall", [0, 4], [0, 0]),
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "a folder's name"
    folder.mkdir()
    (folder / "my sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    monkeypatch.chdir(folder)
    return folder


Run = Callable[..., Any]


@pytest.fixture
def export(capfd: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: str) -> dict[str, Any]:
        return answered(capfd, "export", *arguments)

    return run


@pytest.fixture
def export_error(folder: Path, capfd: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: str) -> str:
        return refusal(capfd, folder, "export", *arguments)

    return run


def outline(sides: Sides, gap: float = 0.0) -> str:
    """Return the design file of an outline, with a gap before the end of the last side."""
    name, start, end = sides[-1]
    sides = [*sides[:-1], (name, start, [end[0], end[1] + gap])]
    faces = [{"name": name, "curve": {"kind": "segment", "a": a, "b": b}} for name, a, b in sides]
    data = {"solen_outline": 1, "faces": faces, "emitters": [{"point": [2, -1]}]}
    Path("outline.json").write_text(json.dumps(data), encoding="utf-8")
    text = 'schema = 1\nname = "outline"\n[material]\nindex = 1.5\n[body]\nkind = "outline"\nfile = "outline.json"\n'
    Path("outline.toml").write_text(text, encoding="utf-8")
    return "outline.toml"


def test_writes_all_formats_and_a_figure(export: Run) -> None:
    result = export("my sensor.toml", "--out", "out", *ALL, "--pockets", "--slots", "--figure", "solid.png")
    assert result["name"] == "Paper 860 nm"
    assert set(result["files"]) == {option.removeprefix("--") for option in ALL} | {"figure"}
    for path in result["files"].values():
        assert Path(path).stat().st_size > 1000
    assert Path(result["files"]["comsol"]).name == "my-sensor-comsol.txt"
    names = {Path(path).name for path in result["files"].values()} - {"solid.png"}
    assert {path.name for path in Path("out").iterdir()} == names
    assert [seat["name"] for seat in result["seats"]] == [
        *("pocket-right", "pocket-left", "slot-right", "slot-left", "slot-emitter")
    ]
    assert result["volume_mm3"] == pytest.approx(852.4369, abs=1e-3)
    mesh = result["mesh"]
    assert abs(mesh["volume_mm3"] - result["volume_mm3"]) <= mesh["volume_bound_mm3"]
    assert mesh["tolerance_mm"] == 1e-3
    assert any("the drawings" in line for line in result["warnings"])
    assert any("ignores pockets" in line for line in result["warnings"])


def test_default_formats_are_stl_and_3mf(export: Run) -> None:
    result = export("my sensor.toml", "--out", "out")
    assert set(result["files"]) == {"stl", "3mf"}
    assert result["warnings"] == []
    assert result["pieces"] == 1
    assert result["faces"][0] == "lens"
    assert len(result["sha256"]) == 64


def test_drawings_do_not_need_a_mesh(export: Run) -> None:
    assert export("my sensor.toml", "--out", "out", "--svg")["mesh"] is None


def test_thickness_and_tolerance(export: Run) -> None:
    thick = export("my sensor.toml", "--out", "out", "--thickness-mm", "2.5", "--tolerance-mm", "0.01")
    default = export("my sensor.toml", "--out", "out")
    assert thick["volume_mm3"] == pytest.approx(2.5 * default["area_mm2"], rel=1e-12)
    assert thick["mesh"]["triangles"] < default["mesh"]["triangles"]
    assert thick["sha256"] != default["sha256"]
    assert thick["area_mm2"] == default["area_mm2"]


def test_warns_of_receivers_in_air(export: Run) -> None:
    gap = ("--set", "receivers.coupling=air-gap", "--set", "receivers.gap_mm=0.5")
    result = export("my sensor.toml", "--out", "out", "--svg", *gap)
    assert any("separate objects in air" in line for line in result["warnings"])


def test_warns_of_separate_parts(export: Run) -> None:
    sides = [*SQUARE, *((f"far {name}", [a[0] + 9, a[1]], [b[0] + 9, b[1]]) for name, a, b in SQUARE)]
    result = export(outline(sides), "--out", "out", *ALL)
    assert result["pieces"] == 2
    assert any("separate parts" in line for line in result["warnings"])
    assert result["volume_mm3"] == pytest.approx(2 * 16 * 4.0, rel=1e-12)


def test_printed_lines(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["export", "my sensor.toml", "--out", "out", "--stl", "--pockets", "--figure", "a.svg"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Paper 860 nm"
    assert any(line.startswith("stl: ") and line.endswith("my-sensor.stl") for line in lines)
    assert any("triangles within 0.001 mm" in line for line in lines)
    assert any("pocket-left" in line and "2.41 mm3" in line for line in lines)
    assert "figure: a.svg" in lines


def test_replaces_its_files_and_keeps_others(export: Run) -> None:
    export("my sensor.toml", "--out", "out", "--stl", "--svg")
    Path("out/notes.txt").write_text("mine", encoding="utf-8")
    before = Path("out/my-sensor.stl").read_bytes()
    export("my sensor.toml", "--out", "out", "--stl", "--thickness-mm", "1")
    assert Path("out/my-sensor.stl").read_bytes() != before
    assert {path.name for path in Path("out").iterdir()} == {"my-sensor.stl", "my-sensor.svg", "notes.txt"}


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--thickness-mm", "0"], "body.thickness_mm = 0; must be at least 1e-06"),
        (["--thickness-mm", "-1"], "body.thickness_mm = -1; must be at least 1e-06"),
        (["--thickness-mm", "nan"], "body.thickness_mm = nan"),
        (["--thickness-mm", "thick"], "body.thickness_mm = 'thick'"),
        (["--tolerance-mm", "0"], "--tolerance-mm = 0.0; must be 0.0001 to 1 mm"),
        (["--tolerance-mm", "nan"], "--tolerance-mm = nan; must be 0.0001 to 1 mm"),
        (["--set", "body.arm_width_mm=7"], "body.arm_width_mm = 7.0; must be below"),
        (["--set", "lens.half_width_mm=4"], "lens.half_width_mm"),
        (["--set", "fabricate.pocket=true"], "did you mean fabricate.pockets?"),
        (["--pockets", "--set", "body.arm_width_mm=1.5"], "pocket-right; extends beyond the part"),
        (["--figure", "solid.jpg"], "a figure must end in .svg, .pdf"),
        (["--stl", "--svg", "--figure", "out/my-sensor.svg"], "is also another output of this command"),
    ],
)
def test_refuses_invalid_values(export_error: Run, arguments: list[str], line: str) -> None:
    assert line in export_error("my sensor.toml", "--out", "out", *arguments)


def test_refuses_an_open_outline(export_error: Run) -> None:
    line = export_error(outline(SQUARE, gap=0.3), "--out", "out", *ALL)
    assert "body outline; is open at the end of wall" in line
    assert "0.3 mm" in line


def test_refuses_an_outline_that_intersects_itself(export_error: Run) -> None:
    line = export_error(outline(CROSSING), "--out", "out", *ALL)
    assert "body outline; intersects itself at x = 2, z = 2 mm" in line


def test_refuses_a_missing_design_and_an_unusable_folder(export_error: Run, folder: Path) -> None:
    assert "no such file" in export_error("other.toml", "--out", "out")
    assert "out" in export_error("my sensor.toml")
    (folder / "taken").write_text("a file", encoding="utf-8")
    assert "cannot be written" in export_error("my sensor.toml", "--out", "taken")
    assert "cannot be written" in export_error("my sensor.toml", "--out", "taken/below")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root can write to any folder")
def test_refuses_a_folder_without_write_permission(export_error: Run, folder: Path) -> None:
    closed = folder / "closed"
    closed.mkdir(mode=0o500)
    assert "cannot be written" in export_error("my sensor.toml", "--out", "closed")


def test_refuses_to_replace_a_folder(export_error: Run, folder: Path) -> None:
    (folder / "out" / "my-sensor.stl").mkdir(parents=True)
    assert "not an ordinary file" in export_error("my sensor.toml", "--out", "out")


@pytest.mark.parametrize(("option", "module"), [("--step", "OCP"), ("--dxf", "ezdxf")])
def test_names_a_missing_extra(export_error: Run, monkeypatch: pytest.MonkeyPatch, option: str, module: str) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    line = export_error("my sensor.toml", "--out", "out", "--stl", option)
    assert line.startswith(f"solen: {option}; ")
    assert line.endswith(f"not installed; {PACKAGES[module].command}\n")
