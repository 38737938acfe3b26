"""What only a part of solen needs: the extras that messages and pages name are those of the project."""

import ast
import re
import shlex
import sys
import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from solen.errors import DataError, OutputError
from solen.extras import PACKAGES, installed, need

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "src" / "solen").rglob("*.py"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = {
    extra: {Requirement(line).name for line in lines} for extra, lines in PROJECT["optional-dependencies"].items()
}


@pytest.mark.parametrize("module", PACKAGES)
def test_the_extra_installs_the_package(module: str) -> None:
    assert PACKAGES[module].distribution in EXTRAS[PACKAGES[module].extra]


HINT = re.compile(r"""["`]\.\[([\w,]+)\]["`]""")


def pages() -> list[Path]:
    """Files whose text tells a reader what to install."""
    return [*SOURCES, *(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]


def test_every_printed_hint_names_an_extra_of_the_project() -> None:
    """`pip install ".[vision]"` works in a clone, and pages name that; the name on an index may be somebody else's."""
    named = {
        extra
        for page in pages()
        for hint in HINT.findall(page.read_text(encoding="utf-8"))
        for extra in hint.split(",")
    }
    assert {"cad", "vision", "dev"} <= named <= EXTRAS.keys()


@pytest.mark.parametrize("module", PACKAGES)
def test_a_printed_command_installs_what_the_extra_asks_for(module: str) -> None:
    """Without the name of solen, which no index has: the command works beside a wheel as in a clone."""
    program, action, *named = shlex.split(PACKAGES[module].command)
    asked = [Requirement(line) for line in PROJECT["optional-dependencies"][PACKAGES[module].extra]]
    assert (program, action) == ("pip", "install")
    assert {(one.name, frozenset(one.extras), one.specifier) for one in map(Requirement, named)} == {
        (one.name, frozenset(one.extras), one.specifier) for one in asked
    }


def test_a_clone_that_is_not_installed_installs_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(distribution: str) -> list[str]:
        raise PackageNotFoundError(distribution)

    monkeypatch.setattr("solen.extras.requires", missing)
    assert PACKAGES["OCP"].command == 'pip install ".[cad]"'


def test_no_page_installs_the_package_of_another_project() -> None:
    """`solen` on the public index is not this project: the distribution here is `solen-sensor`."""
    found = [
        f"{page.relative_to(ROOT)}: {line.strip()}"
        for page in pages()
        for line in page.read_text(encoding="utf-8").splitlines()
        if re.search(r"""pip install ["']?solen\b|solen\[\w+\]""", line)
    ]
    assert found == []
    assert PROJECT["name"] == "solen-sensor"
    assert PROJECT["scripts"] == {"solen": "solen.cli:main"}


def test_only_one_place_tells_that_a_package_is_missing() -> None:
    caught = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ExceptHandler)
        and node.type is not None
        and re.search(r"\b(ImportError|ModuleNotFoundError)\b", ast.unparse(node.type))
    ]
    assert caught == []


def test_a_missing_package_is_one_line_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_what_is_not_loaded_is_looked_for_and_stays_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "xarray", raising=False)
    monkeypatch.setitem(PACKAGES, "no_such_module_of_anybody", PACKAGES["xarray"])
    installed("xarray")
    assert "xarray" not in sys.modules
    assert not installed("no_such_module_of_anybody")
