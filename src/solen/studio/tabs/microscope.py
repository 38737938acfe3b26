"""The microscope tab: edge, deviations and profile of a printed lens in an image."""

from pathlib import Path

from solen.studio.page_commands import PageCommand

COMMANDS = (
    PageCommand(
        "print inspect",
        "solen.pipeline.print.inspect:inspect",
        "Printed lens compared with its design",
        files={"image": "Micrograph of the lens, seen along y"},
        outputs={"out": "lens.json"},
        design="design",
        first=("um_per_px", "bar", "scale", "edge"),
    ),
    PageCommand(
        "print scale",
        "solen.pipeline.print.scale:scale",
        "Scale of an objective",
        files={"image": "Image of a stage micrometer"},
        outputs={"out": "scale.toml"},
        first=("spacing_mm",),
        hidden=("force",),
    ),
)


def suitable_commands(path: Path) -> tuple[str, ...]:  # noqa: ARG001  any file may be an image; the command checks it
    """Return the microscope commands that accept an image."""
    return ("print inspect", "print scale")
