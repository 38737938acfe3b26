"""A run: the protocol's steps on the rig's instruments, everything that comes written to the journal as it comes.

The idea: one loop waits, asks the stage where it is and the board or the data acquisition for what it sampled, and
hands both to the journal before it does anything else. Whatever ends a run, the end of the protocol, Ctrl-C or a fault,
the emitters go off and the stage stops, in that order, and the journal says why. Completed cycles are written down, so
that an interrupted run is resumed after the last one.

The interface: `Instruments`; `begin` writes a header, `run` the rest of the journal; `Tick` is what a watcher is shown.
"""

import datetime as dt
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from solen.analysis.load_cell import LoadCell
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
"""How much longer than its way needs a move may take before it counts as stuck."""
SILENT_S = 2.0
"""A board that says nothing for so long is a fault."""
SETTLE_S = 0.5
"""After a move's shortest time, a stage that does not come to rest is asked all the same whether it has arrived."""
OVERSHOOT = 1e-3
"""Share of the travel by which a stage at its end may stand beyond it."""
RESTING = 0.01
"""Share of its velocity below which a stage counts as at rest."""
EXCHANGE_EVERY_S, EXCHANGES = 1.0, 5
"""While the stage rests, clocks are compared so often, and so many times at once."""


@dataclass(frozen=True)
class Instruments:
    """Instruments and sensors of a run.

    Attributes
    ----------
    stage, board, clock
        The instruments, and the clock of the run; in place of a board there may be a data acquisition or a meter.
    read_every_s
        Interval of reading the board: the data that a kill may lose.
    travel
        Lowest and highest allowed position of the stage; None for its own limits only.
    cell
        What reads the force on the sensor, for steps to a force.
    """

    stage: Stage
    board: Sampler
    clock: Clock
    read_every_s: float = 0.1
    travel: tuple[float, float] | None = None
    cell: LoadCell | None = None


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
        Position of the stage, in its unit.
    counts
        The last period, shape (emitters, 2, receivers), or its lowest and highest samples, shape (1, 2, channels); None
        before the first.
    """

    t_s: float
    cycle: int
    cycles: int
    position: float
    counts: Counts | None


Watch = Callable[[Tick], None]


def begin(path: Path, instruments: Instruments, header: Mapping[str, Any]) -> Journal:
    """A new journal for a run; its header states protocol, rig and instruments."""
    sampling, stage = sampling_of(instruments.board), instruments.stage
    of_run = {"stage": stage.name, "unit": stage.unit, "clock_resolution_s": instruments.clock.resolution_s}
    streams = {**sampling.streams(), "stage": STAGE, "exchange": EXCHANGE}
    return Journal.create(path, {**header, **sampling.header(), **of_run}, streams)


def run(
    protocol: Protocol,
    instruments: Instruments,
    journal: Journal,
    *,
    before: JournalContent | None = None,
    watch: Watch | None = None,
) -> None:
    """Run a protocol, or what is left of it, and end the journal.

    Raises
    ------
    BenchError
        If an instrument fails; what was recorded up to then is in the journal, which says so. Emitters are off and
        the stage stands still.
    KeyboardInterrupt
        If Ctrl-C stopped it; likewise. Of either, notes name what could not be stopped.
    """
    if instruments.stage.unit != protocol.unit:
        limit = f"moves in {protocol.unit}, and the stage {instruments.stage.name} in {instruments.stage.unit}"
        raise BenchError("protocol", limit=limit, remedy="a linear stage needs lever_mm and steps in mm")
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


@dataclass
class _Runner:
    """One run under way."""

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
    _looks: list[tuple[int, float, float, float]] = field(default_factory=list)
    _last_two: list[tuple[float, float]] = field(default_factory=list)
    _compared_s: float = -math.inf
    _cell_V: list[float] = field(default_factory=list)
    _zero_V: float = math.nan

    def __post_init__(self) -> None:
        self._sampling = sampling_of(self.on.board)

    @property
    def now_s(self) -> float:
        return self.on.clock.now_s()

    def all(self) -> None:
        """From the beginning, or the first cycle that is not done, to the end."""
        utc = dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")
        self.journal.event(self.now_s, "begun", part=self.part, cycle=self.done + 1, utc=utc)
        if no_watchdog := getattr(self.on.board, "no_watchdog", None):
            self.journal.event(self.now_s, "remark", reason=no_watchdog)
        self._exchange(self._sampling.start)
        self._due_s = self._read_s = self._heard_s = self.now_s
        self._cycle = self.done + 1
        self._go(self.protocol.step[-1])  # to where a cycle begins
        self.journal.event(self.now_s, "at rest")
        self._cell_V.clear()
        self._stay(self.protocol.rest_s)
        self._tare()
        for cycle in range(self.done + 1, self.protocol.all_cycles + 1):
            self._cycle = cycle
            self.journal.event(self.now_s, "cycle", number=cycle)
            for number, step in enumerate(self.protocol.steps_of(cycle), 1):
                aim = {"target": step.target} if step.to_N is None else {"to_N": step.to_N}
                self.journal.event(self.now_s, "step", number=number, **aim)
                self._go(step) if step.to_N is None else self._press(step, step.to_N)
                self.journal.event(self.now_s, "arrived", number=number)
                self._stay(step.hold_s)
            self._read()
            self.journal.event(self.now_s, "cycle done", number=cycle)
        self._stay(self.protocol.rest_s)
        self._read()

    def safe(self) -> list[str]:
        """Emitters off, then the stage stopped; the second is tried whatever becomes of the first.

        Then what was seen of the stage since the last reading is written down. Gives a line for what did not stop.
        """
        left = []
        for name, stop in (("board", self.on.board.stop), ("stage", self.on.stage.stop)):
            try:
                stop()
            except SolenError as bad:
                self.journal.event(self.now_s, "not stopped", instrument=name, reason=str(bad))
                left.append(f"{name} not stopped: {bad}")
        self._write_looks()
        return left

    def _go(self, step: Step) -> None:
        """Move and wait for arrival; while moving, only the position is queried."""
        start = self._look()
        self._check_travel(step, start, step.target)
        shortest_s = abs(step.target - start) / step.velocity if math.isfinite(start) else 0.0
        patience_s = getattr(self.on.stage, "patience_s", ARRIVE_S)
        self.on.stage.begin_move(step.target, step.velocity)
        arrives_s = self.now_s + shortest_s
        while not self._arrived(step, arrives_s):
            if self.now_s > arrives_s + patience_s:
                limit = f"has not arrived at {step.target:g} {step.unit} in {shortest_s + patience_s:.0f} s"
                raise BenchError(self.on.stage.name, limit=limit, remedy="is it free to move?")
            self._tick(self.now_s + 1.0)

    def _tare(self) -> None:
        """Take the load cell's zero from the rest that has just been, unless it is stated."""
        if self.on.cell is None:
            return
        self._read()
        resting = float(np.mean(self._cell_V)) if self._cell_V else math.nan
        self._zero_V = resting if self.on.cell.zero_V is None else self.on.cell.zero_V

    def _press(self, step: Step, to_N: float) -> None:
        """Move until the load cell reads a force, deeper or back, and stop there.

        It goes on by its velocity times what a look and a reading take; the place where it then stands is not sought.
        """
        low, high = self.on.travel or (math.nan, math.nan)  # a protocol with such steps needs both
        begun = self._look()
        deeper = self._force_N() < to_N
        end = high if deeper else low
        self._check_travel(step, begun, end)
        self.on.stage.begin_move(end, step.velocity)
        while (self._force_N() < to_N) == deeper:
            if self.on.stage.on_target():
                limit = (
                    f"reads {self._force_N():.3g} N at the end of travel, {end:g} {step.unit}, and {to_N:g} N is asked"
                )
                raise BenchError(
                    self.on.cell.name if self.on.cell else "load cell", limit=limit, remedy="is it in touch?"
                )
            self._tick(self.now_s + 1.0)
            self._read()
        self.on.stage.stop()
        self._look()

    def _force_N(self) -> float:
        """Force by the newest reading; `BenchError` without one."""
        if self.on.cell is None or not (self._cell_V and math.isfinite(self._zero_V)):
            raise BenchError("load cell", limit="has no reading to press by", remedy="check its input")
        return self.on.cell.sensitivity_N_per_V * (self._cell_V[-1] - self._zero_V)

    def _check_travel(self, step: Step, start: float, target: float) -> None:
        """Refuse a way that is not within the rig's travel from end to end."""
        if self.on.travel is None:
            return
        low, high = self.on.travel
        slack = OVERSHOOT * (high - low)
        for what, position in (("stands at", start), ("is sent to", target)):
            if position < low - slack or position > high + slack:
                limit = f"{what} {position:g} {step.unit}, and travel in the rig is {low:g} to {high:g}"
                raise BenchError(self.on.stage.name, limit=limit, remedy="move it back by hand, or widen travel")

    def _arrived(self, step: Step, arrives_s: float) -> bool:
        """Whether the stage has arrived; queried from the earliest possible time, and only if it seems to rest."""
        if self.now_s < arrives_s:
            return False
        if self.now_s < arrives_s + SETTLE_S and len(self._last_two) == 2:
            (before_s, before), (at_s, at) = self._last_two
            if abs(at - before) > RESTING * step.velocity * (at_s - before_s):
                return False
        return self.on.stage.on_target()

    def _stay(self, duration_s: float) -> None:
        until = self.now_s + duration_s
        while until - self.now_s > 1e-9:
            if self.now_s - self._compared_s >= EXCHANGE_EVERY_S:
                self._compare()
            self._tick(until)

    def _compare(self) -> None:
        """Compare the sampler's clock with the run's, as long as it answers with its time."""
        for _ in range(EXCHANGES):
            if not self._exchange(self._sampling.time_s):
                break
        self._compared_s = self.now_s

    def _exchange(self, ask: Callable[[], float | None]) -> bool:
        """Record the sampler's time and the time of the query; False if it has no clock."""
        sent_s = self.now_s
        device_s = ask()
        if device_s is not None:
            row = np.array([(self.part, sent_s, self.now_s, device_s)], self.journal.dtype("exchange"))
            self.journal.rows("exchange", row)
        return device_s is not None

    def _look(self) -> float:
        """Ask the stage where it is; question and answer are stamped."""
        sent_s = self.now_s
        position = self.on.stage.position()
        at_s = self.now_s
        self._looks.append((self.part, sent_s, at_s, position))
        self._last_two = [*self._last_two[-1:], (at_s, position)]
        return position

    def _tick(self, until_s: float) -> None:
        """Wait for the next time to look, then look."""
        self._due_s = max(self._due_s + 1.0 / self.protocol.position_rate_hz, self.now_s)
        self.on.clock.sleep(max(0.0, min(self._due_s, until_s) - self.now_s))
        position = self._look()
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
                limit = f"has said nothing for {self.now_s - self._heard_s:.1f} s"
                raise BenchError(self.on.board.name, limit=limit, remedy="check its cable and power")
            return
        self._heard_s, self._last = self.now_s, taken.last
        taken.rows["part"] = self.part
        if self.on.cell is not None and self.on.cell.input is not None:
            if math.isfinite(self._zero_V):
                self._cell_V.clear()  # the newest is enough
            self._cell_V.append(self._sampling.level_V(taken.rows, self.on.cell.input - 1))
        self.journal.rows(self._sampling.stream, taken.rows)
        came = np.array([(self.part, self.now_s, *taken.came)], self.journal.dtype("came"))
        self.journal.rows("came", came)

    def _write_looks(self) -> None:
        looks, self._looks = self._looks, []
        self.journal.rows("stage", np.array(looks, self.journal.dtype("stage")))
