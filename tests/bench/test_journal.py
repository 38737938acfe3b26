"""The journal: after any end, every row that was written is read once, and the journal can be resumed."""

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
    table = np.zeros(n, ROW)
    table["number"] = np.arange(first, first + n)
    table["counts"] = (table["number"][:, None, None] * 7 % 65536) * np.ones((1, 2, 3))
    return table


def write_journal(path: Path) -> Path:
    with Journal.create(path, {"design": "µ"}, {"board": ROW, "stage": STAGE}) as journal:
        journal.rows("board", rows(0, 10))
        journal.event(0.5, "moved", to_deg=3.0)
        journal.rows("stage", np.array([(0.1, 3.0)], STAGE))
        journal.rows("board", rows(10, 5))
        journal.end(outcome="done")
    return path


def test_reads_what_was_written(tmp_path: Path) -> None:
    content = read_journal(write_journal(tmp_path / "a.journal"))
    assert content.header["design"] == "µ"
    assert np.array_equal(content.streams["board"], rows(0, 15))
    assert content.streams["stage"].tolist() == [(0.1, 3.0)]
    assert content.events == ({"t_s": 0.5, "what": "moved", "to_deg": 3.0},)
    assert (content.end, content.lost_bytes) == ({"outcome": "done"}, 0)


def test_reads_complete_records_of_truncated_journal(tmp_path: Path) -> None:
    data = write_journal(tmp_path / "a.journal").read_bytes()
    truncated, lengths = tmp_path / "truncated.journal", set()
    for size in range(len(data)):
        truncated.write_bytes(data[:size])
        if size < 173:  # the header is incomplete
            with pytest.raises(DataError, match=r"^[^\n]*$"):
                read_journal(truncated)
            continue
        content = read_journal(truncated)
        board = content.streams["board"]
        assert np.array_equal(board, rows(0, len(board)))
        assert content.complete_bytes + content.lost_bytes == size
        lengths.add(len(board))
    assert lengths == {0, 10, 15}


def test_resumes_truncated_journal(tmp_path: Path) -> None:
    path = tmp_path / "a.journal"
    data = write_journal(path).read_bytes()
    path.write_bytes(data[:-40])
    journal, previous = Journal.resume(path)
    with journal:
        assert len(previous.streams["board"]) == 10
        journal.rows("board", rows(10, 3))
    assert np.array_equal(read_journal(path).streams["board"], rows(0, 13))


def test_damaged_byte_loses_one_record(tmp_path: Path) -> None:
    path = write_journal(tmp_path / "a.journal")
    data = bytearray(path.read_bytes())
    data[-60] ^= 4
    path.write_bytes(data)
    content = read_journal(path)
    assert content.end == {"outcome": "done"}
    assert len(content.streams["board"]) == 10
    assert (content.damaged, content.lost_bytes, content.damaged_bytes > 0) == (True, 0, True)
    assert [str(gap) for gap in content.missing] == ["1 record between 0.10 s and the end"]


def test_reads_version_1_but_does_not_resume_it(tmp_path: Path) -> None:
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
    content = read_journal(path)
    assert (content.version, content.damaged, len(content.streams["stage"]), content.parts) == (1, False, 2, 1)
    with pytest.raises(BenchError, match="older version of solen"):
        Journal.resume(path)
    path.write_bytes(data[:-30] + b"\x00" + data[-29:])
    content = read_journal(path)
    assert (content.damaged, len(content.streams["stage"])) == (True, 1)


def test_refuses_to_overwrite_journal(tmp_path: Path) -> None:
    path = write_journal(tmp_path / "a.journal")
    with pytest.raises(BenchError, match=r"already exists.*; use solen bench recover"):
        Journal.create(path, {}, {})
    with pytest.raises(BenchError, match="run that has ended"):
        Journal.resume(path)


@pytest.mark.parametrize(("name", "data"), [("a.txt", b"hello"), ("empty", b""), ("head", b"SOLENJ1\n")])
def test_refuses_other_files(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(DataError):
        read_journal(tmp_path / name)


def test_reserve_holds_last_records_on_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reserve = reserve_of(tmp_path / "a.journal")

    class LimitedFile(FileIO):
        """A file on a disk that is full at 2.2 kB as long as the reserve exists."""

        def write(self, data: Any) -> int:
            if self.tell() + len(data) > 2_200 and reserve.exists():
                super().write(bytes(data)[:7])
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data)

    monkeypatch.setattr("solen.bench.journal.FileIO", LimitedFile)
    with Journal.create(tmp_path / "a.journal", {}, {"board": ROW}) as journal:
        for first in range(0, 90, 10):
            journal.rows("board", rows(first, 10))
        with pytest.raises(BenchError, match=r"a\.journal; .*No space left on device; free some space"):
            journal.rows("board", rows(90, 10))
        journal.event(1.0, "fault", reason="no room")
    content = read_journal(tmp_path / "a.journal")
    assert content.outcome == "fault"
    assert not content.damaged  # the incomplete record was removed
    assert len(content.streams["board"]) == 90
    assert not reserve.exists()


def test_reports_input_output_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    errors: list[OSError] = []

    class FailingFile(FileIO):
        def seek(self, *position: Any) -> int:
            if errors:
                raise errors[0]
            return super().seek(*position)

    monkeypatch.setattr("solen.bench.journal.FileIO", FailingFile)
    with Journal.create(tmp_path / "a.journal", {}, {"board": ROW}) as journal:
        journal.rows("board", rows(0, 10))
        errors.append(OSError(errno.EIO, "Input/output error"))
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
        begin, written = time.monotonic(), 0
        print(begin, flush=True)
        while True:
            due = int((time.monotonic() - begin) * 2000)
            rows = np.zeros(due - written, dtype)
            rows["number"] = np.arange(written, due)
            journal.rows("board", rows)
            written = due
            time.sleep(0.005)
"""


def kill_writer(path: Path, delay_s: float) -> tuple[int, int]:
    """Kill a process that writes a journal; return the rows due half a second before, and those in the journal."""
    command = [sys.executable, "-c", textwrap.dedent(CHILD), str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, encoding="utf-8") as child:
        assert child.stdout is not None
        begin_s = float(child.stdout.readline())
        time.sleep(delay_s)
        killed_s = time.monotonic()
        child.kill()
    numbers = read_journal(path).streams["board"]["number"]
    assert np.array_equal(numbers, np.arange(len(numbers)))
    return max(0, int((killed_s - begin_s - 0.5) * 2000)), len(numbers)


@pytest.mark.parametrize("kills", [2, pytest.param(50, marks=pytest.mark.evidence)])
def test_killed_process_loses_less_than_half_second(tmp_path: Path, kills: int) -> None:
    delays_s = np.random.default_rng(kills).uniform(0.3, 1.2, kills).tolist()
    for number, delay_s in enumerate(delays_s):
        due, written = kill_writer(tmp_path / f"{number}.journal", delay_s)
        assert written >= due
    if kills == 50:
        print("\n  50 kills at random moments: every row older than 0.5 s is in the journal once")
