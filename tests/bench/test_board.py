"""The driver of the emitter board with a simulated board on the wire, and faults of the wire."""

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
    """Return samples that encode the numbers of their period, slot and input."""
    index = np.arange(LAYOUT.values).reshape(2, 2, 4)
    return ((number[:, None, None, None] * 100 + index) % 65536).astype(np.uint16)


class CountingHardware(SimulatedHardware):
    """Hardware that samples `counts`."""

    def __init__(self) -> None:
        super().__init__(lambda *_: np.zeros((1, 4), np.uint16), 5000, LAYOUT.emitters, LAYOUT.receivers)

    def sample(self, buffer: bytearray, at: int, inputs: int) -> None:
        number = int.from_bytes(buffer[6:10], "little")
        row = counts(np.array([number])).reshape(4, 4)[(at - 18) // 8]
        buffer[at : at + 2 * inputs] = row.astype("<u2").tobytes()


def wired_board() -> tuple[SerialBoard, BoardController, Wire, SimulatedClock]:
    clock = SimulatedClock()
    controller = BoardController(clock, CountingHardware())
    wire = Wire(controller, clock)
    board = SerialBoard(wire, clock, LAYOUT, period_s=PERIOD_S, volts_per_count=1e-4)
    return board, controller, wire, clock


def read_periods(board: EmitterBoard, clock: Clock, times: int, interval_s: float = 0.1) -> Periods:
    parts = []
    for _ in range(times):
        clock.sleep(interval_s)
        parts.append(board.read())
    return Periods.joined(parts, board.layout)


def test_board_sends_periods_until_stopped() -> None:
    board, controller, _, clock = wired_board()
    assert board.identity == "solen emitter board (simulated)"
    board.start()
    periods = read_periods(board, clock, 20)
    assert periods.number.tolist() == list(range(400))
    assert np.array_equal(periods.counts, counts(periods.number))
    assert board.losses == Losses()
    assert controller.sampling
    board.close()
    assert not controller.sampling
    clock.sleep(1.0)
    assert len(board.read()) == 0


def test_counts_lost_and_garbled_frames() -> None:
    board, controller, wire, clock = wired_board()
    controller.lose = {50, 51, 52, 300}
    board.start()
    read_periods(board, clock, 5)
    wire.faults.garbage = b"\xa5\x5a\x01\x01\xff\xff noise"
    read_periods(board, clock, 5)
    wire.faults.lost = 7
    periods = read_periods(board, clock, 10)
    assert board.losses.dropped == 5
    assert board.losses.garbled + board.losses.skipped_bytes > 0
    assert len(np.unique(periods.number)) == len(periods)
    assert np.array_equal(periods.counts, counts(periods.number))


def test_board_goes_dark_without_host() -> None:
    board, controller, wire, clock = wired_board()
    board.start()
    read_periods(board, clock, 50)
    assert controller.sampling  # every reading sends a sign of life
    last_us = controller.hardware.at_us
    clock.sleep(2.5)
    wire.instrument.reply(b"")
    assert not controller.sampling
    dark_us, emitter = controller.hardware.switched[-1]
    assert emitter == -1
    assert 0 < dark_us - last_us < 1_000_000


def test_reads_board_clock_until_first_missing_reply() -> None:
    board, controller, wire, clock = wired_board()
    board.start()
    read_periods(board, clock, 50)
    for until_s in (2500, 4300):  # the microseconds overflow their 4 bytes in between
        clock.sleep(until_s - clock.now_s())
        controller.hardware.at_us = until_s * 1_000_000
        controller.core.receive(frame(ALIVE, 0, b""))
        read_periods(board, clock, 1)
    assert board.losses.dropped > 858_000  # the periods of the jump in time
    assert board.time_s() == pytest.approx(4300.1, abs=1e-6)
    controller.has_clock = False
    assert math.isnan(board.time_s() or 0.0)
    wire.faults.deaf = True
    sent = len(wire.sent)
    assert [board.time_s() for _ in range(3)] == [None] * 3
    assert len(wire.sent) == sent + 1


def test_reports_rejected_command_and_missing_reply() -> None:
    board, _, wire, clock = wired_board()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match=r"start within 1 s; .*baud rate"):
        board.start()
    with pytest.raises(BenchError, match=r"configure: .*; .*rig file"):
        SerialBoard(
            Wire(BoardController(clock, CountingHardware()), clock),
            clock,
            Layout(3, 4),
            period_s=PERIOD_S,
            volts_per_count=1.0,
        )
    wire.faults.disconnected = True
    with pytest.raises(BenchError, match="disconnected"):
        board.read()


def test_reads_board_over_socket() -> None:
    clock = WallClock()
    with Served(BoardController(clock, CountingHardware())) as served:
        board = SerialBoard(open_link(served.url), clock, LAYOUT, period_s=PERIOD_S, volts_per_count=1e-4)
        board.start()
        periods = read_periods(board, clock, 8, 0.05)
        board.close()
    assert len(periods) >= 50
    assert periods.number.tolist() == list(range(len(periods)))
    assert np.array_equal(periods.counts, counts(periods.number))
    assert board.losses == Losses()


def test_firmware_core_samples_as_simulated_board(bench: Path) -> None:
    rig, clock = load_rig(bench / "rig.toml"), SimulatedClock()
    sensors = tuple(
        replace(sensor, circuit=replace(sensor.circuit, adc=replace(sensor.circuit.adc, noise_V=0.0)))
        for sensor in simulated_sensors(rig, bench, 3.0, np.random.default_rng(1))
    )
    layout = Layout(rig.emitters, rig.inputs)

    def swing(time_s: FloatArray) -> FloatArray:
        return np.asarray(3.0 * np.sin(2.0 * time_s))

    def simulated(seed: int) -> SimulatedBoard:
        return SimulatedBoard(
            clock, sensors, swing, AmbientLight(), np.random.default_rng(seed), layout=layout, period_s=PERIOD_S, ppm=0
        )

    direct, sampler = simulated(1), simulated(2)
    controller = BoardController(clock, SimulatedHardware(sampler.counts, 5000, layout.emitters, layout.receivers))
    board = SerialBoard(
        Wire(controller, clock), clock, layout, period_s=PERIOD_S, volts_per_count=direct.volts_per_count
    )
    direct.start()
    board.start()
    by_core = read_periods(board, clock, 10)
    at_once = direct.read()
    assert len(at_once) == 200
    for name in ("number", "board_us", "flags"):
        assert np.array_equal(getattr(at_once, name), getattr(by_core, name))
    difference = at_once.counts.astype(float) - by_core.counts  # two draws of the shot noise
    assert (np.abs(difference.mean(axis=0)) <= 5.0 * difference.std(axis=0) / np.sqrt(len(at_once))).all()
    assert difference.std() < 200.0
    assert np.ptp(at_once.counts[:, 0, 0, 0]) > 10_000


def test_motor_on_board_follows_velocity_ramp() -> None:
    board, controller, _, clock = wired_board()
    stage = BoardStage(board, clock, steps_per_unit=100.0, acceleration=200.0)
    homing_stage: HomingStage = stage
    with pytest.raises(BenchError, match=r"no reference switch.*home = \"here\""):
        ensure_zero(stage, False, 0.0)
    ensure_zero(stage, "here", 0.5)
    assert (homing_stage.referenced, stage.position()) == (True, 0.5)
    board.start()
    stage.begin_move(3.5, 15.0)
    with pytest.raises(BenchError, match="move: impossible"):
        stage.begin_move(0.0, 15.0)
    assert wait_for_arrival(stage, clock) == pytest.approx(3.0 / 15.0 + 15.0 / 200.0, abs=0.02)
    assert stage.position() == 3.5
    at_us, steps = np.array(controller.hardware.steps).T
    move = Move(0.0, 0.5, 3.5, 15.0, 200.0)
    expected = move.at(1e-6 * (at_us - at_us[0]) + np.sqrt(2 * 0.005 / 200.0))
    assert np.abs(expected - steps / 100.0).max() < 0.011  # a step
    stage.begin_move(-3.0, 15.0)
    clock.sleep(0.2)
    stage.stop()
    stage.stop()
    assert -3.0 < stage.position() < 3.4
    with pytest.raises(BenchError, match="stopped at step"):
        stage.on_target()
    number = board.read().number
    assert number.tolist() == list(range(len(number)))  # sampling went on throughout
    assert len(number) > 80
    with pytest.raises(BenchError, match="move: impossible"):
        stage.begin_move(0.0, 1e4)
    for target, velocity, name in ((3e7, 1.0, "position"), (0.0, 1e5, "velocity"), (math.nan, 1.0, "position")):
        with pytest.raises(BenchError, match=f"{name} = .*32 bits"):
            stage.begin_move(target, velocity)
    controller.hardware.max_steps_per_s = 0
    with pytest.raises(BenchError, match="has no motor"):
        stage.position()
