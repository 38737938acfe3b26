"""Read a file that an instrument or a person wrote: its format is told by what it holds, never by its name.

The interface: `read`, and `read_parts` for files that hold several recordings.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from solen.recording import cary, hdf5, layout, matlab, table, tdms, testxpert, workbook
from solen.recording.bulk import bulk
from solen.recording.grid import of_text
from solen.recording.model import Recording
from solen.recording.source import Source, load

_BINARY: tuple[tuple[Callable[[Source], bool], Callable[[Source], Recording]], ...] = (
    (matlab.is_matlab, matlab.read),
    (tdms.is_tdms, tdms.read),
    (hdf5.is_netcdf3, hdf5.read_netcdf3),
)


def read(path: Path | str, *, sheet: str | None = None, columns: Sequence[str] | None = None) -> Recording:
    """Recording of a file.

    Parameters
    ----------
    path
        A Cary or testXpert export, a table as CSV, TSV or with semicolons or spaces, an Excel workbook of one, or
        arrays: MATLAB, TDMS, HDF5 and netCDF.
    sheet
        Name of the workbook's sheet; without it, the only one that holds numbers.
    columns
        Names of the columns, with units, of a table without a header: ``("stress_MPa", "stretch")``.

    Returns
    -------
    Recording
        Numbers as the file states them. A cell that is empty is NaN.

    Raises
    ------
    DataError
        With the line and the column, where anything in the table is not what it should be.
    """
    large = hdf5.stored(Path(path))
    if large is not None:
        _check_arrays(large, sheet, columns)
        return hdf5.read(large)
    source = load(Path(path))
    reader = next((read for told, read in _BINARY if told(source)), None)
    if reader is not None:
        _check_arrays(source, sheet, columns)
        return reader(source)
    quick = bulk(source, columns) if sheet is None else None
    if quick is not None:
        return quick
    if source.is_archive:
        grid = workbook.grid(source, sheet)
    else:
        if sheet is not None:
            raise source.refused("", "is no workbook, so it has no sheets", "leave out the sheet", sheet)
        grid = of_text(source)
    if columns is None:
        start = cary.is_cary(grid)
        if start is not None:
            return cary.read(grid, start)
    place = layout.find(grid, columns)
    return testxpert.read(grid, place) if testxpert.is_testxpert(place) else table.read(grid, place)


def _check_arrays(source: Source, sheet: str | None, columns: Sequence[str] | None) -> None:
    """`DataError` where a file of arrays is asked for as a table."""
    if sheet is not None or columns is not None:
        raise source.refused("", "names its own columns and has no sheets", "leave out sheet and columns")


def read_parts(
    path: Path | str, *, sheet: str | None = None, columns: Sequence[str] | None = None
) -> Iterator[tuple[str, Recording]]:
    """Recordings of a file with their names, one after the other: of an HDF5 file one for each group that has a time.

    The name is empty where the file is one recording.
    """
    large = hdf5.stored(Path(path))
    names = hdf5.groups(large) if large is not None else ()
    if large is None or not names:
        yield "", read(path, sheet=sheet, columns=columns)
        return
    _check_arrays(large, sheet, columns)
    for name in names:
        yield name, hdf5.read(large, name)
