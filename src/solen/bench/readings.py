"""Readings of a sensor from the rows of a journal, without ambient light, faulty periods and incomplete cycles."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.analysis.demodulation import Demodulated, slots_of, subtract
from solen.arrays import FloatArray
from solen.bench.axes import stream_of
from solen.bench.frames import ANEW, UNSOUND
from solen.bench.journal_content import JournalContent, Rows
from solen.bench.rig import driven_values
from solen.bench.timing import Looks


@dataclass(frozen=True, eq=False)
class Read:
    """Readings of inputs: times (N,); signal, subtracted level, and whether a sample was clipped, (N, R)."""

    time_s: FloatArray
    signal: FloatArray
    ambient: FloatArray
    clipped: NDArray[Any]


Columns = dict[str, NDArray[Any]]
CELL = "cell_V"
"""Column of a load cell's volts, from which forces are computed when its voltage without load is known."""
AT_ONCE = 16_384
"""Periods per chunk of processing and storage: an hour then needs little memory and few reads."""


def stretches(board: Rows) -> list[tuple[int, int]]:
    """Return start and end index of each segment sampled by one clock, up to a restart of the board."""
    edges = np.flatnonzero((np.diff(board["part"].astype(np.int64)) != 0) | (board["flags"][1:] & ANEW != 0)) + 1
    return list(zip([0, *edges.tolist()], [*edges.tolist(), len(board)], strict=True)) if len(board) else []


def cut_short(journaled: JournalContent) -> list[tuple[float, float]]:
    """Return the times of the run from the last complete cycle of a part until the next part is at rest."""
    found, whole_s, open_s = [], -math.inf, None
    for event in journaled.events:
        if event["what"] == "begun" and event["part"] > 0 and open_s is None:
            open_s = whole_s
        elif event["what"] in {"at rest", "cycle done"}:
            whole_s = event["t_s"]
            if open_s is not None:
                found.append((open_s, whole_s))
                open_s = None
    return found if open_s is None else [*found, (open_s, math.inf)]


class View(NamedTuple):
    """A sensor under one of its emitters: its name, the emitter, and the inputs of its receivers, from 1.

    ``sensor`` is its entry in a journal's header. Most sensors have one emitter, and ``name`` is the sensor's name.
    """

    name: str
    emitter: int
    inputs: dict[str, int]
    sensor: Mapping[str, Any]


def views_of(header: Mapping[str, Any]) -> list[View]:
    """Return every sensor of a run under each of its emitters."""
    views = []
    for one in header["sensors"]:
        if one.get("emitters"):
            views += [View(f"{one['name']}.{own}", lit, one["inputs"], one) for own, lit in one["emitters"].items()]
        else:
            views.append(View(one["name"], one["emitter"], {side: one[side] for side in ("right", "left")}, one))
    return views


def motions_of(header: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return how positions of a run's stages become values, by motion.

    The motion of a run with one stage has no name.
    """
    return dict(header["motions"]) if header.get("motions") else {"": header}


def looks_of(journaled: JournalContent, motion: str = "") -> Looks:
    """Return the recorded positions of the stage of a motion."""
    return Looks.of(journaled.streams[stream_of(motion)], journaled.header.get("clock_resolution_s", 0.0))


def sensor_readings(
    view: View, journaled: JournalContent, time_s: FloatArray, cuts: Sequence[tuple[float, float]]
) -> Iterator[Columns]:
    """Return the readings of a sensor, segment by segment, without those of incomplete cycles."""
    board, header = journaled.streams["board"], journaled.header
    for first, last in stretches(board):
        for begin in range(first, last, AT_ONCE):
            end = min(begin + AT_ONCE, last)
            low, high = max(begin - 1, first), min(end + 1, last)  # neighbours supply their off phases
            inputs, counts = inputs_of(view, header), board["counts"][low:high]
            readings = subtracted(counts, time_s[low:high], view.emitter, inputs, Converter.of(header))
            kept = readings.of(view.emitter) & (readings.time_s >= time_s[begin])
            kept &= sound(board["flags"][low:high], time_s[low:high], readings.time_s)
            if end < last:
                kept &= readings.time_s < time_s[end]
            yield columns_of(view, readings, kept, journaled, cuts)


class Converter(NamedTuple):
    """Length of a board's period, volts per count, and the highest count."""

    period_s: float
    volts_per_count: float
    top_count: float

    @classmethod
    def of(cls, header: Mapping[str, Any]) -> "Converter":
        """Return the converter that a journal's header states."""
        return cls(header["period_s"], header["volts_per_count"], header["top_count"])


def inputs_of(view: View, header: Mapping[str, Any]) -> list[int]:
    """Return the inputs of a sensor's receivers, from 0, right before left, and of the load cell if a run has one."""
    cell = header.get("load_cell")
    return [one - 1 for one in (*view.inputs.values(), *(() if cell is None else (cell["input"],)))]


def subtracted(
    counts: NDArray[np.uint16], time_s: FloatArray, emitter: int, inputs: Sequence[int], converter: Converter
) -> Demodulated:
    """Return the demodulated readings of some inputs with one emitter, in some periods.

    Of each period, only the emitter's own on phase and the adjacent off phases are used.
    """
    phases, on = 2 * counts.shape[1], 2 * (emitter - 1)
    near = np.unique([(on - 1) % phases, on, on + 1])
    taken = counts.reshape(len(counts), phases, -1)[:, near][..., inputs].reshape(-1, len(inputs))
    values: FloatArray = np.multiply(taken, converter.volts_per_count, dtype=np.float64)
    time = (time_s[:, None] + (near + 1.0) / phases * converter.period_s).ravel()
    state = np.tile(np.where(near == on, emitter, 0), len(counts))
    ends = np.array([0.0, converter.top_count])[:, None] * np.full(len(inputs), converter.volts_per_count)
    return subtract(slots_of(time, values, state, limits=(ends[0], ends[1])))


def sound(flags: NDArray[np.uint8], period_s: FloatArray, reading_s: FloatArray) -> NDArray[np.bool_]:
    """Return which readings come from valid periods; in a late one the exposure is unknown.

    The preceding period must be valid too, because it supplies the off phase.
    """
    good = flags & UNSOUND == 0
    period = np.searchsorted(period_s, reading_s, "right") - 1
    return np.asarray(good[period] & good[np.maximum(period - 1, 0)])


def columns_of(
    view: View,
    readings: Demodulated | Read,
    kept: NDArray[np.bool_],
    journaled: JournalContent,
    cuts: Sequence[tuple[float, float]],
) -> Columns:
    """Return the columns of the kept readings, without those of incomplete cycles."""
    for cut_s, rest_s in cuts:
        kept &= (readings.time_s <= cut_s) | (readings.time_s >= rest_s)
    motions = {motion: (looks_of(journaled, motion), driven) for motion, driven in motions_of(journaled.header).items()}
    for looks, _ in motions.values():
        if not np.isfinite(looks.position).all():  # a stage turned by hand: the angle during a move is unknown
            kept = kept & np.isfinite(looks.at(readings.time_s))
    time = readings.time_s[kept]
    columns = {"time_s": time} | {
        drive_of(motion, driven): driven_values(looks.at(time), driven) for motion, (looks, driven) in motions.items()
    }
    for what, values in (("", readings.signal), ("_ambient", readings.ambient), ("_clipped", readings.clipped)):
        kind = np.uint8 if what == "_clipped" else np.float64
        columns |= {f"{name}{what}": values[kept, place].astype(kind) for place, name in enumerate(view.inputs)}
    return _cell_volts(readings, kept, len(view.inputs)) | columns


def drive_of(motion: str, driven: Mapping[str, Any]) -> str:
    """Return the column of the angles of a motion, or of depths."""
    if motion:
        return f"{motion}_deg"
    return "depth_mm" if driven.get("drives") == "depth" else "angle_deg"


def _cell_volts(readings: Demodulated | Read, kept: NDArray[np.bool_], receivers: int) -> Columns:
    """Return the volts of the load cell, the mean of on and off because no emitter affects it.

    The result is NaN if one was at a limit.
    """
    if readings.signal.shape[1] <= receivers:
        return {}
    off, signal = readings.ambient[kept, receivers], readings.signal[kept, receivers]
    volts = np.where(np.isfinite(off), off + 0.5 * signal, signal)
    return {CELL: np.where(readings.clipped[kept, receivers], np.nan, volts)}
