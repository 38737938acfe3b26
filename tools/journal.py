"""Copy some figures of `solen project reproduce` for the page that shows them (docs/paper-figures.md).

``python -m tools.journal FOLDER`` makes the figures in the folder, or uses those already finished there.
"""

import sys
from pathlib import Path

from PIL import Image

from solen.pipeline.project.reproduce import reproduce

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
DRAWN = ("2", "3CD", "4D", "5", "S1C", "S2")
PHOTOGRAPHS = ("3E", "S5B")
"""Figures that are several times as large as a PNG than as a JPEG."""


def main(folder: Path) -> None:
    """Make and copy the figures."""
    reproduce(out=folder)
    for name in DRAWN:
        (IMAGES / f"paper-{name}.svg").write_bytes((folder / "figures" / f"{name}.svg").read_bytes())
    for name in PHOTOGRAPHS:
        with Image.open(folder / "figures" / f"{name}.png") as picture:
            picture.convert("RGB").save(IMAGES / f"paper-{name}.jpg", quality=80)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
