"""The driver of GRBL: by a written conversation, and against a simulated controller, also behind a socket."""

import pytest

from solen.bench.clock import SimulatedClock, WallClock
from solen.bench.drivers import DRIVERS
from solen.bench.grbl import GrblStage
from solen.bench.homing import ensure_zero
from solen.bench.link import open_link
from solen.bench.roles import HomingStage, Stage
from solen.errors import BenchError
from tests.bench.grbl_controller_support import GrblController
from tests.bench.stage_support import Dialogue, wait_for_arrival, rig_with
from tests.bench.wire_support import Served, Wire

IDLE = b"<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"
HELLO = [
    (b"?", b"\xff\r\nGrbl 1.1h ['$' for help]\r\n" + IDLE),
    (b"?", IDLE),
    (b"$I\n", b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"),
    (b"$$\n", b"$10=1\r\n$22=0\r\n$100=250.000\r\n$110=1800.000\r\n$130=200.000\r\nok\r\n"),
]


def driven(*, homing: bool = False) -> tuple[GrblStage, GrblController, SimulatedClock, Wire]:
    clock = SimulatedClock()
    controller = GrblController(clock, homing)
    wire = Wire(controller, clock)
    return GrblStage(wire, clock), controller, clock, wire


def test_what_is_said_is_the_wiki_s() -> None:
    more = [
        (b"?", IDLE),
        (b"$J=G21 G90 G53 X-3.0000 F900.000\n", b"ok\r\n"),
        (b"?", b"<Jog|MPos:-1.234,0.000,0.000|FS:900,0>\r\n"),
        (b"?", b"<Jog|MPos:-2.999,0.000,0.000|FS:20,0>\r\n"),
        (b"?", b"<Idle|MPos:-3.000,0.000,0.000|FS:0,0>\r\n"),
        (b"$J=G21 G90 G53 X3.0000 F900.000\n", b"error:15\r\n"),
        (b"\x85", b""),
        (b"?", b"<Idle|MPos:-3.000,0.000,0.000|FS:0,0>\r\n"),
    ]
    stage = GrblStage(Dialogue(HELLO + more), SimulatedClock())
    ensure_zero(stage, "here", 0.0)
    stage.begin_move(-3.0, 15.0)
    assert stage.position() == -1.234
    assert [stage.on_target(), stage.on_target()] == [False, True]
    with pytest.raises(BenchError, match=r"error:15, .*soft limits"):
        stage.begin_move(3.0, 15.0)
    stage.close()


def test_it_moves_from_where_it_stands_and_stops() -> None:
    stage, controller, clock, _ = driven()
    controller.axis.initial = 12.0
    homes: HomingStage = stage
    assert homes.name
    with pytest.raises(BenchError, match=r"no switch .*home = \"here\""):
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
    here = stage.position()
    clock.sleep(1.0)
    assert stage.position() == here
    assert -3.0 < here < 3.0
    with pytest.raises(BenchError, match=r"31 deg/s .* 30 \(\$110\)"):
        stage.begin_move(0.0, 31.0)


def test_a_run_is_not_resumed_from_wherever_it_stands() -> None:
    stage, controller, _, _ = driven()
    with pytest.raises(BenchError, match=r"lost its zero since the run began; .*recover"):
        ensure_zero(stage, "here", 0.0, resumed=True)
    assert not controller.moved


def test_a_rig_opens_it_by_its_table() -> None:
    with Served(GrblController(WallClock())) as served:
        rig = rig_with(driver="grbl", port=served.url, lever_mm=40.0, home="here", travel=(-2.5, 2.5))
        stage = DRIVERS["grbl"].open(rig, WallClock())
        assert isinstance(stage, GrblStage)
        assert stage.unit == "mm"
        stage.close()


def test_homing_is_waited_for_and_a_stop_on_the_way_is_seen() -> None:
    stage, controller, clock, _ = driven(homing=True)
    assert "by up to 200 deg" in stage.search
    ensure_zero(stage, True, 0.0)
    assert (stage.referenced, stage.position()) == (True, -1.0)
    stage.begin_move(3.0, 15.0)
    clock.sleep(0.1)
    controller.axis.halt(clock.now_s())
    clock.sleep(0.1)
    assert not stage.on_target()  # it may not have begun yet
    clock.sleep(0.1)
    with pytest.raises(BenchError, match=r"rests at .*, but was sent to 3"):
        stage.on_target()
    controller.locked = True
    with pytest.raises(BenchError, match="state Alarm"):
        stage.on_target()


def test_what_is_no_grbl_is_refused() -> None:
    clock = SimulatedClock()
    other = [*HELLO[:2], (b"$I\n", b"[VER:0.9j]\r\nok\r\n")]
    with pytest.raises(BenchError, match=r"'\[VER:0\.9j\]'"):
        GrblStage(Dialogue(other), clock)
    with pytest.raises(BenchError, match=r"\$10=1"):
        GrblStage(Dialogue([(b"?", b"<Idle|WPos:0.000,0.000,0.000>\r\n")] * 200), clock)
    with pytest.raises(BenchError, match=r"hello.* not a state"):
        GrblStage(_Chatty(), _Hasty())
    _, _, clock, wire = driven()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match="no answer within 1 s"):
        GrblStage(wire, clock)


class _Chatty:
    """Something else, that talks all the time."""

    name = "chatty"

    def write(self, data: bytes) -> None:
        """Hears nothing."""

    def read(self, most: int, timeout_s: float) -> bytes:
        return b"hello\r\n" * (most // 7) if timeout_s else b""

    def close(self) -> None:
        """Goes on."""


class _Hasty(SimulatedClock):
    """A clock that passes whenever somebody looks at it."""

    def now_s(self) -> float:
        self.sleep(0.01)
        return super().now_s()


def test_over_a_socket() -> None:
    clock = WallClock()
    with Served(GrblController(clock)) as served:
        stage: Stage = GrblStage(open_link(served.url), clock)
        assert isinstance(stage, GrblStage)
        stage.set_position(0.0)
        stage.begin_move(1.0, 10.0)
        seen = []
        while not stage.on_target():
            seen.append(stage.position())
        assert stage.position() == 1.0
        stage.close()
    assert seen == sorted(seen)
    assert len(seen) > 3
