"""The layers of a coupon's job: its own exposure for each disc and for the single layer, and no burn-in in silence."""

import json
import zipfile
from pathlib import Path

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


def layered(
    folder: Path, capfd: pytest.CaptureFixture[str], job: str, *options: str
) -> tuple[dict[str, object], list[dict[str, object]]]:
    """The answer, and the rows of job.json in the archive."""
    capfd.readouterr()
    found = answered(capfd, "print", "layers", str(folder / job), "--out", str(folder / "print"), SMALL, *options)
    with zipfile.ZipFile(found["files"]["layers"]) as archive:
        return found, json.loads(archive.read("job.json"))["layers"]


def test_each_disc_has_its_own_exposure(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    found, rows = layered(folder, capfd, "cure-discs.json")
    assert [row["exposure_s"] for row in rows] == [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    assert {(row["from_mm"], row["to_mm"]) for row in rows} == {(0.0, 0.025)}
    assert [row["feature"] for row in rows][:2] == ["t-1s", "t-1.5s"]
    np.testing.assert_allclose([row["area_mm2"] for row in rows], np.pi * 1.5**2, rtol=1e-4)  # type: ignore[arg-type]
    assert found["settings"]["burn_in_layers"] == 0  # type: ignore[index]
    assert found["settings"]["exposures_s"] == 29.5  # type: ignore[index]
    assert abs(found["volume_error"]) < 1e-4  # type: ignore[arg-type]
    stack = read_zip(found["files"]["layers"])  # type: ignore[index]  # a table of paths
    assert [row["file"] for row in rows] == [f"{number}.png" for number in range(1, stack.count + 1)]
    images = [stack.layer(index).image for index in range(stack.count)]
    columns = [float(np.average(np.arange(one.shape[1]), weights=one.sum(axis=0))) for one in images]
    np.testing.assert_allclose(np.diff(columns), 8.0 / 0.05, atol=0.01)  # a disc each, 8 mm apart
    sheet = Path(found["files"]["sheet"]).read_text(encoding="utf-8")  # type: ignore[index]
    assert "t-7s | 7 s" in sheet


def test_the_single_layer_has_no_burn_in(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    found, rows = layered(folder, capfd, "film-layer.json", "--run", "layer")
    assert [(row["exposure_s"], row["dose_mJ_per_cm2"]) for row in rows] == [(2.0, 26.0)]
    assert found["settings"]["z_offset_um"] == 600.0  # type: ignore[index]
    assert any("set the zero of the printer" in text for text in found["warnings"])  # type: ignore[attr-defined]
    _, base = layered(folder, capfd, "film-layer.json", "--run", "base")
    assert [row["exposure_s"] for row in base] == [3.0] * 6 + [2.0] * 14


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["film-layer.json"], ["--run", "base, layer"]),
        (["film-layer.json", "--run", "top"], ["--run", "top"]),
        (["group-a.json", "--run", "base"], ["--run", "base"]),
        (["film-layer.json", "--run", "layer", "--exposure-s", "3"], ["--exposure-s", "the job specifies 2"]),
        (["group-a.json", "--orientation", "upright"], ["--orientation", "flat"]),
        (["group-a.stl", "--run", "base"], ["--run", "job"]),
        (["group-a.json", "--set", "a=1"], ["--set"]),
    ],
)
def test_what_contradicts_the_job_is_refused(
    folder: Path, arguments: list[str], named: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    capfd.readouterr()
    file, *options = arguments
    assert run_command(["print", "layers", str(folder / file), "--out", str(folder / "no"), SMALL, *options]) == 2
    said = capfd.readouterr().err
    assert len(said.splitlines()) == 1
    assert all(one in said for one in named)


def test_a_file_that_is_no_job_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.json").write_text('{"kind": "something"}', encoding="utf-8")
    assert run_command(["print", "layers", str(tmp_path / "a.json"), "--out", str(tmp_path)]) == 2
    assert "is not a coupon job" in capfd.readouterr().err


def test_burn_in_of_a_thin_part_is_said(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The same layer as an STL, which states no exposure."""
    found, rows = layered(folder, capfd, "film-layer-layer.stl")
    assert [row["exposure_s"] for row in rows] == [3.0]
    assert any("single layer" in text and "--burn-in-layers 0" in text for text in found["warnings"])  # type: ignore[attr-defined]
    quiet, rows = layered(folder, capfd, "film-layer-layer.stl", "--burn-in-layers", "0")
    assert [row["exposure_s"] for row in rows] == [2.0]
    assert not any("burn-in" in text for text in quiet["warnings"])  # type: ignore[attr-defined]


def boxes(path: Path, apart_mm: float) -> Path:
    """Two boxes of 10 x 10 x 2 mm as one STL of two shells."""
    both = [trimesh.creation.box(extents=(10.0, 10.0, 2.0)) for _ in range(2)]
    both[1].apply_translation([apart_mm, 0.0, 0.0])
    trimesh.util.concatenate(both).export(path)
    return path


@pytest.mark.parametrize(("apart_mm", "volume_mm3"), [(5.0, 300.0), (20.0, 400.0)])
def test_overlapping_shells_count_once(
    tmp_path: Path, apart_mm: float, volume_mm3: float, capfd: pytest.CaptureFixture[str]
) -> None:
    boxes(tmp_path / "a.stl", apart_mm)
    found, _ = layered(tmp_path, capfd, "a.stl")
    assert found["solid_volume_mm3"] == pytest.approx(volume_mm3, rel=1e-6)
    assert found["stack_volume_mm3"] == pytest.approx(volume_mm3, rel=1e-3)
    assert any("overlap" in text for text in found["warnings"]) == (apart_mm < 10.0)  # type: ignore[attr-defined]


def test_a_mark_is_in_the_top_of_the_left_arm(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.toml").write_text(template("solen-860"), encoding="utf-8")
    bare, marked = (layered(tmp_path, capfd, "a.toml", *more) for more in ((), ("--mark",)))
    areas = np.array([[row["area_mm2"] for row in rows] for _, rows in (bare, marked)], dtype=float)
    np.testing.assert_allclose((areas[0] - areas[1])[-8:], np.pi * 0.5**2, rtol=1e-3)
    np.testing.assert_allclose((areas[0] - areas[1])[:-8], 0.0, atol=1e-6)
    stack = read_zip(marked[0]["files"]["layers"])  # type: ignore[index]  # a table of paths
    last, below = (stack.layer(stack.count + at).image.astype(float) for at in (-1, -9))
    _, columns = np.nonzero(below - last > 128.0)
    assert columns.max() < 0.5 * last.shape[1]
