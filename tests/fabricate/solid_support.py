"""Designs of parts, and the oval of the lens by bisection, independent of the solution in solen."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.fabricate import Part, sensor_part
from solen.geometry import Body
from solen.sensor import Sensor
from solen.spec import Design, loads, template, with_values

S, F, HALF = 1.0, 20.0, 2.0
SEATED = {"fabricate.pockets": True, "fabricate.slots": ["receivers", "emitter"]}


def design(**values: Any) -> Design:
    """Return the shipped 860 nm design with values replaced; in their keys, ``__`` stands for a dot."""
    return with_values(loads(template("paper-860")), {key.replace("__", "."): value for key, value in values.items()})


def seated(**values: Any) -> Design:
    """Return such a design with pockets and slots."""
    return with_values(design(**values), SEATED)


def body_of(sensor_design: Design) -> Body:
    return Sensor.of(sensor_design).body()


def part_of(sensor_design: Design) -> Part:
    return sensor_part(sensor_design, body_of(sensor_design))


def oval_z(x: NDArray[np.float64], n: float = 1.44) -> NDArray[np.float64]:
    """Return the profile of the lens at any x within its half width."""
    low, high = np.zeros_like(x), np.full_like(x, 3.0)
    for _ in range(60):
        z = (low + high) / 2
        difference = np.hypot(x, z + S) + n * np.hypot(x, F - z) - (S + n * F)
        low, high = np.where(difference > 0, z, low), np.where(difference > 0, high, z)
    return (low + high) / 2


def oval_distance_mm(points: NDArray[np.float64], n: float = 1.44) -> float:
    """Return the largest distance of points (N, 2) from the oval along z, an upper bound of that along the normal."""
    return float(np.abs(points[:, 1] - oval_z(points[:, 0], n)).max())
