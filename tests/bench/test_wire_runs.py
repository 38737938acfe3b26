"""A whole run over the wire: stage and board behind sockets, with the faults of real ones, from start to analysis."""

import contextlib
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
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
from solen.errors import BenchError
from tests.bench.board_controller_support import BoardController, SimulatedHardware
from tests.bench.fork_support import Forks, forks
from tests.bench.gcs2_controller_support import Gcs2Controller
from tests.bench.wire_support import Served, Wire

CYCLES = 2


@dataclass
class Wires:
    """A rig on the other side of two sockets: what the run is not told."""

    folder: Path
    stage: Gcs2Controller
    board: BoardController
    to_stage: Served
    to_board: Served

    def run(self, watch: Callable[[Tick], None] | None = None) -> RecordedRun:
        files = self.folder / "protocol.toml", self.folder / "wired.toml", self.folder / "out"
        return record(*files, watch=watch)

    @property
    def events(self) -> list[dict[str, Any]]:
        return list(read_journal(self.folder / "out" / "protocol.journal").events)

    def stands(self) -> bool:
        return not self.stage.axis.moving(self.stage.clock.now_s())

    def goes_dark(self, within_s: float) -> bool:
        due = time.monotonic() + within_s
        while self.board.sampling and time.monotonic() < due:
            time.sleep(0.01)
        return not self.board.sampling


def controllers(bench: Path, clock: Clock) -> tuple[Gcs2Controller, BoardController]:
    """The simulated rig of the folder as controllers of stage and board."""
    rig = load_rig(bench / "rig.toml")
    stage = Gcs2Controller(clock, reference_s=0.05, offset=0.0)
    prints = simulated_sensors(rig, bench, 3.0, np.random.default_rng([rig.seed, 0]))
    sampler = SimulatedBoard(
        clock,
        prints,
        lambda time_s: stage.axis.positions(time_s),
        rig.ambient,
        np.random.default_rng(1),
        layout=Layout(rig.emitters, rig.inputs),
        period_s=0.005,
    )
    sampler.start()
    hardware = SimulatedHardware(sampler.counts, 5000, rig.emitters, rig.inputs)
    return stage, BoardController(clock, hardware)


def write_rig(bench: Path, to_stage: str, to_board: str) -> None:
    """A short protocol, and a rig file that names the ports of both controllers."""
    text = (bench / "protocol.toml").read_text(encoding="utf-8").replace("cycles = 3", f"cycles = {CYCLES}")
    (bench / "protocol.toml").write_text(text, encoding="utf-8")
    lines = f'[stage]\ndriver = "gcs2"\nhome = true\nport = "{to_stage}"\n'
    lines += f'[board]\ndriver = "serial"\nport = "{to_board}"\n'
    wired = (bench / "rig.toml").read_text(encoding="utf-8").replace("[board]\ntrim_v = 1.0\n", lines)
    (bench / "wired.toml").write_text(wired[: wired.index("[ambient]")], encoding="utf-8")


@pytest.fixture
def wires(bench: Path) -> Iterator[Wires]:
    """The controllers on loopback sockets."""
    stage, board = controllers(bench, WallClock())
    with Served(stage) as to_stage, Served(board) as to_board:
        write_rig(bench, to_stage.url, to_board.url)
        yield Wires(bench, stage, board, to_stage, to_board)


def at(moment_s: float, what: Callable[[], Any]) -> Callable[[Tick], None]:
    """Does something once, so long after the run's first look."""
    began: list[float] = []

    def watch(tick: Tick) -> None:
        began.append(tick.t_s)
        if len(began) > 1 and began[-2] - began[0] < moment_s <= tick.t_s - began[0]:
            what()

    return watch


def volts_at(found: dict[str, Any], sensor: str, side: str, angle: float) -> float:
    told = found["sensors"][sensor]["receivers"][side]
    return float(np.interp(angle, told["angle_deg"], [np.nan if one is None else one for one in told["mean_V"]]))


def test_from_the_wire_to_the_response(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Drivers and controllers speak by wires on one simulated clock: a busy computer changes nothing."""
    clock = SimulatedClock()
    stage, board = controllers(bench, clock)
    wires = {"to stage": Wire(stage, clock), "to board": Wire(board, clock)}
    write_rig(bench, *wires)
    monkeypatch.setattr("solen.bench.link.open_link", lambda name, **_: wires[name])
    monkeypatch.setattr("solen.bench.record.WallClock", lambda *_: clock)
    found = record(bench / "protocol.toml", bench / "wired.toml", bench / "out")
    assert (found.outcome, found.cycles, found.simulated) == ("done", CYCLES, False)
    assert not any(found.losses.values())
    assert not board.sampling
    assert not stage.axis.moving(clock.now_s())
    told = study([found.path]).to_dict()
    lens = {(side, angle): volts_at(told, "A", side, angle) for side in ("right", "left") for angle in (-2.8, 2.8)}
    assert lens["right", -2.8] < lens["right", 2.8] - 1.0  # brighter is lower: -3 degrees brighten the right receiver
    assert lens["left", 2.8] < lens["left", -2.8] - 1.0
    # what the same prints give without a wire, but for where the stage was between two looks at it
    there = record(bench / "protocol.toml", bench / "rig.toml", bench / "out", RecordOptions(name="straight"))
    straight = study([there.path]).to_dict()
    for (side, angle), volts in lens.items():
        assert volts == pytest.approx(volts_at(straight, "A", side, angle), abs=0.1)


def test_frames_lost_doubled_and_garbled_and_a_restart_are_counted_and_reported(wires: Wires) -> None:
    wires.board.lose, wires.board.double = {40, 41, 90}, {60, 61, 62, 63}

    def garble() -> None:
        wires.to_board.faults.garbage = b"\xa5\x5a\x01\x01\x40\x00 noise on the line"

    first, second = at(0.8, garble), at(1.6, lambda: setattr(wires.board, "restart", True))

    def both(tick: Tick) -> None:
        first(tick)
        second(tick)

    found = wires.run(both)
    losses = found.losses
    assert found.outcome == "done"
    assert losses["restarts"] == 1
    assert losses["doubled"] >= 4
    assert losses["dropped"] >= 3
    assert losses["garbled"] + losses["skipped_bytes"] > 0
    with h5netcdf.File(found.path, "r") as file:
        time_s, number = file.variables["time_s"][...], file.variables["number"][...]
        assert int(np.sum(file.variables["flags"][...] & RESTARTED != 0)) == 1
        assert len(json.loads(file.attrs["clock"])) == 2
        assert json.loads(file.attrs["losses"]) == losses
    assert len(np.unique(number)) == len(number)
    assert (np.diff(time_s) > 0.0).all()
    assert time_s[-1] - time_s[0] < 20.0  # a clock that began anew is no leap in time
    assert set(study([found.path]).to_dict()["sensors"]) == {"A", "B"}


FAULTS: dict[str, tuple[str, Callable[[Wires], Any], float]] = {
    "board deaf": ("has sent no data for 2", lambda on: setattr(on.to_board.faults, "deaf", True), 3.0),
    "board unplugged": ("the line is disconnected", lambda on: setattr(on.to_board.faults, "disconnected", True), 0.5),
    "stage deaf": ("no reply within 1 s", lambda on: setattr(on.to_stage.faults, "deaf", True), 0.0),
    "stage unplugged": ("the line is disconnected", lambda on: setattr(on.to_stage.faults, "disconnected", True), 0.0),
    "stage blocked": ("error 1024, motion error", lambda on: on.stage.stall(), 0.0),
    "garbage from the stage": (
        "which is not text",
        lambda on: setattr(on.to_stage.faults, "garbage", b"\xff\xfe\n\xfd\n"),
        0.0,
    ),
}


IN_CI = {"board unplugged", "stage blocked"}


@pytest.mark.parametrize(
    "fault", [one if one in IN_CI else pytest.param(one, marks=pytest.mark.evidence) for one in FAULTS]
)
def test_a_fault_in_the_middle_ends_the_run_with_emitters_off_and_the_stage_stopped(wires: Wires, fault: str) -> None:
    told, happens, dark_s = FAULTS[fault]
    with pytest.raises(BenchError, match=told) as refusal:
        wires.run(at(0.9, lambda: happens(wires)))
    assert len(str(refusal.value).splitlines()) == 1
    if fault == "board unplugged":  # nobody serves what is unplugged: its own watchdog
        time.sleep(2.1)
        wires.board.reply(b"")
    assert wires.goes_dark(dark_s)
    if "stage" not in fault or fault == "stage blocked":
        assert wires.stands()
    else:  # it cannot be told to stop, and says so; it ends its move by itself
        time.sleep(0.5)
        assert wires.stands()
    events = [event["what"] for event in wires.events]
    assert events[-1] == "fault"
    assert ("not stopped" in events) == (fault not in {"stage blocked", "garbage from the stage"})
    kept = recover(wires.folder / "out" / "protocol.journal")
    assert kept.outcome == "fault"
    assert kept.periods > 100


pytestmark = pytest.mark.usefixtures("heeded")
SIGNALS = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


RUN = ("bench", "run", "protocol.toml", "--rig", "wired.toml", "--out", "out")
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="a console's Ctrl-C cannot be sent to one process there")


def ended(wires: Wires, by: Forks, name: str, delay_s: float) -> tuple[int, str]:
    """A run in a process of its own that gets a signal on its third move: its exit code, and what it said."""
    first = len(wires.stage.axis.moves)
    run = by.start(wires.folder, *RUN)
    due = time.monotonic() + 60.0
    while not wires.stage.axis.moving(wires.stage.clock.now_s()) or len(wires.stage.axis.moves) < first + 3:
        if time.monotonic() > due:
            pytest.fail("the run did not begin within a minute")
        time.sleep(0.005)
    time.sleep(delay_s)
    for _ in range(2):  # asked twice, it does not leave half-way
        run.kill(getattr(signal, name))
        time.sleep(0.01)
    return run.wait()


def check_ended(wires: Wires, by: Forks, name: str, delay_s: float = 0.0) -> None:
    code, said = ended(wires, by, name, delay_s)
    assert code == 128 + getattr(signal, name)
    assert "Traceback" not in said
    assert f"ended by {name}; emitters off, stage stopped" in said
    assert "protocol.journal: continue with --resume" in said
    assert not wires.board.sampling
    assert wires.stands()
    events = [event["what"] for event in wires.events]
    assert events[-1] == "stopped"
    assert "not stopped" not in events
    journal = wires.folder / "out" / "protocol.journal"
    if delay_s == 0.0:
        assert abs(wires.stage.axis.at(wires.stage.clock.now_s())) < 2.99  # on the way, not where it was sent
    with contextlib.suppress(BenchError):
        assert recover(journal).outcome == "stopped"
    journal.with_suffix(".nc").unlink(missing_ok=True)


@POSIX
@pytest.mark.parametrize("name", SIGNALS)
def test_a_signal_switches_off_and_stops(wires: Wires, name: str) -> None:
    with forks() as by:
        check_ended(wires, by, name)


@POSIX
@pytest.mark.evidence
@pytest.mark.parametrize("name", SIGNALS)
def test_signals_at_random_moments_switch_off_and_stop(wires: Wires, name: str) -> None:
    wires.board.hardware.counts = plain_counts
    with forks() as by:
        for delay_s in np.random.default_rng(1).uniform(0.001, 1.2, 20).tolist():
            check_ended(wires, by, name, delay_s)
    print(f"\n  20 {name} at random moments: emitters off and stage at rest at the controllers' side each time")


def plain_counts(time_s: FloatArray, lit: IntArray) -> NDArray[np.uint16]:  # noqa: ARG001  the same at all times
    """What costs the controllers no time."""
    return np.full((len(time_s), 4), 1000, np.uint16)


@dataclass
class Left:
    """What a killed run left: how long emitters stayed lit, moves sent after the kill, samples lost."""

    dark_s: float
    moves: int
    lost_s: float


def killed(wires: Wires, by: Forks, delay_s: float) -> Left | None:
    """A run that is killed so long after its emitters were lit; None where it had ended by then."""
    clock, hardware = wires.stage.clock, wires.board.hardware
    switched = len(hardware.switched)
    run = by.start(wires.folder, *RUN)
    due = time.monotonic() + 60.0
    while len(hardware.switched) == switched:
        if time.monotonic() > due:
            pytest.fail("the run did not begin within a minute")
        time.sleep(0.002)
    time.sleep(delay_s)
    run.kill(signal.SIGKILL)
    killed_s, moves = clock.now_s(), sent(wires)
    if run.wait()[0] != -signal.SIGKILL:
        return None
    time.sleep(1.2)
    wires.board.reply(b"")  # nobody hears it, and its own time has passed
    assert not wires.board.sampling
    assert wires.stands()
    assert wires.stage.axis.at(clock.now_s()) == pytest.approx(wires.stage.axis.moves[-1].target)
    lit_s, dark_s = ([hardware.begin_s + 1e-6 * at for at, one in hardware.switched[switched:] if (one < 0) is off]
                     for off in (False, True))  # fmt: skip
    came = read_journal(wires.folder / "out" / "protocol.journal").streams["came"]
    lasted_s = 0.005 * (int(came["number"][-1]) + 1) if len(came) else 0.0
    return Left(dark_s[-1] - killed_s, sent(wires) - moves, killed_s - lit_s[0] - lasted_s)


def sent(wires: Wires) -> int:
    """Moves that the stage was given."""
    return sum(move.target != move.start for move in wires.stage.axis.moves)


@POSIX
@pytest.mark.evidence
def test_kills_at_random_moments_leave_a_dark_board_and_a_stage_at_rest(wires: Wires) -> None:
    wires.board.hardware.counts = plain_counts
    path = wires.folder / "wired.toml"
    text = path.read_text(encoding="utf-8").replace("home = true", "home = true\ntravel = [-4.0, 4.0]")
    path.write_text(text, encoding="utf-8")
    found: list[Left] = []
    with forks() as by:
        for delay_s in np.random.default_rng(2).uniform(0.0, 3.0, 50).tolist():
            left = killed(wires, by, delay_s)
            if left is not None:
                found.append(left)
                assert recover(wires.folder / "out" / "protocol.journal").outcome == "killed"
            (wires.folder / "out" / "protocol.nc").unlink(missing_ok=True)
    dark, lost, moves = (max(getattr(one, name) for one in found) for name in ("dark_s", "lost_s", "moves"))
    told = f"emitters off within {dark:.2f} s by the board's watchdog, {moves} moves sent after it"
    print(f"\n  {len(found)} SIGKILLs in the run: {told}; at most {1e3 * lost:.0f} ms of samples lost")
    assert len(found) >= 45
    assert all(-4.0 <= move.target <= 4.0 for move in wires.stage.axis.moves)
    assert dark <= 1.0
    assert lost <= 0.5
    assert moves <= 1


def test_a_stage_that_does_not_know_its_zero_is_not_driven_to_find_it_unasked(wires: Wires) -> None:
    path = wires.folder / "wired.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("home = true\n", ""), encoding="utf-8")
    asked: list[str] = []

    def run(answer: bool | None) -> RecordedRun:
        def says(question: str) -> bool:
            asked.append(question)
            return bool(answer)

        confirm = None if answer is None else says
        return record(wires.folder / "protocol.toml", path, wires.folder / "out", confirm=confirm)

    for answer in (None, False):
        with pytest.raises(BenchError, match=r"has no zero\..* 360 deg .*home = true"):
            run(answer)
    assert not wires.stage.axis.moves
    assert not wires.stage.referenced
    assert not (wires.folder / "out").exists()
    assert run(True).outcome == "done"
    assert len(asked) == 2
    assert all("up to 360 deg in either direction. Begin?" in question for question in asked)


def test_somebody_turns_the_stage_at_a_terminal(wires: Wires) -> None:
    rig, protocol = wires.folder / "wired.toml", wires.folder / "stops.toml"
    text = rig.read_text(encoding="utf-8")
    hand = re.sub(r'driver = "gcs2"\nhome = true\nport = ".*"', 'driver = "hand"', text)
    (wires.folder / "hand.toml").write_text(hand, encoding="utf-8")
    steps = "".join(
        f"[[step]]\nto_deg = {to}\nvelocity_deg_per_s = 15.0\nhold_s = 0.2\n" for to in (-3.0, 0.0, 3.0, 0.0)
    )
    protocol.write_text(f'schema = 1\nname = "stops"\nrest_s = 0.1\n{steps}', encoding="utf-8")
    words = ["bench", "run", "stops.toml", "--rig", "hand.toml", "--out", "out"]
    line, pipe = [sys.executable, "-m", "solen", *words], subprocess.PIPE
    with subprocess.Popen(line, cwd=wires.folder, stdin=pipe, stderr=pipe, text=True, encoding="utf-8") as child:
        assert child.stdin is not None
        assert child.stderr is not None
        for said in child.stderr:
            if asked := re.search(r"to ([+-]\d+) deg", said):
                move = wires.stage.axis.send(wires.stage.clock.now_s(), float(asked[1]), 15.0)
                time.sleep(max(0.0, move.end_s - wires.stage.clock.now_s()) + 0.05)
                child.stdin.write("\n")
                child.stdin.flush()
    assert child.returncode == 0
    with h5netcdf.File(wires.folder / "out" / "stops.nc", "r") as file:
        read = {name: file.groups["A"].variables[name][...] for name in ("angle_deg", "right")}
    assert set(read["angle_deg"]) == {-3.0, 0.0, 3.0}
    means = [read["right"][read["angle_deg"] == angle].mean() for angle in (-3.0, 0.0, 3.0)]
    assert means[0] < means[1] - 0.5 < means[2] - 0.5  # brighter is lower: -3 degrees brighten the right receiver


def test_travel_of_the_rig_is_not_left(wires: Wires) -> None:
    path = wires.folder / "wired.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("home = true", "home = true\ntravel = [-2.0, 4.0]"), encoding="utf-8")
    with pytest.raises(BenchError, match=r"step\[0\] = -3\.0; .*-2 to 4 deg"):
        wires.run()
    path.write_text(text.replace("home = true", "home = true\ntravel = [1.0, 4.0]"), encoding="utf-8")
    with pytest.raises(BenchError, match=r"travel = .*must include the zero, 0"):
        wires.run()
    path.write_text(text.replace("home = true", "home = true\ntravel = [-4.0, 4.0]"), encoding="utf-8")
    wires.stage.referenced = wires.stage.servo = True
    wires.stage.axis.initial = 37.0
    with pytest.raises(BenchError, match=r"position = 37\.0; .*-4 to 4"):
        wires.run()
    assert not wires.stage.axis.moves
