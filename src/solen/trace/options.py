"""Trace options, declared once for `solen trace`, for scenes and for designs."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from solen.errors import SpecError
from solen.scene import Scene
from solen.spec.strict import Finite, Options, refused
from solen.trace.adaptive import MAX_TOLERANCE, MIN_TOLERANCE, default_tolerance, integrate
from solen.trace.chunks import Digits
from solen.trace.engine import trace
from solen.trace.result import Mode, Trace

MAX_PATHS = 100_000
"""Maximum number of rays whose paths are stored."""


class TraceOptions(Options):
    """Options that determine which rays are traced, how they propagate, and what is reported."""

    mode: Mode | None = None
    """Physics: count (refraction or total reflection), power (Fresnel, both branches) or roulette (Fresnel, one branch
    chosen at random); default: trace.mode of a design, power for a scene.
    """
    sampling: Literal["fan", "sobol", "adaptive"] = "fan"
    """Ray selection: fan (uniformly spaced), sobol (independent samples) or adaptive (integration over the launch
    angle).
    """
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = None
    """Seed of sobol and roulette; equal seeds give identical results."""
    tolerance: Annotated[Finite, Field(ge=MIN_TOLERANCE, le=MAX_TOLERANCE)] | None = None
    """For adaptive sampling: maximum uncertainty of a power, as a fraction of the emitted power; default: 1e-6 for a
    point source of one wavelength, 1e-4 for other sources.
    """
    precision: Digits = "double"
    """Floating-point precision; single also reports the error that it causes."""
    histogram: Annotated[int, Field(ge=1, le=10_000)] | None = None
    """Number of histogram bins for the power at each receiver, by position and by angle of incidence."""

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        if self.sampling != "adaptive":
            if self.tolerance is not None:
                remedy = "set sampling to adaptive, or omit tolerance"
                raise refused("tolerance", "applies only to adaptive sampling", value=self.tolerance, remedy=remedy)
            return self
        single = "single" if self.precision == "single" else None
        for name, value in (("seed", self.seed), ("precision", single), ("histogram", self.histogram)):
            if value is not None:
                limit = "does not apply to adaptive sampling"
                raise refused(name, limit, value=value, remedy=f"omit {name}, or set sampling to fan or sobol")
        return self


def trace_with(scene: Scene, options: TraceOptions, usual_mode: Mode = "power", *, paths: bool = False) -> Trace:
    """Trace or integrate a scene, as its options specify.

    Parameters
    ----------
    scene
        The scene to trace.
    options
        Trace options; ``usual_mode`` is used if they do not specify a mode.
    paths
        Whether to store each ray segment, from which ``paths()`` returns all ray paths.

    Raises
    ------
    SpecError
        For an option that has no effect on this scene, or that its sources or monitors do not support.
    DesignError
        As in `solen.trace.trace` and `solen.trace.integrate`.
    """
    mode = options.mode or usual_mode
    if options.sampling == "adaptive":
        _check_adaptive(scene, paths)
        tolerance = options.tolerance or default_tolerance(scene)
        return integrate(scene, mode, tolerance)
    is_random = options.sampling == "sobol" or mode == "roulette" or scene.is_random
    if options.seed is not None and not is_random:
        limit = f"mode {mode} with a fan uses no random numbers"
        raise SpecError("seed", value=options.seed, limit=limit, remedy="set sampling to sobol or mode to roulette")
    bins = options.histogram or 0
    return trace(
        scene,
        mode,
        sampling=options.sampling,
        seed=options.seed or 0,
        precision=options.precision,
        position_bins=bins,
        angle_bins=bins,
        segments=paths,
    )


def _check_adaptive(scene: Scene, paths: bool) -> None:
    if paths:
        raise SpecError(
            "sampling", value="adaptive", limit="does not support ray paths", remedy="use fan, or omit paths"
        )
    if scene.monitors:
        limit = "evaluates only receivers, but this scene has monitors"
        raise SpecError("sampling", value="adaptive", limit=limit, remedy="use fan or sobol")


def check_paths(scene: Scene) -> None:
    """Raise `SpecError` if the ray paths of a scene cannot be stored: too many rays, or rays in space."""
    if scene.rays > MAX_PATHS:
        limit = f"are stored for at most {MAX_PATHS} rays, but the scene has {scene.rays}"
        raise SpecError("paths", limit=limit, remedy="reduce the number of rays")
    if scene.extrusion is not None:
        limit = "are supported only in the plane, but these rays are in space"
        raise SpecError("paths", limit=limit, remedy="omit paths, or trace in the plane")
