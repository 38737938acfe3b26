"""A run: the protocol's steps on the rig's instruments, with all data written to the journal as they arrive.

One loop waits, asks the stage for its position and the board or the data acquisition for its samples, and writes both
to the journal before anything else. Whatever ends a run, the end of the protocol, Ctrl-C or a fault, the emitters are
switched off and the stage stops, in that order, and the journal states the reason. Completed cycles are recorded, and
an interrupted run is resumed after the last of them.

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

ARRIVE_S = 10.0
"""Time in s by which a move may exceed its expected duration before it counts as stuck."""
SILENT_S = 2.0
"""Silence of a board in s that counts as a fault."""
EXCHANGE_EVERY_S, EXCHANGES = 1.0, 5
"""Interval in s at which clocks are compared while the stage is at rest, and number of exchanges in each comparison."""


@dataclass(frozen=True)
class Instruments:
    """Instruments and sensors of a run.

    Attributes
    ----------
    stage, board, clock
        The instruments, and the clock of the run; instead of a board there may be a data acquisition or a meter,
        instead of a stage one for each motion, by name.
    read_every_s
        Interval of reading the board: the data that a kill may lose.
    travel
        Lowest and highest allowed position of the stage, or of each by its motion; None if only its own limits apply.
    cell
        Load cell that reads the force on the sensor, for steps to a force.
    """

    stage: Stage | Mapping[str, Stage]
    board: Sampler
    clock: Clock
    read_every_s: float = 0.1
    travel: Mapping[str, tuple[float, float] | None] | tuple[float, float] | None = None
    cell: LoadCell | None = None

    @property
    def stages(self) -> dict[str, Stage]:
        """Stages by motion; a single stage has no name."""
        return dict(self.stage) if isinstance(self.stage, Mapping) else {"": self.stage}


@dataclass(frozen=True, eq=False)
class Tick:
    """State of a run for display.

    Attributes
    ----------
    t_s
        Time of the run.
    cycle, cycles
        Number of the cycle, from 1, and of all cycles.
    position
        Position of each stage by its motion, in its unit; a single stage has no name.
    counts
        The last period, shape (emitters, 2, receivers), or its lowest and highest samples, shape (1, 2, channels); None
        before the first.
    """

    t_s: float
    cycle: int
    cycles: int
    position: dict[str, float]
    counts: Counts | None

    @property
    def levels(self) -> FloatArray:
        """Light at each input, as a fraction of the highest reading with the emitters off.

        Empty before the first period.
        """
        if self.counts is None:
            return np.empty(0)
        on, off = self.counts[:, 0, :].min(axis=0), self.counts[:, 1, :].max(axis=0)
        return np.asarray((off.astype(float) - on) / max(float(off.max()), 1.0))


Watch = Callable[[Tick], None]


def begin(path: Path, instruments: Instruments, header: Mapping[str, Any]) -> Journal:
    """Create a new journal for a run; its header states protocol, rig and instruments."""
    sampling, stages = sampling_of(instruments.board), instruments.stages
    of_run = {
        "stage": ", ".join(stage.name for stage in stages.values()),
        "unit": next(iter(stages.values())).unit,
        "clock_resolution_s": instruments.clock.resolution_s,
    }
    streams = {**sampling.streams(), **{stream_of(motion): STAGE for motion in stages}, "exchange": EXCHANGE}
    return Journal.create(path, {**header, **sampling.header(), **of_run}, streams)


def run(
    protocol: Protocol,
    instruments: Instruments,
    journal: Journal,
    *,
    before: JournalContent | None = None,
    watch: Watch | None = None,
) -> None:
    """Run a protocol, or its remaining part, and end the journal.

    Raises
    ------
    BenchError
        If an instrument fails; the data recorded until then are in the journal, which states the failure. Emitters are
        off and the stage is at rest.
    KeyboardInterrupt
        If Ctrl-C stopped it, with the same result. For both, notes name what could not be stopped.
    """
    stages = instruments.stages
    for stage in stages.values():
        if stage.unit != protocol.unit:
            limit = f"moves in {protocol.unit}, and the stage {stage.name} in {stage.unit}"
            raise BenchError("protocol", limit=limit, remedy="a linear stage needs lever_mm and steps in mm")
    check_motions(protocol, stages)
    part, done = (0, 0) if before is None else (before.parts, before.cycles)
    runner = _Runner(protocol, instruments, journal, part, done, watch)
    outcome, reason = "done", ""
    ended: BaseException | None = None
    try:
        runner.all()
    except BaseException as bad:
        ended = bad
        outcome = "stopped" if isinstance(bad, KeyboardInterrupt) else "fault"
        reason = str(bad) if isinstance(bad, SolenError | Ended) else type(bad).__name__
        raise
    finally:
        with uninterrupted():
            end = {"outcome": outcome, "reason": reason, "losses": vars(instruments.board.losses)}
            for line in runner.safe():
                if ended is not None:
                    ended.add_note(line)
            journal.event(runner.now_s, outcome, **end)
            if outcome == "done":
                journal.end(**end)
            journal.sync()


def check_motions(protocol: Protocol, known: Collection[str], what: str = "protocol") -> None:
    """Raise `BenchError` for a motion of a protocol that no stage makes."""
    for name in protocol.places:
        if name in known:
            continue
        there = ", ".join(known)
        if not name:
            remedy = f"use to_deg = {{{next(iter(known))} = ...}}"
            raise BenchError(what, limit=f"names no motion, and the rig's stages make {there}", remedy=remedy)
        limit = (
            f"names no motion of the rig; its motions are {there}"
            if there
            else "names a motion, but the rig has only one"
        )
        raise BenchError(f"{what}: step", value=name, limit=limit)


@dataclass
class _Runner:
    """One run in progress."""

    protocol: Protocol
    on: Instruments
    journal: Journal
    part: int
    done: int
    watch: Watch | None
    _read_s: float = 0.0
    _heard_s: float = 0.0
    _due_s: float = 0.0
    _last: Counts | None = None
    _cycle: int = 0
    _compared_s: float = -math.inf
    _cell_V: list[float] = field(default_factory=list)
    _zero_V: float = math.nan

    def __post_init__(self) -> None:
        self._sampling = sampling_of(self.on.board)
        self._axes = axes_of(self.on.stage, self.on.clock, self.part, self.on.travel)

    @property
    def now_s(self) -> float:
        return self.on.clock.now_s()

    def all(self) -> None:
        """Run from the beginning, or from the first cycle that is not done, to the end."""
        utc = dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")
        self.journal.event(self.now_s, "begun", part=self.part, cycle=self.done + 1, utc=utc)
        if no_watchdog := getattr(self.on.board, "no_watchdog", None):
            self.journal.event(self.now_s, "remark", reason=no_watchdog)
        self._exchange(self._sampling.start)
        self._due_s = self._read_s = self._heard_s = self.now_s
        self._cycle = self.done + 1
        self._go(self._begin())  # to the position at which a cycle begins
        self.journal.event(self.now_s, "at rest")
        self._cell_V.clear()
        self._stay(self.protocol.rest_s)
        self._tare()
        for cycle in range(self.done + 1, self.protocol.all_cycles + 1):
            self._cycle = cycle
            self.journal.event(self.now_s, "cycle", number=cycle)
            for number, step in enumerate(self.protocol.steps_of(cycle), 1):
                self.journal.event(self.now_s, "step", number=number, **_aim(step))
                self._go(step) if step.to_N is None else self._press(step, step.to_N)
                self.journal.event(self.now_s, "arrived", number=number)
                self._stay(step.hold_s)
            self._read()
            self.journal.event(self.now_s, "cycle done", number=cycle)
        self._stay(self.protocol.rest_s)
        self._read()

    def safe(self) -> list[str]:
        """Switch the emitters off, then stop the stage; the second is tried even if the first fails.

        Then the positions of the stage since the last reading are recorded. Returns a line for each instrument that did
        not stop.
        """
        left = []
        stages = [(axis.name, axis.stage.stop) for axis in self._axes.values()]
        for name, stop in (("board", self.on.board.stop), *stages):
            try:
                stop()
            except SolenError as bad:
                self.journal.event(self.now_s, "not stopped", instrument=name, reason=str(bad))
                left.append(f"{name} not stopped: {bad}")
        self._write_looks()
        return left

    def _begin(self) -> Step:
        """Begin with the last step, which moves every motion to the position in which a cycle ends."""
        last = self.protocol.steps[-1]
        left: dict[str, float] = {}
        if "" in last.targets:
            return last
        for step in self.protocol.steps:
            left |= step.targets
        return last.model_copy(update={f"to_{last.unit}": left})

    def _go(self, step: Step) -> None:
        """Move and wait for arrival; while the stage moves, only the position is queried."""
        due: dict[str, float] = {}
        starts = {motion: self._axes[motion].look() for motion in step.targets}
        for motion, target in step.targets.items():
            self._axes[motion].check_travel(step, starts[motion], target)
        for motion, target in step.targets.items():
            start = starts[motion]
            self._axes[motion].stage.begin_move(target, step.velocity)
            due[motion] = self.now_s + (abs(target - start) / step.velocity if math.isfinite(start) else 0.0)
        for motion, arrives_s in due.items():
            self._wait(self._axes[motion], step, arrives_s)

    def _wait(self, axis: Axis, step: Step, arrives_s: float) -> None:
        patience_s = getattr(axis.stage, "patience_s", ARRIVE_S)
        while not axis.arrived(step, arrives_s):
            if self.now_s > arrives_s + patience_s:
                late = f"{patience_s:.0f} s after it was due"
                limit = f"has not arrived at {step.targets[axis.motion]:g} {step.unit} {late}"
                raise BenchError(axis.stage.name, limit=limit, remedy="check that it is free to move")
            self._tick(self.now_s + 1.0)

    def _tare(self) -> None:
        """Determine the load cell's zero from the preceding rest, unless it is stated."""
        if self.on.cell is None:
            return
        self._read()
        resting = float(np.mean(self._cell_V)) if self._cell_V else math.nan
        self._zero_V = resting if self.on.cell.zero_V is None else self.on.cell.zero_V

    def _press(self, step: Step, to_N: float) -> None:
        """Move until the load cell reads a force, deeper or back, and stop there.

        The stage overshoots by its velocity times the duration of a query and a reading; the overshoot is not
        corrected.
        """
        (axis,) = self._axes.values()
        low, high = axis.travel or (math.nan, math.nan)  # a protocol with these steps requires both limits
        begun = axis.look()
        deeper = self._force_N() < to_N
        end = high if deeper else low
        axis.check_travel(step, begun, end)
        axis.stage.begin_move(end, step.velocity)
        while (self._force_N() < to_N) == deeper:
            if axis.stage.on_target():
                limit = (
                    f"reads {self._force_N():.3g} N at the end of travel, {end:g} {step.unit}, "
                    f"instead of the {to_N:g} N of the protocol"
                )
                raise BenchError(
                    self.on.cell.name if self.on.cell else "load cell",
                    limit=limit,
                    remedy="check that the finger touches the sensor",
                )
            self._tick(self.now_s + 1.0)
            self._read()
        axis.stage.stop()
        axis.look()

    def _force_N(self) -> float:
        """Return the force of the newest reading; raise `BenchError` without one."""
        if self.on.cell is None or not (self._cell_V and math.isfinite(self._zero_V)):
            raise BenchError(
                "load cell", limit="has no reading that a step to a force could use", remedy="check its input"
            )
        return self.on.cell.sensitivity_N_per_V * (self._cell_V[-1] - self._zero_V)

    def _stay(self, duration_s: float) -> None:
        until = self.now_s + duration_s
        while until - self.now_s > 1e-9:
            if self.now_s - self._compared_s >= EXCHANGE_EVERY_S:
                self._compare()
            self._tick(until)

    def _compare(self) -> None:
        """Compare the sampler's clock with the run's, unless it stops answering with its time."""
        for _ in range(EXCHANGES):
            if not self._exchange(self._sampling.time_s):
                break
        self._compared_s = self.now_s

    def _exchange(self, ask: Callable[[], float | None]) -> bool:
        """Record the sampler's time and the time of the query; return False if it has no clock."""
        sent_s = self.now_s
        device_s = ask()
        if device_s is not None:
            row = np.array([(self.part, sent_s, self.now_s, device_s)], self.journal.dtype("exchange"))
            self.journal.rows("exchange", row)
        return device_s is not None

    def _tick(self, until_s: float) -> None:
        """Wait for the next time to query the instruments, then query them."""
        self._due_s = max(self._due_s + 1.0 / self.protocol.position_rate_hz, self.now_s)
        self.on.clock.sleep(max(0.0, min(self._due_s, until_s) - self.now_s))
        position = {motion: axis.look() for motion, axis in self._axes.items()}
        if self.now_s - self._read_s >= self.on.read_every_s:
            self._read()
            if self.watch is not None:
                self.watch(Tick(self.now_s, self._cycle, self.protocol.all_cycles, position, self._last))

    def _read(self) -> None:
        """Fetch samples and record them, after the stage's position."""
        self._write_looks()
        taken = self._sampling.read()
        self._read_s = self.now_s
        for remark in taken.remarks:
            self.journal.event(self.now_s, "remark", reason=remark)
        if taken.last is None:
            silent_s = getattr(self.on.board, "silent_s", SILENT_S)
            if self.now_s - self._heard_s > max(silent_s, 3.0 * self.on.read_every_s):
                limit = f"has sent nothing for {self.now_s - self._heard_s:.1f} s"
                raise BenchError(self.on.board.name, limit=limit, remedy="check the cable and the power")
            return
        self._heard_s, self._last = self.now_s, taken.last
        taken.rows["part"] = self.part
        if self.on.cell is not None and self.on.cell.input is not None:
            if math.isfinite(self._zero_V):
                self._cell_V.clear()  # only the newest is needed
            self._cell_V.append(self._sampling.level_V(taken.rows, self.on.cell.input - 1))
        self.journal.rows(self._sampling.stream, taken.rows)
        came = np.array([(self.part, self.now_s, *taken.came)], self.journal.dtype("came"))
        self.journal.rows("came", came)

    def _write_looks(self) -> None:
        for axis in self._axes.values():
            axis.write(self.journal)


def _aim(step: Step) -> dict[str, Any]:
    """Return the target of a step, for its event."""
    if step.to_N is not None:
        return {"to_N": step.to_N}
    return {"target": step.targets.get("", step.targets)}
