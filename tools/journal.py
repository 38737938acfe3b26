"""Copy figures of `solen project reproduce` for docs/paper-figures.md.

``python -m tools.journal FOLDER`` makes the figures in the folder, or uses those that are already there.
"""

import sys
from pathlib import Path

from PIL import Image

from solen.pipeline.project.reproduce import reproduce

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
VECTOR_FIGURES = ("2", "3CD", "4D", "5", "S1C", "S2")
RASTER_FIGURES = ("3E", "S5B")
"""Figures whose PNG file is several times as large as their JPEG file."""


def main(folder: Path) -> None:
    """Make and copy the figures."""
    reproduce(out=folder)
    for name in VECTOR_FIGURES:
        (IMAGES / f"paper-{name}.svg").write_bytes((folder / "figures" / f"{name}.svg").read_bytes())
    for name in RASTER_FIGURES:
        with Image.open(folder / "figures" / f"{name}.png") as image:
            image.convert("RGB").save(IMAGES / f"paper-{name}.jpg", quality=80)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
