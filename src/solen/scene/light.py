"""The light of a sensor: its emitter as a source, and light from around."""

import math

import numpy as np

from solen.geometry import Body
from solen.geometry.body import Pose
from solen.parts import Light
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


def ambient_of(design: Design, body: Body, spectrum: tuple[Line, ...]) -> tuple[Source, ...]:
    """Ambient light through a circle that holds the body and the emitter, with some room."""
    stated = design.ambient
    if not (stated.power > 0.0 or stated.irradiance_per_mm > 0.0):
        return ()
    points = np.vstack([body.outline(), [body.emitter.point]])
    low, high = points.min(axis=0), points.max(axis=0)
    x, z = (0.5 * (low + high)).tolist()
    radius_mm = ROOM * float(np.max(np.hypot(points[:, 0] - x, points[:, 1] - z)))
    power = stated.power or stated.irradiance_per_mm * 2.0 * math.pi * radius_mm
    return (Ambient((x, z), radius_mm, stated.rays, design.body.thickness_mm, power, spectrum=spectrum),)
