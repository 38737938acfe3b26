"""Old Excel files (.xls): the same table as in other formats, and errors for other files or without xlrd."""

import sys
from pathlib import Path

import pytest

from solen.errors import DataError
from solen.recording import read
from tests.recording.old_excel import DATE, PERCENT, Cell, Shown, xls
from tests.recording.programs import FORCE, TIME, TRAVEL

ROWS: list[list[Cell]] = [["Exposure (mJ/cm²)", "thickness_um", "disc"], [20.0, 51.25, "a"], [40.0, 88.125, "b"]]


def saved(folder: Path, data: bytes) -> Path:
    path = folder / "table.data"  # the format is not in the name
    path.write_bytes(data)
    return path


def test_xls_is_same_table(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, xls({"notes": [["by hand"]], "data": ROWS})))
    assert recording.need("thickness").to("um").tolist() == [51.25, 88.125]
    assert recording.need("exposure").to("mJ/cm**2").tolist() == [20.0, 40.0]
    assert recording.label("disc") == ("a", "b")


def test_sheet_is_named_or_only_one(tmp_path: Path) -> None:
    path = saved(tmp_path, xls({"first": ROWS, "second": [["t_s"], [1.5]]}))
    with pytest.raises(DataError, match="2 sheets with numbers; choose one of first, second"):
        read(path)
    with pytest.raises(DataError, match="'third'; has no such sheet; its sheets are first, second"):
        read(path, sheet="third")
    assert read(path, sheet="second").need("time").values.tolist() == [1.5]


def test_stored_results_of_formulas_and_percentages(tmp_path: Path) -> None:
    results: list[Cell] = [Shown(2.5, formula=True), Shown(3.5, formula=True)]
    formulas: list[list[Cell]] = [["time_s", "force_N"], [1.0, results[0]], [2.0, results[1]]]
    assert read(saved(tmp_path, xls({"data": formulas}))).need("force").values.tolist() == [2.5, 3.5]
    with pytest.raises(DataError, match="cell B2 = '91 %'; is not a number"):
        read(saved(tmp_path, xls({"data": [["wavelength_nm", "T (%)"], [400.0, Shown(0.91, PERCENT)]]})))


def test_dates_are_strings(tmp_path: Path) -> None:
    day = Shown(46082.0, DATE)
    rows: list[list[Cell]] = [["date", "time_s", "force_N"], [day, 0.0, 0.0], [day, 1.0, 2.0]]
    recording = read(saved(tmp_path, xls({"data": rows})))
    assert set(recording.texts["date"]) == {"2026-03-01T00:00:00"}
    assert recording.need("force").values.tolist() == [0.0, 2.0]


def test_export_of_machine_in_xls(tmp_path: Path) -> None:
    names = ["Time (s)", "Load (N)", "Machine Extension (mm)"]
    recording = read(saved(tmp_path, xls({"Sheet1": [names, *zip(TIME, FORCE, TRAVEL, strict=True)]})))
    assert recording.provenance.format == "lloyd-nexygen"
    assert recording.need("crosshead").to("mm").tolist() == TRAVEL


def test_rejects_other_files_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    intact = xls({"data": ROWS})
    other = intact.replace("Workbook".encode("utf-16-le"), "Contents".encode("utf-16-le"))
    with pytest.raises(DataError, match="is not an Excel workbook"):
        read(saved(tmp_path, other))
    with pytest.raises(DataError, match="is a damaged workbook"):
        read(saved(tmp_path, intact[:700]))
    monkeypatch.setitem(sys.modules, "xlrd", None)
    with pytest.raises(DataError, match=r"requires xlrd.*pip install.*\.xlsx or CSV"):
        read(saved(tmp_path, intact))
