"""The driver of PI stages: by a written conversation, against a simulated controller, with every fault of a wire."""

import numpy as np
import pytest

from solen.bench.clock import SimulatedClock, WallClock
from solen.bench.gcs2 import Gcs2Stage
from solen.bench.homing import ensure_zero
from solen.bench.link import open_link
from solen.bench.roles import HomingStage, Stage
from solen.bench.simulated.stage import Axis, Move
from solen.errors import BenchError
from tests.bench.gcs2_controller_support import Gcs2Controller
from tests.bench.stage_support import Dialogue
from tests.bench.wire_support import Faults, Served, Wire

HELLO = [
    (b"ERR?\n", b"0\n"),
    (b"*IDN?\n", b"(c)2015 Physik Instrumente (PI) GmbH & Co. KG, C-863.12, 0145500123, 1.2.1.0\n"),
    (b"CST? 1\n", b"1=M-060.DG\n"),
    (b"SVO 1 1\n", b""),
    (b"ERR?\n", b"0\n"),
    (b"TMN? 1\n", b"1=-360.0000000\n"),
    (b"TMX? 1\n", b"1=360.0000000\n"),
]
"""What is said when a stage is taken into use."""


def test_what_is_said_is_the_manual_s(recwarn: pytest.WarningsRecorder) -> None:
    more = [
        (b"FRF? 1\n", b"1=0\n"),
        (b"FRF 1\n", b""),
        (b"ERR?\n", b"0\n"),
        (b"\x07", b"\xb0\n"),
        (b"\x07", b"\xb1\n"),
        (b"ERR?\n", b"0\n"),
        (b"FRF? 1\n", b"1=1\n"),
        (b"VEL 1 15.000000\n", b""),
        (b"ERR?\n", b"0\n"),
        (b"MOV 1 -3.000000\n", b""),
        (b"ERR?\n", b"0\n"),
        (b"ONT? 1\n", b"1=0\n"),
        (b"\x05", b"1\n"),
        (b"POS? 1\n", b"1=-1.2345678\n"),
        (b"ONT? 1\n", b"1=1\n"),
        (b"MOV 1 3.000000\n", b""),
        (b"ERR?\n", b"7\n"),
        (b"\x18", b""),
        (b"ERR?\n", b"10\n"),
        (b"\x05", b"0\n"),
    ]
    link = Dialogue(HELLO + more)
    stage = Gcs2Stage(link, SimulatedClock(), stage="M-060.DG")
    stage.reference()
    stage.begin_move(-3.0, 15.0)
    assert not stage.on_target()
    assert stage.position() == -1.2345678
    assert stage.on_target()
    with pytest.raises(BenchError, match=r"MOV 1 3\.000000: error 7"):
        stage.begin_move(3.0, 15.0)
    stage.close()
    assert not recwarn.list


def test_answers_of_several_lines_and_addresses() -> None:
    link = Dialogue(
        [*((b"3 " + sent, b"0 3 " + got if got else got) for sent, got in HELLO), (b"3 HLP?\n", b"0 3 a \nb \nc\n")]
    )
    stage = Gcs2Stage(link, SimulatedClock(), stage="M-060.DG", address=3)
    assert stage.query("HLP?") == ["a", "b", "c"]


def driven(**more: float) -> tuple[Gcs2Stage, Gcs2Controller, Wire, SimulatedClock]:
    clock = SimulatedClock()
    controller = Gcs2Controller(clock, **more)  # type: ignore[arg-type]  # its numbers
    wire = Wire(controller, clock)
    return Gcs2Stage(wire, clock, stage="M-060.DG"), controller, wire, clock


def arrive(stage: Gcs2Stage, clock: SimulatedClock) -> float:
    begun = clock.now_s()
    while not stage.on_target():
        clock.sleep(0.01)
    return clock.now_s() - begun


def test_a_stage_is_referenced_moved_and_stopped() -> None:
    stage, controller, _, clock = driven()
    with pytest.raises(BenchError, match="error 5,"):
        stage.begin_move(3.0, 15.0)
    stage.reference()
    assert (stage.referenced, stage.position()) == (True, 0.0)
    stage.begin_move(3.0, 15.0)
    assert arrive(stage, clock) == pytest.approx(3.0 / 15.0 + 15.0 / 100.0 + 0.05, abs=0.02)
    assert stage.position() == 3.0
    stage.begin_move(-3.0, 15.0)
    clock.sleep(0.2)
    stage.stop()
    here = stage.position()
    clock.sleep(1.0)
    assert stage.position() == here
    assert controller.axis.at(clock.now_s()) == pytest.approx(here, abs=1e-7)
    assert -3.0 < here < 3.0


def test_where_it_stands_can_be_taken_for_a_position() -> None:
    stage, controller, _, clock = driven()
    homes: HomingStage = stage
    assert homes.name
    ensure_zero(stage, "here", 2.5)
    assert (stage.referenced, stage.position(), controller.axis.moves) == (True, 2.5, [])
    ensure_zero(stage, False, 0.0)  # it is known now
    stage.begin_move(3.0, 15.0)
    assert arrive(stage, clock) < 1.0


def test_any_stage_is_driven_whose_unit_is_stated() -> None:
    clock = SimulatedClock()
    controller = Gcs2Controller(clock, stage="L-611.9ASD")
    stage = Gcs2Stage(Wire(controller, clock), clock, stage="L-611.9ASD", unit="deg")
    stage.reference()
    stage.begin_move(2.0, 10.0)
    arrive(stage, clock)
    assert (stage.position(), stage.unit) == (2.0, "deg")
    with pytest.raises(BenchError, match=r"'L-611\.9ASD'; .*state its unit"):
        Gcs2Stage(Wire(controller, clock), clock, stage="L-611.9ASD")


def test_roles_are_played() -> None:
    stage, _, _, _ = driven()
    turning: Stage = stage
    assert turning.unit == "deg"
    clock = SimulatedClock()
    linear = Gcs2Stage(Wire(Gcs2Controller(clock, stage="M-111.1DG"), clock), clock, stage="M-111.1DG")
    shifting: Stage = linear
    assert shifting.unit == "mm"


def test_what_the_controller_refuses_is_reported() -> None:
    stage, controller, _, clock = driven(low=-5.0, high=5.0)
    stage.reference()
    with pytest.raises(BenchError, match=r"9 deg .* limits -5 to 5"):
        stage.begin_move(9.0, 15.0)
    with pytest.raises(BenchError, match="error 8,"):
        stage.begin_move(1.0, 500.0)
    stage.begin_move(4.0, 5.0)
    clock.sleep(0.1)
    controller.stall()
    with pytest.raises(BenchError, match="error 1024,"):
        arrive(stage, clock)


def test_another_stage_another_instrument_and_an_unknown_one() -> None:
    clock = SimulatedClock()
    with pytest.raises(BenchError, match=r"set up for M-111\.1DG, not M-060\.DG"):
        Gcs2Stage(Wire(Gcs2Controller(clock, stage="M-111.1DG"), clock), clock, stage="M-060.DG")
    with pytest.raises(BenchError, match=r"^stage = 'M-1'; .*known are M-060\.DG, M-111\.1DG"):
        Gcs2Stage(Wire(Gcs2Controller(clock), clock), clock, stage="M-1")
    link = Dialogue([(b"ERR?\n", b"0\n"), (b"*IDN?\n", b"ACME, 1, 2\n")])
    with pytest.raises(BenchError, match=r"'ACME, 1, 2' .*; .*PI"):
        Gcs2Stage(link, SimulatedClock(), stage="M-060.DG")


def test_silence_garbage_and_a_pulled_plug_are_reported_in_one_line() -> None:
    stage, _, wire, clock = driven()
    wire.faults.deaf = True
    begun = clock.now_s()
    with pytest.raises(BenchError, match=r"within 1 s .*; .*baud rate"):
        stage.position()
    assert clock.now_s() - begun == pytest.approx(1.0)
    wire.faults.deaf = False
    wire.faults.garbage = b"\xff\xfe"
    with pytest.raises(BenchError, match=r"not text; .*baud rate"):
        stage.position()
    wire.faults.garbage = b"%&$\n"
    with pytest.raises(BenchError, match=r"answered '%&\$' to POS\?"):
        stage.position()
    wire.faults.disconnected = True
    with pytest.raises(BenchError, match="disconnected"):
        stage.position()


def test_a_reference_that_is_never_found_is_given_up() -> None:
    stage, _, _, clock = driven(reference_s=1e9)
    with pytest.raises(BenchError, match=r"reference .*within 60 s"):
        stage.reference()
    assert clock.now_s() == pytest.approx(60.0, abs=0.2)


def test_over_a_socket_as_over_a_port() -> None:
    clock = WallClock()
    faults = Faults()
    with Served(Gcs2Controller(clock, reference_s=0.05), faults) as served:
        link = open_link(served.url)
        stage = Gcs2Stage(link, clock, stage="M-060.DG", timeout_s=0.5)
        stage.reference()
        stage.begin_move(0.5, 15.0)
        while not stage.on_target():
            clock.sleep(0.01)
        assert stage.position() == 0.5
        faults.deaf = True
        with pytest.raises(BenchError, match=r"no answer within 0\.5 s"):
            stage.position()
        faults.deaf = False
        assert stage.position() == 0.5
        faults.disconnected = True
        clock.sleep(0.1)
        with pytest.raises(BenchError, match=r"disconnected|no answer"):
            stage.position()
        link.close()


def test_an_answer_that_comes_late_is_not_taken_for_another_s() -> None:
    stage, _, wire, _ = driven()
    stage.reference()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match="no answer"):
        stage.position()
    wire.faults.deaf = False
    wire.write(b"POS? 1\n")  # what was asked is answered now
    assert stage.on_target()


def test_a_port_that_is_not_there() -> None:
    with pytest.raises(BenchError, match="cannot be opened") as refusal:
        open_link("/dev/no-such-port")
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("target", [0.001, 1.0, 3.0, -3.0])
def test_a_move_is_the_integral_of_its_velocity(target: float) -> None:
    move = Move(0.5, 0.0, target, 15.0, 100.0)
    time = np.linspace(0.0, 2.0, 200_001)
    positions = move.at(time)
    velocity = np.gradient(positions, time)
    assert np.abs(velocity).max() <= 15.0 * (1 + 1e-9)
    assert np.abs(np.gradient(velocity, time)).max() <= 100.0 * 1.001
    assert positions[0] == 0.0
    assert positions[time >= move.end_s] == pytest.approx(target)
    if abs(target) >= 15.0**2 / 100.0:
        assert move.end_s == pytest.approx(0.5 + abs(target) / 15.0 + 0.15)


def test_many_positions_are_those_of_each_time() -> None:
    axis = Axis(100.0)
    axis.send(0.1, 3.0, 15.0)
    axis.send(0.2, -3.0, 15.0)
    axis.halt(0.3)
    axis.send(0.9, 1.0, 5.0)
    times = np.linspace(0.0, 2.0, 301)
    assert axis.positions(times) == pytest.approx([axis.at(float(time)) for time in times])
    assert axis.at(2.0) == pytest.approx(1.0)
