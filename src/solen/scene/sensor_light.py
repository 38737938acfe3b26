"""The light of a sensor: its emitter as a source, and light from around."""

import math
from collections.abc import Sequence

import numpy as np

from solen.errors import DesignError
from solen.geometry.body import Pose
from solen.parts import Light
from solen.plane import Point
from solen.scene.model import Interface
from solen.scene.sources import (
    Ambient,
    Chip,
    CosinePower,
    Emitter,
    Fan,
    Isotropic,
    Line,
    Pattern,
    PatternTable,
    RayFile,
    Source,
)
from solen.spec import Design

ROOM = 1.1
"""Radius of the circle that ambient light comes through, over that of the circle round the sensor."""


def emitter_of(design: Design, light: Light, pose: Pose, rays: int | None) -> Source:
    """Source of a light: a fan or a chip where the paper's evenly spaced angles will do."""
    stated = design.emitter.rays if rays is None else rays
    if light.ray_file is not None:
        some = stated if rays is not None or design.emitter.states("rays") else None
        return RayFile.of(str(light.ray_file), pose.point, pose.axis_deg, some)
    width_mm = light.width_mm or pose.width_mm
    if light.pattern == "fan" and width_mm == 0.0:
        return Fan(pose.point, pose.axis_deg, light.cone_deg, stated, spectrum=light.spectrum)
    if light.pattern == "fan":
        return Chip(pose.point, width_mm, pose.axis_deg, light.cone_deg, stated, spectrum=light.spectrum)
    pattern: Pattern = Isotropic()
    if light.pattern == "lambertian":
        pattern = CosinePower(light.exponent)
    elif light.pattern == "table":
        pattern = PatternTable(tuple(angle for angle, _ in light.table), tuple(value for _, value in light.table))
    size = (light.cone_deg, width_mm, light.height_mm)
    return Emitter(pose.point, pose.axis_deg, stated, pattern, *size, spectrum=light.spectrum)


def ambient_of(
    design: Design, emitter: Point, interfaces: Sequence[Interface], rays: int | None, spectrum: tuple[Line, ...]
) -> tuple[Source, ...]:
    """Ambient light through a circle that holds all faces and the emitter, with some room.

    Where more ``rays`` are asked for than the design has for its emitter, there are as many times more of these.
    """
    stated = design.ambient
    if not (stated.power > 0.0 or stated.irradiance_per_mm > 0.0):
        return ()
    if design.trace.dimension == "extruded":
        limit = "is light in the plane: in space it would also come in through top and bottom"
        raise DesignError("ambient", limit=limit, remedy='set trace.dimension = "2d", or leave the ambient light out')
    points = np.vstack([interface.curve.flattened() for interface in interfaces] + [[emitter]])
    low, high = points.min(axis=0), points.max(axis=0)
    x, z = (0.5 * (low + high)).tolist()
    radius_mm = ROOM * float(np.max(np.hypot(points[:, 0] - x, points[:, 1] - z)))
    power = stated.power or stated.irradiance_per_mm * 2.0 * math.pi * radius_mm
    many = stated.rays if rays is None else max(1, round(stated.rays * rays / design.emitter.rays))
    return (Ambient((x, z), radius_mm, many, design.body.thickness_mm, power=power, spectrum=spectrum),)
