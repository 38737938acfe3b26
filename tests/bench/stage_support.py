"""Helpers for tests of stages: a scripted dialogue, waiting for arrival, a rig with a real stage."""

from dataclasses import dataclass
from typing import Any

from solen.bench.clock import Clock
from solen.bench.rig import Rig
from solen.bench.roles import Stage

SENSOR = {"name": "A", "design": "a.toml", "emitter": 1, "right": 1, "left": 2}
BOARD = {"driver": "serial", "port": "COM3"}


@dataclass
class Dialogue:
    """A link with a scripted dialogue: the messages that must be sent, in this order, and the reply to each."""

    exchanges: list[tuple[bytes, bytes]]
    name: str = "scripted"
    _received: bytes = b""

    def write(self, data: bytes) -> None:
        expected, reply = self.exchanges.pop(0)
        assert data == expected
        self._received += reply

    def read(self, most: int, timeout_s: float) -> bytes:  # noqa: ARG002  replies arrive at once
        data, self._received = self._received[:most], self._received[most:]
        return data

    def close(self) -> None:
        assert not self.exchanges


def wait_for_arrival(stage: Stage, clock: Clock) -> float:
    """Wait until the stage is at its target, and return the duration in s."""
    begin = clock.now_s()
    while not stage.on_target():
        clock.sleep(0.01)
    return clock.now_s() - begin


def rig_with(**stage: Any) -> Rig:
    """Return a rig with a real stage."""
    return Rig(name="steps", stage=stage, board=BOARD, sensor=(SENSOR,))
