"""The scene of a sensor: its body in air, the emitter before it, a receiver on each arm."""

import math

import numpy as np

from solen.curve import Curve, Segment
from solen.geometry import Body, Face
from solen.geometry.body import Pose
from solen.material import Dispersion, Optical
from solen.parts import Light, light_of
from solen.scene.model import Interface, Region, Scene
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

AIR = Region("air", 1.0)
BODY = "body"
ROOM = 1.1
"""Radius of the circle that ambient light comes through, over that of the circle round the sensor."""


def sensor_scene(design: Design, body: Body, material: Optical, rays: int | None = None) -> Scene:
    """Scene of a body of the given material; ``rays`` overrides the design's number.

    Receivers are called ``right`` and ``left``. With ``coupling = "matched"`` an arm's end is itself the receiver's
    black face: all that arrives from inside is detected. With ``"air-gap"`` the arm's end is a bare face and the
    receiver, as wide as the arm, stands ``gap_mm`` before it; light reaching its back is absorbed, not detected.
    """
    interfaces: list[Interface] = []
    for face in body.faces:
        interfaces.extend(_interfaces(design, face))
    light = light_of(design)
    emitter = _emitter(design, light, body.emitter, rays)
    index = material.dispersion if emitter.spectrum and material.dispersion is not None else material.index
    regions = (AIR, Region(BODY, index, material.absorption_per_mm))
    emitter = emitter.with_spectrum(_spectrum(emitter.spectrum or ((light.wavelength_nm, 1.0),), regions, interfaces))
    sources = (emitter, *_ambient(design, body, emitter.spectrum))
    return Scene(regions, tuple(interfaces), sources, name=design.name)


def _spectrum(spectrum: tuple[Line, ...], regions: tuple[Region, ...], interfaces: list[Interface]) -> tuple[Line, ...]:
    """The spectrum where anything in the scene depends on it, else none: one colour traces faster."""
    surfaces = [interface.surface for interface in interfaces if interface.surface is not None]
    matters = any(isinstance(region.index, Dispersion) for region in regions) or any(
        surface.coating is not None or surface.band_nm is not None for surface in surfaces
    )
    return spectrum if matters else ()


def _emitter(design: Design, light: Light, pose: Pose, rays: int | None) -> Source:
    """Source of a light: a fan or a chip where the paper's evenly spaced angles will do."""
    stated = design.emitter.rays if rays is None else rays
    if light.ray_file is not None:
        some = stated if rays is not None or design.emitter.states("rays") else None
        return RayFile.of(str(light.ray_file), pose.point, pose.axis_deg, some)
    if light.pattern == "fan" and light.width_mm == 0.0:
        return Fan(pose.point, pose.axis_deg, light.cone_deg, stated, spectrum=light.spectrum)
    if light.pattern == "fan":
        return Chip(pose.point, light.width_mm, pose.axis_deg, light.cone_deg, stated, spectrum=light.spectrum)
    pattern: Pattern = Isotropic()
    if light.pattern == "lambertian":
        pattern = CosinePower(light.exponent)
    elif light.pattern == "table":
        pattern = PatternTable(tuple(angle for angle, _ in light.table), tuple(value for _, value in light.table))
    size = (light.cone_deg, light.width_mm, light.height_mm)
    return Emitter(pose.point, pose.axis_deg, stated, pattern, *size, spectrum=light.spectrum)


def _ambient(design: Design, body: Body, spectrum: tuple[Line, ...]) -> tuple[Source, ...]:
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


def _interfaces(design: Design, face: Face) -> list[Interface]:
    part, _, side = face.name.partition("-")
    if part != "receiver":
        return [Interface(face.name, face.curve, BODY, AIR.name)]
    if design.receivers.coupling == "matched":
        return [Interface(face.name, face.curve, BODY, AIR.name, "receiver", side)]
    return [
        Interface(f"end-{side}", face.curve, BODY, AIR.name),
        Interface(face.name, _before(face.curve, design.receivers.gap_mm or 0.0), AIR.name, AIR.name, "receiver", side),
    ]


def _before(end: Curve, gap_mm: float) -> Segment:
    """The receiver's face ``gap_mm`` outside an arm's end, its left towards the arm."""
    nx, nz = end.normal_at(end.start)

    def outside(point: tuple[float, float]) -> tuple[float, float]:
        return (point[0] - gap_mm * nx, point[1] - gap_mm * nz)

    return Segment(outside(end.start), outside(end.end))
