"""Files that are too large, unusual or malicious: rejected in one line, in a time proportional to their size."""

import io
import zipfile
from pathlib import Path

import openpyxl
import pytest

from solen.errors import DataError
from solen.recording import read
from solen.recording.source import MAX_MB
from tests.recording.mutate import damaged
from tests.recording.test_table import ROWS, workbook

TABLE = "# comment: a\nRate;5\n\nwavelength_nm;T (%);sample\nnm;%;\n400;91,5;A\n410;91,7;\n420;;B\n\nby hand\n"


@pytest.mark.parametrize("kind", ["table", "workbook"])
def test_damaged_file_gives_numbers_or_one_line(tmp_path: Path, kind: str) -> None:
    intact = TABLE.encode() if kind == "table" else workbook(tmp_path, {"data": ROWS}).read_bytes()
    path = tmp_path / "file"
    rejected = 0
    for seed in range(150):
        path.write_bytes(damaged(seed, intact)[0])
        try:
            read(path)
        except DataError as bad:
            rejected += 1
            text = str(bad)
            assert "\n" not in text
    assert rejected > 30


def test_rejects_too_large_file(tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    with path.open("wb") as file:
        file.truncate(MAX_MB * 1_000_000 + 1)
    with pytest.raises(DataError, match=f"limit is {MAX_MB} MB"):
        read(path)


def archive(parts: dict[str, bytes]) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as file:
        for name, part in parts.items():
            file.writestr(name, part)
    return data.getvalue()


def test_rejects_other_or_too_large_archives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solen.recording.workbook.MAX_MB", 4)
    path = tmp_path / "book.xlsx"
    path.write_bytes(archive({"xl/workbook.xml": b"<workbook/>", "xl/worksheets/sheet1.xml": bytes(5_000_000)}))
    assert path.stat().st_size < 10_000
    with pytest.raises(DataError, match="unpacks to 5 MB; at most 4 MB"):
        read(path)
    path.write_bytes(archive({"content.xml": b"<office/>"}))
    with pytest.raises(DataError, match="is an archive, but not an Excel workbook"):
        read(path)
    entities = b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bbbb">]><workbook>&b;</workbook>'
    path.write_bytes(archive({"xl/workbook.xml": entities}))
    with pytest.raises(DataError, match=r"declares entities in xl/workbook\.xml"):
        read(path)


def test_rejects_distant_single_cell(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.worksheets[0]["A1"] = "t_s"
    book.worksheets[0].cell(20_000, 16_000, 1.0)
    path = tmp_path / "book.xlsx"
    book.save(path)
    with pytest.raises(DataError, match="extends to row 20000 and column 16000"):
        read(path)


LONG = 200_000


@pytest.mark.parametrize(
    "text",
    [
        "(" * LONG + "\n1\n",
        "a(" * LONG + "\n1\n",
        "%" * LONG + "\n1\n",
        "a_" * LONG + "\n1\n",
        "a," * LONG + "\n" + "1," * LONG + "\n",
        '"' * LONG + "\n1\n",
        '"a' * LONG,
        "9" * LONG + ",T\n" + "9" * LONG + ",1\n",
        "wavelength_nm,T\n" + "9" * LONG + ",1\n",
        "a,b\n1\n" * 30_000,
        "a,b\n\n" * 30_000 + "1,2\n",
        " " * LONG + "\n1\n",
        "\n" * LONG,
        "#" * LONG,
        "film,\nWavelength (nm),%T\n400,1\n\nfilm,\n" + "<" + "> " * LONG + "\n" + "a  " * LONG + "\n",
    ],
    ids=range(15),
)
def test_long_or_many_lines_give_result_or_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "file.csv"
    path.write_text(text, encoding="utf-8", newline="")
    try:
        read(path)
    except DataError as bad:
        assert len(str(bad)) < 2000  # noqa: PT017
