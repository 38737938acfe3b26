"""Commands that tabs offer: from the signature of a command's function a form, a call, a command line and a script.

The idea: `solen resin cure` is `solen.pipeline.resin.cure.cure`, whose parameters and `Options` state names, units,
limits and help once. An `Offer` names that function and says which of its parameters are files that a page drops, which
are written, and which is the open design; all else is read from the signature. So a page can ask for what the command
takes, no more and no less, and "the same elsewhere" is the call itself, written out.

The interface: `Offer.form` for the page, `Offer.call` of what a page asks, `perform` as the work of a job.
"""

import importlib
import inspect
import shlex
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from solen.errors import SpecError
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.spec.strict import Options, option_refusal
from solen.studio.jobs import Tell

Value = Any
INJECTED = ("progress", "figure", "set_")
"""Parameters that neither a page nor an offer states."""
FIGURE = "figure.svg"
Shown = Callable[[str, Any], Sequence[str]]
"""Lines that a command prints of its result, by the command's name."""


@dataclass(frozen=True)
class Offer:
    """A command that a tab offers.

    Attributes
    ----------
    name
        The command without ``solen``, as ``resin cure``.
    where
        Its function, ``module:name``.
    label
        What it is for, in few words.
    files, results
        Parameters that take files dropped on the page, and files that other commands wrote, with their labels.
    written
        Parameters that take a file to be written, with its name; an empty name is the folder itself.
    design
        Parameter that takes the open design; empty if there is none.
    first
        Options that are asked first; all others are behind a further click.
    """

    name: str
    where: str
    label: str
    files: Mapping[str, str] = field(default_factory=dict)
    results: Mapping[str, str] = field(default_factory=dict)
    written: Mapping[str, str] = field(default_factory=dict)
    design: str = ""
    first: tuple[str, ...] = ()

    @property
    def taken(self) -> dict[str, str]:
        """Labels of all parameters that take files."""
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
    def parameters(self) -> dict[str, "Parameter"]:
        """Parameters of the function by name."""
        hints = typing.get_type_hints(self.function, include_extras=True)
        signature = inspect.signature(self.function).parameters
        return {name: Parameter(name, hints[name], one) for name, one in signature.items()}

    @cached_property
    def groups(self) -> dict[str, type[Options]]:
        """Classes of options by parameter."""
        return {name: one.options for name, one in self.parameters.items() if one.options and name not in INJECTED}

    @cached_property
    def plain(self) -> dict[str, "Parameter"]:
        """Parameters that a page states one by one."""
        known = {*INJECTED, *self.groups, *self.taken, *self.written, self.design}
        return {name: one for name, one in self.parameters.items() if name not in known and not one.is_path}

    def form(self) -> dict[str, Any]:
        """What a page asks for, as JSON Schema; paths among it are names of dropped files."""
        described = _described(self.function)
        fields: dict[str, Any] = {}
        for name, one in self.plain.items():
            schema = TypeAdapter(one.hint).json_schema()
            default = {} if one.is_required else {"default": one.default}
            fields[name] = _flat({"description": described.get(name, ""), **schema, **default})
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
        design: Path | None = None,
        changes: Sequence[str] = (),
    ) -> "Call":
        """The call of the function for what a page asks.

        Parameters
        ----------
        asked
            Values by the names of `form`; of a file the name, or a list of names, of what was dropped.
        path
            Path of a dropped file by its name.
        folder
            Where files are written.
        design, changes
            The open design, and what is changed in it, as ``--set`` takes it.

        Raises
        ------
        SpecError
            If a value is missing, unknown or breaks a limit.
        """
        asked = {name: value for name, value in asked.items() if value is not None and value != "" and value != []}
        form = self.form()
        for name in asked:
            if name not in form["fields"] and name not in self.taken:
                raise SpecError(name, limit=f"is no option of solen {self.name}")
        values: dict[str, Any] = {}
        for name, parameter in self.parameters.items():
            if name in self.groups:
                options = self.groups[name]
                stated = {key: asked[key] for key in options.model_fields if key in asked}
                paths = {key: path(str(stated[key])) for key in stated if form["fields"][key].get("format") == "path"}
                values[name] = options(**stated | paths)
            elif name in self.taken and name in asked:
                many = asked[name] if isinstance(asked[name], list) else [asked[name]]
                values[name] = [path(str(one)) for one in many] if parameter.is_many else path(str(many[0]))
            elif name in self.written:
                values[name] = folder / self.written[name]
            elif name == self.design:
                values[name] = design
            elif name == "figure":
                values[name] = FigureOptions(figure=folder / FIGURE)
            elif name == "set_" and changes:
                values[name] = tuple(changes)
            elif name in self.plain and name in asked:
                values[name] = parameter.converted(asked[name])
            elif name != "progress" and self._needs_stated(name):
                raise SpecError(self.taken.get(name, name), limit="is missing", remedy="state it")
        return Call(self, values)

    def _needs_stated(self, name: str) -> bool:
        return self._needs(name) if name in self.taken else self.parameters[name].is_required


@dataclass(frozen=True)
class Parameter:
    """A parameter of a command's function."""

    name: str
    hint: Any
    signature: inspect.Parameter

    @property
    def kind(self) -> Any:
        """How it is passed."""
        return self.signature.kind

    @property
    def default(self) -> Any:
        """Its default."""
        return self.signature.default

    @property
    def is_required(self) -> bool:
        """Whether it must be stated."""
        return self.default is inspect.Parameter.empty and self.kind is not inspect.Parameter.VAR_POSITIONAL

    @property
    def is_positional(self) -> bool:
        """Whether a command line states it without its name."""
        return self.kind in {inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.VAR_POSITIONAL}

    @property
    def is_many(self) -> bool:
        """Whether it takes several values."""
        return self.kind is inspect.Parameter.VAR_POSITIONAL or any(
            typing.get_origin(one) in {list, tuple} for one in _inside(self.hint)
        )

    @property
    def is_path(self) -> bool:
        """Whether it is a path, or several."""
        return any(one is Path for one in _inside(self.hint))

    @property
    def options(self) -> type[Options] | None:
        """Its class, if it is one of options."""
        for one in _inside(self.hint):
            if isinstance(one, type) and issubclass(one, Options):
                return one
        return None

    @property
    def option(self) -> tuple[str, str]:
        """What a command line writes for it, and for the negative of a flag."""
        own, negative = option_name(self.name), f"--no-{self.name}"
        for note in getattr(self.hint, "__metadata__", ()):
            named = [one for one in getattr(note, "name", None) or () if one.startswith("--")]
            own = named[0] if named else own
            negative = next(iter(getattr(note, "negative", None) or ()), negative)
        return own, negative

    def converted(self, value: Any) -> Any:
        """A value of a page as the function takes it; `SpecError` where it is none."""
        try:
            return TypeAdapter(self.hint).validate_python(value)
        except ValidationError as bad:
            refused = option_refusal(bad)
            raise SpecError(self.name, value=refused.value, limit=refused.limit, remedy=refused.remedy) from None


@dataclass(frozen=True)
class Call:
    """A call of a command's function: the values that are stated, by parameter."""

    offer: Offer
    values: Mapping[str, Any]

    def run(self, progress: Callable[[float], None] | None = None) -> Outcome[Any]:
        """Call it."""
        given = dict(self.values)
        if "progress" in self.offer.parameters:
            given["progress"] = progress
        first, keywords = self._split(given)
        return self.offer.function(*first, **keywords)

    def _split(self, given: Mapping[str, Any]) -> tuple[list[Any], dict[str, Any]]:
        first: list[Any] = []
        keywords: dict[str, Any] = {}
        for name, value in given.items():
            kind = self.offer.parameters[name].kind
            if kind is inspect.Parameter.VAR_POSITIONAL:
                first += value
            elif kind is inspect.Parameter.POSITIONAL_ONLY:
                first.append(value)
            else:
                keywords[name] = value
        return first, keywords

    @property
    def shell(self) -> str:
        """The same from the command line."""
        words = ["solen", *self.offer.name.split()]
        for name, value in self.values.items():
            parameter = self.offer.parameters[name]
            if isinstance(value, Options):
                for key, one in stated(value).items():
                    annotation = type(value).model_fields[key].annotation
                    words += option_words(option_name(key), f"--no-{key}", one, fixed=_is_fixed(annotation))
            elif parameter.is_positional:
                words += [str(one) for one in (value if isinstance(value, list) else [value])]
            else:
                words += option_words(*parameter.option, value)
        return shlex.join(words)

    @property
    def python(self) -> str:
        """The same in Python."""
        imports = {f"from {self.offer.module} import {self.offer.function.__name__}"}
        first, keywords = self._split({name: value for name, value in self.values.items() if stated_in_python(value)})
        for value in keywords.values():
            if isinstance(value, Options):
                imports.add(f"from {type(value).__module__} import {type(value).__name__}")
        arguments = [*map(_written, first), *(f"{name}={_written(value)}" for name, value in keywords.items())]
        if any("Path(" in one for one in arguments):
            imports.add("from pathlib import Path")
        call = [f"found = {self.offer.function.__name__}(", *(f"    {one}," for one in arguments), ")"]
        return "\n".join([*sorted(imports), "", *call, "print(found.result)"])


def perform(tell: Tell, call: Call, shown: Shown | None) -> Mapping[str, Any]:
    """Run a command as the work of a job: what it prints, its result as ``--json`` states it, and its files."""
    outcome = call.run(lambda share: tell(share=share))
    lines = list(shown(call.offer.name, outcome.result)) if shown is not None else []
    files = {name: str(path) for name, path in outcome.files.items()}
    return {"lines": lines, "result": outcome.to_dict(), "files": files}


def option_name(field: str) -> str:
    """Name of an option by its field, as the command line has it."""
    return f"--{field.strip('_').replace('_', '-')}"


def option_words(option: str, negative: str, value: Any, *, fixed: bool = False) -> list[str]:
    """Words of a command line for an option; one of a ``fixed`` number of values is stated once."""
    if isinstance(value, bool):
        return [option if value else negative.replace("_", "-")]
    if fixed and isinstance(value, tuple):
        return [option, *map(str, value)]
    if isinstance(value, list | tuple):
        several = [[option, str(one)] for one in value]
        return [word for words in several for word in words]
    return [option, str(value)]


def stated(options: Options) -> dict[str, Any]:
    """Values of options that are stated."""
    return {key: getattr(options, key) for key in type(options).model_fields if key in options.model_fields_set}


def stated_in_python(value: Any) -> bool:
    """Whether a script states a value: not for options that are all left as they are."""
    return not isinstance(value, Options) or bool(stated(value))


def _written(value: Any) -> str:
    if isinstance(value, Options):
        inside = ", ".join(f"{key}={_written(one)}" for key, one in stated(value).items())
        return f"{type(value).__name__}({inside})"
    if isinstance(value, Path):
        return f"Path({str(value)!r})"
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    return repr(value)


def _flat(schema: Mapping[str, Any]) -> dict[str, Any]:
    """A schema in which a value that may be missing is one of its type."""
    kinds = [one for one in schema.get("anyOf", ()) if one.get("type") != "null"]
    flat = {key: value for key, value in schema.items() if key not in {"anyOf", "title"}}
    return flat | (kinds[0] if len(kinds) == 1 else {})


def _is_fixed(hint: Any) -> bool:
    """Whether a type is a tuple of a fixed number of values."""
    return any(typing.get_origin(one) is tuple and ... not in typing.get_args(one) for one in _inside(hint))


def _inside(hint: Any) -> Iterator[Any]:
    """A type and all types in it."""
    yield hint
    if origin := typing.get_origin(hint):
        yield origin
    for one in typing.get_args(hint):
        yield from _inside(one)


def _described(function: Callable[..., Any]) -> dict[str, str]:
    """Descriptions of parameters by the function's docstring."""
    words: dict[str, str] = {}
    names: list[str] = []
    text = (inspect.getdoc(function) or "").partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    for line in text.splitlines():
        if line.startswith(" "):
            words |= {name: f"{words.get(name, '')} {line.strip()}".strip() for name in names}
        else:
            names = [name.strip() for name in line.split(",")]
    return words
