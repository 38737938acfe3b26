"""A journal closed into a netCDF file: all samples, and each sensor's readings without ambient light.

The root of the file stores the received data, count by count, on the clock of the run, and the position of the stage.
The data are a board's periods, or a data acquisition's samples, from which `solen.bench.waveform` computes readings.
Each sensor, and each emitter of a network, has its own group with the data that analysis reads: the times of its
emitter's on phases, the angles at these times, and the volts of its receivers, on minus the mean of off before and
after. Nothing is smoothed. A cycle that was interrupted in a resumed run is repeated: it stays in the root and is
omitted from the groups. The file is written under a temporary name and renamed; the journal stays.

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
from solen.bench.frames import UNSOUND
from solen.bench.journal_content import JournalContent, Rows, signal_unit
from solen.bench.protocol import Protocol
from solen.bench.readings import (
    AT_ONCE,
    CELL,
    Columns,
    Read,
    View,
    columns_of,
    cut_short,
    drive_of,
    inputs_of,
    looks_of,
    motions_of,
    sensor_readings,
    stretches,
    views_of,
)
from solen.bench.timing import Timing, came_by, exchanges, known_at_rest_alone, reach_of
from solen.bench.waveform import Waveform, create_variable
from solen.extras import need
from solen.ranks import Caution, do_not_use, prefixed, warning
from solen.results import HIDDEN, Result, reported

_NAMED = 5
"""Number of gaps of a damaged journal that are named one by one."""


class RecordedRun(Result):
    """Content of the recording of a run.

    Attributes
    ----------
    path
        The file.
    outcome
        ``done``, ``stopped``, ``fault``, or ``killed`` if the journal has no end.
    cycles, periods
        Number of complete cycles, and of periods or frames.
    duration_s
        Time from the first period to the last.
    sensors
        Number of readings of each sensor.
    losses
        Losses of the sampler, over all parts of the run.
    lost_bytes
        Number of bytes of the journal's unfinished last record.
    damaged_bytes, missing_records
        For a damaged journal: bytes that no longer form a record, and number of records known to be missing.
    simulated
        Whether anything in it is simulated.
    remarks
        Periods without readings, and events of the instruments.
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
    remarks: tuple[Caution, ...] = field(default=(), metadata=HIDDEN)

    @reported
    def warnings(self) -> tuple[Caution, ...]:
        """Losses and remarks."""
        lost = [f"{number} {name}" for name, number in self.losses.items() if number]
        return (
            *([warning(f"lost {', '.join(lost)}")] if lost else []),
            *self.remarks,
            *(
                [warning(f"the last {self.lost_bytes} bytes of the journal were not complete")]
                if self.lost_bytes
                else []
            ),
        )


def check_installed() -> None:
    """Raise `OutputError` if the library that writes netCDF is not installed."""
    need("h5netcdf", "h5py", what="netCDF")


def write_recording(journaled: JournalContent, path: Path) -> RecordedRun:
    """Write the content of a journal to a netCDF file.

    Raises
    ------
    OutputError
        If the file cannot be written, or h5netcdf is not installed.
    """
    check_installed()
    done: list[RecordedRun] = []

    def write(target: Path) -> None:
        import h5netcdf

        with h5netcdf.File(target, "w") as file:
            content = _CONTENT[journaled.sampled]
            time_s, readings, remarks = content(file, journaled)
            remarks += [line for view in views_of(journaled.header) for line in _clipped(file[view.name], view)]
            _positions(file, journaled)
            remarks += [warning(event["reason"]) for event in journaled.events if event["what"] == "remark"]
            remarks += _overloaded(file, journaled)
            remarks += [*_timing(file, journaled), *_damage(journaled), *_ended(journaled)]
            done.append(
                RecordedRun(
                    path=path,
                    outcome=journaled.outcome,
                    cycles=journaled.cycles,
                    periods=len(time_s),
                    duration_s=float(time_s[-1] - time_s[0]) if len(time_s) else 0.0,
                    sensors=readings,
                    losses=journaled.losses,
                    lost_bytes=journaled.lost_bytes,
                    damaged_bytes=journaled.damaged_bytes,
                    missing_records=sum(one.last - one.first + 1 for one in journaled.missing),
                    simulated=bool(journaled.header["simulated"]),
                    remarks=tuple(remarks),
                )
            )
        files.seal(target)

    files.write_all({path: write})
    return done[-1]


Content = tuple[FloatArray, dict[str, int], list[Caution]]
"""Time of each period, readings of each sensor, and remarks."""


def _periods(file: Any, journaled: JournalContent) -> Content:
    """Write the samples of a board."""
    board, header = journaled.streams["board"], journaled.header
    time_s, lines = _times(journaled)
    _attributes(file, journaled, {str(place): line for place, line in enumerate(lines)})
    _sampled(file, board, time_s, header)
    cuts, readings, bent = cut_short(journaled), {}, []
    for view in views_of(header):
        parts = list(sensor_readings(view, journaled, time_s, cuts))
        bent += _bent(view, parts, header.get("rig", {}).get("board", {}).get("straight_v"))
        readings[view.name] = _sensor(file, view, parts, journaled)
    return time_s, readings, [*_unsound(board), *bent]


def _bent(view: View, parts: Sequence[Columns], ends: Sequence[float] | None) -> list[Caution]:
    """Warn of readings that depend on levels at which the converter is not linear."""
    if ends is None or not parts:
        return []
    outside = []
    for part in parts:
        levels = [part[f"{name}_ambient"] + more for name in view.inputs for more in (0.0, part[name])]
        outside.append(np.any([(level < ends[0]) | (level > ends[1]) for level in levels], axis=0))
    share = float(np.concatenate(outside).mean())
    beyond = f"levels beyond {ends[0]:g} to {ends[1]:g}, where the converter is not linear"
    return (
        [prefixed(view.name, warning(f"{100 * share:.3g} % of the readings depend on {beyond}"))] if share > 0.0 else []
    )


def _clipped(group: Any, view: View) -> Iterator[Caution]:
    """Warn of readings with a sample at a limit of the converter's range."""
    marks = {name: np.asarray(group[f"{name}_clipped"]) for name in view.inputs}
    shares = [f"{name} {100 * own.mean():.3g} %" for name, own in marks.items() if own.any()]
    if shares:
        yield prefixed(view.name, warning(f"readings clipped at a limit of the converter's range: {', '.join(shares)}"))


def _unsound(board: Rows) -> list[Caution]:
    count = int(np.count_nonzero(board["flags"] & UNSOUND))
    late = warning(f"{count} periods that the board sampled late, or with a fault, gave no readings")
    return [late] if count else []


def _waveform(file: Any, journaled: JournalContent) -> Content:
    """Write the samples of a data acquisition."""
    header, wave = journaled.header, Waveform(file, journaled)
    _attributes(file, journaled, wave.lines)
    file.dimensions["period"] = len(wave.time_s)
    _variable(file, "time_s", ("period",), wave.time_s, "s", "time of a frame's first sample on the clock of the run")
    _variable(file, "part", ("period",), wave.part, "1", "part of the run, counted up each time it was resumed")
    _variable(file, "stretch", ("period",), wave.stretch, "1", "stretch of the part, counted up after each gap")
    _variable(file, "number", ("period",), wave.number, "1", "number of the frame's first sample in its stretch")
    coefficients = np.array(header["daq"]["coefficients"])
    file.dimensions["power"] = coefficients.shape[1]
    _variable(
        file, "coefficients", ("channel", "power"), coefficients, "V", "volts = sum of coefficient * counts^power"
    )
    cuts, views = cut_short(journaled), views_of(header)
    parts: dict[str, list[Columns]] = {view.name: [] for view in views}
    for view, found, kept in wave.readings(views):
        parts[view.name].append(columns_of(view, found, kept, journaled, cuts))
    readings = {view.name: _sensor(file, view, parts.pop(view.name), journaled) for view in views}
    file.attrs["remarks"] = json.dumps(wave.remarks)
    return wave.time_s, readings, wave.remarks


def _readings(file: Any, journaled: JournalContent) -> Content:
    """Write the readings of a meter: each as it arrived, and those of each sensor."""
    rows, header = journaled.streams["meter"], journaled.header
    half_s = 0.5 * (rows["t_s"] - rows["sent_s"] + header.get("clock_resolution_s", 0.0))
    time_s = rows["sent_s"] + half_s
    bound_s = float(half_s.mean()) if len(rows) else None
    _attributes(file, journaled, {"meter": ClockLine(0.0, 1.0, 0.0, bound_s)})
    file.dimensions = {"period": len(rows), "input": header["meter"]["inputs"]}
    _variable(file, "time_s", ("period",), time_s, "s", "midpoint of query and answer, on the clock of the run")
    _variable(file, "bound_s", ("period",), half_s, "s", "half-width of its error")
    _variable(file, "part", ("period",), rows["part"], "1", "part of the run, counted up each time it was resumed")
    for name, text in (("on", "inputs with the emitters on"), ("off", "inputs with the emitters off; NaN: unknown")):
        _variable(file, name, ("period", "input"), rows[name], header["meter"]["unit"], text)
    cuts, readings = cut_short(journaled), {}
    for view in views_of(header):
        inputs = inputs_of(view, header)
        columns = columns_of(view, _read_by(rows, time_s, inputs), np.ones(len(rows), bool), journaled, cuts)
        switched = header["meter"]["switched"]
        readings[view.name] = _sensor(file, view, [columns], journaled, switched=switched)
    return time_s, readings, []


def _read_by(rows: Rows, time_s: FloatArray, inputs: list[int]) -> Read:
    """Return the readings of some inputs: on minus off if off is known, otherwise on."""
    on, off = rows["on"][:, inputs], rows["off"][:, inputs]
    return Read(time_s, np.where(np.isfinite(off), on - off, on), off, rows["clipped"][:, inputs])


_CONTENT = {"board": _periods, "samples": _waveform, "meter": _readings}


def _times(journaled: JournalContent) -> tuple[FloatArray, list[ClockLine]]:
    """Return the time of each period on the run's clock, and the clock line of each segment."""
    board, came = journaled.streams["board"], journaled.streams["came"]
    times, lines = np.zeros(len(board)), []
    for first, last in stretches(board):
        mine = board[first:last]
        numbers, board_s = mine["number"], 1e-6 * mine["board_us"].astype(float)
        held = (came["part"] == mine["part"][0]) & (came["number"] >= numbers[0]) & (came["number"] <= numbers[-1])
        arrivals = came[held]
        # a period arrives when it is over
        over = np.interp(arrivals["number"] + 1.0, numbers, board_s) if len(arrivals) else board_s[:1]
        if len(arrivals):
            came_s = came_by(arrivals, journaled)
            line = fit_clock(over, came_s, exchanges(journaled, int(mine["part"][0]), came_s))
        else:
            line = fit_clock(over, over)
        lines.append(line)
        times[first:last] = line.at(board_s)
    return times, lines


def _attributes(file: Any, journaled: JournalContent, lines: Mapping[str, ClockLine]) -> None:
    header = {key: value for key, value in journaled.header.items() if key != "streams"}
    file.attrs["title"] = f"solen bench run: {header['protocol_name']} on {header['rig_name']}"
    file.attrs["source"] = f"solen {header['solen']}"
    file.attrs["simulated"] = "yes" if header["simulated"] else "no"
    file.attrs["outcome"] = journaled.outcome
    file.attrs["date"] = header["begun_utc"]
    file.attrs["control"] = " ".join(sensor["name"] for sensor in header["sensors"] if not sensor["lens"])
    file.attrs["header"] = json.dumps(header)
    file.attrs["events"] = json.dumps(journaled.events)
    file.attrs["clock"] = json.dumps({name: vars(line) for name, line in lines.items()})
    file.attrs["cut_short"] = json.dumps([[max(a, 0.0), b] for a, b in cut_short(journaled) if b < math.inf])
    file.attrs["losses"] = json.dumps(journaled.losses)
    file.attrs["lost_bytes"] = journaled.lost_bytes


def _sampled(file: Any, board: Rows, time_s: FloatArray, header: Mapping[str, Any]) -> None:
    counts = board["counts"]
    file.dimensions = {
        "period": len(board),
        "emitter": header["emitters"],
        "phase": 2,
        "input": header["receivers"],
    }
    _variable(file, "time_s", ("period",), time_s, "s", "start of the period on the clock of the run")
    _variable(file, "part", ("period",), board["part"], "1", "part of the run, counted up each time it was resumed")
    _variable(file, "number", ("period",), board["number"], "1", "number of the period by the board")
    _variable(file, "board_us", ("period",), board["board_us"], "us", "start of the period by the board's own clock")
    _variable(
        file,
        "flags",
        ("period",),
        board["flags"],
        "1",
        "1 late, 2 emitter at fault (no readings), 4 restarted",
    )
    dims = ("period", "emitter", "phase", "input")
    unit, text = signal_unit(header), "of an input; phase 0 with the emitter on, 1 with it off again"
    name = "voltage" if unit == "V" else "signal"
    values = create_variable(file, name, dims, counts.shape, counts.dtype, unit, f"{name} {text}", AT_ONCE)
    values.attrs["scale_factor"] = header["volts_per_count"]
    for begin in range(0, len(board), AT_ONCE):
        values[begin : begin + AT_ONCE] = counts[begin : begin + AT_ONCE]


def _positions(file: Any, journaled: JournalContent) -> None:
    for motion in motions_of(journaled.header):
        stage, looks = journaled.streams[stream_of(motion)], looks_of(journaled, motion)
        own = f"{motion}_" if motion else ""
        file.dimensions[f"{own}look"] = len(stage)
        for name, values, unit, text in (
            ("stage_time_s", looks.time_s, "s", "time of the position: the midpoint of query and answer"),
            ("stage_bound_s", looks.bound_s, "s", "half-width of its error"),
            ("stage_answer_s", stage["t_s"], "s", "when its answer arrived, on the run's clock as read"),
            ("stage_position", looks.position, journaled.header["unit"], "where it was"),
        ):
            _variable(file, f"{own}{name}", (f"{own}look",), values, unit, text)


def _ended(journaled: JournalContent) -> list[Caution]:
    """State why a run ended early."""
    ends = [event for event in journaled.events if event["what"] in {"stopped", "fault"}]
    if not ends or journaled.outcome == "done":
        return []
    return [warning(f"the run ended early: {ends[-1]['reason']}")]


def _damage(journaled: JournalContent) -> list[Caution]:
    """State the missing parts of a damaged journal."""
    if not journaled.damaged:
        return []
    places = ", ".join(map(str, journaled.missing[:_NAMED]))
    more = f" and records in {len(journaled.missing) - _NAMED} more gaps" if len(journaled.missing) > _NAMED else ""
    lacks = f"missing: {places}{more}" if places else "the missing records are unknown"
    kept = f"the journal is damaged and kept: {journaled.damaged_bytes} bytes cannot be read as records; {lacks}"
    return [warning(kept)]


def _timing(file: Any, journaled: JournalContent) -> list[Caution]:
    """State the timing uncertainty due to clocks and lines, for hysteresis; with a remark if it is notable."""
    header, remarks = journaled.header, []
    lines = [ClockLine(**line) for line in json.loads(file.attrs["clock"]).values()]
    protocol = Protocol(**header["protocol"])
    for motion in motions_of(header):
        stage = journaled.streams[stream_of(motion)]
        timing = Timing.of(stage, header.get("clock_resolution_s", 0.0), lines)
        for name, value in timing.attributes.items():
            file.attrs[f"{motion} {name}" if motion else name] = value
        if not known_at_rest_alone(stage):
            remark = timing.remark(protocol.fastest, reach_of(stage["position"]), protocol.unit)
            remarks += [] if remark is None else [prefixed(motion, remark)]
    return remarks


def _sensor(file: Any, view: View, parts: list[Columns], journaled: JournalContent, *, switched: bool = True) -> int:
    """Write a sensor's group, for a network one for each emitter, and return the number of readings.

    Receivers are in their unit. The ambient light is unknown for emitters that are on all the time.
    """
    # pieces are freed while they are joined
    columns = {name: np.concatenate([part.pop(name) for part in parts]) for name in list(parts[0])} if parts else {}
    group = file.create_group(view.name)
    group.attrs["sensor"] = view.name
    group.attrs["lens"] = "yes" if view.sensor["lens"] else "no"
    for key, value in view.sensor.get("drawn", {}).items():
        group.attrs[f"drawn {key}"] = value
    unit, header = signal_unit(journaled.header), journaled.header
    if header.get("load_cell") is not None and columns:
        cell = LoadCell(**header["load_cell"])
        zero_V = _without_load_V(cell, columns, journaled)
        columns["force_N"] = cell.force_N(columns.pop(CELL), zero_V)
        group.attrs["load_cell_zero_V"] = zero_V
    readings = len(columns["time_s"]) if columns else 0
    group.dimensions = {"reading": readings}
    described = _described(view, header, unit, switched=switched)
    for name, (own_unit, text) in described.items():
        values = columns[name] if columns else np.zeros(0)
        _variable(group, name, ("reading",), values, own_unit, text)
    return readings


def _described(view: View, header: Mapping[str, Any], unit: str, *, switched: bool) -> dict[str, tuple[str, str]]:
    """Return unit and description of each column of a sensor."""
    made = f"{_MADE[switched]}{'; lower is brighter' if switched and unit == 'V' else ''}"
    found = {"time_s": ("s", "time of the emitter's on phase on the clock of the run")}
    for motion, driven in motions_of(header).items():
        found[drive_of(motion, driven)] = _drive_in_words(motion, driven)
    if header.get("load_cell") is not None:
        found["force_N"] = "N", "force by the load cell, the mean of on and off"
    found |= {name: (unit, f"{name} receiver, {made}") for name in view.inputs}
    if switched:
        found |= {f"{name}_ambient": (unit, f"{name} receiver with the emitter off") for name in view.inputs}
    clipped = "receiver was at an end of the converter's range"
    return found | {f"{name}_clipped": ("1", f"1 where a sample of the {name} {clipped}") for name in view.inputs}


def _drive_in_words(motion: str, driven: Mapping[str, Any]) -> tuple[str, str]:
    """Return the unit of the quantity that drives a sensor, and a description of its values."""
    by = "then, by a monotone cubic between the stage's positions"
    if driven.get("drives") == "depth":
        return "mm", f"depth of the finger {by}"
    return "deg", f"angle of {motion or 'the sensor'} {by}"


def _without_load_V(cell: LoadCell, columns: Columns, journaled: JournalContent) -> float:
    """Return the voltage of a load cell without load: as stated, or its mean at rest before the first cycle.

    The result is NaN if unknown.
    """
    if cell.zero_V is not None:
        return cell.zero_V
    rest = next((event["t_s"] for event in journaled.events if event["what"] == "at rest"), math.inf)
    ends = (event["t_s"] for event in journaled.events if event["what"] == "cycle" and event["t_s"] >= rest)
    resting = columns[CELL][(columns["time_s"] >= rest) & (columns["time_s"] <= next(ends, math.inf))]
    known = resting[np.isfinite(resting)]
    return float(known.mean()) if known.size else math.nan


def _overloaded(file: Any, journaled: JournalContent) -> list[Caution]:
    """Warn of readings with the load cell at a limit of its input's range, or its voltage without load unknown."""
    if journaled.header.get("load_cell") is None:
        return []
    forces = [file.groups[view.name].variables["force_N"][...] for view in views_of(journaled.header)]
    missing = int(np.isnan(np.concatenate(forces)).sum())
    limit = "readings have no force: the load cell was at a limit of the input's range, or never recorded without load"
    return [do_not_use(f"{missing} {limit}")] if missing else []


_MADE = {True: "on less the mean of off before and after", False: "emitters being on all the time"}


def _variable(group: Any, name: str, dims: tuple[str, ...], values: NDArray[Any], unit: str, text: str) -> None:
    variable = create_variable(group, name, dims, values.shape, values.dtype, unit, text, 4 * AT_ONCE)
    variable[...] = values
