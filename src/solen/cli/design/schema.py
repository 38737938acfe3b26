"""`solen schema`: the JSON Schema of the design file, or of the JSON output of a command."""

import json
import typing
from importlib import import_module
from typing import Any

from solen.cli.commands import COMMANDS, GROUPS
from solen.errors import SpecError
from solen.results import Outcome, schema_of
from solen.spec import json_schema
from solen.spec.strict import nearest

DIALECT = "https://json-schema.org/draft/2020-12/schema"
FILES = {
    "type": "object",
    "additionalProperties": {"type": "string"},
    "description": "Files written by the command, keyed by content.",
}


def schema(*command: str) -> None:
    """Print the JSON Schema of the design file, or of the result of a command.

    Parameters
    ----------
    command
        A command, such as bench analyse; default: the schema of the design file.
    """
    print(json.dumps(result_schema(command) if command else json_schema(), indent=1))


def result_schema(command: tuple[str, ...]) -> dict[str, Any]:
    """Return the schema of the JSON output of a command; raise `SpecError` if there is none."""
    name = " ".join(command)
    result = result_type(_function_path(name))
    if result is None:
        raise SpecError("command", value=name, limit="has no JSON output", remedy="see docs/commands.md")
    inner = schema_of(result)
    schemas = [_with_files(schema) for schema in inner.get("anyOf", [inner])]
    head = {"$schema": DIALECT, "title": f"solen {name}"}
    return head | ({"anyOf": schemas} if len(schemas) > 1 else schemas[0] | head)


def result_type(path: str) -> Any:
    """Return the result type of the command function at ``module:function``; None if it has no typed result."""
    module, _, function = path.partition(":")
    returned = typing.get_type_hints(getattr(import_module(f"solen.cli.{module}"), function)).get("return")
    alternatives = (returned, *typing.get_args(returned))  # a command may also return None
    types = tuple(typing.get_args(kind)[0] for kind in alternatives if typing.get_origin(kind) is Outcome)
    return typing.Union[types] if types else None  # noqa: UP007 - a variable number of types


def commands() -> dict[str, str]:
    """Return the functions (``module:function``) of all commands, keyed by command, such as ``bench analyse``."""
    return {f"{group} {name}".strip(): path for group, rows in COMMANDS.items() for name, path, _ in rows}


def _function_path(name: str) -> str:
    paths = commands()
    if name in paths:
        return paths[name]
    in_group = [command for command in paths if command.startswith(f"{name} ")] if name in GROUPS else []
    similar = nearest(name, paths)
    remedy = f"did you mean {similar}?" if similar else "see solen --help"
    if in_group:
        remedy = f"specify one of {', '.join(in_group)}"
    raise SpecError("schema", value=name, limit="is not a command", remedy=remedy)


def _with_files(schema: dict[str, Any]) -> dict[str, Any]:
    properties = schema.get("properties", {}) | {"files": FILES}
    return schema | {"properties": properties, "required": list(properties)}
