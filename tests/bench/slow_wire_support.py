"""A stage at the end of a slow line, a clock that advances in steps, and a sensor without hysteresis.

`SlowWire` is a `Link` with delayed replies; `CoarseClock` advances in steps; the voltages of a `LinearBoard` follow the
angle without delay; `record_slow` runs a protocol on them and writes the recording.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from solen.arrays import FloatArray
from solen.bench.clock import Clock, SimulatedClock
from solen.bench.frames import Layout, Losses, Periods
from solen.bench.gcs2 import Gcs2Stage
from solen.bench.homing import ensure_zero
from solen.bench.journal import read_journal
from solen.bench.netcdf import RecordedRun, write_recording
from solen.bench.protocol import Protocol
from solen.bench.roles import Stage
from solen.bench.run import Instruments, begin, run
from tests.bench.gcs2_controller_support import Gcs2Controller
from tests.bench.wire_support import Instrument

Angles = Callable[[FloatArray], FloatArray]
PERIOD_S = 0.005
SENSOR = {"name": "A", "design": "", "lens": True, "emitter": 1, "right": 1, "left": 2}


@dataclass
class CoarseClock:
    """A clock that shows another one in steps, like the system tick of Windows."""

    fine: SimulatedClock
    resolution_s: float

    def now_s(self) -> float:
        return math.floor(self.fine.now_s() / self.resolution_s + 1e-9) * self.resolution_s

    def sleep(self, duration_s: float) -> None:
        self.fine.sleep(duration_s)


@dataclass
class SlowWire:
    """A line with a round-trip time, of which a fraction passes before the instrument receives a query."""

    instrument: Instrument
    clock: Clock
    round_trip_s: float
    query_fraction: float = 0.5
    name: str = "slow"
    sent: list[tuple[float, bytes]] = field(default_factory=list)
    _replies: list[tuple[float, bytes]] = field(default_factory=list)

    def write(self, data: bytes) -> None:
        begin = self.clock.now_s()
        self.sent.append((begin, data))
        self.clock.sleep(self.query_fraction * self.round_trip_s)
        if reply := self.instrument.reply(data):
            self._replies.append((begin + self.round_trip_s, reply))

    def read(self, most: int, timeout_s: float) -> bytes:
        due = self._replies[0][0] - self.clock.now_s() if self._replies else math.inf
        self.clock.sleep(max(0.0, min(due, timeout_s)))
        data = self._replies.pop(0)[1] if due <= timeout_s else b""
        if len(data) > most:
            self._replies.insert(0, (self.clock.now_s(), data[most:]))
        return data[:most]

    def close(self) -> None:
        pass


@dataclass
class LinearBoard:
    """An `EmitterBoard` whose two receivers are linear in the angle, without noise."""

    clock: Clock
    angle_deg: Callable[[FloatArray], FloatArray]
    name: str = "linear"
    layout: Layout = field(default_factory=lambda: Layout(1, 2))
    period_s: float = PERIOD_S
    volts_per_count: float = 5.0 / 65_536
    losses: Losses = field(default_factory=Losses)
    has_clock: bool = True
    _begin_s: float = 0.0
    _next: int = 0

    def start(self) -> None:
        self._begin_s = self.clock.now_s()

    def read(self) -> Periods:
        number = np.arange(self._next, int((self.clock.now_s() - self._begin_s) / PERIOD_S + 1e-9))
        self._next += len(number)
        on_s: FloatArray = np.asarray(self._begin_s + (number + 0.5) * PERIOD_S, np.float64)
        counts = np.full((len(number), 1, 2, 2), 60_000, np.uint16)
        for index, slope in enumerate((5_000, -5_000)):
            counts[:, 0, 0, index] = np.rint(30_000 + slope * self.angle_deg(on_s))
        return Periods(number, np.rint(1e6 * number * PERIOD_S).astype(np.int64), np.zeros(len(number), "u1"), counts)

    def time_s(self) -> float | None:
        return self.clock.now_s() - self._begin_s if self.has_clock else None

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass


def record_slow(
    folder: Path, protocol: Protocol, *, round_trip_s: float, query_fraction: float = 0.5, step_s: float = 0.0
) -> tuple[RecordedRun, SlowWire, Gcs2Controller]:
    """Record a protocol with a stage at the end of a slow line and a clock that advances in steps."""
    fine = SimulatedClock(0.00123)
    clock = CoarseClock(fine, step_s) if step_s else fine
    controller = Gcs2Controller(fine, offset=0.0, reference_s=0.05)
    wire = SlowWire(controller, fine, round_trip_s, query_fraction)
    stage = Gcs2Stage(wire, clock, stage="M-060.DG")
    ensure_zero(stage, True, 0.0)
    angles: Angles = lambda time_s: controller.axis.positions(time_s)  # noqa: E731  homing replaces the axis
    return record_linear(folder, protocol, stage, fine, angles, clock), wire, controller


def record_linear(
    folder: Path, protocol: Protocol, stage: Stage, fine: SimulatedClock, angles: Angles, clock: Clock | None = None
) -> RecordedRun:
    """Record a protocol with a stage and a linear board."""
    instruments = Instruments(stage, LinearBoard(fine, angles), clock or fine)
    header = {
        "solen": "0", "simulated": True, "begun_utc": "2026-01-01T00:00:00+00:00", "protocol_name": protocol.name,
        "rig_name": "slow", "sensors": [SENSOR], "zero": 0.0, "lever_mm": None, "top_count": 65_535,
        "protocol": protocol.model_dump(mode="json"),
    }  # fmt: skip
    path = folder / "slow.journal"
    path.unlink(missing_ok=True)
    with begin(path, instruments, header) as journal:
        run(protocol, instruments, journal)
    return write_recording(read_journal(path), folder / "slow.nc")
