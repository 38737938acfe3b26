"""The samples of a DAQ device, copied from a journal to a file, and the readings computed from them.

Samples may need far more space than the memory has. They are copied from the journal to the file as counts, record by
record; then the file is read again window by window, and the emitter phases and the readings are determined in each.
Windows overlap, and each yields the readings after the last one of the window before: none is lost or repeated at a
border, even though the edges found in two windows differ slightly.

Public names: `Waveform`, whose `Waveform.readings` yields the readings of each sensor, and `create_variable`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from solen.analysis.demodulation import Clock, Demodulated, slots_of, subtract
from solen.arrays import BoolArray, FloatArray
from solen.bench.clock_fit import ClockLine, fit_clock
from solen.bench.daq import Setup, limits_of, volts_of
from solen.bench.journal_content import JournalContent, Rows
from solen.bench.phases import clock_channels, clock_of, states
from solen.bench.readings import View, inputs_of
from solen.bench.timing import exchanges, latest_arrival_s
from solen.errors import DataError
from solen.ranks import Caution, warning

WINDOW_S = 10.0
"""Duration in s of the samples that are processed at once."""
CHUNK = 1 << 14
"""Number of samples that are compressed together."""
OVERLAP = 4
"""Number of frames, of about one period each, by which a window extends beyond its borders."""


@dataclass(frozen=True)
class _Segment:
    """Frames without a gap: begin and end index, the line of their clock, and a name from part and segment."""

    begin: int
    end: int
    line: ClockLine
    name: str


class Waveform:
    """The samples of a journal, copied to a file.

    Parameters
    ----------
    file
        An open netCDF file; ``counts`` are written to its root group.
    journal
        The journal.

    Attributes
    ----------
    part, segment, number
        For each frame, (F,): part of the run, gapless segment, and index of its first sample in that segment.
    time_s
        Time of the first sample of each frame on the clock of the run, (F,).
    cautions
        Warnings of windows without readings, with the reason.
    """

    def __init__(self, file: Any, journal: JournalContent) -> None:
        self._header, daq = journal.header, journal.header["daq"]
        self._setup = Setup(**daq["setup"] | {"channels": tuple(daq["setup"]["channels"])})
        self._rate_hz, self._switch_hz, self._convert_s = daq["rate_hz"], daq["switch_hz"], daq["convert_s"]
        self._coefficients = np.array(daq["coefficients"])
        self._limits = limits_of(self._coefficients, daq.get("limits_V"))
        self.cautions: list[Caution] = []
        frames = journal.counts["samples"]
        self.part, self.segment = np.zeros(frames, np.uint16), np.zeros(frames, np.uint16)
        self.number, self.time_s = np.zeros(frames, np.int64), np.zeros(frames)
        shape = frames * self._setup.frame, len(self._setup.channels)
        file.dimensions = {"sample": shape[0], "channel": shape[1]}
        text = "ADC counts; volts = sum of coefficients * counts^power"
        self._counts = create_variable(file, "counts", ("sample", "channel"), shape, np.int16, "1", text, CHUNK)
        self._counts.attrs["channels"] = " ".join(self._setup.channels)
        self._copy(journal)
        self._segments = list(self._find_segments(journal))

    @property
    def lines(self) -> dict[str, ClockLine]:
        """Linear conversions from device time to run time, keyed by segment name."""
        return {segment.name: segment.line for segment in self._segments}

    def readings(self, views: Sequence[View]) -> Iterator[tuple[View, Demodulated, BoolArray]]:
        """Yield the readings of each sensor under each emitter, window by window, and which of them are new."""
        last: dict[str, float] = {}
        half_period_s = 0.5 / self._setup.switch_hz
        for segment in self._segments:
            for begin, end in self._windows(segment):
                until_s = np.inf if end == segment.end else float(self.time_s[end])
                for view, readings in self._window(segment, begin, end, views):
                    new = readings.of(view.emitter) & (readings.time_s < until_s)
                    new &= readings.time_s > last.get(view.name, -np.inf) + half_period_s
                    if new.any():
                        last[view.name] = float(readings.time_s[new][-1])
                    yield view, readings, new

    def _copy(self, journal: JournalContent) -> None:
        """Write the counts to the file, record by record, and store part, segment and number of each frame."""
        first, frame = 0, self._setup.frame
        for rows in journal.blocks("samples"):
            end = first + len(rows)
            self.part[first:end], self.segment[first:end] = rows["part"], rows["stretch"]
            self.number[first:end] = rows["number"]
            self._counts[first * frame : end * frame] = rows["counts"].reshape(-1, len(self._setup.channels))
            first = end

    def _find_segments(self, journal: JournalContent) -> Iterator[_Segment]:
        """Yield the segments in order, and store the times of their frames."""
        arrivals = journal.streams["came"]
        identity = np.stack([self.part, self.segment], axis=1).astype(np.int64)
        jumps = np.diff(self.number) != self._setup.frame  # a damaged journal lacks frames
        edges = (np.flatnonzero(np.diff(identity, axis=0).any(axis=1) | jumps) + 1).tolist()
        for begin, end in zip([0, *edges], [*edges, len(identity)], strict=True):
            if begin == end:
                continue
            part, number = identity[begin].tolist()
            of_segment = arrivals[(arrivals["part"] == part) & (arrivals["stretch"] == number)]
            line = self._clock_line(of_segment, journal, part, number)
            self.time_s[begin:end] = line.at(self.number[begin:end] / self._rate_hz)
            yield _Segment(begin, end, line, f"{part}.{number}")

    def _clock_line(self, arrivals: Rows, journal: JournalContent, part: int, segment: int) -> ClockLine:
        """Return the line from the device's clock to the run's clock; only segment 0 has an exchange, at its start."""
        if len(arrivals) == 0:
            return ClockLine(0.0, 1.0, 0.0)
        arrival_s = latest_arrival_s(arrivals, journal)
        start = exchanges(journal, part, arrival_s) if segment == 0 else None
        return fit_clock(arrivals["number"] / self._rate_hz, arrival_s, start)

    def _windows(self, segment: _Segment) -> Iterator[tuple[int, int]]:
        """Yield the begin and end frames of windows of about the same length."""
        frames = segment.end - segment.begin
        windows = max(1, round(frames * self._setup.frame / (WINDOW_S * self._rate_hz)))
        edges = np.linspace(segment.begin, segment.end, windows + 1).astype(int).tolist()
        yield from pairwise(edges)

    def _window(
        self, segment: _Segment, begin: int, end: int, views: Sequence[View]
    ) -> Iterator[tuple[View, Demodulated]]:
        """Yield the readings of every sensor in a window and slightly beyond it."""
        low, high = max(begin - OVERLAP, segment.begin), min(end + OVERLAP, segment.end)
        frame = self._setup.frame
        volts = volts_of(self._counts[low * frame : high * frame], self._coefficients)
        sample_s = (self.number[low] + np.arange(len(volts))) / self._rate_hz
        try:
            inputs = {index: None for view in views for index in inputs_of(view, self._header)[: len(view.inputs)]}
            channels, reference = clock_channels(self._setup, inputs)
            clock = clock_of(sample_s, volts[:, channels], self._setup, self._switch_hz)
            for view in views:
                yield view, self._demodulated(volts, sample_s, clock, reference, segment.line, view)
        except DataError as bad:
            span = f"{self.time_s[begin]:.1f} to {self.time_s[end - 1]:.1f} s"
            self.cautions.append(warning(f"no readings from {span}: {bad}"))

    def _demodulated(
        self, volts: FloatArray, sample_s: FloatArray, clock: Clock, reference: float, line: ClockLine, view: View
    ) -> Demodulated:
        """Return the readings of a sensor's inputs, and of the load cell.

        A sample is used if all receivers are in the same phase. ``reference`` is the index of the channel to whose
        conversions the clock refers.
        """
        inputs = inputs_of(view, self._header)
        receivers = inputs[: len(view.inputs)]
        delays = self._convert_s * (np.array(receivers) - reference)
        each = [states(clock, delay, 1e-6 * self._setup.settle_us, self._setup.emitters) for delay in delays]
        time = line.at(sample_s + self._convert_s * float(np.mean(receivers)))
        low, high = self._limits[:, inputs]
        state = np.where(np.ptp(each, axis=0) == 0, each[0], -1)
        return subtract(slots_of(time, volts[:, inputs], state, limits=(low, high)))


def create_variable(
    group: Any, name: str, dims: tuple[str, ...], shape: tuple[int, ...], dtype: Any, unit: str, text: str, rows: int
) -> Any:
    """Create an empty variable in a netCDF group, compressed in chunks of ``rows`` rows."""
    options = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if shape[0] else {}
    chunks = (min(shape[0], rows), *shape[1:]) if shape[0] else None
    variable = group.create_variable(name, dims, dtype, chunks=chunks, **options)
    variable.attrs["units"] = unit
    variable.attrs["long_name"] = text
    return variable
