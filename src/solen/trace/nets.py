"""Integration with sixteen scrambled Sobol' nets, whose numbers of points are increased until the nets agree.

This method is for light through a lens that varies with height. Each ray has four coordinates, and the power at a
receiver jumps along every one of them, so the integral over none of them can be computed exactly. For vertical walls,
in contrast, the integral over height is exact (decision 89). Each net is an unbiased estimate, so the standard error of
the mean over nets is the uncertainty of the integral.
"""

from dataclasses import replace

from solen.scene import Scene
from solen.trace.engine import trace
from solen.trace.result import Limits, Mode, Trace

FIRST_RAYS, MAX_RAYS, RAY_FACTOR = 2**15, 2**21, 4
"""Initial and maximum number of rays, and the factor between successive numbers."""


def integrate_by_nets(
    scene: Scene,
    tolerance: float,
    mode: Mode = "power",
    limits: Limits | None = None,
    *,
    max_rays: int = MAX_RAYS,
    max_segments: int | None = None,
    threads: int | None = None,
    first_rays: int = FIRST_RAYS,
    seed: int = 0,
) -> Trace:
    """Trace with increasing numbers of rays until the standard error at each receiver is within the tolerance.

    Parameters
    ----------
    scene
        The scene to integrate; the ray counts of its sources have no effect.
    tolerance
        Tolerance of each power, as a fraction of the emitted power.
    mode, limits, threads
        As in `solen.trace.trace`.
    max_rays
        Maximum number of rays. If they do not reach the tolerance, ``reached`` is False, and ``why`` gives the reason.
    max_segments
        Expected number of ray segments above which no further rays are traced.
    first_rays
        Initial number of rays.
    seed
        Seed of the nets.
    """
    rays = first_rays
    while True:
        result = trace(with_rays(scene, rays), mode, limits, sampling="sobol", seed=seed, threads=threads)
        if result.u_power <= tolerance:
            return result
        if rays >= max_rays or (max_segments is not None and RAY_FACTOR * result.hits > max_segments):
            why = (
                f"{result.rays} rays reach an uncertainty of {result.u_power:.1e} instead of {tolerance:g}: "
                "choose a larger tolerance"
            )
            return replace(result, reached=False, why=why)
        rays *= RAY_FACTOR


def with_rays(scene: Scene, rays: int) -> Scene:
    """Return the scene with ``rays`` rays per source."""
    return replace(scene, sources=tuple(source.with_rays(rays) for source in scene.sources))
