"""The shipped firmware on a serial line: a simulated Pico and Uno, from their source files to the analysed sensor."""

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
name = "one board"
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


def check_run(bench: Path, kind: str, line: list[str], log: Path, cycles: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Record the paper's rotation on a board with a motor, and analyse it; then the host goes silent."""
    from tests.bench.pty_support import SlowClock, on_pty

    monkeypatch.setattr("solen.bench.record.WallClock", SlowClock)
    bits, range_v, baud = BOARD_VALUES[kind]
    text = (bench / "protocol.toml").read_text(encoding="utf-8").replace("cycles = 3", f"cycles = {cycles}")
    (bench / "protocol.toml").write_text(text, encoding="utf-8")
    with on_pty(line, log.parent, log) as port:
        rig = RIG.format(port=port, bits=bits, range_v=range_v, baud=baud)
        (bench / "wired.toml").write_text(rig, encoding="utf-8")
        run = record(bench / "protocol.toml", bench / "wired.toml", bench / "out")
        assert (run.outcome, run.cycles) == ("done", cycles)
        assert run.losses["garbled"] + run.losses["doubled"] + run.losses["other"] == 0
        assert run.losses["dropped"] < 0.2 * run.periods  # a busy computer cannot always keep up with the board
        sensor = study([run.path]).to_dict()["sensors"]["A"]
        for side, sign in (("right", 1.0), ("left", -1.0)):
            curve = sensor["receivers"][side]
            swing = -2.4 if kind == "pico" else -4.0
            expected = swing / (1.0 + np.exp(1.2 * sign * np.array(curve["angle_deg"])))
            error_V, hysteresis = np.nanstd(np.array(curve["mean_V"], float) - expected), curve["hysteresis_percent"]
            print(f"  {kind} {side}: error of the mean curve {1e3 * error_V:.1f} mV; hysteresis {hysteresis:.2f} % FS")
            assert error_V < 0.03
            assert hysteresis < 3.0
        check_dark(port, baud, log)


def check_dark(port: str, baud: int, log: Path) -> None:
    """Check that a board switches its emitters off when its host goes silent after the start."""
    from tests.bench.pty_support import SLOW, SlowClock, switching

    layout = Layout(1, 2)
    board = SerialBoard(open_link(port, baud=baud), SlowClock(), layout, period_s=0.02, volts_per_count=1.0)
    before = len(switching(log))
    board.start()
    time.sleep(1.1 * SLOW)
    switches = switching(log)[before:]
    number = board.read().number
    board.close()
    assert (switches[0][2], switches[-1][2]) == (1, 0)
    last_on = max(index for index, (_, _, level) in enumerate(switches) if level)
    dark_s = 1e-6 * (switches[last_on + 1][0] - switches[0][0])
    print(f"  dark {dark_s:.3f} s after the start")
    assert 0.5 < dark_s < 1.0
    assert len(number) > 10
    assert number[-1] < 50
    assert board.losses.garbled + board.losses.doubled + board.losses.other == 0


def test_pico_samples_and_goes_dark_without_host(tmp_path: Path) -> None:
    from tests.bench.pty_support import on_pty, pico

    log = tmp_path / "log"
    with on_pty(pico(tmp_path), tmp_path, log) as port:
        check_dark(port, 115_200, log)


def test_servo_on_separate_board_is_stage(tmp_path: Path) -> None:
    from tests.bench.pty_support import SlowClock, on_pty, pico

    log, clock = tmp_path / "log", SlowClock()
    with on_pty(pico(tmp_path, servo=True), tmp_path, log) as port:
        daq = {"driver": "nidaqmx", "device": "Dev1"}
        stage = {"driver": "board", "port": port, "baud": 115_200, "steps_per_unit": 11.1, "home": "here"}
        rig = Rig(name="servo with a DAQ device", stage=stage, daq=daq, sensor=(SENSOR,))
        servo = DRIVERS["board"].open(rig, clock)
        assert isinstance(servo, BoardStage)
        servo.set_position(0.0)
        assert not log.read_text(encoding="utf-8")  # no pulses before the first move
        for target, pulse_us in ((0.9, 1510), (-0.9, 1490)):
            servo.begin_move(target, 60.0)
            while not servo.on_target():
                assert abs(servo.position()) < 1.0
                clock.sleep(0.02)
            assert servo.position() == pytest.approx(target, abs=0.5 / 11.1)
            pulses = [int(line.split()[2]) for line in log.read_text(encoding="utf-8").splitlines()]
            assert pulses[-1] == 1000 * pulse_us
        assert set(np.diff(pulses).tolist()) == {1000, -1000}  # in steps of 1 µs
        servo.close()


def test_port_of_motor_board_is_specified_once() -> None:
    motor = {"driver": "board", "steps_per_unit": 11.1}
    assert rig_with(**motor).stage.port is None  # it is on the sampling board, at COM3
    with pytest.raises(BenchError, match=r"stage\.port = 'COM3'; is also the port of \[board\]"):
        rig_with(**motor, port="COM3")
    with pytest.raises(BenchError, match="baud = 9600; is not used without a port"):
        rig_with(**motor, baud=9600)
    with pytest.raises(BenchError, match=r"driver = 'board'; requires a board; set port, or \[board\]"):
        Rig(name="x", stage=motor, daq={"driver": "nidaqmx", "device": "Dev1"}, sensor=(SENSOR,))


@pytest.mark.evidence
def test_pico_turns_and_reads_sensor(bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.bench.pty_support import pico

    check_run(bench, "pico", pico(tmp_path), tmp_path / "log", 2, monkeypatch)


@pytest.mark.evidence
def test_uno_turns_and_reads_sensor(bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.bench.pty_support import uno

    line = uno(tmp_path, tmp_path / "log")
    if isinstance(line, str):
        pytest.skip(line)
    check_run(bench, "uno", line, tmp_path / "log", 2, monkeypatch)


@pytest.mark.parametrize(
    ("count", "interpreter"),
    [
        (20_000, "CPython"),
        pytest.param(1_000_000, "CPython", marks=pytest.mark.evidence),
        pytest.param(1_000_000, "MicroPython", marks=pytest.mark.evidence),
    ],
)
def test_reads_frames_from_faulty_line(tmp_path: Path, count: int, interpreter: str) -> None:
    from tests.bench.pty_support import on_pty, stream

    received, wrong, last = 0, 0, -1
    line = stream(tmp_path, count, by_micropython=interpreter == "MicroPython")
    if isinstance(line, str):
        pytest.skip(line)
    with on_pty(line, tmp_path, tmp_path / "log") as port:
        link, reader = open_link(port), FrameReader(Layout(1, 2))
        while data := link.read(1 << 16, 20.0):
            periods = reader.feed(data)
            expected = (periods.number[:, None] * np.array([7, 11, 13, 17]) + np.arange(4)) % 65536
            wrong += int((periods.counts.reshape(-1, 4) != expected).any(axis=1).sum())
            wrong += int((periods.board_us != 5000 * periods.number).sum())
            received, last = received + len(periods), int(periods.number[-1]) if len(periods) else last
            if last == count - 1:
                break
        link.close()
    lost = int((tmp_path / "lost").read_text(encoding="utf-8"))
    print(f"\n  {count} frames sent by {interpreter}: {received} received, {wrong} wrong; {lost} lost, {reader.losses}")
    assert wrong == 0
    assert lost > count // 500
    assert (reader.losses.dropped, received) == (lost, count - lost)
    assert reader.losses.doubled > 0
