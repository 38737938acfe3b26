"""Input of the batch tracer: the numbers of sensors from which `solen.trace.batch` computes its tables.

Public names: `batch_input` and `why_not_batched`.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.curve import Bezier, Spline
from solen.errors import DesignError
from solen.geometry import arm_angle_deg
from solen.lens import FlatFace, LensInSpace, OvalLens
from solen.material import Dispersion
from solen.parts import Light
from solen.scene import Interface, Region, Scene
from solen.scene.sources import CosinePower, Fan, Isotropic, Pattern, PatternTable
from solen.sensor.sensor import Sensor
from solen.trace import batch
from solen.trace.tables import compile_scene

PIVOTS = {"stem-base": batch.AT_BASE, "emitter": batch.AT_EMITTER}
LENS_KINDS: tuple[tuple[type, int], ...] = ((FlatFace, batch.FLAT), (OvalLens, batch.WHOLE_OVAL))
NAN = math.nan


def why_not_batched(sensor: Sensor) -> str | None:
    """Return the reason why the batch does not support a sensor; None if it does."""
    design, light = sensor.design, sensor.light
    reasons = (
        (design.body.kind != "y", "the batch supports the Y only"),
        (isinstance(sensor.cut, LensInSpace), "its lens is not a cylinder"),
        (not isinstance(sensor.cut, (FlatFace, OvalLens)) and not _is_spline(sensor), "its lens is not a spline"),
        (design.motion.kind == "bend", "its stem bends"),
        (design.motion.kind == "loaded", "a load deforms its body"),
        (design.motion.join == "smooth", "its lens joins the stem smoothly"),
        (bool(design.wall), "it has wall tables"),
        (design.ambient.power > 0.0 or design.ambient.irradiance_per_mm > 0.0, "it has ambient light"),
        (light.ray_file is not None, "its light comes from a ray file"),
        (len(light.spectrum) > 1 and isinstance(sensor.material.dispersion, Dispersion), "its material is dispersive"),
    )
    return next((reason for applies, reason in reasons if applies), None)


def _is_spline(sensor: Sensor) -> bool:
    return sensor.cut is not None and isinstance(sensor.cut.front, (Bezier, Spline))


def batch_input(sensors: Sequence[Sensor]) -> batch.Sensors:
    """Return the numbers of sensors that are all traced in the plane, or all in space.

    Raises
    ------
    DesignError
        If the batch does not support a sensor, or some are traced in the plane and some in space.
    """
    bodies, lights, pieces, predecessors, patterns = [], [], [np.zeros((0, 12))], [np.zeros(0, np.int64)], []
    first_piece, first_row = 0, 0
    for sensor in sensors:
        if why := why_not_batched(sensor):
            raise DesignError("batch", value=sensor.design.name, limit=f"unsupported: {why}", remedy="use Sensor.power")
        sensor_pieces, sensor_predecessors = _lens_pieces(sensor)
        bodies.append(_body(sensor, first_piece, len(sensor_pieces)))
        light, table = _light(sensor, first_row)
        lights.append(light)
        first_piece, first_row = first_piece + len(sensor_pieces), first_row + len(table)
        pieces.append(sensor_pieces)
        predecessors.append(sensor_predecessors)
        patterns.append(table)
    thickness = [_thickness(sensor) for sensor in sensors]
    if len({value > 0.0 for value in thickness}) > 1:
        raise DesignError(
            "trace.dimension", value="2d and extruded", limit="must be the same for all sensors of a batch"
        )
    return batch.Sensors(
        np.array(bodies),
        np.array(lights),
        np.array(thickness),
        np.vstack(pieces),
        np.concatenate(predecessors),
        np.vstack(patterns),
    )


def _thickness(sensor: Sensor) -> float:
    return sensor.design.body.thickness_mm if sensor.design.trace.dimension == "extruded" else 0.0


def _body(sensor: Sensor, first_piece: int, piece_count: int) -> tuple[float, ...]:
    design, lens = sensor.design, sensor.lens
    body, motion, moves = design.body, design.motion, design.motion.moves
    oval = lens if isinstance(lens, OvalLens) else None
    point = motion.pivot if isinstance(motion.pivot, tuple) else (NAN, NAN)
    height, gap = design.receivers.height_mm, design.receivers.gap_mm
    return batch.Y(
        lens=next((kind for cls, kind in LENS_KINDS if isinstance(lens, cls)), batch.PIECES),
        distance=design.emitter.distance_mm,
        focus=NAN if oval is None else oval.focus_mm,
        half_width=lens.half_width_mm,
        cut_index=NAN if oval is None else oval.design_index,
        depth=lens.depth_mm if piece_count else NAN,
        left_edge=lens.front.start[1] if piece_count else NAN,
        right_edge=lens.front.end[1] if piece_count else NAN,
        refractive_index=sensor.material.index,
        absorption=sensor.material.absorption_per_mm,
        stem_length=body.stem_length_mm,
        stem_curve=body.stem_curve_per_mm,
        arm_length=body.arm_length_mm,
        arm_width=body.arm_width_mm,
        arm_angle=math.radians(arm_angle_deg(design)),
        pivot=batch.AT_POINT if isinstance(motion.pivot, tuple) else PIVOTS[motion.pivot],
        pivot_x=point[0],
        pivot_z=point[1],
        turns_lens="lens" in moves,
        turns_emitter="emitter" in moves,
        turns_receivers="receivers" in moves,
        seam=motion.join == "seam",
        gap=NAN if gap is None else gap,
        receiver_height=math.inf if height is None else height,
        first_piece=first_piece,
        pieces=piece_count,
    )


def _lens_pieces(sensor: Sensor) -> tuple[FloatArray, IntArray]:
    """Return the table rows of the cubics of a lens, and for each row the index of the row whose curve it continues."""
    if isinstance(sensor.lens, (FlatFace, OvalLens)):
        return np.zeros((0, 12)), np.zeros(0, np.int64)
    lens = Interface("lens", sensor.lens.front, "body", "air")
    regions, sources = (Region("air", 1.0), Region("body", 1.0)), (Fan((0.0, 0.0), 0.0, 1.0, 1),)
    tables = compile_scene(Scene(regions, (lens,), sources, open_media=True))
    return np.asarray(tables.shape[:, :12], dtype=float), tables.previous


def _light(sensor: Sensor, first_row: int) -> tuple[tuple[float, ...], FloatArray]:
    light, in_space = sensor.light, sensor.design.trace.dimension == "extruded"
    pattern, half = _pattern(light), 0.5 * math.radians(light.cone_deg)
    table = np.zeros((0, 2))
    exponent = 0.0
    if isinstance(pattern, CosinePower):
        exponent = pattern.exponent
    elif isinstance(pattern, PatternTable):
        exponent, table = -1.0, np.column_stack([np.radians(pattern.angle_deg), pattern.relative])
    is_flat = light.pattern == "fan" or not in_space
    integral, y_mm = _integral(pattern, half, is_flat), sensor.design.emitter.y_mm
    rows = (float(first_row), float(len(table)))
    return batch.Light(half, exponent, integral, light.height_mm, y_mm, *rows, float(is_flat)), table


def _pattern(light: Light) -> Pattern:
    if light.pattern == "lambertian":
        return CosinePower(light.exponent)
    if light.pattern == "table":
        return PatternTable(tuple(angle for angle, _ in light.table), tuple(value for _, value in light.table))
    return Isotropic()


@lru_cache(maxsize=256)
def _integral(pattern: Pattern, half: float, is_flat: bool) -> float:
    """Return the integral of the intensity over angles in the plane, or over directions in space."""
    return pattern.plane_angle(half) if is_flat else pattern.space_integral_sr(half)
