"""Simulated micrographs: levels of the part, each with its own blur, illumination, dirt, and a camera.

A thick part is seen at two levels: the upper face in focus, and the lower face, which is smaller or larger due to
perspective and taper, and out of focus. Each level adds its brightness to the pixels that it covers, so a few levels
represent the usual kinds of illumination:

- reflected: the part is brighter or darker than the background (one level);
- transmitted: background and part are bright, and the slanted wall between the two outlines is dark;
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
    """An outline in mm (closed polygons), its pose, its brightness relative to what is below it, and its blur."""

    rings_mm: Sequence[FloatArray]
    placing: Placing
    brightness: float
    optics: Optics


@dataclass(frozen=True)
class Scene:
    """Levels on a background, dirt, and the camera; ``sub`` is the number of sub-pixels per pixel along each axis."""

    shape: tuple[int, int]
    levels: Sequence[Level]
    ground: float = 0.25
    scenery: Sequence[Scenery] = ()
    camera: Camera = field(default_factory=Camera)
    sub: int = 1

    def light(self, rng: np.random.Generator) -> FloatArray:
        """Return the light (rows, columns) on the pixels, 1 at full scale, without the camera's noise."""
        fine = (self.shape[0] * self.sub, self.shape[1] * self.sub)
        image = np.full(self.shape, self.ground)
        for level in self.levels:
            cover = coverage([self.sub * level.placing.px(ring) for ring in level.rings_mm], fine)
            image += level.brightness * integrated(level.optics(cover, self.sub), self.sub)
        for change in self.scenery:
            image = change(image, rng)
        return image

    def taken(self, seed: int) -> NDArray[Any]:
        """Return the grey levels (rows, columns) of one exposure."""
        rng = np.random.default_rng(seed)
        return self.camera.levels(self.light(rng), rng)


def reflected(outline: FloatArray, placing: Placing, *, step: float = 0.6, optics: Optics | None = None) -> list[Level]:
    """Return a level with one edge: the part is brighter than the background by ``step``."""
    return [Level([outline], placing, step, optics or gaussian(2.0))]


def transmitted(
    outer: tuple[FloatArray, Placing, float],
    inner: tuple[FloatArray, Placing, float],
    *,
    wall: float = 0.55,
    part: float = 0.08,
) -> list[Level]:
    """Return levels with two edges, each an outline, its pose and its blur in px.

    Between them, the light is reduced by ``wall``, and through the part by ``part``; negative values give a bright
    wall, as in dark field.
    """
    return [
        Level([outer[0]], outer[1], -wall, gaussian(outer[2])),
        Level([inner[0]], inner[1], wall - part, gaussian(inner[2])),
    ]


def dark_field(outer: tuple[FloatArray, Placing, float], inner: tuple[FloatArray, Placing, float]) -> list[Level]:
    """Return levels with only the wall between the two outlines bright."""
    return transmitted(outer, inner, wall=-0.6, part=-0.04)
