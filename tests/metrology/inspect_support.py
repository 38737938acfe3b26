"""Rendered micrographs of lenses as files, inspected with the function of the command."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.metrology import InspectOptions
from solen.pipeline.print.inspect import inspect
from solen.spec import template
from tests.metrology.render.camera import Camera, png
from tests.metrology.render.micrograph import Level, Scene, dark_field, reflected, transmitted
from tests.metrology.render.optics import Optics, gaussian
from tests.metrology.render.scenery import Scenery, gradient
from tests.metrology.render.shape import Placing, grown, outline_mm, shipped

INDICES = {"solen-860": "n = 1.44", "solen-500": "n = 1.49", "solen-450": "n = 1.54"}


@dataclass(frozen=True)
class Shot:
    """A micrograph of a lens: the part, its pose, and the properties of the image.

    ``taper_um`` is the distance by which the outline of the other face is outside the one in focus, for illumination
    that shows both.
    """

    outline: FloatArray
    um_per_px: float = 5.0
    angle_deg: float = 5.0
    light: str = "reflected"
    optics: Optics = field(default_factory=lambda: gaussian(2.0))
    scenery: Sequence[Scenery] = (gradient(0.3, 25.0),)
    camera: Camera = field(default_factory=Camera)
    size_um: tuple[float, float] = (4600.0, 2800.0)
    vertex_um: tuple[float, float] = (2300.0, 2350.0)
    taper_um: float = 50.0
    tilt_deg: float = 0.0
    magnification: float = 1.0
    step: float = 0.6
    sub: int = 1

    @property
    def placing(self) -> Placing:
        """Pose of the part; ``vertex_um`` is the position of the vertex from the image's upper left corner."""
        origin = (self.vertex_um[0] / self.um_per_px, self.vertex_um[1] / self.um_per_px)
        return Placing(self.um_per_px, origin, self.angle_deg, magnification=self.magnification, tilt_deg=self.tilt_deg)

    @property
    def _levels(self) -> tuple[list[Level], float]:
        if self.light == "reflected":
            return reflected(self.outline, self.placing, step=self.step, optics=self.optics), 0.25
        focused, other = (self.outline, self.placing, 1.5), (grown(self.outline, self.taper_um), self.placing, 3.0)
        outer, inner = (other, focused) if self.taper_um > 0.0 else (focused, other)
        return (transmitted(outer, inner), 0.85) if self.light == "transmitted" else (dark_field(outer, inner), 0.08)

    def taken(self, seed: int) -> NDArray[Any]:
        """Grey levels (rows, columns)."""
        levels, ground = self._levels
        columns, rows = (round(size / self.um_per_px) for size in self.size_um)
        scene = Scene((rows, columns), levels, ground=ground, scenery=self.scenery, camera=self.camera, sub=self.sub)
        return scene.taken(seed)


def design_file(folder: Path, name: str = "solen-860") -> Path:
    """Write a shipped design to a file."""
    path = folder / f"{name}.toml"
    path.write_text(template(name), encoding="utf-8")
    return path


def inspected(folder: Path, shot: Shot, seed: int, *, design: str = "solen-860", **options: Any) -> dict[str, Any]:
    """Return the result of `solen print inspect` for a shipped design; the scale is specified."""
    image = folder / "image.png"
    image.write_bytes(png(shot.taken(seed)))
    scale = InspectOptions(**{"um_per_px": shot.um_per_px, **options})
    return inspect(image, design=design_file(folder, design), options=scale).to_dict()


def lens(name: str = "solen-860", **values: Any) -> FloatArray:
    """Return the outline of a shipped design."""
    return outline_mm(shipped(name, **values))


def rotation_error_deg(measured_deg: float, true_deg: float) -> float:
    """Return the difference of two rotations in degrees, from −180 to 180."""
    return (measured_deg - true_deg + 180.0) % 360.0 - 180.0


def true_pose(shot: Shot) -> tuple[float, NDArray[np.float64]]:
    """Return the rotation of the part and the position (x, y) of its vertex; integers are at pixel centres."""
    return shot.angle_deg, np.asarray(shot.placing.origin_px) - 0.5
