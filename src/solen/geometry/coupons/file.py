"""A coupon as plain data, and back: what a job file holds, so that a measurement finds the nominal values again."""

from dataclasses import MISSING, asdict, fields
from typing import Any, get_args, get_origin, get_type_hints

from solen.errors import DataError, SolenError
from solen.geometry.coupons.model import Coupon, Feature, Gap, Reading, Slab, Stage, Step

PARTS: dict[str, type] = {"features": Feature, "gaps": Gap, "steps": Step, "stages": Stage, "readings": Reading}


def as_data(coupon: Coupon) -> dict[str, Any]:
    """The coupon as tables, lists, words and numbers."""
    return asdict(coupon)


def coupon_of(data: object, what: str) -> Coupon:
    """Coupon of plain data.

    Parameters
    ----------
    data
        As `as_data` gives it, perhaps by way of JSON.
    what
        Where it comes from, as errors name it.

    Raises
    ------
    DataError
        Where a key is missing or unknown, a value is of another kind, or the coupon cannot be.
    """
    table = dict(_table(data, what))
    for name, kind in PARTS.items():
        rows = table.get(name, ())
        if not isinstance(rows, list | tuple):
            raise DataError(f"{what}: {name}", limit="must be a list")
        table[name] = tuple(_made(kind, row, f"{what}: {name}[{number}]") for number, row in enumerate(rows))
    if table.get("slab") is not None:
        table["slab"] = _made(Slab, table["slab"], f"{what}: slab")
    try:
        made: Coupon = _made(Coupon, table, what)
    except DataError:
        raise
    except SolenError as bad:
        raise DataError(f"{what}: {bad.what}", value=bad.value, limit=bad.limit, remedy=bad.remedy) from None
    return made


def _made(kind: type, data: object, what: str) -> Any:
    """A dataclass of a table, each value of the kind that its field has."""
    table = _table(data, what)
    hints = get_type_hints(kind)
    named = {one.name: one for one in fields(kind)}
    for name in table:
        if name not in named:
            raise DataError(f"{what}: {name}", limit="unknown key")
    for name, one in named.items():
        if name not in table and one.default is MISSING:
            raise DataError(f"{what}: {name}", limit="missing")
    return kind(**{name: _value(hints[name], value, f"{what}: {name}") for name, value in table.items()})


def _table(data: object, what: str) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise DataError(what, limit="must be a table")
    return data


def _value(hint: Any, value: object, what: str) -> Any:
    """A value as a field holds it: a list as a tuple, a whole number as one with a point."""
    kinds = get_args(hint)
    if value is None and type(None) in kinds:
        return None
    if hint is float or float in kinds:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise DataError(what, value=value, limit="must be a number")
        return float(value)
    if hint is bool and not isinstance(value, bool):
        raise DataError(what, value=value, limit="must be true or false")
    if hint is str and not isinstance(value, str):
        raise DataError(what, value=value, limit="must be text")
    if get_origin(hint) is tuple:
        if not isinstance(value, list | tuple):
            raise DataError(what, value=value, limit="must be a list")
        inner = kinds[0]
        return tuple(_value(inner, one, what) if inner is str else one for one in value)
    if isinstance(value, str) and kinds and value not in kinds:
        raise DataError(what, value=value, limit=f"must be one of {', '.join(map(str, kinds))}")
    return value
