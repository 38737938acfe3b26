"""The firmware sources of each board, ready to be copied onto it or uploaded.

Public names: `BOARDS`, `BOARD_VALUES`, `LINEAR_V` and `sources_of`.
"""

from importlib.resources import files as resources
from typing import Literal

Board = Literal["pico", "esp32", "uno"]

_MICROPYTHON = {"solen_board.py": "solen_board.py", "main.py": "sources/main-micropython.py"}
_C = ("solen_board.c", "solen_board.h")
BOARDS: dict[str, dict[str, str]] = {
    "pico": {**_MICROPYTHON, "pins.py": "sources/pins-pico.py"},
    "esp32": {**_MICROPYTHON, "pins.py": "sources/pins-esp32.py"},
    "uno": {f"solen_uno/{name}": f"sources/{name}" for name in (*_C, "uno.c", "solen_uno.ino")},
}
"""Files of the firmware of each board, and the shipped source of each file."""
BOARD_VALUES = {
    "pico": (16, 3.3, 115_200),
    "esp32": (16, 3.3, 115_200),
    "uno": (12, 5.0, 500_000),
}
"""Bits, range in V and baud rate of each board, for a rig file."""
LINEAR_V = {"esp32": (0.15, 2.45)}
"""Linear range of the ADC of a board in V, if it is not the whole range: specified by Espressif for 11 dB."""


def sources_of(board: str) -> dict[str, str]:
    """Return the text of each firmware file of a board, keyed by its name in the folder."""
    folder = resources("solen.bench.firmware")
    return {name: folder.joinpath(shipped).read_text(encoding="utf-8") for name, shipped in BOARDS[board].items()}
