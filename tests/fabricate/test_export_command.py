"""`solen export` from its command line to its files, and what it refuses: one line, code 2, nothing left behind."""

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
BOW: Sides = [("wall", [0, 0], [4, 4]), ("wall", [4, 4], [4, 0]), ("wall", [4, 0], [0, 4]), ("wall", [0, 4], [0, 0])]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    home = tmp_path / "a folder of one's own"
    home.mkdir()
    (home / "my sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    monkeypatch.chdir(home)
    return home


Run = Callable[..., Any]


@pytest.fixture
def told(capfd: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: str) -> dict[str, Any]:
        return answered(capfd, "export", *arguments)

    return run


@pytest.fixture
def refused(folder: Path, capfd: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: str) -> str:
        return refusal(capfd, folder, "export", *arguments)

    return run


def outline(sides: Sides, last: float = 0.0) -> str:
    """Design file of an outline, whose last corner may be moved so that it is open."""
    faces = [{"name": name, "curve": {"kind": "segment", "a": a, "b": b}} for name, a, b in sides]
    faces[-1]["curve"]["b"] = [sides[-1][2][0], sides[-1][2][1] + last]  # type: ignore[index]
    data = {"solen_outline": 1, "faces": faces, "emitters": [{"point": [2, -1]}]}
    Path("own.json").write_text(json.dumps(data), encoding="utf-8")
    text = 'schema = 1\nname = "own"\n[material]\nindex = 1.5\n[body]\nkind = "outline"\nfile = "own.json"\n'
    Path("own.toml").write_text(text, encoding="utf-8")
    return "own.toml"


def test_all_formats_and_the_figure_at_once(told: Run) -> None:
    found = told("my sensor.toml", "--out", "out", *ALL, "--pockets", "--slots", "--figure", "solid.png")
    assert found["name"] == "Paper 860 nm"
    assert set(found["files"]) == {option.removeprefix("--") for option in ALL} | {"figure"}
    for path in found["files"].values():
        assert Path(path).stat().st_size > 1000
    assert Path(found["files"]["comsol"]).name == "my-sensor-comsol.txt"
    assert {path.name for path in Path("out").iterdir()} == {Path(path).name for path in found["files"].values()} - {
        "solid.png"
    }
    assert [seat["name"] for seat in found["seats"]] == [
        *("pocket-right", "pocket-left", "slot-right", "slot-left", "slot-emitter")
    ]
    assert found["volume_mm3"] == pytest.approx(852.4369, abs=1e-3)
    mesh = found["mesh"]
    assert abs(mesh["volume_mm3"] - found["volume_mm3"]) <= mesh["volume_bound_mm3"]
    assert mesh["tolerance_mm"] == 1e-3
    assert any("the drawings" in line for line in found["warnings"])
    assert any("ignores pockets" in line for line in found["warnings"])


def test_without_a_format_it_is_what_printers_take(told: Run) -> None:
    found = told("my sensor.toml", "--out", "out")
    assert set(found["files"]) == {"stl", "3mf"}
    assert found["warnings"] == []
    assert found["pieces"] == 1
    assert found["faces"][0] == "lens"
    assert len(found["sha256"]) == 64


def test_drawings_alone_need_no_mesh(told: Run) -> None:
    assert told("my sensor.toml", "--out", "out", "--svg")["mesh"] is None


def test_a_thickness_and_a_tolerance_of_ones_own(told: Run) -> None:
    thick = told("my sensor.toml", "--out", "out", "--thickness-mm", "2.5", "--tolerance-mm", "0.01")
    usual = told("my sensor.toml", "--out", "out")
    assert thick["volume_mm3"] == pytest.approx(2.5 * usual["area_mm2"], rel=1e-12)
    assert thick["mesh"]["triangles"] < usual["mesh"]["triangles"]
    assert thick["sha256"] != usual["sha256"]
    assert thick["area_mm2"] == usual["area_mm2"]


def test_what_stands_in_the_air_is_reported(told: Run) -> None:
    found = told("my sensor.toml", "--out", "out", "--svg", "--set", "receivers.coupling=air-gap", *GAP)
    assert any("are separate objects in air" in line for line in found["warnings"])


GAP = ("--set", "receivers.gap_mm=0.5")


def test_several_pieces_are_reported(told: Run) -> None:
    sides = [*SQUARE, *((f"far {name}", [a[0] + 9, a[1]], [b[0] + 9, b[1]]) for name, a, b in SQUARE)]
    found = told(outline(sides), "--out", "out", *ALL)
    assert found["pieces"] == 2
    assert any("separate parts" in line for line in found["warnings"])
    assert found["volume_mm3"] == pytest.approx(2 * 16 * 4.0, rel=1e-12)


def test_lines_for_a_reader(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["export", "my sensor.toml", "--out", "out", "--stl", "--pockets", "--figure", "a.svg"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Paper 860 nm"
    assert any(line.startswith("stl: ") and line.endswith("my-sensor.stl") for line in lines)
    assert any("triangles within 0.001 mm" in line for line in lines)
    assert any("pocket-left takes 2.41 mm3" in line for line in lines)
    assert "figure: a.svg" in lines


def test_files_are_replaced_and_others_stay(told: Run) -> None:
    told("my sensor.toml", "--out", "out", "--stl", "--svg")
    Path("out/notes.txt").write_text("mine", encoding="utf-8")
    before = Path("out/my-sensor.stl").read_bytes()
    told("my sensor.toml", "--out", "out", "--stl", "--thickness-mm", "1")
    assert Path("out/my-sensor.stl").read_bytes() != before
    assert {path.name for path in Path("out").iterdir()} == {"my-sensor.stl", "my-sensor.svg", "notes.txt"}


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--thickness-mm", "0"], "body.thickness_mm = 0; must be at least 1e-06"),
        (["--thickness-mm", "-1"], "body.thickness_mm = -1; must be at least 1e-06"),
        (["--thickness-mm", "nan"], "body.thickness_mm = nan"),
        (["--thickness-mm", "thick"], "body.thickness_mm = 'thick'"),
        (["--tolerance-mm", "0"], "--tolerance-mm = 0.0; must be from 0.0001 to 1 mm"),
        (["--tolerance-mm", "nan"], "--tolerance-mm = nan; must be from 0.0001 to 1 mm"),
        (["--set", "body.arm_width_mm=7"], "body.arm_width_mm = 7.0; must be below"),
        (["--set", "lens.half_width_mm=4"], "lens.half_width_mm"),
        (["--set", "fabricate.pocket=true"], "did you mean fabricate.pockets?"),
        (["--pockets", "--set", "body.arm_width_mm=1.5"], "pocket-right; would remove"),
        (["--figure", "solid.jpg"], "a figure must end in .svg, .pdf"),
        (["--stl", "--svg", "--figure", "out/my-sensor.svg"], "is also another output of this command"),
    ],
)
def test_a_bad_value_is_one_line(refused: Run, arguments: list[str], line: str) -> None:
    assert line in refused("my sensor.toml", "--out", "out", *arguments)


def test_an_open_outline_is_one_line(refused: Run) -> None:
    line = refused(outline(SQUARE, last=0.3), "--out", "out", *ALL)
    assert "body outline; is open at the end of wall" in line
    assert "0.3 mm from the end of" in line


def test_an_outline_that_crosses_itself_is_one_line(refused: Run) -> None:
    assert "body outline; intersects itself at x = 2, z = 2 mm" in refused(outline(BOW), "--out", "out", *ALL)


def test_a_missing_design_and_no_folder_to_write_to(refused: Run, folder: Path) -> None:
    assert "no such file" in refused("other.toml", "--out", "out")
    assert "out" in refused("my sensor.toml")
    (folder / "taken").write_text("a file", encoding="utf-8")
    assert "cannot be written" in refused("my sensor.toml", "--out", "taken")
    assert "cannot be written" in refused("my sensor.toml", "--out", "taken/below")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_to_is_one_line(refused: Run, folder: Path) -> None:
    closed = folder / "closed"
    closed.mkdir(mode=0o500)
    assert "cannot be written" in refused("my sensor.toml", "--out", "closed")


def test_a_folder_in_the_way_of_a_file_is_one_line(refused: Run, folder: Path) -> None:
    (folder / "out" / "my-sensor.stl").mkdir(parents=True)
    assert "not an ordinary file" in refused("my sensor.toml", "--out", "out")


@pytest.mark.parametrize(("option", "module"), [("--step", "OCP"), ("--dxf", "ezdxf")])
def test_a_missing_extra_is_one_line(refused: Run, monkeypatch: pytest.MonkeyPatch, option: str, module: str) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    line = refused("my sensor.toml", "--out", "out", "--stl", option)
    assert line.startswith(f"solen: {option}; ")
    assert line.endswith(f"not installed; {PACKAGES[module].command}\n")
