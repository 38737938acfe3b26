"""The driver of Zaber's stages: by a written conversation, and against a simulated device, also behind a socket."""

import pytest

from solen.bench.clock import SimulatedClock, WallClock
from solen.bench.drivers import DRIVERS
from solen.bench.homing import ensure_zero
from solen.bench.roles import HomingStage
from solen.bench.zaber import ZaberStage
from solen.errors import BenchError
from tests.bench.stage_support import Dialogue, wait_for_arrival, rig_with
from tests.bench.wire_support import Served, Wire
from tests.bench.zaber_controller_support import ZaberDevice

PER_DEG = 4000.0
HELLO = [
    (b"/1 1 get limit.min\n", b"@01 1 OK IDLE -- -200000\r\n"),
    (b"/1 1 get limit.max\n", b"@01 1 OK IDLE -- 200000\r\n"),
]


def driven() -> tuple[ZaberStage, ZaberDevice, SimulatedClock, Wire]:
    clock = SimulatedClock()
    device = ZaberDevice(clock)
    wire = Wire(device, clock)
    return ZaberStage(wire, clock, steps_per_unit=PER_DEG), device, clock, wire


def test_what_is_said_is_the_manual_s() -> None:
    more = [
        (b"/1 1 get pos\n", b"@01 1 OK IDLE WR 4000\r\n"),
        (b"/1 1 set pos 0\n", b"@01 1 OK IDLE -- 0\r\n"),
        (b"/1 1 set maxspeed 98304\n", b"@01 1 OK IDLE -- 0\r\n"),  # 15 deg/s * 4000 / deg * 1.6384
        (b"/1 1 move abs -12000\n", b"@01 1 OK BUSY -- 0:5D\r\n"),
        (b"/1 1 get pos\n", b"!01 1 BUSY --\r\n#01 1 remark\r\n@01 1 OK BUSY -- -6000\r\n"),
        (b"/1 1 get pos\n", b"@01 1 OK IDLE -- -12000\r\n"),
        (b"/1 1 move abs 4000000\n", b"@01 1 RJ IDLE -- BADDATA\r\n"),
        (b"/1 1 stop\n", b"@01 1 OK IDLE -- 0\r\n"),
        (b"/1 1 get pos\n", b"@01 1 OK IDLE -- -12000\r\n"),
    ]
    stage = ZaberStage(Dialogue(HELLO + more), SimulatedClock(), steps_per_unit=PER_DEG)
    ensure_zero(stage, "here", 0.0)
    stage.begin_move(-3.0, 15.0)
    assert stage.position() == -1.5
    assert stage.on_target()
    with pytest.raises(BenchError, match="move abs 4000000: refused, BADDATA"):
        stage.begin_move(1000.0, 15.0)
    stage.close()


def test_it_is_homed_when_allowed_moved_and_stopped() -> None:
    stage, device, clock, _ = driven()
    homes: HomingStage = stage
    assert homes.name
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
    here = stage.position()
    clock.sleep(1.0)
    assert stage.position() == here
    assert -3.0 < here < 3.0
    with pytest.raises(BenchError, match="rests at"):
        stage.on_target()
    with pytest.raises(BenchError, match=r"set maxspeed \d+: refused, BADDATA"):
        stage.begin_move(0.0, 500.0)


def test_faults_of_the_axis_and_of_the_line_end_in_a_line() -> None:
    stage, device, clock, wire = driven()
    ensure_zero(stage, "here", 1.0)
    assert (stage.position(), device.axis.moves) == (1.0, [])
    stage.begin_move(3.0, 15.0)
    clock.sleep(1.0)
    device.warning = "FS"
    with pytest.raises(BenchError, match="FS: it stalled and stopped"):
        stage.on_target()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match="no answer within 1 s"):
        stage.position()
    other = Dialogue([(b"/1 1 get limit.min\n", b"@02 1 OK IDLE -- 0\r\n")])
    with pytest.raises(BenchError, match=r"'@02 1 OK IDLE -- 0' .*; check the address"):
        ZaberStage(other, clock, steps_per_unit=PER_DEG)


def test_a_rig_opens_it_by_its_table() -> None:
    with Served(ZaberDevice(WallClock())) as served:
        rig = rig_with(driver="zaber", port=served.url, steps_per_unit=PER_DEG, home="here")
        stage = DRIVERS["zaber"].open(rig, WallClock())
        assert isinstance(stage, ZaberStage)
        stage.set_position(0.0)
        stage.begin_move(1.0, 10.0)
        seen = []
        while not stage.on_target():
            seen.append(stage.position())
        stage.close()
    assert seen == sorted(seen)
    assert len(seen) > 3
    with pytest.raises(BenchError, match="steps_per_unit"):
        rig_with(driver="zaber", port="COM4")
    with pytest.raises(BenchError, match="steps_per_unit"):
        rig_with(steps_per_unit=10.0)
