"""Processes and parts for tests of the print model, small enough for sums over every pixel."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.curve import Arc
from solen.fabricate.process import Process, Settings, Target, default_process


def settings(**values: Any) -> Settings:
    """The default process's values with others set, checked as a file's are."""
    return Settings(**(default_process().process.model_dump() | values))


def process(**values: Any) -> Process:
    """A process of such values that knows no uncertainty."""
    return Process(name="test", process=settings(**values))


def round_target(radius_mm: float, points: int = 90) -> Target:
    """Whole circle about the origin, material inside."""
    return Target.of(Arc((0.0, 0.0), radius_mm, 0.0, 359.9), points)


def ring(radius_mm: float, points: int = 4000) -> NDArray[np.float64]:
    """Polygon of a circle, counter-clockwise, of its area."""
    angle = np.linspace(0.0, 2 * np.pi, points, endpoint=False)
    swell = np.sqrt(2 * np.pi / points / np.sin(2 * np.pi / points))
    return np.asarray(radius_mm * swell * np.column_stack([np.cos(angle), np.sin(angle)]))


def box(x: tuple[float, float], z: tuple[float, float]) -> NDArray[np.float64]:
    """Rectangle, counter-clockwise."""
    return np.array([(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])])
