"""Messages of a running command: elapsed time, progress and compilation."""

import os
import subprocess
import sys

from solen.cli.waiting import CommandProgress, is_silent


def test_reports_progress_within_two_seconds() -> None:
    progress = CommandProgress()
    times = [tenth / 10 for tenth in range(300) if progress.message(tenth / 10)]
    assert times[0] < 2.0
    assert len(times) == 3


def test_log_of_hours_is_short() -> None:
    progress = CommandProgress()
    assert 20 < sum(progress.message(float(second)) is not None for second in range(10_000)) < 60


def test_reports_completed_fraction() -> None:
    progress = CommandProgress()
    progress.done = 0.42
    assert "42 %" in (progress.message(3.0) or "")


def test_reports_compilation_at_once_and_counts_functions() -> None:
    progress = CommandProgress()
    progress.compiled, progress.function = 1, "meet"
    assert "compiling the tracer" in (progress.message(0.3) or "")
    assert progress.message(1.0) is None
    progress.compiled = 40
    assert (progress.message(2.4) or "").endswith("40 functions, now meet")
    progress.function = ""
    assert "working" in (progress.message(5.0) or "")


def test_no_messages_for_quiet_or_interactive_commands() -> None:
    assert is_silent(["studio"])
    assert is_silent(["bench", "watch", "--rig", "rig.toml"])
    assert is_silent(["run", "sensor.toml", "--quiet"])
    assert not is_silent(["run", "sensor.toml", "--json"])
    assert not is_silent(["bench", "run", "rotation.toml"])
    assert is_silent(["bench", "decode", "calibration.json", "-", "--rate-hz", "100"])
    assert is_silent(["bench", "decode", "calibration.json", "run.journal"])
    assert not is_silent(["bench", "decode", "calibration.json", "recording.csv"])


def test_reports_compilation_on_stderr() -> None:
    """Compile a new function with numba during a command."""
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
    assert "1 function, now <lambda>" in done.stderr
    assert done.stdout == ""
