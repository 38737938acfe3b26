"""Conditions of a recording: motion and circuit, from the bench header or from a design file.

Recordings from other programs do not contain the conditions; `ConditionOptions` supplies them.

Public name: `conditions`.
"""

import hashlib
import json
from pathlib import Path
from typing import Any, Literal

from solen.analysis.calibration.file import Ambient, Circuit, Motion
from solen.errors import SolenError, SpecError
from solen.files import read_text
from solen.recording import Provenance
from solen.spec import Design, loads
from solen.spec.strict import Options


class ConditionOptions(Options):
    """Conditions of a recording that its file does not specify."""

    design: Path | None = None
    """Design file of the sensor, for its motion, pivot, moving parts and circuit."""
    motion: Literal["rotation", "bend", "loaded"] | None = None
    """Kind of motion, if the recording does not specify it."""


def conditions(
    sensor: str, provenance: Provenance | None, options: ConditionOptions, ambient: Ambient | None
) -> tuple[Motion, Circuit]:
    """Return the motion and circuit of a sensor's recording; a condition that is not specified is None.

    Raises
    ------
    SpecError
        If the design file cannot be read.
    """
    header = {} if provenance is None else header_of(provenance)
    if options.design is not None:
        text = read_text(options.design, SpecError)
        design: Design | None = loads(text, what=str(options.design), folder=options.design.absolute().parent)
    else:
        text = _design_text(header, sensor)
        design = _design(text)
    protocol = header.get("protocol_name")
    if design is None:
        return Motion(kind=options.motion, protocol=protocol), Circuit(ambient=ambient)
    table, readout = design.motion, design.readout
    circuit = Circuit(
        ambient=ambient,
        emitter_current_mA=readout.emitter_current_ma,
        load_ohm=readout.load_ohm,
        design_sha256=hashlib.sha256(text.encode("utf-8")).hexdigest(),
    )
    kind = options.motion or table.kind
    if kind == "loaded":
        return Motion(kind="loaded", drives=table.drives, protocol=protocol), circuit
    pivot = table.pivot if isinstance(table.pivot, str) else " ".join(f"{coordinate:g}" for coordinate in table.pivot)
    return Motion(kind=kind, pivot=pivot, parts=tuple(table.moves), protocol=protocol), circuit


def header_of(provenance: Provenance) -> dict[str, Any]:
    """Return the header that a bench writes at the start of a run; empty for recordings from other programs."""
    try:
        header = json.loads(provenance.metadata.get("header", "{}"))
    except ValueError:
        return {}
    return header if isinstance(header, dict) else {}


def _design_text(header: dict[str, Any], sensor: str) -> str:
    """Return the text of a sensor's design in the header; if the sensor is not listed, the text of the only design."""
    designs = header.get("designs", {})
    sensors = header.get("sensors", ())
    name = next((entry.get("design") for entry in sensors if entry.get("name") == sensor), None)
    if name is None and len(designs) == 1:
        name = next(iter(designs))
    return str(designs.get(name, ""))


def _design(text: str) -> Design | None:
    """Return the design in the text from a header, or None if it is missing or this version cannot read it."""
    try:
        return loads(text, what="the recording's design") if text else None
    except SolenError:
        return None
