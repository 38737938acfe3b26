"""Outline drawings: DXF, SVG and JSON as named strokes in mm, x to the right and z up.

A drawing is read as separate strokes; `solen.geometry.join` chains them into closed outlines. The name of a face is the
layer in a DXF file, the label, class or id of an SVG element, or the name in a JSON file.
"""

from functools import lru_cache
from pathlib import Path

from solen.errors import DataError
from solen.geometry.drawing.dxf import read_dxf
from solen.geometry.drawing.model import Drawing, DrawnEmitter, Stroke
from solen.geometry.drawing.outline_json import read_json
from solen.geometry.drawing.svg import read_svg

__all__ = ["Drawing", "DrawnEmitter", "Stroke", "read_drawing"]

READERS = {".dxf": read_dxf, ".svg": read_svg, ".json": read_json}


def read_drawing(path: Path, units: str | None = None) -> Drawing:
    """Read a drawing from a file; ``units`` overrides the unit in the file.

    Raises
    ------
    DataError
        If the file cannot be read, has unsupported content, or does not specify its unit.
    """
    if path.suffix.lower() not in READERS:
        raise DataError(
            str(path),
            limit=f"the file name of an outline must end in {', '.join(READERS)}",
            remedy="export the drawing in one of these formats",
        )
    try:
        state = path.stat()
    except OSError:
        raise DataError(str(path), limit="no such file", remedy="check body.file") from None
    return _read(path, state.st_mtime_ns, state.st_size, units)


@lru_cache(maxsize=16)
def _read(path: Path, modified_ns: int, size: int, units: str | None) -> Drawing:  # noqa: ARG001  part of the cache key
    return READERS[path.suffix.lower()](path, units)
