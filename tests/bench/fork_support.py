"""Runs of the program in processes forked from one that has loaded it: quick to start, and real processes to kill.

POSIX only.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

SERVER = """
import json, os, signal, sys
import h5netcdf, h5py, pydantic, scipy.interpolate, serial
import solen.bench.board, solen.bench.gcs2, solen.bench.record, solen.bench.simulated.instruments, solen.cli.bench.record
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


@dataclass
class Forks:
    """A server that forks runs of the program."""

    process: "subprocess.Popen[str]"

    def start(self, folder: Path, *words: str) -> "Forked":
        """Start ``solen WORDS`` in a folder."""
        stderr = folder / "stderr"
        pid = self.request("start", str(folder), str(stderr), *words)
        assert pid is not None
        return Forked(self, stderr, pid)

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
    """A run in progress, with the methods of a `subprocess.Popen`; the text on its stderr goes to a file."""

    server: Forks
    stderr: Path
    pid: int

    def send_signal(self, number: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def poll(self) -> int | None:
        """Return the exit code, negative for the signal that ended it; None while it runs."""
        return self.server.request("poll", self.pid)

    def wait(self) -> int | None:
        """Wait until it has ended, and return the exit code."""
        return self.server.request("wait", self.pid)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is not None:
            self.kill()
        self.wait()


@contextlib.contextmanager
def fork_server() -> Iterator[Forks]:
    """Process that has loaded the program."""
    line, pipe = [sys.executable, "-c", SERVER], subprocess.PIPE
    with subprocess.Popen(line, stdin=pipe, stdout=pipe, text=True, encoding="utf-8") as process:
        try:
            yield Forks(process)
        finally:
            process.kill()
