"""A run: the steps of a protocol on the instruments of a rig, with all data written to the journal as they arrive.

One loop waits, queries the position of the stage and the samples of the sampler, and writes both to the journal before
anything else. Whatever ends a run, the end of the protocol, Ctrl-C or a fault, the emitters are switched off and the
stage stops, in that order, and the journal states the reason. Completed cycles are recorded, and an interrupted run is
resumed after the last of them.

Public names: `Instruments`, `begin`, `run` and `Tick`.
"""

import datetime as dt
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from solen.analysis.load_cell import LoadCell
from solen.arrays import FloatArray
from solen.bench.axes import Axis, axes_of, stream_of
from solen.bench.clock import Clock
from solen.bench.interrupts import Ended, uninterrupted
from solen.bench.journal import Journal
from solen.bench.journal_content import JournalContent
from solen.bench.protocol import Protocol, Step
from solen.bench.roles import Sampler, Stage
from solen.bench.sampling import Counts, sampling_of
from solen.bench.timing import EXCHANGE, STAGE
from solen.errors import BenchError, SolenError

MAX_DELAY_S = 10.0
"""Longest time in s by which a move may exceed its shortest possible duration."""
MAX_SILENCE_S = 2.0
"""Longest time in s for which a board may send nothing."""
COMPARISON_INTERVAL_S, EXCHANGES = 1.0, 5
"""Interval in s at which clocks are compared while the stage is at rest, and number of exchanges in each comparison."""


@dataclass(frozen=True)
class Instruments:
    """Instruments and sensors of a run.

    Attributes
    ----------
    stage, sampler, clock
        The stage, or several keyed by motion; the board, DAQ device or meter; and the clock of the run.
    read_interval_s
        Interval at which the sampler is read; a kill may lose the data of this interval.
    travel
        Lowest and highest allowed position of the stage, or of each, keyed by motion; None if only the stage's own
        limits apply.
    cell
        Load cell for steps to a force.
    """

    stage: Stage | Mapping[str, Stage]
    sampler: Sampler
    clock: Clock
    read_interval_s: float = 0.1
    travel: Mapping[str, tuple[float, float] | None] | tuple[float, float] | None = None
    cell: LoadCell | None = None

    @property
    def stages(self) -> dict[str, Stage]:
        """Stages, keyed by motion; a single stage has no name."""
        return dict(self.stage) if isinstance(self.stage, Mapping) else {"": self.stage}


@dataclass(frozen=True, eq=False)
class Tick:
    """State of a run for display.

    Attributes
    ----------
    t_s
        Time of the run.
    cycle, cycles
        Number of the cycle, from 1, and number of cycles.
    position
        Position of each stage, keyed by motion; a single stage has no name.
    counts
        Counts of the last period (emitters, 2, receivers), or the lowest and highest count of each input in it
        (1, 2, inputs); None before the first period.
    """

    t_s: float
    cycle: int
    cycles: int
    position: dict[str, float]
    counts: Counts | None

    @property
    def levels(self) -> FloatArray:
        """Drop at each input as a fraction of the highest off level; empty before the first period."""
        if self.counts is None:
            return np.empty(0)
        on, off = self.counts[:, 0, :].min(axis=0), self.counts[:, 1, :].max(axis=0)
        return np.asarray((off.astype(float) - on) / max(float(off.max()), 1.0))


Watch = Callable[[Tick], None]


def begin(path: Path, instruments: Instruments, header: Mapping[str, Any]) -> Journal:
    """Create the journal of a run; its header describes protocol, rig and instruments."""
    sampling, stages = sampling_of(instruments.sampler), instruments.stages
    common = {
        "stage": ", ".join(stage.name for stage in stages.values()),
        "unit": next(iter(stages.values())).unit,
        "clock_resolution_s": instruments.clock.resolution_s,
    }
    streams = {**sampling.streams(), **{stream_of(motion): STAGE for motion in stages}, "exchange": EXCHANGE}
    return Journal.create(path, {**header, **sampling.header(), **common}, streams)


def run(
    protocol: Protocol,
    instruments: Instruments,
    journal: Journal,
    *,
    previous: JournalContent | None = None,
    watch: Watch | None = None,
) -> None:
    """Run a protocol, or resume an interrupted run after its last complete cycle.

    However the run ends, the emitters are switched off, the stages are stopped, and the journal states the reason. If
    an instrument cannot be stopped, this is recorded in the journal, and a note that names the instrument is added to
    the exception that ended the run.

    Parameters
    ----------
    protocol, instruments, journal
        The motion, the instruments, and the journal to which the data are written.
    previous
        Content of the journal of the interrupted run; None for a new run.
    watch
        Called with the state of the run.

    Raises
    ------
    BenchError
        If the protocol does not suit the stages, or an instrument fails.
    KeyboardInterrupt
        If Ctrl-C ends the run.
    """
    stages = instruments.stages
    for stage in stages.values():
        if stage.unit != protocol.unit:
            limit = f"is in {protocol.unit}, and the stage {stage.name} moves in {stage.unit}"
            raise BenchError("protocol", limit=limit, remedy=f"use a protocol in {stage.unit}")
    check_motions(protocol, stages)
    part, done = (0, 0) if previous is None else (previous.parts, previous.cycles)
    runner = _Runner(protocol, instruments, journal, part, done, watch)
    outcome, reason = "done", ""
    error: BaseException | None = None
    try:
        runner.run()
    except BaseException as bad:
        error = bad
        outcome = "stopped" if isinstance(bad, KeyboardInterrupt) else "fault"
        reason = str(bad) if isinstance(bad, SolenError | Ended) else type(bad).__name__
        raise
    finally:
        with uninterrupted():
            end = {"outcome": outcome, "reason": reason, "losses": vars(instruments.sampler.losses)}
            for line in runner.shut_down():
                if error is not None:
                    error.add_note(line)
            journal.event(runner.now_s, outcome, **end)
            if outcome == "done":
                journal.end(**end)
            journal.sync()


def check_motions(protocol: Protocol, known: Collection[str], what: str = "protocol") -> None:
    """Raise `BenchError` for a motion of a protocol that no stage makes."""
    for motion in protocol.ranges:
        if motion in known:
            continue
        motions = ", ".join(known)
        if not motion:
            remedy = f"use to_deg = {{{next(iter(known))} = ...}}"
            raise BenchError(what, limit=f"must name the motions of the rig, {motions}", remedy=remedy)
        limit = f"is not a motion of the rig, which has {motions}" if motions else "the rig has only one motion"
        raise BenchError(f"{what}: step", value=motion, limit=limit)


@dataclass
class _Runner:
    """One run in progress."""

    protocol: Protocol
    instruments: Instruments
    journal: Journal
    part: int
    done: int
    watch: Watch | None
    _read_s: float = 0.0
    _data_s: float = 0.0
    _due_s: float = 0.0
    _last: Counts | None = None
    _cycle: int = 0
    _compared_s: float = -math.inf
    _cell_V: list[float] = field(default_factory=list)
    _zero_V: float = math.nan

    def __post_init__(self) -> None:
        self._sampling = sampling_of(self.instruments.sampler)
        self._axes = axes_of(self.instruments.stage, self.instruments.clock, self.part, self.instruments.travel)

    @property
    def now_s(self) -> float:
        return self.instruments.clock.now_s()

    def run(self) -> None:
        """Run from the beginning, or from the first cycle that is not done, to the end."""
        utc = dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")
        self.journal.event(self.now_s, "begun", part=self.part, cycle=self.done + 1, utc=utc)
        if no_watchdog := getattr(self.instruments.sampler, "no_watchdog", None):
            self.journal.event(self.now_s, "remark", reason=no_watchdog)
        self._exchange(self._sampling.start)
        self._due_s = self._read_s = self._data_s = self.now_s
        self._cycle = self.done + 1
        self._move(self._initial_step())
        self.journal.event(self.now_s, "at rest")
        self._cell_V.clear()
        self._hold(self.protocol.rest_s)
        self._tare()
        for cycle in range(self.done + 1, self.protocol.all_cycles + 1):
            self._cycle = cycle
            self.journal.event(self.now_s, "cycle", number=cycle)
            for number, step in enumerate(self.protocol.steps_of(cycle), 1):
                self.journal.event(self.now_s, "step", number=number, **_target_entry(step))
                self._move(step) if step.to_N is None else self._press(step, step.to_N)
                self.journal.event(self.now_s, "arrived", number=number)
                self._hold(step.hold_s)
            self._read()
            self.journal.event(self.now_s, "cycle done", number=cycle)
        self._hold(self.protocol.rest_s)
        self._read()

    def shut_down(self) -> list[str]:
        """Switch the emitters off, stop the stages even if that fails, and record the last positions.

        Returns a line for each instrument that could not be stopped.
        """
        not_stopped = []
        stages = [(axis.name, axis.stage.stop) for axis in self._axes.values()]
        for name, stop in (("board", self.instruments.sampler.stop), *stages):
            try:
                stop()
            except SolenError as bad:
                self.journal.event(self.now_s, "not stopped", instrument=name, reason=str(bad))
                not_stopped.append(f"{name} not stopped: {bad}")
        self._write_positions()
        return not_stopped

    def _initial_step(self) -> Step:
        """Return the move to the position at which a cycle ends, and therefore begins."""
        last = self.protocol.steps[-1]
        if "" in last.targets:
            return last
        targets: dict[str, float] = {}
        for step in self.protocol.steps:
            targets |= step.targets
        return last.model_copy(update={f"to_{last.unit}": targets})

    def _move(self, step: Step) -> None:
        """Move and wait for arrival; meanwhile the sampler's clock is not queried."""
        due: dict[str, float] = {}
        starts = {motion: self._axes[motion].query() for motion in step.targets}
        for motion, target in step.targets.items():
            self._axes[motion].check_travel(step, starts[motion], target)
        for motion, target in step.targets.items():
            start = starts[motion]
            self._axes[motion].stage.begin_move(target, step.velocity)
            due[motion] = self.now_s + (abs(target - start) / step.velocity if math.isfinite(start) else 0.0)
        for motion, arrives_s in due.items():
            self._wait(self._axes[motion], step, arrives_s)

    def _wait(self, axis: Axis, step: Step, arrives_s: float) -> None:
        patience_s = getattr(axis.stage, "patience_s", MAX_DELAY_S)
        while not axis.arrived(step, arrives_s):
            if self.now_s > arrives_s + patience_s:
                target = f"{step.targets[axis.motion]:g} {step.unit}"
                limit = f"has not reached {target} within {patience_s:.0f} s of the expected time"
                raise BenchError(axis.stage.name, limit=limit, remedy="check that it is free to move")
            self._tick(self.now_s + 1.0)

    def _tare(self) -> None:
        """Determine the load cell's zero from the preceding rest, unless the rig file specifies it."""
        cell = self.instruments.cell
        if cell is None:
            return
        self._read()
        at_rest = float(np.mean(self._cell_V)) if self._cell_V else math.nan
        self._zero_V = at_rest if cell.zero_V is None else cell.zero_V

    def _press(self, step: Step, to_N: float) -> None:
        """Move until the load cell reads a force, deeper or back, and stop there.

        The stage overshoots by its velocity times the duration of a query and a reading; the overshoot is not
        corrected.
        """
        (axis,) = self._axes.values()
        low, high = axis.travel or (math.nan, math.nan)  # a protocol with these steps requires both limits
        start = axis.query()
        deeper = self._force_N() < to_N
        end = high if deeper else low
        axis.check_travel(step, start, end)
        axis.stage.begin_move(end, step.velocity)
        while (self._force_N() < to_N) == deeper:
            if axis.stage.on_target():
                limit = f"reads {self._force_N():.3g} N instead of {to_N:g} N at the end of travel, {end:g} {step.unit}"
                name = self.instruments.cell.name if self.instruments.cell else "load cell"
                raise BenchError(name, limit=limit, remedy="check that the finger touches the sensor")
            self._tick(self.now_s + 1.0)
            self._read()
        axis.stage.stop()
        axis.query()

    def _force_N(self) -> float:
        """Return the force in the latest reading; raise `BenchError` without a reading."""
        cell = self.instruments.cell
        if cell is None or not (self._cell_V and math.isfinite(self._zero_V)):
            raise BenchError("load cell", limit="has no reading for a step to a force", remedy="check its input")
        return cell.sensitivity_N_per_V * (self._cell_V[-1] - self._zero_V)

    def _hold(self, duration_s: float) -> None:
        until = self.now_s + duration_s
        while until - self.now_s > 1e-9:
            if self.now_s - self._compared_s >= COMPARISON_INTERVAL_S:
                self._compare_clocks()
            self._tick(until)

    def _compare_clocks(self) -> None:
        """Compare the sampler's clock with the run's, as long as the sampler has one and replies."""
        for _ in range(EXCHANGES):
            if not self._exchange(self._sampling.time_s):
                break
        self._compared_s = self.now_s

    def _exchange(self, query: Callable[[], float | None]) -> bool:
        """Record the time of the sampler's clock, and those of query and reply; return False if there is no clock."""
        sent_s = self.now_s
        device_s = query()
        if device_s is not None:
            row = np.array([(self.part, sent_s, self.now_s, device_s)], self.journal.dtype("exchange"))
            self.journal.rows("exchange", row)
        return device_s is not None

    def _tick(self, until_s: float) -> None:
        """Wait until the next query of the positions is due, then query them; read the sampler if that is due."""
        self._due_s = max(self._due_s + 1.0 / self.protocol.position_rate_hz, self.now_s)
        self.instruments.clock.sleep(max(0.0, min(self._due_s, until_s) - self.now_s))
        position = {motion: axis.query() for motion, axis in self._axes.items()}
        if self.now_s - self._read_s >= self.instruments.read_interval_s:
            self._read()
            if self.watch is not None:
                self.watch(Tick(self.now_s, self._cycle, self.protocol.all_cycles, position, self._last))

    def _read(self) -> None:
        """Record the positions of the stages, then fetch samples and record them."""
        self._write_positions()
        block = self._sampling.read()
        self._read_s = self.now_s
        for notice in block.notices:
            self.journal.event(self.now_s, "remark", reason=notice)
        if block.last is None:
            self._check_silence()
            return
        self._data_s, self._last = self.now_s, block.last
        block.rows["part"] = self.part
        cell = self.instruments.cell
        if cell is not None and cell.input is not None:
            if math.isfinite(self._zero_V):
                self._cell_V.clear()  # after the tare, only the latest reading is needed
            self._cell_V.append(self._sampling.level_V(block.rows, cell.input - 1))
        self.journal.rows(self._sampling.stream, block.rows)
        arrival = np.array([(self.part, self.now_s, *block.progress)], self.journal.dtype("came"))
        self.journal.rows("came", arrival)

    def _check_silence(self) -> None:
        """Raise `BenchError` if the sampler has sent nothing for too long."""
        longest_s = getattr(self.instruments.sampler, "silent_s", MAX_SILENCE_S)
        silence_s = self.now_s - self._data_s
        if silence_s > max(longest_s, 3.0 * self.instruments.read_interval_s):
            limit = f"has sent no data for {silence_s:.1f} s"
            raise BenchError(self.instruments.sampler.name, limit=limit, remedy="check the cable and the power")

    def _write_positions(self) -> None:
        for axis in self._axes.values():
            axis.write(self.journal)


def _target_entry(step: Step) -> dict[str, Any]:
    """Return the entry of a step's event that contains its target."""
    if step.to_N is not None:
        return {"to_N": step.to_N}
    return {"target": step.targets.get("", step.targets)}
