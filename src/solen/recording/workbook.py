"""Excel workbooks (.xlsx, and .xls with the extra ``xls``): the cells of a worksheet as rows of strings, as in a CSV.

A workbook gives the same table as its CSV. Numbers keep all digits. The value of a formula is the stored result; a file
with a formula without a stored result is rejected, because that cell is not empty. An archive that would unpack to more
than the size of a table is not unpacked.

Public name: `grid`.
"""

import io
import re
import warnings
import zipfile
from collections.abc import Callable, Sequence
from datetime import date, datetime, time
from typing import Any

from solen.errors import DataError
from solen.extras import need
from solen.recording.grid import Grid
from solen.recording.numbers import is_number
from solen.recording.source import Source

MAX_MB = 500
"""Largest total size of an unpacked workbook in MB."""
MAX_CELLS = 2_000_000
"""Largest number of cells in a worksheet."""


def grid(source: Source, sheet: str | None = None) -> Grid:
    """Return the rows of a worksheet, by default of the only one with numbers.

    Raise `DataError` if the file is not a workbook, or if several worksheets contain numbers and none is named.
    """
    if source.is_archive:
        _check_archive(source)
    sheets = _sheets(source, sheet, stored=True) if source.is_archive else _old_sheets(source, sheet)
    name = sheet or _only_sheet(source, sheets)
    cells = _grid_of(source, name, sheets[name])
    if source.is_archive and not all(map(all, cells.rows)):
        _check_formulas(source, name, cells)
    return cells


def _check_archive(source: Source) -> None:
    """Raise `DataError` for a zip archive that is not a workbook, or one that is too large or unsafe to unpack."""
    try:
        with zipfile.ZipFile(io.BytesIO(source.data)) as archive:
            members = archive.infolist()
            size = sum(member.file_size for member in members)
            names = {member.filename for member in members}
            if "xl/workbook.xml" not in names:
                raise source.error("", "is an archive, but not an Excel workbook", "save the table as .xlsx or CSV")
            if size > MAX_MB * 1_000_000:
                limit = f"unpacks to {size / 1e6:.0f} MB; at most {MAX_MB} MB are read"
                raise source.error("", limit, "save only the table, as CSV")
            for member in members:
                with archive.open(member) as part:
                    if re.search(rb"<!(?:DOCTYPE|ENTITY)", part.read(2048)):
                        raise source.error("", f"declares entities in {member.filename}", "save it again in Excel")
    except _errors():
        raise source.error("", "is a damaged archive", "save it again in Excel") from None


def _sheets(source: Source, requested: str | None, *, stored: bool) -> dict[str, list[list[str]]]:
    """Return the cells of the requested worksheet or, by default, of all worksheets, keyed by worksheet name.

    With ``stored``, the value of a formula is its stored result, otherwise its text.
    """
    import openpyxl

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they concern styles and validations, which are not used
            book = openpyxl.load_workbook(io.BytesIO(source.data), read_only=True, data_only=stored)
            _check_name(source, requested, [sheet.title for sheet in book.worksheets])
            rows = {
                sheet.title: _strings(source, sheet) for sheet in book.worksheets if requested in {None, sheet.title}
            }
            book.close()
    except _errors():
        raise source.error(
            "", "is damaged: it cannot be read as a workbook", "save it again in Excel, or as CSV"
        ) from None
    return rows


def _check_name(source: Source, requested: str | None, names: Sequence[str]) -> None:
    if requested is not None and requested not in names:
        raise source.error("", "has no such sheet", f"its sheets are {', '.join(names)}", requested)


def _old_sheets(source: Source, requested: str | None) -> dict[str, list[list[str]]]:
    """Return the cells of an .xls file, in which formula results are stored."""
    need("xlrd", what=str(source.path), doing="reading .xls", otherwise="save it as .xlsx or CSV", error=DataError)
    import xlrd

    try:
        book = xlrd.open_workbook(file_contents=source.data, formatting_info=True, logfile=io.StringIO())
        sheets = {sheet.name: [_old_row(book, sheet.row(n)) for n in range(sheet.nrows)] for sheet in book.sheets()}
    except Exception as bad:  # xlrd may raise any exception at a damaged file
        not_found = "find workbook" in str(bad)
        limit = "is not an Excel workbook but another program's binary format" if not_found else "is a damaged workbook"
        raise source.error("", limit, "save the table as .xlsx or CSV") from None
    _check_name(source, requested, list(sheets))
    return sheets if requested is None else {requested: sheets[requested]}


def _old_row(book: Any, cells: Sequence[Any]) -> list[str]:
    """Return the cells of an .xls file in the form in which `_text` returns those of an .xlsx file."""
    import xlrd

    converters: dict[int, Callable[[Any], Any]] = {
        xlrd.XL_CELL_EMPTY: lambda _: None,
        xlrd.XL_CELL_BLANK: lambda _: None,
        xlrd.XL_CELL_DATE: lambda value: xlrd.xldate_as_datetime(value, book.datemode),
        xlrd.XL_CELL_BOOLEAN: bool,
        xlrd.XL_CELL_ERROR: lambda value: xlrd.error_text_from_code.get(value, "#ERROR"),
    }
    formats = (book.format_map[book.xf_list[cell.xf_index].format_key].format_str for cell in cells)
    return [
        _text(converters.get(cell.ctype, lambda same: same)(cell.value), shown)
        for cell, shown in zip(cells, formats, strict=True)
    ]


def _strings(source: Source, sheet: Any) -> list[list[str]]:
    """Return the cells of a worksheet as a CSV would contain them."""
    sheet.reset_dimensions()  # the recorded dimensions may be wrong
    rows: list[list[str]] = []
    remaining = MAX_CELLS
    for row in sheet.iter_rows():
        remaining -= len(row) + 1
        if remaining < 0:
            limit = f"contains more than {MAX_CELLS} cells"
            raise source.error(f"sheet {sheet.title}", limit, "save only the table, as CSV")
        rows.append([_text(cell.value, getattr(cell, "number_format", "")) for cell in row])
    return rows


def _errors() -> tuple[type[Exception], ...]:
    """Return the exceptions that zipfile, openpyxl and their dependencies raise at a damaged workbook."""
    import zlib
    from xml.etree.ElementTree import ParseError

    from openpyxl.utils.exceptions import InvalidFileException

    return (
        *(InvalidFileException, ParseError, zipfile.BadZipFile, zlib.error, OSError, EOFError),
        *(KeyError, ValueError, TypeError, IndexError, AttributeError, OverflowError, RuntimeError, MemoryError),
    )


def _only_sheet(source: Source, sheets: dict[str, list[list[str]]]) -> str:
    """Return the name of the only worksheet that contains numbers."""
    numeric = [name for name, rows in sheets.items() if any(is_number(cell) for row in rows for cell in row)]
    if len(numeric) != 1:
        limit = f"has {len(numeric)} sheets with numbers" if numeric else "has no sheet with numbers"
        raise source.error("", limit, f"choose one of {', '.join(numeric or sheets)} as the sheet")
    return numeric[0]


def _grid_of(source: Source, name: str, texts: list[list[str]]) -> Grid:
    """Return the grid of a worksheet, with rows of equal length and without empty rows and columns at the end."""
    while texts and not any(texts[-1]):
        texts.pop()
    width = max((n + 1 for row in texts for n, cell in enumerate(row) if cell), default=0)
    if width * len(texts) > MAX_CELLS:
        limit = f"extends to row {len(texts)} and column {width}: more than {MAX_CELLS} cells"
        raise source.error(f"sheet {name}", limit, "save only the table, as CSV")
    padded = [(row + [""] * width)[:width] for row in texts]
    return Grid(source, padded, list(range(1, len(padded) + 1)), "", name)


def _check_formulas(source: Source, name: str, result: Grid) -> None:
    """Raise `DataError` at a formula whose result is not stored in the file."""
    formulas = _sheets(source, name, stored=False)[name]
    for row, cells in enumerate(formulas):
        for column, cell in enumerate(cells):
            inside = row < len(result.rows) and column < len(result.rows[row])
            if cell.startswith("=") and inside and not result.rows[row][column]:
                limit = "contains a formula whose result is not stored"
                raise result.error(row, column, limit, "open the workbook in Excel and save it there")


def _text(value: Any, shown: str) -> str:
    """Return a cell as a CSV would contain it, with all digits of a number.

    A number that Excel shows as a percentage is stored as a fraction, 0.91 for 91 %: the cell becomes a string with the
    percent sign, which no reader interprets as a number.
    """
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value)
    if isinstance(value, int | float):
        return f"{100.0 * value:.15g} %" if "%" in shown else repr(value)
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    return " ".join(str(value).split())
