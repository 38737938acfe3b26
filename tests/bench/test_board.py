"""The emitter board's driver against a simulated board on the wire, with every fault of a wire."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.bench.board import BoardStage, SerialBoard
from solen.bench.clock import Clock, SimulatedClock, WallClock
from solen.bench.firmware.solen_board import ALIVE
from solen.bench.frames import Layout, Losses, Periods, frame
from solen.bench.homing import ensure_zero
from solen.bench.link import open_link
from solen.bench.rig import AmbientLight, load_rig
from solen.bench.roles import EmitterBoard, HomingStage
from solen.bench.simulated.board import SimulatedBoard
from solen.bench.simulated.sensors import simulated_sensors
from solen.bench.simulated.stage import Move
from solen.errors import BenchError
from tests.bench.board_controller_support import BoardController, SimulatedHardware
from tests.bench.stage_support import wait_for_arrival
from tests.bench.wire_support import Served, Wire

LAYOUT, PERIOD_S = Layout(2, 4), 0.005


def counts(number: np.ndarray) -> np.ndarray:
    """Samples that say which period, slot and input they are of."""
    place = np.arange(LAYOUT.values).reshape(2, 2, 4)
    return ((number[:, None, None, None] * 100 + place) % 65536).astype(np.uint16)


class Counting(SimulatedHardware):
    """Hardware that samples `counts`."""

    def __init__(self) -> None:
        super().__init__(lambda *_: np.zeros((1, 4), np.uint16), 5000, LAYOUT.emitters, LAYOUT.receivers)

    def sample(self, buffer: bytearray, at: int, inputs: int) -> None:
        number = int.from_bytes(buffer[6:10], "little")
        place = (at - 18) // 8
        row = counts(np.array([number])).reshape(4, 4)[place]
        buffer[at : at + 2 * inputs] = row.astype("<u2").tobytes()


def made() -> tuple[SerialBoard, BoardController, Wire, SimulatedClock]:
    clock = SimulatedClock()
    controller = BoardController(clock, Counting())
    wire = Wire(controller, clock)
    board = SerialBoard(wire, clock, LAYOUT, period_s=PERIOD_S, volts_per_count=1e-4)
    return board, controller, wire, clock


def listened(board: EmitterBoard, clock: Clock, times: int, every_s: float = 0.1) -> Periods:
    parts = []
    for _ in range(times):
        clock.sleep(every_s)
        parts.append(board.read())
    return Periods.joined(parts, board.layout)


def test_periods_come_until_it_is_stopped() -> None:
    board, controller, _, clock = made()
    assert board.identity == "solen emitter board (simulated)"
    board.start()
    got = listened(board, clock, 20)
    assert got.number.tolist() == list(range(400))
    assert np.array_equal(got.counts, counts(got.number))
    assert board.losses == Losses()
    assert controller.sampling
    board.close()
    assert not controller.sampling
    clock.sleep(1.0)
    assert len(board.read()) == 0


def test_frames_that_are_lost_or_garbled_are_counted() -> None:
    board, controller, wire, clock = made()
    controller.lose = {50, 51, 52, 300}
    board.start()
    listened(board, clock, 5)
    wire.faults.garbage = b"\xa5\x5a\x01\x01\xff\xff what is this"
    listened(board, clock, 5)
    wire.faults.lost = 7
    got = listened(board, clock, 10)
    assert board.losses.dropped == 5
    assert board.losses.garbled + board.losses.skipped_bytes > 0
    assert len(np.unique(got.number)) == len(got)
    assert np.array_equal(got.counts, counts(got.number))


def test_a_board_whose_host_is_gone_goes_dark() -> None:
    board, controller, wire, clock = made()
    board.start()
    listened(board, clock, 50)
    assert controller.sampling  # it is fed while it is read
    heard_us = controller.hardware.at_us
    clock.sleep(2.5)
    wire.instrument.reply(b"")
    assert not controller.sampling
    dark_us, emitter = controller.hardware.switched[-1]
    assert emitter == -1
    assert 0 < dark_us - heard_us < 1_000_000


def test_its_clock_is_asked_for_and_a_board_without_an_answer_is_left_alone() -> None:
    board, controller, wire, clock = made()
    board.start()
    listened(board, clock, 50)
    for until_s in (2500, 4300):  # the 4 bytes of its µs wrap meanwhile
        clock.sleep(until_s - clock.now_s())
        controller.hardware.at_us = until_s * 1_000_000
        controller.core.receive(frame(ALIVE, 0, b""))
        listened(board, clock, 1)
    assert board.losses.dropped > 858_000  # what a board that is held up for so long has not sampled
    assert board.time_s() == pytest.approx(4300.1, abs=1e-6)
    controller.has_clock = False
    assert math.isnan(board.time_s() or 0.0)
    wire.faults.deaf = True
    asked = len(wire.sent)
    assert [board.time_s() for _ in range(3)] == [None] * 3
    assert len(wire.sent) == asked + 1


def test_what_it_refuses_and_silence_are_reported() -> None:
    board, _, wire, clock = made()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match=r"start within 1 s; .*baud rate"):
        board.start()
    with pytest.raises(BenchError, match=r"configure: .*; .*rig file"):
        SerialBoard(
            Wire(BoardController(clock, Counting()), clock),
            clock,
            Layout(3, 4),
            period_s=PERIOD_S,
            volts_per_count=1.0,
        )
    wire.faults.disconnected = True
    with pytest.raises(BenchError, match="disconnected"):
        board.read()


def test_over_a_socket() -> None:
    clock = WallClock()
    with Served(BoardController(clock, Counting())) as served:
        board = SerialBoard(open_link(served.url), clock, LAYOUT, period_s=PERIOD_S, volts_per_count=1e-4)
        board.start()
        got = listened(board, clock, 8, 0.05)
        board.close()
    assert len(got) >= 50
    assert got.number.tolist() == list(range(len(got)))
    assert np.array_equal(got.counts, counts(got.number))
    assert board.losses == Losses()


def test_what_the_core_samples_is_what_the_simulated_board_works_out_at_once(bench: Path) -> None:
    rig, clock = load_rig(bench / "rig.toml"), SimulatedClock()
    prints = simulated_sensors(rig, bench, 3.0, np.random.default_rng(1))
    quiet = tuple(
        replace(one, circuit=replace(one.circuit, adc=replace(one.circuit.adc, noise_V=0.0))) for one in prints
    )
    layout = Layout(rig.emitters, rig.inputs)

    def swing(time_s: FloatArray) -> FloatArray:
        return np.asarray(3.0 * np.sin(2.0 * time_s))

    def simulated(seed: int) -> SimulatedBoard:
        return SimulatedBoard(
            clock, quiet, swing, AmbientLight(), np.random.default_rng(seed), layout=layout, period_s=PERIOD_S, ppm=0.0
        )

    whole, sampler = simulated(1), simulated(2)
    controller = BoardController(clock, SimulatedHardware(sampler.counts, 5000, layout.emitters, layout.receivers))
    board = SerialBoard(
        Wire(controller, clock), clock, layout, period_s=PERIOD_S, volts_per_count=whole.volts_per_count
    )
    whole.start()
    board.start()
    theirs = listened(board, clock, 10)
    ours = whole.read()
    assert len(ours) == 200
    for name in ("number", "board_us", "flags"):
        assert np.array_equal(getattr(ours, name), getattr(theirs, name))
    apart = ours.counts.astype(float) - theirs.counts  # shot noise, drawn anew
    assert (np.abs(apart.mean(axis=0)) <= 5.0 * apart.std(axis=0) / np.sqrt(len(ours))).all()
    assert apart.std() < 200.0
    assert np.ptp(ours.counts[:, 0, 0, 0]) > 10_000


def test_a_motor_on_the_board_makes_its_ramp_by_the_board_s_clock() -> None:
    board, controller, _, clock = made()
    stage = BoardStage(board, clock, steps_per_unit=100.0, acceleration=200.0)
    homes: HomingStage = stage
    with pytest.raises(BenchError, match=r"no switch .*home = \"here\""):
        ensure_zero(stage, False, 0.0)
    ensure_zero(stage, "here", 0.5)
    assert (homes.referenced, stage.position()) == (True, 0.5)
    board.start()
    stage.begin_move(3.5, 15.0)
    with pytest.raises(BenchError, match="move: cannot be done"):
        stage.begin_move(0.0, 15.0)
    assert wait_for_arrival(stage, clock) == pytest.approx(3.0 / 15.0 + 15.0 / 200.0, abs=0.02)
    assert stage.position() == 3.5
    at_us, steps = np.array(controller.hardware.steps).T
    move = Move(0.0, 0.5, 3.5, 15.0, 200.0)
    meant = move.at(1e-6 * (at_us - at_us[0]) + np.sqrt(2 * 0.005 / 200.0))
    assert np.abs(meant - steps / 100.0).max() < 0.011  # a step
    stage.begin_move(-3.0, 15.0)
    clock.sleep(0.2)
    stage.stop()
    stage.stop()
    here = stage.position()
    assert -3.0 < here < 3.4
    with pytest.raises(BenchError, match="rests at step"):
        stage.on_target()
    number = board.read().number
    assert number.tolist() == list(range(len(number)))  # it sampled all the while
    assert len(number) > 80
    with pytest.raises(BenchError, match="move: cannot be done"):
        stage.begin_move(0.0, 1e4)
    for target, velocity, name in ((3e7, 1.0, "position"), (0.0, 1e5, "velocity"), (math.nan, 1.0, "position")):
        with pytest.raises(BenchError, match=f"{name} must be .* 32 bits"):
            stage.begin_move(target, velocity)
    controller.hardware.max_steps_per_s = 0
    with pytest.raises(BenchError, match="has no motor"):
        stage.position()
