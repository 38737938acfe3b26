"""A design with its material, whose index is that at the emitter's wavelength, and its lens.

Everything that depends on the angle is a method.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import RLock
from typing import Any, Literal, TypedDict, Unpack

from solen.errors import DesignError
from solen.geometry import BODY_KINDS, Body, are_mirrored, body_of
from solen.geometry.network import network_body, network_lenses
from solen.lens import FlatFace, Lens, LensInSpace, MeasuredLens, lens_of
from solen.material import Optical, optical
from solen.mechanics.design import LoadedBody
from solen.parts import Light, light_of
from solen.progress import Progress, tracked
from solen.scene import Scene, sensor_scene
from solen.sensor.derivatives import SAMPLED_TOLERANCE, derivative_of, sensitivities, slope_per_deg
from solen.sensor.response import Reading, Response, Sensitivity
from solen.sensor.sweep import MAX_ANGLES, balanced, midpoints, mirrored, readings_at
from solen.spec import Design, load, with_values
from solen.spec.body import SHAPE_KEYS
from solen.spec.placed import lit, state_of, states
from solen.trace import Derivative, Mode, Slope, Trace, integrate, trace
from solen.trace.adaptive import default_tolerance, integration_obstacle
from solen.trace.chunks import Sampling
from solen.trace.nets import integrate_by_nets

MAX_SAMPLED = 2**19
"""Largest number of sampled rays."""
NO_SHAPE_KEYS: dict[str, Any] = {f"lens.{key}": None for key, *_ in SHAPE_KEYS}
"""Values that remove, with `solen.spec.with_values`, all keys that apply to some shapes of lens only."""
RECENT_SCENES = 64
"""Number of scenes that a sensor caches."""
BUILDING = RLock()
"""Lock under which scenes are built, since angles are traced on several threads."""


class TraceKeywords(TypedDict, total=False):
    """Options that `Sensor.trace` passes to `solen.trace.trace`, which describes them."""

    sampling: Sampling
    seed: int
    precision: Literal["double", "single"]
    position_bins: int
    angle_bins: int
    segments: bool
    device: Literal["cpu", "cuda"]
    threads: int | None
    progress: Callable[[int], None] | None


@dataclass(frozen=True)
class Sensor:
    """A design with its material and lens, created by `Sensor.of`.

    A network is represented by one sensor per emitter: the sensor of ``design.network.lit``, with the motions at their
    ``at_deg``.

    Attributes
    ----------
    design
        The design.
    material
        Its material at the emitter's wavelength.
    cut
        Its lens, as cut into the body; None for a drawn body and a network.
    lenses
        Lenses of a network, keyed by name, if they were designed for numbers other than the design's.
    """

    design: Design
    material: Optical
    cut: Lens | None
    lenses: Mapping[str, Lens] | None = field(default=None, hash=False)

    @classmethod
    def of(cls, design: Design | Path | str) -> "Sensor":
        """Return the sensor of a design or of a design file.

        Raises
        ------
        SpecError
            If the file is not a valid design.
        DesignError, DataError
            If its lens cannot be made, or its resin cannot be read.
        """
        design = design if isinstance(design, Design) else load(design)
        design = lit(design) if design.body.kind == "network" else design
        material = optical(design)
        drawn = BODY_KINDS[design.body.kind].lens_is_drawn
        return cls(design, material, None if drawn else lens_of(design, material.index))

    def set(self, values: Mapping[str, Any] | None = None, /, **keys: Any) -> "Sensor":
        """Return the sensor of the design with some values changed, as by `Design.set`."""
        return Sensor.of(self.design.set(values, **keys))

    @property
    def lens(self) -> Lens:
        """Lens of the design; raises `DesignError` for a drawn body, whose lens is part of the drawing."""
        if self.cut is None:
            drawn = "the lens of an outline is drawn and has no formula"
            limit = "a network has several lenses" if self.is_network else drawn
            raise DesignError("body.kind", value=self.design.body.kind, limit=limit, remedy="use solen check")
        return self.cut

    @property
    def is_drawn(self) -> bool:
        """Whether the body is drawn or a network, and so has no single lens in front of it."""
        return self.cut is None

    @property
    def is_network(self) -> bool:
        """Whether the body is a network of guides."""
        return self.design.body.kind == "network"

    @property
    def has_lens(self) -> bool:
        """Whether light enters through a lens rather than the stem's flat face; true for every drawn body."""
        return not isinstance(self.cut, FlatFace)

    @property
    def is_sampled(self) -> bool:
        """Whether the lens is not a cylinder, so that light through it is sampled."""
        return isinstance(self.cut, LensInSpace)

    @property
    def is_measured(self) -> bool:
        """Whether the lens is measured."""
        return isinstance(self.cut, MeasuredLens)

    @property
    def all_lenses(self) -> tuple[Lens, ...]:
        """The lens, or the lenses of a network; empty if the body is drawn."""
        if self.is_network:
            return tuple((network_lenses(self.design) if self.lenses is None else self.lenses).values())
        return () if self.cut is None else (self.cut,)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the material, the light and the lens."""
        lens_warnings = (text for lens in self.all_lenses for text in lens.warnings)
        return (*self.material.warnings, *self.light.warnings, *lens_warnings)

    @cached_property
    def as_designed(self) -> "Sensor":
        """The sensor with the designed lens, for a sensor with a measured lens."""
        return Sensor.of(with_values(self.design, {"lens.shape": self.design.lens.designed_shape}))

    @cached_property
    def without_lens(self) -> "Sensor":
        """The sensor with the stem's flat face in place of the lens."""
        return Sensor.of(with_values(self.design, NO_SHAPE_KEYS | {"lens.shape": "none"}))

    def body(self, angle_deg: float | None = None) -> Body:
        """Return the body with its moving parts rotated by ``angle_deg``, by default at rest.

        For a loaded design, ``angle_deg`` here and elsewhere is the value of the driven quantity, in degrees, mm or N.

        Raises
        ------
        DesignError
            If the body is impossible at this angle.
        """
        if self.lenses is not None:
            return network_body(self.design, angle_deg or 0.0, self.lenses)
        if angle_deg is None or not self.is_loaded:
            return body_of(self.design, self.cut, angle_deg or 0.0)
        return self.loaded.state(angle_deg).body

    @property
    def is_loaded(self) -> bool:
        """Whether its body is soft and under load."""
        return self.design.motion.kind == "loaded"

    @cached_property
    def loaded(self) -> LoadedBody:
        """Soft body of the sensor; raises `DesignError` if its motion is not that of a loaded body."""
        if self.is_network:
            limit, remedy = "is rigid: no load deforms it", "use solen run, which follows every [[network.motion]]"
            raise DesignError("body.kind", value="network", limit=limit, remedy=remedy)
        if not self.is_loaded:
            limit, remedy = "is not a load", 'set motion.kind = "loaded", and specify supports and loads of the body'
            raise DesignError("motion.kind", value=self.design.motion.kind, limit=limit, remedy=remedy)
        return LoadedBody.of(self.design, self.cut)

    def check_pair(self) -> None:
        """Raise `DesignError` unless there are two receivers, ``right`` and ``left``, as the contrast requires."""
        if self.is_network:
            limit = "the readings of a network are not those of a right and a left receiver"
            remedy = "use solen check, trace, sensitivity or run"
            raise DesignError("body.kind", value="network", limit=limit, remedy=remedy)
        body = self.body()
        receivers = sorted({face.label for face in (*body.all_faces, *body.separate) if face.part == "receiver"})
        if receivers != ["left", "right"]:
            raise DesignError(
                "receivers",
                value=", ".join(receivers) or "none",
                limit="a response needs two, right and left",
                remedy="name their faces receiver-right and receiver-left, or use solen trace, which accepts any",
            )

    def check(self) -> None:
        """Raise `DesignError` if the body cannot be built at some angle of the motion."""
        if self.is_loaded:
            self.loaded.states(self.design.motion.values())
            return
        if self.is_network:
            for state in states(self.design.network):
                body_of(state_of(self.design, state), None)
            return
        for angle_deg in self.design.motion.angles_deg():
            self.body(angle_deg)

    def scene(self, angle_deg: float = 0.0, rays: int | None = None) -> Scene:
        """Return the scene at an angle, with ``rays`` rays, by default the design's number."""
        with BUILDING:
            scene = self._scenes.get((angle_deg, rays))
            if scene is None:
                design = self.loaded.state(angle_deg).design if self.is_loaded else self.design
                scene = sensor_scene(design, self.body(angle_deg), self.material, rays)
                while len(self._scenes) >= RECENT_SCENES:
                    self._scenes.pop(next(iter(self._scenes)))
                self._scenes[angle_deg, rays] = scene
            return scene

    @cached_property
    def _scenes(self) -> dict[tuple[float, int | None], Scene]:
        """Cache of recent scenes, since the same angle is traced in several ways."""
        return {}

    def trace(
        self,
        angle_deg: float = 0.0,
        mode: Mode | None = None,
        rays: int | None = None,
        **options: Unpack[TraceKeywords],
    ) -> Trace:
        """Trace at an angle, by default in the design's mode and with its number of rays.

        The options are those of `solen.trace.trace`: ``sampling``, ``seed``, ``precision``, ``position_bins``,
        ``angle_bins``, ``segments``, ``device``, ``threads``, ``progress``.
        """
        return trace(self.scene(angle_deg, rays), mode or self.design.trace.mode, **options)

    @cached_property
    def light(self) -> Light:
        """Light from the sensor's emitter."""
        return light_of(self.design)

    def integrate(self, angle_deg: float = 0.0, mode: Mode = "power", tolerance: float | None = None) -> Trace:
        """Integrate the powers at an angle over the emitter to a tolerance; see `solen.trace.integrate`.

        The default tolerance is 1e-6 for a monochromatic point, and 1e-4 for any other source. Light through a lens
        that is not a cylinder is integrated with scrambled Sobol' nets, and its uncertainty is a standard error.
        """
        scene = self.scene(angle_deg)
        tolerance = default_tolerance(scene) if tolerance is None else tolerance
        return integrate(scene, mode, tolerance)

    def derivative(
        self, key: str, angle_deg: float = 0.0, mode: Mode = "power", *, emitter: str | None = None
    ) -> Derivative:
        """Return the derivative of the powers at an angle with respect to a number, given by its dotted key.

        See `solen.trace.derivative`; the motion of boundaries between light paths is included. ``emitter`` names the
        lit emitter of a network that has several.

        Raises
        ------
        SpecError
            If the key is not that of a real number with a value in the design, or if the network has several emitters
            and none is named.
        """
        return derivative_of(self, key, angle_deg, mode, emitter)

    def sensitivity(
        self, keys: Sequence[str] | None = None, angle_deg: float = 0.0, progress: Progress | None = None
    ) -> tuple[Sensitivity, ...]:
        """Return derivatives of powers and contrast at an angle, ranked by the effect of each number's tolerance.

        Parameters
        ----------
        keys
            Dotted keys of numbers; default: all `optical_keys` that have an effect.
        angle_deg
            Angle of the motion.
        progress
            Function called with the completed fraction, up to 1.

        Raises
        ------
        SpecError
            If a key is not that of a real number with a value in the design, or the number has no effect.
        DesignError
            If the light at this angle cannot be integrated accurately enough.
        """
        return sensitivities(self, keys, angle_deg, progress)

    def sampled(self, angle_deg: float = 0.0, tolerance: float = SAMPLED_TOLERANCE) -> tuple[Trace, float]:
        """Return the trace with as many Sobol' samples as standard errors within ``tolerance`` require.

        This is used for light scattered at random, and if `integrate` fails. Return also the largest standard error,
        which exceeds ``tolerance`` if `MAX_SAMPLED` rays do not suffice; ``reached`` is then False.
        """
        sampled = integrate_by_nets(self.scene(angle_deg), tolerance, max_rays=MAX_SAMPLED)
        return sampled, sampled.u_power

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether the sensor at any angle of its motion is the mirror image of the sensor at the opposite angle."""
        motion = self.design.motion
        last_deg = max(abs(motion.from_deg), abs(motion.to_deg))
        if self.light.ray_file is not None or self.is_loaded:  # its mesh is not mirror-symmetric
            return False
        return all(are_mirrored(self.body(angle), self.body(-angle)) for angle in (0.0, last_deg / 2, last_deg))

    def slope_per_deg(self, angle_deg: float, tolerance: float | None = None) -> Slope | None:
        """Return the slope of the contrast at an angle, in power, with its uncertainty; None without light.

        The slope is computed from two spans about the angle, one twice the other; curvature adds to the uncertainty.
        The tolerance is that of `integrate`.
        """
        return slope_per_deg(self, angle_deg, tolerance)

    def refined(self, response: Response, tolerance: float | None = None) -> Response:
        """Return a response with angles added where its contrast is curved, so that it looks smooth as a polyline.

        The tolerance is that of `power`.
        """
        while len(response.angle_deg) < MAX_ANGLES:
            added = midpoints(response)
            if not added:
                break
            response = response.merged(self.power(added, tolerance=tolerance))
        return response

    def count(self, angles_deg: Sequence[float] | None = None, progress: Progress | None = None) -> Response:
        """Return the response by counting the design's number of rays, as in the paper."""
        return self._by_rays("count", self._angles(angles_deg), progress)

    def power_of_rays(self, angles_deg: Sequence[float], rays: int, sampling: Sampling = "fan") -> Response:
        """Return the response in power from a given number of rays at each angle, for comparisons of lenses."""
        return self._by_rays("power", angles_deg, None, rays, sampling)

    def _by_rays(
        self,
        mode: Mode,
        angles_deg: Sequence[float],
        progress: Progress | None,
        rays: int | None = None,
        sampling: Sampling = "fan",
    ) -> Response:
        traces = [self.trace(angle, mode, rays, sampling=sampling) for angle in tracked(angles_deg, progress)]
        return Response.of(mode, angles_deg, [(traced, math.nan) for traced in traces])

    def power(
        self,
        angles_deg: Sequence[float] | None = None,
        progress: Progress | None = None,
        *,
        standard_error: float | None = None,
        tolerance: float | None = None,
    ) -> Response:
        """Return the response in power, integrated at every angle, or sampled if the tolerance is not reached.

        The tolerance is that of `integrate`. Scattered light is sampled to ``standard_error``, by default to the
        tolerance. For symmetric sensors, only one of two opposite angles is traced.
        """
        angles = self._angles(angles_deg)

        def traced(angle_deg: float, integrates: bool) -> Reading:
            return self.reading(angle_deg, integrates=integrates, tolerance=tolerance, standard_error=standard_error)

        traced_angles: dict[float, None] = {}
        for angle in angles:
            if not (-angle in traced_angles and self.is_symmetric):
                traced_angles[angle] = None
        readings = readings_at(traced, list(traced_angles), progress)

        def at(angle_deg: float) -> Reading:
            if angle_deg not in readings:
                return mirrored(readings[-angle_deg])
            return balanced(readings[angle_deg]) if angle_deg == 0.0 and self.is_symmetric else readings[angle_deg]

        return Response.of("power", angles, [at(angle) for angle in angles])

    def reading(
        self,
        angle_deg: float = 0.0,
        *,
        integrates: bool = True,
        tolerance: float | None = None,
        standard_error: float | None = None,
    ) -> Reading:
        """Return a trace with the powers at an angle, integrated or sampled, and the uncertainty of these powers.

        The powers are sampled if they cannot be integrated, for example with random scatter, or if integration is
        neither accurate enough nor more accurate than sampling.
        """
        cannot_integrate = bool(integration_obstacle(self.scene(angle_deg)))
        target = standard_error or (tolerance if cannot_integrate else None) or SAMPLED_TOLERANCE
        integrates = integrates and not cannot_integrate
        integrated = self.integrate(angle_deg, tolerance=tolerance) if integrates else None
        sufficient_u = standard_error or SAMPLED_TOLERANCE
        if integrated is not None and (integrated.reached or integrated.u_power <= sufficient_u):
            return integrated, integrated.u_power
        sampled, u = self.sampled(angle_deg, target)
        if integrated is not None and integrated.u_power <= u:
            return integrated, integrated.u_power
        return sampled, u

    def _angles(self, angles_deg: Sequence[float] | None) -> Sequence[float]:
        """Return the angles of a response, by default the design's."""
        self.check_pair()
        angles = self.design.motion.angles_deg() if angles_deg is None else angles_deg
        if self.is_loaded:
            self.loaded.states(angles)  # all with one mesh
        return angles
