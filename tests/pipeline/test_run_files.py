"""Files of a run: either all new files or all previous ones, complete, even if the run is interrupted."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from solen.errors import OutputError, SolenError, SpecError
from solen.pipeline.design import run as pipeline
from solen.pipeline.design.designs import open_design
from solen.pipeline.design.trace import trace
from solen.report.design import html
from solen.sensor import DesignStudy, study
from solen.sensor.traced import DesignTrace
from solen.spec import template

STEP = "motion.step_deg=6"
NAMES = ("lens-profile", "response", "matters", "focus", "rays", "rays-at-the-lens", "rays-without-lens")
FIGURES = {f"{name}.svg" for name in NAMES}
ALL_FILES = FIGURES | {"results.json", "results.csv", "report.html", "sensor.stl", "sensor.3mf"}


ONE_EFFECT = "solen.sensor.effects.KEYS", ("emitter.offset_mm",)
NO_HOLDS: tuple[str, dict[str, str]] = ("solen.sensor.effects.HOLDS", {})
"""Patches that reduce the effects computed in a run to that of one parameter; the files are the same with more."""
PROCESS = f"""
import solen.cli, solen.sensor.effects
solen.sensor.effects.KEYS = {ONE_EFFECT[1]}
solen.sensor.effects.HOLDS = {NO_HOLDS[1]}
solen.cli.main()
"""


@pytest.fixture(scope="module", autouse=True)
def few_effects() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(*ONE_EFFECT)
        patch.setattr(*NO_HOLDS)
        yield


def interrupt_at_once(fraction: float) -> None:
    raise KeyboardInterrupt(fraction)


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("a design") / "sensor.toml"
    target.write_text(template("paper-860"), encoding="utf-8")
    return target


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("results") / "created by the run"


@pytest.fixture(scope="module")
def reported() -> list[float]:
    return []


@pytest.fixture(scope="module")
def results(design: Path, out: Path, reported: list[float]) -> dict[str, Any]:
    return pipeline.run(design, out=out, set_=[STEP], progress=reported.append).to_dict()


def test_writes_all_files(results: dict[str, Any], out: Path) -> None:
    assert {path.name for path in out.iterdir()} == ALL_FILES
    assert results["files"] == {"report": str(out / "report.html")}
    assert all(path.stat().st_size > 500 for path in out.iterdir())


def test_results_file_equals_returned_results(results: dict[str, Any], out: Path) -> None:
    data = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert data == {key: value for key, value in results.items() if key != "files"}
    assert data["summary"]["lens"]["from_deg"] == -3.0
    assert data["design"]["motion"]["step_deg"] == 6.0


def test_reports_progress(results: dict[str, Any], reported: list[float]) -> None:
    assert results
    assert reported == sorted(reported)
    assert reported[-1] == 1.0


def test_returns_plain_data(results: dict[str, Any]) -> None:
    assert json.loads(json.dumps(results, allow_nan=False)) == results


def test_second_run_replaces_files(design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(html, "figures", lambda *_: dict.fromkeys(("response", "rays", "rays-at-the-lens"), "<svg/>"))
    (tmp_path / "results.csv").write_text("old", encoding="utf-8")
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    pipeline.run(design, out=tmp_path, set_=[STEP, "lens.shape=none"])
    first = (tmp_path / "results.csv").read_bytes()
    assert first.startswith(b"# simulated by solen, not measured\nangle_deg,")
    pipeline.run(design, out=tmp_path, set_=[STEP, "lens.shape=none", "emitter.rays=50"])
    assert (tmp_path / "results.csv").read_bytes() != first
    assert (tmp_path / "notes.txt").read_text(encoding="utf-8") == "mine"


def test_removes_figures_of_earlier_design(design: Path, tmp_path: Path) -> None:
    for name in (*FIGURES, "mine.svg"):
        (tmp_path / name).write_text("<svg/>", encoding="utf-8")
    pipeline.run(design, out=tmp_path, set_=[STEP, "lens.shape=none"])
    present = {path.name for path in tmp_path.iterdir()}
    assert present == ALL_FILES - {"lens-profile.svg", "focus.svg", "rays-without-lens.svg"} | {"mine.svg"}
    assert (tmp_path / "mine.svg").read_text(encoding="utf-8") == "<svg/>"
    assert (tmp_path / "rays.svg").read_text(encoding="utf-8") != "<svg/>"


def test_keeps_folder_with_name_of_figure(design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(html, "figures", lambda *_: dict.fromkeys(("response", "rays", "rays-at-the-lens"), "<svg/>"))
    (tmp_path / "lens-profile.svg").mkdir()
    results = pipeline.run(design, out=tmp_path, set_=[STEP, "lens.shape=none"])
    assert (tmp_path / "lens-profile.svg").is_dir()
    assert all(path.is_file() for path in results.files.values())


def test_files_are_reproducible(design: Path, out: Path, results: dict[str, Any], tmp_path: Path) -> None:
    assert results
    command = [sys.executable, "-c", PROCESS, "run", str(design), "--out", str(tmp_path / "again"), "--set", STEP]
    environment = os.environ | {"PYTHONHASHSEED": "7"}
    subprocess.run(command, check=True, capture_output=True, env=environment)
    for path in out.iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes(), path.name


def test_interrupt_while_tracing_removes_new_folder(design: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path / "new", set_=[STEP], progress=interrupt_at_once)
    assert list(tmp_path.iterdir()) == []


def test_interrupt_while_tracing_removes_all_new_folders(design: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path / "new" / "inner", set_=[STEP], progress=interrupt_at_once)
    assert list(tmp_path.iterdir()) == []


def test_interrupt_while_tracing_keeps_existing_folder(design: Path, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("old", encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path, set_=[STEP], progress=interrupt_at_once)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "old"


@pytest.fixture(scope="module")
def traced_study(design: Path) -> DesignStudy:
    return study(open_design(design, [STEP]), practical=True)


@pytest.fixture
def prepared(
    out: Path, results: dict[str, Any], traced_study: DesignStudy, monkeypatch: pytest.MonkeyPatch
) -> dict[str, bytes]:
    """Files that a run must write, keyed by name; its study and figures are replaced by those computed before."""
    assert results
    figures = {name.removesuffix(".svg"): (out / name).read_text(encoding="utf-8") for name in FIGURES}
    monkeypatch.setattr(pipeline, "study", lambda *_, **__: traced_study)
    monkeypatch.setattr(html, "figures", lambda *_: {name: figures[name] for name in html.FIGURES if name in figures})
    return {name: (out / name).read_bytes() for name in ALL_FILES}


def interrupt(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, nth: int) -> None:
    """Raise KeyboardInterrupt at the nth call of a function, before it does anything."""
    function, calls = getattr(owner, name), count(1)

    def interrupted(*arguments: Any) -> Any:
        if next(calls) == nth:
            raise KeyboardInterrupt
        return function(*arguments)

    monkeypatch.setattr(owner, name, interrupted)


def test_prepared_run_writes_same_files(design: Path, tmp_path: Path, prepared: dict[str, bytes]) -> None:
    pipeline.run(design, out=tmp_path, set_=[STEP])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == prepared


@pytest.mark.parametrize("nth", [1, 3, len(ALL_FILES)])
def test_interrupt_before_first_rename_changes_nothing(
    design: Path, tmp_path: Path, prepared: dict[str, bytes], monkeypatch: pytest.MonkeyPatch, nth: int
) -> None:
    for name in prepared:
        (tmp_path / name).write_bytes(b"old")
    interrupt(monkeypatch, os, "fsync", nth)
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path, set_=[STEP])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == dict.fromkeys(prepared, b"old")


@pytest.mark.parametrize("nth", range(1, len(ALL_FILES) + 1))
def test_interrupt_between_renames_leaves_complete_files(
    design: Path, tmp_path: Path, prepared: dict[str, bytes], monkeypatch: pytest.MonkeyPatch, nth: int
) -> None:
    for name in prepared:
        (tmp_path / name).write_bytes(b"old")
    interrupt(monkeypatch, Path, "replace", nth)
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path, set_=[STEP])
    present = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert present.keys() == prepared.keys()
    new = {name for name, data in present.items() if data != b"old"}
    assert len(new) == nth - 1
    assert {name: present[name] for name in new} == {name: prepared[name] for name in new}


@pytest.mark.parametrize(("owner", "name"), [(os, "fsync"), (Path, "replace")])
def test_interrupt_before_first_file_removes_new_folder(
    design: Path, tmp_path: Path, prepared: dict[str, bytes], monkeypatch: pytest.MonkeyPatch, owner: Any, name: str
) -> None:
    assert prepared
    interrupt(monkeypatch, owner, name, 1 if owner is Path else 3)
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path / "new" / "inner", set_=[STEP])
    assert list(tmp_path.iterdir()) == []


def test_irreplaceable_file_leaves_all_files_unchanged(
    design: Path, tmp_path: Path, prepared: dict[str, bytes]
) -> None:
    for name in prepared:
        (tmp_path / name).write_bytes(b"old")
    (tmp_path / "report.html").unlink()
    (tmp_path / "report.html").mkdir()
    with pytest.raises(OutputError, match=r"report\.html; cannot be written: not an ordinary file"):
        pipeline.run(design, out=tmp_path, set_=[STEP])
    (tmp_path / "report.html").rmdir()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {
        name: b"old" for name in prepared if name != "report.html"
    }


INTERRUPTIBLE = "import signal, solen.cli; signal.signal(signal.SIGINT, signal.default_int_handler); solen.cli.main()"


@pytest.mark.skipif(sys.platform == "win32", reason="on Windows, a process cannot send Ctrl-C to another process")
def test_ctrl_c_leaves_nothing_and_returns_130(design: Path, tmp_path: Path) -> None:
    out = tmp_path / "new"
    command = [sys.executable, "-c", INTERRUPTIBLE, "run", str(design), "--out", str(out)]
    many_angles = ["--set", "motion.step_deg=0.001"]
    running = subprocess.Popen([*command, *many_angles], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        deadline_s = time.monotonic() + 30
        while not out.exists() and time.monotonic() < deadline_s and running.poll() is None:
            time.sleep(0.02)
        assert out.exists(), "the run created no folder"
        time.sleep(0.3)
        running.send_signal(signal.SIGINT)
        stdout, stderr = running.communicate(timeout=30)
    finally:
        running.kill()
    assert running.returncode == 130
    assert stdout == ""
    assert "Traceback" not in stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", ["file", "file/inner"])
def test_refuses_invalid_folder_before_tracing(design: Path, tmp_path: Path, folder: str) -> None:
    file = tmp_path / "file"
    file.write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="cannot be written"):
        pipeline.run(design, out=tmp_path / folder, set_=[STEP], progress=interrupt_at_once)
    assert file.read_text(encoding="utf-8") == "mine"


def test_invalid_design_creates_no_folder(design: Path, tmp_path: Path) -> None:
    with pytest.raises(SolenError):
        pipeline.run(design, out=tmp_path / "new", set_=["lens.half_width_mm=2.95"])
    with pytest.raises(SpecError):
        pipeline.run(design, out=tmp_path / "new", set_=["lens.half_width_mm=-1"])
    assert list(tmp_path.iterdir()) == []


def test_run_of_extruded_design(design: Path, tmp_path: Path) -> None:
    set_ = ["trace.dimension=extruded", "motion.from_deg=-1", "motion.to_deg=1", "motion.step_deg=2"]
    outcome = pipeline.run(
        design, out=tmp_path / "out", set_=[*set_, "emitter.pattern=lambertian", "emitter.cone_deg=60"]
    )
    assert (tmp_path / "out" / "rays.svg").is_file()
    assert isinstance(outcome.result, DesignStudy)
    assert 0.0 < (outcome.result.summary["lens"].contrast_from or 0.0) < 1.0


def test_refuses_ambient_light_in_space(design: Path) -> None:
    with pytest.raises(SolenError, match="also enter through the top and bottom"):
        trace(design, ["trace.dimension=extruded", "emitter.pattern=lambertian", "ambient.power=1"])


def test_refuses_paths_of_rays_in_space(design: Path) -> None:
    with pytest.raises(SpecError, match=r"^paths; are supported only in the plane"):
        trace(design, ["trace.dimension=extruded", "emitter.pattern=lambertian"], paths=True)


def test_separates_ambient_light(design: Path) -> None:
    results = trace(design, ["ambient.power=0.5", "trace.mode=power"]).result
    assert isinstance(results, DesignTrace)
    for reading in results.detectors.values():
        assert sum(reading.power_by_source) == pytest.approx(reading.power)
        assert min(reading.power_by_source) > 0.0
