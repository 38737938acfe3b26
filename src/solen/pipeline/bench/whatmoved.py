"""What a recording is of: the motion and the circuit, by the header that a bench wrote or by a design file.

A recording of others says nothing of the pivot; `--design` and `--motion` do.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

from solen.analysis.calibration.file import Circuit, Motion
from solen.errors import SolenError, SpecError
from solen.files import read_text
from solen.pipeline.outputs import check_choice
from solen.recording import Provenance
from solen.spec import Design, loads

KINDS = ("rotation", "bend")


def motion_and_circuit(
    sensor: str, provenance: Provenance | None, design: Path | None, kind: str | None, ambient: str | None
) -> tuple[Motion, Circuit]:
    """Motion and circuit of a sensor's recording; what nothing says is None.

    Raises
    ------
    SpecError
        Where the design file cannot be read, or the motion is none.
    """
    if kind is not None:
        check_choice("--motion", kind, KINDS)
    header = {} if provenance is None else header_of(provenance)
    if design is not None:
        text = read_text(design, SpecError)
        found: Design | None = loads(text, what=str(design), folder=design.absolute().parent)
    else:
        text = _text_of(header, sensor)
        found = _design(text)
    protocol = header.get("protocol_name")
    circuit = Circuit(ambient=ambient)
    if found is None:
        return Motion(kind=kind, protocol=protocol), circuit
    moved, readout = found.motion, found.readout
    pivot = moved.pivot if isinstance(moved.pivot, str) else " ".join(f"{one:g}" for one in moved.pivot)
    motion = Motion(kind=kind or moved.kind, pivot=pivot, parts=tuple(moved.moves), protocol=protocol)
    return motion, Circuit(
        ambient=ambient,
        emitter_current_ma=readout.emitter_current_ma,
        load_ohm=readout.load_ohm,
        design_sha256=hashlib.sha256(text.encode("utf-8")).hexdigest(),
    )


def header_of(provenance: Provenance) -> dict[str, Any]:
    """What a bench wrote at the beginning of a run; empty for recordings of others."""
    try:
        found = json.loads(provenance.metadata.get("header", "{}"))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _text_of(header: dict[str, Any], sensor: str) -> str:
    """Text of the design that a header has for a sensor; without that sensor, of the only one that there is."""
    designs = header.get("designs", {})
    name = next((one.get("design") for one in header.get("sensors", ()) if one.get("name") == sensor), None)
    if name is None and len(designs) == 1:
        name = next(iter(designs))
    return str(designs.get(name, ""))


def _design(text: str) -> Design | None:
    """Design of a header's text; None where there is none, or this solen cannot read it."""
    try:
        return loads(text, what="the recording's design") if text else None
    except SolenError:
        return None
