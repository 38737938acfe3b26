"""A stop after Ctrl-C at any moment of a conversation: a late answer to another question is not taken for its own."""

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
    """A link whose answers begin late and come byte by byte; one reading or writing is interrupted.

    Attributes
    ----------
    late_s, byte_s
        After a question its answer's first byte, and time of each.
    interrupted
        Number of the reading or writing that Ctrl-C interrupts, from 0; below 0 for none.
    lost
        Whether what was read is lost by that, or nothing was read or written yet.
    """

    instrument: Instrument
    clock: SimulatedClock
    late_s: float = 0.08
    byte_s: float = 1e-3
    interrupted: int = -1
    lost: bool = False
    name: str = "trickling"
    done: int = 0
    _coming: list[tuple[float, int]] = field(default_factory=list)

    def write(self, data: bytes) -> None:
        self._at(before=True)
        answer, begin_s = self.instrument.reply(data), self.clock.now_s() + self.late_s
        begin_s = max(begin_s, self._coming[-1][0] if self._coming else 0.0)
        self._coming += [(begin_s + n * self.byte_s, byte) for n, byte in enumerate(answer, 1)]
        self._at(before=False)

    def read(self, most: int, timeout_s: float) -> bytes:
        self._at(before=True)
        due_s = self._coming[0][0] - self.clock.now_s() if self._coming else timeout_s
        self.clock.sleep(max(0.0, min(due_s, timeout_s)))
        came = [byte for at_s, byte in self._coming[:most] if at_s <= self.clock.now_s() + 1e-9]
        del self._coming[: len(came)]
        self._at(before=False)
        return bytes(came)

    def close(self) -> None:
        """Nothing to let go of."""

    def _at(self, *, before: bool) -> None:
        number = self.done
        self.done += not before
        if number == self.interrupted and before is not self.lost:
            self.interrupted = -1
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


@pytest.mark.parametrize("made", [_gcs2, _grbl, _kinesis, _zaber])
@pytest.mark.parametrize("lost", [False, True])
def test_a_stop_is_known_whatever_ctrl_c_interrupted(
    network_of: Callable[[SimulatedClock], tuple[Any, Callable[[Link], Stage]]], lost: bool
) -> None:
    interrupted = 0
    while True:
        clock = SimulatedClock()
        controller, opened = network_of(clock)
        wire = TricklingWire(controller, clock, lost=lost)
        stage = opened(wire)
        ensure_zero(stage, "here", 0.0)
        wire.done, wire.interrupted = 0, interrupted
        try:
            stage.begin_move(3.0, 2.0)
            stage.position()
            stage.on_target()
            stage.position()
        except KeyboardInterrupt:
            stage.stop()
            assert not controller.axis.moving(clock.now_s())
            at = stage.position()
            assert at < 2.9
            clock.sleep(1.0)
            assert stage.position() == at  # nor is anything left over
        else:
            break
        interrupted += 1
    assert interrupted > 20
