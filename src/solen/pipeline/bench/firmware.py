"""Firmware sources for a board, written to a folder."""

from pathlib import Path

from solen import files
from solen.bench.firmware.boards import BOARD_VALUES, LINEAR_V, Board, sources_of
from solen.results import Outcome, Result


class Firmware(Result):
    """Firmware sources for a board, and the board's values for a rig file.

    Attributes
    ----------
    board
        Kind of board.
    folder
        Folder of the sources.
    bits, range_V
        Resolution and range of its ADC.
    baud
        Baud rate of its serial line.
    linear_V
        Linear range of its ADC; None if the whole range is linear.
    """

    board: str
    folder: Path
    bits: int
    range_V: float
    baud: int
    linear_V: tuple[float, float] | None


def firmware(folder: Path, /, *, board: Board) -> Outcome[Firmware]:
    """Write the firmware of an emitter board to a folder, ready to be copied onto it or uploaded.

    Parameters
    ----------
    folder
        Folder for the files.
    board
        Raspberry Pi Pico or ESP32 (MicroPython), or Arduino Uno (sketch in C).
    """
    written = files.write_new(folder, {name: text.encode() for name, text in sources_of(board).items()})
    result = Firmware(board, folder, *BOARD_VALUES[board], LINEAR_V.get(board))
    return Outcome(result, {target.name: target for target in written})
