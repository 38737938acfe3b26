"""A laboratory that prints drawings on a simulated printer and photographs them, for the tests of tuning."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.explore import TunedPrint, TuneOptions, TuningLog, tune
from solen.fabricate.layers import Slicing
from solen.fabricate.process import as_designed, rings_of
from solen.metrology import measure_lens, read_image
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
    """A folder, a printer, and what was printed."""

    folder: Path
    printer: Printer = field(default_factory=Printer)
    taken: int = 0

    @property
    def slicing(self) -> Slicing:
        """The printer and its process as files."""
        process, printer = self.folder / "process.toml", self.folder / "printer.toml"
        process.write_text(PROCESS)
        printer.write_text(PRINTER)
        return Slicing(process=process, printer=str(printer))

    def image(self, ring: FloatArray, **shot: Any) -> Path:
        """Micrograph of a new print of a drawing."""
        self.taken += 1
        outline = self.printer.printed(ring, self.taken)
        path = self.folder / f"print-{self.taken}.png"
        taken = Shot(outline, **({"um_per_px": UM_PER_PX, "angle_deg": 2.0 + self.taken} | shot))
        path.write_bytes(png(taken.taken(self.taken)))
        return path

    def tuned(self, image: Path, log: TuningLog | None = None, **options: Any) -> TunedPrint:
        """What follows from an image; the response is left out."""
        stated = {"seen_from": "top", "um_per_px": UM_PER_PX, "u_um_per_px": 0.002 * UM_PER_PX, "repeat_um": 0.4}
        chosen = TuneOptions(**(stated | options))
        micrograph = read_image(image, options=chosen)
        measured = measure_lens(micrograph, SENSOR.design, edge=chosen.edge, priors=chosen, seen_from=chosen.seen_from)
        number = 1 if log is None else len(log.prints) + 1
        return tune(measured, SENSOR, self.slicing, chosen, log, file=f"lens-tuned-{number}.toml", response=False)


def drawn_by(tuned: TunedPrint) -> FloatArray:
    """The corrected drawing as a ring."""
    return rings_of(tuned.compensation.outlines)[0]


def true_rms_um(outline: FloatArray) -> float:
    """Deviation (rms) of an outline from the designed lens after the best rotation and shift; corners left out.

    By distances to a polyline and least squares of its own.
    """
    front = front_mm(shipped())[30:-30]
    inner = front[(np.abs(front[:, 0]) < 1.95)]
    near = outline[(outline[:, 1] < 1.95) & (np.abs(outline[:, 0]) < 2.1)]
    near = near[np.argsort(np.arctan2(near[:, 0], 2.5 - near[:, 1]))]
    for _ in range(6):
        points, normals, away = _feet(near, inner)
        columns = np.column_stack([normals, normals[:, 1] * points[:, 0] - normals[:, 0] * points[:, 1]])
        (x, z, turn), *_ = np.linalg.lstsq(columns, away, rcond=None)
        near = near - np.array([x, z]) - turn * np.column_stack([-near[:, 1], near[:, 0]])
    return 1e3 * float(np.sqrt(np.mean((away - columns @ [x, z, turn]) ** 2)))


def _feet(near: FloatArray, inner: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places evenly along the designed front, its outward normals, and how far an outline lies outside there."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(inner, axis=0).T))])
    even = np.linspace(0.0, length[-1], 600)
    points = np.column_stack([np.interp(even, length, inner[:, i]) for i in (0, 1)])
    way = np.gradient(points, axis=0)
    way /= np.hypot(*way.T)[:, None]
    normals = np.column_stack([way[:, 1], -way[:, 0]])
    away = []
    for point, normal in zip(points, normals, strict=True):
        beside = near - point
        along, across = beside @ normal, beside @ np.array([normal[1], -normal[0]])
        close = np.abs(along) < 0.1
        order = np.argsort(across[close])
        away.append(np.interp(0.0, across[close][order], along[close][order]))
    return points, normals, np.array(away)
