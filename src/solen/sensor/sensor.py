"""A design with what follows from it at once: the material's index at the emitter's wavelength, and its lens.

Everything that depends on the angle is a method.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

import numpy as np

from solen.arrays import Progress
from solen.errors import DesignError, SolenError, SpecError
from solen.geometry import BODY_KINDS, Body, arm_angle_deg, body_of
from solen.lens import FlatFace, Lens, MeasuredLens, lens_of
from solen.material import Optical, optical
from solen.parts import Light, light_of
from solen.scene import Scene, sensor_scene
from solen.sensor.response import Response, Sensitivity, contrast, contrast_slope, powers, steepness
from solen.spec import Design, load, value_at, with_values
from solen.trace import Derivative, Mode, Slope, Trace, derivative, integrate, trace
from solen.trace.adaptive import POINT_TOLERANCE, is_extended, usual_tolerance, why_not
from solen.trace.derivative import EXTENDED_TOLERANCE, MOST_LEGS
from solen.trace.derivative import TOLERANCE as DERIVATIVE_TOLERANCE

FAILURES = 2
"""After so many angles of a sweep at which integration failed, it is not tried at the others."""
DENSE_TOLERANCE = 1e-4
SAMPLED_TOLERANCE, FIRST_SAMPLED, MOST_SAMPLED = 2e-4, 2**15, 2**19
"""To what standard error rays in space and scattered light are sampled, and their least and largest number."""
RECENT_SCENES = 64
"""Scenes that a sensor remembers."""
FIRST_RAYS, MOST_RAYS = 2**13, 2**18
"""What ever denser fans are driven to where integration fails, and their least and largest number of rays."""
SLOPE_DEG = 0.04
"""Angle over which the slope at the null is taken: well inside the range where a contrast is straight."""

OPTICAL_KEYS = (
    *(f"emitter.{name}" for name in ("wavelength_nm", "distance_mm", "offset_mm", "cone_deg", "width_mm")),
    *(f"material.{name}" for name in ("index", "absorption_per_mm")),
    *(f"lens.{name}" for name in ("focus_mm", "half_width_mm", "design_index")),
    *(f"body.{name}" for name in ("stem_length_mm", "stem_curve_per_mm", "arm_length_mm", "arm_width_mm")),
    *("body.arm_angle_deg", "receivers.gap_mm"),
)
"""Numbers of a design that its light depends on, at a given angle of the motion."""

MATCHED = (
    "something of the same index touches a wall, where there is no derivative: either way light is reflected there"
)
OF_THE_LIGHT = ("wavelength_nm", "cone_deg", "width_mm", "height_mm")
"""Numbers of the emitter that a part may state where the design does not."""


class TraceKeywords(TypedDict, total=False):
    """What `Sensor.trace` passes on to `solen.trace.trace`, which explains it."""

    sampling: Literal["fan", "sobol"]
    seed: int
    precision: Literal["double", "single"]
    position_bins: int
    angle_bins: int
    legs: bool
    device: Literal["cpu", "cuda"]
    threads: int | None
    progress: Callable[[int], None] | None


@dataclass(frozen=True)
class Sensor:
    """A design and what follows from it; make it with `Sensor.of`. A drawn body has no lens that solen ``cut``."""

    design: Design
    material: Optical
    cut: Lens | None

    @classmethod
    def of(cls, design: Design | Path | str) -> "Sensor":
        """Sensor of a design or of a design file.

        Raises
        ------
        SpecError
            Where the file is not a valid design.
        DesignError, DataError
            Where its lens cannot be, or its resin cannot be read.
        """
        design = design if isinstance(design, Design) else load(design)
        material = optical(design)
        drawn = BODY_KINDS[design.body.kind].lens_is_drawn
        return cls(design, material, None if drawn else lens_of(design, material.index))

    def set(self, values: Mapping[str, Any] | None = None, /, **keys: Any) -> "Sensor":
        """Sensor of the design with some values changed, as `Design.set` takes them."""
        return Sensor.of(self.design.set(values, **keys))

    @property
    def lens(self) -> Lens:
        """Lens cut for the design; `DesignError` for a drawn body, whose lens is part of the drawing."""
        if self.cut is None:
            limit = "the lens of an outline is drawn: solen knows no formula for it"
            raise DesignError("body.kind", value=self.design.body.kind, limit=limit, remedy="use solen check")
        return self.cut

    @property
    def is_drawn(self) -> bool:
        """Whether the body is an outline of one's own."""
        return self.cut is None

    @property
    def has_lens(self) -> bool:
        """Whether light enters by a lens rather than by the stem's flat face; of a drawn body it is said to."""
        return not isinstance(self.cut, FlatFace)

    @property
    def is_measured(self) -> bool:
        """Whether the lens is one as it was printed."""
        return isinstance(self.cut, MeasuredLens)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What must be known of its material's numbers and of its lens before its response is believed."""
        return (*self.material.warnings, *(self.cut.warnings if self.cut is not None else ()))

    @cached_property
    def as_designed(self) -> "Sensor":
        """The same sensor with the lens that was asked for, where this one was measured."""
        return Sensor.of(with_values(self.design, {"lens.shape": "cartesian-oval"}))

    @cached_property
    def without_lens(self) -> "Sensor":
        """The same sensor with the stem's flat face for a lens."""
        return Sensor.of(with_values(self.design, {"lens.shape": "none"}))

    def body(self, angle_deg: float = 0.0) -> Body:
        """Body with its moving parts turned by ``angle_deg``; `DesignError` where it cannot be."""
        return body_of(self.design, self.cut, angle_deg)

    def check_pair(self) -> None:
        """`DesignError` where the receivers are not the two, ``right`` and ``left``, whose contrast is the response."""
        body = self.body()
        found = sorted({face.whose for face in (*body.all_faces, *body.apart) if face.part == "receiver"})
        if found != ["left", "right"]:
            raise DesignError(
                "receivers",
                value=", ".join(found) or "none",
                limit="a response needs two, right and left",
                remedy="name their faces receiver-right and receiver-left, or use solen trace, which reads any",
            )

    def check(self) -> None:
        """`DesignError` where the body cannot be built at some angle of the motion."""
        for angle_deg in self.design.motion.angles_deg():
            self.body(angle_deg)

    def scene(self, angle_deg: float = 0.0, rays: int | None = None) -> Scene:
        """Scene at an angle, with ``rays`` rays in place of the design's."""
        found = self._scenes.get((angle_deg, rays))
        if found is None:
            found = sensor_scene(self.design, self.body(angle_deg), self.material, rays)
            while len(self._scenes) >= RECENT_SCENES:
                self._scenes.pop(next(iter(self._scenes)), None)
            self._scenes[angle_deg, rays] = found
        return found

    @cached_property
    def _scenes(self) -> dict[tuple[float, int | None], Scene]:
        """Scenes lately asked for: an angle is counted, integrated and drawn."""
        return {}

    def trace(
        self,
        angle_deg: float = 0.0,
        mode: Mode | None = None,
        rays: int | None = None,
        **options: Unpack[TraceKeywords],
    ) -> Trace:
        """Trace at an angle, in the design's mode and with its rays unless others are asked for.

        The options are those of `solen.trace.trace`: ``sampling``, ``seed``, ``precision``, ``position_bins``,
        ``angle_bins``, ``legs``, ``device``, ``threads``, ``progress``.
        """
        return trace(self.scene(angle_deg, rays), mode or self.design.trace.mode, **options)

    @cached_property
    def light(self) -> Light:
        """What its emitter sends out."""
        return light_of(self.design)

    def integrate(self, angle_deg: float = 0.0, mode: Mode = "power", tolerance: float | None = None) -> Trace:
        """Powers at an angle, integrated over the emitter to a tolerance; see `solen.trace.integrate`.

        By default the tolerance is 1e-6 for a point in one colour, and 1e-4 for any other source.
        """
        scene = self.scene(angle_deg)
        return integrate(scene, mode, usual_tolerance(scene) if tolerance is None else tolerance)

    def derivative(self, key: str, angle_deg: float = 0.0, mode: Mode = "power") -> Derivative:
        """Derivative of the powers at an angle with respect to a number of the design, by its dotted key.

        See `solen.trace.derivative`; the moving edges between ways of light are included.

        Raises
        ------
        SpecError
            Where the key is not one of a real number that the design states.
        """
        value = self._number(key)

        def scene_at(value: float) -> Scene:
            other = Sensor.of(with_values(self.design, {key: value}))
            return (replace(other, cut=self.cut) if self.is_measured else other).scene(angle_deg)  # it is as it is

        return derivative(scene_at, value, mode=mode)

    def sensitivity(
        self, keys: Sequence[str] | None = None, angle_deg: float = 0.0, progress: Progress | None = None
    ) -> tuple[Sensitivity, ...]:
        """Derivatives of the powers and of the contrast at an angle, the steepest contrast first.

        Parameters
        ----------
        keys
            Numbers of the design by their dotted keys; by default those of `OPTICAL_KEYS` that are not `inert`.
        angle_deg
            Angle of the motion.
        progress
            Called with the share done, up to 1.

        Raises
        ------
        SpecError
            Where a key is not one of a real number that the design states, or is inert.
        DesignError
            Where the light at this angle cannot be integrated closely enough.
        """
        self.check_pair()
        chosen = [key for key in OPTICAL_KEYS if not self.inert(key)] if keys is None else list(dict.fromkeys(keys))
        for key in chosen:
            if why := self.inert(key):
                raise SpecError(key, limit=why, remedy="leave it out")
        values = {key: self._number(key) for key in chosen}
        scene = self.scene(angle_deg)
        if scene.is_random or scene.extrusion is not None:
            found_in = "rays in space" if scene.extrusion is not None else "scattered light"
            limit = "derivatives are known in the plane, of light that nothing scatters by chance"
            raise DesignError("sensitivity", value=found_in, limit=limit, remedy="compare two designs by solen trace")
        tolerance = EXTENDED_TOLERANCE if is_extended(scene) else DERIVATIVE_TOLERANCE
        base = integrate(scene, "power", tolerance, most_legs=MOST_LEGS)
        if not base.reached:
            limit = f"the integral must reach {tolerance:g}"
            raise DesignError(f"light at {angle_deg:g} deg", value=base.why, limit=limit, remedy="try another angle")
        found = []
        for done, (key, value) in enumerate(values.items(), start=1):
            found.append(self._sensitivity(key, value, angle_deg, base))
            if progress is not None:
                progress(done / len(values))
        return tuple(sorted(found, key=steepness, reverse=True))

    def inert(self, key: str) -> str:
        """Why a number of the design has no part of its own in the light; empty where it has one."""
        design = self.design
        resin = design.material.resin is not None
        if self.is_measured and key.startswith("lens."):
            return "the lens is measured"
        if self.is_drawn and key.startswith(("lens.", "body.", "emitter.distance_mm")):
            return "the body is drawn"
        cases = {
            "emitter.wavelength_nm": (
                not resin and not self.scene().wavelengths_nm,
                "the index is stated, whatever the wavelength",
            ),
            "emitter.width_mm": (self.light.width_mm == 0.0, "the emitter is a point"),
            "material.index": (
                resin or self._is_matched,
                "follows from the resin and the wavelength" if resin else MATCHED,
            ),
            "material.absorption_per_mm": (resin and not design.material.states_absorption, "follows from the resin"),
            "lens.focus_mm": (not self.has_lens, "the design has no lens"),
            "lens.design_index": (
                not self.has_lens or design.lens.design_index is None,
                "follows from the material's index" if self.has_lens else "the design has no lens",
            ),
            "receivers.gap_mm": (design.receivers.gap_mm is None, "the design has no air gap"),
        }
        applies, why = cases.get(key, (False, ""))
        return why if applies else ""

    @property
    def _is_matched(self) -> bool:
        """Whether something of the body's own index touches a bare wall; through a film both ways are smooth."""
        bare = [wall for wall in self.design.wall if wall.gap_um is None and not wall.coating]
        return any(wall.index == self.material.index for wall in bare)

    def doubled(self, angle_deg: float = 0.0, tolerance: float = DENSE_TOLERANCE) -> tuple[Trace, float]:
        """Power by fans of twice as many rays until no receiver changes by more than ``tolerance``.

        For light whose ways part too often for `integrate`. Returns the last trace and its uncertainty: the last
        change, or the share of one ray where that is more, because two fans can agree by chance; above ``tolerance``
        where `MOST_RAYS` rays do not reach it.
        """
        rays = FIRST_RAYS
        before = self.trace(angle_deg, "power", rays)
        while True:
            rays *= 2
            after = self.trace(angle_deg, "power", rays)
            changes = [abs(after.detectors[name].power - before.detectors[name].power) for name in after.detectors]
            u = max(*changes, 1.0 / min(rays, after.rays))
            if u <= tolerance or rays >= MOST_RAYS:
                return after, u
            before = after

    def sampled(self, angle_deg: float = 0.0, tolerance: float = SAMPLED_TOLERANCE) -> tuple[Trace, float]:
        """Power by ever more Sobol' samples until every receiver's standard error is within ``tolerance``.

        For rays in space and for light that is scattered by chance. Returns the last trace and the largest error; above
        ``tolerance`` where `MOST_SAMPLED` rays do not reach it.
        """
        rays = FIRST_SAMPLED
        while True:
            found = self.trace(angle_deg, "power", rays, sampling="sobol")
            if found.u_power <= tolerance or rays >= MOST_SAMPLED:
                return found, found.u_power
            rays *= 4

    def slope_per_deg(self, angle_deg: float) -> float | None:
        """Change of the contrast per degree at an angle, in power, over `SLOPE_DEG`; None where no light arrives."""
        self.check_pair()
        ends = (angle_deg - SLOPE_DEG / 2, angle_deg + SLOPE_DEG / 2)
        readings = [self._reading(end, tolerance=POINT_TOLERANCE)[1] for end in ends]
        low, high = (contrast(reading["right"], reading["left"]) for reading in readings)
        return None if low is None or high is None else (high - low) / SLOPE_DEG

    def count(self, angles_deg: Sequence[float] | None = None, progress: Progress | None = None) -> Response:
        """Response by counting the design's own number of rays, as the paper does."""

        def at(angle_deg: float) -> tuple[Trace, dict[str, float], float]:
            found = self.trace(angle_deg, "count")
            return found, powers(found), math.nan

        return self._sweep("count", at, angles_deg, progress)

    def power(
        self,
        angles_deg: Sequence[float] | None = None,
        progress: Progress | None = None,
        *,
        standard_error: float = SAMPLED_TOLERANCE,
        tolerance: float | None = None,
    ) -> Response:
        """Response in power, integrated at every angle; by ever denser fans where that does not reach its tolerance.

        The tolerance is that of `integrate`. Rays in space and scattered light are sampled to the standard error.
        """
        failed: list[float] = []

        def at(angle_deg: float) -> tuple[Trace, dict[str, float], float]:
            integrates = len(failed) < FAILURES
            reading = self._reading(
                angle_deg, integrates=integrates, tolerance=tolerance, standard_error=standard_error
            )
            if reading[0].method != "adaptive":
                failed.append(angle_deg)
            return reading

        return self._sweep("power", at, angles_deg, progress)

    def _number(self, key: str) -> float:
        """Value of a key, `SpecError` where it is not a real number."""
        value = value_at(self.design, key)
        table, _, name = key.partition(".")
        if table == "emitter" and name in OF_THE_LIGHT:
            value = getattr(self.light, name)
        if value is None and key == "body.arm_angle_deg":
            value = arm_angle_deg(self.design)
        if isinstance(value, bool | int) or not isinstance(value, float):
            raise SpecError(
                key, value=value, limit="must be a real number that the design states", remedy="set it in the design"
            )
        return value

    def _sensitivity(self, key: str, value: float, angle_deg: float, base: Trace) -> Sensitivity:
        """Row of one key; a value at the edge of what it may be has no derivative, and says so."""
        nothing = Slope(math.nan, math.nan)
        try:
            derivative = self.derivative(key, angle_deg)
        except SolenError as bad:
            return Sensitivity(key, value, nothing, nothing, nothing, f"not on both sides of {value:g}: {bad}")
        right, left = derivative.detectors["right"], derivative.detectors["left"]
        if not derivative.reached:
            return Sensitivity(key, value, nothing, nothing, nothing, derivative.why)
        return Sensitivity(key, value, right, left, contrast_slope(base, right, left))

    def _reading(
        self,
        angle_deg: float,
        *,
        integrates: bool = True,
        tolerance: float | None = None,
        standard_error: float = SAMPLED_TOLERANCE,
    ) -> tuple[Trace, dict[str, float], float]:
        """Powers at an angle with their uncertainty: integrated, or by ever denser fans where that does not reach.

        What is drawn by chance is sampled, and what flies in space where its integration does not reach.
        """
        scene = self.scene(angle_deg)
        integrates = integrates and not why_not(scene)
        whole = self.integrate(angle_deg, tolerance=tolerance) if integrates else None
        if whole is not None and whole.reached:
            return whole, powers(whole), whole.u_power
        if scene.is_random or scene.extrusion is not None:
            reading, u = self.sampled(angle_deg, standard_error)
            return reading, powers(reading), u
        dense, u = self.doubled(angle_deg)
        return dense, powers(dense), u

    def _sweep(
        self,
        mode: Mode,
        at: Callable[[float], tuple[Trace, dict[str, float], float]],
        angles_deg: Sequence[float] | None,
        progress: Progress | None,
    ) -> Response:
        self.check_pair()
        angles = self.design.motion.angles_deg() if angles_deg is None else tuple(angles_deg)
        results = []
        for done, angle in enumerate(angles, start=1):
            results.append(at(angle))
            if progress is not None:
                progress(done / len(angles))
        return Response(
            mode=mode,
            angle_deg=np.array(angles),
            right=np.array([powers["right"] for _, powers, _ in results]),
            left=np.array([powers["left"] for _, powers, _ in results]),
            u_power=np.array([u for _, _, u in results]),
            traces=tuple(sweep for sweep, _, _ in results),
        )
