"""The workflow of public runners: what it names is there."""

import re

import yaml

from tools.pins import PYTHONS, ROOT

WORKFLOW = ROOT / ".github" / "workflows" / "tests.yml"


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
