"""Responses and pictures of a design for a few values of its parameters, computed in advance for a page of sliders."""

import math
from collections.abc import Sequence
from dataclasses import field

import numpy as np
from pydantic import Field

from solen.arrays import FloatArray
from solen.errors import SolenError, SpecError
from solen.explore.axes import Axis, axis, check_axes, grid
from solen.explore.live import GOAL, Curve, batched_response, curve_of, largest_u, planar_model_error
from solen.progress import Progress
from solen.results import HIDDEN, Result, reported
from solen.sensor import Picture, Sensor, in_plane, picture, why_not_batched
from solen.sensor.practice import MAX_ANGLES, subsample
from solen.spec import Design
from solen.spec.strict import Options

MAX_AXES, MAX_POINTS = 3, 125
FIRST_RAYS, MORE_RAYS = 2**14, 2**17
"""Numbers of rays per angle: of the first trace, and of a second one if the first does not reach `GOAL`."""


class SlidersOptions(Options):
    """Sliders of a page."""

    over: tuple[str, ...] = ()
    """Key and values of a slider: lens.focus_mm=15:25:5 or a list; repeatable, at most three. Default: the decentre of
    the emitter and the focus.
    """
    drawn_rays: int = Field(60, ge=1, le=500)
    """Number of rays drawn at each angle."""


class SlidersPoint(Result):
    """The design for one combination of the sliders' values.

    Attributes
    ----------
    curve
        Its response and its merits.
    planar_model_error
        Sentence on the error of the model in the plane; empty if there is none.
    pictures
        The sensor at each angle of the response.
    """

    curve: Curve
    planar_model_error: str
    pictures: tuple[Picture, ...] = field(metadata=HIDDEN)


class Sliders(Result):
    """A design on a grid of values.

    Attributes
    ----------
    name
        Name of the design.
    keys, values
        Key of each slider, and its values.
    in_space
        Whether the responses were traced in space (3-D).
    angle_deg
        (A,) angles of every response.
    points
        Points of the grid, where the last slider varies fastest; None if the sensor cannot be built.
    simulated
        Always true, since nothing was measured.
    """

    name: str
    keys: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]
    in_space: bool
    angle_deg: FloatArray
    points: tuple[SlidersPoint | None, ...] = field(metadata=HIDDEN)
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
        """Largest uncertainty of the contrast."""
        return float(np.nanmax(self.u_contrast))

    def _rows(self, name: str) -> FloatArray:
        missing = np.full(len(self.angle_deg), math.nan)
        return np.array([missing if point is None else getattr(point.curve.response, name) for point in self.points])


def sliders(design: Design, options: SlidersOptions = SlidersOptions(), progress: Progress | None = None) -> Sliders:
    """Compute responses and pictures of a design for all combinations of the sliders' values.

    Raises
    ------
    SpecError
        If a slider is malformed, there are too many of them, or values are not numbers.
    DesignError
        If the design itself has no response.
    """
    axes = _axes(design, options)
    Sensor.of(design).check_pair()
    combinations = list(grid(axes))
    points: list[SlidersPoint | None] = []
    for done, values in enumerate(combinations):

        def report(fraction: float, done: int = done) -> None:
            if progress is not None:
                progress((done + fraction) / len(combinations))

        report(0.0)
        try:
            points.append(_point(Sensor.of(design.set(values)), options.drawn_rays, report))
        except SolenError:
            points.append(None)
        report(1.0)
    if not any(points):
        raise SpecError(
            "--over",
            limit="no sensor can be built with any combination of values",
            remedy="use values closer to those of the design",
        )
    return Sliders(
        name=design.name,
        keys=tuple(axis.key for axis in axes),
        values=tuple(axis.values for axis in axes),
        in_space=design.trace.dimension == "extruded",
        angle_deg=np.array(subsample(design.motion.values(), MAX_ANGLES)),
        points=tuple(points),
    )


def _axes(design: Design, options: SlidersOptions) -> list[Axis]:
    axes = [axis(text, design) for text in options.over] or _default_axes(design)
    check_axes(axes, None)
    if len(axes) > MAX_AXES:
        limit = f"a page has at most {MAX_AXES} sliders"
        raise SpecError("--over", value=f"{len(axes)} sliders", limit=limit, remedy=f"use at most {MAX_AXES} --over")
    points = math.prod(len(slider.values) for slider in axes)
    if points > MAX_POINTS:
        limit = f"a page has at most {MAX_POINTS} combinations"
        raise SpecError("--over", value=f"{points} combinations", limit=limit, remedy="use fewer values")
    for slider in axes:
        if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in slider.values):
            limit = "a slider requires a key with numerical values"
            raise SpecError(f"--over {slider.key}", limit=limit, remedy="specify another design parameter")
    return axes


def _default_axes(design: Design) -> list[Axis]:
    offset, focus = design.emitter.offset_mm, design.lens.focus_mm
    return [
        Axis("emitter.offset_mm", tuple(round(offset + step, 6) for step in (-0.1, -0.05, 0.0, 0.05, 0.1))),
        Axis("lens.focus_mm", tuple(round(focus * factor, 6) for factor in (0.8, 0.9, 1.0, 1.1, 1.2))),
    ]


def _point(sensor: Sensor, rays: int, progress: Progress) -> SlidersPoint:
    angles = subsample(sensor.design.motion.values(), MAX_ANGLES)
    curve, planar = _curve(sensor, angles, progress), in_plane(sensor)
    error = ""
    if curve.in_space and not why_not_batched(planar):
        error = planar_model_error(batched_response(planar, angles, FIRST_RAYS), curve.response)
    return SlidersPoint(curve, error, tuple(picture(sensor, angle, rays) for angle in angles))


def _curve(sensor: Sensor, angles: Sequence[float], progress: Progress) -> Curve:
    if why_not_batched(sensor):
        return curve_of(sensor, sensor.power(angles, progress, tolerance=GOAL), None, finished=True)
    for rays in (FIRST_RAYS, MORE_RAYS):
        response = batched_response(sensor, angles, rays)
        if largest_u(response) <= GOAL:
            break
    return curve_of(sensor, response, rays, finished=True)
