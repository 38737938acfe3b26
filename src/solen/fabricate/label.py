"""The label of a file: which design it holds, which solen wrote it, from which design file."""

import hashlib
from dataclasses import dataclass

from solen import __version__
from solen.spec import Design, dumps

WRITER = f"solen {__version__}"
SHAPING = ("body.file", "fabricate.receiver_part")
"""Keys of files that a design may name and that shape what is made of it."""


@dataclass(frozen=True)
class Label:
    """Name of a design, its SHA-256, and in words what was made of it. No date: the same design gives the same file."""

    name: str
    sha256: str
    about: str

    @property
    def lines(self) -> tuple[str, ...]:
        """The label as lines of text."""
        return (self.name, f"written by {WRITER}", f"design sha256 {self.sha256}", self.about)


def label_of(design: Design, about: str) -> Label:
    """Label of what is made of a design.

    Its hash is that of its TOML with all defaults left out, so comments and the order of keys do not count, and of the
    files that shape it: a drawn outline, a receiver's part file.
    """
    digest = hashlib.sha256(dumps(design).encode())
    for key, path in design.files.items():
        if key in SHAPING:
            digest.update(path.read_bytes())
    return Label(design.name, digest.hexdigest(), about)


def ascii_of(text: str, most: int) -> str:
    """A text in ASCII, what is not in it as ``?``, cut off after ``most`` characters."""
    return text.encode("ascii", "replace").decode("ascii")[:most]
