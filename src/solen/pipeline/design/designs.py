"""Design files: opened with assignments, or newly written."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from solen import files
from solen.errors import OutputError, SpecError
from solen.recording import Provenance
from solen.results import Outcome
from solen.spec import Design, NewDesign, json_schema, load, parse_assignment, template, with_values

DESIGN_NAME, SCHEMA_NAME, SCENE_SUFFIX = "sensor.toml", "sensor.schema.json", ".json"


def open_design(path: Path, assignments: Sequence[str] | None = None) -> Design:
    """Return the design of a file with ``key=value`` assignments applied; the last assignment to a key counts."""
    design = load(path)
    changes = dict(parse_assignment(text) for text in assignments or ())
    return with_values(design, changes) if changes else design


def is_scene(path: Path, of_designs: Mapping[str, object]) -> bool:
    """Return whether a file is a scene rather than a design; raise `SpecError` for options that need a design."""
    if path.suffix.lower() != SCENE_SUFFIX:
        return False
    for name, value in of_designs.items():
        if value is not None and value is not False:
            limit = "applies to a design only; a scene has neither a motion nor keys"
            raise SpecError(name, value=None if value is True else value, limit=limit, remedy="leave it out")
    return True


def provenance_of(path: Path) -> Provenance:
    """Return the name and checksum of a design file, as a source of its results."""
    return Provenance(file=path.name, sha256=hashlib.sha256(path.read_bytes()).hexdigest(), format="design")


def new(folder: Path, /, *, example: str = "solen-860") -> Outcome[NewDesign]:
    """Write a commented design file, FOLDER/sensor.toml, and the schema with which editors check it.

    Parameters
    ----------
    folder
        Where to write it; created if missing.
    example
        Shipped design: solen-860, solen-500, solen-450 or pmma-860, with a commercial LED, in space; press-860, a soft
        sensor under a finger; hand-860, robot-860 or strip-860, networks of guides; paper-860, paper-500 or paper-450,
        with the point source in the plane that the paper simulates.
    """
    text = f"#:schema {SCHEMA_NAME}\n{template(example)}"
    with files.output_folder(folder):
        target, schema = folder / DESIGN_NAME, folder / SCHEMA_NAME
        if target.exists():
            raise OutputError(str(target), limit="already exists", remedy="name another folder or remove it")
        files.write_all({target: text.encode(), schema: json.dumps(json_schema(), indent=1).encode()})
    return Outcome(NewDesign(target, example), {"schema": schema})
