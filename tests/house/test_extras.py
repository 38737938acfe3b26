"""Optional packages: the extras named in messages and pages are those of the project."""

import ast
import re
import shlex
import sys
import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from solen.errors import DataError, OutputError
from solen.extras import PACKAGES, installed, need

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "src" / "solen").rglob("*.py"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = {
    extra: {Requirement(line).name for line in lines} for extra, lines in PROJECT["optional-dependencies"].items()
}


@pytest.mark.parametrize("module", PACKAGES)
def test_extra_installs_package(module: str) -> None:
    assert PACKAGES[module].distribution in EXTRAS[PACKAGES[module].extra]


HINT = re.compile(r"""["`]\.\[([\w,]+)\]["`]""")


def pages() -> list[Path]:
    """Files that may contain installation commands."""
    return [*SOURCES, *(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]


def test_hints_name_extras_of_project() -> None:
    """Pages show `pip install ".[vision]"`, for a clone: on a package index the name belongs to another project."""
    named = {
        extra
        for page in pages()
        for hint in HINT.findall(page.read_text(encoding="utf-8"))
        for extra in hint.split(",")
    }
    assert {"cad", "vision", "dev"} <= named <= EXTRAS.keys()


def _parts(requirement: Requirement) -> tuple[str, frozenset[str], SpecifierSet]:
    return requirement.name, frozenset(requirement.extras), requirement.specifier


@pytest.mark.parametrize("module", PACKAGES)
def test_command_installs_requirements_of_extra(module: str) -> None:
    """The command does not name solen, which is not on a package index, so it works with a wheel and in a clone."""
    program, action, *packages = shlex.split(PACKAGES[module].command)
    requirements = [Requirement(line) for line in PROJECT["optional-dependencies"][PACKAGES[module].extra]]
    assert (program, action) == ("pip", "install")
    assert {_parts(requirement) for requirement in map(Requirement, packages)} == set(map(_parts, requirements))


def test_clone_without_metadata_installs_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(distribution: str) -> list[str]:
        raise PackageNotFoundError(distribution)

    monkeypatch.setattr("solen.extras.requires", missing)
    assert PACKAGES["OCP"].command == 'pip install ".[cad]"'


def test_no_page_installs_package_of_other_project() -> None:
    """`solen` on the public index is not this project, whose distribution is `solen-sensor`."""
    lines = [
        f"{page.relative_to(ROOT)}: {line.strip()}"
        for page in pages()
        for line in page.read_text(encoding="utf-8").splitlines()
        if re.search(r"""pip install ["']?solen\b|solen\[\w+\]""", line)
    ]
    assert lines == []
    assert PROJECT["name"] == "solen-sensor"
    assert PROJECT["scripts"] == {"solen": "solen.cli:main"}


def test_no_module_catches_import_errors() -> None:
    caught = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ExceptHandler)
        and node.type is not None
        and re.search(r"\b(ImportError|ModuleNotFoundError)\b", ast.unparse(node.type))
    ]
    assert caught == []


def test_error_of_missing_package_names_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "OCP", None)
    monkeypatch.setitem(sys.modules, "h5py", sys)
    assert not installed("OCP")
    with pytest.raises(
        OutputError,
        match=r'^--step; writing STEP requires Open CASCADE, which is .*; pip install "cadquery-ocp-novtk\S+"$',
    ):
        need("h5py", "OCP", what="--step", doing="writing STEP")
    with pytest.raises(DataError, match=r'^a\.h5 = 3; requires Open CASCADE, .*; pip install "cadquery\S+", or try b$'):
        need("OCP", what="a.h5", value=3, otherwise="try b", error=DataError)
    need("h5py", what="a.h5")


def test_looks_for_package_without_loading_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "xarray", raising=False)
    monkeypatch.setitem(PACKAGES, "no_such_module_of_anybody", PACKAGES["xarray"])
    installed("xarray")
    assert "xarray" not in sys.modules
    assert not installed("no_such_module_of_anybody")
