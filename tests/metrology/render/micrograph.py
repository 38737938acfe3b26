"""A simulated micrograph: levels of the part, each with its own blur, lit, dirtied and taken by a camera.

A thick part is seen at two levels at once: the top face in focus and the bottom face, smaller or larger by perspective
and wall taper and further out of focus. Each level adds its own brightness where it covers a pixel, so any of the usual
kinds of lighting comes of a few of them:

- reflected: the part is brighter or darker than the ground (one level);
- transmitted: ground and part are bright, the slanted wall between the two outlines is dark;
- dark field: only the wall is bright.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from tests.metrology.render.camera import Camera, integrated
from tests.metrology.render.coverage import coverage
from tests.metrology.render.optics import Optics, gaussian
from tests.metrology.render.scenery import Scenery
from tests.metrology.render.shape import Placing


@dataclass(frozen=True)
class Level:
    """An outline in mm (closed polygons), where it lies, how bright it is against what is below, and its blur."""

    rings_mm: Sequence[FloatArray]
    placing: Placing
    brightness: float
    optics: Optics


@dataclass(frozen=True)
class Scene:
    """Levels on a ground, what dirties them, and the camera; ``sub`` sub-pixels to a pixel each way."""

    shape: tuple[int, int]
    levels: Sequence[Level]
    ground: float = 0.25
    scenery: Sequence[Scenery] = ()
    camera: Camera = field(default_factory=Camera)
    sub: int = 1

    def light(self, rng: np.random.Generator) -> FloatArray:
        """Light (rows, columns) on the pixels, 1 at full scale, before the camera."""
        fine = (self.shape[0] * self.sub, self.shape[1] * self.sub)
        image = np.full(self.shape, self.ground)
        for level in self.levels:
            cover = coverage([self.sub * level.placing.px(ring) for ring in level.rings_mm], fine)
            image += level.brightness * integrated(level.optics(cover, self.sub), self.sub)
        for change in self.scenery:
            image = change(image, rng)
        return image

    def taken(self, seed: int) -> NDArray[Any]:
        """Grey levels (rows, columns) of one exposure."""
        rng = np.random.default_rng(seed)
        return self.camera.levels(self.light(rng), rng)


def reflected(outline: FloatArray, placing: Placing, *, step: float = 0.6, optics: Optics | None = None) -> list[Level]:
    """One edge: the part ``step`` brighter than the ground."""
    return [Level([outline], placing, step, optics or gaussian(2.0))]


def transmitted(
    outer: tuple[FloatArray, Placing, float],
    inner: tuple[FloatArray, Placing, float],
    *,
    wall: float = 0.55,
    part: float = 0.08,
) -> list[Level]:
    """Two edges, each an outline, its place and its blur in px: light is lost by ``wall`` between them.

    Through the part it is weaker by ``part``; negative values make the wall bright, as in dark field.
    """
    return [
        Level([outer[0]], outer[1], -wall, gaussian(outer[2])),
        Level([inner[0]], inner[1], wall - part, gaussian(inner[2])),
    ]


def dark_field(outer: tuple[FloatArray, Placing, float], inner: tuple[FloatArray, Placing, float]) -> list[Level]:
    """Only the wall between the two outlines is bright."""
    return transmitted(outer, inner, wall=-0.6, part=-0.04)
