"""Reserved names in a drawing, and detection of misspellings, which would turn a receiver into a bare wall."""

import difflib

from solen.errors import DesignError
from solen.geometry.body import Face
from solen.geometry.drawing import Drawing
from solen.geometry.drawing.model import EMITTER, PIVOT

RESERVED = ("receiver", "mirror", "black", EMITTER, PIVOT)
"""Reserved first words of names; ``lens`` is recognised, too, but a lens is an ordinary wall."""
UNRELATED = {"back", "blank", "block", "slack", "pilot"}
"""Words that resemble reserved words but are not misspellings."""
MIN_SIMILARITY = 0.79
"""Minimum similarity, as defined by `difflib`, of a misspelling to a reserved word."""


def check_names(drawing: Drawing) -> None:
    """Raise `DesignError` for a name that is probably a misspelt reserved name."""
    named = [(stroke.name, "a bare wall") for stroke in drawing.strokes]
    named += [(name, "a point without meaning") for name, _ in drawing.points]
    for name, meaning in named:
        intended = _intended_name(name)
        if intended is not None:
            remedy = f"did you mean {intended}? if not, choose a less similar name"
            raise DesignError("name in the drawing", value=name, limit=f"is read as {meaning}", remedy=remedy)


def _intended_name(name: str) -> str | None:
    """Return the intended name of a misspelling; None if the first word is reserved, or unlike all reserved words."""
    word = Face.part_of(name)
    if word in RESERVED or word in UNRELATED:
        return None
    remainder = name[len(word) :].strip("-_ .")
    for reserved in RESERVED:
        if word.startswith(reserved):  # receivers, receiverright
            return "-".join(part for part in (reserved, word[len(reserved) :].removesuffix("s"), remainder) if part)
    similar = difflib.get_close_matches(word, RESERVED, n=1, cutoff=MIN_SIMILARITY)
    return "-".join(part for part in (*similar, remainder) if part) if similar else None
