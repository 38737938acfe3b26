"""`solen resin spectra`: one JSON object or lines, one line and exit code 2 for a bad file, a figure on request."""

import json
from pathlib import Path
from typing import Any

import pytest

from solen.cli import run_command
from tests.recording.exports import cary, tensile

TRACES = [("film 1", "%T", 0), ("film 2", "%T", 3), ("film 1", "Abs", 0)]


@pytest.fixture
def export(tmp_path: Path) -> Path:
    path = tmp_path / "spectra.csv"
    path.write_bytes(cary(TRACES).encode())
    return path


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    code = run_command(["resin", "spectra", *map(str, arguments)])
    printed = capsys.readouterr()
    assert (code, printed.err) == (0, "")
    return printed.out


def as_json(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(told(capsys, *arguments, "--json"))
    return found


def test_every_trace_with_its_kind_and_reach(export: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = as_json(capsys, export)
    keys = ("name", "quantity", "unit", "points", "range_nm")
    assert [tuple(one[key] for key in keys) for one in found["traces"]] == [
        ("film 1", "transmittance", "%", 40, [705.0, 900.0]),
        ("film 2", "transmittance", "%", 37, [720.0, 900.0]),
        ("film 1 (2)", "absorbance", "1", 40, [705.0, 900.0]),
    ]
    assert found["format"] == "agilent-cary-csv"
    assert found["sources"][0]["instrument"] == "Cary 5000"
    assert len(found["warnings"]) == 1
    assert "film 2: the scan contains 900 to 720 nm" in found["warnings"][0]
    lines = told(capsys, export)
    assert all(one["name"] in lines for one in found["traces"])
    assert found["warnings"][0] in lines


def test_traces_are_chosen_by_name(export: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = as_json(capsys, export, "--trace", "film 1")
    assert [one["name"] for one in found["traces"]] == ["film 1"]
    assert found["warnings"] == []
    assert run_command(["resin", "spectra", str(export), "--trace", "film 3"]) == 2
    assert "trace film 3; not in spectra.csv; did you mean film 2?" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_a_figure_has_a_panel_for_each_kind(export: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    figure = export.with_name(f"drawn{suffix}")
    found = as_json(capsys, export, "--figure", figure)
    assert found["files"] == {"figure": str(figure)}
    first = figure.read_bytes()
    as_json(capsys, export, "--figure", figure)
    assert figure.read_bytes() == first
    if suffix == ".svg":
        text = first.decode("utf-8")
        assert all(words in text for words in ("transmittance (%)", "absorbance", "film 1 (2)", "wavelength (nm)"))


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (cary(TRACES).replace("91.", "9l.", 1), "line 3, column 4 = '9l.37'"),
        (tensile(), "holds no spectrum"),
        ("wavelength,T\n0.4,0.9\n0.5,0.9\n", "unit of wavelength = 'none'"),
        ("x,y\n1,2\n", "holds no spectrum; name the wavelength column wavelength_nm"),
        ("wavelength_nm\n400\n", "holds no spectrum; add a column of values"),
    ],
)
def test_what_cannot_be_read_is_one_line(
    tmp_path: Path, content: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "file.csv"
    path.write_bytes(content.encode("cp1252"))
    assert run_command(["resin", "spectra", str(path), "--figure", str(tmp_path / "f.svg")]) == 2
    printed = capsys.readouterr()
    assert line in printed.err
    assert len(printed.err.splitlines()) == 1
    assert printed.out == ""
    assert not (tmp_path / "f.svg").exists()


def test_a_trace_without_numbers_has_no_reach(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "file.csv"
    path.write_text("wavelength_nm,T (%),sample (au)\n400,,0.1\n500,,0.2\n", encoding="utf-8")
    first, second = as_json(capsys, path)["traces"]
    assert (first["range_values"], first["empty"], first["points"]) == (None, 2, 2)
    assert (second["quantity"], second["unit"]) == (None, None)
