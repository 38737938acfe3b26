"""The fast reader of large tables agrees with the row-by-row reader, including its errors."""

from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError
from solen.recording import large_table as fast
from solen.recording import read
from solen.recording.source import load

ROWS = 3000


def table(separator: str = ",", mark: str = ".", header: str = "time_s,angle_deg,left_mV", above: str = "") -> str:
    time_s = np.arange(ROWS) * 0.005
    rows = np.column_stack([time_s, 3.0 * np.sin(time_s), 2000.0 + 100.0 * np.cos(time_s)]).tolist()
    lines = [separator.join(f"{value:.4f}".replace(".", mark) for value in row) for row in rows]
    return above + "\n".join([header.replace(",", separator), *lines]) + "\n"


@pytest.fixture(autouse=True)
def _low_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fast, "MIN_BYTES", 1000)


def compare(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Assert that both readers agree."""
    fast_reading = read(path)
    monkeypatch.setattr(fast, "MIN_BYTES", 10**9)
    slow = read(path)
    assert fast_reading.names == slow.names
    assert fast_reading.provenance == slow.provenance
    assert fast_reading.warnings == slow.warnings
    for fast_channel, channel in zip(fast_reading.channels, slow.channels, strict=True):
        assert np.array_equal(fast_channel.values, channel.values, equal_nan=True)
        assert (fast_channel.unit, fast_channel.quantity, fast_channel.axis) == (
            channel.unit,
            channel.quantity,
            channel.axis,
        )


@pytest.mark.parametrize(
    "text",
    [
        table(),
        table(";", ","),
        table("\t"),
        table(above="# simulated: yes\noperator;nobody\n\n"),
        table().rstrip("\n"),
        table().rstrip("\n")[:-3],
        table().replace("\n", "\r\n"),
    ],
    ids=["comma", "semicolon", "tab", "parameters", "no end", "cut", "windows"],
)
def test_agrees_with_row_by_row_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    path = tmp_path / "large.csv"
    path.write_bytes(text.encode("utf-8"))
    compare(path, monkeypatch)


def test_reads_large_table(tmp_path: Path) -> None:
    path = tmp_path / "large.csv"
    path.write_text(table(), encoding="utf-8")
    assert fast.read_large(load(path)) is not None


@pytest.mark.parametrize(
    ("row", "location"),
    [("1.0,x,2.0", "line 2000, column 2"), ("1.0,2.0", "line 2000"), ("1.0,2.0,3.0,4.0", "line 2000")],
)
def test_reports_damage_with_line(tmp_path: Path, row: str, location: str) -> None:
    lines = table().split("\n")
    lines[1999] = row
    path = tmp_path / "large.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(DataError, match=location):
        read(path)


def test_empty_cell_and_comment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = table().split("\n")
    lines[1999] = "1.0,,2.0"
    lines[1500] = "# a comment"
    path = tmp_path / "large.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    compare(path, monkeypatch)
    assert np.isnan(read(path).need("angle").values).sum() == 1


@pytest.mark.parametrize(
    ("stamps", "steps"),
    [
        (["2026-03-01T10:00:00.250", "2026-03-01T10:00:00.500", "2026-03-02T10:00:00.500"], [0.25, 86400.0]),
        (["01.03.2026 10:00:00,25", "01.03.2026 10:00:01,25", "01.03.2026 10:00:01,50"], [1.0, 0.25]),
        (["03/04/2026 11:59:59.5 AM", "03/04/2026 12:00:00.0 PM", "03/04/2026 01:00:00.0 PM"], [0.5, 3600.0]),
        (["23:59:59.75", "00:00:00.25", "00:00:00.75"], [0.5, 0.5]),
    ],
)
def test_clock_times_become_seconds(tmp_path: Path, stamps: list[str], steps: list[float]) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["timestamp;V", *(f"{stamp};1" for stamp in stamps)]) + "\n", encoding="utf-8")
    channel = read(path).need("timestamp")
    assert (channel.unit, channel.quantity) == ("s", "time")
    assert np.diff(channel.values) == pytest.approx(steps)


def test_words_are_not_clock_times(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("clock;V\nten;1\neleven;2\n", encoding="utf-8")
    assert read(path).find("clock") is None
