"""Complete runs with stage and board at the end of lines, with the faults of real lines, from start to analysis."""

import contextlib
import json
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import h5netcdf
import numpy as np
import pytest
from numpy.typing import NDArray

from solen.analysis import study
from solen.arrays import FloatArray, IntArray
from solen.bench.clock import Clock, SimulatedClock, WallClock
from solen.bench.frames import RESTARTED, Layout
from solen.bench.journal import read_journal
from solen.bench.netcdf import RecordedRun
from solen.bench.record import RecordOptions, record, recover
from solen.bench.rig import load_rig
from solen.bench.run import Tick
from solen.bench.simulated.board import SimulatedBoard
from solen.bench.simulated.sensors import simulated_sensors
from solen.cli import run_command
from solen.errors import BenchError
from tests.bench.board_controller_support import BoardController, SimulatedHardware
from tests.bench.fork_support import Start
from tests.bench.gcs2_controller_support import Gcs2Controller
from tests.bench.wire_support import Faults, Served, Wire

pytestmark = pytest.mark.usefixtures("signals")
CYCLES = 2
RUN = ("bench", "run", "protocol.toml", "--rig", "wired.toml", "--out", "out")
SIGNALS = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C cannot be sent to a single process there")


@dataclass
class WiredRig:
    """A rig whose stage and board are simulated instruments at the end of lines, and the faults of these lines."""

    folder: Path
    clock: Clock
    stage: Gcs2Controller
    board: BoardController
    stage_faults: Faults
    board_faults: Faults

    def record(self, watch: Callable[[Tick], None] | None = None) -> RecordedRun:
        return record(self.folder / "protocol.toml", self.folder / "wired.toml", self.folder / "out", watch=watch)

    def change(self, old: str, new: str) -> None:
        """Replace part of the rig file."""
        path = self.folder / "wired.toml"
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new), encoding="utf-8")

    @property
    def events(self) -> list[str]:
        return [event["what"] for event in read_journal(self.folder / "out" / "protocol.journal").events]

    def is_at_rest(self) -> bool:
        return not self.stage.axis.moving(self.clock.now_s())


def controllers(bench: Path, clock: Clock) -> tuple[Gcs2Controller, BoardController]:
    """Return controllers of the stage and the board of the simulated rig in the folder."""
    rig = load_rig(bench / "rig.toml")
    stage = Gcs2Controller(clock, reference_s=0.05, offset=0.0)
    sampler = SimulatedBoard(
        clock,
        simulated_sensors(rig, bench, 3.0, np.random.default_rng([rig.seed, 0])),
        lambda time_s: stage.axis.positions(time_s),
        rig.ambient,
        np.random.default_rng(1),
        layout=Layout(rig.emitters, rig.inputs),
        period_s=0.005,
    )
    sampler.start()
    hardware = SimulatedHardware(sampler.counts, 5000, rig.emitters, rig.inputs)
    return stage, BoardController(clock, hardware)


def write_rig(bench: Path, stage_port: str, board_port: str) -> None:
    """Write a short protocol, and a rig file with the ports of both controllers."""
    text = (bench / "protocol.toml").read_text(encoding="utf-8").replace("cycles = 3", f"cycles = {CYCLES}")
    (bench / "protocol.toml").write_text(text, encoding="utf-8")
    tables = f'[stage]\ndriver = "gcs2"\nhome = true\nport = "{stage_port}"\n'
    tables += f'[board]\ndriver = "serial"\nport = "{board_port}"\n'
    wired = (bench / "rig.toml").read_text(encoding="utf-8").replace("[board]\ntrim_v = 1.0\n", tables)
    (bench / "wired.toml").write_text(wired[: wired.index("[ambient]")], encoding="utf-8")


@pytest.fixture
def wired(bench: Path, monkeypatch: pytest.MonkeyPatch) -> WiredRig:
    """Rig in this process, on a simulated clock."""
    clock = SimulatedClock()
    stage, board = controllers(bench, clock)
    wires = {"stage": Wire(stage, clock), "board": Wire(board, clock)}
    write_rig(bench, *wires)
    monkeypatch.setattr("solen.bench.link.open_link", lambda name, **_: wires[name])
    monkeypatch.setattr("solen.bench.record.WallClock", lambda *_: clock)
    return WiredRig(bench, clock, stage, board, wires["stage"].faults, wires["board"].faults)


@pytest.fixture
def served(bench: Path) -> Iterator[WiredRig]:
    """Rig on loopback sockets, in real time, for runs in other processes."""
    clock = WallClock()
    stage, board = controllers(bench, clock)
    with Served(stage) as stage_line, Served(board) as board_line:
        write_rig(bench, stage_line.url, board_line.url)
        yield WiredRig(bench, clock, stage, board, stage_line.faults, board_line.faults)


def once(delay_s: float, action: Callable[[], object]) -> Callable[[Tick], None]:
    """Return a function that watches a run, and calls the action once, a delay after the first tick."""
    pending, begin_s = [action], []

    def watch(tick: Tick) -> None:
        begin_s.append(tick.t_s)
        if pending and tick.t_s - begin_s[0] >= delay_s:
            pending.pop()()

    return watch


def volts_at(analysis: dict[str, Any], sensor: str, side: str, angle_deg: float) -> float:
    curve = analysis["sensors"][sensor]["receivers"][side]
    return float(np.interp(angle_deg, curve["angle_deg"], np.array(curve["mean_V"], float)))


def test_run_over_wires_gives_response_of_sensors(wired: WiredRig) -> None:
    run = wired.record()
    assert (run.outcome, run.cycles, run.simulated) == ("done", CYCLES, False)
    assert not any(run.losses.values())
    assert not wired.board.sampling
    assert wired.is_at_rest()
    analysis = study([run.path]).to_dict()
    lens = {(side, angle): volts_at(analysis, "A", side, angle) for side in ("right", "left") for angle in (-2.8, 2.8)}
    # at -3 deg the right receiver gets more light, which lowers its voltage
    assert lens["right", -2.8] < lens["right", 2.8] - 1.0
    assert lens["left", 2.8] < lens["left", -2.8] - 1.0
    # without wires, only the angle between two readings of the position differs
    files = wired.folder / "protocol.toml", wired.folder / "rig.toml", wired.folder / "out"
    simulated = study([record(*files, RecordOptions(name="simulated")).path]).to_dict()
    for (side, angle), volts in lens.items():
        assert volts == pytest.approx(volts_at(simulated, "A", side, angle), abs=0.1)


def test_counts_lost_double_and_garbled_frames_and_restart(wired: WiredRig) -> None:
    wired.board.lose, wired.board.double = {40, 41, 90}, {60, 61, 62, 63}
    noise = b"\xa5\x5a\x01\x01\x40\x00 noise on the line"
    garble = once(0.8, lambda: setattr(wired.board_faults, "garbage", noise))
    restart = once(1.6, lambda: setattr(wired.board, "restart", True))

    def watch(tick: Tick) -> None:
        garble(tick)
        restart(tick)

    run = wired.record(watch)
    losses = run.losses
    assert run.outcome == "done"
    assert losses["restarts"] == 1
    assert losses["doubled"] >= 4
    assert losses["dropped"] >= 3
    assert losses["garbled"] + losses["skipped_bytes"] > 0
    with h5netcdf.File(run.path, "r") as file:
        time_s, number = file.variables["time_s"][...], file.variables["number"][...]
        assert int(np.sum(file.variables["flags"][...] & RESTARTED != 0)) == 1
        assert len(json.loads(file.attrs["clock"])) == 2
        assert json.loads(file.attrs["losses"]) == losses
    assert len(np.unique(number)) == len(number)
    assert (np.diff(time_s) > 0.0).all()
    assert time_s[-1] - time_s[0] < 20.0  # the restarted clock causes no jump in time
    assert set(study([run.path]).to_dict()["sensors"]) == {"A", "B"}


FAULTS: dict[str, tuple[str, Callable[[WiredRig], object]]] = {
    "board deaf": ("has sent no data for 2", lambda rig: setattr(rig.board_faults, "deaf", True)),
    "board unplugged": ("the line is disconnected", lambda rig: setattr(rig.board_faults, "disconnected", True)),
    "stage deaf": ("no reply within 1 s", lambda rig: setattr(rig.stage_faults, "deaf", True)),
    "stage unplugged": ("the line is disconnected", lambda rig: setattr(rig.stage_faults, "disconnected", True)),
    "stage blocked": ("error 1024, motion error", lambda rig: rig.stage.stall()),
    "stage sends garbage": (
        "which is not text",
        lambda rig: setattr(rig.stage_faults, "garbage", b"\xff\xfe\n\xfd\n"),
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_during_run_switches_emitters_off_and_stops_stage(wired: WiredRig, fault: str) -> None:
    message, inject = FAULTS[fault]
    with pytest.raises(BenchError, match=message) as bad:
        wired.record(once(0.9, lambda: inject(wired)))
    assert len(str(bad.value).splitlines()) == 1
    if fault == "board unplugged":  # its watchdog switches the emitters off
        wired.clock.sleep(2.1)
        wired.board.reply(b"")
    assert not wired.board.sampling
    if fault in {"stage deaf", "stage unplugged", "stage sends garbage"}:  # it cannot be stopped, and ends its move
        wired.clock.sleep(0.5)
    assert wired.is_at_rest()
    events = wired.events
    assert events[-1] == "fault"
    assert ("not stopped" in events) == (fault not in {"stage blocked", "stage sends garbage"})
    closed = recover(wired.folder / "out" / "protocol.journal")
    assert closed.outcome == "fault"
    assert closed.periods > 100


def wait_until(condition: Callable[[], bool]) -> None:
    due_s = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < due_s, "the run did not begin within a minute"
        time.sleep(0.002)


def end_by_signal(rig: WiredRig, start: Start, name: str, delay_s: float) -> tuple[int | None, str]:
    """Send a signal to a run a delay after its third move has begun; return its exit code and its text on stderr."""
    first = len(rig.stage.axis.moves)
    process = start(rig.folder, *RUN)
    wait_until(lambda: len(rig.stage.axis.moves) >= first + 3 and not rig.is_at_rest())
    time.sleep(delay_s)
    for _ in range(2):  # the second signal must not interrupt the end
        process.send_signal(getattr(signal, name))
        time.sleep(0.01)
    return process.wait(), (rig.folder / "stderr").read_text(encoding="utf-8")


def check_end_by_signal(rig: WiredRig, start: Start, name: str, delay_s: float = 0.0) -> None:
    code, stderr = end_by_signal(rig, start, name, delay_s)
    assert code == 128 + getattr(signal, name)
    assert "Traceback" not in stderr
    assert f"ended by {name}; emitters off, stage stopped" in stderr
    assert "protocol.journal: continue with --resume" in stderr
    assert not rig.board.sampling
    assert rig.is_at_rest()
    assert rig.events[-1] == "stopped"
    assert "not stopped" not in rig.events
    journal = rig.folder / "out" / "protocol.journal"
    if delay_s == 0.0:
        assert abs(rig.stage.axis.at(rig.clock.now_s())) < 2.99  # stopped before its target
    with contextlib.suppress(BenchError):
        assert recover(journal).outcome == "stopped"
    journal.with_suffix(".nc").unlink(missing_ok=True)


@POSIX
@pytest.mark.parametrize("name", SIGNALS)
def test_signal_switches_emitters_off_and_stops_stage(served: WiredRig, start: Start, name: str) -> None:
    check_end_by_signal(served, start, name)


@POSIX
@pytest.mark.evidence
@pytest.mark.parametrize("name", SIGNALS)
def test_signal_at_random_moment_switches_emitters_off(served: WiredRig, start: Start, name: str) -> None:
    served.board.hardware.counts = constant_counts
    for delay_s in np.random.default_rng(1).uniform(0.001, 1.2, 20).tolist():
        check_end_by_signal(served, start, name, delay_s)
    print(f"\n  20 {name} at random moments: each time the emitters are off and the stage is at rest")


def constant_counts(time_s: FloatArray, lit: IntArray) -> NDArray[np.uint16]:  # noqa: ARG001  the same at all times
    """Return counts that take no time to compute."""
    return np.full((len(time_s), 4), 1000, np.uint16)


@dataclass
class Aftermath:
    """Effects of a kill.

    Attributes
    ----------
    dark_s
        Time from the kill until the emitters were switched off.
    moves
        Number of moves that the stage received after the kill.
    lost_s
        Duration of the samples that are not in the journal.
    """

    dark_s: float
    moves: int
    lost_s: float


def move_count(rig: WiredRig) -> int:
    return sum(move.target != move.start for move in rig.stage.axis.moves)


def kill_run(rig: WiredRig, start: Start, delay_s: float) -> Aftermath | None:
    """Kill a run a delay after its first emitter was switched on; return None if it has ended before."""
    hardware, first = rig.board.hardware, len(rig.board.hardware.switched)
    process = start(rig.folder, *RUN)
    wait_until(lambda: len(hardware.switched) > first)
    time.sleep(delay_s)
    process.kill()
    killed_s, moves = rig.clock.now_s(), move_count(rig)
    if process.wait() != -signal.SIGKILL:
        return None
    time.sleep(1.2)
    rig.board.reply(b"")  # lets the board's time pass
    assert not rig.board.sampling
    assert rig.is_at_rest()
    assert rig.stage.axis.at(rig.clock.now_s()) == pytest.approx(rig.stage.axis.moves[-1].target)
    switched = [(hardware.begin_s + 1e-6 * at_us, emitter) for at_us, emitter in hardware.switched[first:]]
    lit_s = next(at_s for at_s, emitter in switched if emitter >= 0)
    dark_s = [at_s for at_s, emitter in switched if emitter < 0][-1]
    arrivals = read_journal(rig.folder / "out" / "protocol.journal").streams["came"]
    recorded_s = 0.005 * (int(arrivals["number"][-1]) + 1) if len(arrivals) else 0.0
    return Aftermath(dark_s - killed_s, move_count(rig) - moves, killed_s - lit_s - recorded_s)


@POSIX
@pytest.mark.evidence
def test_kill_at_random_moment_leaves_emitters_off_and_stage_at_rest(served: WiredRig, start: Start) -> None:
    served.board.hardware.counts = constant_counts
    served.change("home = true", "home = true\ntravel = [-4.0, 4.0]")
    kills: list[Aftermath] = []
    for delay_s in np.random.default_rng(2).uniform(0.0, 3.0, 50).tolist():
        if (kill := kill_run(served, start, delay_s)) is not None:
            kills.append(kill)
            assert recover(served.folder / "out" / "protocol.journal").outcome == "killed"
        (served.folder / "out" / "protocol.nc").unlink(missing_ok=True)
    dark_s, lost_s, moves = (max(getattr(kill, name) for kill in kills) for name in ("dark_s", "lost_s", "moves"))
    print(f"\n  {len(kills)} SIGKILLs: emitters off within {dark_s:.2f} s, at most {moves} moves sent afterwards")
    print(f"  and {1e3 * lost_s:.0f} ms of samples lost")
    assert len(kills) >= 45
    assert all(-4.0 <= move.target <= 4.0 for move in served.stage.axis.moves)
    assert dark_s <= 1.0
    assert lost_s <= 0.5
    assert moves <= 1


def test_reference_move_needs_confirmation(wired: WiredRig) -> None:
    wired.change("home = true\n", "")
    questions: list[str] = []

    def record_with(reply: bool | None) -> RecordedRun:
        def confirm(question: str) -> bool:
            questions.append(question)
            return bool(reply)

        files = wired.folder / "protocol.toml", wired.folder / "wired.toml", wired.folder / "out"
        return record(*files, confirm=None if reply is None else confirm)

    for reply in (None, False):
        with pytest.raises(BenchError, match=r"has no zero\..* 360 deg .*home = true"):
            record_with(reply)
    assert not wired.stage.axis.moves
    assert not wired.stage.referenced
    assert not (wired.folder / "out").exists()
    assert record_with(True).outcome == "done"
    assert len(questions) == 2
    assert all("up to 360 deg in either direction. Begin?" in question for question in questions)


class Operator:
    """Standard input and error of the program: every prompt turns the stage at once, and is replied to with Enter."""

    def __init__(self, rig: WiredRig) -> None:
        self._rig = rig
        self._lines: SimpleQueue[str] = SimpleQueue()

    def readline(self) -> str:
        return self._lines.get()

    def write(self, text: str) -> None:
        if prompt := re.search(r"to ([+-]\d+) deg", text):
            self._rig.stage.axis.send(self._rig.clock.now_s(), float(prompt[1]), 1e6)
            self._lines.put("\n")

    def flush(self) -> None:
        """Do nothing, as nothing is buffered."""

    def isatty(self) -> bool:
        return False


def test_operator_turns_stage_by_hand(wired: WiredRig, monkeypatch: pytest.MonkeyPatch) -> None:
    wired.change('driver = "gcs2"\nhome = true\nport = "stage"', 'driver = "hand"')
    wired.stage.axis.acceleration = 1e9
    steps = "".join(
        f"[[step]]\nto_deg = {to}\nvelocity_deg_per_s = 15.0\nhold_s = 0.2\n" for to in (-3.0, 0.0, 3.0, 0.0)
    )
    (wired.folder / "protocol.toml").write_text(f'schema = 1\nname = "stops"\nrest_s = 0.1\n{steps}', encoding="utf-8")
    operator = Operator(wired)
    with monkeypatch.context() as patch:
        patch.chdir(wired.folder)
        patch.setattr("sys.stdin", operator)
        patch.setattr("sys.stderr", operator)
        assert run_command(list(RUN)) == 0
    with h5netcdf.File(wired.folder / "out" / "protocol.nc", "r") as file:
        angle_deg, right = (file.groups["A"].variables[name][...] for name in ("angle_deg", "right"))
    assert set(angle_deg) == {-3.0, 0.0, 3.0}
    means = [right[angle_deg == angle].mean() for angle in (-3.0, 0.0, 3.0)]
    assert means[0] < means[1] - 0.5 < means[2] - 0.5  # at -3 deg the right receiver gets more light


def test_refuses_moves_outside_travel(wired: WiredRig) -> None:
    wired.change("home = true", "home = true\ntravel = [-2.0, 4.0]")
    with pytest.raises(BenchError, match=r"step\[0\] = -3\.0; .*-2 to 4 deg"):
        wired.record()
    wired.change("[-2.0, 4.0]", "[1.0, 4.0]")
    with pytest.raises(BenchError, match=r"travel = .*must include the zero, 0"):
        wired.record()
    wired.change("[1.0, 4.0]", "[-4.0, 4.0]")
    wired.stage.referenced = wired.stage.servo = True
    wired.stage.axis.initial = 37.0
    with pytest.raises(BenchError, match=r"position = 37\.0; .*-4 to 4"):
        wired.record()
    assert not wired.stage.axis.moves
