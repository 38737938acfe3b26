"""Conversion of units on input and output; inside solen, units are mm, nm, degrees and fractions of the emitted power.

The spelling of units varies between files (``N/mm²``, ``mW/cm2``, ``µm``): `is_unit` recognises a unit, and `factor`
converts between two units. pint does the conversion and is loaded on first use.
"""

import re
from functools import cache
from typing import Any

NM_PER_UM = 1e3

_MAX_UNIT_LENGTH = 24  # longer strings are comments
_SPELLINGS = {"pct": "%", "percent": "%", "prozent": "%"} | dict.fromkeys(("%t", "%r", "%a"), "%")
_SPELLINGS |= {
    "µ": "µm",
    "å": "angstrom",
    "micron": "um",
    "microns": "um",
    "sec": "s",
    "sek": "s",
    "std": "h",
    "ohms": "ohm",
    **{name: name for name in ("ohm", "kohm", "deg")},  # in upper or lower case
    "°": "deg",
    "": "1",
    "-": "1",
}
_COUNTS = frozenset({"count", "counts"})
"""Counts of an ADC or an encoder, whose size is unknown; pint would treat them as pure numbers, like rad."""
_SIGNS = str.maketrans({"²": "2", "³": "3", "⁻": "-", "¹": "1", "·": "*", "μ": "µ", "−": "-"})
_UNIT_PATTERN = re.compile(r"1|[1/%°a-zµΩ*^.\-0-9 ()]+", re.IGNORECASE)


def um_from_nm(wavelength_nm: float) -> float:
    """Return a wavelength in micrometres, as used in dispersion formulas."""
    return wavelength_nm / NM_PER_UM


def is_unit(text: str) -> bool:
    """Return whether a string is a unit in a common spelling; an empty string is a dimensionless unit."""
    return _unit(text) is not None


def factor(unit: str, target: str) -> float | None:
    """Return the factor that converts a number from ``unit`` to ``target``, or None if there is none.

    Units without a factor, such as dB/cm and °C, convert only to themselves.
    """
    if unit and unit == target:
        return 1.0
    old, new = _unit(unit), _unit(target)
    if old is None or new is None or old.dimensionality != new.dimensionality:
        return None
    # rounded, because a conversion through m gives 999.9999999999999
    return float(f"{(1.0 * old).to(new).magnitude:.15g}")


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(on_redefinition="ignore", autoconvert_offset_to_baseunit=False)


@cache
def _unit(text: str) -> Any:
    """Return the unit in a string, or None."""
    spelling = text.strip().strip("[]").translate(_SIGNS)
    spelling = _SPELLINGS.get(spelling.lower(), spelling)
    if len(spelling) > _MAX_UNIT_LENGTH or not _UNIT_PATTERN.fullmatch(spelling) or spelling.lower() in _COUNTS:
        return None
    if spelling == "1":
        return _registry().dimensionless
    powered = re.sub(r"(?<=[a-zµΩ)])\^?(-?\d)", r"**\1", spelling, flags=re.IGNORECASE)
    try:
        unit = _registry().Unit(powered)
        first, second = (_registry().Quantity(number, unit).to_base_units().magnitude for number in (1.0, 2.0))
    except Exception:
        return None
    return unit if second == 2.0 * first else None  # scales with an offset and logarithmic units have no factor
