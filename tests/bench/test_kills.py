"""The program killed at any moment: its samples are kept, and the run can be closed, analysed and resumed."""

import datetime as dt
import shutil
import time
from collections import Counter
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pytest

from solen.analysis import study
from solen.bench import record as recording
from solen.bench.journal import read_journal
from solen.bench.journal_content import JournalContent
from solen.bench.record import RecordOptions, record, recover
from solen.errors import BenchError, DataError, SolenError
from tests.bench.fork_support import Killed, Start, kill_runs, start_process

CYCLES, PERIOD_S = 3, 0.005
PARALLEL = 5


def record_named(folder: Path, name: str, **options: Any) -> None:
    record(folder / "protocol.toml", folder / "rig.toml", folder / "out", RecordOptions(name=name, **options))


def check_journal(run: Killed, content: JournalContent, *, timed: bool) -> None:
    """Check that no record is double or missing and, if `timed`, that everything older than half a second is there."""
    board, stage = content.streams["board"], content.streams["stage"]
    assert board["number"].tolist() == list(range(len(board)))
    assert (np.diff(board["board_us"]) > 0).all()
    assert (np.diff(stage["t_s"]) > 0.0).all()
    if timed and content.end is None and content.events:
        begin_s = dt.datetime.fromisoformat(content.events[0]["utc"]).timestamp()
        due_s = run.killed_s - begin_s - 0.5
        assert len(board) >= int(due_s / PERIOD_S)
        if due_s > 0.1:
            assert stage["t_s"][-1] - content.events[0]["t_s"] >= due_s - 0.05


def check_readings(recording: Path, periods: int | None = None) -> None:
    with h5netcdf.File(recording, "r") as file:
        time_s, number = file.variables["time_s"][...], file.variables["number"][...]
        assert (np.diff(time_s) > 0.0).all()
        assert periods is None or len(number) == periods
        assert set(file.groups) == {"A", "B"}


def check_one_line(error: DataError) -> None:
    assert len(str(error).splitlines()) == 1


def analyse(recording: Path) -> str:
    """Analyse a recording, or check that the error is one line, if it has no complete cycle."""
    try:
        analysis = study([recording]).to_dict()
    except DataError as bad:
        check_one_line(bad)
        return "too short to analyse"
    assert set(analysis["sensors"]) == {"A", "B"}
    return "analysed"


def close_run(run: Killed, *, resume: bool, timed: bool) -> tuple[str, str]:
    """Check what a killed run has left, and close or resume it; return when it was killed, and the outcome."""
    if not run.journal.exists():
        if not run.recording.exists():
            return "before its journal", "nothing to keep"
        check_readings(run.recording)
        return "after its end", analyse(run.recording)
    try:
        content = read_journal(run.journal)
    except DataError:
        assert run.journal.stat().st_size < 4096  # the first record is incomplete
        return "before its journal", "nothing to keep"
    check_journal(run, content, timed=timed)
    if content.end is not None:
        recover(run.journal)
        check_readings(run.recording, len(content.streams["board"]))
        return "while closing", analyse(run.recording)
    if resume:
        record_named(run.folder, run.name, resume=True)
        check_readings(run.recording)
        analysis = study([run.recording]).to_dict()
        for sensor in analysis["sensors"].values():
            assert [len(part["motion"]["cycles"]) for part in sensor["runs"]] == [CYCLES]
        assert not [line for line in analysis["warnings"] if "incomplete" in line]
        return "in the run", "resumed with all cycles complete"
    closed = recover(run.journal)
    assert (closed.outcome, closed.periods) == ("killed", len(content.streams["board"]))
    if closed.periods > 0:
        check_readings(run.recording, closed.periods)
    return "in the run", analyse(run.recording)


def test_killed_run_is_closed_or_resumed(bench: Path, start: Start) -> None:
    (bench / "out").mkdir()
    for number, run in enumerate(kill_runs(start, bench, [0.4, 1.0, 1.8], from_sampling=True)):
        close_run(run, resume=number % 2 == 1, timed=False)
    assert not temporary_files(bench / "out")


@pytest.mark.evidence
def test_run_killed_at_random_moment_is_closed_or_resumed(bench: Path) -> None:
    (bench / "out").mkdir()
    delays_s = np.random.default_rng(50).uniform(0.0, 6.0, 50).tolist()
    outcomes: Counter[tuple[str, str]] = Counter()
    for first in range(0, len(delays_s), PARALLEL):
        delays, from_sampling = delays_s[first : first + PARALLEL], first != PARALLEL
        killed = kill_runs(start_process, bench, delays, first, from_sampling=from_sampling)
        outcomes.update(close_run(run, resume=number % 2 == 1, timed=True) for number, run in enumerate(killed))
    assert not temporary_files(bench / "out")
    assert outcomes.total() == len(delays_s)
    summary = "; ".join(f"{count} {moment}, {outcome}" for (moment, outcome), count in sorted(outcomes.items()))
    print(f"\n  {len(delays_s)} kills at random moments: {summary}")


def unclosed_journal(bench: Path, monkeypatch: pytest.MonkeyPatch, cycles: int) -> Path:
    """Record a run that has ended, but whose journal is not closed, and return the journal."""

    def interrupt(*_: Path) -> None:
        raise KeyboardInterrupt

    text = (bench / "protocol.toml").read_text(encoding="utf-8")
    (bench / "protocol.toml").write_text(text.replace("cycles = 3", f"cycles = {cycles}"), encoding="utf-8")
    with monkeypatch.context() as patch:
        patch.setattr(recording, "close_journal", interrupt)
        with pytest.raises(KeyboardInterrupt):
            record_named(bench, "ended")
    return bench / "out" / "ended.journal"


def temporary_files(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if path.name.endswith(".tmp")]


def test_recovers_after_kill_while_recording_is_written(
    bench: Path, start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = unclosed_journal(bench, monkeypatch, 60)
    periods = len(read_journal(journal).streams["board"])
    process = start(journal.parent, "bench", "recover", str(journal))
    while process.poll() is None and not temporary_files(journal.parent):
        time.sleep(0.001)
    process.kill()
    process.wait()
    assert journal.exists()
    assert temporary_files(journal.parent)
    run = recover(journal)
    assert (run.outcome, run.periods, run.cycles) == ("done", periods, 60)
    assert not temporary_files(journal.parent)
    assert not journal.exists()


def test_recovers_after_kill_before_journal_is_removed(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = unclosed_journal(bench, monkeypatch, 3)
    copy = shutil.copy(journal, journal.with_suffix(".copy"))
    first = recover(journal)
    shutil.copy(copy, journal)
    assert recover(journal).to_dict() == first.to_dict()
    shutil.copy(copy, journal.with_name("other.journal"))
    data = first.path.read_bytes()
    journal.with_name("other.nc").write_bytes(b"another file")
    with pytest.raises(SolenError, match=r"other\.nc; already exists; move it away"):
        recover(journal.with_name("other.journal"))
    assert first.path.read_bytes() == data


@pytest.mark.evidence
def test_recovers_after_recover_is_killed_at_random_moment(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = unclosed_journal(bench, monkeypatch, 60)
    states: Counter[str] = Counter()
    copy = shutil.copy(journal, journal.with_suffix(".copy"))
    periods, recording = len(read_journal(journal).streams["board"]), journal.with_suffix(".nc")
    begin_s = time.monotonic()
    assert start_process(journal.parent, "bench", "recover", str(journal)).wait(60.0) == 0
    duration_s = time.monotonic() - begin_s
    for fraction in np.random.default_rng(9).uniform(0.5, 1.0, 20).tolist():
        shutil.copy(copy, journal)
        recording.unlink(missing_ok=True)
        with start_process(journal.parent, "bench", "recover", str(journal)) as process:
            time.sleep(fraction * duration_s)
            process.kill()
        state = "before writing" if journal.exists() and not temporary_files(journal.parent) else "after"
        states["writing" if temporary_files(journal.parent) else state] += 1
        if journal.exists():
            recover(journal)
        check_readings(recording, periods)
        assert not temporary_files(journal.parent)
    print(f"\n  20 kills of recover: {dict(states)}; in the end always {periods} periods")


def test_refuses_journal_in_use(bench: Path, start: Start) -> None:
    text = (bench / "protocol.toml").read_text(encoding="utf-8")
    (bench / "protocol.toml").write_text(text.replace("rest_s = 0.2", "rest_s = 30"), encoding="utf-8")
    journal = bench / "out" / "first.journal"
    words = ("run", "protocol.toml", "--rig", "rig.toml", "--out", "out", "--real-time", "--name", "first")
    process = start(bench, "bench", *words)
    try:
        while not (journal.exists() and journal.stat().st_size > 20_000):
            assert process.poll() is None
            time.sleep(0.01)
        for again in (lambda: record_named(bench, "first", resume=True), lambda: recover(journal)):
            with pytest.raises(BenchError, match=r"first\.journal; is in use by another run"):
                again()
        assert process.poll() is None
    finally:
        process.kill()
        process.wait()
    assert recover(journal).outcome == "killed"  # the lock ended with its process
