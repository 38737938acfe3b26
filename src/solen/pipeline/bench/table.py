"""A calibration as a lookup table with code for a microcontroller."""

from pathlib import Path
from typing import Annotated

from solen import __version__, files
from solen.analysis.calibration.file import load
from solen.analysis.calibration.table import BoardTable, DecodingTable, TableOptions
from solen.pipeline.options import FLAT
from solen.results import Outcome


def table(
    calibration: Path, folder: Path, /, *, options: Annotated[TableOptions, FLAT] = TableOptions()
) -> Outcome[DecodingTable]:
    """Write a calibration as a small table, with code in MicroPython and C that decodes with it on a board.

    Parameters
    ----------
    calibration
        File from solen bench calibrate.
    folder
        Folder for solen_decode.py and solen_decode.h.
    """
    known = load(calibration)
    readings = f"in {known.unit}, ambient light {known.circuit.ambient or 'treated as in the recordings'}"
    board_table = BoardTable.of(
        known.calibration,
        options.points,
        name=known.sensor,
        readings=readings,
        version=__version__,
        stimulus=known.stimulus_of,
    )
    texts = {"solen_decode.py": board_table.python, "solen_decode.h": board_table.c}
    written = files.write_new(folder, {name: text.encode() for name, text in texts.items()})
    deviation_deg, sigma = board_table.deviation(known.calibration)
    low, high = known.range_deg
    result = DecodingTable(
        known.sensor, len(board_table.pieces), low, high, deviation_deg, sigma, known.simulated, known.stimulus
    )
    return Outcome(result, dict(zip(texts, written, strict=True)))
