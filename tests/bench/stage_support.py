"""What tests of stages share: a written conversation, waiting for an arrival, the rest of a rig."""

from dataclasses import dataclass, field
from typing import Any

from solen.bench.clock import Clock
from solen.bench.rig import Rig
from solen.bench.roles import Stage

SENSOR = {"name": "A", "design": "a.toml", "emitter": 1, "right": 1, "left": 2}
BOARD = {"driver": "serial", "port": "COM3"}


@dataclass
class Written:
    """A conversation that was written down: what must be sent, in this order, and what is answered."""

    turns: list[tuple[bytes, bytes]]
    name: str = "written"
    coming: bytes = b""
    sent: list[bytes] = field(default_factory=list)

    def write(self, data: bytes) -> None:
        expected, answer = self.turns.pop(0)
        assert data == expected
        self.coming += answer

    def read(self, most: int, timeout_s: float) -> bytes:  # noqa: ARG002  all is there at once
        data, self.coming = self.coming[:most], self.coming[most:]
        return data

    def close(self) -> None:
        assert not self.turns


def arrived(stage: Stage, clock: Clock) -> float:
    """How long it takes until the stage is on target."""
    begun = clock.now_s()
    while not stage.on_target():
        clock.sleep(0.01)
    return clock.now_s() - begun


def rig_with(**stage: Any) -> Rig:
    """A rig with a real stage."""
    return Rig(name="steps", stage=stage, board=BOARD, sensor=(SENSOR,))
