"""The scene of a sensor: body, emitter, ambient light, receivers, and media in contact with its walls."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from solen.errors import DesignError
from solen.geometry import Body, Face
from solen.geometry.body import Pose
from solen.material import Dispersion, Optical
from solen.parts import Light, light_of
from solen.plane import Point
from solen.scene.contact import pad_edges, pad_regions
from solen.scene.finishes import FINISHES
from solen.scene.model import Behaviour, Extrusion, Interface, Region, Scene
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
from solen.scene.surface import Coating, Gaussian, HarveyShack, Lambertian, Layer, Scatter, Surface, Texture
from solen.spec import Design, Wall

AIR = Region("air", 1.0)
BODY = "body"
BEHAVIOURS: dict[str, Behaviour] = {"receiver": "receiver", "mirror": "mirror", "black": "absorbing"}
"""Behaviour of a face, keyed by the first word of its name; all other faces refract."""
CIRCLE_MARGIN = 1.1
"""Radius of the circle from which ambient light comes, divided by the radius of the circle around the sensor."""


def sensor_scene(design: Design, body: Body, material: Optical, rays: int | None = None) -> Scene:
    """Return the scene for a body of the specified material; ``rays`` overrides the ray count of the design.

    A face whose name begins with ``receiver`` belongs to the receiver named by the rest of the name: ``right`` or
    ``left`` for a Y. With ``coupling = "matched"`` the end of each arm is itself the black face of the receiver: all
    light that arrives from inside is detected. With ``"air-gap"`` the end of the arm is a bare face, and the receiver,
    which is as wide as the arm, is ``gap_mm`` in front of it; light that reaches the back of the receiver is absorbed,
    not detected. Parts of walls listed in the design's wall tables have the finish specified there, and a pad of the
    touching medium.

    If a wall is coated, or a film of air separates it from the medium touching it, the emitter has the wavelength of
    the design. With ``dimension = "extruded"`` the entire scene extends over the thickness of the body, and light that
    meets the end of an arm above or below a lower receiver leaves the body there.
    """
    interfaces = [
        *(_interface(face, BODY, design.wall) for face in body.all_faces),
        *(_interface(face, AIR.name, design.wall) for face in body.separate),
        *pad_edges(body, design.wall),
    ]
    light = light_of(design)
    emitter = _emitter(design, light, body.emitter, rays)
    for number, wall in enumerate(design.wall):
        wavelengths_nm = tuple(nm for nm, _ in emitter.spectrum) or (light.wavelength_nm,)
        FINISHES[wall.finish].check_at(f"wall[{number}].finish", wall.finish, wavelengths_nm)
    index = material.dispersion if emitter.spectrum and material.dispersion is not None else material.index
    used = {name for interface in interfaces for name in (interface.left, interface.right)}
    outside = [region for region in pad_regions(design.wall) if region.name in used]
    regions = (AIR, Region(BODY, index, material.absorption_per_mm), *outside)
    emitter = emitter.with_spectrum(_spectrum(emitter.spectrum or ((light.wavelength_nm, 1.0),), regions, interfaces))
    sources = (emitter, *_ambient(design, body.emitter.point, interfaces, rays, emitter.spectrum))
    if design.trace.dimension == "2d":
        return Scene(regions, tuple(interfaces), sources, name=design.name)
    high_mm, extrusion = design.receivers.height_mm, Extrusion(design.body.thickness_mm)
    if high_mm is not None:
        height_mm = (-0.5 * high_mm, 0.5 * high_mm)
        interfaces = [replace(i, height_mm=height_mm) if i.behaviour == "receiver" else i for i in interfaces]
    return Scene(regions, tuple(interfaces), sources, name=design.name, extrusion=extrusion, front=body.front)


def _emitter(design: Design, light: Light, pose: Pose, rays: int | None) -> Source:
    """Return the source of a light; for a fan pattern, a `Fan` or `Chip` with uniformly spaced angles."""
    count = design.emitter.rays if rays is None else rays
    if light.ray_file is not None:
        selected = count if rays is not None or design.emitter.sets("rays") else None
        return RayFile.of(str(light.ray_file), pose.point, pose.axis_deg, selected)
    width_mm = light.width_mm or pose.width_mm
    if light.pattern == "fan" and width_mm == 0.0:
        return Fan(pose.point, pose.axis_deg, light.cone_deg, count, spectrum=light.spectrum)
    if light.pattern == "fan":
        return Chip(pose.point, width_mm, pose.axis_deg, light.cone_deg, count, spectrum=light.spectrum)
    pattern: Pattern = Isotropic()
    if light.pattern == "lambertian":
        pattern = CosinePower(light.exponent)
    elif light.pattern == "table":
        pattern = PatternTable(tuple(angle for angle, _ in light.table), tuple(value for _, value in light.table))
    size = (light.cone_deg, width_mm, light.height_mm, design.emitter.y_mm)
    return Emitter(pose.point, pose.axis_deg, count, pattern, *size, spectrum=light.spectrum)


def _ambient(
    design: Design, emitter: Point, interfaces: Sequence[Interface], rays: int | None, spectrum: tuple[Line, ...]
) -> tuple[Source, ...]:
    """Return ambient light from a circle that encloses all faces and the emitter, with a margin.

    The number of ambient rays is scaled by ``rays`` divided by the ray count of the design's emitter.
    """
    ambient = design.ambient
    if not (ambient.power > 0.0 or ambient.irradiance_per_mm > 0.0):
        return ()
    if design.trace.dimension == "extruded":
        limit = "is modelled only in the plane: in space, light would also enter through the top and bottom"
        raise DesignError("ambient", limit=limit, remedy='set trace.dimension = "2d", or omit the ambient light')
    points = np.vstack([interface.curve.flattened() for interface in interfaces] + [[emitter]])
    low, high = points.min(axis=0), points.max(axis=0)
    x, z = (0.5 * (low + high)).tolist()
    radius_mm = CIRCLE_MARGIN * float(np.max(np.hypot(points[:, 0] - x, points[:, 1] - z)))
    power = ambient.power or ambient.irradiance_per_mm * 2.0 * math.pi * radius_mm
    count = ambient.rays if rays is None else max(1, round(ambient.rays * rays / design.emitter.rays))
    return (Ambient((x, z), radius_mm, count, design.body.thickness_mm, power=power, spectrum=spectrum),)


def _spectrum(spectrum: tuple[Line, ...], regions: tuple[Region, ...], interfaces: list[Interface]) -> tuple[Line, ...]:
    """Return the spectrum if the scene depends on it; otherwise an empty one, which is traced faster."""
    surfaces = [interface.surface for interface in interfaces if interface.surface is not None]
    is_dispersive = any(isinstance(region.index, Dispersion) for region in regions) or any(
        surface.coating is not None or surface.band_nm is not None for surface in surfaces
    )
    return spectrum if is_dispersive else ()


def _interface(face: Face, left: str, walls: tuple[Wall, ...]) -> Interface:
    """Return the interface of a face, with the body or the air on its left."""
    behaviour = BEHAVIOURS.get(face.part, "refracting")
    if behaviour == "receiver":
        return Interface(face.name, face.curve, left, AIR.name, behaviour, face.label)
    if face.wall is None:
        return Interface(face.name, face.curve, left, AIR.name, behaviour)
    wall = walls[face.wall]
    finish = FINISHES[wall.finish]
    surface = finish.surface if wall.has_plugin_finish else _surface(wall)
    treatment = None if surface == Surface() else surface
    return Interface(face.name, face.curve, left, wall.outside, finish.behaviour, surface=treatment)


def _surface(wall: Wall) -> Surface:
    """Return the surface of part of a wall."""
    layers = [Layer(film.index, film.thickness_nm, film.extinction) for film in wall.coating]
    if wall.gap_um is not None:
        layers.append(Layer(1.0, 1e3 * wall.gap_um))
    return Surface(
        reflectance=wall.reflectance,
        coating=Coating(tuple(layers)) if layers else None,
        scatter=_scatter(wall),
        texture=_texture(wall),
    )


def _scatter(wall: Wall) -> Scatter | None:
    if wall.scatter == "lambertian":
        return Lambertian(wall.scatter_share)
    if wall.scatter == "gaussian" and wall.sigma is not None:
        return Gaussian(wall.sigma, wall.scatter_share)
    if wall.scatter == "harvey-shack" and wall.shoulder is not None and wall.slope is not None:
        return HarveyShack(wall.shoulder, wall.slope, wall.scatter_share)
    return None


def _texture(wall: Wall) -> Texture | None:
    if wall.texture_pitch_um is None or wall.texture_amplitude_um is None:
        return None
    return Texture(wall.texture_pitch_um, wall.texture_amplitude_um, wall.texture_direction)
