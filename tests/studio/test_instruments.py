"""The bench and microscope tabs: live curves, and results equal to those of the commands."""

import json
import shlex
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from solen.cli import run_command
from solen.cli.design.studio import printed
from solen.files import write_text
from solen.metrology.scale import ScaleOptions
from solen.samples import FOLDER
from solen.spec import template
from solen.studio import tabs
from solen.studio.calls import Call, run_call
from solen.studio.document import Document
from solen.studio.live import MAX_POINTS, Angles, LiveCurve
from solen.studio.workspace import Workspace

PROTOCOL = """schema = 1
name = "short"
cycles = 1
[[step]]
to_deg = -3.0
velocity_deg_per_s = 15.0
[[step]]
to_deg = 3.0
velocity_deg_per_s = 15.0
"""


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """Workspace of a saved design with a dropped micrograph and recording."""
    folder = tmp_path_factory.mktemp("desk")
    workspace = Workspace(Document(Path(write_text(folder / "sensor.toml", template("solen-860")))))
    workspace.storage.folder.mkdir()
    for name in ("lens-simulated.ome.tif", "rotation-simulated.csv"):
        (workspace.storage.folder / name).write_bytes((FOLDER / name).read_bytes())
    return workspace


def call_of(workspace: Workspace, command: str, values: dict[str, Any]) -> tuple[Call, Path]:
    page_command = tabs.command(command)
    folder = workspace.storage.new_folder(page_command.last_word)
    return page_command.call(values, workspace.storage.path, folder, workspace.document.path), folder


@pytest.fixture
def run_in_tab(workspace: Workspace, capsys: pytest.CaptureFixture[str]) -> Any:
    """Run a command in a tab, and check that its result equals that of its command line."""

    def run(
        command: str, values: dict[str, Any], *extra_options: str
    ) -> tuple[dict[str, Any], list[dict[str, Any]], Path]:
        call, folder = call_of(workspace, command, values)
        reports: list[dict[str, Any]] = []
        content = run_call(lambda **status: reports.append(status), call, printed)
        json.dumps([content["result"], reports])
        assert run_command([*shlex.split(call.shell)[1:], *extra_options, "--json"]) == 0
        assert json.loads(capsys.readouterr().out) == content["result"]
        return content["result"], reports, folder

    return run


def test_inspects_lens_with_scale_from_two_marks(workspace: Workspace, run_in_tab: Any) -> None:
    """The image has 6 µm per pixel, so marks 500 pixels apart are 3 mm apart; one pixel is 0.3 % of that."""
    bar = [100.0, 330.0, 600.0, 330.0, 3000.0]
    result, _, folder = run_in_tab("print inspect", {"image": "lens-simulated.ome.tif", "bar": bar})
    assert result["scale"]["um_per_px"] == pytest.approx(6.0)
    assert result["scale"]["u_um_per_px"] == pytest.approx(6.0 * 2**0.5 / 500.0)
    state = workspace.document.change(
        {"lens.shape": "measured", "lens.profile": f"{workspace.storage.folder.name}/{folder.name}/lens.json"}
    )
    assert state.sensor.is_measured
    workspace.document.step(-1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bar": (0, 0, 3, 4, 100)}, "5 pixels"),
        ({"bar": (0, 0, 300, 400, 100), "um_per_px": 6.0}, "--um-per-px"),
        ({"bar": (0, 0, 300, 400, 100), "scale": "a.toml"}, "--scale"),
        ({"bar": (0, 0, 300, 400, -1)}, "-1"),
        ({"bar": (0, 0, 300)}, "bar"),
    ],
)
def test_refuses_bar_that_gives_no_scale(options: dict[str, Any], message: str) -> None:
    with pytest.raises(Exception, match=message):
        ScaleOptions(**options)


def test_runs_simulated_rig_with_live_curve(workspace: Workspace) -> None:
    call, rig = call_of(workspace, "bench new", {})
    run_call(lambda **_: None, call, printed)
    assert f"{rig.name}/rig.toml" in workspace.storage.names()
    design = workspace.storage.folder / rig.name / "sensor.toml"
    write_text(design, design.read_text(encoding="utf-8").replace("width_mm = 0.2", "width_mm = 0.0"))  # fast to trace
    (workspace.storage.folder / "short.toml").write_text(PROTOCOL, encoding="utf-8")
    assert workspace.suitable_commands("bench", "short.toml")["suits"] == ("bench run",)
    call, folder = call_of(workspace, "bench run", {"protocol": "short.toml", "rig": f"{rig.name}/rig.toml", "seed": 3})
    reports: list[dict[str, Any]] = []
    content = run_call(lambda **status: reports.append(status), call, printed)
    assert call.shell.split()[:3] == ["solen", "bench", "run"]
    assert content["result"]["outcome"] == "done"
    assert f"{folder.name}/short.nc" in workspace.storage.names(), "available to other commands"
    curve = reports[-1]["live"]
    assert len(curve["columns"]) == 1 + len(curve["names"]) == 9, "time and eight inputs"
    assert all(0.0 <= value <= 1.0 for column in curve["columns"][1:] for value in column)


def test_analyses_calibrates_and_decodes_recording(workspace: Workspace, run_in_tab: Any) -> None:
    files = ["rotation-simulated.csv"]
    result, _, _ = run_in_tab("bench analyse", {"files": files})
    assert result["simulated"]
    call, calibration_folder = call_of(workspace, "bench calibrate", {"recordings": files, "sensor": "S1"})
    run_call(lambda **_: None, call, printed)
    values = {"source": files[0], "calibration": f"{calibration_folder.name}/calibration.json"}
    decoded, reports, _ = run_in_tab("bench decode", values, "--force")
    printed_lines = reports[-1]["live"]
    assert printed_lines["axis"] == "angle / °"
    time, angle, low, high = printed_lines["columns"]
    assert time[-1] == pytest.approx(decoded["to_s"], rel=0.02)
    assert min(angle) >= decoded["lowest_deg"]
    assert max(angle) <= decoded["highest_deg"]
    assert all(a <= b <= c for a, b, c in zip(low, angle, high, strict=True))


def test_long_curve_is_thinned_out_evenly() -> None:
    reports: list[Any] = []
    curve = LiveCurve(lambda **status: reports.append(status))
    for n in range(10 * MAX_POINTS):
        curve.add((float(n), 2.0 * n), ("twice",), "twice")
    curve.update(("twice",), "twice")
    time, double = reports[-1]["live"]["columns"]
    assert len(time) < MAX_POINTS
    steps = {b - a for a, b in pairwise(time)}
    assert len(steps) == 1
    assert double == [2.0 * value for value in time]


def test_missing_reading_leaves_gap() -> None:
    reports: list[Any] = []
    angles = Angles(lambda **status: reports.append(status))
    angles.write("time_s,force_N,low95_N,high95_N\n0.0,1.0,0.9,1.1\n0.1,,,\n")
    angles.flush()
    assert reports[-1]["live"]["axis"] == "force / N"
    assert reports[-1]["live"]["columns"][1][0] == 1.0
    assert reports[-1]["live"]["columns"][1][1] != reports[-1]["live"]["columns"][1][1], "is NaN"
