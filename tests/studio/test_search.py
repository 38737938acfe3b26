"""Background searches: they reach the front of the command, report it as it grows, and keep all traced responses."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from solen.errors import SolenError, SpecError
from solen.explore.optimise import Front, optimise
from solen.explore.store import Store
from solen.spec import load
from solen.studio.document import Document
from solen.studio.jobs import Job
from solen.studio.search import SearchRequest, adopt, start, work

DESIGN = """schema = 1
name = "a"
[material]
index = 1.44
[motion]
step_deg = 3.0
[emitter]
width_mm = 0.0
"""
REQUEST = SearchRequest(
    minimise=("abs(null_deg)",),
    maximise=("light",),
    free=("emitter.offset_mm=-0.03:0.03", "lens.focus_mm=15:25"),
    front=3,
    evaluations=60,
)


@pytest.fixture
def document(tmp_path: Path) -> Document:
    (tmp_path / "a.toml").write_text(DESIGN, encoding="utf-8")
    return Document(tmp_path / "a.toml")


def wait_for(job: Job, until: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    for _ in range(6000):
        if until(head := job.head()):
            return head
        time.sleep(0.02)
    raise AssertionError("it never came")


def test_cancelled_search_continues_to_front_of_command(document: Document) -> None:
    document.change({"emitter.offset_mm": 0.02})
    start_state = document.state
    start(document, REQUEST)
    with pytest.raises(SpecError, match="running"):
        start(document, REQUEST)
    search = document.search
    assert search is not None
    head = wait_for(search.job, lambda head: head["rows"] and head["share"] > 0.2)
    assert head["state"] == "running", head
    search.job.cancel()
    assert search.job.state == "cancelled"
    assert search.job.head()["rows"], "the designs found so far are kept"
    traced = len(Store(search.folder).points)
    assert traced > 0, "the traced responses are kept"

    number = search.job.head()["rows"][0]["number"]
    document.change({"material.index": 1.5})
    opened_state = adopt(document, number)
    assert opened_state.changes == {**start_state.changes, **search.values_of(number)}
    assert opened_state.design.material.index == 1.44, "the design on the front, without later changes"
    assert document.step(-1).design.material.index == 1.5

    document.step(-1)
    content = work(lambda **_: None, start_state.design, REQUEST.options(Path()), search.folder)
    reference = optimise(start_state.design, REQUEST.options(Path()), Store(search.folder))
    assert isinstance(reference, Front)
    assert reference.traced == 0, "the search is identical"
    assert content["traced"] <= len(Store(search.folder).points) - traced
    assert [row["goals"] for row in content["rows"]] == [design.goals for design in reference.designs]
    search.job.status |= {"rows": content["rows"]}
    assert adopt(document, 1).design == reference.designs[0].design
    document.save()
    assert load(document.path) == reference.designs[0].design


@pytest.mark.parametrize(
    ("changes", "message"), [({"free": ("lens.focus=1:2",)}, "lens.focus"), ({"minimise": ("price",)}, "price")]
)
def test_refuses_invalid_search_at_once(document: Document, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        start(document, REQUEST.model_copy(update=changes))
    assert document.search is None
    with pytest.raises(SpecError, match="front"):
        adopt(document, 1)


def test_reports_failure_of_search(document: Document) -> None:
    request = REQUEST.model_copy(update={"subject_to": ("light > 2",), "maximise": (), "evaluations": 20})
    with pytest.raises(SolenError, match="light > 2"):
        work(lambda **_: None, document.state.design, request.options(Path()), document.path.parent / "kept")


def test_search_may_be_robust_and_as_printed(document: Document) -> None:
    changes = {"minimise": ("linearity_percent",), "free": ("lens.focus_mm=15:25",), "evaluations": 20}
    with pytest.raises(SolenError, match=r"none\.toml"):
        start(document, SearchRequest(**changes, as_printed=True, process="none.toml"))
    start(document, SearchRequest(**changes, robust=("emitter.offset_mm=0.02",)))
    assert document.search is not None
    document.search.job.cancel()
    assert "--robust emitter.offset_mm=0.02" in document.search.job.head()["shell"]
