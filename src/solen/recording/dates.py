"""Dates in the spellings of instruments, as ISO 8601 where it can be told which number is the month.

The interface: `iso` of a text, `among` the parameters of a file.
"""

import re
from collections.abc import Iterable, Mapping
from datetime import datetime

_CLOCK = r"(?:[T ,]+(\d{1,2}):(\d{2})(?::(\d{2})(?:\.\d+)?)?\s*([AaPp]\.?[Mm]\.?)?)?"
_YEAR_FIRST = re.compile(r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})" + _CLOCK)
_GERMAN = re.compile(r"(\d{1,2})\.\s?(\d{1,2})\.\s?(\d{4})" + _CLOCK)
_SLASHED = re.compile(r"(\d{1,2})[/-](\d{1,2})[/-](\d{4})" + _CLOCK)
_KEYS = re.compile(r"\b(date|datum|prüfdatum|test date|collection time|date/time stamp|measured|gemessen)\b", re.I)


def iso(text: str, *, others: Iterable[str] = ()) -> str:
    """ISO 8601 of a date and, if there, its time; empty where it is none or where day and month cannot be told apart.

    ``others`` are dates of the same file, one of which may tell.
    """
    text = text.strip()
    if found := _YEAR_FIRST.fullmatch(text):
        year, month, day = (int(found[n]) for n in (1, 2, 3))
    elif found := _GERMAN.fullmatch(text):
        day, month, year = (int(found[n]) for n in (1, 2, 3))
    elif found := _SLASHED.fullmatch(text):
        first = _month_first([text, *others])
        if first is None:
            return ""
        one, two, year = (int(found[n]) for n in (1, 2, 3))
        month, day = (one, two) if first else (two, one)
    else:
        return ""
    return _written(year, month, day, found)


def among(metadata: Mapping[str, str]) -> str:
    """Date that the parameters of a file state, as ISO 8601 where it can be told, else in the file's words."""
    stated = next((value for key, value in metadata.items() if _KEYS.search(key)), "")
    return iso(stated) or stated


def _month_first(texts: Iterable[str]) -> bool | None:
    """Whether dates with slashes begin with the month: a number beyond 12 tells, and so does the American clock."""
    found = [match for text in texts if (match := _SLASHED.fullmatch(text.strip()))]
    if any(int(match[2]) > 12 for match in found):
        return True
    if any(int(match[1]) > 12 for match in found):
        return False
    american = any(match[7] and len(match[2]) == 1 for match in found)  # others with AM and PM write 06 for a month
    return True if american else None


def _written(year: int, month: int, day: int, found: re.Match[str]) -> str:
    hour, minute, second = (int(found[n] or 0) for n in (4, 5, 6))
    half = (found[7] or "").lower().replace(".", "")
    if half and not 1 <= hour <= 12:
        return ""
    hour = hour % 12 + 12 * (half == "pm") if half else hour
    try:
        when = datetime(year, month, day, hour, minute, second)
    except ValueError:
        return ""
    return when.isoformat() if found[4] else when.date().isoformat()
