"""Workflows of public runners, and pages beside the documentation: what they name is there."""

import re
from pathlib import Path

import pytest
import yaml

from tools.pins import PYTHONS, ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
WORKFLOW = ROOT / ".github" / "workflows" / "tests.yml"
BESIDE = [*sorted(ROOT.glob("*.md")), ROOT / "examples" / "README.md"]


def test_the_workflow_runs_every_python_on_every_system() -> None:
    text = WORKFLOW.read_text(encoding="utf-8")
    jobs = yaml.safe_load(text)["jobs"]
    matrix = jobs["tests"]["strategy"]["matrix"]
    assert tuple(matrix["python"]) == tuple(PYTHONS)
    assert {name.partition("-")[0] for name in matrix["os"]} == {"ubuntu", "windows", "macos"}
    named = re.findall(r"\btests/[\w/]+\.py", text)
    assert len(named) >= 6
    assert all((ROOT / name).is_file() for name in named)
    assert "never run" in text


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_makes_what_there_is_and_says_that_it_was_never_run(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert set(re.findall(r"run: make (\w+)", text)) <= set(targets)
    for job in yaml.safe_load(text)["jobs"].values():
        assert job["timeout-minutes"] <= 90
        needed = job.get("needs", [])
        assert {needed} if isinstance(needed, str) else set(needed) <= set(yaml.safe_load(text)["jobs"])
    assert "never run" in text


@pytest.mark.parametrize("path", BESIDE, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_of_a_page_that_sphinx_does_not_read_lead_somewhere(path: Path) -> None:
    """Files, and headings as their anchors; other sites are not asked."""
    for link in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        name, _, anchor = link.partition("#")
        if not name.startswith("http"):
            target = path.parent / name if name else path
            assert target.exists(), f"{path.name}: {link}"
            if anchor:
                headings = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.MULTILINE)
                assert anchor in {re.sub(r"[^\w -]", "", one.lower()).replace(" ", "-") for one in headings}, link
