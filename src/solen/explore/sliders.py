"""Responses and pictures of a design for a few values of its numbers, computed in advance for a page with sliders."""

import math
from collections.abc import Sequence
from dataclasses import field

import numpy as np
from pydantic import Field

from solen.arrays import FloatArray
from solen.errors import SolenError, SpecError
from solen.explore.axes import Axis, axis, check_axes, grid
from solen.explore.live import GOAL, Curve, batched_response, curve_of, largest_u, misleading
from solen.progress import Progress
from solen.results import HIDDEN, Result, reported
from solen.sensor import Picture, Sensor, in_plane, picture, why_not_batched
from solen.sensor.practice import MAX_ANGLES, subsample
from solen.spec import Design
from solen.spec.strict import Options

MAX_AXES, MAX_POINTS = 3, 125
FIRST_RAYS, MORE_RAYS = 2**14, 2**17
"""Numbers of rays per angle: for the first trace, and for a second one if the first does not reach `GOAL`."""


class SlidersOptions(Options):
    """Sliders of a page."""

    over: tuple[str, ...] = ()
    """A slider with its values, lens.focus_mm=15:25:5 or a list; repeatable, three at most. Default: the emitter's
    decentre and the focus.
    """
    drawn_rays: int = Field(60, ge=1, le=500)
    """Number of rays drawn at each angle."""


class Slid(Result):
    """A point of the sliders.

    Attributes
    ----------
    curve
        Its response and its merits.
    misleading
        Description of the plane's error in words.
    pictures
        The sensor at each angle of the response.
    """

    curve: Curve
    misleading: str
    pictures: tuple[Picture, ...] = field(metadata=HIDDEN)


class Sliders(Result):
    """A design over a grid of values.

    Attributes
    ----------
    name
        Name of the design.
    keys, values
        Key of each slider, and its values.
    in_space
        Whether responses were traced in space.
    angle_deg
        (A,) angles of every response.
    points
        Points of the grid, with the last slider varying fastest; None if the sensor cannot be built.
    simulated
        Always true, since nothing was measured.
    """

    name: str
    keys: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]
    in_space: bool
    angle_deg: FloatArray
    points: tuple[Slid | None, ...] = field(metadata=HIDDEN)
    simulated: bool = True

    @reported
    def contrast(self) -> FloatArray:
        """(points, A) contrast at each angle; NaN if the sensor cannot be built."""
        return self._rows("contrast")

    @reported
    def u_contrast(self) -> FloatArray:
        """(points, A) standard uncertainty of the contrast."""
        return self._rows("u_contrast")

    @property
    def u_largest(self) -> float:
        """Largest uncertainty of a contrast."""
        return float(np.nanmax(self.u_contrast))

    def _rows(self, name: str) -> FloatArray:
        none = np.full(len(self.angle_deg), math.nan)
        return np.array([none if point is None else getattr(point.curve.response, name) for point in self.points])


def sliders(design: Design, options: SlidersOptions = SlidersOptions(), progress: Progress | None = None) -> Sliders:
    """Compute responses and pictures of a design for all combinations of the sliders' values.

    Raises
    ------
    SpecError
        If a slider is malformed, there are too many, or values are not numbers.
    DesignError
        If the design itself has no response.
    """
    axes = _axes(design, options)
    Sensor.of(design).check_pair()
    places = list(grid(axes))
    found: list[Slid | None] = []
    for done, values in enumerate(places):

        def share(of_point: float, done: int = done) -> None:
            if progress is not None:
                progress((done + of_point) / len(places))

        share(0.0)
        try:
            found.append(_point(Sensor.of(design.set(values)), options.drawn_rays, share))
        except SolenError:
            found.append(None)
        share(1.0)
    if not any(found):
        raise SpecError(
            "--over", limit="none of these sensors can be built", remedy="use values closer to those of the design"
        )
    return Sliders(
        name=design.name,
        keys=tuple(one.key for one in axes),
        values=tuple(one.values for one in axes),
        in_space=design.trace.dimension == "extruded",
        angle_deg=np.array(subsample(design.motion.values(), MAX_ANGLES)),
        points=tuple(found),
    )


def _axes(design: Design, options: SlidersOptions) -> list[Axis]:
    axes = [axis(text, design) for text in options.over] or _usual(design)
    check_axes(axes, None)
    if len(axes) > MAX_AXES:
        raise SpecError("--over", value=len(axes), limit=f"at most {MAX_AXES} sliders", remedy="omit some")
    points = math.prod(len(one.values) for one in axes)
    if points > MAX_POINTS:
        limit = f"a page has at most {MAX_POINTS} points"
        raise SpecError("--over", value=points, limit=limit, remedy="use fewer values")
    for one in axes:
        if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in one.values):
            raise SpecError(
                f"--over {one.key}",
                limit="a slider requires a key with numerical values",
                remedy="name a design parameter",
            )
    return axes


def _usual(design: Design) -> list[Axis]:
    offset, focus = design.emitter.offset_mm, design.lens.focus_mm
    return [
        Axis("emitter.offset_mm", tuple(round(offset + by, 6) for by in (-0.1, -0.05, 0.0, 0.05, 0.1))),
        Axis("lens.focus_mm", tuple(round(focus * by, 6) for by in (0.8, 0.9, 1.0, 1.1, 1.2))),
    ]


def _point(sensor: Sensor, rays: int, progress: Progress) -> Slid:
    angles = subsample(sensor.design.motion.values(), MAX_ANGLES)
    curve, flat = _curve(sensor, angles, progress), in_plane(sensor)
    words = ""
    if curve.in_space and not why_not_batched(flat):
        words = misleading(batched_response(flat, angles, FIRST_RAYS), curve.response)
    return Slid(curve, words, tuple(picture(sensor, angle, rays) for angle in angles))


def _curve(sensor: Sensor, angles: Sequence[float], progress: Progress) -> Curve:
    if why_not_batched(sensor):
        return curve_of(sensor, sensor.power(angles, progress, tolerance=GOAL), None, finished=True)
    for rays in (FIRST_RAYS, MORE_RAYS):
        response = batched_response(sensor, angles, rays)
        if largest_u(response) <= GOAL:
            break
    return curve_of(sensor, response, rays, finished=True)
