"""Work in the background: a function in a separate process, whose progress and result every page of a document shows.

A process that has finished its work waits for the next job, because importing the modules of a command takes a second
or two. A cancelled process is killed, because a thread could not be stopped within a trace. A process ends by itself
when its parent is gone. Files that a job has written are kept, whatever happens to page and server.
"""

import importlib
import multiprocessing
import signal
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from threading import Lock, Thread
from typing import Any, Literal, Protocol

from solen.errors import SolenError, SpecError

MAX_RUNNING, MAX_KEPT = 3, 60
"""Largest number of jobs that run at a time, and of finished jobs whose results are still shown."""
ENDED = "ended unexpectedly: see the terminal; files already written are kept"
State = Literal["running", "done", "cancelled", "failed"]


class SendNews(Protocol):
    """Function that reports progress: ``share`` is the completed fraction, other keys are the work's own."""

    def __call__(self, **news: Any) -> None:
        """Send a report."""


Work = Callable[..., Mapping[str, Any]]
"""Function of a module that accepts a `SendNews` and the given arguments, and returns the final content of its job."""


class Process:
    """A process that runs one job after another."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve_jobs, args=(theirs,), daemon=True, name="solen-job")
        self.process.start()
        theirs.close()

    def end(self) -> None:
        """Kill the process."""
        self.process.terminate()
        self.process.join()


def _serve_jobs(pipe: Connection) -> None:
    """Run jobs in this process until its parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C stops the studio, which ends this process
    with suppress(EOFError, OSError):
        while True:
            work, given = pipe.recv()
            if isinstance(work, str):
                importlib.import_module(work)
            else:
                pipe.send(run_work(pipe, work, given))


def run_work(pipe: Connection, work: Work, given: Sequence[Any]) -> dict[str, Any]:
    """Run the work; send its reports, and return its final report."""

    def send_news(**news: Any) -> None:
        try:
            pipe.send(news)
        except OSError:
            raise SystemExit from None  # nobody listens

    try:
        return {"state": "done", "share": 1.0, **work(send_news, *given)}
    except SolenError as bad:
        return {"state": "failed", "why": str(bad)}
    except Exception:
        traceback.print_exc(file=sys.stderr)
        return {"state": "failed", "why": ENDED}


class Job:
    """Work for a document.

    Attributes
    ----------
    number, name
        Number among the document's jobs, and the command, such as ``resin cure``.
    news
        Reports so far: ``state``, ``share`` of the work that is done, and the work's own keys.
    version
        Incremented with each change.
    """

    def __init__(self, number: int, name: str, about: Mapping[str, Any], jobs: "Jobs") -> None:
        self.number, self.name, self.about, self.jobs = number, name, about, jobs
        self.lock, self.version = Lock(), 1
        self.news: dict[str, Any] = {"state": "running", "share": 0.0}
        self.process: Process | None = None

    @property
    def state(self) -> State:
        """Whether the job runs, or how it ended."""
        found: State = self.news["state"]
        return found

    @property
    def result(self) -> Any:
        """Its result as plain data; None if there is none yet."""
        return self.news.get("result")

    def head(self) -> dict[str, Any]:
        """Return the job as a page shows it, without its result."""
        with self.lock:
            shown = {key: value for key, value in self.news.items() if key != "result"}
            return {"kind": "job", "number": self.number, "name": self.name, **self.about, **shown}

    def begin(self, work: Work, given: Sequence[Any]) -> None:
        """Send work to a process, and listen to its reports."""
        self.process = self.jobs.process()
        self.process.pipe.send((work, given))
        Thread(target=self._listen, args=(self.process,), daemon=True).start()

    def cancel(self) -> None:
        """Stop the work; its reports and files are kept."""
        self._becomes({"state": "cancelled"})
        process, self.process = self.process, None
        if process is not None:
            process.end()

    def _becomes(self, news: Mapping[str, Any]) -> None:
        with self.lock:
            if self.state == "running":
                self.news |= news
                self.version += 1

    def _listen(self, process: Process) -> None:
        """Receive the reports of the process until the work ends."""
        with suppress(EOFError, OSError):
            while self.state == "running":
                self._becomes(process.pipe.recv())
        self._becomes({"state": "failed", "why": ENDED})
        if self.state != "cancelled":
            self.process = None
            self.jobs.wait(process)


class Jobs:
    """All jobs of a document, the newest last."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.all: list[Job] = []
        self.idle: list[Process] = []

    def begin(self, name: str, work: Work, given: Sequence[Any], about: Mapping[str, Any]) -> Job:
        """Start a job.

        Parameters
        ----------
        name
            The command.
        given
            Arguments of the work after its `SendNews`; they are pickled.
        about
            Content that a page shows from the start.

        Raises
        ------
        SpecError
            If too many jobs are running.
        """
        with self.lock:
            running = [one for one in self.all if one.state == "running"]
            if len(running) >= MAX_RUNNING:
                limit = f"{MAX_RUNNING} are running"
                raise SpecError("work in the background", limit=limit, remedy=f"wait, or cancel {running[0].name}")
            ended = [one for one in self.all if one.state != "running"][-MAX_KEPT:]
            job = Job(self.all[-1].number + 1 if self.all else 1, name, about, self)
            self.all = sorted([*ended, *running, job], key=lambda one: one.number)
        job.begin(work, given)
        return job

    def ended(self, name: str, about: Mapping[str, Any], news: Mapping[str, Any]) -> None:
        """Add a job that ended in an earlier session."""
        job = Job(self.all[-1].number + 1 if self.all else 1, name, about, self)
        job.news |= {**news, "state": "done", "share": 1.0}
        self.all = [*self.all, job][-MAX_KEPT:]

    def of(self, number: int) -> Job:
        """Return a job by its number; raise `SpecError` if it does not exist."""
        for job in self.all:
            if job.number == number:
                return job
        raise SpecError("job", value=number, limit="is unknown", remedy="begin it again")

    def warm(self, modules: Sequence[str]) -> None:
        """Prepare a process that has imported the given modules."""
        process = self.process()
        for module in modules:
            process.pipe.send((module, ()))
        self.wait(process)

    def process(self) -> Process:
        """Return a process that waits for work."""
        with self.lock:
            while self.idle:
                process = self.idle.pop()
                if process.process.is_alive():
                    return process
        return Process()

    def wait(self, process: Process) -> None:
        """Keep a process for the next job, unless another one is waiting."""
        with self.lock:
            if not self.idle and process.process.is_alive():
                self.idle.append(process)
                return
        process.end()

    def end(self) -> None:
        """Stop all jobs when the server stops."""
        for job in self.all:
            if job.state == "running":
                job.cancel()
        for process in self.idle:
            process.end()
        self.idle = []
