"""Which column is the time, the angle or a receiver where nobody says: by its words, its unit, its number.

The interface: `told` of a quantity, `told_receivers` among the columns that are left, `words_of` a name.
"""

import re
from collections.abc import Sequence

from solen.analysis import side_of
from solen.errors import DataError
from solen.recording import Channel, Recording
from solen.recording.words import plain
from solen.units import factor

_TIMES = frozenset(
    {"timestamp", "time stamp", "elapsed", "elapsed time", "zeitstempel", "clock", "datetime", "date time", "t"}
    | {
        "x value",
        "sec",
        "second",
        "seconds",
        "sekunden",
        "ms",
        "millis",
        "milliseconds",
        "us",
        "micros",
        "microseconds",
    }
)
NAMED_UNITS = {"ms": "ms", "millis": "ms", "milliseconds": "ms", "us": "us", "micros": "us", "microseconds": "us"}
"""Names of times that say their unit."""
_ANGLES = frozenset(
    {"theta", "position", "pos", "rotation", "stage", "stage position", "encoder", "stage angle", "phi", "deg"}
)
_OF_ANGLES = frozenset({"angle", "winkel", "drehwinkel", "rotation", "rot", "theta", "alpha", "angolo"})
"""Words of which one in a longer name tells an angle."""
_UNITS = {
    "time": frozenset({"s", "sec", "ms", "us", "µs", "ns", "min"}),
    "angle": frozenset({"deg", "°", "degree", "degrees", "rad", "mrad", "mdeg", "arcmin", "arcsec"}),
}
"""Units that tell what a column is whatever it is called."""
_NUMBERED = re.compile(
    r"(?:.*[\s/._-])?(?:v|u|a|ai|ch|chan|channel|kanal|pd|pt|rx|receiver|sensor|voltage|volt|spannung|photodiode|"
    r"phototransistor|detector|signal|amplitude)[\s_-]*\d+",
    re.IGNORECASE,
)
"""Names that recorders and people give to voltages: ai0, CH1, Voltage_0, PD2."""
_WORDS = {"time": _TIMES, "angle": _ANGLES}
ENDS = re.compile(r"(?:_|\b)V$")
"""A name that ends in the unit of volts."""
_BESIDE = re.compile(r"^(?:u|ambient|clipped)_|_(?:ambient|clipped)$")
"""Columns beside a receiver's: its uncertainty, what was subtracted from it, and whether it is clipped."""


def told(recording: Recording, quantity: str) -> Channel | None:
    """Column of a quantity by its words or its unit; `DataError` where several are."""
    of = _OF_ANGLES if quantity == "angle" else frozenset({quantity})
    for found in (
        [one for one in recording.channels if one.quantity == quantity],
        [one for one in recording.channels if plain(one.name) in _WORDS[quantity]],
        [one for one in recording.channels if one.unit in _UNITS[quantity]],
        [one for one in recording.channels if plain(one.name).startswith(quantity)],
        [one for one in recording.channels if not one.unit and of & {word.lower() for word in words_of(one.name)}],
    ):
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(one.name for one in found)
            raise DataError(
                recording.provenance.file or "recording",
                limit=f"has {len(found)} columns that may be the {quantity}: {names}",
                remedy=f"name one with --{quantity}",
            )
    return None


def told_receivers(free: Sequence[Channel]) -> list[Channel]:
    """Columns of receivers among those that are nothing else: volts, else a side in their names, else numbered ones."""
    free = [one for one in free if not _BESIDE.search(one.name)]
    found = [one for one in free if one.quantity == "voltage" or (one.unit and factor(one.unit, "V") is not None)]
    bare = [one for one in free if not one.unit]
    found = found or [one for one in bare if ENDS.search(one.name) or side_of(one.name)]
    return found or [one for one in bare if _NUMBERED.fullmatch(one.name)]


def words_of(name: str) -> list[str]:
    """Words of a name, by what is no letter or digit, by capitals, and by digits before letters."""
    found = re.split(r"[\W_]+|(?<=[a-z0-9])(?=[A-Z])|(?<=[0-9])(?=[A-Za-z])", name)
    return [word for word in found if word]
