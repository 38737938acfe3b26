"""Labels in file names: ``S1_lens_2.csv`` gives the sensor, the lens and the recording number.

Public names: `labels` and `has_lens`.
"""

import re
from pathlib import Path

from solen.errors import DataError, SpecError

_FIELD = re.compile(r"\{([^{}]*)\}")
_WITH = {"lens", "with", "withlens", "yes", "y", "1", "true", "on", "linse", "mit"}
_WITHOUT = {
    "nolens",
    "without",
    "withoutlens",
    "no",
    "n",
    "0",
    "none",
    "false",
    "off",
    "control",
    "flat",
    "bare",
    "ohne",
}


def labels(path: Path, pattern: str) -> dict[str, str]:
    """Return the labels in a file name that matches a pattern.

    Parameters
    ----------
    path
        The file.
    pattern
        The name with a field in braces for each varying part: ``sensor``, ``lens``, ``run`` or any other; ``*`` matches
        anything. The extension is optional; a pattern with ``/`` includes the last folders.

    Raises
    ------
    SpecError
        If the pattern has no field, or the same field twice.
    DataError
        If the name does not match.
    """
    expression, fields = _expression(pattern)
    depth = pattern.count("/") + 1
    name = "/".join(path.parts[-depth:])
    stem = name[: -len(path.suffix)] if path.suffix and not pattern.endswith(path.suffix) else name
    match = expression.fullmatch(name) or expression.fullmatch(stem)
    if match is None:
        remedy = "correct --pattern, or rename the file; a field is written as in {sensor}_{lens}_{run}.csv"
        raise DataError(str(path), limit=f"does not match the pattern {pattern}", remedy=remedy)
    return dict(zip(fields, match.groups(), strict=True))


def _expression(pattern: str) -> tuple[re.Pattern[str], list[str]]:
    fields = _FIELD.findall(pattern)
    invalid = next((name for name in fields if not name.isidentifier() or fields.count(name) > 1), None)
    if not fields or invalid is not None:
        limit = "has no field" if invalid is None else f"has the field {{{invalid}}}, which is repeated or not a name"
        remedy = "write a field as in {sensor}_{lens}_{run}.csv"
        raise SpecError("--pattern", value=pattern, limit=limit, remedy=remedy)
    parts = _FIELD.split(pattern)
    literals = [re.escape(part).replace(r"\*", "[^/]*") for part in parts[::2]]
    return re.compile("([^/]+?)".join(literals)), fields


def has_lens(word: str) -> bool:
    """Return whether a label means that there is a lens; raise `DataError` for a word that means neither."""
    plain = re.sub(r"[\W_]+", "", word).casefold()
    if plain in _WITH or plain in _WITHOUT:
        return plain in _WITH
    remedy = "use lens or nolens, or omit {lens} from --pattern and name the sensors without a lens with --control"
    raise DataError("lens", value=word, limit="indicates neither a lens nor its absence", remedy=remedy)
