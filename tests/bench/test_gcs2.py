"""The driver of PI stages, with a scripted dialogue and with a simulated controller, and faults of the line."""

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
from tests.bench.stage_support import Dialogue, wait_for_arrival
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
"""The dialogue when the stage is opened."""


def test_dialogue_follows_manual(recwarn: pytest.WarningsRecorder) -> None:
    exchanges = [
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
    link = Dialogue(HELLO + exchanges)
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


def test_reads_replies_with_address_and_several_lines() -> None:
    hello = [(b"3 " + query, b"0 3 " + reply if reply else reply) for query, reply in HELLO]
    link = Dialogue([*hello, (b"3 HLP?\n", b"0 3 a \nb \nc\n")])
    stage = Gcs2Stage(link, SimulatedClock(), stage="M-060.DG", address=3)
    assert stage.query("HLP?") == ["a", "b", "c"]


def wired_stage(**attributes: float) -> tuple[Gcs2Stage, Gcs2Controller, Wire, SimulatedClock]:
    clock = SimulatedClock()
    controller = Gcs2Controller(clock, **attributes)  # type: ignore[arg-type]  # numbers only
    wire = Wire(controller, clock)
    return Gcs2Stage(wire, clock, stage="M-060.DG"), controller, wire, clock


def test_references_moves_and_stops() -> None:
    stage, controller, _, clock = wired_stage()
    with pytest.raises(BenchError, match="error 5,"):
        stage.begin_move(3.0, 15.0)
    stage.reference()
    assert (stage.referenced, stage.position()) == (True, 0.0)
    stage.begin_move(3.0, 15.0)
    assert wait_for_arrival(stage, clock) == pytest.approx(3.0 / 15.0 + 15.0 / 100.0 + 0.05, abs=0.02)
    assert stage.position() == 3.0
    stage.begin_move(-3.0, 15.0)
    clock.sleep(0.2)
    stage.stop()
    position = stage.position()
    clock.sleep(1.0)
    assert stage.position() == position
    assert controller.axis.at(clock.now_s()) == pytest.approx(position, abs=1e-7)
    assert -3.0 < position < 3.0


def test_defines_current_position() -> None:
    stage, controller, _, clock = wired_stage()
    homing_stage: HomingStage = stage
    assert homing_stage.name
    ensure_zero(stage, "here", 2.5)
    assert (stage.referenced, stage.position(), controller.axis.moves) == (True, 2.5, [])
    ensure_zero(stage, False, 0.0)  # the zero is known now
    stage.begin_move(3.0, 15.0)
    assert wait_for_arrival(stage, clock) < 1.0


def test_drives_unknown_stage_with_specified_unit() -> None:
    clock = SimulatedClock()
    controller = Gcs2Controller(clock, stage="L-611.9ASD")
    stage = Gcs2Stage(Wire(controller, clock), clock, stage="L-611.9ASD", unit="deg")
    stage.reference()
    stage.begin_move(2.0, 10.0)
    wait_for_arrival(stage, clock)
    assert (stage.position(), stage.unit) == (2.0, "deg")
    with pytest.raises(BenchError, match=r"'L-611\.9ASD'; .*set its unit"):
        Gcs2Stage(Wire(controller, clock), clock, stage="L-611.9ASD")


def test_unit_follows_from_known_stage() -> None:
    rotary: Stage = wired_stage()[0]
    assert rotary.unit == "deg"
    clock = SimulatedClock()
    linear: Stage = Gcs2Stage(Wire(Gcs2Controller(clock, stage="M-111.1DG"), clock), clock, stage="M-111.1DG")
    assert linear.unit == "mm"


def test_reports_errors_of_controller() -> None:
    stage, controller, _, clock = wired_stage(low=-5.0, high=5.0)
    stage.reference()
    with pytest.raises(BenchError, match=r"target 9 is outside the limits of the stage, -5 to 5 deg"):
        stage.begin_move(9.0, 15.0)
    with pytest.raises(BenchError, match="error 8,"):
        stage.begin_move(1.0, 500.0)
    stage.begin_move(4.0, 5.0)
    clock.sleep(0.1)
    controller.stall()
    with pytest.raises(BenchError, match="error 1024,"):
        wait_for_arrival(stage, clock)


def test_refuses_other_stages_and_instruments() -> None:
    clock = SimulatedClock()
    with pytest.raises(BenchError, match=r"configured for M-111\.1DG, not M-060\.DG"):
        Gcs2Stage(Wire(Gcs2Controller(clock, stage="M-111.1DG"), clock), clock, stage="M-060.DG")
    with pytest.raises(BenchError, match=r"^stage = 'M-1'; .*M-060\.DG, M-111\.1DG"):
        Gcs2Stage(Wire(Gcs2Controller(clock), clock), clock, stage="M-1")
    link = Dialogue([(b"ERR?\n", b"0\n"), (b"*IDN?\n", b"ACME, 1, 2\n")])
    with pytest.raises(BenchError, match=r"'ACME, 1, 2' .* controller of PI"):
        Gcs2Stage(link, SimulatedClock(), stage="M-060.DG")


def test_reports_faults_of_line() -> None:
    stage, _, wire, clock = wired_stage()
    wire.faults.deaf = True
    begin_s = clock.now_s()
    with pytest.raises(BenchError, match=r"within 1 s .*; .*baud rate"):
        stage.position()
    assert clock.now_s() - begin_s == pytest.approx(1.0)
    wire.faults.deaf = False
    wire.faults.garbage = b"\xff\xfe"
    with pytest.raises(BenchError, match=r"not text; .*baud rate"):
        stage.position()
    wire.faults.garbage = b"%&$\n"
    with pytest.raises(BenchError, match=r"replied '%&\$' to POS\?"):
        stage.position()
    wire.faults.disconnected = True
    with pytest.raises(BenchError, match="disconnected"):
        stage.position()


def test_gives_up_reference_move_after_a_minute() -> None:
    stage, _, _, clock = wired_stage(reference_s=1e9)
    with pytest.raises(BenchError, match=r"reference .*within 60 s"):
        stage.reference()
    assert clock.now_s() == pytest.approx(60.0, abs=0.2)


def test_drives_stage_over_socket() -> None:
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
        with pytest.raises(BenchError, match=r"no reply within 0\.5 s"):
            stage.position()
        faults.deaf = False
        assert stage.position() == 0.5
        faults.disconnected = True
        clock.sleep(0.1)
        with pytest.raises(BenchError, match=r"disconnected|no reply"):
            stage.position()
        link.close()


def test_discards_late_reply() -> None:
    stage, _, wire, _ = wired_stage()
    stage.reference()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match="no reply"):
        stage.position()
    wire.faults.deaf = False
    wire.write(b"POS? 1\n")  # its reply arrives before the next query
    assert stage.on_target()


def test_reports_missing_port_in_one_line() -> None:
    with pytest.raises(BenchError, match="cannot be opened") as bad:
        open_link("/dev/no-such-port")
    assert len(str(bad.value).splitlines()) == 1


@pytest.mark.parametrize("target", [0.001, 1.0, 3.0, -3.0])
def test_move_keeps_velocity_and_acceleration(target: float) -> None:
    move = Move(0.5, 0.0, target, 15.0, 100.0)
    time_s = np.linspace(0.0, 2.0, 20_001)
    positions = move.at(time_s)
    velocity = np.gradient(positions, time_s)
    assert np.abs(velocity).max() <= 15.0 * (1 + 1e-9)
    assert np.abs(np.gradient(velocity, time_s)).max() <= 100.0 * 1.001
    assert positions[0] == 0.0
    assert positions[time_s >= move.end_s] == pytest.approx(target)
    if abs(target) >= 15.0**2 / 100.0:
        assert move.end_s == pytest.approx(0.5 + abs(target) / 15.0 + 0.15)


def test_array_of_positions_equals_single_positions() -> None:
    axis = Axis(100.0)
    axis.send(0.1, 3.0, 15.0)
    axis.send(0.2, -3.0, 15.0)
    axis.halt(0.3)
    axis.send(0.9, 1.0, 5.0)
    time_s = np.linspace(0.0, 2.0, 301)
    assert axis.positions(time_s) == pytest.approx([axis.at(at_s) for at_s in time_s.tolist()])
    assert axis.at(2.0) == pytest.approx(1.0)
