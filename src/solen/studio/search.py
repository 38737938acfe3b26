"""A search for better designs in the background: the job of `solen explore optimise` for the open design.

Every traced response is stored in a folder next to the design file, so a search continues there after it was cancelled
or the studio was closed.
"""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from solen.errors import SpecError
from solen.explore.optimise import Front, FrontDesign, NondominatedDesign, OptimiseOptions, Optimum, optimise
from solen.explore.optimise.task import Task
from solen.explore.store import Store
from solen.spec import Design, value_at
from solen.spec.strict import Strict
from solen.studio.commands import SAVE_FIRST, assigned
from solen.studio.document import Document, State
from solen.studio.jobs import SendNews

TRIED = 140
"""Number of designs tried, unless a page requests another number."""


class SearchRequest(Strict):
    """Request of a page for a search: options of `solen explore optimise` without files."""

    minimise: tuple[str, ...] = Field((), max_length=2, description="Merits to minimise.")
    maximise: tuple[str, ...] = Field((), max_length=2, description="Merits to maximise.")
    free: tuple[str, ...] = Field((), max_length=64, description="Parameters that may change, KEY=LOW:HIGH.")
    subject_to: tuple[str, ...] = Field((), max_length=16, description="Conditions on merits that must hold.")
    robust: tuple[str, ...] = Field(
        (), max_length=16, description="Deviations of parameters to allow for, KEY=DEVIATION."
    )
    as_printed: bool = Field(False, description="Whether each design is traced with the lens that the process prints.")
    process: str | None = Field(
        None, max_length=4096, description="File of a printer's process, relative to the design."
    )
    front: int = Field(7, ge=3, le=50, description="Number of designs on the front for a search with two merits.")
    evaluations: int = Field(TRIED, ge=20, le=100_000, description="Designs tried.")

    def options(self, folder: Path) -> OptimiseOptions:
        """Return the request as options of the search; paths are relative to a folder."""
        is_front = len(self.minimise) + len(self.maximise) > 1
        stated = self.model_dump(exclude={"process"} | (set() if is_front else {"front"}), exclude_defaults=True)
        stated |= {"evaluations": self.evaluations} | ({"front": self.front} if is_front else {})
        return OptimiseOptions(**stated | ({"process": folder / self.process} if self.process else {}))


class Search:
    """A search of one state of a document.

    Attributes
    ----------
    base, text
        The state at the start, and the opened text that it is a change of.
    folder
        Folder in which responses are stored as they are traced.
    job
        Its job: ``rows`` of its news are the designs on the front so far, and at the end that front, traced again.
    """

    def __init__(self, document: Document, sought: SearchRequest) -> None:
        self.base, self.text = document.state, document.text
        self.folder = document.path.absolute().with_name(f"{document.path.stem}-search")
        goals = [f"{word} {text}" for word in ("minimise", "maximise") for text in getattr(sought, word)]
        about = {"goals": goals, "folder": self.folder.name, "shell": _command_line(document, sought, self.folder)}
        given = (self.base.design, sought.options(self.folder.parent), self.folder)
        self.job = document.jobs.begin("explore optimise", work, given, {"rows": [], **about})

    def chosen(self, number: int) -> dict[str, Any]:
        """Return the values of the free parameters of a design on the front, by dotted key."""
        for row in self.job.head()["rows"]:
            if row["number"] == number:
                values: dict[str, Any] = row["values"]
                return values
        raise SpecError("design", value=number, limit="is no longer on the front", remedy="choose another")


def work(send_news: SendNews, design: Design, options: OptimiseOptions, folder: Path) -> Mapping[str, Any]:
    """Search, and report each change."""
    keys = sorted({text.partition("=")[0].partition("[")[0] for text in options.free})

    def report_designs(front: Sequence[NondominatedDesign]) -> None:
        send_news(rows=[_row(one.number, one.design, keys, _so_far(one)) for one in front])

    found = optimise(design, options, Store(folder), lambda share: send_news(share=share), report_designs)
    rows = [_row(number, one, keys, goals) for number, one, goals in _results(found)]
    return {"rows": rows, "before": _goals_of(found.before), "warnings": found.warnings, "traced": found.traced}


def _row(number: int, design: Design, keys: Sequence[str], goals: dict[str, Any]) -> dict[str, Any]:
    return {"number": number, "values": {key: value_at(design, key) for key in keys}, **goals}


def _so_far(one: NondominatedDesign) -> dict[str, Any]:
    return {"goals": [goal.goal for goal in one.by_goal], "u_goals": [goal.u_goal for goal in one.by_goal]}


def _goals_of(one: Any) -> dict[str, Any]:
    """Return the goals of a design that was traced again."""
    many = isinstance(one, FrontDesign)
    return {"goals": one.goals if many else [one.goal], "u_goals": one.u_goals if many else [one.u_goal]}


def _results(found: Front | Optimum) -> Iterator[tuple[int, Design, dict[str, Any]]]:
    """Yield number, design and goals of each design of a result."""
    if isinstance(found, Optimum):
        yield 1, found.design, _goals_of(found.after)
        return
    for design in found.designs:
        yield design.number, design.design, _goals_of(design)


def _command_line(document: Document, sought: SearchRequest, folder: Path) -> str:
    """Return the same search as a command line."""
    changes = {} if document.is_saved else document.state.changes
    if None in changes.values():
        return SAVE_FIRST
    asked = sought.model_dump()
    options = [
        part
        for name in ("minimise", "maximise", "free", "subject_to", "robust")
        for text in asked[name]
        for part in (f"--{name.replace('_', '-')}", text)
    ]
    options += ["--as-printed"] if sought.as_printed else []
    options += ["--process", str(document.path.parent / sought.process)] if sought.process else []
    ends = ["--front", str(sought.front), "--evaluations", str(sought.evaluations), "--out", str(folder)]
    return shlex.join(["solen", "explore", "optimise", str(document.path), *options, *ends, *assigned(changes)])


def begin(document: Document, sought: SearchRequest) -> None:
    """Start a search of the open design.

    Raises
    ------
    SolenError
        If a search is running, or the request is malformed.
    """
    with document.lock:
        if document.search is not None and document.search.job.state == "running":
            raise SpecError("search", limit="one is running", remedy="cancel it first")
        Task.of(document.state.design, sought.options(document.path.absolute().parent))
        document.search = Search(document, sought)


def adopt(document: Document, number: int) -> State:
    """Open a design of the front; `SpecError` if there is none, or the file was opened again since."""
    search = document.search
    if search is None or search.text is not document.text:
        limit = "is not on a front of the open file"
        raise SpecError("design", value=number, limit=limit, remedy="search again")
    return document.open_state(search.base, search.chosen(number))
