"""A recording from start to end: a protocol run on a rig, its journal closed, the file entered into the catalogue.

The journal is kept until its recording has been written and read back. An interrupted run is resumed after its last
complete cycle, or closed as it is; a lock prevents both while the run is in progress.

Public names: `record`, `RecordOptions`, `recover` and `close_journal`.
"""

import datetime as dt
import math
import platform
import shutil
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from solen import __version__, files
from solen.bench.axes import STREAM
from solen.bench.catalogue import Catalogue, header_of
from solen.bench.clock import Clock, SimulatedClock, WallClock
from solen.bench.drivers import DRIVERS, open_instruments
from solen.bench.homing import Confirm, ensure_zero
from solen.bench.interrupts import Ended, ended_by_signals, uninterrupted
from solen.bench.journal import SUFFIX, Journal, read_journal, reserve_of
from solen.bench.journal_content import JournalContent
from solen.bench.lock import locked
from solen.bench.netcdf import RecordedRun, check_installed, write_recording
from solen.bench.protocol import Protocol, load_protocol
from solen.bench.rig import Rig, check_names, load_rig
from solen.bench.rig_instruments import StageTable
from solen.bench.roles import Sampler, Stage
from solen.bench.run import Instruments, Watch, begin, check_motions, run
from solen.errors import BenchError, DataError, OutputError, SolenError, SpecError
from solen.spec.strict import Options

READ_S = 0.1
"""Interval in s at which a sampler is read; a kill may lose the data of this interval."""
MIN_SIMULATED_READ_S, MAX_SIMULATED_READ_S = 1.0, 10.0
"""Shortest and longest interval in s at which a simulated sampler is read; its time passes faster than real time."""
SIZE_FACTOR, EXTRA_BYTES = 1.5, 1 << 18
"""A recording needs at most the first factor times the size of its journal, plus the second number of bytes."""
MIN_PAUSE_S = 1.0
"""Shortest time in s from the end of one part of a run to the beginning of the next."""
MIN_HOLD_QUERIES = 5
"""Smallest number of position queries during a hold, for a stage whose position is known only at rest."""
Report = Callable[[str], None]


class RecordOptions(Options):
    """Options of a recording."""

    name: str | None = None
    """Name of the recording; default: that of the protocol file."""
    seed: Annotated[int, Field(ge=0, lt=1 << 63)] | None = None
    """Seed that replaces the one in the file of a simulated rig: other sensors, other noise."""
    resume: bool = False
    """Resume a run that was stopped or killed, after its last complete cycle."""
    real_time: bool = False
    """Run a simulated rig in real time."""


def record(
    protocol_file: Path,
    rig_file: Path,
    folder: Path,
    options: RecordOptions = RecordOptions(),
    *,
    watch: Watch | None = None,
    report: Report | None = None,
    confirm: Confirm | None = None,
) -> RecordedRun:
    """Run a protocol on a rig and close the recording.

    Parameters
    ----------
    protocol_file, rig_file
        Motion of the stage, and the instruments and sensors.
    folder
        Folder of the recording; created if missing.
    watch, report
        Called with the state of the run, and with the progress of its preparation.
    confirm
        Asks the operator whether a stage may be homed, if the rig does not allow it.

    Raises
    ------
    BenchError, SpecError, DataError, DesignError, OutputError
        If a file is invalid, an instrument fails, or an output cannot be written. The data recorded until then are in
        the journal.
    Ended
        If Ctrl-C or a signal ended the run; the emitters are off, the stage is at rest, and the message states what is
        kept.
    """
    check_installed()
    protocol, rig = load_protocol(protocol_file), load_rig(rig_file)
    if options.seed is not None:
        rig = rig.model_copy(update={"seed": options.seed})
    _check_compatible(protocol, rig, protocol_file, rig_file)
    if options.real_time and not rig.simulated:
        limit = "is for a simulated rig; a real rig always runs in real time"
        raise SpecError("--real-time", limit=limit, remedy="omit it")
    name = options.name or protocol_file.stem
    files.check_name("--name", name, SpecError)
    path, target = folder / f"{name}{SUFFIX}", folder / f"{name}.nc"
    simulated_time = rig.simulated and not options.real_time
    with files.output_folder(folder), locked(path):
        if target.exists() and not (path.exists() and _is_recording_of(target, path)):
            raise OutputError(str(target), limit="already exists", remedy="specify another --name")
        if path.exists() and not options.resume:
            limit, remedy = "already exists, from a run that was not closed", "use solen bench recover, or --resume"
            raise BenchError(str(path), limit=limit, remedy=remedy)
        journal, previous = None, None
        if options.resume:
            journal, previous = _resume(path, {protocol_file: protocol, rig_file: rig})
        clock = _clock(simulated_time, previous)
        noise = _noise(rig, options.name, previous)
        with (
            ended_by_signals(),
            _instruments(rig, protocol, rig_file.parent, clock, noise, report) as (stages, sampler, drawn),
        ):
            for motion, axis in rig.axes.items():
                ensure_zero(stages[motion], axis.home, axis.zero, confirm, resumed=previous is not None)
            travel = {motion: axis.travel for motion, axis in rig.axes.items()}
            read_s = _read_interval_s(protocol, simulated_time)
            instruments = Instruments(stages, sampler, clock, read_s, travel, rig.load_cell)
            if journal is None:
                header = _header(protocol, rig, rig_file.parent, simulated_time)
                journal = begin(path, instruments, header | drawn)
            with journal, _with_advice(path):
                run(protocol, instruments, journal, previous=previous, watch=watch)
        return close_journal(path, target)


def recover(path: Path) -> RecordedRun:
    """Close the journal of a run that was killed, stopped or failed."""
    if path.suffix != SUFFIX:
        raise SpecError(str(path), limit=f"is not a {SUFFIX} file", remedy="specify the journal of the run")
    target = path.with_suffix(".nc")
    with locked(path):
        if target.exists() and not _is_recording_of(target, path):
            raise OutputError(str(target), limit="already exists", remedy="move it away")
        return close_journal(path, target)


def close_journal(path: Path, target: Path) -> RecordedRun:
    """Write the recording of a journal, enter it into the catalogue, and only then remove the journal.

    A damaged journal is never removed. If the process is killed meanwhile, the journal remains, and the recording is
    written again the next time.
    """
    files.remove_leftovers(target)
    _check_disk_space(path, target)
    content = read_journal(path)
    recorded = write_recording(content, target)
    entry = Catalogue(target.parent).add(target)
    if entry.periods != content.counts[content.sampler_stream]:
        raise OutputError(str(target), limit="differs from the journal", remedy=f"keep {path.name}")
    files.remove(reserve_of(path))
    if not content.damaged:
        files.remove(path)
    return recorded


@contextmanager
def _with_advice(path: Path) -> Iterator[None]:
    """To an error that ends the run, add where the recorded data are and how to continue."""
    advice = (
        f"the recorded data are in {path}: continue with --resume, or finish the recording with solen bench recover"
    )
    try:
        yield
    except KeyboardInterrupt as bad:
        line = str(bad) or "interrupted"
        state = "; ".join(getattr(bad, "__notes__", ())) or "emitters off, stage stopped"
        raise Ended(f"{line}; {state}; {advice}", getattr(bad, "exit_code", 130)) from None
    except SolenError as bad:
        remedy = "; ".join([*filter(None, [bad.remedy]), *getattr(bad, "__notes__", ()), advice])
        raise type(bad)(bad.what, value=bad.value, limit=bad.limit, remedy=remedy) from None


def _check_disk_space(path: Path, target: Path) -> None:
    """Raise `OutputError` if the disk has no space for the recording of a journal."""
    if not path.exists():
        return
    needed = int(SIZE_FACTOR * path.stat().st_size) + EXTRA_BYTES
    free = shutil.disk_usage(target.absolute().parent).free
    if free < needed:
        limit = f"needs up to {1e-6 * needed:.2g} MB, and {1e-6 * free:.2g} MB are free"
        raise OutputError(str(target), limit=limit, remedy=f"free some space, then run solen bench recover {path.name}")


def _is_recording_of(target: Path, journal: Path) -> bool:
    """Whether a recording was made from a journal that a killed process did not remove."""
    try:
        return header_of(target) == _without_streams(read_journal(journal).header)
    except DataError:
        return False


def _without_streams(header: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in header.items() if key != "streams"}


def _check_compatible(protocol: Protocol, rig: Rig, protocol_file: Path, rig_file: Path) -> None:
    unit = rig.motion_unit
    if protocol.unit != unit:
        remedy = f"use a protocol in {unit}, or another rig"
        limit = f"is in {protocol.unit}, and the stage moves in {unit}"
        raise BenchError(str(protocol_file), limit=limit, remedy=remedy)
    check_motions(protocol, rig.axes, str(protocol_file))
    for number, step in enumerate(protocol.steps):
        for motion, target in step.targets.items() if step.to_N is None else ():
            low, high = rig.axes[motion].travel or (-math.inf, math.inf)
            if not low <= target <= high:
                limit = f"is outside the travel in {rig_file}, {low:g} to {high:g} {unit}"
                remedy = "change the target, or widen travel in the rig file"
                raise BenchError(f"{protocol_file}: step[{number}]", value=target, limit=limit, remedy=remedy)
    known_only_at_rest = any(axis.driver in DRIVERS and DRIVERS[axis.driver].stops for axis in rig.axes.values())
    if known_only_at_rest:
        _check_holds(protocol, protocol_file)
    if protocol.forces_N:
        _check_forces(max(protocol.forces_N), rig, f"{protocol_file}: to_N", known_only_at_rest=known_only_at_rest)
    if rig.load_cell is not None and rig.load_cell.zero_V is None and protocol.rest_s == 0.0:
        limit = "must be above 0: the load cell's voltage without load is measured at rest before the first cycle"
        remedy = "set it to 0.5, or specify load_cell.zero_V"
        raise BenchError(f"{protocol_file}: rest_s", value=0.0, limit=limit, remedy=remedy)
    if rig.simulated and {rig.sampler.driver, *(axis.driver for axis in rig.axes.values())} != {"simulated"}:
        limit, remedy = "has both real and simulated instruments", "make all of them real or all of them simulated"
        raise BenchError(str(rig_file), limit=limit, remedy=remedy)


def _check_forces(largest_N: float, rig: Rig, what: str, *, known_only_at_rest: bool) -> None:
    """Raise `BenchError` for steps to a force that the rig cannot produce, or that might not end."""
    cell, limit, remedy = rig.load_cell, "", ""
    if cell is None:
        limit, remedy = "requires a load cell", "add [load_cell] to the rig, or use to_mm"
    elif rig.stage.drives != "depth":
        limit, remedy = "requires a stage that presses", 'set drives = "depth" in [stage]'
    elif rig.stage.travel is None:
        limit, remedy = "requires a limit of the depth", "add travel to [stage], for example [-1.0, 1.0]"
    elif known_only_at_rest:
        limit = f"requires a stage whose position is known while it moves; that of {rig.stage.driver} is not"
        remedy = "use to_mm"
    elif cell.capacity_N is not None and largest_N > cell.capacity_N:
        limit, remedy = f"exceeds the capacity of the load cell, {cell.capacity_N:g} N", "reduce the force"
    if limit:
        raise BenchError(what, value=largest_N, limit=limit, remedy=remedy)


def _check_holds(protocol: Protocol, protocol_file: Path) -> None:
    """Raise `BenchError` for holds that are too short for a stage whose position is known only at rest."""
    shortest_s = MIN_HOLD_QUERIES / protocol.position_rate_hz
    for number, step in enumerate(protocol.steps):
        if step.hold_s < shortest_s:
            limit = f"must be at least {shortest_s:g} s: the position of the stage is known only at rest"
            raise BenchError(f"{protocol_file}: step[{number}].hold_s", value=step.hold_s, limit=limit)


def _resume(path: Path, tables: dict[Path, Protocol | Rig]) -> tuple[Journal, JournalContent]:
    """Return the journal of a run and its content, checked against the files of the protocol and the rig."""
    if not path.exists():
        raise BenchError(str(path), limit="does not exist: there is no run to resume", remedy="omit --resume")
    header = read_journal(path).header
    for key, (file, table) in zip(("protocol", "rig"), tables.items(), strict=True):
        if header[key] != table.model_dump(mode="json"):
            remedy = "change it back, or close the journal with solen bench recover"
            raise BenchError(str(file), limit="differs from the file with which the run began", remedy=remedy)
    return Journal.resume(path)


def _header(protocol: Protocol, rig: Rig, folder: Path, simulated_time: bool) -> dict[str, Any]:
    """Return the header, which contains all settings of a run."""
    designs = {sensor.design: files.read_text(folder / sensor.design, DataError) for sensor in rig.sensor}
    return {
        "solen": __version__,
        "python": platform.python_version(),
        "system": platform.platform(),
        "begun_utc": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"),
        "simulated": rig.simulated,
        "clock": "as fast as it can be computed" if simulated_time else "wall",
        "seed": rig.seed,
        "protocol_name": protocol.name,
        "rig_name": rig.name,
        "protocol": protocol.model_dump(mode="json"),
        "rig": rig.model_dump(mode="json"),
        "designs": designs,
        "sensors": [sensor.model_dump(mode="json") for sensor in rig.sensor],
        **(
            {"motions": {name: _conversion(stage) for name, stage in rig.stages.items()}}
            if rig.stages
            else _conversion(rig.stage)
        ),
        "load_cell": None if rig.load_cell is None else rig.load_cell.model_dump(mode="json"),
        "signal_unit": rig.unit,
        "top_count": 2**rig.board.bits - 1,
    }


def _conversion(stage: StageTable) -> dict[str, Any]:
    """Return the settings of a stage that convert its positions to angles or depths."""
    return {"zero": stage.zero, "lever_mm": stage.lever_mm, "drives": stage.drives}


def _clock(simulated_time: bool, previous: JournalContent | None) -> Clock:
    """Return the clock of a run; that of a resumed run continues the clock of the previous parts."""
    if previous is None:
        return SimulatedClock() if simulated_time else WallClock()
    streams = ("came", *(name for name in previous.streams if name.startswith(STREAM)))
    last_s = max(float(previous.streams[name]["t_s"][-1:].max(initial=0.0)) for name in streams)
    if simulated_time:
        return SimulatedClock(last_s + MIN_PAUSE_S)
    elapsed = dt.datetime.now(dt.UTC) - dt.datetime.fromisoformat(previous.header["begun_utc"])
    return WallClock(max(elapsed.total_seconds(), last_s + MIN_PAUSE_S))


def _noise(rig: Rig, name: str | None, previous: JournalContent | None) -> np.random.Generator:
    """Return the generator of a simulated rig's noise, which depends on the part of the run and on --name."""
    part = 0 if previous is None else 1 + previous.parts
    return np.random.default_rng([rig.seed, 1, part, *([] if name is None else [zlib.crc32(name.encode())])])


def _read_interval_s(protocol: Protocol, simulated_time: bool) -> float:
    if not simulated_time:
        return READ_S
    return min(max(MIN_SIMULATED_READ_S, protocol.shortest_s / 300.0), MAX_SIMULATED_READ_S)


@contextmanager
def _instruments(
    rig: Rig, protocol: Protocol, folder: Path, clock: Clock, noise: np.random.Generator, report: Report | None
) -> Iterator[tuple[Mapping[str, Stage], Sampler, dict[str, Any]]]:
    """Yield stages and sampler of a rig, closed on exit, and the header's entry of the simulated sensors."""
    stages: Mapping[str, Stage]
    sampler: Sampler
    drawn: dict[str, Any] = {}
    if rig.simulated:
        from solen.bench.simulated.instruments import simulated_instruments  # the tracer is loaded only if needed

        stages, sampler, sensors = simulated_instruments(rig, protocol, folder, clock, noise, report)
        drawn = {"sensors": sensors}
    else:
        check_names(rig, folder)
        stages, sampler = open_instruments(rig, clock)
    try:
        yield stages, sampler, drawn
    finally:
        with uninterrupted():
            for instrument in (sampler, *stages.values()):
                # the reason why the run ended matters more; the journal names what could not be stopped
                with suppress(SolenError):
                    instrument.close()
