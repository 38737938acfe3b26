"""`import solen`: one screen of names, loaded when they are used, and what a first script does with them."""

import ast
import inspect
import subprocess
import sys
import typing
from importlib import import_module
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import solen
from solen.errors import FrozenError, OutputError, SpecError
from solen.material.loss import CutbackOptions
from solen.report.plot import FIGURES
from solen.spec import template

ROOT = Path(__file__).resolve().parents[2]
NAMES = [name for name in solen.__all__ if not name.startswith("_")]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "sensor.toml"
    path.write_text(template("paper-860"), encoding="utf-8")
    return path


def test_to_import_it_loads_nothing_heavy() -> None:
    probe = "import solen, sys; dir(solen); print(*(set(sys.modules) & {'numpy', 'pydantic', 'scipy', 'numba'}))"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_there_and_documented(name: str) -> None:
    assert inspect.getdoc(getattr(solen, name))
    assert name in dir(solen)


def test_type_checkers_see_the_same_names() -> None:
    stub = ast.parse((ROOT / "src" / "solen" / "__init__.pyi").read_text(encoding="utf-8"))
    named = {alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert named == set(NAMES)


def test_names_are_no_rooms() -> None:
    rooms = {path.stem for path in (ROOT / "src" / "solen").iterdir()}
    assert not rooms & set(NAMES), "to import a room would take the name's place"


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        getattr(solen, "nonsense")  # noqa: B009  as mypy knows the names


def test_a_design_changes_into_another_by_keys(file: Path) -> None:
    design = solen.load(file)
    assert design.set(focus_mm=25).lens.focus_mm == 25.0
    assert design.set({"lens.focus_mm": 24}, name="other").name == "other"
    assert design.lens.focus_mm == 20.0
    assert design.set(focus_mm=25).folder == design.folder
    with pytest.raises(SpecError, match=r"kind.*body\.kind, motion\.kind"):
        design.set(kind="bend")
    with pytest.raises(SpecError, match=r"focus; .*focus_mm"):
        design.set(focus=25)


def test_what_is_frozen_says_how_a_changed_copy_is_made(file: Path) -> None:
    design = solen.load(file)
    with pytest.raises(FrozenError, match=r'design\.set\(\{"lens\.focus_mm": 25\}\)'):
        setattr(design.lens, "focus_mm", 25)  # noqa: B010
    with pytest.raises(AttributeError, match=r"design\.set"):
        setattr(design, "name", "other")  # noqa: B010
    with pytest.raises(FrozenError, match=r"OvalLens\.focus_mm; .*dataclasses\.replace\(result, focus_mm=25\)"):
        setattr(solen.Sensor.of(design).lens, "focus_mm", 25)  # noqa: B010
    with pytest.raises(AttributeError, match=r"OvalLens\.focus_mm; cannot be changed"):
        delattr(solen.Sensor.of(design).lens, "focus_mm")
    with pytest.raises(FrozenError, match=r"CutbackOptions\(keep_all=True\)"):
        setattr(CutbackOptions(), "keep_all", True)  # noqa: B010  as mypy knows that it cannot be


def test_a_sensor_is_that_of_a_file_or_of_a_design(file: Path) -> None:
    sensor = solen.Sensor.of(str(file))
    assert sensor == solen.Sensor.of(solen.load(file))
    assert sensor.set(focus_mm=25).design.lens.focus_mm == 25.0


def test_a_file_of_an_instrument_is_read_and_evaluated(tmp_path: Path) -> None:
    path = tmp_path / "guides.csv"
    rows = "".join(f"{guide},{mm},{1.0 * 10 ** (-0.02 * mm)}\n" for guide in "abc" for mm in (10, 20, 40, 60))
    path.write_text(f"guide,length_mm,power_mW\n{rows}", encoding="utf-8")
    assert [channel.name for channel in solen.read(path).channels]
    loss = solen.loss_of_guide(path)
    assert loss.loss_dB_per_cm == pytest.approx(2.0, abs=1e-6)
    assert len(repr(loss).splitlines()) < 20
    assert isinstance(solen.plot(loss), Figure)


def test_a_design_is_exported_from_memory(file: Path, tmp_path: Path) -> None:
    outcome = solen.export(solen.load(file).set(thickness_mm=3), tmp_path / "out", "stl")
    assert [path.suffix for path in outcome.files.values()] == [".stl"]
    assert outcome.result.thickness_mm == 3.0
    assert all(path.exists() for path in outcome.files.values())


def test_what_has_no_figure_is_refused_with_what_has_one() -> None:
    with pytest.raises(OutputError, match=r"int.*Sensor"):
        solen.plot(3)


@pytest.mark.parametrize(("kind", "place"), FIGURES.items())
def test_every_figure_takes_the_type_that_it_is_registered_for(kind: str, place: str) -> None:
    module, _, function = place.partition(":")
    draw = getattr(import_module(f"solen.report.{module}"), function)
    first, *others = inspect.signature(draw).parameters.values()
    assert all(other.default is not inspect.Parameter.empty for other in others)
    taken = typing.get_type_hints(draw)[first.name]
    names = {one.__name__ for one in typing.get_args(taken) or (taken,)}
    assert kind in names
