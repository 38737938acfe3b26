"""Numbers as written in files: which strings are numbers, and with which decimal mark.

A string is a number only if every character belongs to it. Strings that a lenient reader would accept (``1_000``,
``nan``, ``0x1F``, Arabic digits) or repair (``12.5x``, ``1.234,5``) are typical of damage. Numbers written by
instruments must have a stricter form: no leading zeros, no plus sign, digits on both sides of the decimal mark, and one
digit before the mark if a power of ten follows.

Public names: `is_number`, `is_missing`, `all_numbers`, `parse` and `digits`.
"""

import math
import re
from collections.abc import Sequence

_NUMBER = re.compile(r"[+\-−–]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_MACHINE_NUMBER = re.compile(r"-?(?:(?:0|[1-9][0-9]*)(?:[.,][0-9]+)?|[0-9](?:[.,][0-9]+)?[eE][+-]?[0-9]{1,3})")
_NUMBERS = re.compile(rf"(?:{_NUMBER.pattern}\n)*+{_NUMBER.pattern}")
_MACHINE_NUMBERS = re.compile(rf"(?:(?:{_MACHINE_NUMBER.pattern})\n)*+(?:{_MACHINE_NUMBER.pattern})")
_MANTISSA = re.compile(r"([0-9]*)(?:[.,]([0-9]*))?(?:[eE].*)?")
_MAX_DIGITS = 15  # further digits come from the binary number, not from a measurement
_MISSING = {"", "nan", "n/a", "#n/a", "na", "null", "none", "nicht bekannt", "unknown"}
_MINUS = str.maketrans({"−": "-", "–": "-"})


def is_number(cell: str) -> bool:
    """Return whether a cell is a number with a decimal point or a decimal comma."""
    return _NUMBER.fullmatch(cell) is not None


def is_missing(cell: str) -> bool:
    """Return whether a cell is empty or marks a missing number."""
    return not cell or cell.lower() in _MISSING


def all_numbers(cells: Sequence[str], *, machine: bool = False) -> bool:
    """Return whether all cells are numbers; with ``machine``, in the form used by instruments."""
    return bool(cells) and (_MACHINE_NUMBERS if machine else _NUMBERS).fullmatch("\n".join(cells)) is not None


def parse(cell: str, mark: str, *, machine: bool = False) -> float:
    """Return the number in a cell, NaN if it is missing; raise `ValueError` with the reason otherwise.

    Parameters
    ----------
    mark
        Decimal mark, ``.`` or ``,``.
    machine
        Whether the number must have the form used by instruments.
    """
    if is_missing(cell):
        return math.nan
    plain = cell if cell.isascii() else cell.translate(_MINUS)
    if not (_MACHINE_NUMBER if machine else _NUMBER).fullmatch(plain):
        raise ValueError(_reason(plain, mark))
    if mark == ",":
        if "." in plain:
            raise ValueError("has a decimal point, but other numbers have decimal commas")
        plain = plain.replace(",", ".")
    elif "," in plain:
        raise ValueError("has a decimal comma, but other numbers have decimal points")
    number = float(plain)
    if math.isinf(number):
        raise ValueError("is too large for a number")
    return number


def digits(cell: str) -> tuple[int, int]:
    """Return the numbers of significant digits and of decimals of a written number."""
    mantissa = cell.lstrip("+-−–")
    match = _MANTISSA.fullmatch(mantissa)
    if not match:
        return 0, 0
    integer, decimals = match[1], match[2] or ""
    significant = (integer + decimals).lstrip("0")
    if len(significant) > _MAX_DIGITS:  # 53.064991000000006 is 53.064991
        return digits(f"{float(mantissa.replace(',', '.')):.{_MAX_DIGITS}g}")
    return len(significant), len(decimals)


def _reason(cell: str, mark: str) -> str:
    if _NUMBER.fullmatch(cell):
        return "is not in the form in which instruments write numbers"
    other = "," if mark == "." else "."
    if re.fullmatch(rf"[+-]?[0-9]{{1,3}}(?:[{other} '][0-9]{{3}})+(?:[{mark}][0-9]*)?", cell):
        return "has a thousands separator, which is not supported"
    return "is not a number"
