"""Docstrings document the parameters and attributes that exist, under their names."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[2] / "src" / "solen"
SECTION = re.compile(r"^(Parameters|Attributes)\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", re.MULTILINE | re.DOTALL)
FILES = [path.relative_to(SOURCE).as_posix() for path in sorted(SOURCE.rglob("*.py"))]


def documented(node: ast.AST, section: str) -> set[str]:
    """Names that begin the entries of a section of a docstring, as in ``x, y : float``."""
    text = ast.get_docstring(node) or "" if isinstance(node, ast.FunctionDef | ast.ClassDef) else ""
    entries = dict(SECTION.findall(text)).get(section, "")
    heads = [line.partition(":")[0] for line in entries.splitlines() if line and not line[0].isspace()]
    return {name.strip(" *`") for head in heads for name in head.split(",")}


def arguments(function: ast.FunctionDef) -> set[str]:
    """Names of the parameters of a function."""
    every = function.args
    starred = [argument for argument in (every.vararg, every.kwarg) if argument is not None]
    return {argument.arg for argument in (*every.posonlyargs, *every.args, *every.kwonlyargs, *starred)}


def members(node: ast.ClassDef) -> set[str]:
    """Names of the fields, attributes and parameters of a class."""
    functions = [part for part in node.body if isinstance(part, ast.FunctionDef)]
    fields = {
        part.target.id for part in node.body if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name)
    }
    values = {
        name.id
        for part in node.body
        if isinstance(part, ast.Assign)
        for name in part.targets
        if isinstance(name, ast.Name)
    }
    own = {part.attr for part in ast.walk(node) if isinstance(part, ast.Attribute) and isinstance(part.ctx, ast.Store)}
    created = {name for part in functions if part.name in {"__init__", "of"} for name in arguments(part)}
    return fields | values | own | created | {part.name for part in functions}


def unknown(tree: ast.Module) -> Iterator[str]:
    """Documented names that do not exist; those of base classes are not known here."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            yield from (f"{node.name}: {name}" for name in documented(node, "Parameters") - arguments(node))
        if isinstance(node, ast.ClassDef):
            names = documented(node, "Parameters") | documented(node, "Attributes")
            plain = all(
                isinstance(base, ast.Name) and base.id in {"Result", "Strict", "NamedTuple"} for base in node.bases
            )
            yield from (f"{node.name}: {name}" for name in (names - members(node) if plain else ()))


@pytest.mark.parametrize("file", FILES)
def test_documented_names_exist(file: str) -> None:
    assert list(unknown(ast.parse((SOURCE / file).read_text(encoding="utf-8")))) == []
