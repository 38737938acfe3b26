"""Commands that tabs offer: a form, a call, a command line and a script from the signature of a command's function.

`solen resin cure` is `solen.pipeline.resin.cure.cure`, whose parameters and `Options` state names, units, limits and
help once. An `Offer` names that function and states which of its parameters are files that a page drops, which are
files to write, and which is the open design; everything else is read from the signature. A page can therefore request
exactly the parameters of the command, and "the same elsewhere" is the call itself, written out.

Public name: `Offer`.
"""

import importlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from solen.errors import SpecError
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.spec.strict import Options
from solen.studio.calls import Call
from solen.studio.signature import Parameter, described, parameters_of
from solen.studio.storage import safe_name

INJECTED = ("progress", "figure", "set_")
"""Parameters that the studio supplies itself, which therefore appear neither on a page nor in an offer."""
FIGURE = "figure.svg"


@dataclass(frozen=True)
class Offer:
    """A command that a tab offers.

    Attributes
    ----------
    name
        The command without ``solen``, such as ``resin cure``.
    where
        Its function, ``module:name``.
    label
        Its purpose, in few words.
    files, results
        Parameters for files dropped on the page, and for files that other commands wrote, with their labels.
    written
        Parameters for a file to write, with its name; an empty name is the folder itself.
    beside
        Parameters for a file to write next to the design, with its name, which may contain values and the name of the
        design, such as ``{name}.toml`` or ``{design}-tuning.json``.
    design
        Parameter for the open design; empty if there is none.
    first
        Options that are shown first; all others require a further click.
    live
        Parameters that accept an observer of the run, with the class that makes it from a `SendNews`: ``module:name``.
    hidden
        Parameters that a page does not need.
    """

    name: str
    where: str
    label: str
    files: Mapping[str, str] = field(default_factory=dict)
    results: Mapping[str, str] = field(default_factory=dict)
    written: Mapping[str, str] = field(default_factory=dict)
    beside: Mapping[str, str] = field(default_factory=dict)
    design: str = ""
    first: tuple[str, ...] = ()
    live: Mapping[str, str] = field(default_factory=dict)
    hidden: tuple[str, ...] = ()

    @property
    def taken(self) -> dict[str, str]:
        """Labels of all file parameters."""
        return {**self.files, **self.results}

    @property
    def short(self) -> str:
        """Last word of the command, for names of folders."""
        return self.name.rpartition(" ")[2]

    @property
    def module(self) -> str:
        """Module of the function."""
        return self.where.partition(":")[0]

    @cached_property
    def function(self) -> Callable[..., Outcome[Any]]:
        """The function of the command."""
        module, _, name = self.where.partition(":")
        found: Callable[..., Outcome[Any]] = getattr(importlib.import_module(module), name)
        return found

    @cached_property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of the function by name."""
        return parameters_of(self.function)

    @cached_property
    def groups(self) -> dict[str, type[Options]]:
        """Classes of options by parameter."""
        return {
            name: parameter.options
            for name, parameter in self.parameters.items()
            if parameter.options and name not in INJECTED
        }

    @cached_property
    def plain(self) -> dict[str, Parameter]:
        """Parameters that a page states individually."""
        made = {*INJECTED, *self.written, *self.beside, *self.live, *self.hidden, self.design}
        known = {*made, *self.groups, *self.taken}
        return {
            name: parameter
            for name, parameter in self.parameters.items()
            if name not in known and not parameter.is_path
        }

    def form(self) -> dict[str, Any]:
        """Return the form of the command as JSON Schema; paths in it are names of dropped files."""
        words_of = described(self.function)
        fields: dict[str, Any] = {}
        for name, one in self.plain.items():
            schema = TypeAdapter(one.hint).json_schema()
            default = {} if one.is_required else {"default": one.default}
            fields[name] = _flat({"description": words_of.get(name, ""), **schema, **default})
        required = [name for name, one in self.plain.items() if one.is_required]
        for options in self.groups.values():
            schema = options.model_json_schema()
            fields |= {name: _flat(one) for name, one in schema["properties"].items()}
            required += schema.get("required", [])
        files = [
            {
                "name": name,
                "label": label,
                "many": self.parameters[name].is_many,
                "required": self._needs(name),
                "result": name in self.results,
            }
            for name, label in self.taken.items()
        ]
        words = (inspect.getdoc(self.function) or "").partition("\n")[0]
        about = {"name": self.name, "label": self.label, "help": words, "design": bool(self.design)}
        return about | {"files": files, "first": self.first, "fields": fields, "required": required}

    def _needs(self, name: str) -> bool:
        one = self.parameters[name]
        return one.is_required or one.kind is inspect.Parameter.VAR_POSITIONAL

    def call(
        self,
        asked: Mapping[str, Any],
        path: Callable[[str], Path],
        folder: Path,
        design: Path,
        changes: Sequence[str] = (),
    ) -> Call:
        """Return the call of the function for a request of a page.

        Parameters
        ----------
        asked
            Values by the names of `form`; for a file, its name or a list of names of dropped files.
        path
            Function that returns the path of a dropped file by its name.
        folder
            Folder in which files are written, except those next to the design.
        design, changes
            The open design, and its changes, as ``--set`` accepts them.

        Raises
        ------
        SpecError
            If a value is missing, unknown or breaks a limit.
        """
        fields = self.form()["fields"]
        left: tuple[Any, ...] = (None, "", [])
        asked = {
            name: value
            for name, value in asked.items()
            if value not in left and value != fields.get(name, {}).get("default")
        }
        for name in asked:
            if name not in fields and name not in self.taken:
                raise SpecError(name, limit=f"is not an option of solen {self.name}")
        values: dict[str, Any] = {name: folder / file for name, file in self.written.items()}
        values |= {
            name: design.parent / self._name_beside(name, {"design": design.stem, **asked}) for name in self.beside
        }
        values |= {self.design: design} if self.design else {}
        values |= {"set_": tuple(changes)} if changes else {}
        values |= {"figure": FigureOptions(figure=folder / FIGURE)} if "figure" in self.parameters else {}
        for name, options in self.groups.items():
            stated = {key: asked[key] for key in options.model_fields if key in asked}
            paths = {key: path(str(stated[key])) for key in stated if fields[key].get("format") == "path"}
            if stated or self.parameters[name].is_required:
                values[name] = options(**stated | paths)
        for name in asked.keys() & self.taken.keys():
            names = asked[name] if isinstance(asked[name], list) else [asked[name]]
            several = [path(str(name)) for name in names]
            taken = several if self.parameters[name].is_path else [str(one) for one in several]
            values[name] = taken if self.parameters[name].is_many else taken[0]
        values |= {name: self.plain[name].converted(asked[name]) for name in asked.keys() & self.plain.keys()}
        for name in self.parameters:
            if name not in values and (self._needs(name) if name in self.taken else self.parameters[name].is_required):
                raise SpecError(self.taken.get(name, name), limit="is missing", remedy="state it")
        given = {name: values[name] for name in self.parameters if name in values}
        return Call(self.name, self.function, given, self.live)

    def _name_beside(self, name: str, asked: Mapping[str, Any]) -> str:
        """Return the name of a file next to the design; `SpecError` without the value that it is made from."""
        try:
            return safe_name(self.beside[name].format(**asked))
        except KeyError as bad:
            raise SpecError(str(bad.args[0]), limit="is missing", remedy="state it") from None


def _flat(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return a schema in which an optional value has only its own type, without null."""
    kinds = [one for one in schema.get("anyOf", ()) if one.get("type") != "null"]
    flat = {key: value for key, value in schema.items() if key not in {"anyOf", "title"}}
    return flat | (kinds[0] if len(kinds) == 1 else {})
