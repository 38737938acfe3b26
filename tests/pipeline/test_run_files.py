"""A run writes all of its files or none of them, whatever stops it."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from solen import pipeline
from solen.errors import OutputError, SolenError, SpecError
from solen.spec import template

STEP = "motion.step_deg=3"
PICTURES = {"lens-profile.svg", "response.svg", "rays.svg", "rays-at-the-lens.svg", "rays-without-lens.svg"}
EVERYTHING = PICTURES | {"results.json", "results.csv", "report.html"}


def stop_at_once(share: float) -> None:
    raise KeyboardInterrupt(share)


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("a design") / "sensor.toml"
    target.write_text(template(), encoding="utf-8")
    return target


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("results of one") / "made by the run"


@pytest.fixture(scope="module")
def told() -> list[float]:
    return []


@pytest.fixture(scope="module")
def found(design: Path, out: Path, told: list[float]) -> dict[str, Any]:
    return pipeline.run(design, out, [STEP], told.append)


def test_all_files_are_written_and_named(found: dict[str, Any], out: Path) -> None:
    assert {path.name for path in out.iterdir()} == EVERYTHING
    assert set(found["files"]) == {str(out / name) for name in EVERYTHING}
    assert found["report"] == str(out / "report.html")
    assert all(path.stat().st_size > 500 for path in out.iterdir())


def test_results_on_disk_are_those_returned(found: dict[str, Any], out: Path) -> None:
    data = json.loads((out / "results.json").read_text(encoding="utf-8"))
    for key in ("name", "material", "lens", "summary"):
        assert data[key] == found[key]
    assert data["summary"]["lens"]["from_deg"] == -3.0
    assert data["design"]["motion"]["step_deg"] == 3.0


def test_progress_reaches_the_caller(found: dict[str, Any], told: list[float]) -> None:
    assert found
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_what_is_returned_is_plain_data(found: dict[str, Any]) -> None:
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_a_second_run_replaces_the_files(design: Path, tmp_path: Path) -> None:
    (tmp_path / "results.csv").write_text("old", encoding="utf-8")
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    pipeline.run(design, tmp_path, [STEP, "lens.shape=none"])
    first = (tmp_path / "results.csv").read_bytes()
    assert first.startswith(b"angle_deg,")
    pipeline.run(design, tmp_path, [STEP, "lens.shape=none", "emitter.rays=50"])
    assert (tmp_path / "results.csv").read_bytes() != first
    assert (tmp_path / "notes.txt").read_text(encoding="utf-8") == "mine"


@pytest.mark.xfail(reason="figures of the run before, which this one does not draw, stay beside its report")
def test_no_figure_of_an_earlier_design_stays(design: Path, tmp_path: Path) -> None:
    for name in PICTURES:
        (tmp_path / name).write_text("<svg/>", encoding="utf-8")
    pipeline.run(design, tmp_path, [STEP, "lens.shape=none"])
    assert not (tmp_path / "lens-profile.svg").exists()
    assert not (tmp_path / "rays-without-lens.svg").exists()


def test_the_same_design_gives_the_same_bytes(design: Path, out: Path, found: dict[str, Any], tmp_path: Path) -> None:
    assert found
    command = [sys.executable, "-m", "solen", "run", str(design), "--out", str(tmp_path / "again"), "--set", STEP]
    environment = os.environ | {"PYTHONHASHSEED": "7"}
    subprocess.run(command, check=True, capture_output=True, env=environment)
    for path in out.iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes(), path.name


def test_interrupted_while_tracing_a_new_folder_goes_again(design: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, tmp_path / "new", [STEP], stop_at_once)
    assert list(tmp_path.iterdir()) == []


def test_interrupted_while_tracing_all_folders_made_go_again(design: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, tmp_path / "new" / "inner", [STEP], stop_at_once)
    assert list(tmp_path.iterdir()) == []


def test_interrupted_while_tracing_an_old_folder_stays_as_it_was(design: Path, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("old", encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, tmp_path, [STEP], stop_at_once)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "old"


def test_interrupted_while_writing_no_file_is_half_written(
    design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in EVERYTHING:
        (tmp_path / name).write_text("old", encoding="utf-8")
    synced = []

    def sync(descriptor: int) -> None:
        synced.append(descriptor)
        if len(synced) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", sync)
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, tmp_path, [STEP])
    texts = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()}
    assert texts.keys() == EVERYTHING
    assert len([text for text in texts.values() if text != "old"]) == 2
    for name, text in texts.items():
        assert text == "old" or text.endswith("</svg>\n"), name


@pytest.mark.xfail(reason="files written before the interruption stay, though the command says nothing was written")
def test_interrupted_while_writing_a_new_folder_goes_again(
    design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced = []

    def sync(descriptor: int) -> None:
        synced.append(descriptor)
        if len(synced) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", sync)
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, tmp_path / "new", [STEP])
    assert not (tmp_path / "new").exists()


INTERRUPTIBLE = "import signal, solen.cli; signal.signal(signal.SIGINT, signal.default_int_handler); solen.cli.main()"


@pytest.mark.skipif(sys.platform == "win32", reason="one process cannot send another a Ctrl-C there")
def test_a_real_ctrl_c_leaves_nothing_and_ends_with_130(design: Path, tmp_path: Path) -> None:
    out = tmp_path / "new"
    command = [sys.executable, "-c", INTERRUPTIBLE, "run", str(design), "--out", str(out)]
    fine = ["--set", "motion.step_deg=0.001"]
    running = subprocess.Popen([*command, *fine], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        ends_s = time.monotonic() + 30
        while not out.exists() and time.monotonic() < ends_s and running.poll() is None:
            time.sleep(0.02)
        assert out.exists(), "the run made no folder"
        time.sleep(0.3)
        running.send_signal(signal.SIGINT)
        told, complaint = running.communicate(timeout=30)
    finally:
        running.kill()
    assert running.returncode == 130
    assert told == ""
    assert "Traceback" not in complaint
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("under", ["", "inner"])
def test_a_folder_that_cannot_be_is_refused_before_tracing(design: Path, tmp_path: Path, under: str) -> None:
    file = tmp_path / "file"
    file.write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="cannot be written"):
        pipeline.run(design, file / under if under else file, [STEP], stop_at_once)
    assert file.read_text(encoding="utf-8") == "mine"


def test_a_bad_design_makes_no_folder(design: Path, tmp_path: Path) -> None:
    with pytest.raises(SolenError):
        pipeline.run(design, tmp_path / "new", ["lens.half_width_mm=2.95"])
    with pytest.raises(SpecError):
        pipeline.run(design, tmp_path / "new", ["lens.half_width_mm=-1"])
    assert list(tmp_path.iterdir()) == []
