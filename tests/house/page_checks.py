"""What a TOML or JSON block of a page is, and whether the reader of such files accepts it."""

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
    """Whole, or as a part of a shipped example: a sensor in space, or a network."""
    stated = tomllib.loads(path.read_text(encoding="utf-8"))
    if "schema" not in stated:
        shipped = tomlkit.parse(template("hand-860" if "network" in stated else "solen-860"))
        if "resin" in stated.get("material", {}):
            shipped.pop("material")
        _completed(path, tomlkit.dumps(shipped), replaced=("network", "body"))
    load(path)


def _rig(path: Path) -> None:
    """Whole, or as a part of the shipped rig; the instruments that it states stand for that rig's board."""
    stated = tomllib.loads(path.read_text(encoding="utf-8"))
    shipped: dict[str, Any] = tomllib.loads(starter_files()["rig"])
    if "stages" not in stated:
        for key in ("spread", "ambient"):  # of a simulated rig
            shipped.pop(key, None)
    for key in ("board", "stage"):
        if stated.keys() & {"meter", "stages"}:
            shipped.pop(key, None)
    if "meter" in stated:
        shipped["sensor"] = shipped["sensor"][:1]  # of two inputs
    _completed(path, tomlkit.dumps(shipped), replaced=("stage", "board", "sensor"))
    load_rig(path)


def _completed(path: Path, shipped: str, replaced: tuple[str, ...]) -> None:
    """Add what a block leaves out; tables that are replaced are those of the block alone."""
    whole: dict[str, Any] = tomllib.loads(shipped)
    for key, value in tomllib.loads(path.read_text(encoding="utf-8")).items():
        merged = isinstance(value, dict) and key not in replaced
        whole[key] = {**whole.get(key, {}), **value} if merged else value
    path.write_text(tomlkit.dumps(whole), encoding="utf-8")


def _protocol(path: Path) -> None:
    """Whole, or steps that the return to where a cycle begins ends."""
    text = path.read_text(encoding="utf-8")
    if "schema" not in text:
        back = "\n[[step]]\nto_mm = 0.0\nvelocity_mm_per_s = 0.2\n" if "[[step]]" in text else ""
        path.write_text(f'schema = 1\nname = "part"\n\n{text}{back}', encoding="utf-8")
    load_protocol(path)


def _process(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    text = text if text.startswith("schema") else f'schema = 1\nname = "part"\n\n{text}'
    parsed_process(text, path.name, path.parent)


def _profile(path: Path) -> None:
    """A page shows two points; the others follow on a parabola."""
    stated = json.loads(path.read_text(encoding="utf-8"))
    (x, *_), (z, *_), (u, *_) = (stated[key] for key in ("x_mm", "z_mm", "u_mm"))
    across = np.linspace(x, -x, 16)
    stated |= {"x_mm": across.tolist(), "z_mm": (z * (across / x) ** 2).tolist(), "u_mm": [u] * 16}
    path.write_text(json.dumps(stated), encoding="utf-8")
    read_profile(path)


def _entry_points(path: Path) -> None:
    named = tomllib.loads(path.read_text(encoding="utf-8"))["project"]["entry-points"]
    assert {*named} == {*GROUPS}


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
"""Reader of a TOML block, by the first of these keys that it has."""
JSON_FILES: dict[str, Reader] = {"x_mm": _profile, "features": read_features}


def check_file(language: str, text: str, path: Path) -> None:
    """Read a block as the file that its keys say; `AssertionError` if they say none, an error of solen if it is bad."""
    stated = tomllib.loads(text) if language == "toml" else json.loads(text)
    readers = TOML_FILES if language == "toml" else JSON_FILES
    key = next((key for key in readers if key in stated), None)
    assert key is not None, f"{[*stated]} are the keys of no file"
    path.write_text(text, encoding="utf-8")
    readers[key](path)
