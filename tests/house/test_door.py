"""Public names of `import solen`, loaded when first used, and typical uses of them."""

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


def test_import_loads_no_large_package() -> None:
    probe = "import solen, sys; dir(solen); print(*(set(sys.modules) & {'numpy', 'pydantic', 'scipy', 'numba'}))"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.mark.parametrize("name", NAMES)
def test_name_exists_and_is_documented(name: str) -> None:
    assert inspect.getdoc(getattr(solen, name))
    assert name in dir(solen)


def test_stub_contains_same_names() -> None:
    stub = ast.parse((ROOT / "src" / "solen" / "__init__.pyi").read_text(encoding="utf-8"))
    stub_names = {alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert stub_names == set(NAMES)


def test_names_are_not_those_of_modules() -> None:
    modules = {path.stem for path in (ROOT / "src" / "solen").iterdir()}
    assert not modules & set(NAMES), "importing a module would replace the name"


def test_unknown_name_is_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        getattr(solen, "nonsense")  # noqa: B009  mypy would reject the attribute


def test_design_is_copied_with_changed_keys(file: Path) -> None:
    design = solen.load(file)
    assert design.set(focus_mm=25).lens.focus_mm == 25.0
    assert design.set({"lens.focus_mm": 24}, name="other").name == "other"
    assert design.lens.focus_mm == 20.0
    assert design.set(focus_mm=25).folder == design.folder
    with pytest.raises(SpecError, match=r"kind.*body\.kind, motion\.kind"):
        design.set(kind="bend")
    with pytest.raises(SpecError, match=r"focus; .*focus_mm"):
        design.set(focus=25)


def test_error_of_frozen_object_shows_how_to_copy_it(file: Path) -> None:
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
        setattr(CutbackOptions(), "keep_all", True)  # noqa: B010  mypy would reject the assignment


def test_sensor_of_file_equals_sensor_of_design(file: Path) -> None:
    sensor = solen.Sensor.of(str(file))
    assert sensor == solen.Sensor.of(solen.load(file))
    assert sensor.set(focus_mm=25).design.lens.focus_mm == 25.0


def test_reads_and_evaluates_measured_file(tmp_path: Path) -> None:
    path = tmp_path / "guides.csv"
    rows = "".join(f"{guide},{mm},{1.0 * 10 ** (-0.02 * mm)}\n" for guide in "abc" for mm in (10, 20, 40, 60))
    path.write_text(f"guide,length_mm,power_mW\n{rows}", encoding="utf-8")
    assert [channel.name for channel in solen.read(path).channels]
    loss = solen.loss_of_guide(path)
    assert loss.loss_dB_per_cm == pytest.approx(2.0, abs=1e-6)
    assert len(repr(loss).splitlines()) < 20
    assert isinstance(solen.plot(loss), Figure)


def test_exports_design_from_memory(file: Path, tmp_path: Path) -> None:
    outcome = solen.export(solen.load(file).set(thickness_mm=3), tmp_path / "out", "stl")
    assert [path.suffix for path in outcome.files.values()] == [".stl"]
    assert outcome.result.thickness_mm == 3.0
    assert all(path.exists() for path in outcome.files.values())


def test_plot_refuses_object_without_figure() -> None:
    with pytest.raises(OutputError, match=r"int.*Sensor"):
        solen.plot(3)


@pytest.mark.parametrize(("kind", "place"), FIGURES.items())
def test_figure_accepts_its_registered_type(kind: str, place: str) -> None:
    module, _, function = place.partition(":")
    draw = getattr(import_module(f"solen.report.{module}"), function)
    first, *others = inspect.signature(draw).parameters.values()
    assert all(other.default is not inspect.Parameter.empty for other in others)
    annotation = typing.get_type_hints(draw)[first.name]
    names = {accepted.__name__ for accepted in typing.get_args(annotation) or (annotation,)}
    assert kind in names
