"""Decoding of a stream of network readings with a saved calibration: rows of motions as they arrive, and a summary.

Public names: `recorded_cycles`, `cycles_of_lines`, `SwitchingCycles`, `NetworkStream`, `NetworkDecoding` and
`check_options`.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from solen.analysis.calibration.counted_stream import CountedStream
from solen.analysis.calibration.csv_lines import STDIN, Lines, lines_of
from solen.analysis.calibration.file import Ambient
from solen.analysis.network.calibrate import HeldOut, checks_of
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
_MEANINGS = {
    "outside": "are outside the calibrated map, so their motions are meaningless",
    "ambiguous": "match several states",
    "missing": "lack the reading of a receiver",
    "clipped": "contain a value at a limit of the recorder's range, which hides changes outside it",
}


@dataclass(frozen=True, eq=False)
class SwitchingCycles:
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
        Number of switching cycles that were decoded, and of switching cycles that lack a reading.
    outside, ambiguous, at_end
        Number of switching cycles with these flags, as in `solen.analysis.network.decoder.NetworkDecoded`.
    clipped
        Number of switching cycles with a reading that the source marks as clipped.
    from_s, to_s
        Times of the first and the last switching cycle.
    reached_deg
        Lowest and highest angle of each motion, from readings on the map.
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
    """Decoder of a stream of switching cycles, which counts them and their flags.

    Parameters
    ----------
    calibration, file
        The calibration, and the name of its file.
    source, provenance
        Name of the stream in error messages, and its file; None if lines are read.
    warnings
        Warnings about the stream itself.
    """

    def __init__(
        self,
        calibration: NetworkCalibration,
        file: str,
        source: str,
        provenance: Provenance | None,
        warnings: tuple[Caution, ...] = (),
    ) -> None:
        largest = float(np.abs(np.array(calibration.signal_V)).max())
        super().__init__(calibration, file, source, provenance, largest, (*FLAGS, "clipped"))
        self._ranges = np.array([[math.inf, -math.inf]] * len(calibration.motions))
        self._compared: list[HeldOut] = []
        self.warnings = (*warnings, *self._calibration_warnings())

    @property
    def header(self) -> str:
        """Header line with the column names."""
        suffixes = ["_deg", *(f"_{band}_deg" for band in BANDS)]
        columns = (f"{name}{suffix}" for name in self._calibration.motions for suffix in suffixes)
        return ",".join(["time_s", *columns, "flags", "probability", "other"]) + "\n"

    def rows(self, cycles: SwitchingCycles) -> str:
        """Decode switching cycles into CSV lines; raise `DataError` if the readings must be in another unit."""
        self._check_scale(cycles.signal, "a.end_mV")
        decoded = self._calibration.decoder.decode(cycles.signal)
        self._count(cycles, decoded)
        return "".join(_rows(cycles.time_s, decoded))

    def result(self, *, interrupted: bool) -> NetworkDecoding:
        """Return the summary of the decoded stream; raise `DataError` if there was no complete switching cycle."""
        if not self.counts["readings"]:
            limit = "contains no complete switching cycle of the emitters"
            raise DataError(self._source, limit=limit, remedy="check its columns")
        pairs = zip(self._calibration.motions, self._ranges.tolist(), strict=True)
        return NetworkDecoding(
            **self.counts,
            from_s=self._times_s[0],
            to_s=self._times_s[1],
            reached_deg={name: (low, high) for name, (low, high) in pairs if low <= high},
            against=self._against(),
            calibration=self._file,
            sensor=self._calibration.sensor,
            simulated=self._simulated,
            interrupted=interrupted,
            sources=() if self._provenance is None else (self._provenance,),
            warnings=(*self.warnings, *self._flag_warnings(_MEANINGS, always=("missing", "clipped"))),
        )

    def _calibration_warnings(self) -> Iterator[Caution]:
        unusable = (caution for caution in self._calibration.warnings if rank_of(caution) == DO_NOT_USE)
        yield from (prefixed("calibration", caution) for caution in unusable)
        if self._calibration.simulated and self._provenance is not None and not self._provenance.simulated:
            yield do_not_use("the calibration is simulated, but the recording is not")

    def _count(self, cycles: SwitchingCycles, decoded: NetworkDecoded) -> None:
        complete = ~decoded.missing
        self._count_readings(cycles.time_s, complete, {name: getattr(decoded, name) for name in FLAGS})
        if cycles.clipped is not None:
            self.counts["clipped"] += int((cycles.clipped.any(axis=(1, 2)) & complete).sum())
        if not complete.any():
            return
        on_map = decoded.angle_deg[complete & ~decoded.outside]
        self._ranges[:, 0] = np.minimum(self._ranges[:, 0], on_map.min(axis=0, initial=math.inf))
        self._ranges[:, 1] = np.maximum(self._ranges[:, 1], on_map.max(axis=0, initial=-math.inf))
        if cycles.angle_deg is not None:
            low, high = np.array(self._calibration.range_deg).T
            margin = 1e-6 * (high - low)
            true = cycles.angle_deg
            kept = complete & ((true >= low - margin) & (true <= high + margin)).all(axis=1)
            self._compared.append(HeldOut(np.clip(true[kept], low, high), rows_of(decoded, kept)))

    def _against(self) -> tuple[MotionCheck, ...]:
        parts = [part for part in self._compared if len(part.angle_deg)]
        return checks_of(self._calibration.motions, HeldOut.joined(parts)) if parts else ()


def recorded_cycles(
    path: Path, calibration: NetworkCalibration, sensor: str | None
) -> tuple[SwitchingCycles, Provenance, tuple[Caution, ...]]:
    """Return the switching cycles in a recording with the true angles at its stops, its provenance, and warnings.

    Raises
    ------
    DataError
        If an emitter or a receiver is missing, or the unit cannot be converted to that of the calibration.
    """
    readings = network_readings(path, sensor).ordered(calibration.motions, calibration.emitters, calibration.receivers)
    scale = scale_of(path.name, readings.unit, calibration)
    _check_ambient(path.name, readings.ambient, calibration)
    true = None
    if readings.motions:
        true = np.where(at_rest(readings.angle_deg)[:, None], readings.angle_deg, np.nan)
    cycles = SwitchingCycles(readings.time_s, scale * readings.signal, true, readings.clipped)
    return cycles, readings.provenance, readings.warnings


def _check_ambient(source: str, ambient: Ambient | None, calibration: NetworkCalibration) -> None:
    if None not in {ambient, calibration.ambient} and ambient != calibration.ambient:
        limit = f"contains readings with ambient light {ambient}, but in the calibration it was {calibration.ambient}"
        raise DataError(source, limit=limit, remedy="calibrate with recordings that treat ambient light alike")


def scale_of(source: str, unit: str, calibration: NetworkCalibration) -> float:
    """Return the factor from a unit to that of the calibration; raise `DataError` if it cannot be converted."""
    scale = factor(unit, calibration.unit)
    if scale is None:
        limit = f"contains readings in {unit}, but the calibration is in {calibration.unit}"
        remedy = f"correct the unit in the header, as in a.end ({calibration.unit}), or calibrate in {unit}"
        raise DataError(source, limit=limit, remedy=remedy)
    return scale


def cycles_of_lines(
    text: Iterable[str], calibration: NetworkCalibration
) -> tuple[Iterator[SwitchingCycles], tuple[Caution, ...]]:
    """Return the switching cycles from CSV lines, each as soon as it arrives, and warnings.

    The first line contains the names of the columns.

    Raises
    ------
    DataError
        If there is no column for the time or for a power in the calibration.
    """
    lines = lines_of(text, remedy="begin the lines with time_s, and EMITTER.RECEIVER for each power")
    layout = _Layout.of(lines, calibration)
    return (layout.cycle(values) for values in lines.rows), layout.warnings


@dataclass(frozen=True, eq=False)
class _Layout:
    """Column and scale of the time and of each power (emitters, receivers); columns of the clipping flags, or -1."""

    time: tuple[int, float]
    columns: IntArray
    scales: FloatArray
    flags: IntArray
    warnings: tuple[Caution, ...]

    @classmethod
    def of(cls, lines: Lines, calibration: NetworkCalibration) -> "_Layout":
        """Return the layout of lines, from their header."""
        header = lines.header
        times, seconds, warnings = times_of(header)
        powers = power_columns(header.channels, STDIN)
        _check_ambient(STDIN, powers.ambient, calibration)
        pairs = list(product(calibration.emitters, calibration.receivers))
        for pair in pairs:
            if pair not in powers.indices:
                limit = f"contains no column {'.'.join(pair)}, which the calibration requires"
                raise DataError(STDIN, limit=limit, remedy=f"add this column; the columns are {', '.join(lines.names)}")
        shape = len(calibration.emitters), len(calibration.receivers)
        scale = scale_of(STDIN, powers.unit, calibration)
        return cls(
            time=(header.names.index(times.name), seconds),
            columns=np.array([powers.indices[pair] for pair in pairs]).reshape(shape),
            scales=scale * np.array([powers.scales[pair] for pair in pairs]).reshape(shape),
            flags=np.array([powers.clipped.get(pair, -1) for pair in pairs]).reshape(shape),
            warnings=(*warnings, *powers.warnings),
        )

    def cycle(self, values: Sequence[float]) -> SwitchingCycles:
        """Return the switching cycle from the values in one line."""
        (time, scale), row = self.time, np.array(values)
        clipped = (self.flags >= 0) & (row[self.flags] > 0.5)
        return SwitchingCycles(scale * row[[time]], self.scales * row[None, self.columns], clipped=clipped[None])


def check_options(options: Options, kept: Sequence[str] = ()) -> None:
    """Raise `SpecError` for an option that does not apply to a network."""
    for name, info in type(options).model_fields.items():
        value = getattr(options, name)
        if name not in kept and value != info.get_default(call_default_factory=True):
            limit = "does not apply to a network, whose columns and motions are recognised by their names"
            raise SpecError(f"--{name.replace('_', '-')}", value=str(value), limit=limit, remedy="omit it")


def _rows(time_s: FloatArray, decoded: NetworkDecoded) -> Iterator[str]:
    """Yield a line for each switching cycle."""
    motions = decoded.angle_deg.shape[1]
    bands = np.stack([decoded.low_deg, decoded.high_deg], axis=-1).reshape(len(time_s), motions, 4)
    values = np.concatenate([decoded.angle_deg[..., None], bands], axis=-1).reshape(len(time_s), -1)
    flags = zip(*(getattr(decoded, name).tolist() for name in FLAGS), strict=True)
    columns = values.tolist(), flags, decoded.probability.tolist(), decoded.other_deg.tolist()
    for seconds, missing, *cells in zip(time_s.tolist(), decoded.missing.tolist(), *columns, strict=True):
        time = f"{seconds:.6f}" if math.isfinite(seconds) else ""
        if missing:
            yield f"{time}{',' * (5 * motions)},missing,,\n"
            continue
        numbers, is_set, probability, other_deg = cells
        names = " ".join(name for name, flag in zip(FLAGS, is_set, strict=True) if flag)
        other = " ".join(f"{angle:.5f}" for angle in other_deg) if math.isfinite(other_deg[0]) else ""
        yield ",".join([time, *(f"{number:.5f}" for number in numbers), names, f"{probability:.3f}", other]) + "\n"
