"""The sources that a board needs, ready to be copied onto it or uploaded.

Public names: `BOARDS` and `sources_of`.
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
"""Files of each board's firmware, and the shipped source of each file."""
CONVERTERS = {
    "pico": (16, 3.3, 115_200),
    "esp32": (16, 3.3, 115_200),
    "uno": (12, 5.0, 500_000),
}
"""Bits, range in V and baud rate that a rig file states for each board."""


STRAIGHT_V = {"esp32": (0.15, 2.45)}
"""Levels in V between which a board's converter is linear, if that is not its whole range: by Espressif, at 11 dB."""


def sources_of(board: str) -> dict[str, str]:
    """Return the text of each of a board's files, by its name in the folder that it is written to."""
    folder = resources("solen.bench.firmware")
    return {name: folder.joinpath(shipped).read_text(encoding="utf-8") for name, shipped in BOARDS[board].items()}
