"""Layers of coupon jobs: separate exposures of discs, exposure of a single layer, and burn-in."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from solen.cli import run_command
from solen.spec import template
from tests.command_support import answered
from tests.fabricate.zip_reader import read_zip

SMALL = "--printer=generic"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("coupons")
    names = "cure-discs,film-layer,group-a"
    assert run_command(["print", "coupons", "--out", str(out), "--only", names, "--exposure-s", "2"]) == 0
    return out


def print_layers(
    folder: Path, capfd: pytest.CaptureFixture[str], job: str, *options: str
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the result of the command, and the rows of job.json in the archive."""
    capfd.readouterr()
    result = answered(capfd, "print", "layers", str(folder / job), "--out", str(folder / "print"), SMALL, *options)
    with zipfile.ZipFile(result["files"]["layers"]) as archive:
        return result, json.loads(archive.read("job.json"))["layers"]


def test_discs_are_exposed_separately(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    result, rows = print_layers(folder, capfd, "cure-discs.json")
    assert [row["exposure_s"] for row in rows] == [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    assert {(row["from_mm"], row["to_mm"]) for row in rows} == {(0.0, 0.025)}
    assert [row["feature"] for row in rows][:2] == ["t-1s", "t-1.5s"]
    np.testing.assert_allclose([row["area_mm2"] for row in rows], np.pi * 1.5**2, rtol=1e-4)
    assert result["settings"]["burn_in_layers"] == 0
    assert result["settings"]["exposures_s"] == 29.5
    assert abs(result["volume_error"]) < 1e-4
    stack = read_zip(result["files"]["layers"])
    assert [row["file"] for row in rows] == [f"{number}.png" for number in range(1, stack.count + 1)]
    images = [stack.layer(index).image for index in range(stack.count)]
    columns = [float(np.average(np.arange(image.shape[1]), weights=image.sum(axis=0))) for image in images]
    np.testing.assert_allclose(np.diff(columns), 8.0 / 0.05, atol=0.01)  # one disc per image, at a pitch of 8 mm
    sheet = Path(result["files"]["sheet"]).read_text(encoding="utf-8")
    assert "t-7s | 7 s" in sheet


def test_the_single_layer_has_no_burn_in(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    result, rows = print_layers(folder, capfd, "film-layer.json", "--run", "layer")
    assert [(row["exposure_s"], row["dose_mJ_per_cm2"]) for row in rows] == [(2.0, 26.0)]
    assert result["settings"]["z_offset_um"] == 600.0
    assert any("zero" in text for text in result["warnings"])
    _, base = print_layers(folder, capfd, "film-layer.json", "--run", "base")
    assert [row["exposure_s"] for row in base] == [3.0] * 6 + [2.0] * 14


@pytest.mark.parametrize(
    ("arguments", "texts"),
    [
        (["film-layer.json"], ["--run", "base, layer"]),
        (["film-layer.json", "--run", "top"], ["--run", "top"]),
        (["group-a.json", "--run", "base"], ["--run", "base"]),
        (["film-layer.json", "--run", "layer", "--exposure-s", "3"], ["--exposure-s = 3", "must be 2"]),
        (["group-a.json", "--orientation", "upright"], ["--orientation", "flat"]),
        (["group-a.stl", "--run", "base"], ["--run", "job"]),
        (["group-a.json", "--set", "a=1"], ["--set"]),
    ],
)
def test_refuses_options_that_contradict_the_job(
    folder: Path, arguments: list[str], texts: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    capfd.readouterr()
    file, *options = arguments
    assert run_command(["print", "layers", str(folder / file), "--out", str(folder / "no"), SMALL, *options]) == 2
    message = capfd.readouterr().err
    assert len(message.splitlines()) == 1
    assert [text for text in texts if text not in message] == []


def test_refuses_a_file_that_is_not_a_job(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.json").write_text('{"kind": "something"}', encoding="utf-8")
    assert run_command(["print", "layers", str(tmp_path / "a.json"), "--out", str(tmp_path)]) == 2
    assert "is not a coupon job" in capfd.readouterr().err


def test_warns_of_burn_in_of_a_single_layer(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """An STL file of the same layer does not specify an exposure."""
    result, rows = print_layers(folder, capfd, "film-layer-layer.stl")
    assert [row["exposure_s"] for row in rows] == [3.0]
    assert any("--burn-in-layers 0" in warning for warning in result["warnings"])
    result, rows = print_layers(folder, capfd, "film-layer-layer.stl", "--burn-in-layers", "0")
    assert [row["exposure_s"] for row in rows] == [2.0]
    assert not any("burn-in" in warning for warning in result["warnings"])


@pytest.mark.parametrize(("offset_mm", "volume_mm3"), [(5.0, 300.0), (20.0, 400.0)])
def test_the_volume_of_overlapping_shells_is_that_of_their_union(
    tmp_path: Path, offset_mm: float, volume_mm3: float, capfd: pytest.CaptureFixture[str]
) -> None:
    boxes = [trimesh.creation.box(extents=(10.0, 10.0, 2.0)) for _ in range(2)]
    boxes[1].apply_translation([offset_mm, 0.0, 0.0])
    trimesh.util.concatenate(boxes).export(tmp_path / "a.stl")
    result, _ = print_layers(tmp_path, capfd, "a.stl")
    assert result["solid_volume_mm3"] == pytest.approx(volume_mm3, rel=1e-6)
    assert result["stack_volume_mm3"] == pytest.approx(volume_mm3, rel=1e-3)
    assert any("overlap" in warning for warning in result["warnings"]) == (offset_mm < 10.0)


def test_the_mark_is_in_the_upper_side_of_the_left_arm(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.toml").write_text(template("solen-860"), encoding="utf-8")
    bare, marked = (print_layers(tmp_path, capfd, "a.toml", *options) for options in ((), ("--mark",)))
    areas = np.array([[row["area_mm2"] for row in rows] for _, rows in (bare, marked)], dtype=float)
    np.testing.assert_allclose((areas[0] - areas[1])[-8:], np.pi * 0.5**2, rtol=1e-3)
    np.testing.assert_allclose((areas[0] - areas[1])[:-8], 0.0, atol=1e-6)
    stack = read_zip(marked[0]["files"]["layers"])
    last, below = (stack.layer(stack.count + offset).image.astype(float) for offset in (-1, -9))
    _, columns = np.nonzero(below - last > 128.0)
    assert columns.max() < 0.5 * last.shape[1]
