"""Readings of the sensors from the rows of a journal, without ambient light, faulty periods and interrupted cycles."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.analysis.demodulation import Demodulated, slots_of, subtract
from solen.arrays import FloatArray
from solen.bench.axes import stream_of
from solen.bench.frames import INVALID, RESTARTED
from solen.bench.journal_content import JournalContent, Rows
from solen.bench.rig import driven_values
from solen.bench.timing import Positions


@dataclass(frozen=True, eq=False)
class MeterReadings:
    """Readings of a meter: times (N,); signal, ambient level, and whether a value was clipped, (N, inputs)."""

    time_s: FloatArray
    signal: FloatArray
    ambient: FloatArray
    clipped: NDArray[Any]


Columns = dict[str, NDArray[Any]]
CELL = "cell_V"
"""Column of a load cell's volts, from which forces are computed once its voltage without load is known."""
CHUNK_PERIODS = 16_384
"""Periods that are processed and stored together: an hour then needs little memory and few reads."""


def segments(board: Rows) -> list[tuple[int, int]]:
    """Return start and end index of each segment of periods without a restart of the board or of the run."""
    edges = np.flatnonzero((np.diff(board["part"].astype(np.int64)) != 0) | (board["flags"][1:] & RESTARTED != 0)) + 1
    return list(zip([0, *edges.tolist()], [*edges.tolist(), len(board)], strict=True)) if len(board) else []


def interrupted_spans(journal: JournalContent) -> list[tuple[float, float]]:
    """Return the time spans from the last complete cycle before an interruption until the stage is at rest again."""
    spans, complete_s, begin_s = [], -math.inf, None
    for event in journal.events:
        if event["what"] == "begun" and event["part"] > 0 and begin_s is None:
            begin_s = complete_s
        elif event["what"] in {"at rest", "cycle done"}:
            complete_s = event["t_s"]
            if begin_s is not None:
                spans.append((begin_s, complete_s))
                begin_s = None
    return spans if begin_s is None else [*spans, (begin_s, math.inf)]


class View(NamedTuple):
    """A sensor under one of its emitters: a name, the emitter, and the inputs of the receivers, counted from 1.

    ``sensor`` is the entry of the sensor in a journal's header. ``name`` is the name of the sensor, for a network
    followed by that of the emitter.
    """

    name: str
    emitter: int
    inputs: dict[str, int]
    sensor: Mapping[str, Any]


def views_of(header: Mapping[str, Any]) -> list[View]:
    """Return every sensor of a run under each of its emitters."""
    views = []
    for sensor in header["sensors"]:
        name = sensor["name"]
        if sensor.get("emitters"):
            emitters = sensor["emitters"].items()
            views += [View(f"{name}.{emitter}", number, sensor["inputs"], sensor) for emitter, number in emitters]
        else:
            views.append(View(name, sensor["emitter"], {side: sensor[side] for side in ("right", "left")}, sensor))
    return views


def motions_of(header: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the settings that convert positions of the stages to angles or depths, keyed by motion.

    The motion of a run with one stage has no name.
    """
    return dict(header["motions"]) if header.get("motions") else {"": header}


def positions_of(journal: JournalContent, motion: str = "") -> Positions:
    """Return the recorded positions of the stage that makes a motion."""
    return Positions.of(journal.streams[stream_of(motion)], journal.header.get("clock_resolution_s", 0.0))


def sensor_readings(
    view: View, journal: JournalContent, time_s: FloatArray, spans: Sequence[tuple[float, float]]
) -> Iterator[Columns]:
    """Yield the readings of a sensor, chunk by chunk, without those in the spans of interrupted cycles."""
    board, header = journal.streams["board"], journal.header
    for first, last in segments(board):
        for begin in range(first, last, CHUNK_PERIODS):
            end = min(begin + CHUNK_PERIODS, last)
            low, high = max(begin - 1, first), min(end + 1, last)  # the adjacent periods supply off phases
            inputs, counts = inputs_of(view, header), board["counts"][low:high]
            readings = demodulated(counts, time_s[low:high], view.emitter, inputs, BoardAdc.of(header))
            kept = readings.of(view.emitter) & (readings.time_s >= time_s[begin])
            kept &= valid(board["flags"][low:high], time_s[low:high], readings.time_s)
            if end < last:
                kept &= readings.time_s < time_s[end]
            yield columns_of(view, readings, kept, journal, spans)


class BoardAdc(NamedTuple):
    """Sampling by a board: duration of a period, volts per count, and highest count."""

    period_s: float
    volts_per_count: float
    max_count: float

    @classmethod
    def of(cls, header: Mapping[str, Any]) -> "BoardAdc":
        """Return the sampling that the header of a journal describes."""
        return cls(header["period_s"], header["volts_per_count"], header["top_count"])


def inputs_of(view: View, header: Mapping[str, Any]) -> list[int]:
    """Return the indices of a sensor's inputs in the order of the view, then that of the load cell if a run has one."""
    cell = header.get("load_cell")
    return [number - 1 for number in (*view.inputs.values(), *(() if cell is None else (cell["input"],)))]


def demodulated(
    counts: NDArray[np.uint16], time_s: FloatArray, emitter: int, inputs: Sequence[int], adc: BoardAdc
) -> Demodulated:
    """Return the demodulated readings of the given inputs with one emitter, in the given periods.

    Of each period, only the on phase of the emitter and the adjacent off phases are used.
    """
    phases, on = 2 * counts.shape[1], 2 * (emitter - 1)
    used = np.unique([(on - 1) % phases, on, on + 1])
    used_counts = counts.reshape(len(counts), phases, -1)[:, used][..., inputs].reshape(-1, len(inputs))
    values: FloatArray = np.multiply(used_counts, adc.volts_per_count, dtype=np.float64)
    time = (time_s[:, None] + (used + 1.0) / phases * adc.period_s).ravel()
    state = np.tile(np.where(used == on, emitter, 0), len(counts))
    limits = np.array([0.0, adc.max_count])[:, None] * np.full(len(inputs), adc.volts_per_count)
    return subtract(slots_of(time, values, state, limits=(limits[0], limits[1])))


def valid(flags: NDArray[np.uint8], period_s: FloatArray, reading_s: FloatArray) -> NDArray[np.bool_]:
    """Return which readings come from valid periods; in a late period the exposure is unknown.

    The preceding period must be valid too, because it supplies an off phase.
    """
    valid_periods = flags & INVALID == 0
    period = np.searchsorted(period_s, reading_s, "right") - 1
    return np.asarray(valid_periods[period] & valid_periods[np.maximum(period - 1, 0)])


def columns_of(
    view: View,
    readings: Demodulated | MeterReadings,
    kept: NDArray[np.bool_],
    journal: JournalContent,
    spans: Sequence[tuple[float, float]],
) -> Columns:
    """Return the columns of the kept readings, without those in the spans of interrupted cycles."""
    for begin_s, end_s in spans:
        kept &= (readings.time_s <= begin_s) | (readings.time_s >= end_s)
    settings = motions_of(journal.header)
    positions = {motion: positions_of(journal, motion) for motion in settings}
    for stage in positions.values():
        if not np.isfinite(stage.position).all():  # a stage turned by hand: the angle during a move is unknown
            kept = kept & np.isfinite(stage.at(readings.time_s))
    time = readings.time_s[kept]
    columns = {"time_s": time} | {
        drive_column(motion, settings[motion]): driven_values(stage.at(time), settings[motion])
        for motion, stage in positions.items()
    }
    for suffix, values in (("", readings.signal), ("_ambient", readings.ambient), ("_clipped", readings.clipped)):
        kind = np.uint8 if suffix == "_clipped" else np.float64
        columns |= {f"{name}{suffix}": values[kept, index].astype(kind) for index, name in enumerate(view.inputs)}
    return _cell_volts(readings, kept, len(view.inputs)) | columns


def drive_column(motion: str, settings: Mapping[str, Any]) -> str:
    """Return the name of the column of a motion's angles, or of depths."""
    if motion:
        return f"{motion}_deg"
    return "depth_mm" if settings.get("drives") == "depth" else "angle_deg"


def _cell_volts(readings: Demodulated | MeterReadings, kept: NDArray[np.bool_], receivers: int) -> Columns:
    """Return the volts of the load cell: the mean of on and off, because no emitter affects it; NaN if clipped."""
    if readings.signal.shape[1] <= receivers:
        return {}
    off, signal = readings.ambient[kept, receivers], readings.signal[kept, receivers]
    volts = np.where(np.isfinite(off), off + 0.5 * signal, signal)
    return {CELL: np.where(readings.clipped[kept, receivers], np.nan, volts)}
