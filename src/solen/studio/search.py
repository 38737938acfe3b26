"""A search for better designs in the background: `solen explore optimise` of the open design, in a process of its own.

The process keeps every traced response in a folder beside the design file, so that a search which was cancelled, or
whose studio was ended or killed, goes on there; it ends by itself when nobody listens any more. What it sends is shown
by all pages of the document, and stays when they are closed.
"""

import multiprocessing
import shlex
import signal
from collections.abc import Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock, Thread
from typing import Any, Literal

from pydantic import Field

from solen.errors import SolenError, SpecError
from solen.explore.optimise import Front, FrontDesign, Grown, OptimiseOptions, Optimum, optimise
from solen.explore.optimise.task import Task
from solen.explore.store import Store
from solen.spec import Design, value_at
from solen.spec.strict import Strict
from solen.studio.commands import SAVE_FIRST, assigned
from solen.studio.document import Document, State

ENDED = "the search ended unexpectedly: see the terminal; what was traced is kept"
TRIED = 140
"""Designs tried, unless a page asks for another number."""


class Sought(Strict):
    """What a page asks of a search: options of `solen explore optimise` without files."""

    minimise: tuple[str, ...] = Field((), max_length=2, description="Values of merits to be made small.")
    maximise: tuple[str, ...] = Field((), max_length=2, description="Values of merits to be made large.")
    free: tuple[str, ...] = Field((), max_length=64, description="Numbers that may change, KEY=LOW:HIGH.")
    subject_to: tuple[str, ...] = Field((), max_length=16, description="Conditions on merits that must hold.")
    front: int = Field(7, ge=3, le=50, description="Designs of the front, where two values are sought.")
    evaluations: int = Field(TRIED, ge=20, le=100_000, description="Designs tried.")

    @property
    def options(self) -> OptimiseOptions:
        """The same as options of the search."""
        is_front = len(self.minimise) + len(self.maximise) > 1
        return OptimiseOptions(**self.model_dump(exclude=set() if is_front else {"front"}))


class Search:
    """A search of one state of a document.

    Attributes
    ----------
    base, text
        What it began with, and the opened text of which that is a change.
    folder
        Where responses are kept as they are traced.
    is
        ``running``, ``done``, ``cancelled`` or ``failed``.
    share
        Share of the designs tried.
    rows
        Designs of the front so far, and in the end that front, traced again.
    version
        Higher with each change.
    """

    def __init__(self, document: Document, sought: Sought) -> None:
        self.base, self.text, self.sought = document.state, document.text, sought
        self.folder = document.path.absolute().with_name(f"{document.path.stem}-search")
        self.shell = _same(document, sought, self.folder)
        self.lock, self.version = Lock(), 1
        self.state: Literal["running", "done", "cancelled", "failed"] = "running"
        self.share = 0.0
        self.rows: list[dict[str, Any]] = []
        self.told: dict[str, Any] = {}
        context = multiprocessing.get_context("spawn")
        self.heard, sender = context.Pipe(duplex=False)
        given = (sender, self.base.design, sought.options, self.folder)
        self.process = context.Process(target=_alone, args=given, daemon=True, name="solen-search")
        self.process.start()
        sender.close()
        Thread(target=self._listen, daemon=True).start()

    def cancel(self) -> None:
        """End the search; what it has traced and the front so far stay."""
        with self.lock:
            if self.state == "running":
                self._becomes(state="cancelled")
        self.process.terminate()
        self.process.join()

    def head(self) -> dict[str, Any]:
        """What a page shows of it."""
        with self.lock:
            named = {"state": self.state, "share": self.share, "rows": self.rows, "goals": self.goals}
            return {"kind": "search", **named, "shell": self.shell, "folder": self.folder.name, **self.told}

    @property
    def goals(self) -> tuple[str, ...]:
        """What is sought, in words of the search."""
        return tuple(f"{word} {text}" for word in ("minimise", "maximise") for text in getattr(self.sought, word))

    def chosen(self, number: int) -> dict[str, Any]:
        """Values of the free numbers of a design of the front, by dotted key."""
        with self.lock:
            for row in self.rows:
                if row["number"] == number:
                    values: dict[str, Any] = row["values"]
                    return values
        raise SpecError("design", value=number, limit="is no longer on the front", remedy="choose another")

    def _becomes(self, **values: Any) -> None:
        for name, value in values.items():
            setattr(self, name, value)
        self.version += 1

    def _listen(self) -> None:
        """Take what the process sends until it ends."""
        with suppress(EOFError, OSError):
            while True:
                news = self.heard.recv()
                with self.lock:
                    if self.state == "running":
                        self._becomes(**news)
        with self.lock:
            if self.state == "running":
                self._becomes(state="failed", told={"why": ENDED})


def _alone(*given: Any) -> None:
    """Work in a process of its own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the studio, which ends this
    work(*given)


def work(sender: Connection, design: Design, options: OptimiseOptions, folder: Path) -> None:
    """Search, and send each change; ends when nobody listens."""
    keys = sorted({text.partition("=")[0].partition("[")[0] for text in options.free})

    def grown(front: Sequence[Grown]) -> None:
        sender.send({"rows": [_row(one.number, one.design, keys, _so_far(one)) for one in front]})

    with suppress(BrokenPipeError, ConnectionError):
        try:
            found = optimise(design, options, Store(folder), lambda share: sender.send({"share": share}), grown)
        except SolenError as bad:
            sender.send({"state": "failed", "told": {"why": str(bad)}})
            return
        rows = [_row(number, one, keys, goals) for number, one, goals in _ends(found)]
        told = {"before": _again(found.before), "warnings": found.warnings, "traced": found.traced}
        sender.send({"state": "done", "share": 1.0, "rows": rows, "told": told})


def _row(number: int, design: Design, keys: Sequence[str], goals: dict[str, Any]) -> dict[str, Any]:
    return {"number": number, "values": {key: value_at(design, key) for key in keys}, **goals}


def _so_far(one: Grown) -> dict[str, Any]:
    return {"goals": [goal.goal for goal in one.by_goal], "u_goals": [goal.u_goal for goal in one.by_goal]}


def _again(one: Any) -> dict[str, Any]:
    """Goals of a design that was traced again."""
    many = isinstance(one, FrontDesign)
    return {"goals": one.goals if many else [one.goal], "u_goals": one.u_goals if many else [one.u_goal]}


def _ends(found: Front | Optimum) -> Iterator[tuple[int, Design, dict[str, Any]]]:
    """Number, design and goals of each design of a result."""
    if isinstance(found, Optimum):
        yield 1, found.design, _again(found.after)
        return
    for one in found.designs:
        yield one.number, one.design, _again(one)


def _same(document: Document, sought: Sought, folder: Path) -> str:
    """The same search from the command line."""
    changes = {} if document.is_saved else document.state.changes
    if None in changes.values():
        return SAVE_FIRST
    asked = sought.model_dump()
    options = [
        part
        for name in ("minimise", "maximise", "free", "subject_to")
        for text in asked[name]
        for part in (f"--{name.replace('_', '-')}", text)
    ]
    ends = ["--front", str(sought.front), "--evaluations", str(sought.evaluations), "--out", str(folder)]
    return shlex.join(["solen", "explore", "optimise", str(document.path), *options, *ends, *assigned(changes)])


def begin(document: Document, sought: Sought) -> None:
    """Begin a search of the open design.

    Raises
    ------
    SolenError
        If one is running, or what is asked is malformed.
    """
    with document.lock:
        if document.search is not None and document.search.state == "running":
            raise SpecError("search", limit="one is running", remedy="cancel it first")
        Task.of(document.state.design, sought.options)
        document.search = Search(document, sought)


def adopted(document: Document, number: int) -> State:
    """Make a design of the front the open one; `SpecError` where there is none, or the file was opened anew since."""
    search = document.search
    if search is None or search.text is not document.text:
        limit = "is not on a front of the file that is open"
        raise SpecError("design", value=number, limit=limit, remedy="search again")
    return document.become(search.base, search.chosen(number))
