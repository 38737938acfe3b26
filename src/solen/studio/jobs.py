"""Background jobs: functions in separate processes, whose progress and result every page of a document shows.

A process that has finished its work waits for the next job, because importing the modules of a command takes a second
or two. To cancel a job, its process is killed; a thread could not be stopped during a trace. A process exits when its
parent has exited. Files that a job has written are kept, whatever happens to page and server.
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
"""Maximum number of jobs that run at a time, and of finished jobs whose results are shown."""
ENDED = "ended unexpectedly: see the terminal; files already written are kept"
State = Literal["running", "done", "cancelled", "failed"]


class Reporter(Protocol):
    """Function that reports progress: ``share`` is the completed fraction, other keys depend on the work."""

    def __call__(self, **values: Any) -> None:
        """Send a report."""


Work = Callable[..., Mapping[str, Any]]
"""Function of a module that accepts a `Reporter` and the given arguments, and returns the final status of its job."""


class Process:
    """A process that runs one job after another."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, child_end = context.Pipe()
        self.process = context.Process(target=_serve_jobs, args=(child_end,), daemon=True, name="solen-job")
        self.process.start()
        child_end.close()

    def end(self) -> None:
        """Kill the process."""
        self.process.terminate()
        self.process.join()


def _serve_jobs(pipe: Connection) -> None:
    """Run jobs in this process until its parent has exited."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C stops the studio, which then ends this process
    with suppress(EOFError, OSError):
        while True:
            work, arguments = pipe.recv()
            if isinstance(work, str):
                importlib.import_module(work)
            else:
                pipe.send(run_work(pipe, work, arguments))


def run_work(pipe: Connection, work: Work, arguments: Sequence[Any]) -> dict[str, Any]:
    """Run the work and send its reports; return the final status."""

    def report(**values: Any) -> None:
        try:
            pipe.send(values)
        except OSError:
            raise SystemExit from None  # the parent has exited

    try:
        return {"state": "done", "share": 1.0, **work(report, *arguments)}
    except SolenError as bad:
        return {"state": "failed", "why": str(bad)}
    except Exception:
        traceback.print_exc(file=sys.stderr)
        return {"state": "failed", "why": ENDED}


class Job:
    """A job for a document.

    Attributes
    ----------
    number, name
        Number among the jobs of the document, and the command, such as ``resin cure``.
    status
        Values reported so far: ``state``, the completed fraction ``share``, and keys that depend on the work.
    version
        Number that is incremented with each change.
    """

    def __init__(self, number: int, name: str, details: Mapping[str, Any], jobs: "Jobs") -> None:
        self.number, self.name, self.details, self.jobs = number, name, details, jobs
        self.lock, self.version = Lock(), 1
        self.status: dict[str, Any] = {"state": "running", "share": 0.0}
        self.process: Process | None = None

    @property
    def state(self) -> State:
        """Whether the job runs, or how it ended."""
        state: State = self.status["state"]
        return state

    @property
    def result(self) -> Any:
        """The result as plain data; None if there is none yet."""
        return self.status.get("result")

    def head(self) -> dict[str, Any]:
        """Return the description of the job for a page, without its result."""
        with self.lock:
            visible = {key: value for key, value in self.status.items() if key != "result"}
            return {"kind": "job", "number": self.number, "name": self.name, **self.details, **visible}

    def start(self, work: Work, arguments: Sequence[Any]) -> None:
        """Send work to a process, and receive its reports."""
        self.process = self.jobs.process()
        self.process.pipe.send((work, arguments))
        Thread(target=self._listen, args=(self.process,), daemon=True).start()

    def cancel(self) -> None:
        """Stop the work; its status and files are kept."""
        self._update({"state": "cancelled"})
        process, self.process = self.process, None
        if process is not None:
            process.end()

    def _update(self, status: Mapping[str, Any]) -> None:
        with self.lock:
            if self.state == "running":
                self.status |= status
                self.version += 1

    def _listen(self, process: Process) -> None:
        """Receive the reports of the process until the work ends."""
        with suppress(EOFError, OSError):
            while self.state == "running":
                self._update(process.pipe.recv())
        self._update({"state": "failed", "why": ENDED})
        if self.state != "cancelled":
            self.process = None
            self.jobs.keep_idle(process)


class Jobs:
    """All jobs of a document, the newest last."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.all: list[Job] = []
        self.idle: list[Process] = []

    def start(self, name: str, work: Work, arguments: Sequence[Any], details: Mapping[str, Any]) -> Job:
        """Start a job.

        Parameters
        ----------
        name
            The command.
        work, arguments
            Function to run, and its arguments after its `Reporter`; they are pickled.
        details
            Description of the job that a page shows from the start.

        Raises
        ------
        SpecError
            If too many jobs are running.
        """
        with self.lock:
            running = [job for job in self.all if job.state == "running"]
            if len(running) >= MAX_RUNNING:
                limit = f"at most {MAX_RUNNING} may run at a time"
                raise SpecError("background jobs", limit=limit, remedy=f"wait, or cancel {running[0].name}")
            finished = [job for job in self.all if job.state != "running"][-MAX_KEPT:]
            job = Job(self.all[-1].number + 1 if self.all else 1, name, details, self)
            self.all = sorted([*finished, *running, job], key=lambda job: job.number)
        job.start(work, arguments)
        return job

    def add_finished(self, name: str, details: Mapping[str, Any], status: Mapping[str, Any]) -> None:
        """Add a job that was finished in an earlier session."""
        job = Job(self.all[-1].number + 1 if self.all else 1, name, details, self)
        job.status |= {**status, "state": "done", "share": 1.0}
        self.all = [*self.all, job][-MAX_KEPT:]

    def by_number(self, number: int) -> Job:
        """Return a job by its number; raise `SpecError` if it does not exist."""
        for job in self.all:
            if job.number == number:
                return job
        raise SpecError("job", value=number, limit="is unknown", remedy="start it again")

    def prepare(self, modules: Sequence[str]) -> None:
        """Start a process that imports the given modules for later jobs."""
        process = self.process()
        for module in modules:
            process.pipe.send((module, ()))
        self.keep_idle(process)

    def process(self) -> Process:
        """Return an idle process, or a new one."""
        with self.lock:
            while self.idle:
                process = self.idle.pop()
                if process.process.is_alive():
                    return process
        return Process()

    def keep_idle(self, process: Process) -> None:
        """Keep a process for the next job, unless another one is idle."""
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
