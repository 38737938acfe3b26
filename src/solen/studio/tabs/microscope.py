"""The microscope tab: measures the edge, deviations and profile of a printed lens in an image."""

from pathlib import Path

from solen.studio.offers import Offer

OFFERS = (
    Offer(
        "print inspect",
        "solen.pipeline.print.inspect:inspect",
        "Printed lens against its design",
        files={"image": "Micrograph of the lens, seen along y"},
        written={"out": "lens.json"},
        design="design",
        first=("um_per_px", "bar", "scale", "edge"),
    ),
    Offer(
        "print scale",
        "solen.pipeline.print.scale:scale",
        "Scale of an objective",
        files={"image": "Image of a stage micrometer"},
        written={"out": "scale.toml"},
        first=("spacing_mm",),
        hidden=("force",),
    ),
)


def commands_for(path: Path) -> tuple[str, ...]:  # noqa: ARG001  any file may be an image; the command checks it
    """Return the microscope commands that accept an image."""
    return ("print inspect", "print scale")
