"""`solen trace SCENE.json`: both formats, output and errors."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from solen.cli import run_command
from solen.curve import Arc, Segment
from solen.report.design.figures import rays_figure, sensor_view
from solen.scene import Fan, Interface, Monitor, Rays, Region, Scene, save
from solen.sensor import Sensor
from solen.trace import integrate, options

LAMP = {"type": "SingleRay", "p1": {"x": 0, "y": 0}, "p2": {"x": 1, "y": 0}, "brightness": 0.5}
RAYOPTICS_SCENE = {
    "version": 5,
    "name": "a lamp and a screen",
    "objs": [
        LAMP,
        {"type": "Detector", "p1": {"x": 9, "y": -4}, "p2": {"x": 9, "y": 3}, "irradMap": True, "binSize": 2},
        {"type": "Detector", "p1": {"x": 8, "y": -4}, "p2": {"x": 8, "y": 3}, "name": "all"},
        {"type": "Hologram"},
    ],
}


@pytest.fixture
def rayoptics_file(tmp_path: Path) -> Path:
    file = tmp_path / "peer.json"
    file.write_text(json.dumps(RAYOPTICS_SCENE), encoding="utf-8")
    return file


@pytest.fixture
def solen_file(tmp_path: Path) -> Path:
    wall = Interface("wall", Segment((20.0, -5.0), (20.0, 5.0)), "air", "air", "receiver", "eye")
    rays = Rays(((0.0, 0.0), (0.0, 1.0)), ((1.0, 0.0), (1.0, 0.0)))
    return save(
        tmp_path / "own.JSON",
        Scene((Region("air", 1.0),), (wall,), (rays,), (Monitor("line", (9.0, 4.0), (9.0, -4.0), 4),)),
    )


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert run_command(["trace", *arguments]) == 0
    result = capsys.readouterr()
    assert not result.err
    return result.out


def test_traces_rayoptics_scene_in_its_units(rayoptics_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result: dict[str, Any] = json.loads(printed(capsys, str(rayoptics_file), "--json"))
    assert result["name"] == "a lamp and a screen"
    assert result["format"] == "ray-optics"
    detector = result["readings"]["detector1"]
    assert (detector["position"], detector["irradiance"]) == ([0, 2, 4, 6], [0, 0, 0.25, 0])
    detector_without_bins = result["readings"]["all"]
    assert (
        detector_without_bins["power"],
        detector_without_bins["u_power"],
        detector_without_bins["rays"],
        detector_without_bins["position"],
    ) == (0.5, None, 1, None)
    assert result["emitted"] == 0.5
    reason = "solen does not support this type of object"
    assert result["not_understood"] == [{"object": 4, "type": "Hologram", "key": None, "reason": reason}]
    lines = printed(capsys, str(rayoptics_file)).splitlines()
    assert lines[0] == "a lamp and a screen (ray-optics), 1 rays, mode power"
    assert "all       0.5 ± unknown  (1 rays)" in lines[2]
    assert lines[-1] == f"ignored: object 4, Hologram: {reason}"


def test_traces_rayoptics_scene_with_engine(rayoptics_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = json.loads(printed(capsys, str(rayoptics_file), "--json", "--mode", "power"))
    assert result["readings"]["detector1"]["irradiance"] == [0, 0, 0.25, 0]


def test_traces_solen_scene(solen_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = json.loads(printed(capsys, str(solen_file), "--json", "--paths"))
    assert result["detectors"]["eye"]["power"] == 1.0
    assert result["readings"]["eye"]["power"] == 1.0
    line = result["readings"]["line"]
    assert (line["power"], line["position"], line["irradiance"]) == (1.0, [0, 2, 4, 6], [0, 0.25, 0.25, 0])
    assert result["ledger"]["detected"] == 1.0
    assert len(result["branches"]) == 2


def test_draws_figure_of_scene(rayoptics_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figure = tmp_path / "drawn.svg"
    assert f"figure: {figure}" in printed(capsys, str(rayoptics_file), "--figure", str(figure))
    assert "a lamp and a screen" in figure.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--angle-deg", "0"), "--angle-deg = 0.0; applies to designs"),
        (("--no-lens",), "--no-lens; applies to designs"),
        (("--set", "lens.focus_mm=3"), "--set = 'lens.focus_mm=3'; applies to designs"),
        (("--rays", "7"), "--rays = 7; applies to designs"),
        (("--mode", "guess"), "guess"),
        (("--sampling", "sobol"), "add --mode power"),
        (("--histogram", "7"), "add --mode power"),
        (("--figure", "drawn.gif"), "a figure must end in"),
    ],
)
def test_refuses_options_that_do_not_apply_to_scene(
    arguments: tuple[str, ...], message: str, rayoptics_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(["trace", str(rayoptics_file), *arguments]) == 2
    result = capsys.readouterr()
    assert not result.out
    assert message in result.err
    assert result.err.count("\n") == 1


@pytest.mark.parametrize("content", ["{", "[]", '{"a": 1}', '{"version": 3, "objs": []}', '{"solen_scene": 9}'])
def test_refuses_invalid_scene_file(content: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "scene.json"
    file.write_text(content, encoding="utf-8")
    assert run_command(["trace", str(file)]) == 2
    assert str(file) in capsys.readouterr().err


def test_integration_refuses_monitors(solen_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["trace", str(solen_file), "--sampling", "adaptive"]) == 2
    assert "evaluates only receivers, but this scene has monitors" in capsys.readouterr().err


@pytest.fixture
def stop(tmp_path: Path) -> Path:
    """A lamp with a stop in front of it, inside a ring that detects."""
    black = Interface("stop", Segment((0.3, 3.0), (2.0, 3.0)), "air", "air", "absorbing")
    ring = Interface("ring", Arc.circle((0.0, 0.0), 9.0), "air", "air", "receiver", "ring")
    lamp = Fan((0.0, 0.0), 0.0, 60.0, 101)
    return save(tmp_path / "stop.json", Scene((Region("air", 1.0),), (black, ring), (lamp,)))


@pytest.mark.parametrize("sampling", ["fan", "sobol", "adaptive"])
def test_every_printed_power_has_uncertainty(sampling: str, stop: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(capsys, str(stop), "--sampling", sampling).splitlines()
    powers = [line for line in lines if line.startswith("  ")]
    assert [line.split()[0] for line in powers] == ["ring", "detected", "escaped", "absorbed", "truncated"]
    for line in powers:
        assert "±" in line
        assert "unknown" not in line
        assert 0.0 <= float(line.split("±")[1].split()[0]) < 2e-2


def test_reports_tolerance_that_is_not_reached(
    stop: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = (str(stop), "--sampling", "adaptive", "--tolerance")
    assert "not reached" not in printed(capsys, *arguments, "1e-3")
    monkeypatch.setattr(options, "integrate", partial(integrate, max_segments=8))
    assert "the tolerance was not reached: " in printed(capsys, *arguments, "1e-9")


def test_checks_scenes(
    rayoptics_file: Path, solen_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(["check", str(rayoptics_file)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "a lamp and a screen: a valid scene of ray-optics"
    assert "  monitors    detector1, all" in lines
    assert lines[-1].startswith("ignored: object 4, Hologram")
    assert run_command(["check", str(solen_file), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["format"], result["rays"], result["receivers"], result["monitors"]) == (
        "solen",
        2,
        ["eye"],
        ["line"],
    )
    assert run_command(["check", str(solen_file), "--set", "lens.focus_mm=3"]) == 2
    assert "applies to designs" in capsys.readouterr().err
    bad = tmp_path / "bad.json"
    bad.write_text("{", encoding="utf-8")
    assert run_command(["check", str(bad)]) == 2
    assert "not JSON" in capsys.readouterr().err


def test_warns_of_efficiencies_above_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grating = {"type": "DiffractionGrating", "p1": {"x": 5, "y": -4}, "p2": {"x": 5, "y": 4}, "customBrightness": True}
    file = tmp_path / "ruled.json"
    file.write_text(json.dumps({"version": 5, "objs": [LAMP, grating]}), encoding="utf-8")
    for command in ("check", "trace"):
        assert run_command([command, str(file)]) == 0
        assert "warning: diffractiongrating1.1: the efficiencies of its orders add up to 2 " in capsys.readouterr().out
    assert run_command(["trace", str(file), "--mode", "power"]) == 2
    assert "add up to 2" in capsys.readouterr().err


def test_draws_design_with_custom_receiver_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A receiver that is neither right nor left must not end in a KeyError."""
    corners = [(-2, 0), (2, 0), (2, 9), (0, 9), (-2, 9)]
    names = ["lens", "wall", "receiver-north", "receiver-south", "wall"]
    faces = [
        {"name": name, "curve": {"kind": "segment", "a": a, "b": b}}
        for name, a, b in zip(names, corners, corners[1:] + corners[:1], strict=True)
    ]
    outline = {"solen_outline": 1, "faces": faces, "emitters": [{"point": (0.0, -1.0), "axis_deg": 0.0}]}
    (tmp_path / "own.json").write_text(json.dumps(outline), encoding="utf-8")
    design = tmp_path / "own.toml"
    text = 'schema = 1\nname = "own"\n[material]\nindex = 1.5\n[body]\nkind = "outline"\nfile = "own.json"\n'
    design.write_text(text + "[motion]\npivot = [0.0, 0.0]\n", encoding="utf-8")
    figure = tmp_path / "rays.svg"
    assert run_command(["trace", str(design), "--figure", str(figure)]) == 0, capsys.readouterr().err
    assert figure.stat().st_size > 10_000
    (axes,) = rays_figure([sensor_view(Sensor.of(design), 0.0)]).axes
    assert {"north", "south"} < {text.get_text() for text in axes.texts}
