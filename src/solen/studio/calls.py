"""A call of the function of a command: run as a job, and written as a command line or a script."""

import importlib
import inspect
import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from solen.files import write_text
from solen.results import Outcome
from solen.spec.strict import Options
from solen.studio.jobs import Reporter
from solen.studio.signature import Parameter, is_fixed, option_name, parameters_of

PrintedLines = Callable[[str, Any], Sequence[str]]
"""Function that returns the lines that a command prints, given its name and result."""


@dataclass(frozen=True)
class Call:
    """A call of the function of a command.

    Attributes
    ----------
    name
        The command without ``solen``.
    function
        Function of the command.
    values
        The given values, keyed by parameter, in the order of the function.
    live
        Class of the observer, ``module:name``, keyed by the parameter that accepts it; created with a `Reporter`.
    """

    name: str
    function: Callable[..., Outcome[Any]]
    values: Mapping[str, Any]
    live: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of the function, keyed by name."""
        return parameters_of(self.function)

    def run(self, report: Reporter) -> Outcome[Any]:
        """Call the function; report its progress and live values."""
        arguments = dict(self.values)
        for name, location in self.live.items():
            module, _, factory = location.partition(":")
            arguments[name] = getattr(importlib.import_module(module), factory)(report)
        if "progress" in self.parameters:
            arguments["progress"] = lambda share: report(share=share)
        positional, keywords = self._split(arguments)
        return self.function(*positional, **keywords)

    def _split(self, arguments: Mapping[str, Any]) -> tuple[list[Any], dict[str, Any]]:
        positional: list[Any] = []
        keywords: dict[str, Any] = {}
        for name, value in arguments.items():
            kind = self.parameters[name].kind
            if kind is inspect.Parameter.VAR_POSITIONAL:
                positional += value
            elif kind is inspect.Parameter.POSITIONAL_ONLY:
                positional.append(value)
            else:
                keywords[name] = value
        return positional, keywords

    @property
    def shell(self) -> str:
        """The same call as a command line."""
        options = ["solen", *self.name.split()]
        for name, value in self.values.items():
            parameter = self.parameters[name]
            if isinstance(value, Options):
                for key, item in given_options(value).items():
                    annotation = type(value).model_fields[key].annotation
                    options += option_words(option_name(key), f"--no-{key}", item, fixed=is_fixed(annotation))
            elif parameter.is_positional:
                options += [str(item) for item in (value if isinstance(value, list) else [value])]
            else:
                options += option_words(*parameter.option, value)
        return shlex.join(options)

    @property
    def python(self) -> str:
        """The same call as a Python script."""
        imports = {f"from {self.function.__module__} import {self.function.__name__}"}
        positional, keywords = self._split({name: value for name, value in self.values.items() if is_given(value)})
        for value in keywords.values():
            if isinstance(value, Options):
                imports.add(f"from {type(value).__module__} import {type(value).__name__}")
        arguments = [*map(_written, positional), *(f"{name}={_written(value)}" for name, value in keywords.items())]
        if any("Path(" in argument for argument in arguments):
            imports.add("from pathlib import Path")
        call = [f"found = {self.function.__name__}(", *(f"    {argument}," for argument in arguments), ")"]
        return "\n".join([*sorted(imports), "", *call, "print(found.result)"])


def run_call(
    report: Reporter,
    call: Call,
    printed_lines: PrintedLines | None,
    about: Mapping[str, Any] | None = None,
    record: Path | None = None,
) -> Mapping[str, Any]:
    """Run a command as the work of a job; return its printed lines, its result as in ``--json``, and its files.

    The job, described by ``about``, is also written to ``record``, so that `solen.studio.workspace` can show it again
    later.
    """
    outcome = call.run(report)
    lines = list(printed_lines(call.name, outcome.result)) if printed_lines is not None else []
    files = {name: str(path) for name, path in outcome.files.items()}
    content = {"lines": lines, "result": outcome.to_dict(), "files": files}
    if record is not None:
        write_text(record, json.dumps({"name": call.name, "about": about, "news": content}, allow_nan=False))
    return content


def option_words(option: str, negative: str, value: Any, *, fixed: bool = False) -> list[str]:
    """Return the words of a command line for an option, which is repeated for a list of values unless ``fixed``."""
    if isinstance(value, bool):
        return [option if value else negative.replace("_", "-")]
    if fixed and isinstance(value, tuple):
        return [option, *map(str, value)]
    if isinstance(value, list | tuple):
        repeated = [[option, str(item)] for item in value]
        return [word for options in repeated for word in options]
    return [option, str(value)]


def given_options(options: Options) -> dict[str, Any]:
    """Return the values of the options that are given."""
    return {key: getattr(options, key) for key in type(options).model_fields if key in options.model_fields_set}


def is_given(value: Any) -> bool:
    """Return whether a script must contain a value; options that all have their defaults are omitted."""
    return not isinstance(value, Options) or bool(given_options(value))


def _written(value: Any) -> str:
    if isinstance(value, Options):
        arguments_text = ", ".join(f"{key}={_written(item)}" for key, item in given_options(value).items())
        return f"{type(value).__name__}({arguments_text})"
    if isinstance(value, Path):
        return f"Path({str(value)!r})"
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    return repr(value)
