"""Errors that a user can act on: each states in one line what is wrong, the value, the limit and the remedy.

The class of an error identifies the kind of input at fault; the command line prints the message and exits with code 2.
Any exception that is not a :class:`SolenError` is a defect of solen itself.
"""

import re

_DIGITS = re.compile(r"(\d{12})\d{9,}")  # more digits than any number of a measurement has
_LETTERS = 200


class SolenError(Exception):
    """A rejected input, described in one line.

    Parameters
    ----------
    what
        What is wrong, named as the user did (``lens.half_width_mm``, a file's path).
    value
        The value in question; omitted from the line if ``None``.
    limit
        The limit that it violates.
    remedy
        How to correct it.
    """

    def __init__(self, what: str, *, value: object = None, limit: str = "", remedy: str = "") -> None:
        self.what = what
        self.value = value
        self.limit = limit
        self.remedy = remedy
        found = "" if value is None else f" = {_shown(value)}"
        tail = "".join(f"; {part}" for part in (limit, remedy) if part)
        super().__init__(" ".join(f"{what}{found}{tail}".split()))


def _shown(value: object) -> str:
    """Return a value in short form: a number to nine digits, a long text truncated."""
    if isinstance(value, float):
        return str(float(f"{value:.9g}"))
    text = _DIGITS.sub(r"\1…", str(value))
    text = text if len(text) <= _LETTERS else f"{text[:_LETTERS]}…"
    return repr(text) if isinstance(value, str) else text


class SpecError(SolenError):
    """The design file, or a value set on the command line, is not a valid design."""


class DataError(SolenError):
    """A data file (a resin, a scene) cannot be read or contains values that are not physical."""


class DesignError(SolenError):
    """The design is well formed but cannot be built: an oval beyond tangency, a body crossing itself."""


class OutputError(SolenError):
    """The requested output cannot be written."""


class FrozenError(SolenError, AttributeError):
    """Assignment to a field of a design, of options or of a result, which are immutable."""


class BenchError(SolenError):
    """An instrument failed, or cannot do what was requested."""
