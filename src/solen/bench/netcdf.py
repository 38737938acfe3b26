"""A journal converted to a netCDF file: all samples, and the readings of each sensor without ambient light.

The root group stores the received data, as counts on the clock of the run, and the positions of the stages. The data
are the periods of a board, the samples of a DAQ device, from which `solen.bench.waveform` computes readings, or the
readings of a meter. Each sensor, and each emitter of a network, has its own group with the data for analysis: the times
of the on phases of its emitter, the angles at these times, and the signals of its receivers, on minus the mean of off
before and after. Nothing is smoothed. A cycle that was interrupted is repeated when the run is resumed; its samples
stay in the root group and are omitted from the others. The file is written under a temporary name and renamed; the
journal is kept.

Public names: `write_recording` and `RecordedRun`.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen import files
from solen.analysis.load_cell import LoadCell
from solen.arrays import FloatArray
from solen.bench.axes import stream_of
from solen.bench.clock_fit import ClockLine, fit_clock
from solen.bench.frames import INVALID
from solen.bench.journal_content import JournalContent, Rows, signal_unit
from solen.bench.protocol import Protocol
from solen.bench.readings import (
    CELL,
    CHUNK_PERIODS,
    Columns,
    MeterReadings,
    View,
    columns_of,
    drive_column,
    inputs_of,
    interrupted_spans,
    motions_of,
    positions_of,
    segments,
    sensor_readings,
    views_of,
)
from solen.bench.timing import Timing, exchanges, full_scale_of, known_only_at_rest, latest_arrival_s
from solen.bench.waveform import Waveform, create_variable
from solen.extras import need
from solen.ranks import Caution, do_not_use, prefixed, warning
from solen.results import HIDDEN, Result, reported

_PART = "part of the run, increased by one each time the run was resumed"
_MAX_LISTED_GAPS = 5
"""Largest number of gaps of a damaged journal that a warning lists."""


class RecordedRun(Result):
    """Summary of the recording of a run.

    Attributes
    ----------
    path
        The file.
    outcome
        ``done``, ``stopped``, ``fault``, or ``killed`` if the run did not record how it ended.
    cycles, periods
        Number of complete cycles, and of periods of a board, frames of a DAQ device or readings of a meter.
    duration_s
        Time from the first period to the last.
    sensors
        Number of readings of each sensor.
    losses
        Losses of the sampler, over all parts of the run.
    lost_bytes
        Number of bytes of the unfinished last record of the journal.
    damaged_bytes, missing_records
        For a damaged journal: bytes that no longer form a record, and number of records known to be missing.
    simulated
        Whether any of its data are simulated.
    cautions
        Warnings from the recording, except those about losses.
    """

    path: Path = field(metadata=HIDDEN)
    outcome: str
    cycles: int
    periods: int
    duration_s: float
    sensors: dict[str, int]
    losses: dict[str, int]
    lost_bytes: int
    damaged_bytes: int
    missing_records: int
    simulated: bool
    cautions: tuple[Caution, ...] = field(default=(), metadata=HIDDEN)

    @reported
    def warnings(self) -> tuple[Caution, ...]:
        """Losses and other warnings."""
        lost = [f"{number} {name}" for name, number in self.losses.items() if number]
        losses = [warning(f"lost {', '.join(lost)}")] if lost else []
        unfinished = f"the last record of the journal is incomplete, and its {self.lost_bytes} bytes are lost"
        return (*losses, *self.cautions, *([warning(unfinished)] if self.lost_bytes else []))


def check_installed() -> None:
    """Raise `OutputError` if the library that writes netCDF is not installed."""
    need("h5netcdf", "h5py", what="netCDF")


def write_recording(journal: JournalContent, path: Path) -> RecordedRun:
    """Write the content of a journal to a netCDF file.

    Raises
    ------
    OutputError
        If the file cannot be written, or h5netcdf is not installed.
    """
    check_installed()
    recorded: list[RecordedRun] = []

    def write(target: Path) -> None:
        import h5netcdf

        with h5netcdf.File(target, "w") as file:
            time_s, readings, cautions = _WRITERS[journal.sampler_stream](file, journal)
            cautions += [caution for view in views_of(journal.header) for caution in _clipped(file[view.name], view)]
            _write_positions(file, journal)
            cautions += [warning(event["reason"]) for event in journal.events if event["what"] == "remark"]
            cautions += _without_force(file, journal)
            cautions += [*_write_timing(file, journal), *_damage(journal), *_early_end(journal)]
            recorded.append(
                RecordedRun(
                    path=path,
                    outcome=journal.outcome,
                    cycles=journal.cycles,
                    periods=len(time_s),
                    duration_s=float(time_s[-1] - time_s[0]) if len(time_s) else 0.0,
                    sensors=readings,
                    losses=journal.losses,
                    lost_bytes=journal.lost_bytes,
                    damaged_bytes=journal.damaged_bytes,
                    missing_records=sum(gap.last - gap.first + 1 for gap in journal.missing),
                    simulated=bool(journal.header["simulated"]),
                    cautions=tuple(cautions),
                )
            )
        files.seal(target)

    files.write_all({path: write})
    return recorded[-1]


Written = tuple[FloatArray, dict[str, int], list[Caution]]
"""Time of each period, number of readings of each sensor, and warnings."""


def _write_periods(file: Any, journal: JournalContent) -> Written:
    """Write the periods of a board."""
    board, header = journal.streams["board"], journal.header
    time_s, lines = _times(journal)
    _write_attributes(file, journal, {str(index): line for index, line in enumerate(lines)})
    _write_samples(file, board, time_s, header)
    spans, readings, cautions = interrupted_spans(journal), {}, _invalid(board)
    for view in views_of(header):
        parts = list(sensor_readings(view, journal, time_s, spans))
        cautions += _nonlinear(view, parts, header.get("rig", {}).get("board", {}).get("linear_v"))
        readings[view.name] = _write_sensor(file, view, parts, journal)
    return time_s, readings, cautions


def _nonlinear(view: View, parts: Sequence[Columns], linear_V: Sequence[float] | None) -> list[Caution]:
    """Warn of readings with levels outside the linear range of the ADC."""
    if linear_V is None or not parts:
        return []
    low, high = linear_V
    outside = []
    for part in parts:
        off = [part[f"{name}_ambient"] for name in view.inputs]
        on = [level + part[name] for level, name in zip(off, view.inputs, strict=True)]
        outside.append(np.any([(level < low) | (level > high) for level in (*off, *on)], axis=0))
    percent = 100.0 * float(np.concatenate(outside).mean())
    if percent == 0.0:
        return []
    limits = f"outside {low:g} to {high:g} V, the linear range of the ADC"
    return [prefixed(view.name, warning(f"{percent:.3g} % of the readings have levels {limits}"))]


def _clipped(group: Any, view: View) -> Iterator[Caution]:
    """Warn of readings with a sample at a limit of the input range."""
    marks = {name: np.asarray(group[f"{name}_clipped"]) for name in view.inputs}
    percentages = [f"{name} {100 * clipped.mean():.3g} %" for name, clipped in marks.items() if clipped.any()]
    if percentages:
        yield prefixed(view.name, warning(f"readings are clipped at a limit of the range: {', '.join(percentages)}"))


def _invalid(board: Rows) -> list[Caution]:
    count = int(np.count_nonzero(board["flags"] & INVALID))
    omitted = warning(f"{count} periods that the board sampled late, or with a faulty emitter, gave no readings")
    return [omitted] if count else []


def _write_waveform(file: Any, journal: JournalContent) -> Written:
    """Write the samples of a DAQ device."""
    header, waveform = journal.header, Waveform(file, journal)
    _write_attributes(file, journal, waveform.lines)
    file.dimensions["period"] = len(waveform.time_s)
    for name, values, unit, text in (
        ("time_s", waveform.time_s, "s", "time of the first sample of the frame, on the clock of the run"),
        ("part", waveform.part, "1", _PART),
        ("stretch", waveform.segment, "1", "gapless segment of the part, increased by one after each gap"),
        ("number", waveform.number, "1", "index of the first sample of the frame in its segment"),
    ):
        _write_variable(file, name, ("period",), values, unit, text)
    coefficients = np.array(header["daq"]["coefficients"])
    file.dimensions["power"] = coefficients.shape[1]
    _write_variable(
        file, "coefficients", ("channel", "power"), coefficients, "V", "volts = sum of coefficient * counts^power"
    )
    spans, views = interrupted_spans(journal), views_of(header)
    parts: dict[str, list[Columns]] = {view.name: [] for view in views}
    for view, window, kept in waveform.readings(views):
        parts[view.name].append(columns_of(view, window, kept, journal, spans))
    readings = {view.name: _write_sensor(file, view, parts.pop(view.name), journal) for view in views}
    file.attrs["remarks"] = json.dumps(waveform.cautions)
    return waveform.time_s, readings, waveform.cautions


def _write_meter(file: Any, journal: JournalContent) -> Written:
    """Write the readings of a meter: all of them as they arrived, and those of each sensor."""
    rows, header = journal.streams["meter"], journal.header
    half_s = 0.5 * (rows["t_s"] - rows["sent_s"] + header.get("clock_resolution_s", 0.0))
    time_s = rows["sent_s"] + half_s
    bound_s = float(half_s.mean()) if len(rows) else None
    _write_attributes(file, journal, {"meter": ClockLine(0.0, 1.0, 0.0, bound_s)})
    file.dimensions = {"period": len(rows), "input": header["meter"]["inputs"]}
    for name, values, unit, text in (
        ("time_s", time_s, "s", "midpoint of query and reply, on the clock of the run"),
        ("bound_s", half_s, "s", "bound on the error of this time in either direction"),
        ("part", rows["part"], "1", _PART),
    ):
        _write_variable(file, name, ("period",), values, unit, text)
    for name, text in (("on", "inputs with the emitters on"), ("off", "inputs with the emitters off; NaN: unknown")):
        _write_variable(file, name, ("period", "input"), rows[name], header["meter"]["unit"], text)
    spans, readings = interrupted_spans(journal), {}
    for view in views_of(header):
        of_view = _meter_readings(rows, time_s, inputs_of(view, header))
        columns = columns_of(view, of_view, np.ones(len(rows), bool), journal, spans)
        switched = header["meter"]["switched"]
        readings[view.name] = _write_sensor(file, view, [columns], journal, switched=switched)
    return time_s, readings, []


def _meter_readings(rows: Rows, time_s: FloatArray, inputs: list[int]) -> MeterReadings:
    """Return the readings of the given inputs: on minus off if off is known, otherwise on."""
    on, off = rows["on"][:, inputs], rows["off"][:, inputs]
    return MeterReadings(time_s, np.where(np.isfinite(off), on - off, on), off, rows["clipped"][:, inputs])


_WRITERS = {"board": _write_periods, "samples": _write_waveform, "meter": _write_meter}


def _times(journal: JournalContent) -> tuple[FloatArray, list[ClockLine]]:
    """Return the time of each period on the run's clock, and the clock line of each segment."""
    board, arrivals = journal.streams["board"], journal.streams["came"]
    times, lines = np.zeros(len(board)), []
    for first, last in segments(board):
        periods = board[first:last]
        part, numbers, board_s = int(periods["part"][0]), periods["number"], 1e-6 * periods["board_us"].astype(float)
        within = (arrivals["number"] >= numbers[0]) & (arrivals["number"] <= numbers[-1])
        of_segment = arrivals[within & (arrivals["part"] == part)]
        if len(of_segment):
            end_s = np.interp(of_segment["number"] + 1.0, numbers, board_s)  # a period arrives after its end
            arrival_s = latest_arrival_s(of_segment, journal)
            line = fit_clock(end_s, arrival_s, exchanges(journal, part, arrival_s))
        else:
            line = ClockLine(0.0, 1.0, 0.0)
        lines.append(line)
        times[first:last] = line.at(board_s)
    return times, lines


def _write_attributes(file: Any, journal: JournalContent, lines: Mapping[str, ClockLine]) -> None:
    header = {key: value for key, value in journal.header.items() if key != "streams"}
    file.attrs["title"] = f"solen bench run: {header['protocol_name']} on {header['rig_name']}"
    file.attrs["source"] = f"solen {header['solen']}"
    file.attrs["simulated"] = "yes" if header["simulated"] else "no"
    file.attrs["outcome"] = journal.outcome
    file.attrs["date"] = header["begun_utc"]
    file.attrs["control"] = " ".join(sensor["name"] for sensor in header["sensors"] if not sensor["lens"])
    file.attrs["header"] = json.dumps(header)
    file.attrs["events"] = json.dumps(journal.events)
    file.attrs["clock"] = json.dumps({name: vars(line) for name, line in lines.items()})
    file.attrs["cut_short"] = json.dumps([[max(a, 0.0), b] for a, b in interrupted_spans(journal) if b < math.inf])
    file.attrs["losses"] = json.dumps(journal.losses)
    file.attrs["lost_bytes"] = journal.lost_bytes


def _write_samples(file: Any, board: Rows, time_s: FloatArray, header: Mapping[str, Any]) -> None:
    counts = board["counts"]
    file.dimensions = {
        "period": len(board),
        "emitter": header["emitters"],
        "phase": 2,
        "input": header["receivers"],
    }
    for name, values, unit, text in (
        ("time_s", time_s, "s", "start of the period on the clock of the run"),
        ("part", board["part"], "1", _PART),
        ("number", board["number"], "1", "number of the period, from the board"),
        ("board_us", board["board_us"], "us", "start of the period on the clock of the board"),
        ("flags", board["flags"], "1", "1 late, 2 emitter faulty (no readings), 4 first after a restart"),
    ):
        _write_variable(file, name, ("period",), values, unit, text)
    dims = ("period", "emitter", "phase", "input")
    unit, text = signal_unit(header), "of an input; phase 0 with the emitter on, 1 with it off again"
    name = "voltage" if unit == "V" else "signal"
    variable = create_variable(file, name, dims, counts.shape, counts.dtype, unit, f"{name} {text}", CHUNK_PERIODS)
    variable.attrs["scale_factor"] = header["volts_per_count"]
    for begin in range(0, len(board), CHUNK_PERIODS):
        variable[begin : begin + CHUNK_PERIODS] = counts[begin : begin + CHUNK_PERIODS]


def _write_positions(file: Any, journal: JournalContent) -> None:
    for motion in motions_of(journal.header):
        stage, positions = journal.streams[stream_of(motion)], positions_of(journal, motion)
        prefix = f"{motion}_" if motion else ""
        file.dimensions[f"{prefix}look"] = len(stage)
        for name, values, unit, text in (
            ("stage_time_s", positions.time_s, "s", "time of the position: the midpoint of query and reply"),
            ("stage_bound_s", positions.bound_s, "s", "bound on the error of this time in either direction"),
            ("stage_answer_s", stage["t_s"], "s", "time at which the reply arrived, on the clock of the run"),
            ("stage_position", positions.position, journal.header["unit"], "position of the stage"),
        ):
            _write_variable(file, f"{prefix}{name}", (f"{prefix}look",), values, unit, text)


def _early_end(journal: JournalContent) -> list[Caution]:
    """Warn of a run that ended early, with the reason."""
    ends = [event for event in journal.events if event["what"] in {"stopped", "fault"}]
    if not ends or journal.outcome == "done":
        return []
    return [warning(f"the run ended early: {ends[-1]['reason']}")]


def _damage(journal: JournalContent) -> list[Caution]:
    """Warn of the missing parts of a damaged journal."""
    if not journal.damaged:
        return []
    missing = "it is unknown which records are missing"
    if journal.missing:
        listed, unlisted = journal.missing[:_MAX_LISTED_GAPS], len(journal.missing) - _MAX_LISTED_GAPS
        more = f" and records in {unlisted} more gaps" if unlisted > 0 else ""
        missing = f"missing: {', '.join(map(str, listed))}{more}"
    damage = f"{journal.damaged_bytes} bytes cannot be read as records"
    return [warning(f"the journal is damaged and is kept: {damage}; {missing}")]


def _write_timing(file: Any, journal: JournalContent) -> list[Caution]:
    """Write the timing uncertainty due to clocks and lines; warn if it may contribute notably to hysteresis."""
    header, cautions = journal.header, []
    lines = [ClockLine(**line) for line in json.loads(file.attrs["clock"]).values()]
    protocol = Protocol(**header["protocol"])
    for motion in motions_of(header):
        stage = journal.streams[stream_of(motion)]
        timing = Timing.of(stage, header.get("clock_resolution_s", 0.0), lines)
        for name, value in timing.attributes.items():
            file.attrs[f"{motion} {name}" if motion else name] = value
        if not known_only_at_rest(stage):
            caution = timing.caution(protocol.fastest, full_scale_of(stage["position"]), protocol.unit)
            cautions += [] if caution is None else [prefixed(motion, caution)]
    return cautions


def _write_sensor(
    file: Any, view: View, parts: list[Columns], journal: JournalContent, *, switched: bool = True
) -> int:
    """Write the group of a sensor under one emitter, and return the number of its readings.

    The ambient light is unknown if the emitters are not switched.
    """
    # parts are freed while they are joined
    columns = {name: np.concatenate([part.pop(name) for part in parts]) for name in list(parts[0])} if parts else {}
    group = file.create_group(view.name)
    group.attrs["sensor"] = view.name
    group.attrs["lens"] = "yes" if view.sensor["lens"] else "no"
    for key, value in view.sensor.get("drawn", {}).items():
        group.attrs[f"drawn {key}"] = value
    header = journal.header
    if header.get("load_cell") is not None and columns:
        cell = LoadCell(**header["load_cell"])
        zero_V = _zero_V(cell, columns, journal)
        columns["force_N"] = cell.force_N(columns.pop(CELL), zero_V)
        group.attrs["load_cell_zero_V"] = zero_V
    readings = len(columns["time_s"]) if columns else 0
    group.dimensions = {"reading": readings}
    for name, (unit, text) in _descriptions(view, header, switched=switched).items():
        values = columns[name] if columns else np.zeros(0)
        _write_variable(group, name, ("reading",), values, unit, text)
    return readings


def _descriptions(view: View, header: Mapping[str, Any], *, switched: bool) -> dict[str, tuple[str, str]]:
    """Return unit and description of each column of a sensor, keyed by its name."""
    unit = signal_unit(header)
    signal = "with the emitters on all the time"
    if switched:
        signal = f"on minus the mean of off before and after{'; lower is brighter' if unit == 'V' else ''}"
    texts = {"time_s": ("s", "time of the emitter's on phase on the clock of the run")}
    for motion, settings in motions_of(header).items():
        texts[drive_column(motion, settings)] = _drive_description(motion, settings)
    if header.get("load_cell") is not None:
        texts["force_N"] = "N", "force from the load cell, the mean of on and off"
    texts |= {name: (unit, f"{name} receiver, {signal}") for name in view.inputs}
    if switched:
        texts |= {f"{name}_ambient": (unit, f"{name} receiver with the emitter off") for name in view.inputs}
    clipped = "receiver was at a limit of the range"
    return texts | {f"{name}_clipped": ("1", f"1 if a sample of the {name} {clipped}") for name in view.inputs}


def _drive_description(motion: str, settings: Mapping[str, Any]) -> tuple[str, str]:
    """Return unit and description of the quantity that a stage drives."""
    method = "at that time, by a monotone cubic between the positions of the stage"
    if settings.get("drives") == "depth":
        return "mm", f"depth of the finger {method}"
    return "deg", f"angle of {motion or 'the sensor'} {method}"


def _zero_V(cell: LoadCell, columns: Columns, journal: JournalContent) -> float:
    """Return the voltage of a load cell without load: that in the rig file, or its mean at rest before the first cycle.

    The result is NaN if neither is known.
    """
    if cell.zero_V is not None:
        return cell.zero_V
    rest = next((event["t_s"] for event in journal.events if event["what"] == "at rest"), math.inf)
    ends = (event["t_s"] for event in journal.events if event["what"] == "cycle" and event["t_s"] >= rest)
    at_rest = columns[CELL][(columns["time_s"] >= rest) & (columns["time_s"] <= next(ends, math.inf))]
    known = at_rest[np.isfinite(at_rest)]
    return float(known.mean()) if known.size else math.nan


def _without_force(file: Any, journal: JournalContent) -> list[Caution]:
    """Warn of readings for which no force could be computed from the load cell."""
    if journal.header.get("load_cell") is None:
        return []
    forces = [file.groups[view.name].variables["force_N"][...] for view in views_of(journal.header)]
    missing = int(np.isnan(np.concatenate(forces)).sum())
    reason = "the input of the load cell was clipped, or its voltage without load was not recorded"
    return [do_not_use(f"no force could be computed for {missing} readings: {reason}")] if missing else []


def _write_variable(group: Any, name: str, dims: tuple[str, ...], values: NDArray[Any], unit: str, text: str) -> None:
    variable = create_variable(group, name, dims, values.shape, values.dtype, unit, text, 4 * CHUNK_PERIODS)
    variable[...] = values
