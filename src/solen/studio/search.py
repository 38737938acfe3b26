"""A background search for better designs: `solen explore optimise` as a job for the open design.

Every traced response is stored in a folder next to the design file, so that a search can be continued after it was
cancelled or the studio was closed.
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
from solen.studio.jobs import Reporter

DEFAULT_EVALUATIONS = 140
"""Number of designs to try, unless a page requests another number."""


class SearchRequest(Strict):
    """Request for a search from a page: the options of `solen explore optimise` without files."""

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
    evaluations: int = Field(DEFAULT_EVALUATIONS, ge=20, le=100_000, description="Designs tried.")

    def options(self, folder: Path) -> OptimiseOptions:
        """Return the request as options of the search; paths are relative to a folder."""
        is_front = len(self.minimise) + len(self.maximise) > 1
        given_options = self.model_dump(exclude={"process"} | (set() if is_front else {"front"}), exclude_defaults=True)
        given_options |= {"evaluations": self.evaluations} | ({"front": self.front} if is_front else {})
        return OptimiseOptions(**given_options | ({"process": folder / self.process} if self.process else {}))


class Search:
    """A search that starts from one state of a document.

    Attributes
    ----------
    base, text
        The state at the start, and the text of the file that was open.
    folder
        Folder in which responses are stored as they are traced.
    job
        The job; ``rows`` in its status contains the designs on the front so far, and at the end the front traced again.
    """

    def __init__(self, document: Document, request: SearchRequest) -> None:
        self.base, self.text = document.state, document.text
        self.folder = document.path.absolute().with_name(f"{document.path.stem}-search")
        goals = [f"{word} {text}" for word in ("minimise", "maximise") for text in getattr(request, word)]
        details = {"goals": goals, "folder": self.folder.name, "shell": _command_line(document, request, self.folder)}
        arguments = (self.base.design, request.options(self.folder.parent), self.folder)
        self.job = document.jobs.start("explore optimise", work, arguments, {"rows": [], **details})

    def values_of(self, number: int) -> dict[str, Any]:
        """Return the values of the free parameters of a design on the front, keyed by dotted key."""
        for row in self.job.head()["rows"]:
            if row["number"] == number:
                values: dict[str, Any] = row["values"]
                return values
        raise SpecError("design", value=number, limit="is no longer on the front", remedy="select another design")


def work(report: Reporter, design: Design, options: OptimiseOptions, folder: Path) -> Mapping[str, Any]:
    """Run the search, and report each change."""
    keys = sorted({text.partition("=")[0].partition("[")[0] for text in options.free})

    def report_designs(front: Sequence[NondominatedDesign]) -> None:
        report(rows=[_row(design.number, design.design, keys, _so_far(design)) for design in front])

    result = optimise(design, options, Store(folder), lambda share: report(share=share), report_designs)
    rows = [_row(number, design, keys, goals) for number, design, goals in _results(result)]
    return {"rows": rows, "before": _goals_of(result.before), "warnings": result.warnings, "traced": result.traced}


def _row(number: int, design: Design, keys: Sequence[str], goals: dict[str, Any]) -> dict[str, Any]:
    return {"number": number, "values": {key: value_at(design, key) for key in keys}, **goals}


def _so_far(design: NondominatedDesign) -> dict[str, Any]:
    return {"goals": [goal.goal for goal in design.by_goal], "u_goals": [goal.u_goal for goal in design.by_goal]}


def _goals_of(design: Any) -> dict[str, Any]:
    """Return the goals of a design that was traced again."""
    is_front = isinstance(design, FrontDesign)
    return {
        "goals": design.goals if is_front else [design.goal],
        "u_goals": design.u_goals if is_front else [design.u_goal],
    }


def _results(result: Front | Optimum) -> Iterator[tuple[int, Design, dict[str, Any]]]:
    """Yield number, design and goals of each design of a result."""
    if isinstance(result, Optimum):
        yield 1, result.design, _goals_of(result.after)
        return
    for design in result.designs:
        yield design.number, design.design, _goals_of(design)


def _command_line(document: Document, request: SearchRequest, folder: Path) -> str:
    """Return the search as a command line."""
    changes = {} if document.is_saved else document.state.changes
    if None in changes.values():
        return SAVE_FIRST
    request_values = request.model_dump()
    options = [
        part
        for name in ("minimise", "maximise", "free", "subject_to", "robust")
        for text in request_values[name]
        for part in (f"--{name.replace('_', '-')}", text)
    ]
    options += ["--as-printed"] if request.as_printed else []
    options += ["--process", str(document.path.parent / request.process)] if request.process else []
    final_options = ["--front", str(request.front), "--evaluations", str(request.evaluations), "--out", str(folder)]
    return shlex.join(
        ["solen", "explore", "optimise", str(document.path), *options, *final_options, *assigned(changes)]
    )


def start(document: Document, request: SearchRequest) -> None:
    """Start a search of the open design.

    Raises
    ------
    SolenError
        If a search is running, or the request is malformed.
    """
    with document.lock:
        if document.search is not None and document.search.job.state == "running":
            raise SpecError("search", limit="is already running", remedy="cancel it first")
        Task.of(document.state.design, request.options(document.path.absolute().parent))
        document.search = Search(document, request)


def adopt(document: Document, number: int) -> State:
    """Open a design of the front; raise `SpecError` if there is none, or if the file was reloaded since."""
    search = document.search
    if search is None or search.text is not document.text:
        limit = "is not on a front of the open file"
        raise SpecError("design", value=number, limit=limit, remedy="search again")
    return document.open_state(search.base, search.values_of(number))
