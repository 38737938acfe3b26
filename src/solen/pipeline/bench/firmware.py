"""Sources of a board's firmware, written into a folder."""

from dataclasses import dataclass
from pathlib import Path

from solen import files
from solen.bench.firmware.written import CONVERTERS, sources_of
from solen.errors import OutputError
from solen.results import Outcome, Result


@dataclass(frozen=True, eq=False, repr=False)
class Firmware(Result):
    """Sources for a board, and what a rig file states of it.

    Attributes
    ----------
    board
        Its kind.
    folder
        Where its sources are.
    bits, range_V
        Of its converter.
    baud
        Of its serial line.
    """

    board: str
    folder: Path
    bits: int
    range_V: float
    baud: int


def firmware(folder: Path, board: str) -> Outcome[Firmware]:
    """Write the sources for a board into a folder; existing files are never overwritten."""
    texts = {folder / name: text.encode() for name, text in sources_of(board).items()}
    with files.output_folder(folder):
        for target in texts:
            if target.exists():
                raise OutputError(str(target), limit="exists already", remedy="name another folder or remove it")
            target.parent.mkdir(exist_ok=True)
        files.write_all(texts)
    return Outcome(Firmware(board, folder, *CONVERTERS[board]), {target.name: target for target in texts})
