"""A stop after Ctrl-C at any moment of an exchange: a late reply is not taken for the reply to a later query."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import pytest

from solen.bench.clock import SimulatedClock
from solen.bench.gcs2 import Gcs2Stage
from solen.bench.grbl import GrblStage
from solen.bench.homing import ensure_zero
from solen.bench.kinesis import KinesisStage
from solen.bench.link import Link
from solen.bench.roles import Stage
from solen.bench.zaber import ZaberStage
from tests.bench.gcs2_controller_support import Gcs2Controller
from tests.bench.grbl_controller_support import GrblController
from tests.bench.kinesis_controller_support import KinesisController
from tests.bench.wire_support import Instrument
from tests.bench.zaber_controller_support import ZaberDevice


@dataclass
class TricklingWire:
    """A link whose replies begin late and arrive byte by byte; one call of `read` or `write` is interrupted.

    Attributes
    ----------
    delay_s, byte_s
        Time from a query to the first byte of its reply, and time for each byte.
    interrupted_call
        Index of the call that Ctrl-C interrupts; negative for none.
    after
        Whether Ctrl-C interrupts this call at its end, so that the bytes read are lost, or at its beginning.
    """

    instrument: Instrument
    clock: SimulatedClock
    delay_s: float = 0.08
    byte_s: float = 1e-3
    interrupted_call: int = -1
    after: bool = False
    name: str = "trickling"
    calls: int = 0
    _arrivals: list[tuple[float, int]] = field(default_factory=list)

    def write(self, data: bytes) -> None:
        self._begin_call()
        reply, begin_s = self.instrument.reply(data), self.clock.now_s() + self.delay_s
        begin_s = max(begin_s, self._arrivals[-1][0] if self._arrivals else 0.0)
        self._arrivals += [(begin_s + n * self.byte_s, byte) for n, byte in enumerate(reply, 1)]
        self._end_call()

    def read(self, most: int, timeout_s: float) -> bytes:
        self._begin_call()
        due_s = self._arrivals[0][0] - self.clock.now_s() if self._arrivals else timeout_s
        self.clock.sleep(max(0.0, min(due_s, timeout_s)))
        received = [byte for at_s, byte in self._arrivals[:most] if at_s <= self.clock.now_s() + 1e-9]
        del self._arrivals[: len(received)]
        self._end_call()
        return bytes(received)

    def close(self) -> None:
        """Do nothing: no port is open."""

    def _begin_call(self) -> None:
        if self.calls == self.interrupted_call and not self.after:
            self._interrupt()

    def _end_call(self) -> None:
        self.calls += 1
        if self.calls - 1 == self.interrupted_call and self.after:
            self._interrupt()

    def _interrupt(self) -> None:
        self.interrupted_call = -1
        raise KeyboardInterrupt


def _gcs2(clock: SimulatedClock) -> tuple[Any, Callable[[Link], Stage]]:
    return Gcs2Controller(clock), lambda link: Gcs2Stage(link, clock, stage="M-060.DG")


def _zaber(clock: SimulatedClock) -> tuple[Any, Callable[[Link], Stage]]:
    return ZaberDevice(clock), lambda link: ZaberStage(link, clock, steps_per_unit=4000.0)


def _kinesis(clock: SimulatedClock) -> tuple[Any, Callable[[Link], Stage]]:
    controller = KinesisController(clock)
    return controller, lambda link: KinesisStage(link, clock, counts_per_unit=controller.per_unit)


def _grbl(clock: SimulatedClock) -> tuple[Any, Callable[[Link], Stage]]:
    return GrblController(clock), partial(GrblStage, clock=clock)


@pytest.mark.parametrize("simulated", [_gcs2, _grbl, _kinesis, _zaber])
@pytest.mark.parametrize("after", [False, True])
def test_stops_after_ctrl_c_at_any_call(
    simulated: Callable[[SimulatedClock], tuple[Any, Callable[[Link], Stage]]], after: bool
) -> None:
    interrupted_call = 0
    while True:
        clock = SimulatedClock()
        controller, open_stage = simulated(clock)
        wire = TricklingWire(controller, clock, after=after)
        stage = open_stage(wire)
        ensure_zero(stage, "here", 0.0)
        wire.calls, wire.interrupted_call = 0, interrupted_call
        try:
            stage.begin_move(3.0, 2.0)
            stage.position()
            stage.on_target()
            stage.position()
        except KeyboardInterrupt:
            stage.stop()
            assert not controller.axis.moving(clock.now_s())
            position = stage.position()
            assert position < 2.9
            clock.sleep(1.0)
            assert stage.position() == position  # no earlier reply is pending
        else:
            break
        interrupted_call += 1
    assert interrupted_call > 20
