"""Reading of the sampler during a run: periods of a board, frames of a DAQ device, or readings of a meter.

The loop of a run is independent of the kind of sampler. Each kind supplies rows for its stream of the journal, the
number of the last row, and values to display. The samples of a DAQ device are grouped into frames of about a period of
the emitters; each frame has the index of its first sample, which locates every sample. An incomplete frame is kept
until the next reading.

Public names: `sampling_of` and `Block`.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.bench.daq import volts_of
from solen.bench.journal_content import Rows
from solen.bench.roles import ClockedBoard, Daq, EmitterBoard, Meter, Sampler

Counts = NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class Block:
    """Data from one reading of a sampler.

    Attributes
    ----------
    rows
        Rows of the stream; the caller sets their ``part``.
    progress
        For the stream ``came``: number of the last period or reading, or segment and end of the last frame.
    last
        Counts of the last period for display, on and off, (emitters, 2, inputs); None if nothing arrived.
    notices
        Events of the instrument.
    """

    rows: Rows
    progress: tuple[int, ...]
    last: Counts | None
    notices: tuple[str, ...] = ()


class BoardSampling:
    """Periods of a board."""

    stream = "board"

    def __init__(self, board: EmitterBoard) -> None:
        self._board = board
        self._rows = self.streams()["board"]

    def header(self) -> dict[str, Any]:
        """Return the entries of the board in the header of a journal."""
        board = self._board
        return {
            "period_s": board.period_s,
            "volts_per_count": board.volts_per_count,
            "emitters": board.layout.emitters,
            "receivers": board.layout.receivers,
            "board": board.name,
        }

    def streams(self) -> dict[str, np.dtype[np.void]]:
        """Return the structured types of the periods and of their arrivals."""
        counts = (self._board.layout.emitters, 2, self._board.layout.receivers)
        return {
            "board": np.dtype(
                [("part", "<u2"), ("number", "<i8"), ("board_us", "<i8"), ("flags", "u1"), ("counts", "<u2", counts)]
            ),
            "came": np.dtype([("part", "<u2"), ("t_s", "<f8"), ("number", "<i8")]),
        }

    def start(self) -> float | None:
        """Start sampling; return None, because the board determines when the first period begins."""
        self._board.start()
        return None

    def time_s(self) -> float | None:
        """Return the time of the board clock; NaN if the reply contains no time, None if it cannot be queried."""
        return self._board.time_s() if isinstance(self._board, ClockedBoard) else None

    def read(self) -> Block:
        """Return the periods since the last call."""
        periods = self._board.read()
        rows = np.zeros(len(periods), self._rows)
        for name in ("number", "board_us", "flags", "counts"):
            rows[name] = getattr(periods, name)
        if len(periods) == 0:
            return Block(rows, (), None)
        return Block(rows, (int(periods.number[-1]),), periods.counts[-1])

    def level_V(self, rows: Rows, index: int) -> float:
        """Return the mean level of an input in the last period, over on and off, in V."""
        return float(rows["counts"][-1][..., index].mean() * self._board.volts_per_count)


class DaqSampling:
    """Frames of samples of a DAQ device."""

    stream = "samples"

    def __init__(self, daq: Daq) -> None:
        self._daq = daq
        self._frame, self._rows = daq.setup.frame, self.streams()["samples"]
        self._remainder = np.zeros((0, len(daq.setup.channels)), np.int16)
        self._segment = 0

    def header(self) -> dict[str, Any]:
        """Return the entries of the device in the header of a journal."""
        daq = self._daq
        limits = getattr(daq, "limits_V", None)  # limits of an ADC with fewer than 16 bits
        return {
            "daq": {
                "name": daq.name,
                "setup": asdict(daq.setup),
                "rate_hz": daq.rate_hz,
                "switch_hz": daq.switch_hz,
                "convert_s": daq.convert_s,
                "coefficients": daq.coefficients.tolist(),
                "limits_V": None if limits is None else limits.tolist(),
            },
            "bulky": ["samples"],
        }

    def streams(self) -> dict[str, np.dtype[np.void]]:
        """Return the structured types of the frames and of their arrivals."""
        counts = (self._daq.setup.frame, len(self._daq.setup.channels))
        return {
            "samples": np.dtype([("part", "<u2"), ("stretch", "<u2"), ("number", "<i8"), ("counts", "<i2", counts)]),
            "came": np.dtype([("part", "<u2"), ("t_s", "<f8"), ("stretch", "<u2"), ("number", "<i8")]),
        }

    def start(self) -> float | None:
        """Start sampling; return 0, the device's time of the first sample, which is taken within this call."""
        self._daq.start()
        return 0.0

    def time_s(self) -> float | None:
        """Return None: the device has no clock that could be queried."""
        return None

    def read(self) -> Block:
        """Return the complete frames since the last call."""
        samples = self._daq.read()
        if samples.segment != self._segment:
            self._remainder, self._segment = self._remainder[:0], samples.segment
        first = samples.first - len(self._remainder)
        counts = np.concatenate([self._remainder, samples.counts])
        frames = len(counts) // self._frame
        rows = np.zeros(frames, self._rows)
        rows["stretch"], rows["number"] = samples.segment, first + self._frame * np.arange(frames)
        rows["counts"] = counts[: frames * self._frame].reshape(rows["counts"].shape)
        self._remainder = counts[frames * self._frame :]
        if frames == 0:
            return Block(rows, (), None, samples.notices)
        extremes = np.stack([rows["counts"][-1].min(axis=0), rows["counts"][-1].max(axis=0)])
        last = np.maximum(extremes, 0).astype(np.uint16)[None, :, : self._daq.setup.inputs]
        return Block(rows, (samples.segment, samples.first + len(samples.counts)), last, samples.notices)

    def level_V(self, rows: Rows, index: int) -> float:
        """Return the mean level of an input in the last frame, in V."""
        return float(volts_of(rows["counts"][-1], self._daq.coefficients)[:, index].mean())


class MeterSampling:
    """Readings of a meter."""

    stream = "meter"

    def __init__(self, meter: Meter) -> None:
        self._meter, self._number = meter, 0
        self._rows = self.streams()["meter"]

    def header(self) -> dict[str, Any]:
        """Return the entries of the meter in the header of a journal."""
        meter = self._meter
        entry = {"name": meter.name, "inputs": meter.inputs, "unit": meter.unit, "switched": meter.switched}
        return {"meter": entry}

    def streams(self) -> dict[str, np.dtype[np.void]]:
        """Return the structured types of the readings and of their arrivals."""
        shape = (self._meter.inputs,)
        values = [("on", "<f8", shape), ("off", "<f8", shape), ("clipped", "u1", shape)]
        return {
            "meter": np.dtype([("part", "<u2"), ("sent_s", "<f8"), ("t_s", "<f8"), *values]),
            "came": np.dtype([("part", "<u2"), ("t_s", "<f8"), ("number", "<i8")]),
        }

    def start(self) -> float | None:
        """Start measuring; return None, because readings are timestamped by the run's clock."""
        self._meter.start()
        return None

    def time_s(self) -> float | None:
        """Return None: a meter has no clock."""
        return None

    def read(self) -> Block:
        """Return the readings since the last call; they are not displayed during the run."""
        readings = self._meter.read()
        rows = np.zeros(len(readings), self._rows)
        for name in ("sent_s", "t_s", "on", "off", "clipped"):
            for row, reading in enumerate(readings):
                rows[name][row] = getattr(reading, name)
        self._number += len(readings)
        dark = np.zeros((1, 2, self._meter.inputs), np.uint16) if readings else None
        return Block(rows, (self._number,), dark)

    def level_V(self, rows: Rows, index: int) -> float:
        """Return the last reading of an input: the mean of on and off if both are known."""
        return float(np.nanmean([rows["on"][-1, index], rows["off"][-1, index]]))


def sampling_of(sampler: Sampler) -> BoardSampling | DaqSampling | MeterSampling:
    """Return the object that reads a sampler during a run, of the class for a board, a DAQ device or a meter."""
    if isinstance(sampler, Daq):
        return DaqSampling(sampler)
    return MeterSampling(sampler) if isinstance(sampler, Meter) else BoardSampling(sampler)
