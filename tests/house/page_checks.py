"""Check TOML and JSON blocks of pages with the reader of the file that they show."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from solen.analysis.load_cell import load_cell_of
from solen.bench.protocol import load_protocol
from solen.bench.rig import load_rig
from solen.bench.starter import starter_files
from solen.explore.machines import Slurm
from solen.fabricate.process.features import read_features
from solen.fabricate.process.process_file import parsed_process
from solen.lens import read_profile
from solen.material.resin import load_resin
from solen.parts.datasheet import load_part
from solen.parts.printer import load_printer
from solen.registry import GROUPS
from solen.spec import load, template

Reader = Callable[[Path], Any]


def _design(path: Path) -> None:
    """Check a complete design, or a part of one that is added to a shipped example."""
    design = tomllib.loads(path.read_text(encoding="utf-8"))
    if "schema" not in design:
        shipped = tomlkit.parse(template("hand-860" if "network" in design else "solen-860"))
        if "resin" in design.get("material", {}):
            shipped.pop("material")
        _completed(path, tomlkit.dumps(shipped), replaced=("network", "body"))
    load(path)


def _rig(path: Path) -> None:
    """Check a complete rig, or a part of one that is added to the shipped rig, whose instruments it replaces."""
    rig = tomllib.loads(path.read_text(encoding="utf-8"))
    shipped: dict[str, Any] = tomllib.loads(starter_files()["rig"])
    if "stages" not in rig:
        for key in ("spread", "ambient"):  # only for simulated instruments
            shipped.pop(key, None)
    for key in ("board", "stage"):
        if rig.keys() & {"meter", "stages"}:
            shipped.pop(key, None)
    if "meter" in rig:
        shipped["sensor"] = shipped["sensor"][:1]  # a meter has two inputs
    _completed(path, tomlkit.dumps(shipped), replaced=("stage", "board", "sensor"))
    load_rig(path)


def _completed(path: Path, shipped: str, replaced: tuple[str, ...]) -> None:
    """Add the tables that a block omits; those in ``replaced`` are not merged with the shipped ones."""
    complete: dict[str, Any] = tomllib.loads(shipped)
    for key, value in tomllib.loads(path.read_text(encoding="utf-8")).items():
        merged = isinstance(value, dict) and key not in replaced
        complete[key] = {**complete.get(key, {}), **value} if merged else value
    path.write_text(tomlkit.dumps(complete), encoding="utf-8")


def _protocol(path: Path) -> None:
    """Check a complete protocol, or steps, to which the return to the start of the cycle is added."""
    text = path.read_text(encoding="utf-8")
    if "schema" not in text:
        return_step = "\n[[step]]\nto_mm = 0.0\nvelocity_mm_per_s = 0.2\n" if "[[step]]" in text else ""
        path.write_text(f'schema = 1\nname = "part"\n\n{text}{return_step}', encoding="utf-8")
    load_protocol(path)


def _process(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    text = text if text.startswith("schema") else f'schema = 1\nname = "part"\n\n{text}'
    parsed_process(text, path.name, path.parent)


def _profile(path: Path) -> None:
    """Check a profile of which the page shows two points; the others are on a parabola."""
    profile = json.loads(path.read_text(encoding="utf-8"))
    (x, *_), (z, *_), (u, *_) = (profile[key] for key in ("x_mm", "z_mm", "u_mm"))
    points = np.linspace(x, -x, 16)
    profile |= {"x_mm": points.tolist(), "z_mm": (z * (points / x) ** 2).tolist(), "u_mm": [u] * 16}
    path.write_text(json.dumps(profile), encoding="utf-8")
    read_profile(path)


def _entry_points(path: Path) -> None:
    entry_points = tomllib.loads(path.read_text(encoding="utf-8"))["project"]["entry-points"]
    assert {*entry_points} == {*GROUPS}


TOML_FILES: dict[str, Reader] = {
    "process": _process,
    "pitch_um": load_printer,
    "index": load_resin,
    "peak_nm": load_part,
    "step": _protocol,
    "grid": _protocol,
    "load_cell": load_cell_of,
    "jobs": Slurm.read,
    "project": _entry_points,
    "meter": _rig,
    "stages": _rig,
    "stage": _rig,
    "material": _design,
    "body": _design,
    "lens": _design,
    "wall": _design,
    "mechanics": _design,
    "network": _design,
}
"""Readers of TOML blocks, keyed by a key of the file; the first key that a block contains determines its reader."""
JSON_FILES: dict[str, Reader] = {"x_mm": _profile, "features": read_features}


def check_file(language: str, text: str, path: Path) -> None:
    """Read a block with the reader of its keys.

    Raise `AssertionError` if there is none, or the error of the reader if the block is invalid.
    """
    keys = tomllib.loads(text) if language == "toml" else json.loads(text)
    readers = TOML_FILES if language == "toml" else JSON_FILES
    key = next((key for key in readers if key in keys), None)
    assert key is not None, f"no file has the keys {[*keys]}"
    path.write_text(text, encoding="utf-8")
    readers[key](path)
