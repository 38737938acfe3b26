"""Units inside solen are mm, nm, degrees and fractions of the emitted power; they are converted here, at the doors.

A file states units in its own spelling, ``N/mm²``, ``mW/cm2`` or ``µm``: `is_unit` knows whether a text is one,
`factor` takes numbers from one to another. pint knows the units; it is loaded when the first text is asked about.
"""

import re
from functools import cache
from typing import Any

NM_PER_UM = 1e3

_LONGEST = 24  # characters of a unit: what is longer is a remark
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
"""Counts of a converter or an encoder: of what size, nobody knows; pint takes them for pure numbers, as it does rad."""
_POWERS = str.maketrans({"²": "2", "³": "3", "⁻": "-", "¹": "1", "·": "*", "μ": "µ", "−": "-"})
_FORM = re.compile(r"1|[1/%°a-zµΩ*^.\-0-9 ()]+", re.IGNORECASE)


def um_from_nm(wavelength_nm: float) -> float:
    """Wavelength in micrometres, as dispersion formulas take it."""
    return wavelength_nm / NM_PER_UM


def is_unit(text: str) -> bool:
    """Whether a text is a unit, by the spellings of instruments and of people; an empty one is a pure number's."""
    return _unit(text) is not None


def factor(unit: str, wanted: str) -> float | None:
    """Factor that turns a number in ``unit`` into one in ``wanted``; None where there is none.

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
    """Unit of a text, or None."""
    plain = text.strip().strip("[]").translate(_POWERS)
    plain = _SPELLINGS.get(plain.lower(), plain)
    if len(plain) > _LONGEST or not _FORM.fullmatch(plain) or plain.lower() in _COUNTS:
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
