"""Tabs: requests from a page give the same results as the command line and Python."""

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
from solen.studio.calls import Call, run_call
from solen.studio.document import Document
from solen.studio.jobs import Job
from solen.studio.storage import JOB, Storage, safe_name
from solen.studio.workspace import CommandRequest, Workspace


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """Workspace of a design with dropped files."""
    workspace = Workspace(Document(tmp_path_factory.mktemp("desk") / "sensor.toml"))
    workspace.document.save()
    stored = workspace.storage.folder
    stored.mkdir()
    for name in ("layer", "exposures", "absorbance", "cube", "discs", "guides"):
        (stored / f"{name}.csv").write_bytes((FOLDER / f"{name}-simulated.csv").read_bytes())
    (stored / "lens.ome.tif").write_bytes((FOLDER / "lens-simulated.ome.tif").read_bytes())
    (stored / "notes.csv").write_text("apples,pears\n1,2\n2,3\n3,5\n")
    return workspace


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


def call_of(workspace: Workspace, command: str, values: Mapping[str, Any], folder: Path) -> Call:
    """The call for a request from a page."""
    folder.mkdir(exist_ok=True)
    return tabs.command(command).call(values, workspace.storage.path, folder, workspace.document.path)


def without_files(result: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in result.items() if key != "files"}


@pytest.mark.parametrize("command", ASKED)
def test_tab_result_equals_that_of_command(
    command: str, workspace: Workspace, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = call_of(workspace, command, ASKED[command], tmp_path / "a")
    reports: list[Any] = []
    content = run_call(lambda **status: reports.append(status), call, printed)
    json.dumps(content["result"], allow_nan=False)
    figure = (tmp_path / "a" / "figure.svg").read_bytes()

    assert run_command([*shlex.split(call.shell)[1:], "--json"]) == 0
    printed_result = json.loads(capsys.readouterr().out)
    assert content["result"] == printed_result, "each number"
    assert (tmp_path / "a" / "figure.svg").read_bytes() == figure


def test_lines_and_python_script_agree_with_command(
    workspace: Workspace, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = call_of(workspace, "resin cure", ASKED["resin cure"], tmp_path / "a")
    lines = run_call(lambda **_: None, call, printed)["lines"]
    assert run_command(shlex.split(call.shell)[1:]) == 0
    assert capsys.readouterr().out.splitlines()[: len(lines)] == lines
    names: dict[str, Any] = {}
    exec(call.python, names)  # noqa: S102  the script shown on the page
    assert names["found"].result.Dp_um > 0.0
    assert "\n".join(printed("resin cure", names["found"].result)) == "\n".join(lines)


def test_only_tuning_log_is_written_next_to_design(workspace: Workspace) -> None:
    folder = workspace.storage.folder / "tune-1"
    call = call_of(workspace, "print tune", {"image": "lens.ome.tif", "response": False, "sheet_only": True}, folder)
    assert call.values["log"] == workspace.document.path.with_name("sensor-tuning.json")
    assert (call.values["design"], call.values["out"]) == (workspace.document.path, folder)
    assert call.shell.endswith(
        f"--sheet-only --log {call.values['log']} --no-response --figure {folder / 'figure.svg'}"
    )
    assert tabs.suitable_commands("print", workspace.storage.path("lens.ome.tif")) == ("print tune",)


def test_serves_only_layers_in_archive(workspace: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = workspace.storage.folder / "layers-1"
    content = run_call(lambda **_: None, call_of(workspace, "print layers", ASKED["print layers"], folder), None)
    job = Job(1, "print layers", {}, workspace.document.jobs)
    job.status |= content
    monkeypatch.setattr(workspace.document.jobs, "all", [job])
    rows = json.loads(workspace.member(1, "layers", "job.json"))["layers"]
    assert len(rows) == content["result"]["layers"]
    assert workspace.member(1, "layers", rows[0]["file"]).startswith(b"\x89PNG")
    for name, part in (("layers", "../job.json"), ("placed", "1.png"), ("out", "1.png")):
        with pytest.raises(SpecError):
            workspace.member(1, name, part)


def test_finished_jobs_are_restored_in_new_session(tmp_path: Path) -> None:
    workspace = Workspace(Document(tmp_path / "sensor.toml"))
    folder = workspace.storage.new_folder("show")
    about = {"label": "Show a resin", "folder": folder.name, "shell": "", "python": ""}
    call = call_of(workspace, "resin show", {"name": "pmma"}, folder)
    content = run_call(lambda **_: None, call, printed, about, folder / JOB)
    reopened = Workspace(Document(tmp_path / "sensor.toml"))
    (job,) = reopened.document.jobs.all
    assert job.head()["label"] == "Show a resin"
    assert (job.state, job.result) == ("done", content["result"])
    assert reopened.file_of(1, "figure").exists()
    assert reopened.storage.names() == []
    for text in ("{", '{"name": "a", "about": {}, "news": {"files": {"a": "/etc/passwd"}}}'):
        (folder / JOB).write_text(text)
        assert Workspace(Document(tmp_path / "sensor.toml")).document.jobs.all == []


def test_command_requires_saved_design(tmp_path: Path) -> None:
    workspace = Workspace(Document(tmp_path / "sensor.toml"))
    with pytest.raises(SpecError, match="save the design"):
        workspace.start(CommandRequest(command="export"))


def test_resin_built_from_results_is_saved_next_to_design(workspace: Workspace) -> None:
    stored = workspace.storage.folder
    run_call(lambda **_: None, call_of(workspace, "resin cutback", ASKED["resin cutback"], stored / "cutback-1"), None)
    assert "cutback-1/cutback.json" in workspace.storage.names()
    values = {"name": "my resin", "cutback": "cutback-1/cutback.json"}
    call = call_of(workspace, "resin build", values, stored / "build-1")
    run_call(lambda **_: None, call, printed)
    file = workspace.document.path.with_name("my resin.toml")
    assert f"--cutback {stored / 'cutback-1' / 'cutback.json'}" in call.shell
    workspace.document.change({"material.index": 1.5})
    workspace.document.change({"material.resin": "pmma", "material.index": None})
    with pytest.raises(OutputError, match="exists"):
        run_call(lambda **_: None, call, None)
    assert file.exists()


@pytest.mark.parametrize(
    ("name", "first"),
    [
        *(("discs", "cure"), ("guides", "cutback"), ("layer", "index")),
        *(("absorbance", "penetration"), ("cube", "stiffness"), ("exposures", "exposures")),
    ],
)
def test_detects_commands_for_file(workspace: Workspace, name: str, first: str) -> None:
    assert workspace.suitable_commands("resin", f"{name}.csv")["suits"][0] == f"resin {first}"


def test_reports_columns_of_unsuitable_file(workspace: Workspace) -> None:
    reports = workspace.suitable_commands("resin", "notes.csv")
    assert reports["suits"] == ()
    assert "apples, pears" in reports["why"]


@pytest.mark.parametrize(
    ("values", "message"),
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
def test_refuses_invalid_values_before_start(workspace: Workspace, values: dict[str, Any], message: str) -> None:
    before = workspace.storage.names()
    with pytest.raises(SpecError, match=message):
        workspace.start(CommandRequest(command="resin cure", asked=values))
    assert workspace.storage.names() == before
    assert not list(workspace.storage.folder.glob("cure-*"))
    assert workspace.document.jobs.all == []


def test_only_commands_of_tabs_are_available() -> None:
    for name in ("studio", "doctor", "resin", ""):
        with pytest.raises(SpecError):
            tabs.command(name)


@pytest.mark.parametrize(
    ("name", "stored"),
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
def test_safe_name_contains_no_path(name: str, stored: str) -> None:
    assert safe_name(name) == stored


@pytest.mark.parametrize("name", tabs.TABS)
def test_first_options_exist_in_form(name: str) -> None:
    for command in tabs.commands_of(name):
        assert set(command.first) <= command.form()["fields"].keys(), command.name


def test_dropped_files_are_kept_completely_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored = Storage(tmp_path / "kept")

    async def parts(*chunks: bytes) -> AsyncIterator[bytes]:
        for part in chunks:
            yield part

    def keep(name: str, *chunks: bytes) -> str:
        return anyio.run(lambda: stored.keep(name, parts(*chunks)))

    assert keep("a.csv", b"1", b"2") == "a.csv"
    assert keep("../a.csv", b"12") == "a.csv", "same content"
    assert keep("a.csv", b"3") == "a-2.csv"
    monkeypatch.setattr(storage, "MAX_FILE_BYTES", 3)
    with pytest.raises(SolenError, match="larger"):
        keep("b.csv", b"12", b"34")
    assert sorted(path.name for path in (tmp_path / "kept").iterdir()) == ["a-2.csv", "a.csv"]
