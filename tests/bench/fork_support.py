"""Runs of the program in processes of their own, forked from one that has loaded it: quick to start, real to kill.

POSIX only.
"""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

FORKS = """
import json, os, signal, sys
import h5netcdf, h5py, pydantic, scipy.interpolate, serial
import solen.bench.board, solen.bench.gcs2, solen.bench.record, solen.cli.bench.record
from solen.cli import run_command

for line in sys.stdin:
    folder, said, *words = json.loads(line)
    child = os.fork()
    if child == 0:
        os.chdir(folder)
        for stream, name in ((0, os.devnull), (1, os.devnull), (2, said)):
            os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | os.O_TRUNC), stream)
        os._exit(run_command(words))
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@dataclass
class Forked:
    """A run under way."""

    by: "subprocess.Popen[str]"
    said: Path
    pid: int

    def kill(self, number: int) -> None:
        """Send it a signal."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, number)

    def wait(self) -> tuple[int, str]:
        """Exit code, below 0 for the signal that killed it, and what it wrote to stderr."""
        assert self.by.stdout is not None
        return int(self.by.stdout.readline()), self.said.read_text(encoding="utf-8")


@dataclass
class Forks:
    """What starts runs, one after the other has ended."""

    by: "subprocess.Popen[str]"

    def start(self, folder: Path, *words: str) -> Forked:
        """Begin ``solen WORDS`` in a folder."""
        assert self.by.stdin is not None
        assert self.by.stdout is not None
        said = folder / "stderr"
        self.by.stdin.write(json.dumps([str(folder), str(said), *words]) + "\n")
        self.by.stdin.flush()
        return Forked(self.by, said, int(self.by.stdout.readline()))


@contextlib.contextmanager
def forks() -> Iterator[Forks]:
    """A process that has loaded the program."""
    line, pipe = [sys.executable, "-c", FORKS], subprocess.PIPE
    with subprocess.Popen(line, stdin=pipe, stdout=pipe, text=True, encoding="utf-8") as by:
        try:
            yield Forks(by)
        finally:
            by.kill()
