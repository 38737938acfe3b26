"""The firmware as it is shipped, behind a serial line: a Pico and an Uno from their files to a figure."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest

from solen.analysis import study
from solen.bench.board import BoardStage, SerialBoard
from solen.bench.drivers import DRIVERS
from solen.bench.firmware.boards import BOARD_VALUES
from solen.bench.frames import FrameReader, Layout
from solen.bench.link import open_link
from solen.bench.record import record
from solen.bench.rig import Rig
from solen.errors import BenchError
from tests.bench.stage_support import SENSOR, rig_with

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")

RIG = """
schema = 1
name = "ten euros"
[stage]
driver = "board"
steps_per_unit = 100.0
home = "here"
travel = [-5.0, 5.0]
[board]
driver = "serial"
port = "{port}"
bits = {bits}
range_v = {range_v}
baud = {baud}
[[sensor]]
name = "A"
design = "sensor.toml"
emitter = 1
right = 1
left = 2
"""


def to_the_figure(
    bench: Path, kind: str, line: list[str], log: Path, cycles: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The paper's turn on a board with a motor; then its host falls silent."""
    from tests.bench.pty_support import SlowClock, on_pty

    monkeypatch.setattr("solen.bench.record.WallClock", SlowClock)
    bits, range_v, baud = BOARD_VALUES[kind]
    text = (bench / "protocol.toml").read_text(encoding="utf-8").replace("cycles = 3", f"cycles = {cycles}")
    (bench / "protocol.toml").write_text(text, encoding="utf-8")
    with on_pty(line, log.parent, log) as port:
        rig = RIG.format(port=port, bits=bits, range_v=range_v, baud=baud)
        (bench / "wired.toml").write_text(rig, encoding="utf-8")
        found = record(bench / "protocol.toml", bench / "wired.toml", bench / "out")
        assert (found.outcome, found.cycles) == ("done", cycles)
        assert found.losses["garbled"] + found.losses["doubled"] + found.losses["other"] == 0
        assert found.losses["dropped"] < 0.2 * found.periods  # what a busy computer could not play a board in time
        sensor = study([found.path]).to_dict()["sensors"]["A"]
        for side, sign in (("right", 1.0), ("left", -1.0)):
            told = sensor["receivers"][side]
            swing = -2.4 if kind == "pico" else -4.0
            meant = swing / (1.0 + np.exp(1.2 * sign * np.array(told["angle_deg"])))
            apart = np.array(told["mean_V"], float) - meant
            off_mV, hysteresis = 1e3 * np.nanstd(apart), told["hysteresis_percent"]
            print(f"  {kind} {side}: {off_mV:.1f} mV from the circuit's own; hysteresis {hysteresis:.2f} % FS")
            assert np.nanstd(apart) < 0.03
            assert told["hysteresis_percent"] < 3.0
        goes_dark(port, baud, log)


def goes_dark(port: str, baud: int, log: Path) -> None:
    """A host that says start and nothing more."""
    from tests.bench.pty_support import SLOW, SlowClock, switched

    layout = Layout(1, 2)
    board = SerialBoard(open_link(port, baud=baud), SlowClock(), layout, period_s=0.02, volts_per_count=1.0)
    before = len(switched(log))
    board.start()
    time.sleep(1.1 * SLOW)
    told = switched(log)[before:]
    number = board.read().number
    board.close()
    assert (told[0][2], told[-1][2]) == (1, 0)
    last_on = max(place for place, one in enumerate(told) if one[2])
    dark_s = 1e-6 * (told[last_on + 1][0] - told[0][0])
    print(f"  dark {dark_s:.3f} s after the host's last word")
    assert 0.5 < dark_s < 1.0
    assert len(number) > 10
    assert number[-1] < 50
    assert board.losses.garbled + board.losses.doubled + board.losses.other == 0


def test_a_pico_samples_and_goes_dark_by_itself(tmp_path: Path) -> None:
    from tests.bench.pty_support import on_pty, pico

    log = tmp_path / "log"
    with on_pty(pico(tmp_path), tmp_path, log) as port:
        goes_dark(port, 115_200, log)


def test_a_servo_on_a_board_of_its_own_is_a_stage(tmp_path: Path) -> None:
    from tests.bench.pty_support import SlowClock, on_pty, pico

    log, clock = tmp_path / "log", SlowClock()
    with on_pty(pico(tmp_path, servo=True), tmp_path, log) as port:
        daq = {"driver": "nidaqmx", "device": "Dev1"}
        stage = {"driver": "board", "port": port, "baud": 115_200, "steps_per_unit": 11.1, "home": "here"}
        rig = Rig(name="servo beside a data acquisition", stage=stage, daq=daq, sensor=(SENSOR,))
        servo = DRIVERS["board"].open(rig, clock)
        assert isinstance(servo, BoardStage)
        servo.set_position(0.0)
        assert not log.read_text(encoding="utf-8")  # free, until it is sent somewhere
        for target, pulse_us in ((3.0, 1533), (-3.0, 1467)):
            servo.begin_move(target, 60.0)
            while not servo.on_target():
                assert abs(servo.position()) < 3.1
            assert servo.position() == pytest.approx(target, abs=0.5 / 11.1)
            pulses = [int(line.split()[2]) for line in log.read_text(encoding="utf-8").splitlines()]
            assert pulses[-1] == 1000 * pulse_us
        assert set(np.diff(pulses).tolist()) == {1000, -1000}  # microsecond by microsecond
        servo.close()


def test_a_motor_s_board_is_stated_once() -> None:
    motor = {"driver": "board", "steps_per_unit": 11.1}
    assert rig_with(**motor).stage.port is None  # that of the board that samples, COM3
    with pytest.raises(BenchError, match=r"stage\.port = 'COM3'; is also the port of \[board\]"):
        rig_with(**motor, port="COM3")
    with pytest.raises(BenchError, match="baud = 9600; is not used without a port"):
        rig_with(**motor, baud=9600)
    with pytest.raises(BenchError, match="needs a port, or"):
        Rig(name="x", stage=motor, daq={"driver": "nidaqmx", "device": "Dev1"}, sensor=(SENSOR,))


@pytest.mark.evidence
def test_a_pico_turns_and_reads_the_sensor(bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.bench.pty_support import pico

    to_the_figure(bench, "pico", pico(tmp_path), tmp_path / "log", 2, monkeypatch)


@pytest.mark.evidence
def test_an_uno_turns_and_reads_the_sensor(bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.bench.pty_support import uno

    line = uno(tmp_path, tmp_path / "log")
    if isinstance(line, str):
        pytest.skip(line)
    to_the_figure(bench, "uno", line, tmp_path / "log", 2, monkeypatch)


MANY = 1_000_000


@pytest.mark.parametrize(
    ("count", "by"),
    [
        (20_000, "CPython"),
        pytest.param(MANY, "CPython", marks=pytest.mark.evidence),
        pytest.param(MANY, "MicroPython", marks=pytest.mark.evidence),
    ],
)
def test_frames_of_the_core_through_a_faulty_line(tmp_path: Path, count: int, by: str) -> None:
    from tests.bench.pty_support import on_pty, stream

    taken, wrong, last = 0, 0, -1
    line = stream(tmp_path, count, by_micropython=by == "MicroPython")
    if isinstance(line, str):
        pytest.skip(line)
    with on_pty(line, tmp_path, tmp_path / "log") as port:
        link, reader = open_link(port), FrameReader(Layout(1, 2))
        while data := link.read(1 << 16, 20.0):
            found = reader.feed(data)
            meant = (found.number[:, None] * np.array([7, 11, 13, 17]) + np.arange(4)) % 65536
            wrong += int((found.counts.reshape(-1, 4) != meant).any(axis=1).sum())
            wrong += int((found.board_us != 5000 * found.number).sum())
            taken, last = taken + len(found), int(found.number[-1]) if len(found) else last
            if last == count - 1:
                break
        link.close()
    lost = int((tmp_path / "lost").read_text(encoding="utf-8"))
    told = f"{taken} read, {wrong} wrong; {lost} damaged on the way, {reader.losses}"
    print(f"\n  {count} frames of the core under {by}: {told}")
    assert wrong == 0
    assert lost > count // 500
    assert (reader.losses.dropped, taken) == (lost, count - lost)
    assert reader.losses.doubled > 0
