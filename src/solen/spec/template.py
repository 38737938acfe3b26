"""Design files shipped with solen: a commented template, and examples that differ from it in a few keys."""

from importlib.resources import files
from pathlib import Path

from solen.errors import SpecError
from solen.results import Result
from solen.spec.strict import nearest

_EXAMPLES = files("solen.spec") / "examples"


class NewDesign(Result, eq=True):
    """A new design file and the name of the example from which it was copied."""

    design: Path
    example: str


def template_names() -> tuple[str, ...]:
    """Return the names of the shipped designs, sorted."""
    return tuple(sorted(file.name[:-5] for file in _EXAMPLES.iterdir() if file.name.endswith(".toml")))


def template(name: str = "solen-860") -> str:
    """Return the text of a shipped design file; the default file shows every key with its default and a comment.

    Raises
    ------
    SpecError
        If no shipped design has that name.
    """
    names = template_names()
    if name not in names:
        near = nearest(name, names)
        remedy = f"did you mean {near}?" if near else ""
        raise SpecError("example", value=name, limit=f"must be one of {', '.join(names)}", remedy=remedy)
    return (_EXAMPLES / f"{name}.toml").read_text(encoding="utf-8")
