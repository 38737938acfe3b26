"""The emitter board's driver against a simulated board on the wire, with every fault of a wire."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from solen.bench.board import SerialBoard
from solen.bench.clock import Clock, SimulatedClock, WallClock
from solen.bench.frames import Layout, Losses, Periods
from solen.bench.link import open_link
from solen.bench.roles import EmitterBoard
from solen.errors import BenchError
from tests.bench.board_controller_support import BoardController
from tests.bench.wire_support import Served, Wire

LAYOUT, PERIOD_S = Layout(2, 4), 0.005


@dataclass
class Counting:
    """Samples that say which period, slot and input they are of."""

    clock: Clock
    layout: Layout = LAYOUT
    period_s: float = PERIOD_S
    begun_s: float = 0.0
    sampled: int = 0
    starts: list[float] = field(default_factory=list)
    stops: int = 0

    def start(self) -> None:
        self.begun_s, self.sampled = self.clock.now_s(), 0
        self.starts.append(self.begun_s)

    def read(self) -> Periods:
        complete = int((self.clock.now_s() - self.begun_s) / self.period_s + 1e-9)
        number = np.arange(self.sampled, complete)
        self.sampled = complete
        return Periods(number, number * 5000, np.zeros(len(number), np.uint8), counts(number))

    def time_s(self) -> float:
        return self.clock.now_s() - self.begun_s

    def stop(self) -> None:
        self.stops += 1


def counts(number: np.ndarray) -> np.ndarray:
    place = np.arange(LAYOUT.values).reshape(2, 2, 4)
    return ((number[:, None, None, None] * 100 + place) % 65536).astype(np.uint16)


def made() -> tuple[SerialBoard, BoardController, Counting, Wire, SimulatedClock]:
    clock = SimulatedClock()
    sampler = Counting(clock)
    controller = BoardController(clock, sampler)
    wire = Wire(controller, clock)
    board = SerialBoard(wire, clock, LAYOUT, period_s=PERIOD_S, volts_per_count=1e-4)
    return board, controller, sampler, wire, clock


def listened(board: EmitterBoard, clock: Clock, times: int, every_s: float = 0.1) -> Periods:
    parts = []
    for _ in range(times):
        clock.sleep(every_s)
        parts.append(board.read())
    return Periods.joined(parts, board.layout)


def test_periods_come_until_it_is_stopped() -> None:
    board, controller, _, _, clock = made()
    assert board.identity == "solen emitter board (simulated)"
    board.start()
    got = listened(board, clock, 20)
    assert got.number.tolist() == list(range(400))
    assert np.array_equal(got.counts, counts(got.number))
    assert board.losses == Losses()
    assert controller.lit
    board.close()
    assert not controller.lit
    clock.sleep(1.0)
    assert len(board.read()) == 0


def test_frames_that_are_lost_or_garbled_are_counted() -> None:
    board, controller, _, wire, clock = made()
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
    board, controller, sampler, wire, clock = made()
    board.start()
    listened(board, clock, 50)
    assert controller.lit  # it is fed while it is read
    clock.sleep(2.5)
    wire.instrument.answer(b"")
    assert not controller.lit
    assert sampler.stops > 0


def test_its_clock_is_asked_for_and_a_board_without_an_answer_is_left_alone() -> None:
    board, controller, _, wire, clock = made()
    board.start()
    listened(board, clock, 50)
    clock.sleep(4300.0 - clock.now_s())  # the 4 bytes of its µs have wrapped
    listened(board, clock, 1)
    assert board.time_s() == pytest.approx(4300.1, abs=1e-6)
    controller.keeps_time = False
    assert math.isnan(board.time_s() or 0.0)
    wire.faults.deaf = True
    asked = len(wire.sent)
    assert [board.time_s() for _ in range(3)] == [None] * 3
    assert len(wire.sent) == asked + 1


def test_what_it_refuses_and_silence_are_told() -> None:
    board, _, _, wire, clock = made()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match=r"start within 1 s; .*baud rate"):
        board.start()
    with pytest.raises(BenchError, match=r"configure: .*; .*rig file"):
        SerialBoard(
            Wire(BoardController(clock, Counting(clock)), clock),
            clock,
            Layout(3, 4),
            period_s=PERIOD_S,
            volts_per_count=1.0,
        )
    wire.faults.gone = True
    with pytest.raises(BenchError, match="the line is gone"):
        board.read()


def test_over_a_socket() -> None:
    clock = WallClock()
    with Served(BoardController(clock, Counting(clock))) as served:
        board = SerialBoard(open_link(served.url), clock, LAYOUT, period_s=PERIOD_S, volts_per_count=1e-4)
        board.start()
        got = listened(board, clock, 8, 0.05)
        board.close()
    assert len(got) >= 50
    assert got.number.tolist() == list(range(len(got)))
    assert np.array_equal(got.counts, counts(got.number))
    assert board.losses == Losses()
