"""Reserved names in a drawing, and detection of misspellings, which would turn a receiver into a bare wall."""

import difflib

from solen.errors import DesignError
from solen.geometry.body import Face
from solen.geometry.drawing import Drawing
from solen.geometry.drawing.model import EMITTER, PIVOT

WORDS = ("receiver", "mirror", "black", EMITTER, PIVOT)
"""Reserved first words of names; ``lens`` is also recognised, but is otherwise an ordinary wall."""
ORDINARY = {"back", "blank", "block", "slack", "pilot"}
"""Words similar to reserved words that are not misspellings."""
NEAR = 0.79
"""Similarity, by `difflib`, above which a word counts as a misspelling."""


def check_names(drawing: Drawing) -> None:
    """Raise `DesignError` for a name that nearly matches a reserved name and is probably misspelt."""
    named = [(stroke.name, "a bare wall") for stroke in drawing.strokes]
    named += [(name, "a point without meaning") for name, _ in drawing.points]
    for name, otherwise in named:
        meant = _meant(name)
        if meant is not None:
            remedy = f"did you mean {meant}? If not, choose a less similar name"
            raise DesignError("body outline", value=name, limit=f"would be {otherwise}", remedy=remedy)


def _meant(name: str) -> str | None:
    """Return the intended name of a misspelling; None if its first word is reserved, or unlike all reserved words."""
    word = Face.part_of(name)
    if word in WORDS or word in ORDINARY:
        return None
    rest = name[len(word) :].strip("-_ .")
    for known in WORDS:
        if word.startswith(known):  # receivers, receiverright
            return "-".join(part for part in (known, word[len(known) :].removesuffix("s"), rest) if part)
    near = difflib.get_close_matches(word, WORDS, n=1, cutoff=NEAR)
    return "-".join(part for part in (*near, rest) if part) if near else None
