"""What a command says while it works: by the time, by its progress, by what is compiled."""

import os
import subprocess
import sys

from solen.cli.waiting import Waiting, is_silent


def test_nothing_over_two_seconds_is_silent() -> None:
    waiting = Waiting()
    said = [tenth / 10 for tenth in range(300) if waiting.words(tenth / 10)]
    assert said[0] < 2.0
    assert len(said) == 3


def test_a_log_of_hours_stays_short() -> None:
    waiting = Waiting()
    assert 20 < sum(waiting.words(float(second)) is not None for second in range(10_000)) < 60


def test_progress_is_said() -> None:
    waiting = Waiting()
    waiting.done = 0.42
    assert "42 %" in (waiting.words(3.0) or "")


def test_compiling_is_said_at_once_and_then_counted() -> None:
    waiting = Waiting()
    waiting.compiled, waiting.function = 1, "meet"
    assert "compiling the tracer" in (waiting.words(0.3) or "")
    assert waiting.words(1.0) is None
    waiting.compiled = 40
    assert (waiting.words(2.4) or "").endswith("40 functions, now meet")
    waiting.function = ""
    assert "working" in (waiting.words(5.0) or "")


def test_what_talks_itself_or_is_quiet_is_left_alone() -> None:
    assert is_silent(["studio"])
    assert is_silent(["bench", "watch", "--rig", "rig.toml"])
    assert is_silent(["run", "sensor.toml", "--quiet"])
    assert not is_silent(["run", "sensor.toml", "--json"])
    assert not is_silent(["bench", "run", "rotation.toml"])
    assert is_silent(["bench", "decode", "calibration.json", "-", "--rate-hz", "100"])
    assert is_silent(["bench", "decode", "calibration.json", "run.journal"])
    assert not is_silent(["bench", "decode", "calibration.json", "recording.csv"])


def test_a_compilation_is_noticed_and_said_on_stderr() -> None:
    """A function that numba has never seen, in a command of this program."""
    program = (
        "import sys, time, solen.cli.waiting as w\n"
        "with w.progress_messages('solen x'):\n"
        "    import numba\n"
        "    time.sleep(0.5)\n"
        "    numba.njit(lambda x: x + 1)(1.0)\n"
        "    time.sleep(0.5)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env={**os.environ}, timeout=120
    )
    assert "solen x: compiling the tracer" in done.stderr
    assert "1 functions, now <lambda>" in done.stderr
    assert done.stdout == ""
