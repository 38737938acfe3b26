"""A stage that is not there: it moves as its moves say, by the clock of the run."""

from typing import Literal

from solen.bench.clock import Clock
from solen.bench.simulated.motion import Axis
from solen.errors import BenchError

LIMITS = {"deg": (-180.0, 180.0), "mm": (-7.5, 7.5)}
HIGHEST = {"deg": 20.0, "mm": 10.0}
ACCELERATION = {"deg": 200.0, "mm": 50.0}


class SimulatedStage:
    """A `RotationStage` or `LinearStage` in the program itself.

    Attributes
    ----------
    axis
        Where it is at any time.
    """

    def __init__(self, clock: Clock, unit: Literal["deg", "mm"] = "deg", name: str = "simulated stage") -> None:
        self.name = name
        self.unit: Literal["deg", "mm"] = unit
        self.axis = Axis(ACCELERATION[unit])
        self._clock = clock

    def reference(self) -> None:
        """It always knows where it is."""

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move; `BenchError` beyond its limits."""
        low, high = LIMITS[self.unit]
        if not low <= target <= high:
            limit = f"{target:g} {self.unit} is out of its limits {low:g} to {high:g}"
            raise BenchError(self.name, limit=limit, remedy="move less far")
        if velocity > HIGHEST[self.unit]:
            limit = f"{velocity:g} {self.unit}/s is above its highest velocity, {HIGHEST[self.unit]:g}"
            raise BenchError(self.name, limit=limit, remedy="move more slowly")
        self.axis.send(self._clock.now_s(), target, velocity)

    def position(self) -> float:
        """Where it is."""
        return self.axis.at(self._clock.now_s())

    def on_target(self) -> bool:
        """Whether it stands where it was sent."""
        return not self.axis.moving(self._clock.now_s())

    def stop(self) -> None:
        """Stand still."""
        self.axis.halt(self._clock.now_s())

    def close(self) -> None:
        """Stand still."""
        self.stop()
