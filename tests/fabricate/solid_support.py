"""Designs to be made, and the oval found by bisection, from which solen's own solution takes nothing."""

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
    """The shipped 860 nm design with other values, given by keys in which ``__`` stands for the dot."""
    return with_values(loads(template("paper-860")), {key.replace("__", "."): value for key, value in values.items()})


def seated(**values: Any) -> Design:
    """The same with pockets and slots."""
    return with_values(design(**values), SEATED)


def body_of(chosen: Design) -> Body:
    return Sensor.of(chosen).body()


def part_of(chosen: Design) -> Part:
    return sensor_part(chosen, body_of(chosen))


def oval_z(x: NDArray[np.float64], n: float = 1.44) -> NDArray[np.float64]:
    """Profile of the lens at any x within its half width."""
    low, high = np.zeros_like(x), np.full_like(x, 3.0)
    for _ in range(60):
        z = (low + high) / 2
        rest = np.hypot(x, z + S) + n * np.hypot(x, F - z) - (S + n * F)
        low, high = np.where(rest > 0, z, low), np.where(rest > 0, high, z)
    return (low + high) / 2


def off_the_oval_mm(points: NDArray[np.float64], n: float = 1.44) -> float:
    """Largest distance of points (N, 2) from the oval: that along z is never less."""
    return float(np.abs(points[:, 1] - oval_z(points[:, 0], n)).max())
