"""Reading of a run's sampler: of a board by periods, of a data acquisition by frames.

The loop of a run is independent of the kind of sampler. Each supplies rows for its journal's stream, its data so far,
and values to display. A data acquisition's samples are grouped in frames of about a period of the emitters, each with
the number of its first sample, so that a journal locates every sample; the remainder waits for the next reading.

Public names: `sampling_of` and `Taken`.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.bench.daq import volts_of
from solen.bench.journal_content import Rows
from solen.bench.roles import Daq, EmitterBoard, KeepsTime, Meter, Sampler

Counts = NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class Taken:
    """Data of one reading.

    Attributes
    ----------
    rows
        Rows of the stream; the caller fills in their ``part``.
    came
        Progress of the stream, for the stream ``came``.
    last
        Values of the last period for display, shape (emitters, 2, inputs): on and off, from 0 up; None if nothing
        arrived.
    remarks
        Events of the instrument.
    """

    rows: Rows
    came: tuple[int, ...]
    last: Counts | None
    remarks: tuple[str, ...] = ()


class BoardSampling:
    """Periods of a board."""

    stream = "board"

    def __init__(self, board: EmitterBoard) -> None:
        self._board = board
        self._rows = self.streams()["board"]

    def header(self) -> dict[str, Any]:
        """Return the board's entry in a journal's header."""
        board = self._board
        return {
            "period_s": board.period_s,
            "volts_per_count": board.volts_per_count,
            "emitters": board.layout.emitters,
            "receivers": board.layout.receivers,
            "board": board.name,
        }

    def streams(self) -> dict[str, np.dtype[np.void]]:
        """Return the columns of the board's periods, and of their times of arrival."""
        counts = (self._board.layout.emitters, 2, self._board.layout.receivers)
        return {
            "board": np.dtype(
                [("part", "<u2"), ("number", "<i8"), ("board_us", "<i8"), ("flags", "u1"), ("counts", "<u2", counts)]
            ),
            "came": np.dtype([("part", "<u2"), ("t_s", "<f8"), ("number", "<i8")]),
        }

    def start(self) -> float | None:
        """Start sampling; the board decides when the first period begins."""
        self._board.start()
        return None

    def time_s(self) -> float | None:
        """Return the board's time; NaN if its answer lacks it, None if it cannot be queried."""
        return self._board.time_s() if isinstance(self._board, KeepsTime) else None

    def read(self) -> Taken:
        """Return the periods since the last call."""
        periods = self._board.read()
        rows = np.zeros(len(periods), self._rows)
        for name in ("number", "board_us", "flags", "counts"):
            rows[name] = getattr(periods, name)
        if len(periods) == 0:
            return Taken(rows, (), None)
        return Taken(rows, (int(periods.number[-1]),), periods.counts[-1])

    def level_V(self, rows: Rows, place: int) -> float:
        """Return the mean of an input over its newest period, on and off, in V."""
        return float(rows["counts"][-1][..., place].mean() * self._board.volts_per_count)


class DaqSampling:
    """Frames of a data acquisition's samples."""

    stream = "samples"

    def __init__(self, daq: Daq) -> None:
        self._daq = daq
        self._frame, self._rows = daq.setup.frame, self.streams()["samples"]
        self._left = np.zeros((0, len(daq.setup.channels)), np.int16)
        self._stretch = 0

    def header(self) -> dict[str, Any]:
        """Return the data acquisition's entry in a journal's header."""
        daq = self._daq
        limits = getattr(daq, "limits_V", None)  # limits of a converter with fewer than 16 bits
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
        """Return the columns of the frames, and of their times of arrival."""
        counts = (self._daq.setup.frame, len(self._daq.setup.channels))
        return {
            "samples": np.dtype([("part", "<u2"), ("stretch", "<u2"), ("number", "<i8"), ("counts", "<i2", counts)]),
            "came": np.dtype([("part", "<u2"), ("t_s", "<f8"), ("stretch", "<u2"), ("number", "<i8")]),
        }

    def start(self) -> float | None:
        """Start sampling; the first sample, at time 0 of the instrument, is taken within this call."""
        self._daq.start()
        return 0.0

    def time_s(self) -> float | None:
        """Return None: the instrument's time is that of its samples."""
        return None

    def read(self) -> Taken:
        """Return the complete frames since the last call."""
        samples = self._daq.read()
        if samples.stretch != self._stretch:
            self._left, self._stretch = self._left[:0], samples.stretch
        first = samples.first - len(self._left)
        counts = np.concatenate([self._left, samples.counts])
        whole = len(counts) // self._frame
        rows = np.zeros(whole, self._rows)
        rows["stretch"], rows["number"] = samples.stretch, first + self._frame * np.arange(whole)
        rows["counts"] = counts[: whole * self._frame].reshape(rows["counts"].shape)
        self._left = counts[whole * self._frame :]
        if whole == 0:
            return Taken(rows, (), None, samples.remarks)
        ends = np.stack([rows["counts"][-1].min(axis=0), rows["counts"][-1].max(axis=0)])
        last = np.maximum(ends, 0).astype(np.uint16)[None, :, : self._daq.setup.inputs]
        return Taken(rows, (samples.stretch, samples.first + len(samples.counts)), last, samples.remarks)

    def level_V(self, rows: Rows, place: int) -> float:
        """Return the mean of an input over its newest frame, in V."""
        return float(volts_of(rows["counts"][-1], self._daq.coefficients)[:, place].mean())


class MeterSampling:
    """Readings of a meter."""

    stream = "meter"

    def __init__(self, meter: Meter) -> None:
        self._meter, self._number = meter, 0
        self._rows = self.streams()["meter"]

    def header(self) -> dict[str, Any]:
        """Return the meter's entry in a journal's header."""
        meter = self._meter
        stated = {"name": meter.name, "inputs": meter.inputs, "unit": meter.unit, "switched": meter.switched}
        return {"meter": stated}

    def streams(self) -> dict[str, np.dtype[np.void]]:
        """Return the columns of the readings, and of their number at each time of arrival."""
        of_inputs = (self._meter.inputs,)
        values = [("on", "<f8", of_inputs), ("off", "<f8", of_inputs), ("clipped", "u1", of_inputs)]
        return {
            "meter": np.dtype([("part", "<u2"), ("sent_s", "<f8"), ("t_s", "<f8"), *values]),
            "came": np.dtype([("part", "<u2"), ("t_s", "<f8"), ("number", "<i8")]),
        }

    def start(self) -> float | None:
        """Start measuring; readings are stamped by the run's clock."""
        self._meter.start()
        return None

    def time_s(self) -> float | None:
        """Return None: a meter has no clock."""
        return None

    def read(self) -> Taken:
        """Return the readings since the last call; they are not displayed during the run."""
        readings = self._meter.read()
        rows = np.zeros(len(readings), self._rows)
        for name in ("sent_s", "t_s", "on", "off", "clipped"):
            for place, reading in enumerate(readings):
                rows[name][place] = getattr(reading, name)
        self._number += len(readings)
        nothing = np.zeros((1, 2, self._meter.inputs), np.uint16) if readings else None
        return Taken(rows, (self._number,), nothing)

    def level_V(self, rows: Rows, place: int) -> float:
        """Return the newest reading of an input, the mean of on and off if both are known."""
        return float(np.nanmean([rows["on"][-1, place], rows["off"][-1, place]]))


def sampling_of(instrument: Sampler) -> BoardSampling | DaqSampling | MeterSampling:
    """Return the `Sampling` for the kind of instrument."""
    if isinstance(instrument, Daq):
        return DaqSampling(instrument)
    return MeterSampling(instrument) if isinstance(instrument, Meter) else BoardSampling(instrument)
