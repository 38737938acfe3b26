"""A run leaves whole files, all of them or those there were before, whatever stops it."""

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
PICTURES = {f"{name}.svg" for name in NAMES}
EVERYTHING = PICTURES | {"results.json", "results.csv", "report.html", "sensor.stl", "sensor.3mf"}


FEW = "solen.sensor.effects.KEYS", ("emitter.offset_mm",)
NO_HOLDS: tuple[str, dict[str, str]] = ("solen.sensor.effects.HOLDS", {})
"""A run compares one number of the design here: what it writes is the same with more."""
IN_A_PROCESS = f"""
import solen.cli, solen.sensor.effects
solen.sensor.effects.KEYS = {FEW[1]}
solen.sensor.effects.HOLDS = {NO_HOLDS[1]}
solen.cli.main()
"""


@pytest.fixture(scope="module", autouse=True)
def few_effects() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(*FEW)
        patch.setattr(*NO_HOLDS)
        yield


def stop_at_once(share: float) -> None:
    raise KeyboardInterrupt(share)


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("a design") / "sensor.toml"
    target.write_text(template("paper-860"), encoding="utf-8")
    return target


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("results of one") / "made by the run"


@pytest.fixture(scope="module")
def told() -> list[float]:
    return []


@pytest.fixture(scope="module")
def found(design: Path, out: Path, told: list[float]) -> dict[str, Any]:
    return pipeline.run(design, out=out, set_=[STEP], progress=told.append).to_dict()


def test_all_files_are_written_and_named(found: dict[str, Any], out: Path) -> None:
    assert {path.name for path in out.iterdir()} == EVERYTHING
    assert found["files"] == {"report": str(out / "report.html")}
    assert all(path.stat().st_size > 500 for path in out.iterdir())


def test_results_on_disk_are_those_returned(found: dict[str, Any], out: Path) -> None:
    data = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert data == {key: value for key, value in found.items() if key != "files"}
    assert data["summary"]["lens"]["from_deg"] == -3.0
    assert data["design"]["motion"]["step_deg"] == 6.0


def test_progress_reaches_the_caller(found: dict[str, Any], told: list[float]) -> None:
    assert found
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_what_is_returned_is_plain_data(found: dict[str, Any]) -> None:
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_a_second_run_replaces_the_files(design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(html, "figures", lambda *_: dict.fromkeys(("response", "rays", "rays-at-the-lens"), "<svg/>"))
    (tmp_path / "results.csv").write_text("old", encoding="utf-8")
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    pipeline.run(design, out=tmp_path, set_=[STEP, "lens.shape=none"])
    first = (tmp_path / "results.csv").read_bytes()
    assert first.startswith(b"# simulated by solen, not measured\nangle_deg,")
    pipeline.run(design, out=tmp_path, set_=[STEP, "lens.shape=none", "emitter.rays=50"])
    assert (tmp_path / "results.csv").read_bytes() != first
    assert (tmp_path / "notes.txt").read_text(encoding="utf-8") == "mine"


def test_no_figure_of_an_earlier_design_stays(design: Path, tmp_path: Path) -> None:
    for name in (*PICTURES, "mine.svg"):
        (tmp_path / name).write_text("<svg/>", encoding="utf-8")
    pipeline.run(design, out=tmp_path, set_=[STEP, "lens.shape=none"])
    there = {path.name for path in tmp_path.iterdir()}
    assert there == EVERYTHING - {"lens-profile.svg", "focus.svg", "rays-without-lens.svg"} | {"mine.svg"}
    assert (tmp_path / "mine.svg").read_text(encoding="utf-8") == "<svg/>"
    assert (tmp_path / "rays.svg").read_text(encoding="utf-8") != "<svg/>"


def test_a_folder_that_has_the_name_of_a_figure_not_drawn_stays(
    design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html, "figures", lambda *_: dict.fromkeys(("response", "rays", "rays-at-the-lens"), "<svg/>"))
    (tmp_path / "lens-profile.svg").mkdir()
    found = pipeline.run(design, out=tmp_path, set_=[STEP, "lens.shape=none"])
    assert (tmp_path / "lens-profile.svg").is_dir()
    assert all(path.is_file() for path in found.files.values())


def test_the_same_design_gives_the_same_bytes(design: Path, out: Path, found: dict[str, Any], tmp_path: Path) -> None:
    assert found
    command = [sys.executable, "-c", IN_A_PROCESS, "run", str(design), "--out", str(tmp_path / "again"), "--set", STEP]
    environment = os.environ | {"PYTHONHASHSEED": "7"}
    subprocess.run(command, check=True, capture_output=True, env=environment)
    for path in out.iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes(), path.name


def test_interrupted_while_tracing_a_new_folder_goes_again(design: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path / "new", set_=[STEP], progress=stop_at_once)
    assert list(tmp_path.iterdir()) == []


def test_interrupted_while_tracing_all_folders_made_go_again(design: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path / "new" / "inner", set_=[STEP], progress=stop_at_once)
    assert list(tmp_path.iterdir()) == []


def test_interrupted_while_tracing_an_old_folder_stays_as_it_was(design: Path, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("old", encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path, set_=[STEP], progress=stop_at_once)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "old"


@pytest.fixture(scope="module")
def studied(design: Path) -> DesignStudy:
    return study(open_design(design, [STEP]), practical=True)


@pytest.fixture
def quick(out: Path, found: dict[str, Any], studied: DesignStudy, monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    """What a run is to write, with its study and figures made before, so that writing is all that is left to do."""
    assert found
    drawn = {name.removesuffix(".svg"): (out / name).read_text(encoding="utf-8") for name in PICTURES}
    monkeypatch.setattr(pipeline, "study", lambda *_, **__: studied)
    monkeypatch.setattr(html, "figures", lambda *_: {name: drawn[name] for name in html.FIGURES if name in drawn})
    return {name: (out / name).read_bytes() for name in EVERYTHING}


def interrupt(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, nth: int) -> None:
    """Ctrl-C at the nth call of a function, before it does anything."""
    real, calls = getattr(owner, name), count(1)

    def interrupted(*arguments: Any) -> Any:
        if next(calls) == nth:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(owner, name, interrupted)


def test_a_quick_run_writes_what_a_run_does(design: Path, tmp_path: Path, quick: dict[str, bytes]) -> None:
    pipeline.run(design, out=tmp_path, set_=[STEP])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == quick


@pytest.mark.parametrize("nth", [1, 3, len(EVERYTHING)])
def test_interrupted_before_the_first_rename_nothing_has_changed(
    design: Path, tmp_path: Path, quick: dict[str, bytes], monkeypatch: pytest.MonkeyPatch, nth: int
) -> None:
    for name in quick:
        (tmp_path / name).write_bytes(b"old")
    interrupt(monkeypatch, os, "fsync", nth)
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path, set_=[STEP])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == dict.fromkeys(quick, b"old")


@pytest.mark.parametrize("nth", range(1, len(EVERYTHING) + 1))
def test_interrupted_between_two_renames_every_file_is_the_whole_old_or_the_whole_new_one(
    design: Path, tmp_path: Path, quick: dict[str, bytes], monkeypatch: pytest.MonkeyPatch, nth: int
) -> None:
    for name in quick:
        (tmp_path / name).write_bytes(b"old")
    interrupt(monkeypatch, Path, "replace", nth)
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path, set_=[STEP])
    there = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert there.keys() == quick.keys()
    new = {name for name, data in there.items() if data != b"old"}
    assert len(new) == nth - 1
    assert {name: there[name] for name in new} == {name: quick[name] for name in new}


@pytest.mark.parametrize(("owner", "name"), [(os, "fsync"), (Path, "replace")])
def test_interrupted_before_the_first_file_is_there_a_new_folder_goes_again(
    design: Path, tmp_path: Path, quick: dict[str, bytes], monkeypatch: pytest.MonkeyPatch, owner: Any, name: str
) -> None:
    assert quick
    interrupt(monkeypatch, owner, name, 1 if owner is Path else 3)
    with pytest.raises(KeyboardInterrupt):
        pipeline.run(design, out=tmp_path / "new" / "inner", set_=[STEP])
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_replaced_leaves_all_as_they_were(
    design: Path, tmp_path: Path, quick: dict[str, bytes]
) -> None:
    for name in quick:
        (tmp_path / name).write_bytes(b"old")
    (tmp_path / "report.html").unlink()
    (tmp_path / "report.html").mkdir()
    with pytest.raises(OutputError, match=r"report\.html; cannot be written: not an ordinary file"):
        pipeline.run(design, out=tmp_path, set_=[STEP])
    (tmp_path / "report.html").rmdir()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {
        name: b"old" for name in quick if name != "report.html"
    }


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
        pipeline.run(design, out=file / under if under else file, set_=[STEP], progress=stop_at_once)
    assert file.read_text(encoding="utf-8") == "mine"


def test_a_bad_design_makes_no_folder(design: Path, tmp_path: Path) -> None:
    with pytest.raises(SolenError):
        pipeline.run(design, out=tmp_path / "new", set_=["lens.half_width_mm=2.95"])
    with pytest.raises(SpecError):
        pipeline.run(design, out=tmp_path / "new", set_=["lens.half_width_mm=-1"])
    assert list(tmp_path.iterdir()) == []


def test_an_extruded_design_runs_to_its_report_with_pictures_of_the_plane(design: Path, tmp_path: Path) -> None:
    chosen = ["trace.dimension=extruded", "motion.from_deg=-1", "motion.to_deg=1", "motion.step_deg=2"]
    found = pipeline.run(
        design, out=tmp_path / "out", set_=[*chosen, "emitter.pattern=lambertian", "emitter.cone_deg=60"]
    )
    assert (tmp_path / "out" / "rays.svg").is_file()
    assert isinstance(found.result, DesignStudy)
    assert 0.0 < (found.result.summary["lens"].contrast_from or 0.0) < 1.0


def test_ambient_light_in_space_is_refused(design: Path) -> None:
    with pytest.raises(SolenError, match="also enter through the top and bottom"):
        trace(design, ["trace.dimension=extruded", "emitter.pattern=lambertian", "ambient.power=1"])


def test_ways_of_rays_in_space_are_refused_by_the_name_of_the_option(design: Path) -> None:
    with pytest.raises(SpecError, match=r"^paths; paths are supported only in the plane"):
        trace(design, ["trace.dimension=extruded", "emitter.pattern=lambertian"], paths=True)


def test_ambient_light_is_distinguished(design: Path) -> None:
    found = trace(design, ["ambient.power=0.5", "trace.mode=power"]).result
    assert isinstance(found, DesignTrace)
    for reading in found.detectors.values():
        assert sum(reading.power_by_source) == pytest.approx(reading.power)
        assert min(reading.power_by_source) > 0.0
