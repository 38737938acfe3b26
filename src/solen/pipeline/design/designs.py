"""Design files: read with assignments, or written from an example."""

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
    """Return the design of a file with ``key=value`` assignments applied; the last assignment to a key has priority."""
    design = load(path)
    changes = dict(parse_assignment(text) for text in assignments or ())
    return with_values(design, changes) if changes else design


def is_scene(path: Path, design_options: Mapping[str, object]) -> bool:
    """Return whether a file is a scene, not a design; raise `SpecError` if it is and options of designs are given."""
    if path.suffix.lower() != SCENE_SUFFIX:
        return False
    for name, value in design_options.items():
        if value is not None and value is not False:
            limit = "applies to designs only"
            raise SpecError(name, value=None if value is True else value, limit=limit, remedy="omit it")
    return True


def provenance_of(path: Path) -> Provenance:
    """Return the name and checksum of a design file, as a source of its results."""
    return Provenance(file=path.name, sha256=hashlib.sha256(path.read_bytes()).hexdigest(), format="design")


def new(folder: Path, /, *, example: str = "solen-860") -> Outcome[NewDesign]:
    """Write a commented design file, FOLDER/sensor.toml, and its schema for editors.

    Parameters
    ----------
    folder
        Folder for the files; created if missing.
    example
        The shipped design: solen-860, solen-500, solen-450 or pmma-860, with a commercial LED, in space; press-860, a
        soft sensor under a finger; hand-860, robot-860 or strip-860, networks of guides; paper-860, paper-500 or
        paper-450, with a point source in the plane, as simulated in the publication.
    """
    text = f"#:schema {SCHEMA_NAME}\n{template(example)}"
    with files.output_folder(folder):
        target, schema = folder / DESIGN_NAME, folder / SCHEMA_NAME
        if target.exists():
            raise OutputError(str(target), limit="already exists", remedy="specify another folder, or remove the file")
        files.write_all({target: text.encode(), schema: json.dumps(json_schema(), indent=1).encode()})
    return Outcome(NewDesign(target, example), {"schema": schema})
