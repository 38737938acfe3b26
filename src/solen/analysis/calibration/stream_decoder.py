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
"""Columns that apply only to angles, because a force or depth has no sides."""
FLAGS = ("outside", "ambiguous", "clipped", "at_end")
_MEANINGS = {
    "outside": "are not on the calibrated curve, so their {plural} are meaningless",
    "ambiguous": "match several {plural}",
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
    """Standard deviation, in per cent, of a common change in the light that the bands include, e.g. for an emitter that
    ages.
    """
    window_ms: Finite = Field(1e3 * WINDOW_S, ge=0)
    """Time window from which the heading (rising or falling) is determined."""


class Decoding(Result):
    """Summary of a decoded stream.

    Attributes
    ----------
    readings, missing
        Number of readings that were decoded, and of readings that lack a voltage.
    outside, ambiguous, clipped, at_end
        Number of readings with these flags, as in `solen.analysis.calibration.decoder.Decoded`.
    from_s, to_s
        Times of the first and the last reading.
    stimulus
        Decoded quantity: ``angle``, ``force`` or ``depth``. Keys end in its unit.
    lowest_deg, highest_deg
        Range of the decoded angles of readings on the curve; None if there are none.
    against_angle
        Errors relative to the recorded angle, within the calibrated range; None if no angle was recorded.
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
    """Decoder of a stream of readings, which counts them and their flags.

    Parameters
    ----------
    calibration, file
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
        If ``gain_percent`` is specified but the voltage without light is unknown.
    DataError
        If the unit of the readings cannot be converted to that of the calibration.
    """

    def __init__(
        self,
        calibration: CalibrationFile,
        file: str,
        stream: Stream,
        options: DecodeOptions,
        rails: tuple[float, float] | None,
        source: str,
    ) -> None:
        if options.gain_percent and calibration.dark_V is None:
            limit = "requires the voltage without light, which the calibration does not contain"
            remedy = "calibrate with --dark-V"
            raise SpecError("--gain-percent", value=options.gain_percent, limit=limit, remedy=remedy)
        scale = factor(stream.unit, calibration.unit)
        if scale is None:
            limit = f"contains readings in {stream.unit}, but the calibration {file} is in {calibration.unit}"
            remedy = f"correct the unit in the header, as in left ({calibration.unit}), or calibrate in {stream.unit}"
            raise DataError(source, limit=limit, remedy=remedy)
        model = calibration.calibration
        largest = float(np.abs(model.curves_V).max())
        super().__init__(calibration, file, source, stream.provenance, largest, FLAGS)
        self._stream, self._scale = stream, scale
        self._decoder = Decoder(model, gain_percent=options.gain_percent, dark_V=calibration.dark_V or 0.0)
        self._tracker = Tracker(1e-3 * options.window_ms)
        self._middle_V = model.curves_V.mean(axis=(0, 1))
        self._rails = model.rails_V if rails is None else np.array([rails] * 2)
        self._range_deg = (math.inf, -math.inf)
        self._parts: list[Part] = []
        self.warnings = (*stream.warnings, *_condition_warnings(calibration, stream, options))

    @property
    def header(self) -> str:
        """Header line with the column names."""
        stimulus = self._calibration.stimulus_of
        names = [name for name in COLUMNS if stimulus is ANGLE or name not in SIDES]
        return ",".join(stimulus.keyed(dict.fromkeys(names))) + "\n"

    def rows(self, batch: Batch) -> str:
        """Decode a batch into CSV lines with the columns `COLUMNS`; raise `DataError` if it is in another unit."""
        batch = replace(batch, volts=self._scale * batch.volts)
        complete = np.asarray(np.isfinite(batch.volts).all(axis=1))
        self._check_scale(batch.volts[complete], "left_mV")
        decoded = self._decoder.decode(batch.volts[complete], self._marks(batch, complete))
        noise = self._decoder.noise_deg(decoded.angle_deg)
        headings = self._tracker.of(batch.time_s[complete], decoded.angle_deg, noise)
        self._count(batch, complete, decoded)
        return "".join(_rows(batch.time_s, complete, decoded, headings, sides=self._calibration.stimulus_of is ANGLE))

    def _marks(self, batch: Batch, complete: BoolArray) -> NDArray[np.int8]:
        """Return 1 for a reading at the upper limit of the recorder, −1 at the lower limit, otherwise 0."""
        volts = batch.volts[complete]
        marks = np.zeros(volts.shape, dtype=np.int8)
        if batch.clipped is not None:
            marks[batch.clipped[complete]] = 1
            marks *= np.where(volts >= self._middle_V, 1, -1).astype(np.int8)
        marks[volts >= np.nan_to_num(self._rails[:, 1], nan=np.inf)] = 1
        marks[volts <= np.nan_to_num(self._rails[:, 0], nan=-np.inf)] = -1
        return marks

    def _count(self, batch: Batch, complete: BoolArray, decoded: Decoded) -> None:
        self._count_readings(batch.time_s, complete, {name: getattr(decoded, name) for name in FLAGS})
        if not complete.any():
            return
        on_curve = decoded.angle_deg[~decoded.outside]
        low, high = self._range_deg
        self._range_deg = float(on_curve.min(initial=low)), float(on_curve.max(initial=high))
        if batch.angle_deg is not None:
            true, (start, end) = batch.angle_deg[complete], self._decoder.range_deg
            kept = (true >= start) & (true <= end)
            if kept.any():
                self._parts.append(part_of("source", true[kept], decoded.selected(np.flatnonzero(kept))))

    def result(self, *, interrupted: bool) -> Decoding:
        """Return the summary of the decoded stream; raise `DataError` if there was no reading."""
        if not self.counts["readings"]:
            raise DataError(self._source, limit="contains no reading", remedy="check its columns")
        low, high = self._range_deg
        meanings = {name: text.format_map(vars(self._calibration.stimulus_of)) for name, text in _MEANINGS.items()}
        return Decoding(
            **self.counts,
            from_s=self._times_s[0],
            to_s=self._times_s[1],
            stimulus=self._calibration.stimulus,
            lowest_deg=low if math.isfinite(low) else None,
            highest_deg=high if math.isfinite(high) else None,
            against_angle=merged("source", self._parts) if self._parts else None,
            calibration=self._file,
            calibrated_sensor=self._calibration.sensor,
            sensor=self._stream.sensor,
            simulated=self._simulated,
            interrupted=interrupted,
            sources=() if self._provenance is None else (self._provenance,),
            warnings=(*self.warnings, *self._flag_warnings(meanings, always=("missing",)), *self._cell_notes()),
        )

    def _cell_notes(self) -> Iterator[Caution]:
        """Yield a note on the load cell errors that a comparison with the recorded forces does not show."""
        cell = self._calibration.load_cell
        if self._parts and cell is not None and cell.u_scale is not None:
            yield note(cell.shared)


def _condition_warnings(calibration: CalibrationFile, stream: Stream, options: DecodeOptions) -> Iterator[Caution]:
    """Yield warnings if the calibration must not be used, or its conditions differ from the source or are unknown."""
    yield from (prefixed("calibration", caution) for caution in calibration.warnings if rank_of(caution) == DO_NOT_USE)
    motion, circuit = conditions(stream.sensor or calibration.sensor, stream.provenance, options, stream.ambient)
    different, unknown = differences(calibration, motion, circuit)
    same_conditions = not different
    if len(calibration.prints) == 1 and stream.sensor is not None and _last(stream.sensor) != _last(calibration.sensor):
        if stream.named:
            different.insert(0, f"sensor {stream.sensor} instead of {calibration.sensor}")
        else:
            yield note(
                f"{stream.sensor} is only a file name, so the recording is decoded as the calibrated sensor "
                f'{calibration.sensor}; use --sensor "{stream.sensor}" if it is a different sensor'
            )
    if different:
        yield do_not_use(f"the recording does not match the calibration: {'; '.join(different)}")
    if unknown and same_conditions:
        yield warning(
            f"the recording does not specify the {' and the '.join(unknown)}, so that it cannot be checked whether the "
            "calibration applies to its motion; use --design with the design file of the sensor, or --motion"
        )
    if calibration.simulated and not stream.simulated and stream.provenance is not None:
        yield do_not_use("the calibration is simulated, but the recording is not")


def _last(name: str) -> str:
    """Return the sensor name without the file name."""
    return name.rpartition(".")[2]


def _rows(
    time_s: FloatArray, complete: BoolArray, decoded: Decoded, headings: Headings, *, sides: bool
) -> Iterator[str]:
    """Yield a line for each reading, with the columns `COLUMNS`."""
    others: dict[int, list[str]] = {}
    for row, (low, high), probability in zip(
        decoded.other.tolist(), decoded.other_deg.tolist(), decoded.other_probability.tolist(), strict=True
    ):
        others.setdefault(row, []).append(f"{low:.5f}..{high:.5f} ({probability:.2f})")
    columns = (
        decoded.angle_deg.tolist(),
        decoded.low_deg.tolist(),
        decoded.high_deg.tolist(),
        decoded.right.tolist(),
        headings.labels(),
        headings.rises.tolist(),
        _flags(decoded),
    )
    readings = enumerate(zip(*columns, strict=True))
    for seconds, decodable in zip(time_s.tolist(), complete.tolist(), strict=True):
        time = f"{seconds:.6f}" if math.isfinite(seconds) else ""
        if not decodable:
            yield f"{time},,,,,,{',,' * sides},,missing,\n"
            continue
        index, (angle, low, high, right, heading, rises, flags) = next(readings)
        side, probability = ("right", right) if right >= 0.5 else ("left", 1.0 - right)
        direction = f"{side},{probability:.3f}," if sides else ""
        yield (
            f"{time},{angle:.5f},{low[0]:.5f},{high[0]:.5f},{low[1]:.5f},{high[1]:.5f},"
            f"{direction}{heading},{rises:.3f},{flags},{' '.join(others.get(index, ()))}\n"
        )


def _flags(decoded: Decoded) -> list[str]:
    """Return the names of the flags of each reading, separated by spaces."""
    flags = zip(*(getattr(decoded, name).tolist() for name in FLAGS), strict=True)
    return [" ".join(name for name, is_set in zip(FLAGS, row, strict=True) if is_set) for row in flags]
