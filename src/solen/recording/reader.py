"""Readers of files by instruments and people; the format is detected from the content, never from the name.

Public names: `read` and `read_parts`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from solen import registry
from solen.errors import DataError
from solen.recording import (
    cary,
    hdf5,
    jcamp,
    lvm,
    matlab,
    spc,
    specimens,
    spectrometer_text,
    table,
    tdms,
    testxpert,
    workbook,
)
from solen.recording.grid import Grid, of_text
from solen.recording.large_table import read_large
from solen.recording.layout import Layout, find_layout
from solen.recording.model import Recording
from solen.recording.source import Source, load

_HEADER_ROWS = 200  # number of rows searched for a program's header


@dataclass(frozen=True)
class Format:
    """Functions that read files in a format, recognised by content; each returns None for a file in another format.

    Attributes
    ----------
    from_bytes
        Reads the bytes of the file; tried before any table format.
    from_arrays
        Reads a file of arrays; the user may name the columns.
    from_cells
        Reads the cells of a text file or worksheet.
    """

    from_bytes: Callable[[Source], Recording | None] = lambda _: None
    from_arrays: Callable[[Source, Sequence[str] | None], Recording | None] = lambda _, __: None
    from_cells: Callable[[Grid], Recording | None] = lambda _: None


def _cary(grid: Grid) -> Recording | None:
    start = cary.is_cary(grid)
    return None if start is None else cary.read(grid, start)


def _test(grid: Grid) -> Recording | None:
    if not any(testxpert.is_characteristic(cell) for cells in grid.rows[:_HEADER_ROWS] for cell in cells):
        return None
    layout = find_layout(grid)
    program = testxpert.program(grid, layout)
    return testxpert.read(grid, layout, program) if program else None


FORMATS = registry.Registry(
    registry.FORMATS,
    {
        "matlab": Format(from_arrays=lambda s, names: matlab.read(s, names) if matlab.is_matlab(s) else None),
        "jcamp-dx": Format(from_bytes=lambda source: jcamp.read(source) if jcamp.is_jcamp(source) else None),
        "spc": Format(from_bytes=lambda source: spc.read(source) if spc.is_spc(source) else None),
        "spectrometer-text": Format(from_bytes=spectrometer_text.read),
        "lvm": Format(from_bytes=lambda source: lvm.read(source) if lvm.is_lvm(source) else None),
        "tdms": Format(from_bytes=lambda source: tdms.read(source) if tdms.is_tdms(source) else None),
        "netcdf3": Format(from_bytes=lambda source: hdf5.read_netcdf3(source) if hdf5.is_netcdf3(source) else None),
        "cary": Format(from_cells=_cary),
        "testxpert": Format(from_cells=_test),
    },
    Format,
)
"""Formats, keyed by name; those of other packages are tried first, and an unknown format is read as a table."""


def read(path: Path | str, *, sheet: str | None = None, columns: Sequence[str] | None = None) -> Recording:
    """Read a file.

    Parameters
    ----------
    path
        A Cary or testXpert export, a table (CSV, TSV, or separated by semicolons or spaces), an Excel workbook with a
        table, or arrays: MATLAB, TDMS, HDF5 and netCDF.
    sheet
        Worksheet name; default: the only worksheet that contains numbers.
    columns
        Column names, with units, for a table without a header: ``("stress_MPa", "stretch")``.

    Returns
    -------
    Recording
        Numbers as written in the file. An empty cell is NaN.

    Raises
    ------
    DataError
        With the line and column of any error in the table.
    """
    large = hdf5.stored(Path(path))
    if large is not None:
        _check_arrays(large, sheet, columns)
        return hdf5.read(large)
    parts = _parts(load(Path(path)), sheet, columns)
    if len(parts) > 1:
        limit = f"contains {len(parts)} specimens: {', '.join([name for name, _ in parts][:6])}"
        raise DataError(
            str(path), limit=limit, remedy="export each specimen separately; solen resin stiffness reads all of them"
        )
    return parts[0][1]


def _parts(source: Source, sheet: str | None, columns: Sequence[str] | None) -> list[tuple[str, Recording]]:
    """Return the recordings in a file, named by specimen if there are several."""
    formats = (*FORMATS.added().values(), *FORMATS.own.values())
    recording = next(filter(None, (known.from_arrays(source, columns) for known in formats)), None)
    if recording is not None:
        _check_arrays(source, sheet, None)
        return [("", recording)]
    recording = next(filter(None, (known.from_bytes(source) for known in formats)), None)
    if recording is not None:
        _check_arrays(source, sheet, columns)
        return [("", recording)]
    recording = read_large(source, columns) if sheet is None else None
    if recording is not None:
        return [("", recording)]
    return _tables(_grid(source, sheet), formats, columns)


def _grid(source: Source, sheet: str | None) -> Grid:
    """Return the cells of a text file or worksheet."""
    if source.is_archive or source.is_old_workbook:
        return workbook.grid(source, sheet)
    if sheet is not None:
        raise source.error("", "is not a workbook and has no worksheets", "do not specify a sheet", sheet)
    return of_text(source)


def _tables(grid: Grid, formats: Sequence[Format], columns: Sequence[str] | None) -> list[tuple[str, Recording]]:
    """Return the recordings in cells; a table of unknown format is read as a plain table."""
    if columns is not None:
        return [("", table.read(grid, find_layout(grid, columns)))]
    if parts := specimens.specimens(grid):
        return [(specimen.name, _of_table(specimen.grid, specimen.layout)) for specimen in parts]
    recording = next(filter(None, (known.from_cells(grid) for known in formats)), None)
    return [("", recording if recording is not None else table.read(grid, find_layout(grid)))]


def _of_table(grid: Grid, layout: Layout) -> Recording:
    return testxpert.read(grid, layout, testxpert.program(grid, layout) or "test-machine")


def _check_arrays(source: Source, sheet: str | None, columns: Sequence[str] | None) -> None:
    """Raise `DataError` if options for tables are specified for a file of arrays."""
    if sheet is not None or columns is not None:
        raise source.error("", "has named columns and no worksheets", "specify neither a sheet nor columns")


def read_parts(
    path: Path | str, *, sheet: str | None = None, columns: Sequence[str] | None = None
) -> Iterator[tuple[str, Recording]]:
    """Yield the name and the recording of each part of a file.

    The parts of an HDF5 file are its groups with a time, those of an export from a test machine its specimens. The name
    is empty if the file is a single recording.
    """
    stored = hdf5.stored(Path(path))
    names = hdf5.groups(stored) if stored is not None else ()
    if stored is None:
        yield from _parts(load(Path(path)), sheet, columns)
        return
    if not names:
        yield "", read(path, sheet=sheet, columns=columns)
        return
    _check_arrays(stored, sheet, columns)
    for name in names:
        yield name, hdf5.read(stored, name)
