"""Drawing of a sensor at an angle, in its plane: outline, emitter, rays, and handles for dragging.

The drawn rays are always in the plane: they show the paths of the light and are not used for powers. `dragged` returns
the values of the design that change if a handle is dragged.

Public names: `in_plane`, `picture`, `Picture` and `dragged`.
"""

from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.geometry import Body
from solen.plane import Point, Rigid
from solen.results import Result
from solen.sensor.handles import handles_of
from solen.sensor.sensor import NO_SHAPE_KEYS, Sensor
from solen.spec import with_values
from solen.trace import Limits, Trace, trace
from solen.trace.result import DETECTED, FATES, GOES_ON, TRUNCATED

DEFAULT_RAYS, MAX_RAYS = 200, 5000
MIN_POWER = 0.01
"""Smallest power of a drawn branch, as a fraction of its ray's launched power."""
CHORD_MM = 2e-3
"""Largest distance between drawn and exact outlines."""


class Picture(Result):
    """Drawing of a sensor at an angle, in its plane.

    Attributes
    ----------
    angle_deg
        Angle, or other value driven by the motion.
    faces
        Name of each face, and its number of points.
    outline
        Points (N, 2), x and z in mm, of all faces in order.
    emitter
        Ends (2, 2) of the chip, which are equal for a point.
    ends
        Possible ends of a ray: names of receivers, then ``escaped``, ``absorbed`` and ``truncated``.
    rays
        Segments (M, 6): start x, z, end x, z in mm, power at the start relative to the ray's launched power, and index
        of the ray's end in ``ends``.
    handles
        Points that can be dragged, keyed by name.
    """

    angle_deg: float
    faces: tuple[tuple[str, int], ...]
    outline: FloatArray
    emitter: FloatArray
    ends: tuple[str, ...]
    rays: FloatArray
    handles: dict[str, Point]


def in_plane(sensor: Sensor) -> Sensor:
    """Return the sensor with rays in the plane; a lens that is not a cylinder is replaced by the oval."""
    if sensor.design.trace.dimension == "2d":
        return sensor
    oval = NO_SHAPE_KEYS | {"lens.shape": "cartesian-oval"} if sensor.is_sampled else {}
    flat: dict[str, Any] = {"trace.dimension": "2d", "receivers.height_mm": None, "emitter.y_mm": 0.0}
    return Sensor.of(with_values(sensor.design, flat | oval))


def picture(sensor: Sensor, angle_deg: float = 0.0, rays: int = DEFAULT_RAYS, *, split: bool = False) -> Picture:
    """Return the drawing of a sensor at an angle.

    Parameters
    ----------
    sensor
        The sensor, which is traced as by `in_plane`.
    angle_deg
        Angle, or other value driven by the motion.
    rays
        Number of rays that start at the emitter.
    split
        Whether to draw both branches at each face, down to a hundredth of the power, rather than unsplit rays.

    Raises
    ------
    DesignError
        If the body cannot be built at this angle.
    """
    flat = in_plane(sensor)
    body = flat.body(angle_deg)
    scene = flat.scene(angle_deg, rays)
    traced = trace(scene, "power" if split else "count", Limits(min_weight=MIN_POWER), segments=True, threads=1)
    receivers = [interface.receiver for interface in scene.interfaces]
    names = tuple(dict.fromkeys(name for name in receivers if name))
    faces = [(face.name, face.curve.flattened(CHORD_MM)) for face in (*body.all_faces, *body.separate)]
    return Picture(
        angle_deg=angle_deg,
        faces=tuple((name, len(points)) for name, points in faces),
        outline=np.vstack([points for _, points in faces]),
        emitter=_chip(body, flat.light.width_mm or body.emitter.width_mm),
        ends=(*names, *FATES[DETECTED + 1 :]),
        rays=_segments(traced, [names.index(name) if name else -1 for name in receivers], len(names), rays),
        handles={name: handle.point for name, handle in handles_of(sensor, body, angle_deg).items()},
    )


def dragged(sensor: Sensor, handle: str, to: Point, angle_deg: float = 0.0) -> tuple[float, dict[str, Any]]:
    """Return the angle, and the values of the design by dotted key, that move a handle to a point.

    Raises
    ------
    DesignError
        If the sensor has no such handle.
    """
    handles = handles_of(sensor, sensor.body(angle_deg), angle_deg)
    if handle not in handles:
        names = f"the handles are {', '.join(handles)}" if handles else "this sensor has no handles"
        raise DesignError("handle", value=handle, limit=f"does not exist: {names}")
    handled = handles[handle]
    return angle_deg if handled.angle is None else handled.angle(to), handled.values(to)


def _chip(body: Body, width_mm: float) -> FloatArray:
    half_chip = Rigid.about((0.0, 0.0), body.emitter.axis_deg).vector((0.5 * width_mm, 0.0))
    centre = np.array(body.emitter.point)
    return np.stack([centre - half_chip, centre + half_chip])


def _segments(traced: Trace, receiver: list[int], receivers: int, rays: int) -> FloatArray:
    """Return the segments of a trace, each with the end of its ray; escaping segments have a length of 1 mm."""
    segments = traced.segments
    if segments is None or len(segments) == 0:
        return np.zeros((0, 6))
    first = np.flatnonzero((np.diff(segments["ray"], prepend=-1) != 0) | (np.diff(segments["branch"], prepend=-1) != 0))
    last = np.append(first[1:], len(segments)) - 1
    receiver_index = np.array([*receiver, -1])[segments["interface"][last]]
    fate = np.where(segments["fate"][last] == GOES_ON, TRUNCATED, segments["fate"][last])
    ray_end = np.where(fate == DETECTED, receiver_index, fate - DETECTED - 1 + receivers)
    length = np.where(np.isfinite(segments["length_mm"]), segments["length_mm"], 1.0)
    start = np.column_stack([segments["x_mm"], segments["z_mm"]])
    segment_end = start + length[:, None] * np.column_stack([segments["dx"], segments["dz"]])
    power = (segments["power_s"] + segments["power_p"]) * rays
    return np.column_stack([start, segment_end, power, np.repeat(ray_end, last - first + 1)])
