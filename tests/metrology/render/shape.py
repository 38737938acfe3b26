"""The part under the microscope: its outline in mm, printing errors, and its pose in the image."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.geometry import Body
from solen.sensor import Sensor
from solen.spec import Design, loads, template, with_values

DESIGNS = ("solen-860", "solen-500", "solen-450")
FINE_MM = 1e-6


def shipped(name: str = "solen-860", **values: Any) -> Design:
    """Return a shipped design with other values; in their keys, ``__`` replaces the dot."""
    return with_values(loads(template(name)), {key.replace("__", "."): value for key, value in values.items()})


def body_of(design: Design) -> Body:
    return Sensor.of(design).body()


def front_mm(design: Design) -> FloatArray:
    """Return points (N, 2) of the lens's front in mm, from left to right."""
    return body_of(design).face("lens").curve.flattened(FINE_MM)


def outline_mm(design: Design, change: Callable[[FloatArray], FloatArray] | None = None) -> FloatArray:
    """Return the closed outline (N, 2) of the part in mm; ``change`` moves points of the lens's front."""
    pieces = []
    for face in body_of(design).faces:
        points = face.curve.flattened(FINE_MM)
        pieces.append((change(points) if change and face.name == "lens" else points)[:-1])
    return np.vstack(pieces)


def bump(at_mm: float, height_um: float, width_mm: float) -> Callable[[FloatArray], FloatArray]:
    """Return a function that adds a Gaussian bump to the front; positive heights add material."""

    def changed(points: FloatArray) -> FloatArray:
        tangent = np.gradient(points, axis=0)
        tangent /= np.hypot(*tangent.T)[:, None]
        outward = np.column_stack([tangent[:, 1], -tangent[:, 0]])  # from left to right, the material is on the left
        rise_mm = 1e-3 * height_um * np.exp(-0.5 * ((points[:, 0] - at_mm) / width_mm) ** 2)
        return np.asarray(points + rise_mm[:, None] * outward)

    return changed


def grown(points: FloatArray, by_um: float) -> FloatArray:
    """Return a counter-clockwise closed outline, displaced outwards with mitred corners."""
    step = np.roll(points, -1, axis=0) - points
    normal = np.column_stack([step[:, 1], -step[:, 0]]) / np.hypot(*step.T)[:, None]
    before = np.roll(normal, 1, axis=0)
    mitre = (normal + before) / (1.0 + np.sum(normal * before, axis=1))[:, None]
    return np.asarray(points + 1e-3 * by_um * mitre)


@dataclass(frozen=True)
class Placing:
    """Transformation from mm of the design (x right, z up) to px of the image (u right, v down).

    ``origin_px`` is the position of the lens vertex; ``angle_deg`` rotates the part counter-clockwise as seen.
    ``tilt_deg`` tilts it about its x axis away from the camera at the distance ``working_mm``, which shortens it and
    adds perspective. ``magnification`` enlarges this level of the part about ``middle_mm``, relative to the scale.
    """

    um_per_px: float
    origin_px: tuple[float, float]
    angle_deg: float = 0.0
    magnification: float = 1.0
    middle_mm: tuple[float, float] = (0.0, 1.0)
    tilt_deg: float = 0.0
    working_mm: float = 60.0

    def px(self, points_mm: FloatArray) -> FloatArray:
        """Return the points (N, 2) in the image."""
        middle = np.asarray(self.middle_mm)
        x, z = (middle + self.magnification * (points_mm - middle)).T
        tilt = math.radians(self.tilt_deg)
        perspective = 1.0 / (1.0 + z * math.sin(tilt) / self.working_mm)
        x, z = x * perspective, z * math.cos(tilt) * perspective
        rotation = math.radians(self.angle_deg)
        right, up = x * math.cos(rotation) - z * math.sin(rotation), x * math.sin(rotation) + z * math.cos(rotation)
        return np.asarray(np.column_stack([right, -up]) * 1e3 / self.um_per_px + np.asarray(self.origin_px))

    def mm(self, points_px: FloatArray) -> FloatArray:
        """Return the points (N, 2) of the design, at magnification 1 and without tilt."""
        right, down = ((points_px - np.asarray(self.origin_px)) * self.um_per_px * 1e-3).T
        rotation = math.radians(self.angle_deg)
        return np.column_stack(
            [
                right * math.cos(rotation) - down * math.sin(rotation),
                -right * math.sin(rotation) - down * math.cos(rotation),
            ]
        )

    def moved(self, right_px: float, down_px: float) -> "Placing":
        """Return the transformation with a shift in the image."""
        u, v = self.origin_px
        return replace(self, origin_px=(u + right_px, v + down_px))

    def scaled(self, factor: float) -> "Placing":
        """Return the transformation at another magnification."""
        return replace(self, magnification=self.magnification * factor)
