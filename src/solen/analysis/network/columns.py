"""Columns of a network table, from a file or from lines: powers, their common unit, and accompanying columns.

A column named ``EMITTER.RECEIVER`` is a power. Each power may have a different unit; all are converted to V if possible
or if no unit is specified, otherwise to the unit of the first power. ``a.left_A`` is in ampere if all names end in
``_A``. A power may be accompanied by clipping flags, ``a.left_clipped``, and by the ambient light that was subtracted,
``a.left_ambient``. Accompanying columns without a power are rejected, as are ambient light columns for only some of the
powers.

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
_ACCOMPANYING = re.compile(r"(?:(ambient|clipped)_)?(.*?)(?:_(ambient|clipped))?")
Pair = tuple[str, str]


@dataclass(frozen=True)
class PowerColumns:
    """Indices of the power columns and their factors to the common unit; indices of the clipping flags.

    ``ambient`` is ``subtracted`` if each power has a column of subtracted ambient light, otherwise None. If V is
    assumed as the unit, ``warnings`` reports it.
    """

    indices: dict[Pair, int]
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
    powers: dict[Pair, int] = {}
    for index, name in enumerate(names):
        if (match := DOTTED.fullmatch(name)) and not is_companion(name):
            powers[match[1], match[2]] = index
    unit, scales = _scales({".".join(pair): unit_of(columns[index]) for pair, index in powers.items()}, source)
    candidates = _names_in_unit(unit, columns, names) if powers else []
    clipped, ambient = (_accompanying(kind, candidates, powers, source) for kind in ("clipped", "ambient"))
    missing = [".".join(pair) for pair in powers if pair not in ambient]
    if ambient and missing:
        limit = f"contains an ambient light column for some powers, but not for {missing[0]}"
        raise DataError(source, limit=limit, remedy="subtract ambient light from all powers or from none")
    assumed = [] if unit or not powers else [warning("no unit is specified for the powers; V is assumed")]
    by_pair = dict(zip(powers, scales, strict=True))
    return PowerColumns(powers, by_pair, unit or "V", clipped, "subtracted" if ambient else None, tuple(assumed))


def _in_ampere(columns: Sequence[Channel]) -> Sequence[Channel]:
    """Return the columns with powers in A if all their names end in ``_A``; otherwise the suffix is part of a name."""

    def is_power(column: Channel) -> bool:
        return bool(DOTTED.fullmatch(column.name)) and not is_companion(column.name)

    powers = [column for column in columns if is_power(column)]
    if not powers or any(power.unit not in {"", "1"} or not power.name.endswith(ENDS_IN_A) for power in powers):
        return columns
    return [
        replace(column, name=column.name.removesuffix(ENDS_IN_A), unit="A") if is_power(column) else column
        for column in columns
    ]


def _scales(units: dict[str, str], source: str) -> tuple[str, list[float]]:
    """Return the common unit of the powers, empty if none is specified, and the factor from each unit to it."""
    first = next((unit for unit in units.values() if unit not in {"", "1"}), "")
    if not first:
        return "", [1.0] * len(units)
    common = "V" if factor(first, "V") is not None else first
    scales = []
    for name, unit in units.items():
        scale = factor(unit, common) if unit not in {"", "1"} else None
        if scale is None:
            limit = f"specifies no unit, but other powers are in {common}"
            if unit:
                limit = f"is in {unit}, which cannot be converted to {common}, the unit of other powers"
            remedy = "specify units of the same quantity for all powers, as in a.end_mV"
            raise DataError(f"{source}: {name}", limit=limit, remedy=remedy)
        scales.append(scale)
    return common, scales


def _names_in_unit(unit: str, columns: Sequence[Channel], names: Sequence[str]) -> list[str]:
    """Return the column names; empty for a column in a unit of another kind (e.g. the temperature ``ambient (K)``)."""
    foreign = (column.unit not in {"", "1", unit} and factor(column.unit, unit or "V") is None for column in columns)
    return ["" if is_foreign else name for is_foreign, name in zip(foreign, names, strict=True)]


def _accompanying(kind: str, names: Sequence[str], powers: dict[Pair, int], source: str) -> dict[Pair, int]:
    """Return the indices of accompanying columns of one kind, keyed by the powers that they accompany."""
    pairs = {".".join(pair): pair for pair in powers}
    indices = {}
    for index, name in enumerate(names):
        match = _ACCOMPANYING.fullmatch(name)
        if match is None or kind not in {match[1], match[3], name}:
            continue
        if match[2] not in pairs:
            limit = f"belongs to no power; the powers are {', '.join(pairs)}"
            remedy = f"name it after its power, as in {next(iter(pairs))}_{kind}, or omit it"
            raise DataError(f"{source}: {name}", limit=limit, remedy=remedy)
        indices[pairs[match[2]]] = index
    return indices
