"""Errors that a user can correct: one line that states the subject, its value, the limit and the remedy.

The class of an error identifies the kind of input at fault; the command line prints the message and exits with code 2.
Any exception that is not a :class:`SolenError` is a defect of solen itself.
"""

import re

_LONG_DIGITS = re.compile(r"(\d{12})\d{9,}")  # more digits than any measured value
_MAX_LENGTH = 200


class SolenError(Exception):
    """A rejected input, described in one line.

    Parameters
    ----------
    what
        Subject of the error, as the user specified it (``lens.half_width_mm``, the path of a file).
    value
        The value that the user specified; omitted from the line if None.
    limit
        The limit that is violated.
    remedy
        How to correct it.
    """

    def __init__(self, what: str, *, value: object = None, limit: str = "", remedy: str = "") -> None:
        self.what = what
        self.value = value
        self.limit = limit
        self.remedy = remedy
        shown_value = "" if value is None else f" = {_shown(value)}"
        tail = "".join(f"; {part}" for part in (limit, remedy) if part)
        super().__init__(" ".join(f"{what}{shown_value}{tail}".split()))


def _shown(value: object) -> str:
    """Return a value in short form: numbers to nine digits, long strings truncated."""
    if isinstance(value, float):
        return str(float(f"{value:.9g}"))
    text = _LONG_DIGITS.sub(r"\1…", str(value))
    text = text if len(text) <= _MAX_LENGTH else f"{text[:_MAX_LENGTH]}…"
    return repr(text) if isinstance(value, str) else text


class SpecError(SolenError):
    """The design file, or a value set on the command line, is not a valid design."""


class DataError(SolenError):
    """A data file (a resin, a scene) cannot be read or contains unphysical values."""


class DesignError(SolenError):
    """The design is well formed but cannot be built, for example because the body intersects itself."""


class OutputError(SolenError):
    """The requested output cannot be written."""


class FrozenError(SolenError, AttributeError):
    """A field of a design, of options or of a result was assigned; they are immutable."""


class BenchError(SolenError):
    """An instrument failed, or cannot do what was requested."""
