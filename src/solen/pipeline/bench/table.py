"""A calibration to a table and code that decodes by it on a board."""

from pathlib import Path

from solen import __version__, files
from solen.analysis.calibration.file import load
from solen.analysis.calibration.table import BoardTable, DecodingTable, TableOptions
from solen.errors import OutputError
from solen.results import Outcome


def table(calibration: Path, folder: Path, options: TableOptions = TableOptions()) -> Outcome[DecodingTable]:
    """Write code that decodes on a board; existing files are never overwritten."""
    known = load(calibration)
    ambient = f"ambient light {known.circuit.ambient or 'treated as in the recordings'}"
    made = BoardTable.of(known.calibration, options.points, name=known.sensor, ambient=ambient, version=__version__)
    texts = {"solen_decode.py": made.python, "solen_decode.h": made.c}
    with files.output_folder(folder):
        for name in texts:
            if (folder / name).exists():
                raise OutputError(str(folder / name), limit="exists already", remedy="name another folder or remove it")
        files.write_all({folder / name: text.encode() for name, text in texts.items()})
    off, sigma = made.off_deg(known.calibration)
    low, high = known.range_deg
    result = DecodingTable(known.sensor, len(made.pieces), low, high, off, sigma, known.simulated)
    return Outcome(result, {name: folder / name for name in texts})
