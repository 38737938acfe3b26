"""The driver of Thorlabs stages, with a scripted dialogue and with a simulated controller, also on a pty."""

import contextlib
import os
import struct
import sys
import threading

import pytest

from solen.bench.clock import SimulatedClock, WallClock
from solen.bench.drivers import DRIVERS
from solen.bench.homing import ensure_zero
from solen.bench.kinesis import KinesisStage, message_of
from solen.bench.roles import HomingStage
from solen.errors import BenchError
from tests.bench.kinesis_controller_support import KinesisController, message
from tests.bench.stage_support import Dialogue, rig_with, wait_for_arrival
from tests.bench.wire_support import Served, Wire

PRM1_Z8, K10CR1 = 1919.6418578623391, 409_600 / 3.0
STEPPER = {"model": b"K10CR1", "scale": 53.68, "per_unit": K10CR1, "highest": 10.0}


def hexed(text: str) -> bytes:
    return bytes.fromhex(text)


HELLO = [
    (hexed("12 00 00 00 50 01"), b""),
    # serial number 27000001, "KDC101", then type, firmware and unused bytes
    (hexed("05 00 00 00 50 01"), hexed("06 00 54 00 81 50 C1 FC 9B 01 4B 44 43 31 30 31 00 00") + bytes(72)),
    (hexed("10 02 01 01 50 01"), b""),
    (hexed("3A 04 06 00 D0 01 01 00 00 00 00 00"), b""),
]


def status(counts: int, bits: int) -> bytes:
    return hexed("91 04 0E 00 81 50") + struct.pack("<HihhI", 1, counts, 0, 0, bits)


def velocity(value: int) -> bytes:
    return hexed("15 04 0E 00 81 50") + struct.pack("<Hiii", 1, 0, 264, value)


QUERY_STATUS, QUERY_VELOCITY = hexed("90 04 01 00 50 01"), hexed("14 04 01 00 50 01")


def wired_stage(**attributes: object) -> tuple[KinesisStage, KinesisController, SimulatedClock, Wire]:
    clock = SimulatedClock()
    controller = KinesisController(clock, **attributes)  # type: ignore[arg-type]  # the values have several types
    wire = Wire(controller, clock)
    return KinesisStage(wire, clock, counts_per_unit=controller.per_unit), controller, clock, wire


def test_dialogue_follows_specification() -> None:
    # the manufacturer's example: an actuator with 34,554.96 counts per mm, for which 1 mm/s is 772,981.3692; the stage
    # is homed, and moves to 1 mm
    exchanges = [
        (QUERY_STATUS, status(0, 0x8000_0000)),
        (QUERY_STATUS, status(0, 0x8000_0000)),
        (hexed("43 04 01 00 50 01"), hexed("44 04 01 00 01 50")),
        (QUERY_STATUS, status(-900, 0x8000_0220)),
        (QUERY_STATUS, hexed("44 04 01 00 01 50") + status(0, 0x8000_0400)),
        (QUERY_VELOCITY, velocity(1_000)),
        (hexed("13 04 0E 00 D0 01 01 00 00 00 00 00 08 01 00 00 75 CB 0B 00"), b""),
        (QUERY_VELOCITY, velocity(772_981)),
        (hexed("53 04 06 00 D0 01 01 00 FB 86 00 00"), b""),
        (QUERY_STATUS, status(17_277, 0x8000_0410)),
        (QUERY_STATUS, hexed("64 04 0E 00 81 50") + bytes(14) + status(34_556, 0x8000_0400)),
        (hexed("65 04 01 02 50 01"), hexed("66 04 0E 00 81 50") + bytes(14)),
        (QUERY_STATUS, status(34_555, 0x8000_0400)),
    ]
    stage = KinesisStage(Dialogue(HELLO + exchanges), SimulatedClock(), counts_per_unit=34_554.96, unit="mm")
    assert stage.identity == "KDC101 27000001"
    ensure_zero(stage, True, 0.0)
    stage.begin_move(1.0, 1.0)
    assert stage.position() == pytest.approx(0.5, abs=1e-4)
    assert stage.on_target()
    stage.close()


@pytest.mark.parametrize("kind", [{}, STEPPER, {"model": b"KBD101", "scale": 65536 * 102.4e-6, "per_unit": 4000.0}])
def test_homes_moves_and_stops(kind: dict[str, object]) -> None:
    stage, controller, clock, _ = wired_stage(**kind)
    homing_stage: HomingStage = stage
    assert homing_stage.name
    with pytest.raises(BenchError, match="by up to 360 deg"):
        ensure_zero(stage, False, 0.0)
    assert not controller.axis.moves
    ensure_zero(stage, True, 0.0)
    assert (stage.referenced, stage.position()) == (True, 0.0)
    for target in (3.0, -3.0):  # the duration shows that there is no backlash correction
        distance = abs(target - stage.position())
        stage.begin_move(target, 10.0)
        assert wait_for_arrival(stage, clock) == pytest.approx(distance / 10.0 + 10.0 / 200.0, abs=0.02)
        assert stage.position() == pytest.approx(target, abs=1.0 / controller.per_unit)
    stage.begin_move(3.0, 10.0)
    clock.sleep(0.2)
    stage.stop()
    position = stage.position()
    clock.sleep(1.0)
    assert -3.0 < stage.position() == position < 3.0
    with pytest.raises(BenchError, match="from its target"):
        stage.on_target()
    with pytest.raises(BenchError, match=rf"velocity 60 is above its maximum, {controller.highest:g} deg/s"):
        stage.begin_move(0.0, 60.0)


def test_defines_current_position_without_move() -> None:
    stage, controller, clock, _ = wired_stage()
    ensure_zero(stage, "here", 1.0)
    assert stage.position() == pytest.approx(1.0)
    assert not controller.axis.moves
    stage.begin_move(-1.0, 15.0)
    wait_for_arrival(stage, clock)
    assert controller.axis.at(clock.now_s()) == pytest.approx(35.0 * PRM1_Z8, abs=1.0)


def test_short_move_does_not_end_before_it_begins() -> None:
    stage, controller, clock, _ = wired_stage()
    ensure_zero(stage, "here", 0.0)
    controller.stuck = True  # the status is that before the move
    stage.begin_move(0.009, 15.0)
    assert not stage.on_target()
    controller.stuck = False
    stage.begin_move(0.009, 15.0)
    wait_for_arrival(stage, clock)
    assert stage.position() == pytest.approx(0.009, abs=2.0 / PRM1_Z8)
    controller.stuck = True
    stage.begin_move(0.0, 15.0)
    clock.sleep(0.3)
    assert stage.on_target()  # within the tolerance of a servo


def test_reports_faults_of_stage_and_line() -> None:
    stage, controller, clock, wire = wired_stage()
    ensure_zero(stage, "here", 0.0)
    controller.unsolicited = message(0x0464, bytes(14)) + message(0x0444, first=1)  # end of a move, and of homing
    assert stage.position() == 0.0
    controller.stuck = True
    stage.begin_move(3.0, 15.0)
    assert not stage.on_target()  # the move may not have begun yet
    clock.sleep(0.3)
    with pytest.raises(BenchError, match=r"stopped -3\.\d+ deg from its target"):
        stage.on_target()
    controller.bits |= 0x4000
    with pytest.raises(BenchError, match="motion error"):
        stage.on_target()
    controller.unsolicited = message(0x0081, struct.pack("<HH64s", 0x0453, 7, b"the channel is off"))
    with pytest.raises(BenchError, match="the channel is off"):
        stage.position()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match="no reply within 1 s"):
        stage.position()
    wire.faults.deaf, wire.faults.garbage = False, b"\xff" * 30
    with pytest.raises(BenchError, match="no reply within 1 s"):
        stage.position()
    wire.faults.garbage = b"<Idle|MPos:0.000>\r\n"
    with pytest.raises(BenchError, match="not an APT message"):
        stage.position()


def test_refuses_unknown_controller() -> None:
    with pytest.raises(BenchError, match="TIM101 27000001 is not a supported controller; use one of TDC001, "):
        wired_stage(model=b"TIM101")
    with pytest.raises(BenchError, match="12 bytes instead of 84"):
        KinesisStage(Dialogue([HELLO[0], (HELLO[1][0], message(6, bytes(12)))]), SimulatedClock(), counts_per_unit=1.0)
    stage, _, _, _ = wired_stage(per_unit=1e8)
    with pytest.raises(BenchError, match=r"32 bits; check steps_per_unit"):
        stage.begin_move(30.0, 1e-3)


def test_splits_messages() -> None:
    both = message(0x0481, bytes(14)) + message(0x0444, first=1)
    assert [message_of(both[:size]) for size in (3, 6, 19)] == [None] * 3
    assert message_of(both) == (both[:20], both[20:])
    assert message_of(both[20:]) == (both[20:], b"")


def test_rig_opens_stage() -> None:
    with Served(KinesisController(WallClock())) as served:
        rig = rig_with(driver="kinesis", port=served.url, steps_per_unit=PRM1_Z8, home="here")
        stage = DRIVERS["kinesis"].open(rig, WallClock())
        assert isinstance(stage, KinesisStage)
        stage.set_position(0.0)
        check_move(stage)
        stage.close()
    with pytest.raises(BenchError, match=r"steps_per_unit; is required by the driver kinesis"):
        rig_with(driver="kinesis", port="COM4")
    with pytest.raises(BenchError, match=r"axis = '2'; is not used by the driver kinesis"):
        rig_with(driver="kinesis", port="COM4", steps_per_unit=1.0, axis="2")
    with pytest.raises(BenchError, match=r"port = 'COM4'; is not used by the driver hand"):
        rig_with(driver="hand", port="COM4")


def check_move(stage: KinesisStage) -> None:
    stage.begin_move(1.0, 10.0)
    positions = []
    while not stage.on_target():
        positions.append(stage.position())
    assert positions == sorted(positions)
    assert len(positions) > 3


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")
def test_drives_stage_over_serial_line() -> None:
    import pty
    import tty

    instrument, host = pty.openpty()
    tty.setraw(host)
    controller = KinesisController(WallClock(), **STEPPER)  # type: ignore[arg-type]

    def serve() -> None:
        with contextlib.suppress(OSError):  # raised when the line is closed
            while True:
                os.write(instrument, controller.reply(os.read(instrument, 4096)))

    threading.Thread(target=serve, daemon=True).start()
    rig = rig_with(driver="kinesis", port=os.ttyname(host), steps_per_unit=K10CR1, home=True)
    stage = DRIVERS["kinesis"].open(rig, WallClock())
    assert isinstance(stage, KinesisStage)
    stage.set_position(0.0)
    check_move(stage)
    stage.close()
    os.close(host)
    os.close(instrument)
