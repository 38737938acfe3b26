"""A simulated laboratory that prints drawings and takes their micrographs, for the tests of tuning."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.explore import TunedPrint, TuneOptions, TuningLog, tune
from solen.fabricate.layers import Slicing
from solen.fabricate.process import as_designed, rings_of
from solen.metrology import LensInspection, measure_lens, read_image
from solen.sensor import Sensor
from solen.spec import loads, template
from tests.explore.print_simulator import Printer
from tests.metrology.inspect_support import Shot
from tests.metrology.render.camera import png
from tests.metrology.render.shape import front_mm, shipped

UM_PER_PX = 4.0
SENSOR = Sensor.of(loads(template("solen-860")))
DESIGNED = rings_of(as_designed(SENSOR.body()))[0]
PROCESS = """\
schema = 1
name = "lab"
[process]
pixel_um = 27.0
sigma_um = 12.0
[uncertainty]
sigma_um = 3.0
"""
PRINTER = """\
schema = 1
name = "lab"
maker = "lab"
document = "none"
[pitch_um]
typical = 27.0
basis = "measured"
source = "simulated"
[pixels]
columns = 2000
rows = 2000
basis = "measured"
source = "simulated"
[build_height_mm]
typical = 100
basis = "measured"
source = "simulated"
"""


@dataclass
class Lab:
    """A folder, a printer, and the number of prints made."""

    folder: Path
    printer: Printer = field(default_factory=Printer)
    prints: int = 0

    @property
    def slicing(self) -> Slicing:
        """Slicing with the printer and its process as files."""
        process, printer = self.folder / "process.toml", self.folder / "printer.toml"
        process.write_text(PROCESS)
        printer.write_text(PRINTER)
        return Slicing(process=process, printer=str(printer))

    def image(self, ring: FloatArray, **shot: Any) -> Path:
        """Return the micrograph of a new print of a drawing."""
        self.prints += 1
        outline = self.printer.printed(ring, self.prints)
        path = self.folder / f"print-{self.prints}.png"
        micrograph = Shot(outline, **({"um_per_px": UM_PER_PX, "angle_deg": 2.0 + self.prints} | shot))
        path.write_bytes(png(micrograph.taken(self.prints)))
        return path

    def tuned(self, image: Path, log: TuningLog | None = None, **changed: Any) -> TunedPrint:
        """Return the result of tuning with an image; the response is not traced."""
        number = 1 if log is None else len(log.prints) + 1
        file, options = f"lens-tuned-{number}.toml", _options(changed)
        inspection = self.inspected(image, **changed)
        return tune(inspection, SENSOR, self.slicing, options, log, file=file, response=False)

    def inspected(self, image: Path, **changed: Any) -> LensInspection:
        """Return the measurement of an image."""
        options = _options(changed)
        micrograph = read_image(image, options=options)
        return measure_lens(micrograph, SENSOR.design, edge=options.edge, priors=options, seen_from=options.seen_from)


def _options(changed: dict[str, Any]) -> TuneOptions:
    default = {"seen_from": "top", "um_per_px": UM_PER_PX, "u_um_per_px": 0.002 * UM_PER_PX, "repeat_um": 0.4}
    return TuneOptions(**(default | changed))


def drawing_of(tuned: TunedPrint) -> FloatArray:
    """Return the next drawing as a ring."""
    return rings_of(tuned.compensation.outlines)[0]


def true_rms_um(outline: FloatArray) -> float:
    """Return the RMS deviation of an outline from the designed lens without corners, after the best rotation and shift.

    It is computed from distances to a polyline and a separate least-squares fit, independently of solen.
    """
    front = front_mm(shipped())[30:-30]
    inner = front[(np.abs(front[:, 0]) < 1.95)]
    near = outline[(outline[:, 1] < 1.95) & (np.abs(outline[:, 0]) < 2.1)]
    near = near[np.argsort(np.arctan2(near[:, 0], 2.5 - near[:, 1]))]
    for _ in range(6):
        points, normals, deviation = _deviations(near, inner)
        columns = np.column_stack([normals, normals[:, 1] * points[:, 0] - normals[:, 0] * points[:, 1]])
        (x, z, rotation), *_ = np.linalg.lstsq(columns, deviation, rcond=None)
        near = near - np.array([x, z]) - rotation * np.column_stack([-near[:, 1], near[:, 0]])
    return 1e3 * float(np.sqrt(np.mean((deviation - columns @ [x, z, rotation]) ** 2)))


def _deviations(near: FloatArray, inner: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return equidistant points on the designed front, outward normals, and the outward deviations of an outline."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(inner, axis=0).T))])
    even = np.linspace(0.0, length[-1], 600)
    points = np.column_stack([np.interp(even, length, inner[:, i]) for i in (0, 1)])
    tangents = np.gradient(points, axis=0)
    tangents /= np.hypot(*tangents.T)[:, None]
    normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
    deviations = []
    for point, normal in zip(points, normals, strict=True):
        offset = near - point
        outward, along = offset @ normal, offset @ np.array([normal[1], -normal[0]])
        close = np.abs(outward) < 0.1
        order = np.argsort(along[close])
        deviations.append(np.interp(0.0, along[close][order], outward[close][order]))
    return points, normals, np.array(deviations)
