"""Damage that is visible in the numbers of a scan: jumps of the wavelength, isolated values, surplus digits.

A monochromator moves in one direction and in equal steps. A step that differs from equal steps before and after it is
treated as damaged; so is a wavelength that differs from that of all other traces in its row.

Public names: `check_wavelengths`, `check_common_wavelengths`, `check_outliers`, `check_digits`, `order_note` and
`outlier_note`.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray, IndexArray
from solen.recording.grid import Grid
from solen.recording.numbers import digits

RANGE_NM = (100.0, 100_000.0)
"""Wavelength limits in nm: no laboratory monochromator or interferometer works outside them."""
_UNIFORMITY = 0.05  # relative tolerance of uniform steps: drives are inexact, and printed numbers are rounded
_MAX_DEVIATION = 0.15  # relative deviation from uniform steps on both sides above which a step is wrong
_OUTLIER_RATIO = 100.0  # ratio of a value to its neighbours above which it is damaged
_NEIGHBOURS = 10  # number of rows before and after a value that show the usual magnitude
_MIN_COUNT = 5  # minimum number of occurrences of a usual form
_MAX_DAMAGED = 0.1  # maximum fraction of wavelengths that differ because of damage


def check_wavelengths(grid: Grid, column: int, rows: Sequence[int], waves: FloatArray) -> None:
    """Raise `DataError` at the first wavelength that cannot be part of a scan."""
    outside = np.flatnonzero((waves < RANGE_NM[0]) | (waves > RANGE_NM[1]) | np.isnan(waves))
    if outside.size:
        limit = f"is a wavelength outside {RANGE_NM[0]:g} to {RANGE_NM[1]:g} nm, the range of laboratory instruments"
        raise grid.error(rows[int(outside[0])], column, limit)
    steps = np.diff(waves)
    if not steps.size:
        return
    forward = np.sum(steps > 0.0) > np.sum(steps < 0.0)
    wrong = np.flatnonzero(steps <= 0.0 if forward else steps >= 0.0)
    if wrong.size:
        before = waves[int(wrong[0])]
        direction = "increasing" if forward else "decreasing"
        limit = f"follows {before:g} in a scan with {direction} wavelengths: a wavelength repeats or jumps"
        raise grid.error(rows[int(wrong[0]) + 1], column, limit)
    index = irregular_step(np.abs(steps))
    if index is not None:
        typical = abs(float(np.median(steps[max(index - 3, 0) : index + 4])))
        limit = (
            f"is {abs(steps[index]):g} nm from the previous wavelength, but steps are {typical:g}: "
            "a digit or a line is damaged"
        )
        remedy = "restore the line; a value may be empty, but its line may not be omitted"
        raise grid.error(rows[index + 1], column, limit, remedy)


def order_note(waves: FloatArray) -> str:
    """Return a note if wavelengths are monotonic except for a few; empty if all are, or if the column is not a scan."""
    steps = np.diff(waves)
    disordered = [np.flatnonzero(~(steps > 0.0)), np.flatnonzero(~(steps < 0.0))]
    wrong = min(disordered, key=len)
    if not 0 < wrong.size <= _MAX_DAMAGED * steps.size + 1 or steps.size < 4:
        return ""
    examples = ", ".join(f"{waves[n + 1]:g} after {waves[n]:g}" for n in wrong[:3])
    return f"{wrong.size} wavelengths are out of order ({examples}): rows were moved or repeated, or a digit is damaged"


def irregular_step(steps: FloatArray) -> int | None:
    """Return the index of the first irregular step among uniform ones, or None; the end steps may be shorter.

    A step, or a pair of steps as caused by a single wrong point, is compared with the two steps before and the two
    after it; a step at an end is compared with its three neighbours.
    """
    count = steps.size
    if count < 4:
        return None
    single = _irregular_windows(steps, 1) if count >= 5 else np.array([], dtype=int)
    pair = _irregular_windows(steps, 2) if count >= 6 else np.array([], dtype=int)
    ends = [
        end
        for end, neighbours in ((0, steps[1:4]), (count - 1, steps[-4:-1]))
        if _are_uniform(neighbours) and steps[end] > (1.0 + _MAX_DEVIATION) * neighbours[0]
    ]
    candidates = [*single.tolist(), *pair.tolist(), *ends]
    return int(min(candidates)) if candidates else None


def check_common_wavelengths(grid: Grid, traces: Sequence[tuple[int, Sequence[int], FloatArray]]) -> None:
    """Raise `DataError` at a wavelength that differs from that of most traces, if all other rows agree.

    Each trace is given by its wavelength column, its rows and its wavelengths.
    """
    long_traces = [trace for trace in traces if trace[2].size > 2]
    if len(long_traces) < 3:
        return
    longest = max(waves.size for _, _, waves in long_traces)
    table = np.full((len(long_traces), longest), np.nan)
    for line, (_, _, waves) in zip(table, long_traces, strict=True):
        line[: waves.size] = waves
    typical = np.nanmedian(table, axis=0)
    deviating = np.abs(table - typical) > _MAX_DEVIATION * float(np.median(np.abs(np.diff(typical))))
    for (column, rows, waves), flags in zip(long_traces, deviating, strict=True):
        indices = np.flatnonzero(flags)
        if 0 < indices.size <= max(1.0, _MAX_DAMAGED * waves.size):
            index = int(indices[0])
            limit = f"differs from the {typical[index]:g} nm of other traces, which are the same elsewhere"
            raise grid.error(rows[index], column, limit)


def check_outliers(grid: Grid, column: int, rows: Sequence[int], values: FloatArray) -> None:
    """Raise `DataError` at a value a hundred times its neighbours if these agree, as if its decimal mark were lost.

    A spike of a detector is smaller, and noise about zero has values of similar magnitude within ten rows.
    """
    if values.size < 3:
        return
    size = np.abs(values)
    left, middle, right = size[:-2], size[1:-1], size[2:]
    with np.errstate(invalid="ignore"):
        similar = np.maximum(left, right) <= 2.0 * np.minimum(left, right)
        outlying = similar & (middle > _OUTLIER_RATIO * np.maximum(left, right))
    for index in (np.flatnonzero(outlying) + 1).tolist():
        neighbours = np.concatenate(
            (size[max(index - _NEIGHBOURS, 0) : index], size[index + 1 : index + 1 + _NEIGHBOURS])
        )
        if size[index] > 0.1 * _OUTLIER_RATIO * float(np.nanmax(neighbours)):
            limit = f"is between {values[index - 1]:g} and {values[index + 1]:g}: a decimal point or a digit is damaged"
            raise grid.error(rows[index], column, limit)


def check_digits(grid: Grid, columns: Sequence[tuple[int, Sequence[int]]]) -> None:
    """Raise `DataError` at a number with more digits than the program prints: merged numbers or a surplus digit.

    A program prints a constant number of either significant digits or decimals; most numbers show which. Each column is
    given by its index and rows.
    """
    counted = [[(row, *digits(grid.rows[row][column])) for row in rows] for column, rows in columns]
    frequencies = Counter(count_ for column in counted for _, count_, _ in column)
    usual = _largest_usual(frequencies)
    consistent = 2 * frequencies[usual] >= sum(frequencies.values())
    for (column, _), numbers in zip(columns, counted, strict=True):
        usual_decimals = _largest_usual(Counter(decimals for _, _, decimals in numbers))
        for row, count_, decimals in numbers:
            if count_ > usual and (consistent or decimals > usual_decimals):
                raise grid.error(row, column, f"has {count_} digits, but other numbers have at most {usual}")


def _largest_usual(counts: Counter[int]) -> int:
    """Return the largest number of digits that occurs often or, if none does, the largest number."""
    return max((count for count, times in counts.items() if times >= _MIN_COUNT), default=max(counts, default=0))


def isolated(values: FloatArray) -> IndexArray:
    """Return the indices of values far from both neighbours, which agree; at an end, from the two nearest values.

    The distance of such a value from the mean of its neighbours exceeds fifty times the median distance of all values,
    a twentieth of the larger neighbour, and ten times the difference of the neighbours.
    """
    if values.size < 8:
        return np.array([], dtype=int)
    previous = np.concatenate(([values[1]], values[:-2], [values[-2]]))
    next_value = np.concatenate(([values[2]], values[2:], [values[-3]]))
    distance = np.abs(values - 0.5 * (previous + next_value))
    typical = float(np.nanmedian(distance)) if np.isfinite(distance).any() else 0.0
    level = np.maximum(np.abs(previous), np.abs(next_value))
    with np.errstate(invalid="ignore"):
        is_far = (
            (distance > 50.0 * typical)
            & (distance > 0.05 * level)
            & (distance > 10.0 * np.abs(previous - next_value))
            & (distance > 0.0)
        )
    return np.flatnonzero(is_far)


def outlier_note(values: FloatArray, locations: Sequence[str]) -> str:
    """Return a note on isolated values and their positions; empty if there are none."""
    indices = isolated(values)
    if not indices.size:
        return ""
    shown = ", ".join(f"{values[n]:g} {locations[n]}" for n in indices[:3].tolist())
    return f"{indices.size} values are far from both neighbours ({shown}): a spike, or a damaged digit"


def _irregular_windows(steps: FloatArray, width: int) -> IndexArray:
    """Return the indices of ``width`` irregular steps that have two uniform ones before and two after them."""
    window = np.lib.stride_tricks.sliding_window_view(steps, width + 4)
    neighbours = window[:, [0, 1, -2, -1]]
    uniform = np.ptp(neighbours, axis=1) <= 2.0 * _UNIFORMITY * np.abs(neighbours.mean(axis=1))
    irregular = (
        np.abs(window[:, 2 : 2 + width] - neighbours.mean(axis=1)[:, None])
        > _MAX_DEVIATION * neighbours.mean(axis=1)[:, None]
    )
    return np.flatnonzero(uniform & irregular.all(axis=1)) + 2


def _are_uniform(steps: FloatArray) -> bool:
    return bool(np.ptp(steps) <= 2.0 * _UNIFORMITY * abs(float(steps.mean())))
