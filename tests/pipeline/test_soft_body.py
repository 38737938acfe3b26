"""The commands for a soft body under load: printed lines, files, and refused input."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.cli import run_command
from tests.command_support import answered
from tests.report.test_html_page import Page

DESIGN = """
schema = 1
name = "clamped"
material = {index = 1.44}
emitter = {width_mm = 0.2, rays = 40}
mechanics = {modulus_MPa = 3.0, mesh_mm = 1.5}
[motion]
kind = "loaded"
drives = "clamp.angle_deg"
step_deg = 3.0
[[hold]]
name = "mount"
face = "receiver-*"
[[hold]]
name = "clamp"
face = "lens"
kind = "turning"
about = "stem-base"
"""


@pytest.fixture
def design(tmp_path: Path) -> Path:
    file = tmp_path / "soft.toml"
    file.write_text(DESIGN, encoding="utf-8")
    return file


def test_deform_prints_reactions(capfd: pytest.CaptureFixture[str], design: Path, tmp_path: Path) -> None:
    figure = tmp_path / "shape.svg"
    result = answered(capfd, "deform", str(design), "--at", "-3", "--figure", str(figure))
    assert (result["angle_deg"], result["turn_deg"]) == (-3.0, pytest.approx(-3.0))
    forces = {reaction["name"]: reaction["force_N"] for reaction in result["reactions"]}
    assert np.add(forces["mount"], forces["clamp"]) == pytest.approx([0.0, 0.0], abs=1e-9)
    drawing = figure.read_text(encoding="utf-8")
    assert "largest principal strain" in drawing
    assert "clamp.angle_deg" in drawing
    assert run_command(["deform", str(design), "--at", "-3"]) == 0
    output = capfd.readouterr().out
    assert "rotate by -3 deg and move by +0, +0 mm" in output
    assert "N mm about 0, 40.2" in output  # for a symmetric mount, x is a rounding error
    assert "e-1" not in output
    assert "outside the motion's range" not in output
    assert run_command(["deform", str(design), "--at", "4"]) == 0
    assert "clamp.angle_deg = 4 is outside the motion's range of -3 to 3 deg" in "".join(capfd.readouterr())


def test_run_writes_response_under_load(capfd: pytest.CaptureFixture[str], design: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "focus.svg").write_text("of an earlier design", encoding="utf-8")
    result = answered(capfd, "run", str(design), "--out", str(out))
    assert result["files"] == {"report": str(out / "report.html")}
    names = {path.name for path in out.iterdir()}
    figures = {"response.svg", "shape.svg", "rays.svg"}
    solid = {path.name for path in out.glob("*.stl")} | {path.name for path in out.glob("*.3mf")}
    assert len(solid) == 2
    assert names == {"report.html", "results.json", "results.csv"} | figures | solid
    with (out / "results.csv").open(encoding="utf-8") as file:
        assert next(file).startswith("# simulated")
        rows = list(csv.DictReader(file))
    assert [float(row["contrast"]) for row in rows] == result["contrast"]
    assert [float(row["rigid_contrast"]) for row in rows] == pytest.approx([0.895, 0.0, -0.895], abs=2e-3)
    assert "moment of the clamp (N mm)" in (out / "response.svg").read_text(encoding="utf-8")
    check_report(Page((out / "report.html").read_text(encoding="utf-8")), result)


def check_report(page: Page, result: dict[str, Any]) -> None:
    """Check that the report contains the results and the holds, and loads nothing."""
    assert page.texts["h1"] == ["clamped"]
    assert page.texts["h2"] == ["What to expect", "Response", "Shape", "Rays", "Assumptions"]
    assert page.tags["svg"] == page.tags["figcaption"] == 3
    assert max(page.ids.values()) == 1
    assert all(target.startswith(("#", "data:")) for tag, target in page.loads if tag != "a")
    assert [target.rpartition(".")[2] for tag, target in page.loads if tag == "a"] == ["stl", "3mf"]
    terms = dict(zip(page.texts["dt"], page.texts["dd"], strict=True))
    assert terms["Contrast"].startswith(f"{result['contrast'][0]:+.3f}"[:5])
    assert "clamp (lens, turning)" in terms["Holds"]
    assert "Fingers" not in terms
    for warning in result["warnings"]:
        assert any(warning[1:-1] in item for item in page.texts["li"])
    cells = page.texts["td"]
    for reaction in result["reactions"][-1]:
        first = cells.index(reaction["name"]) + 1
        values = [*reaction["force_N"], reaction["moment_Nmm"]]
        assert [float(text) for text in cells[first : first + 3]] == pytest.approx(values, abs=1e-3)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["deform", "{}", "--set", "motion.kind=rotation"], "motion.drives = 'clamp.angle_deg'; does not apply"),
        (["deform", "{}", "--at", "95"], "--at = 95.0; must be between"),
        (["deform", "{}", "--set", "hold[0].face=recievers"], "mount.face = 'recievers'; is not a face"),
        (["deform", "{}", "--set", "hold[4].face=lens"], "hold[4].face; the list has 2"),
        (["trace", "{}", "--angle-deg", "1"], "--angle-deg = 1.0; does not apply: the motion drives clamp.angle_deg"),
        (["run", "{}", "--set", "motion.drives=clamp.depth_mm", "--out", "{}.out"], "motion.drives = 'clamp.depth_mm'"),
    ],
)
def test_invalid_input_gives_one_line_and_no_file(
    capfd: pytest.CaptureFixture[str], design: Path, command: list[str], message: str
) -> None:
    before = set(design.parent.iterdir())
    assert run_command([part.replace("{}", str(design)) for part in command]) == 2
    err = capfd.readouterr().err
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert set(design.parent.iterdir()) == before
