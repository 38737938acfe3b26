"""Conversion of units on input and output; inside solen they are mm, nm, degrees and fractions of the emitted power.

Files spell units in many ways (``N/mm²``, ``mW/cm2``, ``µm``): `is_unit` recognises a unit, `factor` converts between
two. pint does the conversion and is loaded on first use.
"""

import re
from functools import cache
from typing import Any

NM_PER_UM = 1e3

_MAX_UNIT_LENGTH = 24  # characters of a unit: what is longer is a remark
_SPELLINGS = {"pct": "%", "percent": "%", "prozent": "%"} | dict.fromkeys(("%t", "%r", "%a"), "%")
_SPELLINGS |= {
    "µ": "µm",
    "micron": "um",
    "microns": "um",
    "sec": "s",
    "sek": "s",
    "std": "h",
    "ohms": "ohm",
    **{name: name for name in ("ohm", "kohm", "deg")},  # however their letters are written
    "°": "deg",
    "": "1",
    "-": "1",
}
_COUNTS = frozenset({"count", "counts"})
"""Counts of a converter or an encoder, which have no known size; pint treats them as pure numbers, like rad."""
_POWERS = str.maketrans({"²": "2", "³": "3", "⁻": "-", "¹": "1", "·": "*", "μ": "µ", "−": "-"})
_FORM = re.compile(r"1|[1/%°a-zµΩ*^.\-0-9 ()]+", re.IGNORECASE)


def um_from_nm(wavelength_nm: float) -> float:
    """Return a wavelength in micrometres, as dispersion formulas use it."""
    return wavelength_nm / NM_PER_UM


def is_unit(text: str) -> bool:
    """Return whether a text is a unit in a common spelling; an empty text is a dimensionless unit."""
    return _unit(text) is not None


def factor(unit: str, wanted: str) -> float | None:
    """Return the factor that converts a number from ``unit`` to ``wanted``, or None if there is none.

    Units without a factor, such as dB/cm and °C, convert only to themselves.
    """
    if unit and unit == wanted:
        return 1.0
    ours, theirs = _unit(unit), _unit(wanted)
    if ours is None or theirs is None or ours.dimensionality != theirs.dimensionality:
        return None
    return float(f"{(1.0 * ours).to(theirs).magnitude:.15g}")  # 1000, where steps by way of m make 999.9999999999999


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(on_redefinition="ignore", autoconvert_offset_to_baseunit=False)


@cache
def _unit(text: str) -> Any:
    """Return the unit of a text, or None."""
    plain = text.strip().strip("[]").translate(_POWERS)
    plain = _SPELLINGS.get(plain.lower(), plain)
    if len(plain) > _MAX_UNIT_LENGTH or not _FORM.fullmatch(plain) or plain.lower() in _COUNTS:
        return None
    if plain == "1":
        return _registry().dimensionless
    powered = re.sub(r"(?<=[a-zµΩ)])\^?(-?\d)", r"**\1", plain, flags=re.IGNORECASE)
    try:
        unit = _registry().Unit(powered)
        one, two = (_registry().Quantity(number, unit).to_base_units().magnitude for number in (1.0, 2.0))
    except Exception:
        return None
    return unit if two == 2.0 * one else None  # scales with an offset and logarithms have no factor
