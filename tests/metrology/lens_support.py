"""Rendered images of the shipped lens."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.metrology import Image, as_image
from solen.metrology.nominal import NominalFront, nominal_front
from tests.metrology.render.micrograph import Level, Scene, reflected
from tests.metrology.render.shape import Placing, outline_mm, shipped

UM_PER_PX = 5.0
SHAPE = (900, 1200)
PLACING = Placing(UM_PER_PX, (600.0, 650.0), angle_deg=7.0)
NOMINAL: NominalFront = nominal_front(shipped())
OUTLINE = outline_mm(shipped())


def taken(levels: Sequence[Level], seed: int = 1, um_per_px: float = UM_PER_PX, **options: Any) -> Image:
    """Return an image of levels, with a scale."""
    grey = Scene(options.pop("shape", SHAPE), levels, **options).taken(seed)
    return as_image(as_levels(grey), um_per_px)


def as_levels(grey: NDArray[Any]) -> NDArray[np.float64]:
    return np.asarray(grey / float(np.iinfo(grey.dtype).max), dtype=np.float64)


def printed(change: Callable[[FloatArray], FloatArray] | None = None, design: str = "solen-860") -> FloatArray:
    return outline_mm(shipped(design), change)


def plain(outline: FloatArray = OUTLINE, placing: Placing = PLACING, seed: int = 1, **options: Any) -> Image:
    """Return an image of a part that is brighter than the background."""
    return taken(reflected(outline, placing), seed, **options)
