"""ZIP archive of layers: one PNG per layer, a manifest, and a job.json with heights, exposures and source.

Images are written to the archive as they are made, without further compression; entries have no date. job.json is
written last because the areas are known only then. UVtools (github.com/sn4k3/UVtools, "generic zip") opens an archive
that contains ``1.png`` to ``N.png`` and ``manifest.uvtools``, an XML file with the resolution, display size in mm,
height and layer thickness; the manifest has no entry for exposures.
"""

import io
import json
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from solen.fabricate.label import WRITER
from solen.fabricate.layers.job import Job, Layer
from solen.fabricate.layers.printable import Printable
from solen.fabricate.meshfiles import NO_DATE

JOB_SCHEMA = 2
JOB_NAME = "job.json"
MANIFEST_NAME = "manifest.uvtools"
COVERED = "the fraction of the pixel area that the solid covers at mid-height of the layer"
LAST_LAYER = "a last layer that is less than half filled is omitted"
RULE = f"grey level / 255 is {COVERED}; {LAST_LAYER}"
CORRECTED_RULE = f"according to the measured grey response, the light of the grey level is {COVERED}; {LAST_LAYER}"
VIEW = "seen from above the plate, with X to the right and Y upwards: the first row has the largest Y"

Watch = Callable[[Layer], object]


@dataclass(frozen=True)
class Stack:
    """A stack of layers: volume in mm³, areas in mm² of the first and the largest layer, and islands.

    ``islands`` are pairs of a layer index and the number of regions in that layer without support from below.
    """

    layers: int
    volume_mm3: float
    first_mm2: float
    largest_mm2: float
    islands: tuple[tuple[int, int], ...]


@dataclass
class StackRecorder:
    """Areas and islands of a stack, recorded layer by layer as the images are made."""

    job: Job
    watch: Watch
    areas_mm2: list[float] = field(default_factory=list)
    islands: list[tuple[int, int]] = field(default_factory=list)

    def encoded_layers(self, encode: Callable[[NDArray[np.uint8]], bytes]) -> Iterator[tuple[Layer, bytes]]:
        """Yield layers with their encoded images; an image identical to the previous one is not encoded again."""
        last, data = None, b""
        for layer in self.job.layers():
            if layer.image is not last:
                last, data = layer.image, encode(layer.image)
            yield layer, data
            self.areas_mm2.append(layer.area_mm2)
            if layer.islands:
                self.islands.append((layer.index, layer.islands))
            self.watch(layer)

    def stack(self) -> Stack:
        """Summary of all layers."""
        areas = self.areas_mm2
        return Stack(len(areas), sum(areas) * self.job.layer_mm, areas[0], max(areas), tuple(self.islands))


def write_archive(target: Path, job: Job, part: Printable | None = None, watch: Watch = lambda _: None) -> Stack:
    """Write the layers of a job; job.json names ``part`` and its source, and ``watch`` is called with each layer."""
    rows: list[dict[str, Any]] = []
    recorder = StackRecorder(job, watch)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(zipfile.ZipInfo(MANIFEST_NAME, NO_DATE), _manifest(job))
        for layer, data in recorder.encoded_layers(lambda image: as_png(image, job.printer.pitches_mm)):
            name = f"{layer.index + 1}.png"
            archive.writestr(zipfile.ZipInfo(name, NO_DATE), data)
            rows.append({"file": name} | _row(layer))
        stack = recorder.stack()
        entry = zipfile.ZipInfo(JOB_NAME, NO_DATE)
        entry.compress_type = zipfile.ZIP_DEFLATED
        text = json.dumps(_description(job, stack, part) | {"layers": rows}, indent=1, allow_nan=False)
        archive.writestr(entry, f"{text}\n")
    return stack


def as_png(image: NDArray[np.uint8], pitches_mm: tuple[float, float]) -> bytes:
    """Return a PNG of grey levels (rows, columns), with the first row at the top and the pixel sizes along X and Y."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(image).save(data, "PNG", dpi=tuple(25.4 / pitch for pitch in pitches_mm))
    return data.getvalue()


def _manifest(job: Job) -> bytes:
    """Return the manifest for UVtools, with the sizes of pixels and layers."""
    (rows, columns), (x, y, z) = job.printer.shape, job.printer.size_mm
    root = ET.Element("Manifest")
    about: dict[str, object] = {"CreatedBy": WRITER, "UpdatedBy": WRITER, "LayerHeight": job.layer_mm}
    about |= {"ResolutionX": columns, "ResolutionY": rows}
    about |= {"DisplayWidth": round(x, 6), "DisplayHeight": round(y, 6), "MachineZ": z}
    for name, value in about.items():
        ET.SubElement(root, name).text = str(value)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))


def _row(layer: Layer) -> dict[str, Any]:
    feature = {"feature": layer.feature} if layer.feature else {}
    return feature | {
        "from_mm": round(layer.from_mm, 9),
        "to_mm": round(layer.to_mm, 9),
        "exposure_s": layer.exposure_s,
        "dose_mJ_per_cm2": round(layer.dose_mJ_per_cm2, 9),
        "area_mm2": layer.area_mm2,
        "islands": layer.islands,
    }


def _description(job: Job, stack: Stack, part: Printable | None) -> dict[str, Any]:
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
        "rule": CORRECTED_RULE if job.greys.response and job.greys.corrected else RULE,
        "view": VIEW,
        "mirror": job.mirror,
        "phase_px": slicing.phase_px,
        "anti_aliasing": not slicing.no_anti_aliasing,
        "printer": job.printer.name,
        "pitch_mm": job.printer.pitches_mm,
        "pixels": {"columns": columns, "rows": rows},
        "layer_mm": job.layer_mm,
        "copies_mm": job.positions_mm,
        "size_mm": job.solid.size_mm,
        "solid_volume_mm3": job.volume_mm3,
        "stack_volume_mm3": stack.volume_mm3,
    }
