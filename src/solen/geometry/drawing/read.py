"""The file of a drawing, by its ending; read once as long as it does not change."""

from functools import lru_cache
from pathlib import Path

from solen.errors import DataError
from solen.geometry.drawing.dxf import read_dxf
from solen.geometry.drawing.model import Drawing
from solen.geometry.drawing.outline_json import read_json
from solen.geometry.drawing.svg import read_svg

READERS = {".dxf": read_dxf, ".svg": read_svg, ".json": read_json}


def read_drawing(path: Path, units: str | None = None) -> Drawing:
    """Drawing of a file; ``units`` overrules what the file says of its unit.

    Raises
    ------
    DataError
        Where the file cannot be read, holds what is not understood, or does not say its unit.
    """
    if path.suffix.lower() not in READERS:
        raise DataError(str(path), limit=f"an outline ends in {', '.join(READERS)}", remedy="export it as one of these")
    try:
        state = path.stat()
    except OSError:
        raise DataError(str(path), limit="no such file", remedy="check body.file") from None
    return _read(path, state.st_mtime_ns, state.st_size, units)


@lru_cache(maxsize=16)
def _read(path: Path, changed_ns: int, size: int, units: str | None) -> Drawing:  # noqa: ARG001  they name the content
    return READERS[path.suffix.lower()](path, units)
