"""Label of an exported file: the name and checksum of the design, and the version of solen that wrote the file."""

import hashlib
from dataclasses import dataclass

from solen import __version__
from solen.spec import Design, dumps

WRITER = f"solen {__version__}"
SHAPE_FILES = ("body.file", "fabricate.receiver_part")
"""Design keys that name files on which the exported shape depends."""


@dataclass(frozen=True)
class Label:
    """Design name, SHA-256 and description of the product; without a date, so that files are reproducible."""

    name: str
    sha256: str
    about: str

    @property
    def lines(self) -> tuple[str, ...]:
        """Lines of the label."""
        return (self.name, f"written by {WRITER}", f"design sha256 {self.sha256}", self.about)


def label_of(design: Design, about: str) -> Label:
    """Return the label for a product of a design.

    The hash covers the TOML of the design without its defaults, so that comments and the order of keys do not matter,
    and the files on which the shape of the product depends: a drawn outline and a receiver part file.
    """
    digest = hashlib.sha256(dumps(design).encode())
    for key, path in design.files.items():
        if key in SHAPE_FILES:
            digest.update(path.read_bytes())
    return Label(design.name, digest.hexdigest(), about)


def ascii_of(text: str, max_length: int) -> str:
    """Return a string in ASCII, with ``?`` for other characters, truncated to ``max_length`` characters."""
    return text.encode("ascii", "replace").decode("ascii")[:max_length]
