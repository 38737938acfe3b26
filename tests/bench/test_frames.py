"""Frames of the emitter board: intact frames are read, and lost and damaged ones are counted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solen.bench.frames import (
    HEAD,
    REPLY,
    RESTARTED,
    SAMPLES,
    FrameReader,
    Layout,
    Losses,
    Periods,
    checksum,
    frame,
    sample_frames,
)
from solen.errors import BenchError

LAYOUT = Layout(2, 3)
FRAME_BYTES = HEAD.size + LAYOUT.payload_bytes + 2


def periods(n: int, first: int = 0, seed: int = 0, layout: Layout = LAYOUT) -> Periods:
    rng = np.random.default_rng(seed)
    number = np.arange(first, first + n)
    counts = rng.integers(0, 65536, (n, layout.emitters, 2, layout.receivers)).astype(np.uint16)
    return Periods(number, number * 5000, np.zeros(n, np.uint8), counts)


def frames(of: Periods) -> list[bytes]:
    data = sample_frames(LAYOUT, of)
    return [data[at : at + FRAME_BYTES] for at in range(0, len(data), FRAME_BYTES)]


def test_checksum_matches_published_check_value() -> None:
    assert checksum(b"123456789") == 0x29B1


def test_frame_has_documented_bytes() -> None:
    period = Periods(np.array([7]), np.array([35000]), np.array([1], np.uint8), np.full((1, 1, 2, 1), 258, np.uint16))
    sent = sample_frames(Layout(1, 1), period)
    body = bytes.fromhex("01 01 0c00 07000000 b8880000 01 01 01 00 0201 0201")
    assert sent == b"\xa5\x5a" + body + checksum(body).to_bytes(2, "little")


@settings(max_examples=60, deadline=None)
@given(sizes=st.lists(st.integers(1, 200), min_size=1, max_size=30), n=st.integers(1, 20))
def test_reads_frames_in_parts_of_any_length(sizes: list[int], n: int) -> None:
    sent, reader = periods(n), FrameReader(LAYOUT)
    data, parts, at = sample_frames(LAYOUT, sent), [], 0
    while at < len(data):
        for size in sizes:
            parts.append(reader.feed(data[at : at + size]))
            at += size
    received = Periods.joined(parts, LAYOUT)
    assert np.array_equal(received.counts, sent.counts)
    assert received.number.tolist() == sent.number.tolist()
    assert reader.losses == Losses()


@settings(max_examples=60, deadline=None)
@given(
    lost=st.sets(st.integers(1, 28)),
    garbage=st.dictionaries(st.integers(0, 29), st.binary(min_size=1, max_size=300), max_size=5),
)
def test_counts_lost_frames_and_garbage(lost: set[int], garbage: dict[int, bytes]) -> None:
    sent = periods(30, seed=4)
    stream = b"".join(
        garbage.get(number, b"") + (b"" if number in lost else data) for number, data in enumerate(frames(sent))
    )
    reader = FrameReader(LAYOUT)
    # garbage may look like the head of a frame; zeros, more than the longest frame, complete it
    received = Periods.joined([reader.feed(stream), reader.feed(bytes(5000))], LAYOUT)
    kept = [number for number in range(30) if number not in lost]
    assert received.number.tolist() == kept
    assert np.array_equal(received.counts, sent.counts[kept])
    assert reader.losses.dropped == len(lost)
    garbage_bytes = sum(map(len, garbage.values())) + 5000
    assert garbage_bytes - 1 <= reader.losses.skipped_bytes <= garbage_bytes  # the last byte may begin a frame


@pytest.mark.parametrize("bit", range(0, 8 * FRAME_BYTES, 7))
def test_damaged_bit_loses_one_frame(bit: int) -> None:
    sent = periods(5, seed=2)
    data = bytearray(b"".join(frames(sent)))
    at = 2 * FRAME_BYTES + bit // 8
    data[at] ^= 1 << bit % 8
    reader = FrameReader(LAYOUT)
    received = Periods.joined([reader.feed(bytes(data)), reader.feed(bytes(70_000))], LAYOUT)
    assert received.number.tolist() == [0, 1, 3, 4]
    assert reader.losses.dropped == 1


def test_reads_repeated_period_once() -> None:
    first, second, third, fourth = frames(periods(4))
    reader = FrameReader(LAYOUT)
    received = reader.feed(first + second + second + first + third + fourth)
    assert received.number.tolist() == [0, 1, 2, 3]
    assert reader.losses == Losses(doubled=2)


def test_repeated_frames_are_not_a_restart() -> None:
    reader = FrameReader(LAYOUT)
    received = reader.feed(b"".join(2 * data for data in frames(periods(10))))
    assert received.number.tolist() == list(range(10))
    assert reader.losses == Losses(doubled=10)


def test_detects_restart_of_board() -> None:
    reader = FrameReader(LAYOUT)
    reader.feed(b"".join(frames(periods(50, first=100))))
    after = reader.feed(b"".join(frames(periods(10))))
    assert reader.losses == Losses(doubled=2, restarts=1)
    assert after.number.tolist() == list(range(150, 158))
    assert after.flags.tolist() == [RESTARTED] + [0] * 7
    assert after.board_us.tolist() == periods(10).board_us[2:].tolist()  # its clock restarted too


def test_number_and_time_continue_after_overflow() -> None:
    number = np.arange(2**32 - 3, 2**32 + 3)
    sent = Periods(number, number * 5000, np.zeros(6, np.uint8), periods(6).counts)
    received = FrameReader(LAYOUT).feed(sample_frames(LAYOUT, sent))
    assert received.number.tolist() == number.tolist()
    assert np.diff(received.board_us).tolist() == [5000] * 5


def test_separates_replies_and_other_frames_from_samples() -> None:
    reader = FrameReader(LAYOUT)
    other = sample_frames(Layout(1, 3), periods(1, layout=Layout(1, 3)))
    version = bytearray(frames(periods(1))[0])
    version[2] = 9
    version[-2:] = checksum(bytes(version[2:-2])).to_bytes(2, "little")
    received = reader.feed(
        frame(REPLY, 0, b"ok") + other + bytes(version) + frame(SAMPLES, 0, b"") + frames(periods(1))[0]
    )
    assert reader.replies == [b"ok"]
    assert reader.losses == Losses(other=3)
    assert len(received) == 1


def test_refuses_layout_that_exceeds_frame() -> None:
    with pytest.raises(BenchError, match=r"^emitters = 16; .*65 .*4168 .*4096"):
        Layout(16, 65)
    with pytest.raises(BenchError, match=r"^receivers = 0; must be 1 to 255$"):
        Layout(1, 0)
    assert HEAD.size == 10
