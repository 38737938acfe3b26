"""The print tab: the part, its layers, the predicted print, and the next drawing based on an image of a print."""

from pathlib import Path

from solen.errors import DataError
from solen.studio.offers import Offer

IMAGES = (".tif", ".tiff", ".png", ".jpg", ".jpeg")

OFFERS = (
    Offer(
        "export",
        "solen.pipeline.design.solid:export",
        "The part, for CAD and printers",
        written={"out": ""},
        design="file",
        first=("stl", "threemf", "step", "dxf", "svg"),
    ),
    Offer(
        "print layers",
        "solen.pipeline.print.layers:layers",
        "Layers",
        written={"out": ""},
        design="file",
        first=("printer", "layer_um", "exposure_s", "burn_in_layers", "burn_in_s", "orientation"),
    ),
    Offer(
        "print predict",
        "solen.pipeline.print.predict:predict",
        "Predicted print",
        written={"out": "printed.json"},
        design="file",
        first=("process", "cure", "printer", "orientation", "response"),
    ),
    Offer(
        "print tune",
        "solen.pipeline.print.tune:tune",
        "Next drawing, from an image",
        files={"image": "Micrograph of the printed lens"},
        written={"out": ""},
        beside={"log": "{design}-tuning.json"},
        design="design",
        first=("um_per_px", "scale", "drawn", "process", "response"),
    ),
)


def commands_for(path: Path) -> tuple[str, ...]:
    """Return the print commands that accept a file."""
    if path.suffix.lower() in IMAGES:
        return ("print tune",)
    if path.suffix.lower() in {".toml", ".json"}:
        return ("print predict", "print layers")
    limit, remedy = "is not an image, process or working curve", f"an image must end in {', '.join(IMAGES)}"
    raise DataError(path.name, limit=limit, remedy=remedy)
