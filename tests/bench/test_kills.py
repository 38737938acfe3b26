"""The whole program killed at any moment: what it had sampled is there, can be closed, analysed and gone on with."""

import datetime as dt
import math
import shutil
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
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

CYCLES, PERIOD_S = 3, 0.005
AT_ONCE = 5


def command(*words: str, folder: Path) -> "subprocess.Popen[bytes]":
    line = [sys.executable, "-m", "solen", "bench", *words]
    return subprocess.Popen(line, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def recorded(folder: Path, name: str, **more: Any) -> None:
    options = RecordOptions(name=name, **more)
    record(folder / "protocol.toml", folder / "rig.toml", folder / "out", options)


@dataclass
class Killed:
    """A run that was killed: its name, and the computer's time just before."""

    folder: Path
    name: str
    at_s: float

    @property
    def journal(self) -> Path:
        return self.folder / "out" / f"{self.name}.journal"

    @property
    def recording(self) -> Path:
        return self.journal.with_suffix(".nc")


def killed(folder: Path, moments: list[float], first: int = 0, *, sampling: bool = False) -> list[Killed]:
    """Runs in real time side by side, each killed so long after its beginning, or after it begins to sample."""
    words = ("run", "protocol.toml", "--rig", "rig.toml", "--out", "out", "--real-time", "--name")
    names = [f"k{first + number}" for number in range(len(moments))]
    alive = {name: command(*words, name, folder=folder) for name in names}
    moment = dict(zip(names, moments, strict=True))
    begun = {} if sampling else dict.fromkeys(names, time.monotonic())
    found = []
    while alive:
        for name in list(alive):
            one = Killed(folder, name, time.time())
            if name not in begun and (one.journal.exists() or one.recording.exists()):
                begun[name] = time.monotonic()
            if time.monotonic() - begun.get(name, math.inf) >= moment[name]:
                with alive.pop(name) as child:
                    child.kill()
                found.append(one)
            else:
                assert not alive[name].poll()  # it may have ended, and not with a fault
        time.sleep(0.005)
    return found


def check_journal(one: Killed, found: JournalContent, *, timed: bool) -> None:
    """Nothing twice, nothing missing; where it is ``timed``, all that is older than half a second is there."""
    board, stage = found.streams["board"], found.streams["stage"]
    assert board["number"].tolist() == list(range(len(board)))
    assert (np.diff(board["board_us"]) > 0).all()
    assert (np.diff(stage["t_s"]) > 0.0).all()
    if timed and found.end is None and found.events:
        begun_s = dt.datetime.fromisoformat(found.events[0]["utc"]).timestamp()
        due_s = one.at_s - begun_s - 0.5
        assert len(board) >= int(due_s / PERIOD_S)
        if due_s > 0.1:
            assert stage["t_s"][-1] - found.events[0]["t_s"] >= due_s - 0.05


def check_readings(recording: Path, periods: int | None = None) -> None:
    with h5netcdf.File(recording, "r") as file:
        time_s, number = file.variables["time_s"][...], file.variables["number"][...]
        assert (np.diff(time_s) > 0.0).all()
        assert periods is None or len(number) == periods
        assert set(file.groups) == {"A", "B"}


def one_line(told: str) -> str:
    """What is told of a recording that is too short: in one line."""
    assert len(told.splitlines()) == 1
    return "too short to analyse"


def check_analysis(recording: Path) -> str:
    """Analysed, or told in one line that there is no whole cycle."""
    try:
        found = study([recording]).to_dict()
    except DataError as bad:
        return one_line(str(bad))
    assert set(found["sensors"]) == {"A", "B"}
    return "analysed"


def after(one: Killed, *, resume: bool, timed: bool) -> tuple[str, str]:
    """When it was killed, and what became of it."""
    if not one.journal.exists():
        if not one.recording.exists():
            return "before its journal", "nothing to keep"
        check_readings(one.recording)
        return "after its end", check_analysis(one.recording)
    try:
        found = read_journal(one.journal)
    except DataError:
        assert one.journal.stat().st_size < 4096  # the very first record was under way
        return "before its journal", "nothing to keep"
    check_journal(one, found, timed=timed)
    if found.end is not None:
        recover(one.journal)
        check_readings(one.recording, len(found.streams["board"]))
        return "while closing", check_analysis(one.recording)
    if resume:
        recorded(one.folder, one.name, resume=True)
        check_readings(one.recording)
        told = study([one.recording]).to_dict()
        for sensor in told["sensors"].values():
            assert [len(run["motion"]["cycles"]) for run in sensor["runs"]] == [CYCLES]
        assert not [line for line in told["warnings"] if "incomplete" in line]
        return "in the run", "taken up: every cycle whole"
    done = recover(one.journal)
    assert (done.outcome, done.periods) == ("killed", len(found.streams["board"]))
    if done.periods > 0:
        check_readings(one.recording, done.periods)
    return "in the run", check_analysis(one.recording)


def check_folder(folder: Path) -> None:
    left = [path.name for path in (folder / "out").iterdir() if path.name.endswith(".tmp")]
    assert not left


@pytest.mark.parametrize("kills", [3, pytest.param(50, marks=pytest.mark.evidence)])
def test_the_program_is_killed_at_random_moments(bench: Path, kills: int) -> None:
    (bench / "out").mkdir()
    rng = np.random.default_rng(kills)
    moments = [0.4, 1.0, 1.8] if kills == 3 else rng.uniform(0.0, 6.0, kills).tolist()
    told: Counter[tuple[str, str]] = Counter()
    for begin in range(0, kills, AT_ONCE):
        sampling = begin != AT_ONCE  # of the second five the moments count from before Python is loaded
        for number, one in enumerate(killed(bench, moments[begin : begin + AT_ONCE], begin, sampling=sampling)):
            told[after(one, resume=number % 2 == 1, timed=kills > 3)] += 1
    check_folder(bench)
    assert sum(told.values()) == kills
    if kills > 3:
        print(
            f"\n  {kills} kills at random moments: " + "; ".join(f"{n} {a}, {b}" for (a, b), n in sorted(told.items()))
        )


@pytest.fixture
def left(bench: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A journal of a minute or two that was ended and not closed."""

    def gone(*_: Path) -> None:
        raise KeyboardInterrupt

    text = (bench / "protocol.toml").read_text(encoding="utf-8")
    (bench / "protocol.toml").write_text(text.replace("cycles = 3", "cycles = 60"), encoding="utf-8")
    with monkeypatch.context() as patched:
        patched.setattr(recording, "close_journal", gone)
        with pytest.raises(KeyboardInterrupt):
            recorded(bench, "left")
    return bench / "out" / "left.journal"


def temporary(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if path.name.endswith(".tmp")]


def test_killed_while_the_recording_is_written_it_is_closed_anew(left: Path) -> None:
    periods = len(read_journal(left).streams["board"])
    with command("recover", str(left), folder=left.parent) as child:
        while child.poll() is None and not temporary(left.parent):
            time.sleep(0.001)
        child.kill()
    assert left.exists()
    assert temporary(left.parent)
    done = recover(left)
    assert (done.outcome, done.periods, done.cycles) == ("done", periods, 60)
    assert not temporary(left.parent)
    assert not left.exists()


def test_killed_before_the_journal_is_removed_it_is_closed_again(left: Path) -> None:
    kept = shutil.copy(left, left.with_suffix(".kept"))
    first = recover(left)
    shutil.copy(kept, left)
    assert recover(left).to_dict() == first.to_dict()
    shutil.copy(kept, left.with_name("other.journal"))
    data = first.path.read_bytes()
    left.with_name("other.nc").write_bytes(b"somebody's")
    with pytest.raises(SolenError, match=r"other\.nc; already exists; move it away"):
        recover(left.with_name("other.journal"))
    assert first.path.read_bytes() == data


@pytest.mark.evidence
def test_recover_is_killed_at_random_moments(left: Path) -> None:
    told: Counter[str] = Counter()
    kept = shutil.copy(left, left.with_suffix(".kept"))
    periods, recording = len(read_journal(left).streams["board"]), left.with_suffix(".nc")
    begun = time.monotonic()
    with command("recover", str(left), folder=left.parent) as child:
        assert child.wait(60.0) == 0
    takes_s = time.monotonic() - begun
    for share in np.random.default_rng(9).uniform(0.5, 1.0, 20).tolist():
        shutil.copy(kept, left)
        recording.unlink(missing_ok=True)
        with command("recover", str(left), folder=left.parent) as child:
            time.sleep(share * takes_s)
            child.kill()
        state = "before writing" if left.exists() and not temporary(left.parent) else "after"
        told["writing" if temporary(left.parent) else state] += 1
        if left.exists():
            recover(left)
        check_readings(recording, periods)
        assert not temporary(left.parent)
    print(f"\n  20 kills of recover: {dict(told)}; every time the same {periods} periods in the end")


def test_a_second_run_and_a_recovery_are_kept_from_a_journal_in_use(bench: Path) -> None:
    text = (bench / "protocol.toml").read_text(encoding="utf-8")
    (bench / "protocol.toml").write_text(text.replace("rest_s = 0.2", "rest_s = 30"), encoding="utf-8")
    journal = bench / "out" / "one.journal"
    words = ("run", "protocol.toml", "--rig", "rig.toml", "--out", "out", "--real-time", "--name", "one")
    with command(*words, folder=bench) as child:
        while not (journal.exists() and journal.stat().st_size > 20_000):
            assert child.poll() is None
            time.sleep(0.01)
        in_use = r"one\.journal; is in use by another run; wait until it has ended"
        with pytest.raises(BenchError, match=in_use):
            recorded(bench, "one", resume=True)
        with pytest.raises(BenchError, match=in_use):
            recover(journal)
        assert child.poll() is None
        child.kill()
    assert recover(journal).outcome == "killed"  # the lock went with its process
