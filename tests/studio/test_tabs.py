"""Tabs: what a page asks of a command is the command, from the command line and in Python as well."""

import json
import shlex
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any

import anyio
import pytest

from solen.cli import run_command
from solen.cli.design.studio import printed
from solen.errors import OutputError, SolenError, SpecError
from solen.samples import FOLDER
from solen.studio import storage, tabs
from solen.studio.calls import Call, perform
from solen.studio.document import Document
from solen.studio.jobs import Job
from solen.studio.storage import JOB, Storage, safe_name
from solen.studio.workspace import Order, Workspace


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """Desk of a design, onto which files were dropped."""
    made = Workspace(Document(tmp_path_factory.mktemp("desk") / "sensor.toml"))
    made.document.save()
    kept = made.storage.folder
    kept.mkdir()
    for name in ("layer", "exposures", "absorbance", "cube", "discs", "guides"):
        (kept / f"{name}.csv").write_bytes((FOLDER / f"{name}-simulated.csv").read_bytes())
    (kept / "lens.ome.tif").write_bytes((FOLDER / "lens-simulated.ome.tif").read_bytes())
    (kept / "notes.csv").write_text("apples,pears\n1,2\n2,3\n3,5\n")
    return made


ASKED: dict[str, dict[str, Any]] = {
    "resin index": {"file": "layer.csv", "thickness_um": 50, "u_T": 0.001, "u_R": 0.001, "at_nm": ["500", "860"]},
    "resin cure": {"files": ["discs.csv"], "irradiance_mW_per_cm2": 13, "layer_um": "25", "keep_all": True},
    "resin cutback": {"file": "guides.csv", "launched": 800},
    "resin penetration": {"file": "absorbance.csv", "path_um": 93, "led_nm": 385},
    "resin stiffness": {"files": ["cube.csv"], "cube_mm": 10, "fit": ["neo-hookean"]},
    "resin spectra": {"files": ["layer.csv", "absorbance.csv"]},
    "resin show": {"name": "pmma", "at_nm": [860]},
    "export": {"stl": True, "threemf": True},
    "print layers": {"layer_um": 200, "burn_in_layers": 2, "phase_px": [0.5, 0.0], "no_anti_aliasing": False},
}


def called(workspace: Workspace, command: str, asked: Mapping[str, Any], folder: Path) -> Call:
    """The call of what a page asks."""
    folder.mkdir(exist_ok=True)
    return tabs.offer(command).call(asked, workspace.storage.path, folder, workspace.document.path)


def without_files(result: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in result.items() if key != "files"}


@pytest.mark.parametrize("command", ASKED)
def test_a_tab_shows_what_the_command_answers(
    command: str, workspace: Workspace, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = called(workspace, command, ASKED[command], tmp_path / "a")
    told: list[Any] = []
    found = perform(lambda **news: told.append(news), call, printed)
    json.dumps(found["result"], allow_nan=False)
    figure = (tmp_path / "a" / "figure.svg").read_bytes()

    assert run_command([*shlex.split(call.shell)[1:], "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert found["result"] == answer, "each number"
    assert (tmp_path / "a" / "figure.svg").read_bytes() == figure


def test_lines_are_those_of_the_command_and_the_same_in_python_runs(
    workspace: Workspace, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = called(workspace, "resin cure", ASKED["resin cure"], tmp_path / "a")
    lines = perform(lambda **_: None, call, printed)["lines"]
    assert run_command(shlex.split(call.shell)[1:]) == 0
    assert capsys.readouterr().out.splitlines()[: len(lines)] == lines
    names: dict[str, Any] = {}
    exec(call.python, names)  # noqa: S102  what a page offers to copy
    assert names["found"].result.Dp_um > 0.0
    assert "\n".join(printed("resin cure", names["found"].result)) == "\n".join(lines)


def test_the_log_of_tuned_prints_is_beside_the_design_and_all_else_apart(workspace: Workspace) -> None:
    folder = workspace.storage.folder / "tune-1"
    call = called(workspace, "print tune", {"image": "lens.ome.tif", "response": False, "sheet_only": True}, folder)
    assert call.values["log"] == workspace.document.path.with_name("sensor-tuning.json")
    assert (call.values["design"], call.values["out"]) == (workspace.document.path, folder)
    assert call.shell.endswith(
        f"--sheet-only --log {call.values['log']} --no-response --figure {folder / 'figure.svg'}"
    )
    assert tabs.commands_for("print", workspace.storage.path("lens.ome.tif")) == ("print tune",)


def test_layers_are_shown_from_the_archive_and_nothing_else_is(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = workspace.storage.folder / "layers-1"
    found = perform(lambda **_: None, called(workspace, "print layers", ASKED["print layers"], folder), None)
    job = Job(1, "print layers", {}, workspace.document.jobs)
    job.news |= found
    monkeypatch.setattr(workspace.document.jobs, "all", [job])
    rows = json.loads(workspace.inside(1, "layers", "job.json"))["layers"]
    assert len(rows) == found["result"]["layers"]
    assert workspace.inside(1, "layers", rows[0]["file"]).startswith(b"\x89PNG")
    for name, part in (("layers", "../job.json"), ("placed", "1.png"), ("out", "1.png")):
        with pytest.raises(SpecError):
            workspace.inside(1, name, part)


def test_what_a_job_wrote_is_there_again_after_the_studio_ended(tmp_path: Path) -> None:
    workspace = Workspace(Document(tmp_path / "sensor.toml"))
    folder = workspace.storage.new_folder("show")
    about = {"label": "Show a resin", "folder": folder.name, "shell": "", "python": ""}
    call = called(workspace, "resin show", {"name": "pmma"}, folder)
    found = perform(lambda **_: None, call, printed, about, folder / JOB)
    again = Workspace(Document(tmp_path / "sensor.toml"))
    (job,) = again.document.jobs.all
    assert job.head()["label"] == "Show a resin"
    assert (job.state, job.result) == ("done", found["result"])
    assert again.file_of(1, "figure").exists()
    assert again.storage.names() == []
    for text in ("{", '{"name": "a", "about": {}, "news": {"files": {"a": "/etc/passwd"}}}'):
        (folder / JOB).write_text(text)
        assert Workspace(Document(tmp_path / "sensor.toml")).document.jobs.all == []


def test_a_design_that_is_not_saved_is_no_design_of_a_command(tmp_path: Path) -> None:
    workspace = Workspace(Document(tmp_path / "sensor.toml"))
    with pytest.raises(SpecError, match="save the design"):
        workspace.begin(Order(command="export"))


def test_a_resin_of_results_is_saved_beside_the_design(workspace: Workspace) -> None:
    kept = workspace.storage.folder
    perform(lambda **_: None, called(workspace, "resin cutback", ASKED["resin cutback"], kept / "cutback-1"), None)
    assert "cutback-1/cutback.json" in workspace.storage.names()
    asked = {"name": "my resin", "cutback": "cutback-1/cutback.json"}
    call = called(workspace, "resin build", asked, kept / "build-1")
    perform(lambda **_: None, call, printed)
    file = workspace.document.path.with_name("my resin.toml")
    assert f"--cutback {kept / 'cutback-1' / 'cutback.json'}" in call.shell
    workspace.document.change({"material.index": 1.5})
    workspace.document.change({"material.resin": "pmma", "material.index": None})
    with pytest.raises(OutputError, match="exists"):
        perform(lambda **_: None, call, None)
    assert file.exists()


@pytest.mark.parametrize(
    ("name", "first"),
    [
        *(("discs", "cure"), ("guides", "cutback"), ("layer", "index")),
        *(("absorbance", "penetration"), ("cube", "stiffness"), ("exposures", "exposures")),
    ],
)
def test_the_kind_of_a_file_is_detected(workspace: Workspace, name: str, first: str) -> None:
    assert workspace.commands_for("resin", f"{name}.csv")["suits"][0] == f"resin {first}"


def test_what_is_of_no_kind_is_refused_by_its_columns(workspace: Workspace) -> None:
    told = workspace.commands_for("resin", "notes.csv")
    assert told["suits"] == ()
    assert "apples, pears" in told["why"]


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({}, "discs"),
        ({"files": ["../sensor.toml"]}, "sensor.toml"),
        ({"files": ["discs.csv"], "layer_um": -1}, "layer_um"),
        ({"files": ["discs.csv"], "layer_mm": 1}, "layer_mm"),
        ({"files": ["discs.csv"], "out": "/etc/passwd"}, "out"),
        ({"files": ["discs.csv"], "figure": "/etc/passwd"}, "figure"),
        ({"files": ["discs.csv"], "penetration": "/etc/passwd"}, "passwd"),
    ],
)
def test_what_a_command_cannot_take_is_refused_before_it_begins(
    workspace: Workspace, asked: dict[str, Any], named: str
) -> None:
    before = workspace.storage.names()
    with pytest.raises(SpecError, match=named):
        workspace.begin(Order(command="resin cure", asked=asked))
    assert workspace.storage.names() == before
    assert not list(workspace.storage.folder.glob("cure-*"))
    assert workspace.document.jobs.all == []


def test_no_other_command_is_offered() -> None:
    for name in ("studio", "doctor", "resin", ""):
        with pytest.raises(SpecError):
            tabs.offer(name)


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("discs.csv", "discs.csv"),
        ("../../etc/passwd", "passwd"),
        ("C:\\temp\\a b.csv", "a b.csv"),
        ("..", "file"),
        ("", "file"),
        (".bashrc", "bashrc"),
        ("nul.csv", "_nul.csv"),
        ("a\x00\n;rm -rf.csv", "a_rm -rf.csv"),
        ("Schicht 2 s.csv", "Schicht 2 s.csv"),
        ("x" * 300 + ".csv", "x" * 80 + ".csv"),
    ],
)
def test_a_name_leads_nowhere(name: str, kept: str) -> None:
    assert safe_name(name) == kept


@pytest.mark.parametrize("name", tabs.TABS)
def test_options_that_come_first_exist(name: str) -> None:
    for offer in tabs.offers_of(name):
        assert set(offer.first) <= offer.form()["fields"].keys(), offer.name


def test_dropped_files_are_kept_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Storage(tmp_path / "kept")

    async def parts(*some: bytes) -> AsyncIterator[bytes]:
        for part in some:
            yield part

    def keep(name: str, *some: bytes) -> str:
        return anyio.run(lambda: kept.keep(name, parts(*some)))

    assert keep("a.csv", b"1", b"2") == "a.csv"
    assert keep("../a.csv", b"12") == "a.csv", "the same content"
    assert keep("a.csv", b"3") == "a-2.csv"
    monkeypatch.setattr(storage, "MAX_FILE_BYTES", 3)
    with pytest.raises(SolenError, match="larger"):
        keep("b.csv", b"12", b"34")
    assert sorted(path.name for path in (tmp_path / "kept").iterdir()) == ["a-2.csv", "a.csv"]
