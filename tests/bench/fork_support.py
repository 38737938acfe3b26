"""Runs of the program in separate processes, to be killed: forked from one that has loaded it, or started as usual.

Forked processes start quickly, but need POSIX.
"""

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

SERVER = """
import json, os, signal, sys
import h5netcdf, h5py, pydantic, scipy.interpolate, serial
import solen.bench.board, solen.bench.gcs2, solen.bench.record, solen.bench.simulated.instruments
import solen.cli.bench.record
from solen.cli import run_command

signal.signal(signal.SIGINT, signal.default_int_handler)
for name in ("SIGTERM", "SIGHUP"):
    signal.signal(getattr(signal, name), signal.SIG_DFL)
codes = {}
for line in sys.stdin:
    order, *arguments = json.loads(line)
    if order == "start":
        folder, stderr, *words = arguments
        reply = os.fork()
        if reply == 0:
            os.chdir(folder)
            for stream, name in ((0, os.devnull), (1, os.devnull), (2, stderr)):
                os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | os.O_TRUNC), stream)
            os._exit(run_command(words))
    else:
        pid, = arguments
        if pid not in codes:
            ended, status = os.waitpid(pid, os.WNOHANG if order == "poll" else 0)
            codes |= {pid: os.waitstatus_to_exitcode(status)} if ended else {}
        reply = codes.get(pid)
    print(json.dumps(reply), flush=True)
"""


class Process(Protocol):
    """Part of a `subprocess.Popen`."""

    def send_signal(self, sig: int) -> None: ...
    def kill(self) -> None: ...
    def poll(self) -> int | None: ...
    def wait(self) -> int | None: ...


Start = Callable[..., Process]
"""Starts ``solen WORDS`` in a folder, given the folder and the words; stderr goes to the file of that name there."""


def start_process(folder: Path, *words: str) -> "subprocess.Popen[bytes]":
    """Start ``solen WORDS`` in a folder in a new Python process."""
    with (folder / "stderr").open("wb") as stderr:
        return subprocess.Popen(
            [sys.executable, "-m", "solen", *words],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=stderr,
        )


@dataclass
class Forks:
    """A server that forks runs of the program."""

    process: "subprocess.Popen[str]"

    def start(self, folder: Path, *words: str) -> "Forked":
        """Start ``solen WORDS`` in a folder in a forked process."""
        pid = self.request("start", str(folder), str(folder / "stderr"), *words)
        assert pid is not None
        return Forked(self, pid)

    def request(self, *order: str | int) -> int | None:
        """Send an order to the server, and return its reply."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        reply: int | None = json.loads(self.process.stdout.readline())
        return reply


@dataclass
class Forked:
    """A run in a forked process."""

    server: Forks
    pid: int

    def send_signal(self, sig: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, sig)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def poll(self) -> int | None:
        """Return the exit code, negative for the signal that ended it; None while it runs."""
        return self.server.request("poll", self.pid)

    def wait(self) -> int | None:
        """Wait until it has ended, and return the exit code."""
        return self.server.request("wait", self.pid)


@contextlib.contextmanager
def fork_server() -> Iterator[Forks]:
    """Process that has loaded the program."""
    line, pipe = [sys.executable, "-c", SERVER], subprocess.PIPE
    with subprocess.Popen(line, stdin=pipe, stdout=pipe, text=True, encoding="utf-8") as process:
        try:
            yield Forks(process)
        finally:
            process.kill()


@dataclass
class Killed:
    """A run that was killed.

    Attributes
    ----------
    folder, name
        Folder with the rig, and name of the run.
    killed_s
        Time just before the kill, by the clock of the computer.
    """

    folder: Path
    name: str
    killed_s: float

    @property
    def journal(self) -> Path:
        return self.folder / "out" / f"{self.name}.journal"

    @property
    def recording(self) -> Path:
        return self.journal.with_suffix(".nc")


def kill_runs(
    start: Start, folder: Path, delays_s: list[float], first: int = 0, *, from_sampling: bool = False
) -> list[Killed]:
    """Run in real time in parallel, and kill each run a delay after its start or, `from_sampling`, its first sample."""
    words = ("bench", "run", "protocol.toml", "--rig", "rig.toml", "--out", "out", "--real-time", "--name")
    delay_s = {f"k{number}": delay for number, delay in enumerate(delays_s, first)}
    alive = {name: start(folder, *words, name) for name in delay_s}
    begin_s = {} if from_sampling else dict.fromkeys(delay_s, time.monotonic())
    killed = []
    while alive:
        for name in list(alive):
            run = Killed(folder, name, time.time())
            if name not in begin_s and (run.journal.exists() or run.recording.exists()):
                begin_s[name] = time.monotonic()
            if time.monotonic() - begin_s.get(name, math.inf) >= delay_s[name]:
                process = alive.pop(name)
                process.kill()
                process.wait()
                killed.append(run)
            else:
                assert not alive[name].poll()  # running, or ended without an error
        time.sleep(0.005)
    return killed
