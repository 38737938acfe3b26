"""The driver of Zaber stages, with a scripted dialogue and with a simulated device, also over a socket."""

import pytest

from solen.bench.clock import SimulatedClock, WallClock
from solen.bench.drivers import DRIVERS
from solen.bench.homing import ensure_zero
from solen.bench.roles import HomingStage
from solen.bench.zaber import ZaberStage
from solen.errors import BenchError
from tests.bench.stage_support import Dialogue, rig_with, wait_for_arrival
from tests.bench.wire_support import Served, Wire
from tests.bench.zaber_controller_support import ZaberDevice

PER_DEG = 4000.0
HELLO = [
    (b"/1 1 get limit.min\n", b"@01 1 OK IDLE -- -200000\r\n"),
    (b"/1 1 get limit.max\n", b"@01 1 OK IDLE -- 200000\r\n"),
]


def wired_stage() -> tuple[ZaberStage, ZaberDevice, SimulatedClock, Wire]:
    clock = SimulatedClock()
    device = ZaberDevice(clock)
    wire = Wire(device, clock)
    return ZaberStage(wire, clock, steps_per_unit=PER_DEG), device, clock, wire


def test_dialogue_follows_manual() -> None:
    exchanges = [
        (b"/1 1 get pos\n", b"@01 1 OK IDLE WR 4000\r\n"),
        (b"/1 1 set pos 0\n", b"@01 1 OK IDLE -- 0\r\n"),
        (b"/1 1 set maxspeed 98304\n", b"@01 1 OK IDLE -- 0\r\n"),  # 15 deg/s * 4000 / deg * 1.6384
        (b"/1 1 move abs -12000\n", b"@01 1 OK BUSY -- 0:5D\r\n"),
        (b"/1 1 get pos\n", b"!01 1 BUSY --\r\n#01 1 info\r\n@01 1 OK BUSY -- -6000\r\n"),
        (b"/1 1 get pos\n", b"@01 1 OK IDLE -- -12000\r\n"),
        (b"/1 1 move abs 4000000\n", b"@01 1 RJ IDLE -- BADDATA\r\n"),
        (b"/1 1 stop\n", b"@01 1 OK IDLE -- 0\r\n"),
        (b"/1 1 get pos\n", b"@01 1 OK IDLE -- -12000\r\n"),
    ]
    stage = ZaberStage(Dialogue(HELLO + exchanges), SimulatedClock(), steps_per_unit=PER_DEG)
    ensure_zero(stage, "here", 0.0)
    stage.begin_move(-3.0, 15.0)
    assert stage.position() == -1.5
    assert stage.on_target()
    with pytest.raises(BenchError, match="move abs 4000000: rejected, BADDATA"):
        stage.begin_move(1000.0, 15.0)
    stage.close()


def test_homes_moves_and_stops() -> None:
    stage, device, clock, _ = wired_stage()
    homing_stage: HomingStage = stage
    assert homing_stage.name
    with pytest.raises(BenchError, match="by up to 100 deg"):
        ensure_zero(stage, False, 0.0)
    assert not device.axis.moves
    ensure_zero(stage, True, 0.0)
    assert (stage.referenced, stage.position()) == (True, 0.0)
    stage.begin_move(3.0, 15.0)
    assert wait_for_arrival(stage, clock) == pytest.approx(3.0 / 15.0 + 15.0 / 250.0, abs=0.02)
    assert stage.position() == 3.0
    device.alert = b"!01 1 IDLE --\r\n"
    stage.begin_move(-3.0, 15.0)
    clock.sleep(0.2)
    stage.stop()
    position = stage.position()
    clock.sleep(1.0)
    assert stage.position() == position
    assert -3.0 < position < 3.0
    with pytest.raises(BenchError, match="stopped at"):
        stage.on_target()
    with pytest.raises(BenchError, match=r"set maxspeed \d+: rejected, BADDATA"):
        stage.begin_move(0.0, 500.0)


def test_reports_faults_of_axis_and_line() -> None:
    stage, device, clock, wire = wired_stage()
    ensure_zero(stage, "here", 1.0)
    assert (stage.position(), device.axis.moves) == (1.0, [])
    stage.begin_move(3.0, 15.0)
    clock.sleep(1.0)
    device.warning = "FS"
    with pytest.raises(BenchError, match="fault FS, the axis stalled and stopped"):
        stage.on_target()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match="no reply within 1 s"):
        stage.position()
    other = Dialogue([(b"/1 1 get limit.min\n", b"@02 1 OK IDLE -- 0\r\n")])
    with pytest.raises(BenchError, match=r"'@02 1 OK IDLE -- 0' .*; check the address"):
        ZaberStage(other, clock, steps_per_unit=PER_DEG)


def test_rig_opens_stage() -> None:
    with Served(ZaberDevice(WallClock())) as served:
        rig = rig_with(driver="zaber", port=served.url, steps_per_unit=PER_DEG, home="here")
        stage = DRIVERS["zaber"].open(rig, WallClock())
        assert isinstance(stage, ZaberStage)
        stage.set_position(0.0)
        stage.begin_move(1.0, 10.0)
        positions = []
        while not stage.on_target():
            positions.append(stage.position())
        stage.close()
    assert positions == sorted(positions)
    assert len(positions) > 3
    with pytest.raises(BenchError, match="steps_per_unit"):
        rig_with(driver="zaber", port="COM4")
    with pytest.raises(BenchError, match="steps_per_unit"):
        rig_with(steps_per_unit=10.0)
