"""Commands of designs: the profile of a lens as a table, a new design, a check, and a figure."""

import csv
import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from solen import files
from solen.errors import DesignError, OutputError, SpecError
from solen.pipeline.design import check as pipeline
from solen.pipeline.design.designs import new, open_design
from solen.pipeline.design.trace import trace
from solen.report.options import FigureOptions
from solen.sensor import Check, LensOptions
from solen.sensor.network import NetworkCheck
from solen.spec import load, template, template_names

S, F, N, HALF = 1.0, 20.0, 1.44, 2.0


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("design") / "sensor.toml"
    target.write_text(template("paper-860"), encoding="utf-8")
    return target


def oval_z(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the front of the oval by bisection, independently of the solution of solen."""
    low, high = np.zeros_like(x), np.full_like(x, 3.0)
    for _ in range(60):
        z = (low + high) / 2
        difference = np.hypot(x, z + S) + N * np.hypot(x, F - z) - (S + N * F)
        low, high = np.where(difference > 0, z, low), np.where(difference > 0, high, z)
    return (low + high) / 2


def profile(design: Path, table: Path, tolerance_mm: float) -> NDArray[np.float64]:
    outcome = pipeline.lens(design, options=LensOptions(tolerance_mm=tolerance_mm), csv=table, force=True)
    with table.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["x_mm", "z_mm"]
    points = np.array(rows, dtype=float)
    assert outcome.files == {"profile": table}
    return points


@pytest.mark.parametrize("tolerance_mm", [1e-2, 1e-4, 1e-6])
def test_the_profile_is_within_its_tolerance(design: Path, tmp_path: Path, tolerance_mm: float) -> None:
    points = profile(design, tmp_path / "lens.csv", tolerance_mm)
    assert points[0, 0] == pytest.approx(-HALF, abs=1e-9)
    assert points[-1, 0] == pytest.approx(HALF, abs=1e-9)
    assert (np.diff(points[:, 0]) > 0).all()
    assert np.abs(points[:, 1] - oval_z(points[:, 0])).max() < 1e-9
    fraction = np.linspace(0, 1, 21)[:, None, None]
    between = ((1 - fraction) * points[:-1] + fraction * points[1:]).reshape(-1, 2)
    slope = np.gradient(oval_z(np.linspace(-HALF, HALF, 4001)), 4 * HALF / 8000)
    error = np.abs(between[:, 1] - oval_z(between[:, 0]))
    assert error.max() <= tolerance_mm * math.hypot(1, np.abs(slope).max())


def test_a_coarser_tolerance_requires_fewer_points(design: Path, tmp_path: Path) -> None:
    counts = [len(profile(design, tmp_path / "lens.csv", tolerance_mm)) for tolerance_mm in (1e-2, 1e-4, 1e-6)]
    assert counts == sorted(counts)
    assert counts[0] < 50 < 5 * counts[0] < counts[1] < counts[2] / 5


def test_a_flat_face_has_a_straight_profile(design: Path, tmp_path: Path) -> None:
    result = pipeline.lens(design, set_=["lens.shape=none"], csv=tmp_path / "lens.csv").result
    assert result.lens.shape == "none"
    header, *rows = (tmp_path / "lens.csv").read_text(encoding="utf-8").splitlines()
    assert header == "x_mm,z_mm"
    assert (rows[0], rows[-1]) == ("-2.0,0.0", "2.0,0.0")
    assert {row.partition(",")[2] for row in rows} == {"0.0"}


def test_lens_writes_no_file_by_default(design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert pipeline.lens(design).files == {}
    assert list(tmp_path.iterdir()) == []


def test_focus_in_a_material_with_another_index(design: Path) -> None:
    nominal = pipeline.lens(design).result
    other = pipeline.lens(design, set_=["lens.design_index=1.44", "material.index=1.49"]).result
    assert nominal.foci[1].paraxial_focus_mm == pytest.approx(F)
    focus = other.foci[1]
    assert (other.to_dict()["lens"]["design_index"], focus.material_index) == (1.44, 1.49)
    assert other.lens.depth_mm == nominal.lens.depth_mm
    assert focus.paraxial_focus_mm is not None
    assert focus.marginal_focus_mm is not None
    assert focus.paraxial_focus_mm < focus.marginal_focus_mm < F


@pytest.mark.parametrize("example", template_names())
def test_new_writes_a_valid_design(tmp_path: Path, example: str) -> None:
    result = new(tmp_path / "my sensor", example=example).result
    target = tmp_path / "my sensor" / "sensor.toml"
    assert (result.design, result.example) == (target, example)
    first_line, _, text = target.read_text(encoding="utf-8").partition("\n")
    assert text == template(example)
    schema = json.loads((target.parent / first_line.removeprefix("#:schema ")).read_text(encoding="utf-8"))
    assert set(tomllib.loads(text)) <= set(schema["properties"])
    checked = pipeline.check(target).result
    assert checked.name == load(target).name
    if load(target).body.kind == "network":
        assert isinstance(checked, NetworkCheck)
        assert len(checked.emitters) == len(load(target).network.emitters)
        return
    assert isinstance(checked, Check)
    assert checked.angles == len(load(target).motion.values())
    assert checked.foci[1].material_index == checked.material.index


def test_new_never_overwrites(tmp_path: Path) -> None:
    target = tmp_path / "sensor.toml"
    target.write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="already exists"):
        new(tmp_path)
    assert target.read_text(encoding="utf-8") == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["sensor.toml"]


def test_new_refuses_an_unknown_example_and_makes_no_folder(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="solen-860"):
        new(tmp_path / "new", example="solen-680")
    assert list(tmp_path.iterdir()) == []


def test_removes_only_folders_that_it_created(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OutputError("disk", limit="full")

    monkeypatch.setattr(files, "write_all", fail)
    (tmp_path / "old").mkdir()
    for name in ("old", "new"):
        with pytest.raises(OutputError):
            new(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["old"]


def test_check_covers_all_angles(design: Path) -> None:
    pivot = ['motion.moves=["emitter"]', "motion.pivot=[30.0, 0.0]"]
    with pytest.raises(SpecError, match=r"less than motion\.to_deg"):
        pipeline.check(design, set_=["motion.from_deg=4"])
    checked = pipeline.check(design, set_=[*pivot, "motion.from_deg=0"]).result
    assert isinstance(checked, Check)
    assert checked.angles == 13
    with pytest.raises(DesignError, match="inside the body"):
        pipeline.check(design, set_=pivot)


def test_the_last_assignment_to_a_key_has_priority(design: Path) -> None:
    opened = open_design(design, ["emitter.rays=7", "name=Set by text", "emitter.rays=9"])
    assert (opened.emitter.rays, opened.name) == (9, "Set by text")


def test_refuses_too_many_paths(design: Path) -> None:
    with pytest.raises(SpecError, match="at most 100000"):
        trace(design, ["emitter.rays=100001"], paths=True)


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf", ".SVG"])
def test_the_format_of_a_figure_is_that_of_its_extension(design: Path, tmp_path: Path, suffix: str) -> None:
    starts = {".svg": b"<?xml", ".png": b"\x89PNG", ".pdf": b"%PDF"}
    target = tmp_path / f"rays at 1{suffix}"
    outcome = trace(design, angle_deg=1.0, figure=FigureOptions(figure=target))
    assert outcome.files == {"figure": target}
    assert target.read_bytes().startswith(starts[suffix.lower()])
    assert [path.name for path in tmp_path.iterdir()] == [target.name]
