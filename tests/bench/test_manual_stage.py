"""A stage turned by hand: from stop to stop to a response, and nothing is made up for the ways between."""

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
from tests.bench.slow_wire_support import closed

STOPS = [0.0, *np.arange(-0.5, -3.1, -0.5), *np.arange(-2.5, 3.1, 0.5), *np.arange(2.5, -0.1, -0.5)]


def stops(cycles: int, every: int, hold_s: float) -> Protocol:
    angles = STOPS[every::every]
    steps = [{"to_deg": round(float(to), 3), "velocity_deg_per_s": 5.0, "hold_s": hold_s} for to in angles]
    return Protocol(name="stops", cycles=cycles, step=steps)


class Person(SimulatedClock):
    """Somebody who turns a stage where the program says, beyond it and back, and presses Enter; and their time.

    The clock waits for them, so that what they do takes no longer than it is to.
    """

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.axis, self.asked, self._rng = Axis(50.0), 0, np.random.default_rng(seed)
        self._due_s, self._answered = math.inf, threading.Event()

    def receive(self, line: str) -> None:
        found = re.search(r"to ([+-][\d.]+) deg", line)
        assert found is not None
        self.asked += 1
        begun_s = self.now_s() + self._rng.uniform(0.2, 1.0)
        move = self.axis.send(begun_s, float(found[1]) + 0.4, self._rng.uniform(0.3, 2.0))
        self._answered.clear()
        self._due_s = self.axis.send(move.end_s, float(found[1]), 1.0).end_s + 0.3

    def sleep(self, duration_s: float) -> None:
        super().sleep(duration_s)
        if self.now_s() >= self._due_s:
            self._due_s = math.inf
            self._answered.set()
            time.sleep(0.002)  # their line is on its way

    def answer(self) -> str:
        self._answered.wait(10.0)
        return "\n"


@pytest.mark.parametrize(("every", "hold_s"), [(1, 0.1), (2, 0.5), (3, 0.1), (6, 0.1)])
def test_stops_by_hand_give_the_response_and_no_angle_between_them(tmp_path: Path, every: int, hold_s: float) -> None:
    person = Person(seed=1)
    stage = ManualStage("deg", person.receive, person.answer)
    run = closed(tmp_path, stops(3, every, hold_s), stage, person, person.axis.positions)
    assert run.outcome == "done"
    assert person.asked == 3 * 24 // every + 1
    assert not run.warnings
    with h5netcdf.File(run.path, "r") as file:
        read = {name: file.groups["A"].variables[name][...] for name in ("time_s", "angle_deg", "right")}
        assert np.isnan(file.variables["stage_position"][...]).any()
    true = person.axis.positions(read["time_s"])
    assert read["angle_deg"] == pytest.approx(true, abs=1e-9)  # nothing of the ways between
    assert set(np.round(read["angle_deg"], 6)) == set(np.round(STOPS[::every], 6))
    sensor = study([run.path]).to_dict()["sensors"]["A"]
    assert (sensor["cycles_used"], sensor["timing"]["timing_deg"]) == (2, 0.0)
    found = sensor["receivers"]["right"]
    slope = np.polyfit(found["angle_deg"], found["mean_V"], 1)[0]
    assert slope == pytest.approx(5_000 * 5.0 / 65_536, rel=1e-3)
    assert found["hysteresis_percent"] < 0.5


def answered(stage: ManualStage) -> None:
    due = time.monotonic() + 5.0
    while not stage.on_target() and time.monotonic() < due:
        time.sleep(1e-3)


def test_what_is_typed_is_where_it_stands() -> None:
    said: list[str] = []
    lines = iter(["2,9\n", "there\n", "-3.1\n", ""])
    stage = ManualStage("deg", said.append, lambda: next(lines))
    assert math.isnan(stage.position())
    stage.begin_move(3.0, 1.0)
    answered(stage)
    assert stage.position() == 2.9
    stage.begin_move(-3.0, 1.0)
    assert math.isnan(stage.position())
    answered(stage)
    assert stage.position() == -3.1
    assert [line for line in said if "not a position" in line] == [
        "'there' is not a position in deg; press Enter, or type a number."
    ]
    stage.begin_move(-3.1, 1.0)  # it stands there
    assert len(said) == 3
    stage.begin_move(0.0, 1.0)
    with pytest.raises(BenchError, match="the input has ended"):
        answered(stage)


@pytest.mark.parametrize("late", [False, True])
def test_enter_after_a_stop_is_no_arrival_at_the_next_target(late: bool) -> None:
    lines: SimpleQueue[str] = SimpleQueue()
    heard = threading.Semaphore(0)

    def answer() -> str:
        line = lines.get(timeout=10.0)
        heard.release()
        return line

    stage = ManualStage("deg", lambda _: None, answer)
    stage.begin_move(3.0, 1.0)
    stage.stop()
    if not late:
        lines.put("\n")
        assert heard.acquire(timeout=5.0)
        time.sleep(0.02)  # it is on its way
    stage.begin_move(-3.0, 1.0)
    assert not any(stage.on_target() for _ in range(5))
    lines.put("\n")  # one is enough, whoever waits for it
    answered(stage)
    assert stage.position() == -3.0


def test_a_rig_with_a_hand_needs_no_port_and_has_no_model() -> None:
    sensor = {"name": "A", "design": "a.toml", "emitter": 1, "right": 1, "left": 2}
    board = {"driver": "serial", "port": "COM3"}
    rig = Rig(name="hand", stage={"driver": "hand"}, board=board, sensor=(sensor,))
    assert not rig.simulated
    with pytest.raises(BenchError, match=r"model = 'M-060\.DG'"):
        Rig(name="x", stage={"driver": "hand", "model": "M-060.DG"}, board=board, sensor=(sensor,))
    with pytest.raises(BenchError, match="lever_mm"):
        Rig(name="x", stage={"driver": "hand", "unit": "mm"}, board=board, sensor=(sensor,))
    with pytest.raises(BenchError, match=r"unit = 'mm'; M-060\.DG moves in deg"):
        Rig(name="x", stage={"unit": "mm"}, sensor=(sensor,))
