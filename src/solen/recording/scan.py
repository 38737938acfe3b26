"""Damage visible in the numbers of a scan: wavelength jumps, isolated values, surplus digits.

A monochromator moves in one direction in equal steps. A step that differs from equal steps before and after it is
damaged; so is a row in which the wavelength differs from that of all other traces.

Public names: `check_wavelengths`, `check_alike`, `check_wild`, `check_digits`, `disorder` and `alone_note`.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray, IndexArray
from solen.recording.grid import Grid
from solen.recording.numbers import digits

RANGE_NM = (100.0, 100_000.0)
"""Wavelength limits in nm: no laboratory monochromator or interferometer works outside them."""
_EVEN = 0.05  # relative tolerance of uniform steps: drives are not exact, and printed numbers are rounded
_JUMP = 0.15  # relative deviation from the uniform steps next to it at which a step is wrong
_WILD = 100.0  # ratio of a value to its neighbours that marks damage
_ABOUT = 10  # rows before and after a value that show the usual size
_SOME = 5  # least count that makes a form usual
_FEW = 0.1  # largest fraction of wavelengths that may differ from those of other traces because of damage


def check_wavelengths(grid: Grid, column: int, rows: Sequence[int], waves: FloatArray) -> None:
    """Raise `DataError` at the first wavelength that cannot belong to a scan."""
    outside = np.flatnonzero((waves < RANGE_NM[0]) | (waves > RANGE_NM[1]) | np.isnan(waves))
    if outside.size:
        limit = f"no wavelength in nm is outside {RANGE_NM[0]:g} to {RANGE_NM[1]:g}"
        raise grid.refused(rows[int(outside[0])], column, limit)
    steps = np.diff(waves)
    if not steps.size:
        return
    forward = np.sum(steps > 0.0) > np.sum(steps < 0.0)
    wrong = np.flatnonzero(steps <= 0.0 if forward else steps >= 0.0)
    if wrong.size:
        before = waves[int(wrong[0])]
        sense = "increasing" if forward else "decreasing"
        limit = f"follows {before:g} in a scan with {sense} wavelengths: a wavelength repeats or jumps"
        raise grid.refused(rows[int(wrong[0]) + 1], column, limit)
    odd = uneven(np.abs(steps))
    if odd is not None:
        usual = abs(float(np.median(steps[max(odd - 3, 0) : odd + 4])))
        limit = (
            f"is {abs(steps[odd]):g} nm from the previous wavelength, but steps are {usual:g}: "
            "a digit or a line is damaged"
        )
        remedy = "restore the line; a value may be empty, but its line may not be omitted"
        raise grid.refused(rows[odd + 1], column, limit, remedy)


def disorder(waves: FloatArray) -> str:
    """Return a note on wavelengths that are monotonic except in a few places.

    The note is empty if all are monotonic or if the column is no scan.
    """
    steps = np.diff(waves)
    ways = [np.flatnonzero(~(steps > 0.0)), np.flatnonzero(~(steps < 0.0))]
    wrong = min(ways, key=len)
    if not 0 < wrong.size <= _FEW * steps.size + 1 or steps.size < 4:
        return ""
    where = ", ".join(f"{waves[n + 1]:g} after {waves[n]:g}" for n in wrong[:3])
    return f"{wrong.size} wavelengths are out of order ({where}): rows were moved or repeated, or a digit is damaged"


def uneven(steps: FloatArray) -> int | None:
    """Return the first non-uniform step among uniform ones, or None; the first and the last step may be shorter.

    A step is compared with the two steps before it and the two after. A single wrong point causes two wrong steps,
    which may therefore be adjacent. At the ends a step is compared with three steps on one side.
    """
    count = steps.size
    if count < 4:
        return None
    middle = _windowed(steps, 1) if count >= 5 else np.array([], dtype=int)
    pair = _windowed(steps, 2) if count >= 6 else np.array([], dtype=int)
    ends = [
        end
        for end, beside in ((0, steps[1:4]), (count - 1, steps[-4:-1]))
        if _even(beside) and steps[end] > (1.0 + _JUMP) * beside[0]
    ]
    found = [*middle.tolist(), *pair.tolist(), *ends]
    return int(min(found)) if found else None


def check_alike(grid: Grid, traces: Sequence[tuple[int, Sequence[int], FloatArray]]) -> None:
    """Raise `DataError` at a wavelength that differs from that of most traces while all other rows agree.

    Each trace is given by its wavelength column, its rows and its wavelengths.
    """
    held = [trace for trace in traces if trace[2].size > 2]
    if len(held) < 3:
        return
    longest = max(waves.size for _, _, waves in held)
    table = np.full((len(held), longest), np.nan)
    for line, (_, _, waves) in zip(table, held, strict=True):
        line[: waves.size] = waves
    usual = np.nanmedian(table, axis=0)
    off = np.abs(table - usual) > _JUMP * float(np.median(np.abs(np.diff(usual))))
    for (column, rows, waves), other in zip(held, off, strict=True):
        places = np.flatnonzero(other)
        if 0 < places.size <= max(1.0, _FEW * waves.size):
            place = int(places[0])
            limit = f"differs from the {usual[place]:g} nm of other traces, which are the same elsewhere"
            raise grid.refused(rows[place], column, limit)


def check_wild(grid: Grid, column: int, rows: Sequence[int], values: FloatArray) -> None:
    """Raise `DataError` at a value a hundred times its neighbours if these agree: its decimal mark was lost.

    A detector spike is smaller, and noise about zero has neighbours of similar magnitude within ten rows.
    """
    if values.size < 3:
        return
    size = np.abs(values)
    left, size_here, right = size[:-2], size[1:-1], size[2:]
    with np.errstate(invalid="ignore"):
        alike = np.maximum(left, right) <= 2.0 * np.minimum(left, right)
        wild = alike & (size_here > _WILD * np.maximum(left, right))
    for place in (np.flatnonzero(wild) + 1).tolist():
        about = np.concatenate((size[max(place - _ABOUT, 0) : place], size[place + 1 : place + 1 + _ABOUT]))
        if size[place] > 0.1 * _WILD * float(np.nanmax(about)):
            limit = f"is between {values[place - 1]:g} and {values[place + 1]:g}: a decimal point or a digit is damaged"
            raise grid.refused(rows[place], column, limit)


def check_digits(grid: Grid, columns: Sequence[tuple[int, Sequence[int]]]) -> None:
    """Raise `DataError` at a number with more digits than the program prints: merged numbers or a surplus digit.

    A program prints numbers with a constant number of either significant digits or decimals; most numbers show which.
    Each column is given by its position and rows.
    """
    counted = [[(row, *digits(grid.rows[row][column])) for row in rows] for column, rows in columns]
    every = Counter(whole for column in counted for _, whole, _ in column)
    most = _usual_most(every)
    full = 2 * every[most] >= sum(every.values())
    for (column, _), numbers in zip(columns, counted, strict=True):
        after = _usual_most(Counter(decimals for _, _, decimals in numbers))
        for row, whole, decimals in numbers:
            if whole > most and (full or decimals > after):
                raise grid.refused(row, column, f"has {whole} digits, but other numbers have at most {most}")


def _usual_most(counts: Counter[int]) -> int:
    """Return the largest count that occurs in more than a few numbers."""
    return max((count for count, times in counts.items() if times >= _SOME), default=max(counts, default=0))


def alone(values: FloatArray) -> IndexArray:
    """Return the indices of values far from both neighbours if these agree; at the ends, from the two nearest.

    Far means more than fifty times the median distance of a value from the mean of its neighbours, and more than a
    twentieth of the larger neighbour.
    """
    if values.size < 8:
        return np.array([], dtype=int)
    near = np.concatenate(([values[1]], values[:-2], [values[-2]]))
    other = np.concatenate(([values[2]], values[2:], [values[-3]]))
    off = np.abs(values - 0.5 * (near + other))
    usual = float(np.nanmedian(off)) if np.isfinite(off).any() else 0.0
    beside = np.maximum(np.abs(near), np.abs(other))
    with np.errstate(invalid="ignore"):
        far = (off > 50.0 * usual) & (off > 0.05 * beside) & (off > 10.0 * np.abs(near - other)) & (off > 0.0)
    return np.flatnonzero(far)


def alone_note(values: FloatArray, where: Sequence[str]) -> str:
    """Return a note on isolated values and their positions; empty if there are none."""
    places = alone(values)
    if not places.size:
        return ""
    shown = ", ".join(f"{values[n]:g} {where[n]}" for n in places[:3].tolist())
    return f"{places.size} values are far from both neighbours ({shown}): a spike, or a damaged digit"


def _windowed(steps: FloatArray, width: int) -> IndexArray:
    """Return the positions at which ``width`` steps are non-uniform between two uniform ones before and two after."""
    window = np.lib.stride_tricks.sliding_window_view(steps, width + 4)
    about = window[:, [0, 1, -2, -1]]
    even = np.ptp(about, axis=1) <= 2.0 * _EVEN * np.abs(about.mean(axis=1))
    off = np.abs(window[:, 2 : 2 + width] - about.mean(axis=1)[:, None]) > _JUMP * about.mean(axis=1)[:, None]
    return np.flatnonzero(even & off.all(axis=1)) + 2


def _even(steps: FloatArray) -> bool:
    return bool(np.ptp(steps) <= 2.0 * _EVEN * abs(float(steps.mean())))
