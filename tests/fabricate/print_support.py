"""Processes and parts for tests of the print model, small enough for sums over all pixels."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.curve import Arc
from solen.fabricate.process import Process, Settings, Target, default_process, process_text


def settings(**values: Any) -> Settings:
    """Return the values of the default process with some replaced, validated like those of a file."""
    return Settings(**(default_process().process.model_dump() | values))


def process(**values: Any) -> Process:
    """Return a process with such values and no uncertainties."""
    return Process(name="test", process=settings(**values))


def process_file(folder: Path, **values: float) -> Path:
    """Write the file of a process without uncertainties, for which a single print is computed."""
    path = folder / "process.toml"
    exact = default_process().model_copy(update={"uncertainty": {}, "process": settings(**values)})
    path.write_text(process_text(exact), encoding="utf-8")
    return path


def round_target(radius_mm: float, points: int = 90) -> Target:
    """Return a target whose wall is a circle about the origin, with material inside."""
    return Target.of(Arc((0.0, 0.0), radius_mm, 0.0, 359.9), points)


def ring(radius_mm: float, points: int = 4000) -> NDArray[np.float64]:
    """Return a counter-clockwise polygon with the area of a circle about the origin."""
    angle = np.linspace(0.0, 2 * np.pi, points, endpoint=False)
    scale = np.sqrt(2 * np.pi / points / np.sin(2 * np.pi / points))
    return np.asarray(radius_mm * scale * np.column_stack([np.cos(angle), np.sin(angle)]))


def box(x: tuple[float, float], z: tuple[float, float]) -> NDArray[np.float64]:
    """Return the corners of a rectangle, counter-clockwise."""
    return np.array([(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])])
