"""Decoding of a stream with a saved calibration: rows of angles as readings arrive, and a summary at the end.

Public names: `StreamDecoder` and `Decoding`.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from solen.analysis.calibration.conditions import ConditionOptions, conditions
from solen.analysis.calibration.counted_stream import CountedStream
from solen.analysis.calibration.cross_validation import merged, part_of
from solen.analysis.calibration.decoder import Decoded, Decoder
from solen.analysis.calibration.file import CalibrationFile, Part, differences
from solen.analysis.calibration.heading import WINDOW_S, Headings, Tracker
from solen.analysis.calibration.streams import Batch, Stream
from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError, SpecError
from solen.ranks import DO_NOT_USE, Caution, do_not_use, note, prefixed, rank_of, warning
from solen.recording import Provenance
from solen.recording.stimulus import ANGLE, STIMULI, Name
from solen.results import Result
from solen.spec.strict import Finite
from solen.units import factor

COLUMNS = (
    "time_s",
    "angle_deg",
    "low68_deg",
    "high68_deg",
    "low95_deg",
    "high95_deg",
    "direction",
    "probability",
    "heading",
    "rises",
    "flags",
    "other",
)
SIDES = ("direction", "probability")
"""Columns that apply to angles only, because a force or depth has no sides."""
FLAGS = ("outside", "ambiguous", "clipped", "at_end")
_MEANING = {
    "outside": "do not lie on the calibrated curve, so their {plural} are meaningless",
    "ambiguous": "are consistent with several {plural}",
    "clipped": "are clipped, so their {name} depends on a single receiver",
    "missing": "lack the voltage of a receiver",
}


class DecodeOptions(ConditionOptions):
    """Options for decoding a stream."""

    sensor: str | None = None
    """Sensor in the source to decode; default: the calibrated sensor."""
    follow: bool = False
    """Follow a journal while it grows, until its run ends."""
    gain_percent: Finite = Field(0.0, ge=0)
    """Allow for a common change in the light with this standard deviation in per cent, e.g. for an emitter that
    ages.
    """
    window_ms: Finite = Field(1e3 * WINDOW_S, ge=0)
    """Time window from which the heading (rising or falling) is determined."""


class Decoding(Result):
    """Summary of a decoded stream.

    Attributes
    ----------
    readings, missing
        Number of decoded readings, and of readings that lack a voltage.
    outside, ambiguous, clipped, at_end
        Number of readings with these flags, as in `solen.analysis.calibration.decoder.Decoded`.
    from_s, to_s
        Times of the first and the last reading.
    stimulus
        Decoded quantity: ``angle``, ``force`` or ``depth``. Keys end in its unit.
    lowest_deg, highest_deg
        Range of the decoded angles of readings that lie on the curve; None if there are none.
    against_angle
        Errors relative to the angle recorded in the source, if any, within the calibrated range.
    calibration, calibrated_sensor
        Calibration file, and the sensor it calibrates.
    sensor
        Sensor in the source; None if unknown.
    simulated
        Whether the calibration or the source is simulated.
    interrupted
        Whether the stream was ended with Ctrl-C.
    sources
        The recording.
    warnings
        Warnings.
    """

    readings: int
    missing: int
    outside: int
    ambiguous: int
    clipped: int
    at_end: int
    from_s: float
    to_s: float
    stimulus: Name
    lowest_deg: float | None
    highest_deg: float | None
    against_angle: Part | None
    calibration: str
    calibrated_sensor: str
    sensor: str | None
    simulated: bool
    interrupted: bool
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data; keys end in the unit of the decoded quantity."""
        return STIMULI[self.stimulus].keyed(super().to_dict())


class StreamDecoder(CountedStream[CalibrationFile]):
    """Decoder of a stream that also counts its readings.

    Parameters
    ----------
    known, file
        The calibration, and the name of its file.
    stream
        Source of the readings.
    options
        Decoding options.
    rails
        Lowest and highest voltage of the recorder, used instead of the calibration's limits.
    source
        Name of the stream in error messages.

    Raises
    ------
    SpecError
        If a gain change is allowed for but the voltage without light is unknown.
    """

    def __init__(
        self,
        known: CalibrationFile,
        file: str,
        stream: Stream,
        options: DecodeOptions,
        rails: tuple[float, float] | None,
        source: str,
    ) -> None:
        if options.gain_percent and known.dark_V is None:
            limit = "requires the voltage without light, which the calibration does not contain"
            remedy = "calibrate with --dark-V"
            raise SpecError("--gain-percent", value=options.gain_percent, limit=limit, remedy=remedy)
        scale = factor(stream.unit, known.unit)
        if scale is None:
            limit = f"is the unit of the readings, but the unit of the calibration {file} is {known.unit}"
            remedy = (
                f"specify the unit of the readings in the header, as in left ({known.unit}), "
                "or calibrate with readings in their unit"
            )
            raise DataError(source, value=stream.unit, limit=limit, remedy=remedy)
        calibration = known.calibration
        largest = float(np.abs(calibration.curves_V).max())
        super().__init__(known, file, source, stream.provenance, largest, FLAGS)
        self._stream, self._scale = stream, scale
        self._decoder = Decoder(calibration, gain_percent=options.gain_percent, dark_V=known.dark_V or 0.0)
        self._tracker = Tracker(1e-3 * options.window_ms)
        self._middle_V = calibration.curves_V.mean(axis=(0, 1))
        self._rails = calibration.rails_V if rails is None else np.array([rails] * 2)
        self._range_deg = (math.inf, -math.inf)
        self._parts: list[Part] = []
        self.warnings = (*stream.warnings, *_condition_warnings(known, stream, options))

    @property
    def header(self) -> str:
        """Header line with the column names."""
        stimulus = self._known.stimulus_of
        names = [name for name in COLUMNS if stimulus is ANGLE or name not in SIDES]
        return ",".join(stimulus.keyed(dict.fromkeys(names))) + "\n"

    def rows(self, batch: Batch) -> str:
        """Decode a batch into CSV lines with the columns `COLUMNS`; `DataError` if the batch is in another unit."""
        batch = replace(batch, volts=self._scale * batch.volts)
        good = np.asarray(np.isfinite(batch.volts).all(axis=1))
        self._check_scale(batch.volts[good], "left_mV")
        decoded = self._decoder.decode(batch.volts[good], self._marks(batch, good))
        noise = self._decoder.noise_deg(decoded.angle_deg)
        headings = self._tracker.of(batch.time_s[good], decoded.angle_deg, noise)
        self._count(batch, good, decoded)
        return "".join(_rows(batch.time_s, good, decoded, headings, sides=self._known.stimulus_of is ANGLE))

    def _marks(self, batch: Batch, good: BoolArray) -> NDArray[np.int8]:
        """Return 1 for a reading at the upper limit of the recorder, −1 at the lower limit, otherwise 0."""
        volts = batch.volts[good]
        marks = np.zeros(volts.shape, dtype=np.int8)
        if batch.clipped is not None:
            marks[batch.clipped[good]] = 1
            marks *= np.where(volts >= self._middle_V, 1, -1).astype(np.int8)
        marks[volts >= np.nan_to_num(self._rails[:, 1], nan=np.inf)] = 1
        marks[volts <= np.nan_to_num(self._rails[:, 0], nan=-np.inf)] = -1
        return marks

    def _count(self, batch: Batch, good: BoolArray, decoded: Decoded) -> None:
        self._count_readings(batch.time_s, good, {name: getattr(decoded, name) for name in FLAGS})
        if not good.any():
            return
        inside = decoded.angle_deg[~decoded.outside]
        low, high = self._range_deg
        self._range_deg = float(inside.min(initial=low)), float(inside.max(initial=high))
        if batch.angle_deg is not None:
            true, (start, end) = batch.angle_deg[good], self._decoder.range_deg
            kept = (true >= start) & (true <= end)
            if kept.any():
                self._parts.append(part_of("source", true[kept], decoded.selected(np.flatnonzero(kept))))

    def result(self, *, interrupted: bool) -> Decoding:
        """Return the summary of the decoded stream; raise `DataError` if there was no reading."""
        if not self.counts["readings"]:
            raise DataError(self._source, limit="holds no reading", remedy="check its columns")
        low, high = self._range_deg
        meanings = {name: text.format_map(vars(self._known.stimulus_of)) for name, text in _MEANING.items()}
        return Decoding(
            **self.counts,
            from_s=self._times_s[0],
            to_s=self._times_s[1],
            stimulus=self._known.stimulus,
            lowest_deg=low if math.isfinite(low) else None,
            highest_deg=high if math.isfinite(high) else None,
            against_angle=merged("source", self._parts) if self._parts else None,
            calibration=self._file,
            calibrated_sensor=self._known.sensor,
            sensor=self._stream.sensor,
            simulated=self._simulated,
            interrupted=interrupted,
            sources=() if self._provenance is None else (self._provenance,),
            warnings=(*self.warnings, *self._flag_warnings(meanings, always=("missing",)), *self._cell_notes()),
        )

    def _cell_notes(self) -> Iterator[Caution]:
        """Yield the note on the error that a comparison with the recorded force does not show."""
        cell = self._known.load_cell
        if self._parts and cell is not None and cell.u_scale is not None:
            yield note(cell.shared)


def _condition_warnings(known: CalibrationFile, stream: Stream, options: DecodeOptions) -> Iterator[Caution]:
    """Yield warnings if the calibration must not be used, differs from the source, or cannot be compared with the source."""
    yield from (prefixed("calibration", line) for line in known.warnings if rank_of(line) == DO_NOT_USE)
    motion, circuit = conditions(stream.sensor or known.sensor, stream.provenance, options, stream.ambient)
    other, unknown = differences(known, motion, circuit)
    moved = bool(other)
    if len(known.prints) == 1 and stream.sensor is not None and _last(stream.sensor) != _last(known.sensor):
        if stream.named:
            other.insert(0, f"sensor {stream.sensor} instead of {known.sensor}")
        else:
            yield note(
                f"{stream.sensor} is only a file name, so the recording is decoded as the calibrated sensor "
                f'{known.sensor}; use --sensor "{stream.sensor}" if it is a different sensor'
            )
    if other:
        yield do_not_use(f"the recording does not match the calibration: {'; '.join(other)}")
    if unknown and not moved:
        yield warning(
            "it cannot be checked whether the calibration applies to this motion, because the recording does "
            f"not specify the {', '.join(unknown)}; "
            "specify it with --design or --motion"
        )
    if known.simulated and not stream.simulated and stream.provenance is not None:
        yield do_not_use("the calibration is simulated, but the recording is not")


def _last(name: str) -> str:
    """Return the sensor name without the file name."""
    return name.rpartition(".")[2]


def _rows(time_s: FloatArray, good: BoolArray, decoded: Decoded, headings: Headings, *, sides: bool) -> Iterator[str]:
    """Yield a line for each reading, with the columns `COLUMNS`."""
    others: dict[int, list[str]] = {}
    for row, (low, high), share in zip(
        decoded.other.tolist(), decoded.other_deg.tolist(), decoded.other_probability.tolist(), strict=True
    ):
        others.setdefault(row, []).append(f"{low:.5f}..{high:.5f} ({share:.2f})")
    columns = (
        decoded.angle_deg.tolist(),
        decoded.low_deg.tolist(),
        decoded.high_deg.tolist(),
        decoded.right.tolist(),
        headings.words(),
        headings.rises.tolist(),
        _flags(decoded),
    )
    readings = enumerate(zip(*columns, strict=True))
    for stamp, held in zip(time_s.tolist(), good.tolist(), strict=True):
        when = f"{stamp:.6f}" if math.isfinite(stamp) else ""
        if not held:
            yield f"{when},,,,,,{',,' * sides},,missing,\n"
            continue
        number, (angle, low, high, right, heading, rises, flags) = next(readings)
        side, share = ("right", right) if right >= 0.5 else ("left", 1.0 - right)
        aside = f"{side},{share:.3f}," if sides else ""
        yield (
            f"{when},{angle:.5f},{low[0]:.5f},{high[0]:.5f},{low[1]:.5f},{high[1]:.5f},"
            f"{aside}{heading},{rises:.3f},{flags},{' '.join(others.get(number, ()))}\n"
        )


def _flags(decoded: Decoded) -> list[str]:
    marks = np.column_stack([getattr(decoded, name) for name in FLAGS])
    texts = [
        " ".join(name for place, name in enumerate(FLAGS) if number >> place & 1) for number in range(2 ** len(FLAGS))
    ]
    return [texts[number] for number in (marks @ (1 << np.arange(len(FLAGS)))).tolist()]
