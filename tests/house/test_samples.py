"""Sample data are complete, are reported as simulated by all readers, and never overwrite a file."""

import json
import re
from pathlib import Path

import pytest

from solen.cli import run_command
from solen.cli.design.schema import commands
from solen.metrology.image import read_plane
from solen.pipeline.project.examples import examples
from solen.recording import read
from solen.samples import FOLDER, MEASURED, readme, sample, simulated_name
from tests.command_support import refusal


def test_readme_names_existing_commands_and_files(tmp_path: Path) -> None:
    copied = examples(out=tmp_path / "samples").result
    listed = re.findall(r"^\| `([^`]+)` \|.*\| `solen ([^`]+)` \|$", readme(), re.MULTILINE)
    assert len(listed) == len(MEASURED) + 5
    for name, command in listed:
        assert (copied.folder / name).exists(), name
        assert any(command.startswith(f"{known} ") for known in commands()), command
    assert copied.count == sum(path.is_file() for path in copied.folder.rglob("*"))
    assert {path.name for path in FOLDER.iterdir()} == {simulated_name(item.name) for item in MEASURED} | {"scene.json"}


def test_commands_in_readme_calibrate_and_decode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    examples(out=tmp_path / "samples")
    monkeypatch.chdir(tmp_path / "samples")
    lines = re.findall(r"`solen (bench (?:calibrate|decode) [^`]+)`", readme())
    assert [line.split()[1] for line in lines] == ["calibrate", "decode"]
    for line in lines:
        assert run_command(line.split()) == 0, capsys.readouterr().err


@pytest.mark.parametrize("name", list(dict.fromkeys(simulated_name(item.name) for item in MEASURED)))
def test_readers_report_samples_as_simulated(name: str) -> None:
    path = FOLDER / name
    if path.suffix == ".csv":
        assert sample(name).startswith(b"# simulated")
        assert read(path).provenance.simulated
    elif path.suffix in {".png", ".tif"}:
        assert read_plane(path)[1].simulated
    elif path.suffix == ".json":
        assert json.loads(sample(name))["simulated"] is True
    assert path.stat().st_size < 130_000


def test_refuses_to_overwrite_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "sensor.toml").write_text("mine", encoding="utf-8")
    assert "sensor.toml" in refusal(capsys, tmp_path, "project", "examples", "--out", str(tmp_path))
    assert run_command(["project", "examples", "--out", str(tmp_path / "new")]) == 0
