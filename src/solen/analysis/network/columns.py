"""Columns of a network table, from a file or from lines: powers, their common unit, and accompanying columns.

A column is a power if its name is ``EMITTER.RECEIVER``. Each power has its own unit; all are converted to V if possible
or if no unit is specified, otherwise to the unit of the first power. ``a.left_A`` is in ampere if all names end in
``_A``. A power may be accompanied by clipping flags, ``a.left_clipped``, and by the ambient light that was subtracted,
``a.left_ambient``. Such columns without a power, or with ambient light for only some of the powers, are rejected.

Public names: `power_columns` and `PowerColumns`.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from solen.analysis.calibration.file import Ambient
from solen.errors import DataError
from solen.ranks import Caution, warning
from solen.recording import Channel
from solen.recording.column_roles import ENDS_IN_V, is_companion, unit_of
from solen.units import factor

DOTTED = re.compile(r"([^.\s]+)\.([^.\s]+?)(?:_V)?")
"""Name of a power, composed of the names of its emitter and its receiver."""
ENDS_IN_A = "_A"
_BESIDE = re.compile(r"(?:(ambient|clipped)_)?(.*?)(?:_(ambient|clipped))?")
Pair = tuple[str, str]


@dataclass(frozen=True)
class PowerColumns:
    """Indices of the power columns and their factors to the common unit; indices of the clipping flags.

    ``ambient`` is ``subtracted`` if each power has a column of subtracted ambient light, else None; ``warnings``
    reports whether V is assumed.
    """

    places: dict[Pair, int]
    scales: dict[Pair, float]
    unit: str
    clipped: dict[Pair, int]
    ambient: Ambient | None
    warnings: tuple[Caution, ...] = ()


def power_columns(columns: Sequence[Channel], source: str) -> PowerColumns:
    """Find the powers among columns.

    Raises
    ------
    DataError
        If units cannot be converted to a common unit, or a column that accompanies powers is missing or belongs to no
        power.
    """
    columns = _in_ampere(columns)
    names = [ENDS_IN_V.sub("", column.name) for column in columns]
    places: dict[Pair, int] = {}
    for place, name in enumerate(names):
        if (match := DOTTED.fullmatch(name)) and not is_companion(name):
            places[match[1], match[2]] = place
    unit, scales = _scales({".".join(pair): unit_of(columns[place]) for pair, place in places.items()}, source)
    lights = _in(unit, columns, names) if places else []
    clipped, ambient = (_beside(kind, lights, places, source) for kind in ("clipped", "ambient"))
    lacking = [".".join(pair) for pair in places if pair not in ambient]
    if ambient and lacking:
        limit = f"contains an ambient light column for some powers, but not for {lacking[0]}"
        raise DataError(source, limit=limit, remedy="subtract it from all powers or from none")
    scaled = dict(zip(places, scales, strict=True))
    assumed = [] if unit or not places else [warning("no unit is specified for the powers; V is assumed")]
    return PowerColumns(places, scaled, unit or "V", clipped, "subtracted" if ambient else None, tuple(assumed))


def _in_ampere(columns: Sequence[Channel]) -> Sequence[Channel]:
    """Return the columns in A if all power names end in ``_A``, as in ``a.left_A``; otherwise the suffix is part of a name."""
    are = [bool(DOTTED.fullmatch(column.name)) and not is_companion(column.name) for column in columns]
    powers = [column for column, is_power in zip(columns, are, strict=True) if is_power]
    if not powers or any(power.unit not in {"", "1"} or not power.name.endswith(ENDS_IN_A) for power in powers):
        return columns
    return [
        replace(column, name=column.name.removesuffix(ENDS_IN_A), unit="A") if is_power else column
        for column, is_power in zip(columns, are, strict=True)
    ]


def _scales(units: dict[str, str], source: str) -> tuple[str, list[float]]:
    """Return the common unit of the powers, empty if none is specified, and the factor of each power to this unit."""
    first = next((unit for unit in units.values() if unit not in {"", "1"}), "")
    if not first:
        return "", [1.0] * len(units)
    common = "V" if factor(first, "V") is not None else first
    scales = []
    for name, unit in units.items():
        scale = factor(unit, common) if unit not in {"", "1"} else None
        if scale is None:
            limit = f"cannot be converted to {common}, the unit of the other powers"
            remedy = "specify units of the same quantity for all powers, as in a.end_mV"
            raise DataError(f"{source}: {name}", value=unit or "no unit", limit=limit, remedy=remedy)
        scales.append(scale)
    return common, scales


def _in(unit: str, columns: Sequence[Channel], names: Sequence[str]) -> list[str]:
    """Return the column names; empty for a column whose unit is of another kind (e.g. the temperature ``ambient (K)``)."""
    other = (column.unit not in {"", "1", unit} and factor(column.unit, unit or "V") is None for column in columns)
    return ["" if odd else name for odd, name in zip(other, names, strict=True)]


def _beside(kind: str, names: Sequence[str], powers: dict[Pair, int], source: str) -> dict[Pair, int]:
    """Return the indices of accompanying columns of one kind, by the powers that they accompany."""
    known = {".".join(pair): pair for pair in powers}
    found = {}
    for place, name in enumerate(names):
        match = _BESIDE.fullmatch(name)
        if match is None or kind not in {match[1], match[3], name}:
            continue
        if match[2] not in known:
            limit = f"belongs to no power; the powers are {', '.join(known)}"
            remedy = f"name it after its power, as in {next(iter(known))}_{kind}, or omit it"
            raise DataError(f"{source}: {name}", limit=limit, remedy=remedy)
        found[known[match[2]]] = place
    return found
