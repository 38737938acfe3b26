"""Errors a user can act on: each says in one line what is wrong, the value, the limit and the remedy.

A stage raises the kind that names whose input is at fault; the command line prints the line and exits with 2.
Anything that is not a :class:`SolenError` is a defect of solen itself.
"""

import re

_DIGITS = re.compile(r"(\d{12})\d{9,}")  # more digits than any number of a measurement has
_LETTERS = 200


class SolenError(Exception):
    """A rejected input, described in one line.

    Parameters
    ----------
    what
        The thing that is wrong, by the name the user gave it (``lens.half_width_mm``, a file's path).
    value
        The value in question; left out of the line when ``None``.
    limit
        The limit that it breaks.
    remedy
        How to put it right.
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
    """A value as a reader needs it: nine digits of a number, and the beginning of a long text."""
    if isinstance(value, float):
        return str(float(f"{value:.9g}"))
    text = _DIGITS.sub(r"\1…", str(value))
    text = text if len(text) <= _LETTERS else f"{text[:_LETTERS]}…"
    return repr(text) if isinstance(value, str) else text


class SpecError(SolenError):
    """The design file, or a value set on the command line, is not a valid design."""


class DataError(SolenError):
    """A data file (a resin, a scene) cannot be read or holds values that are not physical."""


class DesignError(SolenError):
    """The design is well formed but cannot be built: an oval beyond tangency, a body crossing itself."""


class OutputError(SolenError):
    """The result cannot be written where it was asked for."""


class FrozenError(SolenError, AttributeError):
    """A field of a design, of options or of a result was assigned to; none of them change, a changed copy is made."""


class BenchError(SolenError):
    """An instrument does not do what it is asked, or is asked for what it cannot do."""
