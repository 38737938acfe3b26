"""A data acquisition's samples on their way from a journal into a file, and from the file into readings.

Samples may need far more space than the memory has. They are copied from the journal into the file as counts, record by
record; then the file is read again window by window, and the emitters' phases and the readings are determined in each.
Windows overlap, and each yields the readings after the last one of the window before. Therefore none is lost or doubled
at a border, even though the two windows differ slightly in the position of an edge.

`Waveform` requires a file and a journal; `Waveform.readings` yields readings by sensor.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from solen.analysis.demodulation import Clock, Demodulated, slots_of, subtract
from solen.arrays import BoolArray, FloatArray
from solen.bench.clock_fit import ClockLine, fit_clock
from solen.bench.daq import Setup, ends_of, volts_of
from solen.bench.journal_content import JournalContent
from solen.bench.phases import clock_of, seen_by, states
from solen.bench.readings import View, inputs_of
from solen.bench.timing import came_by, exchanges
from solen.errors import DataError
from solen.ranks import Caution, warning

WINDOW_S = 10.0
"""Duration in s of the samples that are processed at once."""
CHUNK = 1 << 14
"""Number of samples that are compressed together."""
OVERLAP = 4
"""Number of frames, one period each, by which a window extends beyond its borders."""


@dataclass(frozen=True)
class _Stretch:
    """Frames without a gap: first and last index, the line of their clock, and the number of the segment of the run."""

    begin: int
    end: int
    line: ClockLine
    name: str


class Waveform:
    """Samples of a journal, written to a file unchanged.

    Parameters
    ----------
    file
        An open netCDF file, whose root receives ``counts``.
    journaled
        The journal.

    Attributes
    ----------
    part, stretch, number
        For each frame, shape (F,): part of the run, gapless segment, number of its first sample in that segment.
    time_s
        Time of each frame's first sample on the clock of the run, shape (F,).
    remarks
        Windows that gave no readings, and the reason.
    """

    def __init__(self, file: Any, journaled: JournalContent) -> None:
        self._header, daq = journaled.header, journaled.header["daq"]
        self._setup = Setup(**daq["setup"] | {"channels": tuple(daq["setup"]["channels"])})
        self._rate_hz, self._switch_hz, self._convert_s = daq["rate_hz"], daq["switch_hz"], daq["convert_s"]
        self._coefficients = np.array(daq["coefficients"])
        self._limits = ends_of(self._coefficients, daq.get("limits_V"))
        self.remarks: list[Caution] = []
        frames = journaled.counts["samples"]
        self.part, self.stretch = np.zeros(frames, np.uint16), np.zeros(frames, np.uint16)
        self.number, self.time_s = np.zeros(frames, np.int64), np.zeros(frames)
        shape = frames * self._setup.frame, len(self._setup.channels)
        file.dimensions = {"sample": shape[0], "channel": shape[1]}
        text = "samples as the converter counts; volts are the sum of coefficients times powers of them"
        self._counts = create_variable(file, "counts", ("sample", "channel"), shape, np.int16, "1", text, CHUNK)
        self._counts.attrs["channels"] = " ".join(self._setup.channels)
        self._fill(journaled)
        self._stretches = list(self._lined(journaled))

    @property
    def lines(self) -> dict[str, ClockLine]:
        """Return the instrument's clock on the run's clock, by part and segment."""
        return {stretch.name: stretch.line for stretch in self._stretches}

    def readings(self, views: Sequence[View]) -> Iterator[tuple[View, Demodulated, BoolArray]]:
        """Return the readings of each sensor under each emitter, window by window, and which of them are new."""
        last: dict[str, float] = {}
        half_s = 0.5 / self._setup.switch_hz
        for stretch in self._stretches:
            for begin, end in self._windows(stretch):
                for view, found in self._window(stretch, begin, end, views):
                    until = self._until(stretch, end)
                    kept = found.of(view.emitter) & (found.time_s < until)
                    kept &= found.time_s > last.get(view.name, -np.inf) + half_s
                    if kept.any():
                        last[view.name] = float(found.time_s[kept][-1])
                    yield view, found, kept

    def _fill(self, journaled: JournalContent) -> None:
        """Write counts into the file, record by record, and store the description of each frame."""
        at, frame = 0, self._setup.frame
        for rows in journaled.blocks("samples"):
            here = slice(at, at + len(rows))
            self.part[here], self.stretch[here], self.number[here] = rows["part"], rows["stretch"], rows["number"]
            counts = rows["counts"].reshape(-1, len(self._setup.channels))
            self._counts[at * frame : (at + len(rows)) * frame] = counts
            at += len(rows)

    def _lined(self, journaled: JournalContent) -> Iterator[_Stretch]:
        """Return the segments in their order; the time of arrival of a sample is the time at which it was taken."""
        came = journaled.streams["came"]
        which = np.stack([self.part, self.stretch], axis=1).astype(np.int64)
        jumps = np.diff(self.number) != self._setup.frame  # a damaged journal lacks frames
        edges = (np.flatnonzero(np.diff(which, axis=0).any(axis=1) | jumps) + 1).tolist()
        for begin, end in zip([0, *edges], [*edges, len(which)], strict=True):
            if begin == end:
                continue
            part, stretch = which[begin]
            mine = came[(came["part"] == part) & (came["stretch"] == stretch)]
            taken_s = mine["number"] / self._rate_hz if len(mine) else np.zeros(1)
            came_s = came_by(mine, journaled) if len(mine) else np.zeros(1)
            line = fit_clock(taken_s, came_s, exchanges(journaled, int(part), came_s) if stretch == 0 else None)
            self.time_s[begin:end] = line.at(self.number[begin:end] / self._rate_hz)
            yield _Stretch(begin, end, line, f"{part}.{stretch}")

    def _windows(self, stretch: _Stretch) -> Iterator[tuple[int, int]]:
        """Return the frames of windows of about the same length."""
        frames = stretch.end - stretch.begin
        pieces = max(1, round(frames * self._setup.frame / (WINDOW_S * self._rate_hz)))
        edges = np.linspace(stretch.begin, stretch.end, pieces + 1).astype(int).tolist()
        yield from pairwise(edges)

    def _until(self, stretch: _Stretch, end: int) -> float:
        return np.inf if end == stretch.end else float(self.time_s[end])

    def _window(
        self, stretch: _Stretch, begin: int, end: int, views: Sequence[View]
    ) -> Iterator[tuple[View, Demodulated]]:
        """Return the readings of every sensor in a window and slightly beyond."""
        low, high = max(begin - OVERLAP, stretch.begin), min(end + OVERLAP, stretch.end)
        frame = self._setup.frame
        volts = volts_of(self._counts[low * frame : high * frame], self._coefficients)
        taken_s = (self.number[low] + np.arange(len(volts))) / self._rate_hz
        try:
            wired = {one: None for view in views for one in inputs_of(view, self._header)[: len(view.inputs)]}
            seen, place = seen_by(self._setup, wired)
            clock = clock_of(taken_s, volts[:, seen], self._setup, self._switch_hz)
            for view in views:
                yield view, self._subtracted(volts, taken_s, clock, place, stretch.line, view)
        except DataError as bad:
            span = f"{self.time_s[begin]:.1f} to {self.time_s[end - 1]:.1f} s"
            self.remarks.append(warning(f"no readings from {span}: {bad}"))

    def _subtracted(
        self, volts: FloatArray, taken_s: FloatArray, clock: Clock, place: float, line: ClockLine, view: View
    ) -> Demodulated:
        """Return the readings of a sensor's inputs, and of the load cell.

        A sample is used if all are in the same phase.

        ``place`` is the index of the channel whose conversions the clock's phase refers to.
        """
        inputs = inputs_of(view, self._header)
        own = inputs[: len(view.inputs)]
        delays = self._convert_s * (np.array(own) - place)
        each = [states(clock, delay, 1e-6 * self._setup.settle_us, self._setup.emitters) for delay in delays]
        time = line.at(taken_s + self._convert_s * float(np.mean(own)))
        low, high = self._limits[:, inputs]
        state = np.where(np.ptp(each, axis=0) == 0, each[0], -1)
        return subtract(slots_of(time, volts[:, inputs], state, limits=(low, high)))


def create_variable(
    group: Any, name: str, dims: tuple[str, ...], shape: tuple[int, ...], dtype: Any, unit: str, text: str, rows: int
) -> Any:
    """Create a variable of a netCDF file, compressed in chunks of the given number of rows, to be filled."""
    kept = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if shape[0] else {}
    chunks = (min(shape[0], rows), *shape[1:]) if shape[0] else None
    variable = group.create_variable(name, dims, dtype, chunks=chunks, **kept)
    variable.attrs["units"] = unit
    variable.attrs["long_name"] = text
    return variable
