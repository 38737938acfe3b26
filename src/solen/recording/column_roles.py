"""Column roles: find the time, angle, force, depth and receiver columns of a recording.

A column named by an option takes precedence. Otherwise, the column is found by its header, which names the quantity,
contains a matching unit or follows the conventions of recorders (``ai0``, ``PD2``), tried in this order. If several
columns remain, the user must name one of them.

Public names: `column_of`, `receiver_columns`, `named_column`, `side_of`, `left_right` and `by_sensor`.
"""

import re
from collections import Counter
from collections.abc import Sequence

from solen.errors import DataError
from solen.recording.headings import heading, plain
from solen.recording.model import Channel, Recording
from solen.recording.stimulus import STIMULI
from solen.units import factor

_TIMES = frozenset(
    {"timestamp", "time stamp", "elapsed", "elapsed time", "zeitstempel", "clock", "datetime", "date time", "t"}
    | {"x value", "sec", "second", "seconds", "sekunden", "ms", "millis", "milliseconds", "us", "micros"}
    | {"microseconds"}
)
NAMED_UNITS = {"ms": "ms", "millis": "ms", "milliseconds": "ms", "us": "us", "micros": "us", "microseconds": "us"}
"""Names of time columns that are units, with the unit of each."""
_ANGLES = frozenset(
    {"theta", "position", "pos", "rotation", "stage", "stage position", "encoder", "stage angle", "phi", "deg"}
)
_ANGLE_WORDS = frozenset(["angle", "winkel", "drehwinkel", "rotation", "rot", "theta", "alpha", "angolo"])
"""Words that mark a longer name as that of an angle."""
_FORCES = frozenset({"load cell", "loadcell", "force cell", "force sensor", "kraftsensor", "kraftaufnehmer"})
_FORCE_WORDS = frozenset({"force", "kraft", "load", "loadcell"})
_DEPTHS = frozenset(
    {"depth", "indentation", "press depth", "eindringtiefe", "eindrücktiefe", "stage", "stage position", "position"}
)
_UNITS = {
    "time": frozenset({"s", "sec", "ms", "us", "µs", "ns", "min"}),
    "angle": frozenset({"deg", "°", "degree", "degrees", "rad", "mrad", "mdeg", "arcmin", "arcsec"}),
    "force": frozenset({"N", "mN", "kN", "gf", "kgf", "lbf"}),
    "depth": frozenset[str](),  # a unit of length is ambiguous
}
"""Units that identify a quantity regardless of the column's name."""
_NUMBERED = re.compile(
    r"(?:.*[\s/._-])?(?:v|u|a|ai|ch|chan|channel|kanal|pd|pt|rx|receiver|sensor|voltage|volt|spannung|photodiode|"
    r"phototransistor|detector|signal|amplitude)[\s_-]*\d+",
    re.IGNORECASE,
)
"""Pattern of the names that recorders and users give to voltages: ai0, CH1, Voltage_0, PD2."""
_NAMES = {"time": _TIMES, "angle": _ANGLES, "force": _FORCES, "depth": _DEPTHS}
_QUANTITIES = {"depth": {"displacement", "crosshead"}}
"""Quantities that a header may name instead of the requested quantity."""
ENDS_IN_V = re.compile(r"(?:_|\b)V$")
"""Pattern of the end of a name in the unit V."""
_COMPANION = re.compile(r"^(?:u|ambient|clipped)_|_(?:ambient|clipped)$")
"""Pattern in the names of a receiver's companion columns: uncertainty, subtracted ambient light, clipping flag."""
_WORD_OR_NUMBER = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+")
_SIDE_IN_WORD = re.compile(r"(?:v|u|pd|pt|rx)(l|r|left|right)", re.IGNORECASE)
"""Pattern of a receiver and its side in one word: VL, PDR, Vleft."""
_SIDES = {"l": "left", "left": "left", "links": "left", "r": "right", "right": "right", "rechts": "right"}
_SENSOR_AND_RECEIVER = re.compile(r"(.+)[.:/]([^.:/]+)")


def column_of(recording: Recording, quantity: str) -> Channel | None:
    """Return the ``time``, ``angle``, ``force`` or ``depth`` column, found by name or unit; None if there is none.

    Raises
    ------
    DataError
        If there are several candidates.
    """
    words = _ANGLE_WORDS if quantity == "angle" else frozenset({quantity})
    quantities = {quantity, *_QUANTITIES.get(quantity, ())}
    columns = [column for column in recording.channels if not _is_another(column, quantity)]
    for candidates in (
        [column for column in columns if column.quantity in quantities],
        [column for column in columns if plain(column.name) in _NAMES[quantity]],
        [column for column in columns if column.unit in _UNITS[quantity]],
        [column for column in columns if plain(column.name).startswith(quantity)],
        [column for column in columns if not column.unit and words & {word.lower() for word in _words(column.name)}],
    ):
        if len(candidates) > 1:
            names = ", ".join(candidate.name for candidate in candidates)
            limit = f"{len(candidates)} columns may be the {quantity}: {names}"
            option = STIMULI[quantity].column if quantity in STIMULI else quantity
            raise DataError(recording.provenance.name, limit=limit, remedy=f"choose one with --{option}")
        if candidates:
            return candidates[0]
    return None


def _is_another(column: Channel, quantity: str) -> bool:
    """Return whether a column's unit excludes the quantity; a position in mm, for example, is not an angle."""
    other_unit = {"angle": "mm", "depth": "deg"}.get(quantity)
    if quantity == "depth" and not column.unit:
        return True
    return bool(other_unit and column.unit and factor(column.unit, other_unit) is not None)


def force_in_volts(recording: Recording) -> Channel | None:
    """Return a column in volts whose name identifies a load cell: ``Load cell (mV)``, ``force_V``."""
    return next((channel for channel in recording.channels if _volts_of_force(channel)), None)


def _volts_of_force(column: Channel) -> bool:
    unit = "V" if ENDS_IN_V.search(column.name) else column.unit
    words = {word.lower() for word in _words(ENDS_IN_V.sub("", column.name))}
    return bool(words & _FORCE_WORDS) and bool(unit) and factor(unit, "V") is not None


def named_column(recording: Recording, name: str, option: str) -> Channel:
    """Return the column called ``name``, with or without a unit.

    Raise `DataError` with a list of the columns if there is none.
    """
    last = name.rpartition(".")[2]
    channel = recording.find(name, heading(name).name, last, heading(last).name)
    if channel is not None:
        return channel
    is_text = recording.label(name, heading(name).name) is not None
    limit = "the column contains words instead of numbers" if is_text else "no such column"
    what = f"{recording.provenance.name}: {option} {name}"
    raise DataError(what, limit=limit, remedy=column_list(recording))


def column_list(recording: Recording) -> str:
    """Return the list of a recording's columns for errors."""
    remaining = len(recording.names) - 12
    return f"its columns are {', '.join(recording.names[:12])}" + (f" and {remaining} more" if remaining > 0 else "")


def receiver_columns(columns: Sequence[Channel]) -> list[Channel]:
    """Return the receiver columns.

    These are the columns in volts; otherwise those without a unit whose name contains a side or ends in V; otherwise
    numbered columns without a unit; otherwise columns in any unit whose name contains a side.
    """
    columns = [column for column in columns if not is_companion(column.name)]
    in_volts = [
        column
        for column in columns
        if column.quantity == "voltage" or (column.unit and factor(column.unit, "V") is not None)
    ]
    unitless = [column for column in columns if not column.unit]
    by_name = in_volts or [column for column in unitless if ENDS_IN_V.search(column.name) or side_of(column.name)]
    return by_name or [column for column in unitless if _NUMBERED.fullmatch(column.name)] or _sided(columns)


def _sided(columns: Sequence[Channel]) -> list[Channel]:
    """Return the columns whose name contains a side and that have the unit of the first such column."""
    sided = [column for column in columns if side_of(column.name)]
    return [column for column in sided if column.unit == sided[0].unit]


def unit_of(column: Channel) -> str:
    """Return the unit of a column, or V if its name ends in V (``left_V``); empty if there is neither."""
    return column.unit or ("V" if ENDS_IN_V.search(column.name) else "")


def is_companion(name: str) -> bool:
    """Return whether a column accompanies a receiver column: its uncertainty, ambient light or clipping flag."""
    return bool(_COMPANION.search(name))


def companion(recording: Recording, channel: Channel, kind: str) -> Channel | None:
    """Return the ``ambient`` or ``clipped`` column that accompanies a receiver column, such as ``left_ambient``."""
    name = ENDS_IN_V.sub("", channel.name)
    return recording.find(f"{kind}_{name}", f"{name}_{kind}")


def side_of(name: str) -> str:
    """Return ``left`` or ``right`` from a receiver name (``ReceiverR``, ``V_L``, ``VL``); otherwise empty."""
    words = [
        _SIDE_IN_WORD.sub(r"\1", word) if _SIDE_IN_WORD.fullmatch(word) else word
        for word in _WORD_OR_NUMBER.findall(name)
    ]
    sides = {_SIDES[word.lower()] for word in words if word.lower() in _SIDES}
    return sides.pop() if len(sides) == 1 else ""


def left_right(receivers: Sequence[str]) -> tuple[int, int] | None:
    """Return the indices of the left and the right receiver; None unless there is exactly one of each."""
    sides = [side_of(name) for name in receivers]
    if sides.count("left") == 1 == sides.count("right"):
        return sides.index("left"), sides.index("right")
    return None


def by_sensor(names: Sequence[str], label: str, *, single_file: bool) -> dict[str, dict[str, int]]:
    """Return the receivers of each sensor with their indices, from names such as ``S1.left``, or ``S1_L`` and ``S2_L``.

    ``label`` is the file's label; it precedes the sensor's name unless ``single_file`` is true.
    """
    matches = [_SENSOR_AND_RECEIVER.fullmatch(name) for name in names]
    split = [(match[1], match[2]) if match else ("", name) for match, name in zip(matches, names, strict=True)]
    if not any(matches):
        split = _by_side(names)
    sensors: dict[str, dict[str, int]] = {}
    for index, (sensor, receiver) in enumerate(split):
        name = label if not sensor else sensor if single_file else f"{label}.{sensor}"
        sensors.setdefault(name, {})[receiver] = index
    return sensors


def _by_side(names: Sequence[str]) -> list[tuple[str, str]]:
    """Return sensors and sides if every sensor has both sides; otherwise each name as a receiver of one sensor."""
    split = [(_without_side(name), side_of(name)) for name in names]
    counts = Counter(split)
    sensors = {sensor for sensor, _ in split}
    complete = all(counts[sensor, side] == 1 for sensor in sensors for side in ("left", "right"))
    if len(sensors) > 1 and complete and len(names) == 2 * len(sensors):
        return split
    return [("", name) for name in names]


def _without_side(name: str) -> str:
    return " ".join(word for word in _words(name) if not side_of(word) and word.lower() != "v")


def _words(name: str) -> list[str]:
    """Return the words of a name, split at other characters, at capitals, and between digits and letters."""
    parts = re.split(r"[\W_]+|(?<=[a-z0-9])(?=[A-Z])|(?<=[0-9])(?=[A-Za-z])", name)
    return [part for part in parts if part]
