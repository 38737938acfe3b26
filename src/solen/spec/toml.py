"""The design file: reading and writing TOML, setting single values by dotted keys, and the JSON Schema.

A file contains ``schema``, ``name`` and the differences from the defaults. Reading migrates old schemas, then rejects
anything unknown. Writing omits defaults, and reading a written file gives the same design.

Public names: `load`, `loads`, `dumps`, `save`, `with_values`, `value_at`, `parse_assignment` and `json_schema`.
"""

import os
import re
import tomllib
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from solen.errors import SpecError
from solen.files import read_text, write_text
from solen.results import plain
from solen.spec.design import Design
from solen.spec.light import Emitter
from solen.spec.strict import Document, Migrations, error_context, migrated, parse_toml

SCHEMA = 1
MIGRATIONS: Migrations = {}  # old version -> function that converts its tables to the next version

# Setting one of these keys removes the other, because a design contains only one of them.
_REPLACES = {
    "material.index": "material.resin",
    "material.resin": "material.index",
    "motion.depths_mm": "motion.forces_N",
    "motion.forces_N": "motion.depths_mm",
}


def load(path: Path | str) -> Design:
    """Load a design file.

    Parameters
    ----------
    path
        The design file. Relative paths in it are based on its folder.

    Raises
    ------
    SpecError
        If the file cannot be read, is not TOML, has another schema, or is not a valid design.
    """
    path = Path(path)
    return loads(read_text(path, SpecError), what=str(path), folder=path.absolute().parent)


def loads(text: str, *, what: str = "design", folder: Path | None = None) -> Design:
    """Return the design defined by a TOML string.

    ``what`` is the name used in error messages, and ``folder`` is the base folder of relative paths.
    """
    data = parse_toml(text, what, SpecError)
    data = migrated(data, what, current=SCHEMA, migrations=MIGRATIONS, error=SpecError)
    with error_context(what):
        design = Design(**data)
    return design if folder is None else design.in_folder(folder)


def _document(design: Design, *, keep_set: bool = False) -> Document:
    """Return the tables of the file without ``schema``: the name, and values that differ from the defaults.

    With ``keep_set``, emitter keys set to their defaults are also kept, because a part named later may have other
    values.
    """
    tables: Document = {"name": design.name}
    for key in Design.model_fields.keys() - {"name"}:
        table = design.shared_emitter if key == "emitter" else getattr(design, key)
        if isinstance(table, tuple):
            tables[key] = [entry.model_dump(exclude_defaults=True) for entry in table]
        else:
            tables[key] = table.model_dump(exclude_defaults=True)
    if design.material.resin is not None and design.material.sets_absorption:
        tables["material"]["absorption_per_mm"] = design.material.absorption_per_mm  # a 0 overrides the resin's value
    emitter = design.shared_emitter
    keys = [key for key in DEFERRED if emitter.sets(key)] if keep_set else _needed_defaults(emitter)
    tables["emitter"] |= {key: getattr(emitter, key) for key in keys}
    return {key: tables[key] for key in Design.model_fields if tables[key]}


DEFERRED = ("wavelength_nm", "width_mm", "height_mm", "cone_deg", "pattern")
"""Emitter keys whose defaults depend on a part, a spectrum or a pattern."""


def _needed_defaults(emitter: Emitter) -> list[str]:
    """Return the keys that must be written even if set to their defaults, which a part or pattern would override."""
    keys: tuple[str, ...] = DEFERRED if emitter.part else ()
    keys += ("wavelength_nm",) if emitter.spectrum else ()
    keys += ("cone_deg",) if emitter.pattern != "fan" else ()
    return [key for key in dict.fromkeys(keys) if emitter.sets(key)]


def dumps(design: Design) -> str:
    """Return a design as a TOML string without defaults; `loads` restores the design."""
    return tomli_w.dumps({"schema": SCHEMA, **_document(design)})


@plain.register
def _(design: Design) -> Any:
    """Convert a design in a result to the tables of its design file, without defaults."""
    return plain(_document(design))


def save(path: Path | str, design: Design) -> Path:
    """Write a design file atomically, with paths relative to its folder.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    path = Path(path)
    return write_text(path, dumps(_moved(design, path.absolute().parent)))


def _moved(design: Design, folder: Path) -> Design:
    """Return the design with its paths relative to ``folder``."""
    if design.folder.absolute() == folder:
        return design.in_folder(folder)
    named = {key: path for key, path in design.files.items() if not Path(value_at(design, key)).is_absolute()}
    moved = {key: _from(path.absolute(), folder) for key, path in named.items()}
    return with_values(design, moved).in_folder(folder)


def _from(path: Path, folder: Path) -> str:
    """Return the path of a file relative to ``folder``."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on Windows, another drive
        return path.as_posix()


def with_values(design: Design, values: Mapping[str, Any]) -> Design:
    """Return a design with some values changed.

    Parameters
    ----------
    design
        The design to start from, which is not changed.
    values
        New values by dotted key (``"lens.focus_mm"``, ``"wall[0].index"``, ``"lens.knots_um[0]"``), as TOML would write
        them; None resets an optional key to its default. Setting ``material.index`` removes a resin and vice versa; the
        depths and forces of a motion replace each other in the same way.

    Raises
    ------
    SpecError
        If a key is unknown or the design would be invalid.
    """
    data = deepcopy(_document(design, keep_set=True))
    for key, value in values.items():
        other = replaced_by(key)
        if other and value is not None and other not in values:
            table, name = path_of(other)
            data.get(table, {}).pop(name, None)
        _set(data, key, value)
    return Design(**data).in_folder(design.folder)


def replaced_by(key: str) -> str:
    """Return the key that is removed when a key is set, or an empty string if there is none."""
    return _REPLACES.get(key, "")


def value_at(design: Design, key: str) -> Any:
    """Return the value of a dotted key (``"lens.focus_mm"``, ``"hold[1].to_mm"``, ``"lens.knots_um[0]"``).

    Keys that the design does not contain have their default value.

    Raises
    ------
    SpecError
        If the key is unknown, or a list has no such entry.
    """
    path = path_of(key)
    value: Any = design if len(path) > 1 else None
    for name in path:
        if value is None and name.startswith("["):
            raise SpecError(key, limit="the list is empty", remedy="set the whole list")
        if isinstance(value, tuple):
            value = value[_index(key, name, len(value))]
        elif isinstance(value, BaseModel) and name in type(value).model_fields:
            value = getattr(value, name)
        else:
            raise SpecError(key, limit="unknown key", remedy="list the keys with solen schema")
    return value


def path_of(key: str) -> list[str]:
    """Return the parts of a dotted key; a list index is a separate part: ``lens``, ``knots_um``, ``[0]``."""
    return re.split(r"\.|(?=\[)", key)


def _index(key: str, name: str, size: int) -> int:
    """Return the index of a list entry; raise `SpecError` if the list has too few entries."""
    entry = re.fullmatch(r"\[(\d+)\]", name)
    if entry and int(entry[1]) < size:
        return int(entry[1])
    raise SpecError(key, limit=f"the list has {size} entries, counted from 0", remedy="set the whole list")


def _set(data: Document, key: str, value: Any) -> None:
    container: Any = data
    *parents, last = path_of(key)
    for outer, name in zip(["", *parents], parents, strict=False):
        entry = _entry(container, key, outer, name)
        inner = container[entry] if isinstance(container, list) else container.setdefault(entry, {})
        if isinstance(inner, tuple):
            inner = container[entry] = list(inner)
        container = inner
    container[_entry(container, key, parents[-1] if parents else "", last)] = value


def _entry(container: Any, key: str, outer: str, name: str) -> Any:
    """Return the key of a table entry or the index of a list entry; raise `SpecError` if there can be no such entry."""
    if isinstance(container, list) or (name.startswith("[") and not container):
        return _index(key, name, len(container))
    if name.startswith("[") or not isinstance(container, dict):
        raise SpecError(key, limit=f"unknown key: {outer} is a value and has no keys", remedy=f"set {outer} itself")
    return name


def parse_assignment(text: str) -> tuple[str, Any]:
    """Return the key and value of ``key=value``; the value is parsed as TOML if possible, and is a string otherwise."""
    key, equals, value = text.partition("=")
    if not (equals and key.strip()):
        raise SpecError(text, limit="is not of the form key=value", remedy="write, for example, lens.focus_mm=25")
    return key.strip(), _value(value.strip())


def _value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return parsed["value"] if len(parsed) == 1 else text


class _FileSchema(GenerateJsonSchema):
    """JSON Schema of a TOML file, in which optional keys are never null, because TOML has no null."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        inner = super().default_schema(schema)
        return {key: value for key, value in inner.items() if (key, value) != ("default", None)}


def json_schema() -> Document:
    """Return the JSON Schema of the design file, for editors that check and complete it."""
    schema = Design.model_json_schema(schema_generator=_FileSchema)
    version = {"const": SCHEMA, "type": "integer", "description": "Version of this file format."}
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "solen design file"
    schema["description"] = "A sensor: its name, material, optics, body, motion and ray trace."
    schema["properties"] = {"schema": version, **schema["properties"]}
    schema["required"] = ["schema", *schema["required"]]
    return schema
