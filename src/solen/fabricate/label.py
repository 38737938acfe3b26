"""Metadata label of an exported file: the design, the solen version that wrote it, and the design file."""

import hashlib
from dataclasses import dataclass

from solen import __version__
from solen.spec import Design, dumps

WRITER = f"solen {__version__}"
SHAPING = ("body.file", "fabricate.receiver_part")
"""Keys of design files that affect the exported shape."""


@dataclass(frozen=True)
class Label:
    """Design name, SHA-256 and product description; contains no date, so that files are reproducible."""

    name: str
    sha256: str
    about: str

    @property
    def lines(self) -> tuple[str, ...]:
        """Label as lines of text."""
        return (self.name, f"written by {WRITER}", f"design sha256 {self.sha256}", self.about)


def label_of(design: Design, about: str) -> Label:
    """Return the label for a product of a design.

    The hash covers the design's TOML without defaults, so comments and key order do not matter, and the files that
    define the shape of the product: a drawn outline and a receiver part file.
    """
    digest = hashlib.sha256(dumps(design).encode())
    for key, path in design.files.items():
        if key in SHAPING:
            digest.update(path.read_bytes())
    return Label(design.name, digest.hexdigest(), about)


def ascii_of(text: str, most: int) -> str:
    """Return a text in ASCII, with ``?`` for other characters, truncated to ``most`` characters."""
    return text.encode("ascii", "replace").decode("ascii")[:most]
