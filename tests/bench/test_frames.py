"""Frames of the emitter board: what was sent is read, what was lost is counted, nothing is invented."""

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


def test_the_checksum_is_the_published_one() -> None:
    assert checksum(b"123456789") == 0x29B1


def test_a_frame_is_the_bytes_of_the_table() -> None:
    of = Periods(np.array([7]), np.array([35000]), np.array([1], np.uint8), np.full((1, 1, 2, 1), 258, np.uint16))
    sent = sample_frames(Layout(1, 1), of)
    body = bytes.fromhex("01 01 0c00 07000000 b8880000 01 01 01 00 0201 0201")
    assert sent == b"\xa5\x5a" + body + checksum(body).to_bytes(2, "little")


@settings(max_examples=60, deadline=None)
@given(cuts=st.lists(st.integers(1, 200), min_size=1, max_size=30), n=st.integers(1, 20))
def test_what_was_sent_is_read_in_pieces_of_any_length(cuts: list[int], n: int) -> None:
    sent, reader = periods(n), FrameReader(LAYOUT)
    data, got, at = sample_frames(LAYOUT, sent), [], 0
    while at < len(data):
        for cut in cuts:
            got.append(reader.feed(data[at : at + cut]))
            at += cut
    assert np.array_equal(np.concatenate([one.counts for one in got]), sent.counts)
    assert np.concatenate([one.number for one in got]).tolist() == sent.number.tolist()
    assert reader.losses == Losses()


@settings(max_examples=60, deadline=None)
@given(
    lost=st.sets(st.integers(1, 28)),
    garbage=st.dictionaries(st.integers(0, 29), st.binary(min_size=1, max_size=300), max_size=5),
)
def test_lost_frames_and_garbage_are_counted_and_the_rest_is_whole(lost: set[int], garbage: dict[int, bytes]) -> None:
    sent = periods(30, seed=4)
    stream = b"".join(
        garbage.get(number, b"") + (b"" if number in lost else one) for number, one in enumerate(frames(sent))
    )
    reader = FrameReader(LAYOUT)
    # what garbage may have opened is closed by more than the longest frame of nothing
    got = [reader.feed(stream), reader.feed(bytes(5000))]
    kept = [number for number in range(30) if number not in lost]
    assert np.concatenate([one.number for one in got]).tolist() == kept
    assert np.array_equal(np.concatenate([one.counts for one in got]), sent.counts[kept])
    assert reader.losses.dropped == len(lost)
    known = sum(map(len, garbage.values())) + 5000
    # two bytes are skipped for every beginning that is none; the last may wait for its other half
    assert known - 1 <= reader.losses.skipped_bytes <= known


@pytest.mark.parametrize("bit", range(0, 8 * FRAME_BYTES, 7))
def test_a_changed_bit_loses_its_frame_and_no_other(bit: int) -> None:
    sent = periods(5, seed=2)
    data = bytearray(b"".join(frames(sent)))
    at = 2 * FRAME_BYTES + bit // 8
    data[at] ^= 1 << bit % 8
    reader = FrameReader(LAYOUT)
    got = [reader.feed(bytes(data)), reader.feed(bytes(70_000))]
    assert np.concatenate([one.number for one in got]).tolist() == [0, 1, 3, 4]
    assert reader.losses.dropped == 1


def test_a_period_that_comes_twice_is_taken_once() -> None:
    one = frames(periods(4))
    reader = FrameReader(LAYOUT)
    assert reader.feed(b"".join([one[0], one[1], one[1], one[0], one[2], one[3]])).number.tolist() == [0, 1, 2, 3]
    assert reader.losses == Losses(doubled=2)


def test_frames_that_each_come_twice_are_no_restart() -> None:
    reader = FrameReader(LAYOUT)
    found = reader.feed(b"".join(one + one for one in frames(periods(10))))
    assert found.number.tolist() == list(range(10))
    assert reader.losses == Losses(doubled=10)


def test_a_board_that_restarts_is_noticed() -> None:
    reader = FrameReader(LAYOUT)
    reader.feed(b"".join(frames(periods(50, first=100))))
    after = reader.feed(b"".join(frames(periods(10))))
    assert reader.losses == Losses(doubled=2, restarts=1)
    assert after.number.tolist() == list(range(150, 158))
    assert after.flags.tolist() == [RESTARTED] + [0] * 7
    assert after.board_us.tolist() == periods(10).board_us[2:].tolist()  # its clock began anew as well


def test_numbers_and_time_go_on_where_they_wrap() -> None:
    number = np.arange(2**32 - 3, 2**32 + 3)
    of = Periods(number, number * 5000, np.zeros(6, np.uint8), periods(6).counts)
    got = FrameReader(LAYOUT).feed(sample_frames(LAYOUT, of))
    assert got.number.tolist() == number.tolist()
    assert np.diff(got.board_us).tolist() == [5000] * 5


def test_answers_and_frames_of_others_are_kept_apart() -> None:
    reader = FrameReader(LAYOUT)
    other = sample_frames(Layout(1, 3), periods(1, layout=Layout(1, 3)))
    version = bytearray(frames(periods(1))[0])
    version[2] = 9
    version[-2:] = checksum(bytes(version[2:-2])).to_bytes(2, "little")
    got = reader.feed(frame(REPLY, 0, b"ok") + other + bytes(version) + frame(SAMPLES, 0, b"") + frames(periods(1))[0])
    assert reader.replies == [b"ok"]
    assert reader.losses == Losses(other=3)
    assert len(got) == 1


def test_what_a_frame_cannot_hold_is_refused() -> None:
    with pytest.raises(BenchError, match=r"^emitters = 16; .*65 .*4168 .*4096"):
        Layout(16, 65)
    with pytest.raises(BenchError, match=r"^receivers = 0; must be 1 to 255$"):
        Layout(1, 0)
    assert HEAD.size == 10
