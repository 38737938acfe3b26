"""A ZIP of layers: a PNG for each, and a job.json with their heights, exposures and source.

Pictures go into the archive as they are made. They are compressed already, so the archive stores them; entries have no
date. job.json is written last, as the areas are known then.
"""

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.fabricate.label import WRITER
from solen.fabricate.layers.job import Job, Layer
from solen.fabricate.layers.printable import Printable
from solen.fabricate.meshfiles import NO_DATE

JOB_SCHEMA = 1
JOB_NAME = "job.json"
RULE = (
    "grey value / 255 is the share of the pixel's square that the solid covers at the middle of the layer's height; "
    "a last layer that is filled by less than half is left out"
)
VIEW = "from above onto the plate, X to the right, Y upwards: the first row has the largest Y"

Watch = Callable[[Layer], object]


@dataclass(frozen=True)
class Stack:
    """A stack of layers: volume in mm³, areas in mm² of the first layer and of the largest, and islands.

    ``islands`` are (number of the layer, pieces in it) that begin with nothing below them.
    """

    layers: int
    volume_mm3: float
    first_mm2: float
    largest_mm2: float
    islands: tuple[tuple[int, int], ...]


def write_archive(target: Path, job: Job, part: Printable | None = None, watch: Watch = lambda _: None) -> Stack:
    """Write a job's layers; job.json names ``part`` and its source, ``watch`` is called with each layer."""
    rows: list[dict[str, Any]] = []
    islands = []
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        last: Layer | None = None
        data = b""
        for layer in job.layers():
            if last is None or layer.image is not last.image:
                data = as_png(layer.image, job.printer.pitch_mm)
            name = f"layers/{layer.index + 1:05d}.png"
            archive.writestr(zipfile.ZipInfo(name, NO_DATE), data)
            rows.append({"file": name} | _row(layer))
            if layer.islands:
                islands.append((layer.index, layer.islands))
            last = layer
            watch(layer)
        areas = [row["area_mm2"] for row in rows]
        stack = Stack(len(rows), sum(areas) * job.layer_mm, areas[0], max(areas), tuple(islands))
        entry = zipfile.ZipInfo(JOB_NAME, NO_DATE)
        entry.compress_type = zipfile.ZIP_DEFLATED
        text = json.dumps(_described(job, stack, part) | {"layers": rows}, indent=1, allow_nan=False)
        archive.writestr(entry, f"{text}\n")
    return stack


def as_png(image: NDArray[np.uint8], pitch_mm: float) -> bytes:
    """PNG of grey values (rows, columns), the first row at the top, of pixels with a side of ``pitch_mm``."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(image).save(data, "PNG", dpi=(25.4 / pitch_mm, 25.4 / pitch_mm))
    return data.getvalue()


def _row(layer: Layer) -> dict[str, Any]:
    piece = {"feature": layer.feature} if layer.feature else {}
    return piece | {
        "from_mm": round(layer.from_mm, 9),
        "to_mm": round(layer.to_mm, 9),
        "exposure_s": layer.exposure_s,
        "dose_mJ_per_cm2": round(layer.dose_mJ_per_cm2, 9),
        "area_mm2": layer.area_mm2,
        "islands": layer.islands,
    }


def _described(job: Job, stack: Stack, part: Printable | None) -> dict[str, Any]:
    (rows, columns), slicing = job.printer.shape, job.slicing
    about: dict[str, Any] = {}
    if part is not None:
        source = {"file": part.source.file, "sha256": part.source.sha256, "format": part.source.format}
        about = {"name": part.label.name, "source": source}
    return {
        "solen_layers": JOB_SCHEMA,
        "writer": WRITER,
        **about,
        "orientation": slicing.orientation,
        "rotate_deg": slicing.rotate_deg,
        "burn_in_layers": job.burn_in_layers,
        "z_offset_mm": slicing.z_offset_um / 1000.0,
        "rule": RULE,
        "view": VIEW,
        "mirror": slicing.mirror,
        "printer": job.printer.name,
        "pitch_mm": job.printer.pitch_mm,
        "pixels": {"columns": columns, "rows": rows},
        "layer_mm": job.layer_mm,
        "copies_mm": job.places_mm,
        "size_mm": job.solid.size_mm,
        "solid_volume_mm3": job.volume_mm3,
        "stack_volume_mm3": stack.volume_mm3,
    }
