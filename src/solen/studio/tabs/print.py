"""The print tab: the part, its layers, the predicted print, and the next drawing from an image of a print."""

from pathlib import Path

from solen.errors import DataError
from solen.studio.page_commands import PageCommand

IMAGE_SUFFIXES = (".tif", ".tiff", ".png", ".jpg", ".jpeg")

COMMANDS = (
    PageCommand(
        "export",
        "solen.pipeline.design.solid:export",
        "The part, for CAD and printers",
        outputs={"out": ""},
        design="file",
        first=("stl", "threemf", "step", "dxf", "svg"),
    ),
    PageCommand(
        "print layers",
        "solen.pipeline.print.layers:layers",
        "Layers",
        outputs={"out": ""},
        design="file",
        first=("printer", "layer_um", "exposure_s", "burn_in_layers", "burn_in_s", "orientation"),
    ),
    PageCommand(
        "print predict",
        "solen.pipeline.print.predict:predict",
        "Predicted print",
        outputs={"out": "printed.json"},
        design="file",
        first=("process", "cure", "printer", "orientation", "response"),
    ),
    PageCommand(
        "print tune",
        "solen.pipeline.print.tune:tune",
        "Next drawing, from an image",
        files={"image": "Micrograph of the printed lens"},
        outputs={"out": ""},
        design_outputs={"log": "{design}-tuning.json"},
        design="design",
        first=("um_per_px", "scale", "drawn", "process", "response"),
    ),
)


def suitable_commands(path: Path) -> tuple[str, ...]:
    """Return the print commands that accept a file."""
    if path.suffix.lower() in IMAGE_SUFFIXES:
        return ("print tune",)
    if path.suffix.lower() in {".toml", ".json"}:
        return ("print predict", "print layers")
    limit, remedy = (
        "must be an image, a process or a working curve",
        f"save an image as one of {', '.join(IMAGE_SUFFIXES)}",
    )
    raise DataError(path.name, limit=limit, remedy=remedy)
