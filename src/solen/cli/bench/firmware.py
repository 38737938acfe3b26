"""The command of boards: `solen bench firmware`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from solen.cli.app import lines
from solen.pipeline.bench import firmware as pipeline
from solen.results import Outcome


def firmware(folder: Path, /, *, board: Literal["pico", "esp32", "uno"]) -> Outcome[pipeline.Firmware]:
    """Write the firmware of an emitter board into a folder, ready to be copied onto it or uploaded.

    Parameters
    ----------
    folder
        Where its files go.
    board
        Raspberry Pi Pico or ESP32 (MicroPython), or Arduino Uno (a sketch in C).
    """
    return pipeline.firmware(folder, board)


@lines.register
def _(result: pipeline.Firmware) -> Iterator[str]:
    how = "open the sketch in the Arduino IDE" if result.board == "uno" else "copy the files onto one with MicroPython"
    yield f"next: {how}; what is wired to which pin stands in docs/board.md"
    states = f"bits = {result.bits}, range_v = {result.range_V}, baud = {result.baud}"
    yield f'[board] of the rig: driver = "serial", {states}'
