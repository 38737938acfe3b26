"""The journal: what was written is there after any end, each row once, and it can be gone on with."""

import errno
import json
import struct
import subprocess
import sys
import textwrap
import time
import zlib
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.bench.journal import Journal, read_journal, reserve_of
from solen.bench.records import MAGIC_1
from solen.errors import BenchError, DataError

ROW = np.dtype([("number", "<i8"), ("counts", "<u2", (2, 3))])
STAGE = np.dtype([("t_s", "<f8"), ("angle_deg", "<f8")])


def rows(first: int, n: int) -> np.ndarray:
    made = np.zeros(n, ROW)
    made["number"] = np.arange(first, first + n)
    made["counts"] = (made["number"][:, None, None] * 7 % 65536) * np.ones((1, 2, 3))
    return made


def written(path: Path) -> Path:
    with Journal.create(path, {"design": "µ"}, {"board": ROW, "stage": STAGE}) as journal:
        journal.rows("board", rows(0, 10))
        journal.event(0.5, "moved", to_deg=3.0)
        journal.rows("stage", np.array([(0.1, 3.0)], STAGE))
        journal.rows("board", rows(10, 5))
        journal.end(outcome="done")
    return path


def test_what_was_written_is_read(tmp_path: Path) -> None:
    found = read_journal(written(tmp_path / "a.journal"))
    assert found.header["design"] == "µ"
    assert np.array_equal(found.streams["board"], rows(0, 15))
    assert found.streams["stage"].tolist() == [(0.1, 3.0)]
    assert found.events == ({"t_s": 0.5, "what": "moved", "to_deg": 3.0},)
    assert (found.end, found.lost_bytes) == ({"outcome": "done"}, 0)


def test_cut_anywhere_it_gives_what_was_whole(tmp_path: Path) -> None:
    data = written(tmp_path / "a.journal").read_bytes()
    cut, seen = tmp_path / "cut.journal", set()
    for length in range(len(data)):
        cut.write_bytes(data[:length])
        if length < 173:  # the header is not whole
            with pytest.raises(DataError, match=r"^[^\n]*$"):
                read_journal(cut)
            continue
        found = read_journal(cut)
        board = found.streams["board"]
        assert np.array_equal(board, rows(0, len(board)))
        assert found.complete_bytes + found.lost_bytes == length
        seen.add(len(board))
    assert seen == {0, 10, 15}


def test_what_was_left_is_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "a.journal"
    data = written(path).read_bytes()
    path.write_bytes(data[:-40])
    journal, before = Journal.resume(path)
    with journal:
        assert len(before.streams["board"]) == 10
        journal.rows("board", rows(10, 3))
    assert np.array_equal(read_journal(path).streams["board"], rows(0, 13))


def test_a_changed_byte_costs_one_record_and_it_is_named(tmp_path: Path) -> None:
    path = written(tmp_path / "a.journal")
    data = bytearray(path.read_bytes())
    data[-60] ^= 4
    path.write_bytes(data)
    found = read_journal(path)
    assert found.end == {"outcome": "done"}
    assert len(found.streams["board"]) == 10
    assert (found.damaged, found.lost_bytes, found.damaged_bytes > 0) == (True, 0, True)
    assert [str(one) for one in found.missing] == ["1 record between 0.10 s and the end"]


def test_version_1_still_opens_and_is_not_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "old.journal"
    data = MAGIC_1
    header = {"streams": {"stage": [["t_s", "<f8", []], ["angle_deg", "<f8", []]]}}
    rows = np.array([(0.1, 3.0)], STAGE).tobytes()
    for kind, payload in (
        (1, json.dumps(header).encode()),
        (2, rows),
        (3, b'{"t_s": 1.0, "what": "begun"}'),
        (2, rows),
    ):
        head = struct.pack("<BBI", kind, 0, len(payload))
        data += head + struct.pack("<I", zlib.crc32(payload, zlib.crc32(head))) + payload
    path.write_bytes(data)
    found = read_journal(path)
    assert (found.version, found.damaged, len(found.streams["stage"]), found.parts) == (1, False, 2, 1)
    with pytest.raises(BenchError, match="older solen"):
        Journal.resume(path)
    path.write_bytes(data[:-30] + b"\x00" + data[-29:])
    found = read_journal(path)
    assert (found.damaged, len(found.streams["stage"])) == (True, 1)


def test_a_journal_is_never_written_over(tmp_path: Path) -> None:
    path = written(tmp_path / "a.journal")
    with pytest.raises(BenchError, match=r"already exists.*; use solen bench recover"):
        Journal.create(path, {}, {})
    with pytest.raises(BenchError, match="was ended"):
        Journal.resume(path)


@pytest.mark.parametrize(("name", "data"), [("a.txt", b"hello"), ("empty", b""), ("head", b"SOLENJ1\n")])
def test_what_is_no_journal_is_refused(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(DataError):
        read_journal(tmp_path / name)


def test_a_full_disk_leaves_room_to_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reserve = reserve_of(tmp_path / "a.journal")

    class Filling(FileIO):
        """A file on a disk that is full at 2.2 kB, but for what is given up."""

        def write(self, data: Any) -> int:
            if self.tell() + len(data) > 2_200 and reserve.exists():
                super().write(bytes(data)[:7])  # what still fitted
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data)

    monkeypatch.setattr("solen.bench.journal.FileIO", Filling)
    with Journal.create(tmp_path / "a.journal", {}, {"board": ROW}) as journal:
        for first in range(0, 90, 10):
            journal.rows("board", rows(first, 10))
        with pytest.raises(BenchError, match=r"a\.journal; .*No space left on device; free some space"):
            journal.rows("board", rows(90, 10))
        journal.event(1.0, "fault", reason="no room")
    found = read_journal(tmp_path / "a.journal")
    assert found.outcome == "fault"
    assert not found.damaged  # what was half-written is gone
    assert len(found.streams["board"]) == 90
    assert not reserve.exists()


def test_a_disk_that_is_gone_ends_in_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone: list[OSError] = []

    class Gone(FileIO):
        def seek(self, *at: Any) -> int:
            if gone:
                raise gone[0]
            return super().seek(*at)

    monkeypatch.setattr("solen.bench.journal.FileIO", Gone)
    with Journal.create(tmp_path / "a.journal", {}, {"board": ROW}) as journal:
        journal.rows("board", rows(0, 10))
        gone.append(OSError(errno.EIO, "Input/output error"))
        with pytest.raises(BenchError, match="Input/output error"):
            journal.rows("board", rows(10, 10))
    assert len(read_journal(tmp_path / "a.journal").streams["board"]) == 10


CHILD = """
    import sys, time
    import numpy as np
    from pathlib import Path
    from solen.bench.journal import Journal

    dtype = np.dtype([("number", "<i8"), ("counts", "<u2", (2, 3))])
    with Journal.create(Path(sys.argv[1]), {}, {"board": dtype}) as journal:
        begun, sent = time.monotonic(), 0
        print(begun, flush=True)
        while True:
            due = int((time.monotonic() - begun) * 2000)
            made = np.zeros(due - sent, dtype)
            made["number"] = np.arange(sent, due)
            journal.rows("board", made)
            sent = due
            time.sleep(0.005)
"""


def killed(path: Path, after_s: float) -> tuple[int, int]:
    """Rows that were due half a second before the kill, and rows that are there; every one checked."""
    command = [sys.executable, "-c", textwrap.dedent(CHILD), str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, encoding="utf-8") as child:
        assert child.stdout is not None
        begun = float(child.stdout.readline())
        time.sleep(after_s)
        killed_at = time.monotonic()
        child.kill()
    numbers = read_journal(path).streams["board"]["number"]
    assert np.array_equal(numbers, np.arange(len(numbers)))
    return max(0, int((killed_at - begun - 0.5) * 2000)), len(numbers)


@pytest.mark.parametrize("kill", [0, 1, 2, pytest.param(50, marks=pytest.mark.evidence)])
def test_a_killed_process_loses_less_than_half_a_second(tmp_path: Path, kill: int) -> None:
    moments = np.random.default_rng(kill).uniform(0.3, 1.2, max(1, kill))
    for number, moment in enumerate(moments.tolist()):
        due, there = killed(tmp_path / f"{number}.journal", moment)
        assert there >= due
    if kill == 50:
        print("\n  50 kills at random moments: every row older than 0.5 s there, none twice")
