"""The firmware: one core in two languages and three interpreters, byte for byte, and what is written for each board."""

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
from tests.bench.firmware_support import Script, run_c, by_micropython, run_python, command, micropython, python_source

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
"""Everything that a host says, and some that none does; then silence."""


def check(frames: list[bytes]) -> None:
    """What must come of `SCRIPT`."""
    replies = [data[10:-2] for data in frames if data[3] == REPLY]
    kinds = [(data[0], data[1]) for data in replies]
    assert kinds == [
        (START, UNCONFIGURED), (IDENTIFY, 0), (CONFIGURE, INVALID), (CONFIGURE, 0), (START, 0), (99, UNKNOWN), (TIME, 0),
        (PLACE, 0), (MOVE, 0), (WHERE, 0), (MOVE, INVALID), (HALT, 0), (WHERE, 0), (MOVE, INVALID), (STOP, 0), (START, 0),
        (WHERE, 0),
    ]  # fmt: skip
    periods = [data for data in frames if data[3] == SAMPLES]
    begun = next(number for number, data in enumerate(periods) if number and HEAD.unpack_from(data)[4] == 0)
    reader = FrameReader(LAYOUT)
    first = reader.feed(b"".join(periods[:begun]))
    assert first.number.tolist() == list(range(140))  # of 5 ms from 6 ms to 710 ms
    assert np.array_equal(first.board_us, 5000 * first.number)
    at_us = 6000 + 5000 * first.number[:, None] + np.rint((np.arange(6) + 1) * 5000 // 6)
    expected = (at_us // 7)[:, :, None] + 1000 * np.array([1, 0, 2, 0, 3, 0])[:, None] + 13 * np.arange(4)
    assert np.array_equal(first.counts, (expected % 65536).reshape(first.counts.shape))
    second = FrameReader(LAYOUT).feed(b"".join(periods[begun:]))
    assert len(second) == 160  # 0.8 s after the host's last word it is dark


def where(frames: list[bytes]) -> list[tuple[int, int]]:
    """Positions and whether it moved, as they were asked for."""
    found = [data[12:-2] for data in frames if data[3] == REPLY and data[10] == WHERE]
    return [(int.from_bytes(one[4:8], "little", signed=True), one[8]) for one in found]


def check_motor(frames: list[bytes]) -> None:
    """Speeding up takes 0.1 s and 100 steps; halted after 0.15 s at 2000 steps/s, it needs 100 steps more."""
    for (at, moving), (meant, meant_moving) in zip(where(frames), ((-400, 1), (0, 0), (0, 0)), strict=True):
        assert abs(at - meant) <= 1
        assert moving == meant_moving


def alike(ours: list[bytes], theirs: list[bytes]) -> None:
    """The same frames, but for a step of the motor where one rounds in single precision."""
    assert [data for data in ours if data[10] != WHERE] == [data for data in theirs if data[10] != WHERE]
    for (at, moving), (their_at, their_moving) in zip(where(ours), where(theirs), strict=True):
        assert abs(at - their_at) <= 1
        assert moving == their_moving


def test_the_core_under_python() -> None:
    frames = run_python(SCRIPT)
    check(frames)
    check_motor(frames)


def test_the_core_in_c_says_the_same(tmp_path: Path) -> None:
    frames = run_c(SCRIPT, tmp_path)
    if frames is None:
        pytest.skip("there is no C compiler")
    alike(run_python(SCRIPT), frames)


def test_a_move_may_take_longer_than_the_clock_of_a_uno_counts(tmp_path: Path) -> None:
    """Its 32 bits of µs wrap after 71.6 minutes; 10,000 steps at one per second take 167 minutes."""
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
    places = where(frames)
    assert [at for at, _ in places] == pytest.approx([4200, 4500, 9000, 10_000], abs=2)
    assert [moving for _, moving in places] == [1, 1, 1, 0]


def test_steps_that_a_stall_missed_are_made_up_no_faster_than_the_motor_takes(tmp_path: Path) -> None:
    asked = (command(MOVE, "<iII", 1000, 1_000_000, 100_000), b"", None, *[command(WHERE)] * 3)
    script = Script(tuple(zip((1.0, 100.0, 150.0, 150.0, 152.0, 300.0), asked, strict=True)))
    for frames in (run_python(script), run_c(script, tmp_path)):
        if frames is not None:
            before, soon, late = (at for at, _ in where(frames))
            assert 9 <= soon - before <= 11  # a step per 200 µs, where the loop takes 100
            assert late == pytest.approx(294, abs=1)


@pytest.mark.evidence
def test_the_core_under_micropython_says_the_same(tmp_path: Path) -> None:
    command_line = micropython(tmp_path)
    if isinstance(command_line, str):
        pytest.skip(command_line)
    frames = by_micropython(command_line, python_source(SCRIPT))
    alike(run_python(SCRIPT), frames)
    version = subprocess.run(
        command_line, input="import sys; print(sys.version)", capture_output=True, text=True, check=True
    )
    print(f"\n  {len(frames)} frames alike under CPython and {version.stdout.strip()}")
    assert "MicroPython" in version.stdout


def test_a_board_without_a_motor_says_so() -> None:
    source = python_source(Script(((1.0, command(WHERE)),))).replace("max_steps_per_s = 5000", "max_steps_per_s = 0")
    shown: list[str] = []
    exec(source, {"__name__": "replay", "print": shown.append})  # noqa: S102
    assert bytes.fromhex(shown[0])[10:12] == bytes((WHERE, NO_MOTOR))
