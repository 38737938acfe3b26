"""Decoding of a stream of network readings with a saved calibration: rows of motions as they arrive, and a summary.

Public names: `recorded_turns`, `line_turns`, `Turns`, `NetworkStream`, `NetworkDecoding` and `unused`.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from solen.analysis.calibration.counted_stream import CountedStream
from solen.analysis.calibration.csv_lines import STDIN, Lines, lines_of
from solen.analysis.calibration.file import Ambient
from solen.analysis.network.calibrate import LeftOut, checks_of
from solen.analysis.network.columns import power_columns
from solen.analysis.network.decoder import NetworkDecoded
from solen.analysis.network.file import MotionCheck, NetworkCalibration
from solen.analysis.network.recorded import network_readings, times_of
from solen.analysis.network.states import at_rest
from solen.arrays import BoolArray, FloatArray, IntArray, rows_of
from solen.errors import DataError, SpecError
from solen.ranks import DO_NOT_USE, Caution, do_not_use, prefixed, rank_of
from solen.recording import Provenance
from solen.results import Result
from solen.spec.strict import Options
from solen.units import factor

BANDS = ("low68", "high68", "low95", "high95")
FLAGS = ("outside", "ambiguous", "at_end")
_MEANING = {
    "outside": "are outside the calibrated map, so their motions are meaningless",
    "ambiguous": "are consistent with several states",
    "missing": "lack the reading of a receiver",
    "clipped": "contain a value at a limit of the recorder's range, which hides any change beyond it",
}


@dataclass(frozen=True, eq=False)
class Turns:
    """Switching cycles of emitters: times (n,), signals (n, emitters, receivers), and true angles, NaN if unknown.

    ``clipped`` marks signals at a limit of the recorder's range; None if the source contains no such flags.
    """

    time_s: FloatArray
    signal: FloatArray
    angle_deg: FloatArray | None = None
    clipped: BoolArray | None = None


class NetworkDecoding(Result):
    """Summary of a network's decoded stream.

    Attributes
    ----------
    readings, missing
        Number of decoded switching cycles, and number of those that lack a reading.
    outside, ambiguous, at_end
        Number of switching cycles with these flags, as in `solen.analysis.network.decoder.NetworkDecoded`.
    clipped
        Number of switching cycles with a reading that the source marks as clipped.
    from_s, to_s
        Times of the first and the last switching cycle.
    reached_deg
        Lowest and highest angle of each motion, from readings that lie on the map.
    against
        Errors relative to the angles recorded in the source, at its stops and within the calibrated ranges; empty if
        there are none.
    calibration, sensor
        Calibration file, and the network it calibrates.
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
    at_end: int
    clipped: int
    from_s: float
    to_s: float
    reached_deg: dict[str, tuple[float, float]]
    against: tuple[MotionCheck, ...]
    calibration: str
    sensor: str
    simulated: bool
    interrupted: bool
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]


class NetworkStream(CountedStream[NetworkCalibration]):
    """Decoder of a stream of switching cycles that also counts them.

    Parameters
    ----------
    known, file
        The calibration, and the name of its file.
    source, provenance
        Name of the stream in error messages, and its file; None if lines are read.
    warnings
        Warnings about the stream itself.
    """

    def __init__(
        self,
        known: NetworkCalibration,
        file: str,
        source: str,
        provenance: Provenance | None,
        warnings: tuple[Caution, ...] = (),
    ) -> None:
        largest = float(np.abs(np.array(known.signal_V)).max())
        super().__init__(known, file, source, provenance, largest, (*FLAGS, "clipped"))
        self._ends = np.array([[math.inf, -math.inf]] * len(known.motions))
        self._held: list[LeftOut] = []
        self.warnings = (*warnings, *self._calibration_warnings())

    @property
    def header(self) -> str:
        """Header line with the column names."""
        columns = (f"{one}_deg" for name in self._known.motions for one in (name, *(f"{name}_{b}" for b in BANDS)))
        return ",".join(["time_s", *columns, "flags", "probability", "other"]) + "\n"

    def rows(self, turns: Turns) -> str:
        """Decode switching cycles into CSV lines; `DataError` if the readings are about a thousand times too large."""
        self._check_scale(turns.signal, "a.end_mV")
        decoded = self._known.decoder.decode(turns.signal)
        self._count(turns, decoded)
        return "".join(_rows(turns.time_s, decoded))

    def result(self, *, interrupted: bool) -> NetworkDecoding:
        """Return the summary of the decoded stream; raise `DataError` if there was no complete switching cycle."""
        if not self.counts["readings"]:
            raise DataError(
                self._source, limit="contains no complete switching cycle of the emitters", remedy="check its columns"
            )
        pairs = zip(self._known.motions, self._ends.tolist(), strict=True)
        return NetworkDecoding(
            **self.counts,
            from_s=self._times_s[0],
            to_s=self._times_s[1],
            reached_deg={name: (low, high) for name, (low, high) in pairs if low <= high},
            against=self._against(),
            calibration=self._file,
            sensor=self._known.sensor,
            simulated=self._simulated,
            interrupted=interrupted,
            sources=() if self._provenance is None else (self._provenance,),
            warnings=(*self.warnings, *self._flag_warnings(_MEANING, always=("missing", "clipped"))),
        )

    def _calibration_warnings(self) -> Iterator[Caution]:
        yield from (prefixed("calibration", line) for line in self._known.warnings if rank_of(line) == DO_NOT_USE)
        if self._known.simulated and self._provenance is not None and not self._provenance.simulated:
            yield do_not_use("the calibration is simulated, but the recording is not")

    def _count(self, turns: Turns, decoded: NetworkDecoded) -> None:
        good = ~decoded.missing
        self._count_readings(turns.time_s, good, {name: getattr(decoded, name) for name in FLAGS})
        if turns.clipped is not None:
            self.counts["clipped"] += int((turns.clipped.any(axis=(1, 2)) & good).sum())
        if not good.any():
            return
        inside = decoded.angle_deg[good & ~decoded.outside]
        self._ends[:, 0] = np.minimum(self._ends[:, 0], inside.min(axis=0, initial=math.inf))
        self._ends[:, 1] = np.maximum(self._ends[:, 1], inside.max(axis=0, initial=-math.inf))
        if turns.angle_deg is not None:
            low, high = np.array(self._known.range_deg).T
            slack = 1e-6 * (high - low)
            true = turns.angle_deg
            kept = good & ((true >= low - slack) & (true <= high + slack)).all(axis=1)
            self._held.append(LeftOut(np.clip(true[kept], low, high), rows_of(decoded, kept)))

    def _against(self) -> tuple[MotionCheck, ...]:
        held = [one for one in self._held if len(one.angle_deg)]
        return checks_of(self._known.motions, LeftOut.joined(held)) if held else ()


def recorded_turns(
    path: Path, known: NetworkCalibration, sensor: str | None
) -> tuple[Turns, Provenance, tuple[Caution, ...]]:
    """Return the switching cycles in a recording with the true angles at its stops, its file, and its warnings.

    Raises
    ------
    DataError
        If an emitter or a receiver is missing, or the unit differs from that of the calibration.
    """
    found = network_readings(path, sensor).ordered(known.motions, known.emitters, known.receivers)
    scale = scale_of(path.name, found.unit, known)
    _check_ambient(path.name, found.ambient, known)
    true = np.where(at_rest(found.angle_deg)[:, None], found.angle_deg, np.nan) if found.motions else None
    return Turns(found.time_s, scale * found.signal, true, found.clipped), found.provenance, found.warnings


def _check_ambient(source: str, ambient: Ambient | None, known: NetworkCalibration) -> None:
    if None not in {ambient, known.ambient} and ambient != known.ambient:
        limit = f"contains readings with ambient light {ambient}, but in the calibration it is {known.ambient}"
        raise DataError(source, limit=limit, remedy="calibrate with recordings made in the same way")


def scale_of(source: str, unit: str, known: NetworkCalibration) -> float:
    """Return the factor from a unit of readings to the calibration's unit; raise `DataError` if the unit cannot be converted."""
    scale = factor(unit, known.unit)
    if scale is None:
        limit = f"is the unit of the readings, but the unit of the calibration is {known.unit}"
        remedy = (
            f"specify the unit of the readings in the header, as in a.end ({known.unit}), or "
            "calibrate with readings in their unit"
        )
        raise DataError(source, value=unit, limit=limit, remedy=remedy)
    return scale


def line_turns(text: Iterable[str], known: NetworkCalibration) -> tuple[Iterator[Turns], tuple[Caution, ...]]:
    """Return the switching cycles from CSV lines, each as soon as it arrives, and warnings; the first line names the columns.

    Raises
    ------
    DataError
        If there is no column for the time or for a power in the calibration.
    """
    lines = lines_of(text, remedy="begin the lines with time_s, and EMITTER.RECEIVER for each power")
    layout = _Layout.of(lines, known)
    return (layout.turn(values) for values in lines.rows), layout.warnings


@dataclass(frozen=True, eq=False)
class _Layout:
    """Column and scale of the time and of each power (emitters, receivers); columns of the clipping flags, or -1."""

    time: tuple[int, float]
    places: IntArray
    scales: FloatArray
    marks: IntArray
    warnings: tuple[Caution, ...]

    @classmethod
    def of(cls, lines: Lines, known: NetworkCalibration) -> "_Layout":
        """Return the layout of lines, from their header."""
        header = lines.header
        times, of_time, warnings = times_of(header)
        powers = power_columns(header.channels, STDIN)
        _check_ambient(STDIN, powers.ambient, known)
        pairs = [(lit, read) for lit in known.emitters for read in known.receivers]
        for pair in pairs:
            if pair not in powers.places:
                limit = f"contains no column {'.'.join(pair)}, which the calibration requires"
                raise DataError(STDIN, limit=limit, remedy=f"the columns are {', '.join(lines.names)}")
        shape = len(known.emitters), len(known.receivers)
        return cls(
            time=(header.names.index(times.name), of_time),
            places=np.array([powers.places[pair] for pair in pairs]).reshape(shape),
            scales=scale_of(STDIN, powers.unit, known)
            * np.array([powers.scales[pair] for pair in pairs]).reshape(shape),
            marks=np.array([powers.clipped.get(pair, -1) for pair in pairs]).reshape(shape),
            warnings=(*warnings, *powers.warnings),
        )

    def turn(self, values: Sequence[float]) -> Turns:
        """Return the switching cycle from the values in one line."""
        (place, scale), row = self.time, np.array(values)
        clipped = (self.marks >= 0) & (row[self.marks] > 0.5)
        return Turns(scale * row[[place]], self.scales * row[None, self.places], clipped=clipped[None])


def unused(options: Options, kept: Sequence[str] = ()) -> None:
    """Raise `SpecError` for an option that does not apply to a network."""
    for name, info in type(options).model_fields.items():
        value = getattr(options, name)
        if name not in kept and value != info.get_default(call_default_factory=True):
            limit = "does not apply to a network, whose columns and motions are identified by their names"
            raise SpecError(f"--{name.replace('_', '-')}", value=str(value), limit=limit, remedy="omit it")


def _rows(time_s: FloatArray, decoded: NetworkDecoded) -> Iterator[str]:
    """Yield a line for each switching cycle."""
    motions = decoded.angle_deg.shape[1]
    bands = np.stack([decoded.low_deg, decoded.high_deg], axis=-1).reshape(len(time_s), motions, 4)
    values = np.concatenate([decoded.angle_deg[..., None], bands], axis=-1).reshape(len(time_s), -1)
    marks = zip(*(getattr(decoded, name).tolist() for name in FLAGS), strict=True)
    columns = values.tolist(), marks, decoded.probability.tolist(), decoded.other_deg.tolist()
    for stamp, missing, *rest in zip(time_s.tolist(), decoded.missing.tolist(), *columns, strict=True):
        when = f"{stamp:.6f}" if math.isfinite(stamp) else ""
        if missing:
            yield f"{when}{',' * (5 * motions)},missing,,\n"
            continue
        numbers, flags, probability, other = rest
        named = " ".join(name for name, flag in zip(FLAGS, flags, strict=True) if flag)
        beside = " ".join(f"{one:.5f}" for one in other) if math.isfinite(other[0]) else ""
        yield ",".join([when, *(f"{number:.5f}" for number in numbers), named, f"{probability:.3f}", beside]) + "\n"
