"""The driver of GRBL, with a scripted dialogue and with a simulated controller, also over a socket."""

import pytest

from solen.bench.clock import SimulatedClock, WallClock
from solen.bench.drivers import DRIVERS
from solen.bench.grbl import GrblStage
from solen.bench.homing import ensure_zero
from solen.bench.link import open_link
from solen.bench.roles import HomingStage, Stage
from solen.errors import BenchError
from tests.bench.grbl_controller_support import GrblController
from tests.bench.stage_support import Dialogue, rig_with, wait_for_arrival
from tests.bench.wire_support import Served, Wire

IDLE = b"<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"
HELLO = [
    (b"?", b"\xff\r\nGrbl 1.1h ['$' for help]\r\n" + IDLE),
    (b"?", IDLE),
    (b"$I\n", b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"),
    (b"$$\n", b"$10=1\r\n$22=0\r\n$100=250.000\r\n$110=1800.000\r\n$130=200.000\r\nok\r\n"),
]


def wired_stage(*, homing: bool = False) -> tuple[GrblStage, GrblController, SimulatedClock, Wire]:
    clock = SimulatedClock()
    controller = GrblController(clock, homing)
    wire = Wire(controller, clock)
    return GrblStage(wire, clock), controller, clock, wire


def test_dialogue_follows_wiki() -> None:
    exchanges = [
        (b"?", IDLE),
        (b"$J=G21 G90 G53 X-3.0000 F900.000\n", b"ok\r\n"),
        (b"?", b"<Jog|MPos:-1.234,0.000,0.000|FS:900,0>\r\n"),
        (b"?", b"<Jog|MPos:-2.999,0.000,0.000|FS:20,0>\r\n"),
        (b"?", b"<Idle|MPos:-3.000,0.000,0.000|FS:0,0>\r\n"),
        (b"$J=G21 G90 G53 X3.0000 F900.000\n", b"error:15\r\n"),
        (b"\x85", b""),
        (b"?", b"<Idle|MPos:-3.000,0.000,0.000|FS:0,0>\r\n"),
    ]
    stage = GrblStage(Dialogue(HELLO + exchanges), SimulatedClock())
    ensure_zero(stage, "here", 0.0)
    stage.begin_move(-3.0, 15.0)
    assert stage.position() == -1.234
    assert [stage.on_target(), stage.on_target()] == [False, True]
    with pytest.raises(BenchError, match=r"error:15, .*soft limits"):
        stage.begin_move(3.0, 15.0)
    stage.close()


def test_moves_from_current_position_and_stops() -> None:
    stage, controller, clock, _ = wired_stage()
    controller.axis.initial = 12.0
    homing_stage: HomingStage = stage
    assert homing_stage.name
    with pytest.raises(BenchError, match=r"no reference switch .*home = \"here\""):
        ensure_zero(stage, False, 0.0)
    with pytest.raises(BenchError, match="error:5, homing is not enabled"):
        stage.reference()
    ensure_zero(stage, "here", 0.5)
    assert (stage.position(), controller.moved) == (0.5, [])
    stage.begin_move(3.5, 15.0)
    assert wait_for_arrival(stage, clock) == pytest.approx(3.0 / 15.0 + 15.0 / 100.0, abs=0.02)
    assert (stage.position(), controller.axis.at(clock.now_s())) == (3.5, 15.0)
    stage.begin_move(-3.0, 15.0)
    clock.sleep(0.2)
    stage.stop()
    position = stage.position()
    clock.sleep(1.0)
    assert stage.position() == position
    assert -3.0 < position < 3.0
    with pytest.raises(BenchError, match=r"velocity 31 is above its maximum, 30 deg/s \(\$110\)"):
        stage.begin_move(0.0, 31.0)


def test_resumed_run_does_not_redefine_zero() -> None:
    stage, controller, _, _ = wired_stage()
    with pytest.raises(BenchError, match=r"lost its zero since the run began; .*recover"):
        ensure_zero(stage, "here", 0.0, resumed=True)
    assert not controller.moved


def test_rig_opens_stage() -> None:
    with Served(GrblController(WallClock())) as served:
        rig = rig_with(driver="grbl", port=served.url, lever_mm=40.0, home="here", travel=(-2.5, 2.5))
        stage = DRIVERS["grbl"].open(rig, WallClock())
        assert isinstance(stage, GrblStage)
        assert stage.unit == "mm"
        stage.close()


def test_homes_and_detects_early_stop() -> None:
    stage, controller, clock, _ = wired_stage(homing=True)
    assert "by up to 200 deg" in stage.search
    ensure_zero(stage, True, 0.0)
    assert (stage.referenced, stage.position()) == (True, -1.0)
    stage.begin_move(3.0, 15.0)
    clock.sleep(0.1)
    controller.axis.halt(clock.now_s())
    clock.sleep(0.1)
    assert not stage.on_target()  # the move may not have begun yet
    clock.sleep(0.1)
    with pytest.raises(BenchError, match=r"stopped at .* instead of 3"):
        stage.on_target()
    controller.locked = True
    with pytest.raises(BenchError, match="state Alarm"):
        stage.on_target()


def test_refuses_other_instruments() -> None:
    clock = SimulatedClock()
    other = [*HELLO[:2], (b"$I\n", b"[VER:0.9j]\r\nok\r\n")]
    with pytest.raises(BenchError, match=r"'\[VER:0\.9j\]'"):
        GrblStage(Dialogue(other), clock)
    with pytest.raises(BenchError, match=r"\$10=1"):
        GrblStage(Dialogue([(b"?", b"<Idle|WPos:0.000,0.000,0.000>\r\n")] * 200), clock)
    with pytest.raises(BenchError, match=r"hello.* not a state"):
        GrblStage(_ChattyLink(), _AdvancingClock())
    _, _, clock, wire = wired_stage()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match="no reply within 1 s"):
        GrblStage(wire, clock)


class _ChattyLink:
    """A link to another instrument, which sends lines all the time."""

    name = "chatty"

    def write(self, data: bytes) -> None:
        """Do nothing: the instrument ignores its input."""

    def read(self, most: int, timeout_s: float) -> bytes:
        return b"hello\r\n" * (most // 7) if timeout_s else b""

    def close(self) -> None:
        """Do nothing: no port is open."""


class _AdvancingClock(SimulatedClock):
    """A clock that advances whenever it is read."""

    def now_s(self) -> float:
        self.sleep(0.01)
        return super().now_s()


def test_drives_stage_over_socket() -> None:
    clock = WallClock()
    with Served(GrblController(clock)) as served:
        stage: Stage = GrblStage(open_link(served.url), clock)
        assert isinstance(stage, GrblStage)
        stage.set_position(0.0)
        stage.begin_move(1.0, 10.0)
        positions = []
        while not stage.on_target():
            positions.append(stage.position())
        assert stage.position() == 1.0
        stage.close()
    assert positions == sorted(positions)
    assert len(positions) > 3
