"""Exports from Agilent Cary spectrophotometers (WinUV), as written by the program or saved again from Excel.

An export begins with two header lines: the trace names in every second cell and, below each name, ``Wavelength
(nm),%T``. In the rows that follow, each trace has a wavelength and a value until it ends; then come an empty line and
the program's log of each trace. Traces have separate wavelengths and may share a name; none is dropped or merged. A
scan has uniform wavelength steps, so a scan with a jump, a repetition or a gap is rejected as damaged.

`is_cary` recognises the header; `read` reads a `Grid`.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.recording import carylog, scan
from solen.recording.grid import Grid
from solen.recording.model import Channel, Provenance, Recording
from solen.recording.numbers import is_missing, is_number
from solen.recording.table import unique

MODES = {
    "%t": ("transmittance", "%"),
    "%r": ("reflectance", "%"),
    "%a": ("absorptance", "%"),
    "abs": ("absorbance", "1"),
}
"""Quantity and unit of the modes that the program writes above the values; those of other modes are unknown."""
_MAX_ABS = 10.0
_LIMITS = {"%": 1e4, "1": 12.0}
"""Limits that readings of a spectrophotometer do not exceed, unless a decimal point was lost."""


@dataclass(frozen=True)
class _Trace:
    """Columns of a trace and the rows in which they contain numbers."""

    name: str
    mode: str
    column: int
    rows: list[int]


def is_cary(grid: Grid) -> int | None:
    """Return the row of the trace names if a grid begins like a Cary export, otherwise None.

    Raise `DataError` if the header is for several traces but not preceded by their names.
    """
    filled = [row for row in range(min(len(grid.rows), 8)) if not grid.is_blank(row)]
    for index, row in enumerate(filled):
        traces = _pairs(grid.rows[row][: grid.width(row)])
        if traces and index == 1 and not any(grid.rows[filled[0]][1::2]):
            return filled[0]
        if traces > 1:
            if index == 1:
                return filled[0]
            limit = "is a header for several traces, " + (
                "but the line above lacks their names"
                if index == 0
                else "but the line above contains more than their names"
            )
            raise grid.error(row, None, limit, "restore the first line, with each trace name above its Wavelength (nm)")
    return None


def read(grid: Grid, start: int) -> Recording:
    """Read an export; raise `DataError` with the line and column of damaged content.

    ``start`` is the row of the trace names, as returned by `is_cary`.
    """
    headings = _headings(grid, start)
    body, after = _split_log(grid, start + 2, len(headings))
    traces = _traces(grid, headings, body)
    mark = grid.mark(body, {column: grid.cells(column, body) for column in range(2 * len(headings))})
    pairs = [(_numbers(grid, trace, 0, mark), _numbers(grid, trace, 1, mark)) for trace in traces]
    for trace, (waves, values) in zip(traces, pairs, strict=True):
        _check(grid, trace, waves, values)
    scan.check_digits(grid, [(trace.column + 1, trace.rows) for trace in traces])
    scan.check_common_wavelengths(
        grid, [(trace.column, trace.rows, waves) for trace, (waves, _) in zip(traces, pairs, strict=True)]
    )
    logs = carylog.read([grid.rows[row] for row in after], [name for name, _ in headings], grid.separator)
    return _recording(grid, traces, pairs, logs, grid.truncation_note(body))


def _pairs(cells: list[str]) -> int:
    """Return the number of traces in a row of ``Wavelength (nm)`` and modes; 0 if most cells are something else."""
    pairs = list(zip(cells[::2], cells[1::2], strict=False))
    known = sum(_is_wave(wave) and mode.casefold() in MODES for wave, mode in pairs)
    plausible = sum(_is_wave(wave) and _is_mode(mode) for wave, mode in pairs)
    return len(pairs) if 2 * plausible >= len(pairs) and (known or len(pairs) == 1) else 0


def _is_wave(cell: str) -> bool:
    return cell.casefold().replace(" ", "") in {"wavelength(nm)", "wavelengthnm", "wavelength", "wellenlänge(nm)"}


def _is_mode(cell: str) -> bool:
    return bool(cell) and not is_number(cell) and not _is_wave(cell)


def _headings(grid: Grid, start: int) -> list[tuple[str, str]]:
    """Return the name and mode of each trace."""
    names, modes = grid.rows[start], grid.rows[start + 1]
    count = grid.width(start + 1)
    if count % 2:
        raise grid.error(start + 1, count - 1, "has no column of values")
    for column in range(max(count, grid.width(start))):
        name = names[column] if column < len(names) else ""
        below = modes[column] if column < count else ""
        if column % 2 and name:
            raise grid.error(start, column, "is above values; names belong above the wavelengths")
        if column % 2 == 0 and not name:
            raise grid.error(start, column if column < len(names) else None, "the name of a trace is missing")
        if not (_is_mode(below) if column % 2 else _is_wave(below)):
            expected = "%T, %R, Abs or another mode" if column % 2 else "Wavelength (nm)"
            raise grid.error(start + 1, column if column < len(modes) else None, f"should be {expected}")
    return [(names[column], modes[column + 1]) for column in range(0, count, 2)]


def _split_log(grid: Grid, first: int, traces: int) -> tuple[list[int], list[int]]:
    """Return the rows with numbers and the rows of the log after them."""
    end = next((row for row in range(first, len(grid.rows)) if grid.is_blank(row)), len(grid.rows))
    body, after = list(range(first, end)), list(range(end, len(grid.rows)))
    if not body:
        raise grid.source.error(grid.address(first - 1), "no numbers follow the header", "export it again")
    for row in after:
        if len(grid.rows[row]) > 1 and all(map(is_number, grid.rows[row][:2])):
            raise grid.error(
                row, None, f"contains numbers after the empty line {grid.lines[end]}", "join the two parts"
            )
    comments = [line for line, _ in grid.comments if grid.lines[body[0]] < line <= grid.lines[body[-1]]]
    if comments:
        raise grid.source.error(f"line {comments[0]}", "begins with # within the numbers", "restore it")
    _check_lengths(grid, body, 2 * traces)
    return body, after


def _check_lengths(grid: Grid, body: list[int], columns: int) -> None:
    """Raise `DataError` at a row with missing or surplus cells.

    All rows have the same number of cells: usually one more than there are columns, and that last cell is empty. Excel
    omits the separators at the end of rows once the last traces have ended; later rows are then shorter.
    """
    usual = Counter(len(grid.rows[row]) for row in body).most_common(1)[0][0]
    usual = max(usual, columns)
    for row in body:
        cells = grid.rows[row]
        if grid.width(row) > columns:
            raise grid.error(row, columns, f"is outside the {columns} columns of the header")
        if len(cells) > usual:
            raise grid.error(row, None, f"has {len(cells)} cells where other lines have {usual}")
    short = [n for n, row in enumerate(body) if len(grid.rows[row]) < usual]
    lengths = [len(grid.rows[row]) for row in body]
    if short and (lengths != sorted(lengths, reverse=True) or len(body) - short[0] < 2 or lengths[-1] % 2):
        row = body[short[0]]
        limit = f"has {len(grid.rows[row])} cells where other lines have {usual}: the line is incomplete"
        raise grid.error(row, None, limit)


def _traces(grid: Grid, headings: list[tuple[str, str]], body: list[int]) -> list[_Trace]:
    """Return the traces with the rows in which they contain numbers."""
    names = unique([name for name, _ in headings])
    widths = {row: grid.width(row) for row in body}
    traces = []
    for n, (name, (_, mode)) in enumerate(zip(names, headings, strict=True)):
        column = 2 * n
        rows = [row for row in body if column < widths[row] and any(grid.rows[row][column : column + 2])]
        if rows and rows != body[: len(rows)]:
            gap = next(row for row, filled in zip(body, rows, strict=False) if row != filled)
            limit = "is empty, but the trace continues below"
            raise grid.error(gap, column, limit, "restore the wavelength; only a value may be empty")
        for row in rows:
            if is_missing(grid.rows[row][column]):
                raise grid.error(row, column, "is empty, but the next cell contains a value")
        traces.append(_Trace(name, mode, column, rows))
    return traces


def _numbers(grid: Grid, trace: _Trace, offset: int, mark: str) -> FloatArray:
    """Return the wavelengths of a trace if ``offset`` is 0, or its values if ``offset`` is 1."""
    column = trace.column + offset
    return grid.column(column, trace.rows, grid.cells(column, trace.rows), mark, machine=True)


def _check(grid: Grid, trace: _Trace, waves: FloatArray, values: FloatArray) -> None:
    """Raise `DataError` if an instrument cannot have recorded the numbers in a trace."""
    scan.check_wavelengths(grid, trace.column, trace.rows, waves)
    unit = MODES.get(trace.mode.casefold(), ("", ""))[1]
    limit = _LIMITS.get(unit)
    above = np.flatnonzero(np.abs(values) > limit) if limit else np.array([], dtype=int)
    if above.size:
        row = trace.rows[int(above[0])]
        raise grid.error(row, trace.column + 1, f"exceeds {limit:g}, the limit of {trace.mode}")
    scan.check_outliers(grid, trace.column + 1, trace.rows, values)


def _recording(
    grid: Grid, traces: list[_Trace], pairs: list[tuple[FloatArray, FloatArray]], logs: carylog.Logs, truncation: str
) -> Recording:
    """Return the recording of traces, each with a wavelength channel; identical wavelength channels are merged."""
    axes: dict[bytes, Channel] = {}
    names = {trace.name for trace in traces}
    channels: list[Channel] = []
    for trace, (waves, values), log in zip(traces, pairs, logs.of_traces, strict=True):
        new = Channel(_axis_name(len(axes), names), "wavelength", "nm", waves)
        axis = axes.setdefault(waves.tobytes(), new)
        quantity, unit = MODES.get(trace.mode.casefold(), ("", ""))
        notes = _notes(trace, waves, values, quantity, logs.shared | log)
        channel = Channel(trace.name, quantity, unit, values, axis.name, metadata=log)
        channels.append(channel.noted(*notes, truncation if trace is traces[-1] else ""))
    provenance = Provenance(
        grid.source.name, grid.source.sha256, "agilent-cary-csv", logs.instrument, logs.date, logs.shared
    )
    return Recording((*axes.values(), *channels), provenance)


def _axis_name(number: int, names: set[str]) -> str:
    name = "wavelength" if number == 0 else f"wavelength ({number + 1})"
    return name if name not in names else f"{name} axis"


def _notes(trace: _Trace, waves: FloatArray, values: FloatArray, quantity: str, log: dict[str, str]) -> list[str]:
    """Return the notes on a trace."""
    notes = []
    if not quantity:
        notes.append(f"the quantity and unit of the mode {trace.mode} are unknown")
    if not waves.size:
        return ["the trace contains no points", *notes]
    missing = int(np.sum(np.isnan(values)))
    if missing:
        notes.append(f"{missing} of {values.size} values are empty")
    if quantity == "absorbance" and (saturated := int(np.sum(values >= _MAX_ABS))):
        notes.append(
            f"{saturated} values are at the instrument's limit, Abs = {_MAX_ABS:g}: no light was left to measure"
        )
    if quantity in {"transmittance", "reflectance"} and (negative := int(np.sum(values < 0.0))):
        notes.append(
            f"{negative} values are negative, down to {np.nanmin(values):.3g} %: noise or stray light about zero"
        )
    outliers = scan.outlier_note(values, [f"at {wave:g} nm" for wave in waves.tolist()])
    return [*notes, outliers, *carylog.range_notes(log, waves)]
