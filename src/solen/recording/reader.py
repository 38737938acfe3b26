"""Read a file that an instrument or a person wrote: its format is told by what it holds, never by its name.

The interface: `read`.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from solen.recording import cary, hdf5, layout, matlab, table, tdms, testxpert, workbook
from solen.recording.bulk import bulk
from solen.recording.grid import of_text
from solen.recording.model import Recording
from solen.recording.source import Source, load

_BINARY: tuple[tuple[Callable[[Source], bool], Callable[[Source], Recording]], ...] = (
    (matlab.is_matlab, matlab.read),
    (tdms.is_tdms, tdms.read),
    (hdf5.is_hdf5, hdf5.read),
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
    source = load(Path(path))
    reader = next((read for told, read in _BINARY if told(source)), None)
    if reader is not None:
        if sheet is not None or columns is not None:
            raise source.refused("", "names its own columns and has no sheets", "leave out sheet and columns")
        return reader(source)
    large = bulk(source, columns) if sheet is None else None
    if large is not None:
        return large
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
