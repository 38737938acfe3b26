"""A stage turned by hand from stop to stop: the response at the stops, and no angle between them."""

import math
import re
import threading
import time
from pathlib import Path
from queue import SimpleQueue

import h5netcdf
import numpy as np
import pytest

from solen.analysis import study
from solen.bench.clock import SimulatedClock
from solen.bench.manual_stage import ManualStage
from solen.bench.protocol import Protocol
from solen.bench.rig import Rig
from solen.bench.simulated.stage import Axis
from solen.errors import BenchError
from tests.bench.slow_wire_support import record_linear

STOPS = [0.0, *np.arange(-0.5, -3.1, -0.5), *np.arange(-2.5, 3.1, 0.5), *np.arange(2.5, -0.1, -0.5)]


def protocol(cycles: int, stride: int, hold_s: float) -> Protocol:
    """Return a protocol with every n-th of the stops, n being the stride."""
    angles = STOPS[stride::stride]
    steps = [{"to_deg": round(float(to), 3), "velocity_deg_per_s": 5.0, "hold_s": hold_s} for to in angles]
    return Protocol(name="stops", cycles=cycles, step=steps)


class Operator(SimulatedClock):
    """Somebody who turns the stage as the program prompts, overshoots, and presses Enter; also the clock of the run.

    The simulated time stops while the operator's thread reads a line.
    """

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.axis, self.prompts, self._rng = Axis(50.0), 0, np.random.default_rng(seed)
        self._due_s, self._pressed = math.inf, threading.Event()

    def show(self, line: str) -> None:
        prompt = re.search(r"to ([+-][\d.]+) deg", line)
        assert prompt is not None
        self.prompts += 1
        begin_s = self.now_s() + self._rng.uniform(0.2, 1.0)
        move = self.axis.send(begin_s, float(prompt[1]) + 0.4, self._rng.uniform(0.3, 2.0))
        self._pressed.clear()
        self._due_s = self.axis.send(move.end_s, float(prompt[1]), 1.0).end_s + 0.3

    def sleep(self, duration_s: float) -> None:
        super().sleep(duration_s)
        if self.now_s() >= self._due_s:
            self._due_s = math.inf
            self._pressed.set()
            time.sleep(0.002)  # lets the thread queue the line

    def read(self) -> str:
        self._pressed.wait(10.0)
        return "\n"


@pytest.mark.parametrize(("stride", "hold_s"), [(1, 0.1), (2, 0.5), (3, 0.1), (6, 0.1)])
def test_readings_have_angles_only_at_stops(tmp_path: Path, stride: int, hold_s: float) -> None:
    operator = Operator(seed=1)
    stage = ManualStage("deg", operator.show, operator.read)
    run = record_linear(tmp_path, protocol(3, stride, hold_s), stage, operator, operator.axis.positions)
    assert run.outcome == "done"
    assert operator.prompts == 3 * 24 // stride + 1
    assert not run.warnings
    with h5netcdf.File(run.path, "r") as file:
        time_s, angle_deg = (file.groups["A"].variables[name][...] for name in ("time_s", "angle_deg"))
        assert np.isnan(file.variables["stage_position"][...]).any()
    assert angle_deg == pytest.approx(operator.axis.positions(time_s), abs=1e-9)
    assert set(np.round(angle_deg, 6)) == set(np.round(STOPS[::stride], 6))
    sensor = study([run.path]).to_dict()["sensors"]["A"]
    assert (sensor["cycles_used"], sensor["timing"]["timing_deg"]) == (2, 0.0)
    curve = sensor["receivers"]["right"]
    slope = np.polyfit(curve["angle_deg"], curve["mean_V"], 1)[0]
    assert slope == pytest.approx(5_000 * 5.0 / 65_536, rel=1e-3)
    assert curve["hysteresis_percent"] < 0.5


def wait_for_operator(stage: ManualStage) -> None:
    due = time.monotonic() + 5.0
    while not stage.on_target() and time.monotonic() < due:
        time.sleep(1e-3)


def test_operator_may_type_position() -> None:
    prompts: list[str] = []
    lines = iter(["2,9\n", "there\n", "-3.1\n", ""])
    stage = ManualStage("deg", prompts.append, lambda: next(lines))
    assert math.isnan(stage.position())
    stage.begin_move(3.0, 1.0)
    wait_for_operator(stage)
    assert stage.position() == 2.9
    stage.begin_move(-3.0, 1.0)
    assert math.isnan(stage.position())
    wait_for_operator(stage)
    assert stage.position() == -3.1
    assert [line for line in prompts if "not a position" in line] == [
        "'there' is not a position in deg; press Enter, or type a number."
    ]
    stage.begin_move(-3.1, 1.0)  # the stage is already there
    assert len(prompts) == 3
    stage.begin_move(0.0, 1.0)
    with pytest.raises(BenchError, match="the input has ended"):
        wait_for_operator(stage)


@pytest.mark.parametrize("pressed", [False, True])
def test_enter_before_stop_does_not_confirm_next_move(pressed: bool) -> None:
    lines: SimpleQueue[str] = SimpleQueue()
    was_read = threading.Semaphore(0)

    def read() -> str:
        line = lines.get(timeout=10.0)
        was_read.release()
        return line

    stage = ManualStage("deg", lambda _: None, read)
    stage.begin_move(3.0, 1.0)
    stage.stop()
    if pressed:
        lines.put("\n")
        assert was_read.acquire(timeout=5.0)
        time.sleep(0.02)  # lets the thread queue the line
    stage.begin_move(-3.0, 1.0)
    assert not any(stage.on_target() for _ in range(5))
    lines.put("\n")  # a single line is enough, also for a thread that has waited since the first move
    wait_for_operator(stage)
    assert stage.position() == -3.0


def test_rig_with_manual_stage_has_no_port_and_no_model() -> None:
    sensor = {"name": "A", "design": "a.toml", "emitter": 1, "right": 1, "left": 2}
    board = {"driver": "serial", "port": "COM3"}
    rig = Rig(name="hand", stage={"driver": "hand"}, board=board, sensor=(sensor,))
    assert not rig.simulated
    with pytest.raises(BenchError, match=r"model = 'M-060\.DG'"):
        Rig(name="x", stage={"driver": "hand", "model": "M-060.DG"}, board=board, sensor=(sensor,))
    with pytest.raises(BenchError, match="lever_mm"):
        Rig(name="x", stage={"driver": "hand", "unit": "mm"}, board=board, sensor=(sensor,))
    with pytest.raises(BenchError, match=r"unit = 'mm'; must be deg, the unit of M-060\.DG"):
        Rig(name="x", stage={"unit": "mm"}, sensor=(sensor,))
