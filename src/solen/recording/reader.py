"""Read a file written by an instrument or a person; the format is detected from the content, never from the name.

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
    layout,
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
from solen.recording.model import Recording
from solen.recording.source import Source, load

_HEAD = 200  # rows that contain a program's header


@dataclass(frozen=True)
class Format:
    """Functions that recognise and read files in a format by content; each returns None for other files.

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
    if not any(testxpert.mentioned(cell) for cells in grid.rows[:_HEAD] for cell in cells):
        return None
    place = layout.find(grid)
    program = testxpert.program(grid, place)
    return testxpert.read(grid, place, program) if program else None


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
"""Formats by name; formats from other packages are tried first, and a file in an unknown format is read as a table."""


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
    named = next(filter(None, (one.from_arrays(source, columns) for one in formats)), None)
    if named is not None:
        _check_arrays(source, sheet, None)
        return [("", named)]
    arrays = next(filter(None, (one.from_bytes(source) for one in formats)), None)
    if arrays is not None:
        _check_arrays(source, sheet, columns)
        return [("", arrays)]
    quick = read_large(source, columns) if sheet is None else None
    if quick is not None:
        return [("", quick)]
    if source.is_archive or source.is_old_workbook:
        grid = workbook.grid(source, sheet)
    else:
        if sheet is not None:
            raise source.refused("", "is not a workbook and has no worksheets", "omit the sheet", sheet)
        grid = of_text(source)
    several = specimens.specimens(grid) if columns is None else []
    if several:
        return [(one.name, _of_table(one.grid, one.place)) for one in several]
    known = (one.from_cells(grid) for one in formats) if columns is None else ()
    found = next(filter(None, known), None)
    return [("", found if found is not None else table.read(grid, layout.find(grid, columns)))]


def _of_table(grid: Grid, place: layout.Layout) -> Recording:
    return testxpert.read(grid, place, testxpert.program(grid, place) or "test-machine")


def _check_arrays(source: Source, sheet: str | None, columns: Sequence[str] | None) -> None:
    """Raise `DataError` if table options are given for a file of arrays."""
    if sheet is not None or columns is not None:
        raise source.refused("", "has named columns and no worksheets", "omit sheet and columns")


def read_parts(
    path: Path | str, *, sheet: str | None = None, columns: Sequence[str] | None = None
) -> Iterator[tuple[str, Recording]]:
    """Return the recordings in a file with their names.

    An HDF5 file contains a recording for each group with a time, and an export from a test machine one for each
    specimen.

    The name is empty if the file is a single recording.
    """
    large = hdf5.stored(Path(path))
    names = hdf5.groups(large) if large is not None else ()
    if large is None:
        yield from _parts(load(Path(path)), sheet, columns)
        return
    if not names:
        yield "", read(path, sheet=sheet, columns=columns)
        return
    _check_arrays(large, sheet, columns)
    for name in names:
        yield name, hdf5.read(large, name)
