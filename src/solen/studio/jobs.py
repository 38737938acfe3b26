"""Work in the background: a function in a process of its own, whose progress and answer every page of a document sees.

A process that ended its work waits for the next, as importing what a command needs takes a second or two; one that is
cancelled is killed, which no thread could be within a trace. It ends by itself when nobody listens any more. What a job
has written stays, whatever becomes of page and server.
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

MOST_RUNNING, MOST_KEPT = 3, 60
"""Jobs at a time, and ended ones of which the answer is still shown."""
ENDED = "ended unexpectedly: see the terminal; what was written is kept"
State = Literal["running", "done", "cancelled", "failed"]


class Tell(Protocol):
    """How work sends what is new of it: ``share`` is the completed share, all else is the work's own."""

    def __call__(self, **news: Any) -> None:
        """Send it."""


Work = Callable[..., Mapping[str, Any]]
"""A function of a module that takes a `Tell` and what was given, and returns what its job shows in the end."""


class Process:
    """A process that works for one job after another."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_alone, args=(theirs,), daemon=True, name="solen-job")
        self.process.start()
        theirs.close()

    def end(self) -> None:
        """Kill it."""
        self.process.terminate()
        self.process.join()


def _alone(pipe: Connection) -> None:
    """Work in a process of its own, until nobody listens."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the studio, which ends this
    with suppress(EOFError, OSError):
        while True:
            work, given = pipe.recv()
            if isinstance(work, str):
                importlib.import_module(work)
            else:
                pipe.send(worked(pipe, work, given))


def worked(pipe: Connection, work: Work, given: Sequence[Any]) -> dict[str, Any]:
    """What is new at the end of work; what it tells meanwhile is sent."""

    def tell(**news: Any) -> None:
        try:
            pipe.send(news)
        except OSError:
            raise SystemExit from None  # nobody listens

    try:
        return {"state": "done", "share": 1.0, **work(tell, *given)}
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
        Number among the document's jobs, and what it does, as ``resin cure``.
    news
        What it has reported: ``state``, ``share`` of the work that is done, and the work's own.
    version
        Higher with each change.
    """

    def __init__(self, number: int, name: str, about: Mapping[str, Any], jobs: "Jobs") -> None:
        self.number, self.name, self.about, self.jobs = number, name, about, jobs
        self.lock, self.version = Lock(), 1
        self.news: dict[str, Any] = {"state": "running", "share": 0.0}
        self.process: Process | None = None

    @property
    def state(self) -> State:
        """Whether it runs, and else how it ended."""
        found: State = self.news["state"]
        return found

    @property
    def result(self) -> Any:
        """Its result as plain data; None while there is none."""
        return self.news.get("result")

    def head(self) -> dict[str, Any]:
        """The job as a page shows it, without its result."""
        with self.lock:
            shown = {key: value for key, value in self.news.items() if key != "result"}
            return {"kind": "job", "number": self.number, "name": self.name, **self.about, **shown}

    def begin(self, work: Work, given: Sequence[Any]) -> None:
        """Send work to a process, and listen to its reports."""
        self.process = self.jobs.process()
        self.process.pipe.send((work, given))
        Thread(target=self._listen, args=(self.process,), daemon=True).start()

    def cancel(self) -> None:
        """End the work; what it has reported and written stays."""
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
        """Take what the process sends until the work ends."""
        with suppress(EOFError, OSError):
            while self.state == "running":
                self._becomes(process.pipe.recv())
        self._becomes({"state": "failed", "why": ENDED})
        if self.state != "cancelled":
            self.process = None
            self.jobs.wait(process)


class Jobs:
    """All work of a document, the newest last."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.all: list[Job] = []
        self.idle: list[Process] = []

    def begin(self, name: str, work: Work, given: Sequence[Any], about: Mapping[str, Any]) -> Job:
        """Begin work.

        Parameters
        ----------
        name
            What it does, in the words of a command.
        given
            Arguments of the work after its `Tell`; they are pickled.
        about
            What a page shows of it from the start.

        Raises
        ------
        SpecError
            If too much is running.
        """
        with self.lock:
            running = [one for one in self.all if one.state == "running"]
            if len(running) >= MOST_RUNNING:
                limit = f"{MOST_RUNNING} are running"
                raise SpecError("work in the background", limit=limit, remedy=f"wait, or cancel {running[0].name}")
            ended = [one for one in self.all if one.state != "running"][-MOST_KEPT:]
            job = Job(self.all[-1].number + 1 if self.all else 1, name, about, self)
            self.all = sorted([*ended, *running, job], key=lambda one: one.number)
        job.begin(work, given)
        return job

    def ended(self, name: str, about: Mapping[str, Any], news: Mapping[str, Any]) -> None:
        """Add work that was done at an earlier time."""
        job = Job(self.all[-1].number + 1 if self.all else 1, name, about, self)
        job.news |= {**news, "state": "done", "share": 1.0}
        self.all = [*self.all, job][-MOST_KEPT:]

    def of(self, number: int) -> Job:
        """A job by its number; `SpecError` where there is none."""
        for job in self.all:
            if job.number == number:
                return job
        raise SpecError("job", value=number, limit="is unknown", remedy="begin it again")

    def warm(self, modules: Sequence[str]) -> None:
        """Have a process ready that has imported modules."""
        process = self.process()
        for module in modules:
            process.pipe.send((module, ()))
        self.wait(process)

    def process(self) -> Process:
        """A process that waits for work."""
        with self.lock:
            while self.idle:
                process = self.idle.pop()
                if process.process.is_alive():
                    return process
        return Process()

    def wait(self, process: Process) -> None:
        """Let a process wait for the next job, unless one does."""
        with self.lock:
            if not self.idle and process.process.is_alive():
                self.idle.append(process)
                return
        process.end()

    def end(self) -> None:
        """End all work, as the server ends."""
        for job in self.all:
            if job.state == "running":
                job.cancel()
        for process in self.idle:
            process.end()
        self.idle = []
