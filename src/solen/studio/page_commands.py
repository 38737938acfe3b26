"""Commands in the tabs: their forms, calls, command lines and scripts, derived from the functions of the commands.

`solen resin cure` is `solen.pipeline.resin.cure.cure`, whose parameters and `Options` define names, units, limits and
help once. A `PageCommand` names that function and specifies which parameters are files dropped on a page, which are
files to write, and which is the open design; everything else is taken from the signature. A page can therefore request
exactly the parameters of the command, and "the same elsewhere" is the call itself in text form.

Public name: `PageCommand`.
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

SUPPLIED = ("progress", "figure", "set_")
"""Parameters that the studio supplies itself; they appear neither on a page nor in a `PageCommand`."""
FIGURE = "figure.svg"


@dataclass(frozen=True)
class PageCommand:
    """A command in a tab.

    Attributes
    ----------
    name
        The command without ``solen``, such as ``resin cure``.
    location
        Function of the command, ``module:name``.
    label
        Short description of the command.
    files, results
        Labels of the parameters for files dropped on the page, and for files that other commands wrote, keyed by
        parameter.
    outputs
        Names of files to write, keyed by parameter; an empty name is the folder itself.
    design_outputs
        Names of files to write next to the design, keyed by parameter; they may contain values and the name of the
        design, such as ``{name}.toml`` or ``{design}-tuning.json``.
    design
        Parameter for the open design; empty if there is none.
    first
        Options that are shown immediately; all others require a further click.
    live
        Class of the observer, ``module:name``, keyed by the parameter that accepts it; created with a `Reporter`.
    hidden
        Parameters that are not shown on a page.
    """

    name: str
    location: str
    label: str
    files: Mapping[str, str] = field(default_factory=dict)
    results: Mapping[str, str] = field(default_factory=dict)
    outputs: Mapping[str, str] = field(default_factory=dict)
    design_outputs: Mapping[str, str] = field(default_factory=dict)
    design: str = ""
    first: tuple[str, ...] = ()
    live: Mapping[str, str] = field(default_factory=dict)
    hidden: tuple[str, ...] = ()

    @property
    def file_labels(self) -> dict[str, str]:
        """Labels of all file parameters."""
        return {**self.files, **self.results}

    @property
    def last_word(self) -> str:
        """Last word of the command, for names of folders."""
        return self.name.rpartition(" ")[2]

    @property
    def module(self) -> str:
        """Module of the function."""
        return self.location.partition(":")[0]

    @cached_property
    def function(self) -> Callable[..., Outcome[Any]]:
        """The function of the command."""
        module, _, name = self.location.partition(":")
        function: Callable[..., Outcome[Any]] = getattr(importlib.import_module(module), name)
        return function

    @cached_property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of the function, keyed by name."""
        return parameters_of(self.function)

    @cached_property
    def groups(self) -> dict[str, type[Options]]:
        """Classes of options, keyed by parameter."""
        return {
            name: parameter.options
            for name, parameter in self.parameters.items()
            if parameter.options and name not in SUPPLIED
        }

    @cached_property
    def single_parameters(self) -> dict[str, Parameter]:
        """Parameters that are individual fields of the form."""
        supplied = {*SUPPLIED, *self.outputs, *self.design_outputs, *self.live, *self.hidden, self.design}
        excluded = {*supplied, *self.groups, *self.file_labels}
        return {
            name: parameter
            for name, parameter in self.parameters.items()
            if name not in excluded and not parameter.is_path
        }

    def form(self) -> dict[str, Any]:
        """Return the form of the command as JSON Schema; its paths are names of dropped files."""
        descriptions = described(self.function)
        fields: dict[str, Any] = {}
        for name, parameter in self.single_parameters.items():
            schema = TypeAdapter(parameter.hint).json_schema()
            default = {} if parameter.is_required else {"default": parameter.default}
            fields[name] = _flat({"description": descriptions.get(name, ""), **schema, **default})
        required = [name for name, parameter in self.single_parameters.items() if parameter.is_required]
        for options in self.groups.values():
            schema = options.model_json_schema()
            fields |= {name: _flat(field_schema) for name, field_schema in schema["properties"].items()}
            required += schema.get("required", [])
        files = [
            {
                "name": name,
                "label": label,
                "many": self.parameters[name].is_many,
                "required": self._is_required(name),
                "result": name in self.results,
            }
            for name, label in self.file_labels.items()
        ]
        summary = (inspect.getdoc(self.function) or "").partition("\n")[0]
        about = {"name": self.name, "label": self.label, "help": summary, "design": bool(self.design)}
        return about | {"files": files, "first": self.first, "fields": fields, "required": required}

    def _is_required(self, name: str) -> bool:
        parameter = self.parameters[name]
        return parameter.is_required or parameter.kind is inspect.Parameter.VAR_POSITIONAL

    def call(
        self,
        request: Mapping[str, Any],
        path: Callable[[str], Path],
        folder: Path,
        design: Path,
        changes: Sequence[str] = (),
    ) -> Call:
        """Return the call of the function for a request from a page.

        Parameters
        ----------
        request
            Values, keyed by the names in `form`; for a file, the name or a list of names of dropped files.
        path
            Function that returns the path of a dropped file, given its name.
        folder
            Folder in which files are written, except those next to the design.
        design, changes
            The open design, and its changes, as ``--set`` accepts them.

        Raises
        ------
        SpecError
            If a value is missing, unknown or outside its limits.
        """
        fields = self.form()["fields"]
        empty: tuple[Any, ...] = (None, "", [])
        request = {
            name: value
            for name, value in request.items()
            if value not in empty and value != fields.get(name, {}).get("default")
        }
        for name in request:
            if name not in fields and name not in self.file_labels:
                raise SpecError(name, limit=f"is not an option of solen {self.name}")
        values: dict[str, Any] = {name: folder / file for name, file in self.outputs.items()}
        values |= {
            name: design.parent / self._design_output_name(name, {"design": design.stem, **request})
            for name in self.design_outputs
        }
        values |= {self.design: design} if self.design else {}
        values |= {"set_": tuple(changes)} if changes else {}
        values |= {"figure": FigureOptions(figure=folder / FIGURE)} if "figure" in self.parameters else {}
        for name, options in self.groups.items():
            given_options = {key: request[key] for key in options.model_fields if key in request}
            paths = {key: path(str(given_options[key])) for key in given_options if fields[key].get("format") == "path"}
            if given_options or self.parameters[name].is_required:
                values[name] = options(**given_options | paths)
        for name in request.keys() & self.file_labels.keys():
            names = request[name] if isinstance(request[name], list) else [request[name]]
            paths_of_files = [path(str(file)) for file in names]
            arguments = paths_of_files if self.parameters[name].is_path else list(map(str, paths_of_files))
            values[name] = arguments if self.parameters[name].is_many else arguments[0]
        values |= {
            name: self.single_parameters[name].converted(request[name])
            for name in request.keys() & self.single_parameters.keys()
        }
        for name in self.parameters:
            if name not in values and (
                self._is_required(name) if name in self.file_labels else self.parameters[name].is_required
            ):
                raise SpecError(self.file_labels.get(name, name), limit="is missing")
        ordered = {name: values[name] for name in self.parameters if name in values}
        return Call(self.name, self.function, ordered, self.live)

    def _design_output_name(self, name: str, request: Mapping[str, Any]) -> str:
        """Return the name of a file next to the design; raise `SpecError` if it contains a value that is missing."""
        try:
            return safe_name(self.design_outputs[name].format(**request))
        except KeyError as bad:
            raise SpecError(str(bad.args[0]), limit="is missing") from None


def _flat(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return a schema in which an optional value has only its own type, without null."""
    types = [kind for kind in schema.get("anyOf", ()) if kind.get("type") != "null"]
    flat = {key: value for key, value in schema.items() if key not in {"anyOf", "title"}}
    return flat | (types[0] if len(types) == 1 else {})
