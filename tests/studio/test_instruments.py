"""The tabs of the bench and of the microscope: a run is seen live, and each number is that of the command."""

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
from solen.studio.calls import Call, perform
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
    """Desk of a saved design, onto which a micrograph and a recording were dropped."""
    folder = tmp_path_factory.mktemp("desk")
    made = Workspace(Document(Path(write_text(folder / "sensor.toml", template("solen-860")))))
    made.storage.folder.mkdir()
    for name in ("lens-simulated.ome.tif", "rotation-simulated.csv"):
        (made.storage.folder / name).write_bytes((FOLDER / name).read_bytes())
    return made


def called(workspace: Workspace, command: str, asked: dict[str, Any]) -> tuple[Call, Path]:
    offer = tabs.offer(command)
    folder = workspace.storage.new_folder(offer.short)
    return offer.call(asked, workspace.storage.path, folder, workspace.document.path), folder


@pytest.fixture
def answered(workspace: Workspace, capsys: pytest.CaptureFixture[str]) -> Any:
    """What a tab shows, which must be what its command line answers, and what was reported meanwhile."""

    def run(command: str, asked: dict[str, Any], *forced: str) -> tuple[dict[str, Any], list[dict[str, Any]], Path]:
        call, folder = called(workspace, command, asked)
        reported: list[dict[str, Any]] = []
        found = perform(lambda **news: reported.append(news), call, printed)
        json.dumps([found["result"], reported])
        assert run_command([*shlex.split(call.shell)[1:], *forced, "--json"]) == 0
        assert json.loads(capsys.readouterr().out) == found["result"]
        return found["result"], reported, folder

    return run


def test_a_lens_is_inspected_between_two_marks_and_used(workspace: Workspace, answered: Any) -> None:
    """The image has 6 µm per pixel: marks 500 pixels apart are 3 mm, and a pixel of a click is 0.3 % of that."""
    bar = [100.0, 330.0, 600.0, 330.0, 3000.0]
    result, _, folder = answered("print inspect", {"image": "lens-simulated.ome.tif", "bar": bar})
    assert result["scale"]["um_per_px"] == pytest.approx(6.0)
    assert result["scale"]["u_um_per_px"] == pytest.approx(6.0 * 2**0.5 / 500.0)
    state = workspace.document.change(
        {"lens.shape": "measured", "lens.profile": f"{workspace.storage.folder.name}/{folder.name}/lens.json"}
    )
    assert state.sensor.is_measured
    workspace.document.step(-1)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"bar": (0, 0, 3, 4, 100)}, "5 pixels"),
        ({"bar": (0, 0, 300, 400, 100), "um_per_px": 6.0}, "--um-per-px"),
        ({"bar": (0, 0, 300, 400, 100), "scale": "a.toml"}, "--scale"),
        ({"bar": (0, 0, 300, 400, -1)}, "-1"),
        ({"bar": (0, 0, 300)}, "bar"),
    ],
)
def test_a_bar_that_states_no_scale_is_refused(given: dict[str, Any], named: str) -> None:
    with pytest.raises(Exception, match=named):
        ScaleOptions(**given)


def test_a_simulated_rig_is_run_and_seen_live(workspace: Workspace) -> None:
    call, rig = called(workspace, "bench new", {})
    perform(lambda **_: None, call, printed)
    assert f"{rig.name}/rig.toml" in workspace.storage.names()
    design = workspace.storage.folder / rig.name / "sensor.toml"
    write_text(design, design.read_text(encoding="utf-8").replace("width_mm = 0.2", "width_mm = 0.0"))  # soon traced
    (workspace.storage.folder / "short.toml").write_text(PROTOCOL, encoding="utf-8")
    assert workspace.commands_for("bench", "short.toml")["suits"] == ("bench run",)
    call, folder = called(workspace, "bench run", {"protocol": "short.toml", "rig": f"{rig.name}/rig.toml", "seed": 3})
    reported: list[dict[str, Any]] = []
    found = perform(lambda **news: reported.append(news), call, printed)
    assert call.shell.split()[:3] == ["solen", "bench", "run"]
    assert found["result"]["outcome"] == "done"
    assert f"{folder.name}/short.nc" in workspace.storage.names(), "for what follows"
    course = reported[-1]["live"]
    assert len(course["columns"]) == 1 + len(course["names"]) == 9, "time, and an input each"
    assert all(0.0 <= one <= 1.0 for column in course["columns"][1:] for one in column)


def test_a_recording_is_analysed_calibrated_and_decoded(workspace: Workspace, answered: Any) -> None:
    files = ["rotation-simulated.csv"]
    result, _, _ = answered("bench analyse", {"files": files})
    assert result["simulated"]
    call, calibrated = called(workspace, "bench calibrate", {"recordings": files, "sensor": "S1"})
    perform(lambda **_: None, call, printed)
    asked = {"source": files[0], "calibration": f"{calibrated.name}/calibration.json"}
    decoded, reported, _ = answered("bench decode", asked, "--force")
    shown = reported[-1]["live"]
    assert shown["axis"] == "angle / °"
    time, angle, low, high = shown["columns"]
    assert time[-1] == pytest.approx(decoded["to_s"], rel=0.02)
    assert min(angle) >= decoded["lowest_deg"]
    assert max(angle) <= decoded["highest_deg"]
    assert all(a <= b <= c for a, b, c in zip(low, angle, high, strict=True))


def test_a_long_course_is_thinned_out_evenly() -> None:
    reported: list[Any] = []
    course = LiveCurve(lambda **news: reported.append(news))
    for n in range(10 * MAX_POINTS):
        course.add((float(n), 2.0 * n), ("twice",), "twice")
    course.report(("twice",), "twice")
    time, twice = reported[-1]["live"]["columns"]
    assert len(time) < MAX_POINTS
    steps = {b - a for a, b in pairwise(time)}
    assert len(steps) == 1
    assert twice == [2.0 * one for one in time]


def test_a_reading_that_is_missing_leaves_a_gap() -> None:
    reported: list[Any] = []
    angles = Angles(lambda **news: reported.append(news))
    angles.write("time_s,force_N,low95_N,high95_N\n0.0,1.0,0.9,1.1\n0.1,,,\n")
    angles.flush()
    assert reported[-1]["live"]["axis"] == "force / N"
    assert reported[-1]["live"]["columns"][1][0] == 1.0
    assert reported[-1]["live"]["columns"][1][1] != reported[-1]["live"]["columns"][1][1], "no number"
