"""What a scan's own numbers tell about damage: wavelengths that jump, values that stand alone.

The idea: a monochromator moves one way, in even steps. A step that differs from equal steps before and after it is no
scan's; nor are wavelengths that differ in one place from those of all traces beside them.

The interface: `check_wavelengths`, `check_alike` and `alone`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solen.recording.grid import Grid

FloatArray = NDArray[np.float64]

_RANGE_NM = (50.0, 100_000.0)
_EVEN = 0.05  # steps are even within this share of them: drives are not exact, and prints are rounded
_JUMP = 0.15  # a step is off beyond this share of the even steps beside it
_FEW = 0.1  # wavelengths that differ from those of other traces in at most this share of places are damaged there


def check_wavelengths(grid: Grid, column: int, rows: Sequence[int], waves: FloatArray) -> None:
    """`DataError` at the first wavelength of a trace that no scan would have."""
    outside = np.flatnonzero((waves < _RANGE_NM[0]) | (waves > _RANGE_NM[1]) | np.isnan(waves))
    if outside.size:
        limit = f"no wavelength in nm is outside {_RANGE_NM[0]:g} to {_RANGE_NM[1]:g}"
        raise grid.refused(rows[int(outside[0])], column, limit)
    steps = np.diff(waves)
    if not steps.size:
        return
    forward = np.sum(steps > 0.0) > np.sum(steps < 0.0)
    wrong = np.flatnonzero(steps <= 0.0 if forward else steps >= 0.0)
    if wrong.size:
        before = waves[int(wrong[0])]
        limit = f"follows {before:g} in a scan {'up' if forward else 'down'}: wavelengths repeat or jump"
        raise grid.refused(rows[int(wrong[0]) + 1], column, limit)
    odd = uneven(np.abs(steps))
    if odd is not None:
        usual = abs(float(np.median(steps[max(odd - 3, 0) : odd + 4])))
        limit = f"is {abs(steps[odd]):g} nm from the one before where steps are {usual:g}: a digit or a line is damaged"
        remedy = "restore it; a value may be empty, its line may not be left out"
        raise grid.refused(rows[odd + 1], column, limit, remedy)


def uneven(steps: FloatArray) -> int | None:
    """First step that is off between even ones, or None. The first may be shorter than the others, and the last.

    A step is judged by the two before it and the two after; where one point is off, two steps are, so those may follow
    one another. At the ends it is judged by three on one side.
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
    """`DataError` at a wavelength that differs from those of most traces, where all others are the same.

    Each trace is its column of wavelengths, its rows and the wavelengths.
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


def alone(values: FloatArray) -> NDArray[np.intp]:
    """Places of values that stand far from both neighbours, while those agree with one another.

    Far is fifty times the usual distance of a value from the middle of its neighbours, and a twentieth of them.
    """
    if values.size < 8:
        return np.array([], dtype=int)
    left, value, right = values[:-2], values[1:-1], values[2:]
    off = np.abs(value - 0.5 * (left + right))
    usual = float(np.nanmedian(off)) if np.isfinite(off).any() else 0.0
    beside = np.maximum(np.abs(left), np.abs(right))
    far = (off > 50.0 * usual) & (off > 0.05 * beside) & (off > 10.0 * np.abs(left - right))
    return np.flatnonzero(far & (off > 0.0)) + 1


def _windowed(steps: FloatArray, width: int) -> NDArray[np.intp]:
    """Places where ``width`` steps are off between two even ones before and two after."""
    window = np.lib.stride_tricks.sliding_window_view(steps, width + 4)
    about = window[:, [0, 1, -2, -1]]
    even = np.ptp(about, axis=1) <= 2.0 * _EVEN * np.abs(about.mean(axis=1))
    off = np.abs(window[:, 2 : 2 + width] - about.mean(axis=1)[:, None]) > _JUMP * about.mean(axis=1)[:, None]
    return np.flatnonzero(even & off.all(axis=1)) + 2


def _even(steps: FloatArray) -> bool:
    return bool(np.ptp(steps) <= 2.0 * _EVEN * abs(float(steps.mean())))
