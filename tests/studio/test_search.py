"""A search in the background: the front of the command, shown as it grows, and nothing that was traced is lost."""

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
from solen.studio.search import SearchRequest, adopt, begin, work

DESIGN = """schema = 1
name = "a"
[material]
index = 1.44
[motion]
step_deg = 3.0
[emitter]
width_mm = 0.2
"""
SOUGHT = SearchRequest(
    minimise=("abs(null_deg)",),
    maximise=("light",),
    free=("emitter.offset_mm=-0.03:0.03", "lens.focus_mm=15:25"),
    front=3,
    evaluations=30,
)


@pytest.fixture
def document(tmp_path: Path) -> Document:
    (tmp_path / "a.toml").write_text(DESIGN, encoding="utf-8")
    return Document(tmp_path / "a.toml")


def waited(job: Job, until: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    for _ in range(6000):
        if until(head := job.head()):
            return head
        time.sleep(0.02)
    raise AssertionError("it never came")


def test_a_cancelled_search_goes_on_to_the_front_of_the_command(document: Document) -> None:
    document.change({"emitter.offset_mm": 0.02})
    began = document.state
    begin(document, SOUGHT)
    with pytest.raises(SpecError, match="running"):
        begin(document, SOUGHT)
    first = document.search
    assert first is not None
    seen = waited(first.job, lambda head: head["rows"] and head["share"] > 0.2)
    assert seen["state"] == "running", seen
    first.job.cancel()
    assert first.job.state == "cancelled"
    assert first.job.head()["rows"], "what was reached stays"
    traced = len(Store(first.folder).points)
    assert traced > 0, "and what was traced"

    number = first.job.head()["rows"][0]["number"]
    document.change({"material.index": 1.5})
    taken = adopt(document, number)
    assert taken.changes == {**began.changes, **first.chosen(number)}
    assert taken.design.material.index == 1.44, "the design that was found, whatever was changed since"
    assert document.step(-1).design.material.index == 1.5

    document.step(-1)
    done = work(lambda **_: None, began.design, SOUGHT.options(Path()), first.folder)
    exact = optimise(began.design, SOUGHT.options(Path()), Store(first.folder))
    assert isinstance(exact, Front)
    assert exact.traced == 0, "the same search"
    assert done["traced"] <= len(Store(first.folder).points) - traced
    assert [row["goals"] for row in done["rows"]] == [one.goals for one in exact.designs]
    first.job.news |= {"rows": done["rows"]}
    assert adopt(document, 1).design == exact.designs[0].design
    document.save()
    assert load(document.path) == exact.designs[0].design


@pytest.mark.parametrize(
    ("asked", "named"), [({"free": ("lens.focus=1:2",)}, "lens.focus"), ({"minimise": ("price",)}, "price")]
)
def test_what_cannot_be_sought_is_refused_at_once(document: Document, asked: dict[str, Any], named: str) -> None:
    with pytest.raises(SpecError, match=named):
        begin(document, SOUGHT.model_copy(update=asked))
    assert document.search is None
    with pytest.raises(SpecError, match="front"):
        adopt(document, 1)


def test_what_fails_in_a_search_is_said(document: Document) -> None:
    sought = SOUGHT.model_copy(update={"subject_to": ("light > 2",), "maximise": (), "evaluations": 20})
    with pytest.raises(SolenError, match="light > 2"):
        work(lambda **_: None, document.state.design, sought.options(Path()), document.path.parent / "kept")


def test_a_search_may_be_robust_and_as_printed(document: Document) -> None:
    asked = {"minimise": ("linearity_percent",), "free": ("lens.focus_mm=15:25",), "evaluations": 20}
    with pytest.raises(SolenError, match=r"none\.toml"):
        begin(document, SearchRequest(**asked, as_printed=True, process="none.toml"))
    begin(document, SearchRequest(**asked, robust=("emitter.offset_mm=0.02",)))
    assert document.search is not None
    document.search.job.cancel()
    assert "--robust emitter.offset_mm=0.02" in document.search.job.head()["shell"]
