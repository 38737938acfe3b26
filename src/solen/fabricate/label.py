"""The metadata label of an exported file: its design, the version of solen that wrote it, and the design file."""

import hashlib
from dataclasses import dataclass

from solen import __version__
from solen.spec import Design, dumps

WRITER = f"solen {__version__}"
SHAPING = ("body.file", "fabricate.receiver_part")
"""Keys of files that a design may name and that shape what is made of it."""


@dataclass(frozen=True)
class Label:
    """Name of a design, its SHA-256, and a description of the product; no date, so that files are reproducible."""

    name: str
    sha256: str
    about: str

    @property
    def lines(self) -> tuple[str, ...]:
        """The label as lines of text."""
        return (self.name, f"written by {WRITER}", f"design sha256 {self.sha256}", self.about)


def label_of(design: Design, about: str) -> Label:
    """Label of a product of a design.

    Its hash is that of its TOML with all defaults left out, so comments and the order of keys do not count, and of the
    files that shape it: a drawn outline, a receiver's part file.
    """
    digest = hashlib.sha256(dumps(design).encode())
    for key, path in design.files.items():
        if key in SHAPING:
            digest.update(path.read_bytes())
    return Label(design.name, digest.hexdigest(), about)


def ascii_of(text: str, most: int) -> str:
    """A text in ASCII, with ``?`` for other characters, truncated after ``most`` characters."""
    return text.encode("ascii", "replace").decode("ascii")[:most]
