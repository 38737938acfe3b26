"""Workflows for public runners, and links on pages outside the documentation."""

import re
from pathlib import Path

import pytest
import yaml

from tools.pins import PYTHONS, ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
WORKFLOW = ROOT / ".github" / "workflows" / "tests.yml"
OTHER_PAGES = [*sorted(ROOT.glob("*.md")), ROOT / "examples" / "README.md"]


def test_workflow_runs_every_python_on_every_system() -> None:
    text = WORKFLOW.read_text(encoding="utf-8")
    jobs = yaml.safe_load(text)["jobs"]
    matrix = jobs["tests"]["strategy"]["matrix"]
    assert tuple(matrix["python"]) == tuple(PYTHONS)
    assert {name.partition("-")[0] for name in matrix["os"]} == {"ubuntu", "windows", "macos"}
    test_files = re.findall(r"\btests/[\w/]+\.py", text)
    assert len(test_files) >= 6
    assert all((ROOT / name).is_file() for name in test_files)
    assert "never run" in text


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflow_uses_existing_targets(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert set(re.findall(r"run: make (\w+)", text)) <= set(targets)
    jobs = yaml.safe_load(text)["jobs"]
    for job in jobs.values():
        assert job["timeout-minutes"] <= 90
        needed = job.get("needs", [])
        assert {*([needed] if isinstance(needed, str) else needed)} <= jobs.keys()
    assert "never run" in text


@pytest.mark.parametrize("path", OTHER_PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_outside_documentation_are_valid(path: Path) -> None:
    """Links to files and headings; links to other sites are not followed."""
    for link in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        name, _, anchor = link.partition("#")
        if not name.startswith("http"):
            target = path.parent / name if name else path
            assert target.exists(), f"{path.name}: {link}"
            if anchor:
                headings = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.MULTILINE)
                assert anchor in {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}, (
                    link
                )
