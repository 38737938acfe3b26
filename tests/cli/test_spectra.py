"""`solen resin spectra`: JSON, lines and figure; one line and exit code 2 for a bad file."""

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


def printed_by(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    code = run_command(["resin", "spectra", *map(str, arguments)])
    printed = capsys.readouterr()
    assert (code, printed.err) == (0, "")
    return printed.out


def as_json(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    result: dict[str, Any] = json.loads(printed_by(capsys, *arguments, "--json"))
    return result


def test_lists_traces_with_quantity_and_range(export: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = as_json(capsys, export)
    keys = ("name", "quantity", "unit", "points", "range_nm")
    assert [tuple(trace[key] for key in keys) for trace in result["traces"]] == [
        ("film 1", "transmittance", "%", 40, [705.0, 900.0]),
        ("film 2", "transmittance", "%", 37, [720.0, 900.0]),
        ("film 1 (2)", "absorbance", "1", 40, [705.0, 900.0]),
    ]
    assert result["format"] == "agilent-cary-csv"
    assert result["sources"][0]["instrument"] == "Cary 5000"
    assert len(result["warnings"]) == 1
    assert "film 2: the scan covers 900 to 720 nm" in result["warnings"][0]
    lines = printed_by(capsys, export)
    assert all(trace["name"] in lines for trace in result["traces"])
    assert result["warnings"][0] in lines


def test_selects_traces_by_name(export: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = as_json(capsys, export, "--trace", "film 1")
    assert [trace["name"] for trace in result["traces"]] == ["film 1"]
    assert result["warnings"] == []
    assert run_command(["resin", "spectra", str(export), "--trace", "film 3"]) == 2
    assert "trace film 3; is not in spectra.csv; did you mean film 2?" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_figure_has_panel_for_each_quantity(export: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    figure = export.with_name(f"drawn{suffix}")
    result = as_json(capsys, export, "--figure", figure)
    assert result["files"] == {"figure": str(figure)}
    first = figure.read_bytes()
    as_json(capsys, export, "--figure", figure)
    assert figure.read_bytes() == first
    if suffix == ".svg":
        text = first.decode("utf-8")
        assert all(label in text for label in ("transmittance (%)", "absorbance", "film 1 (2)", "wavelength (nm)"))


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (cary(TRACES).replace("91.", "9l.", 1), "line 3, column 4 = '9l.37'"),
        (tensile(), "contains no spectrum"),
        ("wavelength,T\n0.4,0.9\n0.5,0.9\n", "unit of wavelength = 'none'"),
        ("x,y\n1,2\n", "contains no spectrum; name the wavelength column wavelength_nm"),
        ("wavelength_nm\n400\n", "contains no spectrum; add a column of values"),
    ],
)
def test_refuses_unreadable_file_in_one_line(
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


def test_trace_without_values_has_no_range(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "file.csv"
    path.write_text("wavelength_nm,T (%),sample (au)\n400,,0.1\n500,,0.2\n", encoding="utf-8")
    first, second = as_json(capsys, path)["traces"]
    assert (first["range_values"], first["empty"], first["points"]) == (None, 2, 2)
    assert (second["quantity"], second["unit"]) == (None, None)
