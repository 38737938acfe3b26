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
from solen.geometry import BODY_KINDS, Body, are_mirrored, arm_angle_deg, body_of
from solen.geometry.mirror import OTHER
from solen.lens import FlatFace, Lens, MeasuredLens, lens_of
from solen.material import Optical, optical
from solen.parts import Light, light_of
from solen.scene import Scene, sensor_scene
from solen.sensor.response import Response, Sensitivity, contrast_slope, powers
from solen.spec import Design, load, value_at, with_values
from solen.trace import Derivative, Mode, Slope, Trace, derivative, integrate, trace
from solen.trace.adaptive import POINT_TOLERANCE, is_extended, usual_tolerance, why_not
from solen.trace.derivative import EXTENDED_TOLERANCE, MOST_LEGS, SPACE_TOLERANCE
from solen.trace.derivative import TOLERANCE as DERIVATIVE_TOLERANCE
from solen.trace.result import Detected

FAILURES = 2
"""After so many angles of a sweep at which integration failed, it is not tried at the others."""
SAMPLED_TOLERANCE, FIRST_SAMPLED, MOST_SAMPLED = 2e-4, 2**15, 2**19
"""To what standard error rays in space and scattered light are sampled, and their least and largest number."""
RECENT_SCENES = 64
"""Scenes that a sensor remembers."""
SLOPE_DEG, WIDE_SLOPE_DEG = 0.04, 0.2
"""Angle over which a slope is taken: of a point in the plane, whose response is steep, and of any other light."""
FEW_ANGLES, MOST_ANGLES = 5, 129
"""Angles that a drawn curve has at least, where there are two ends, and at most."""
BEND = 0.02
"""How far a contrast may lie from the straight line between its neighbours before angles are added between them."""

OPTICAL_KEYS = (
    *(f"emitter.{name}" for name in ("wavelength_nm", "distance_mm", "offset_mm", "cone_deg", "width_mm", "height_mm")),
    *(f"material.{name}" for name in ("index", "absorption_per_mm")),
    *(f"lens.{name}" for name in ("focus_mm", "half_width_mm", "design_index")),
    *(f"body.{name}" for name in ("stem_length_mm", "stem_curve_per_mm", "arm_length_mm", "arm_width_mm")),
    *("body.arm_angle_deg", "body.thickness_mm", "receivers.gap_mm"),
)
"""Numbers of a design that its light depends on, at a given angle of the motion."""

MATCHED = (
    "something of the same index touches a wall, where there is no derivative: either way light is reflected there"
)
OF_THE_MATERIAL = ("material.index", "material.absorption_per_mm")
USUAL = {"material.index": 0.01, "material.absorption_per_mm": 0.005}
"""Tolerances where the resin states no uncertainty: a reflectance good to 0.001 gives the index to 0.008."""
OF_THE_LIGHT = ("wavelength_nm", "cone_deg", "width_mm", "height_mm")
"""Numbers of the emitter that a part may state where the design does not."""


Reading = tuple[Trace, dict[str, float], float]
"""A trace, the power at each receiver, and its uncertainty."""


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
        value = self.number(key)

        def scene_at(value: float) -> Scene:
            other = Sensor.of(with_values(self.design, {key: value}))
            return (replace(other, cut=self.cut) if self.is_measured else other).scene(angle_deg)  # it is as it is

        return derivative(scene_at, value, mode=mode)

    def sensitivity(
        self, keys: Sequence[str] | None = None, angle_deg: float = 0.0, progress: Progress | None = None
    ) -> tuple[Sensitivity, ...]:
        """Derivatives of the powers and of the contrast at an angle, ranked by what a tolerance of each number does.

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
        values = {key: self.number(key) for key in chosen}
        scene = self.scene(angle_deg)
        if why := why_not(scene):
            limit = "derivatives need light from points that nothing scatters by chance"
            raise DesignError("sensitivity", value=why, limit=limit, remedy="compare two designs by solen trace")
        in_space = scene.extrusion is not None
        tolerance = EXTENDED_TOLERANCE if is_extended(scene) else DERIVATIVE_TOLERANCE
        tolerance = SPACE_TOLERANCE if in_space else tolerance
        base = integrate(scene, "power", tolerance, most_legs=None if in_space else MOST_LEGS)
        if not base.reached:
            limit = f"the integral must reach {tolerance:g}"
            raise DesignError(f"light at {angle_deg:g} deg", value=base.why, limit=limit, remedy="try another angle")
        found = []
        for done, (key, value) in enumerate(values.items(), start=1):
            found.append(replace(self._sensitivity(key, value, angle_deg, base), tolerance=self.tolerance(key)[0]))
            if progress is not None:
                progress(done / len(values))
        return tuple(sorted(found, key=lambda one: one.effect, reverse=True))

    def inert(self, key: str) -> str:
        """Why a number of the design has no part of its own in the light; empty where it has one."""
        design = self.design
        resin = design.material.resin is not None
        flat, in_plane = design.trace.dimension == "2d", "has no effect in the plane"
        if self.is_measured and key.startswith("lens."):
            return "the lens is measured"
        if self.is_drawn and key.startswith(("lens.", "body.", "emitter.distance_mm")) and key != "body.thickness_mm":
            return "the body is drawn"
        cases = {
            "emitter.wavelength_nm": (
                not resin and not self.scene().wavelengths_nm,
                "the index is stated, whatever the wavelength",
            ),
            "emitter.width_mm": (self.light.width_mm == 0.0, "the emitter is a point"),
            "emitter.height_mm": (flat or self.light.height_mm == 0.0, in_plane if flat else "the emitter is a line"),
            "body.thickness_mm": (flat, in_plane),
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

    def sampled(self, angle_deg: float = 0.0, tolerance: float = SAMPLED_TOLERANCE) -> tuple[Trace, float]:
        """Power by ever more Sobol' samples until every receiver's standard error is within ``tolerance``.

        For light that is scattered by chance, and where `integrate` does not do. Returns the last trace and the largest
        error; above ``tolerance`` where `MOST_SAMPLED` rays do not reach it.
        """
        rays = FIRST_SAMPLED
        while True:
            found = self.trace(angle_deg, "power", rays, sampling="sobol")
            if found.u_power <= tolerance or rays >= MOST_SAMPLED:
                return found, found.u_power
            rays *= 4

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether it is, at every angle of its motion, the mirror image of itself at the opposite one."""
        motion = self.design.motion
        last_deg = max(abs(motion.from_deg), abs(motion.to_deg))
        if self.light.ray_file is not None:
            return False
        return all(are_mirrored(self.body(angle), self.body(-angle)) for angle in (0.0, last_deg / 2, last_deg))

    def slope_per_deg(self, angle_deg: float, tolerance: float | None = None) -> Slope | None:
        """Change of the contrast per degree at an angle, in power, with its uncertainty; None where no light arrives.

        From two spans about the angle, one twice the other: what bends within them counts as uncertainty. The
        tolerance is that of `integrate`.
        """
        point = usual_tolerance(self.scene(angle_deg)) == POINT_TOLERANCE
        half = (SLOPE_DEG if point else WIDE_SLOPE_DEG) / 2
        found = self.power([angle_deg + n * half for n in (-2, -1, 1, 2)], tolerance=tolerance)
        value, u = found.contrast, found.u_contrast
        if not np.isfinite(value).all():
            return None
        close, wide = (value[2] - value[1]) / (2 * half), (value[3] - value[0]) / (4 * half)
        return Slope(float(close), float(abs(wide - close) / 3 + (u[1] + u[2]) / (2 * half)))

    def smooth(self, response: Response) -> Response:
        """A response with angles added where its contrast bends, so that straight lines between them look smooth."""
        while len(response.angle_deg) < MOST_ANGLES:
            added = _between(response)
            if not added:
                break
            response = response.joined(self.power(added))
        return response

    def count(self, angles_deg: Sequence[float] | None = None, progress: Progress | None = None) -> Response:
        """Response by counting the design's own number of rays, as the paper does."""

        def at(angle_deg: float) -> Reading:
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
        """Response in power, integrated at every angle; sampled where that does not reach its tolerance.

        The tolerance is that of `integrate`; scattered light is sampled to the standard error. Of symmetric sensors one
        of two opposite angles is traced.
        """
        failed: list[float] = []
        done: dict[float, Reading] = {}

        def at(angle_deg: float) -> Reading:
            if -angle_deg in done and self.is_symmetric:
                return _mirrored(done[-angle_deg])
            found = done[angle_deg] = traced(angle_deg)
            return _balanced(found) if angle_deg == 0.0 and self.is_symmetric else found

        def traced(angle_deg: float) -> Reading:
            integrates = len(failed) < FAILURES
            reading = self._reading(
                angle_deg, integrates=integrates, tolerance=tolerance, standard_error=standard_error
            )
            if reading[0].method != "adaptive":
                failed.append(angle_deg)
            return reading

        return self._sweep("power", at, angles_deg, progress)

    def tolerance(self, key: str) -> tuple[float, bool]:
        """How far off a number may be, and whether that is its standard uncertainty; else a hundredth of it."""
        stated = self.design.tolerance.of(key)
        u = {
            "material.index": self.material.u_index,
            "material.absorption_per_mm": self.material.u_absorption_per_mm,
        }.get(key)
        if stated is None and u:
            return u, True
        return stated or USUAL.get(key) or 0.01 * abs(self.number(key)) or 0.01, False

    def number(self, key: str) -> float:
        """Value of a number of the design; `SpecError` where it is not a real number that the design states."""
        value = value_at(self.design, key)
        table, _, name = key.partition(".")
        if table == "emitter" and name in OF_THE_LIGHT:
            value = getattr(self.light, name)
        if value is None and key == "body.arm_angle_deg":
            value = arm_angle_deg(self.design)
        if key in OF_THE_MATERIAL and value is None:
            value = getattr(self.material, name)
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
    ) -> Reading:
        """Powers at an angle with their uncertainty: integrated, or sampled where that is better.

        What is drawn by chance is sampled.
        """
        integrates = integrates and not why_not(self.scene(angle_deg))
        whole = self.integrate(angle_deg, tolerance=tolerance) if integrates else None
        if whole is not None and (whole.reached or whole.u_power <= standard_error):
            return whole, powers(whole), whole.u_power
        sampled, u = self.sampled(angle_deg, standard_error)
        if whole is not None and whole.u_power <= u:
            return whole, powers(whole), whole.u_power
        return sampled, powers(sampled), u

    def _sweep(
        self,
        mode: Mode,
        at: Callable[[float], Reading],
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


def _mirrored(reading: Reading) -> Reading:
    """What a symmetric sensor reads at the opposite angle."""
    trace, _, u = reading
    found = replace(trace, detectors={name: trace.detectors[OTHER[name]] for name in trace.detectors})
    return found, powers(found), u


def _balanced(reading: Reading) -> Reading:
    """What a symmetric sensor reads at rest: the same at both receivers."""
    trace, _, u = reading
    found = replace(trace, detectors={name: _mean(trace.detectors) for name in trace.detectors})
    return found, powers(found), u


def _mean(detectors: Mapping[str, Detected]) -> Detected:
    """Mean of two receivers."""
    right, left = (detectors[name] for name in OTHER)
    sources = zip(right.power_by_source, left.power_by_source, strict=True)
    return replace(right, power=(right.power + left.power) / 2, power_by_source=tuple((a + b) / 2 for a, b in sources))


def _between(response: Response) -> list[float]:
    """Angles halfway between those of a response beside which its contrast bends."""
    angle, contrast = response.angle_deg, response.contrast
    middles = (angle[1:] + angle[:-1]) / 2
    if len(angle) < FEW_ANGLES:
        return [float(middle) for middle in middles]
    share = (angle[1:-1] - angle[:-2]) / (angle[2:] - angle[:-2])
    bends = np.abs(contrast[1:-1] - (1.0 - share) * contrast[:-2] - share * contrast[2:]) > BEND
    wide = np.diff(angle) > (angle[-1] - angle[0]) / MOST_ANGLES
    return [float(middle) for middle in middles[(np.append(bends, False) | np.append(False, bends)) & wide]]
