"""The core of the firmware: identical frames from CPython, MicroPython and C."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from solen.bench.firmware.solen_board import (
    ALIVE,
    CONFIGURE,
    HALT,
    IDENTIFY,
    INVALID,
    MOVE,
    NO_MOTOR,
    PLACE,
    START,
    STOP,
    TIME,
    UNCONFIGURED,
    UNKNOWN,
    WHERE,
)  # fmt: skip
from solen.bench.frames import HEAD, REPLY, SAMPLES, FrameReader, Layout
from tests.bench.firmware_support import (
    Script,
    command,
    micropython,
    python_source,
    run_c,
    run_micropython,
    run_python,
)

LAYOUT = Layout(3, 4)
SCRIPT = Script(
    (
        (1.0, command(START)),
        (2.0, command(IDENTIFY)),
        (3.0, command(CONFIGURE, "<IBB", 5000, 9, 4)),
        (4.0, command(CONFIGURE, "<IBB", 5000, 3, 4)),
        (5.0, b"\xa5\x5a\x01\x12 noise \xa5" + command(START)[:9]),
        (6.0, command(START)),
        (7.7, command(99)),
        (103.3, command(ALIVE)[:6]),
        (104.4, command(ALIVE)[6:] + command(TIME)),
        (200.0, command(PLACE, "<i", -500) + command(MOVE, "<iII", 700, 2_000_000, 20_000)),
        (300.0, command(WHERE)),
        (301.0, command(MOVE, "<iII", 0, 2_000_000, 20_000)),
        (450.0, command(HALT)),
        (600.0, command(WHERE)),
        (700.0, command(MOVE, "<iII", -3, 9_000_000, 20_000)),
        (710.0, command(STOP)),
        (750.0, command(START)),
        (2000.0, command(WHERE)),
    )
)
"""All commands of a host, invalid ones and noise; then the host is silent."""


def check_frames(frames: list[bytes]) -> None:
    """Check the frames that the script must cause."""
    replies = [data[10:-2] for data in frames if data[3] == REPLY]
    assert [(data[0], data[1]) for data in replies] == [
        (START, UNCONFIGURED), (IDENTIFY, 0), (CONFIGURE, INVALID), (CONFIGURE, 0), (START, 0), (99, UNKNOWN),
        (TIME, 0), (PLACE, 0), (MOVE, 0), (WHERE, 0), (MOVE, INVALID), (HALT, 0), (WHERE, 0), (MOVE, INVALID),
        (STOP, 0), (START, 0), (WHERE, 0),
    ]  # fmt: skip
    periods = [data for data in frames if data[3] == SAMPLES]
    restart = next(index for index, data in enumerate(periods) if index and HEAD.unpack_from(data)[4] == 0)
    first = FrameReader(LAYOUT).feed(b"".join(periods[:restart]))
    assert first.number.tolist() == list(range(140))  # every 5 ms from 6 ms to 710 ms
    assert np.array_equal(first.board_us, 5000 * first.number)
    at_us = 6000 + 5000 * first.number[:, None] + np.rint((np.arange(6) + 1) * 5000 // 6)
    expected = (at_us // 7)[:, :, None] + 1000 * np.array([1, 0, 2, 0, 3, 0])[:, None] + 13 * np.arange(4)
    assert np.array_equal(first.counts, (expected % 65536).reshape(first.counts.shape))
    second = FrameReader(LAYOUT).feed(b"".join(periods[restart:]))
    assert len(second) == 160  # the emitters are off 0.8 s after the last command


def motor_states(frames: list[bytes]) -> list[tuple[int, int]]:
    """Return the replies to queries of the motor: its position, and whether it moves."""
    replies = [data[12:-2] for data in frames if data[3] == REPLY and data[10] == WHERE]
    return [(int.from_bytes(data[4:8], "little", signed=True), data[8]) for data in replies]


def check_motor(states: list[tuple[int, int]], expected: list[tuple[int, int]]) -> None:
    """Check motor states to within a step, because C computes in single precision."""
    for (position, moving), (expected_position, expected_moving) in zip(states, expected, strict=True):
        assert abs(position - expected_position) <= 1
        assert moving == expected_moving


def check_equal(frames: list[bytes], expected: list[bytes]) -> None:
    assert [data for data in frames if data[10] != WHERE] == [data for data in expected if data[10] != WHERE]
    check_motor(motor_states(frames), motor_states(expected))


def test_core_under_python() -> None:
    frames = run_python(SCRIPT)
    check_frames(frames)
    # acceleration takes 0.1 s and 100 steps; a halt after 0.15 s, at 2000 steps/s, takes 100 more
    check_motor(motor_states(frames), [(-400, 1), (0, 0), (0, 0)])


def test_core_in_c_sends_same_frames(tmp_path: Path) -> None:
    frames = run_c(SCRIPT, tmp_path)
    if frames is None:
        pytest.skip("there is no C compiler")
    check_equal(frames, run_python(SCRIPT))


def test_move_may_outlast_clock_of_uno(tmp_path: Path) -> None:
    """The clock's 32 bits of µs overflow after 71.6 minutes; 10,000 steps at one per second take 167 minutes."""
    minute_ms = 60_000.0
    long = Script(
        (
            (1.0, command(MOVE, "<iII", 10_000, 1000, 10)),
            *((minutes * minute_ms, command(WHERE)) for minutes in (70.0, 75.0, 150.0, 168.0)),
        )
    )
    frames = run_c(long, tmp_path, idle_us=100_000)
    if frames is None:
        pytest.skip("there is no C compiler")
    positions, moving = zip(*motor_states(frames), strict=True)
    assert positions == pytest.approx((4200, 4500, 9000, 10_000), abs=2)
    assert moving == (1, 1, 1, 0)


def test_makes_up_for_missed_steps_at_maximum_rate(tmp_path: Path) -> None:
    commands = (command(MOVE, "<iII", 1000, 1_000_000, 100_000), b"", None, *[command(WHERE)] * 3)
    script = Script(tuple(zip((1.0, 100.0, 150.0, 150.0, 152.0, 300.0), commands, strict=True)))
    for frames in (run_python(script), run_c(script, tmp_path)):
        if frames is not None:
            at_stall, soon_after, later = (position for position, _ in motor_states(frames))
            assert 9 <= soon_after - at_stall <= 11  # a step every 200 µs, while the loop takes 100 µs
            assert later == pytest.approx(294, abs=1)


@pytest.mark.evidence
def test_core_under_micropython_sends_same_frames(tmp_path: Path) -> None:
    command_line = micropython(tmp_path)
    if isinstance(command_line, str):
        pytest.skip(command_line)
    frames = run_micropython(command_line, python_source(SCRIPT))
    check_equal(frames, run_python(SCRIPT))
    version = subprocess.run(
        command_line, input="import sys; print(sys.version)", capture_output=True, text=True, check=True
    )
    print(f"\n  {len(frames)} equal frames from CPython and {version.stdout.strip()}")
    assert "MicroPython" in version.stdout


def test_board_without_motor_rejects_queries_of_motor() -> None:
    source = python_source(Script(((1.0, command(WHERE)),))).replace("max_steps_per_s = 5000", "max_steps_per_s = 0")
    printed: list[str] = []
    exec(source, {"__name__": "replay", "print": printed.append})  # noqa: S102
    assert bytes.fromhex(printed[0])[10:12] == bytes((WHERE, NO_MOTOR))
