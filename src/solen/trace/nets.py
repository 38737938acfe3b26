"""Integration with randomised nets: sixteen scrambled Sobol' nets with increasing numbers of points, until they agree.

This method is for light through a face in space. Each ray has four coordinates, and the power at a receiver jumps along
every one of them, so none can be integrated exactly, as the height can for vertical walls (decision 89). Each net is an
unbiased estimate, so the standard error of the mean over nets is the uncertainty of the integral.
"""

from dataclasses import replace

from solen.scene import Scene
from solen.trace.engine import trace
from solen.trace.result import Limits, Mode, Trace

FIRST_RAYS, MAX_RAYS, TIMES = 2**15, 2**21, 4
"""Initial and maximum number of rays, and the factor between successive numbers."""


def by_nets(
    scene: Scene,
    tolerance: float,
    mode: Mode = "power",
    limits: Limits | None = None,
    *,
    most_rays: int = MAX_RAYS,
    most_legs: int | None = None,
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
    most_rays
        Number of rays at which the integration ends, whatever the error; ``reached`` is then False, and ``why`` gives
        the reason.
    most_legs
        Number of ray segments beyond which no further rays are traced.
    first_rays
        Initial number of rays.
    seed
        Seed of the nets.
    """
    rays = first_rays
    while True:
        found = trace(with_rays(scene, rays), mode, limits, sampling="sobol", seed=seed, threads=threads)
        if found.u_power <= tolerance:
            return found
        if rays >= most_rays or (most_legs is not None and TIMES * found.hits > most_legs):
            why = (
                f"{found.rays} rays reach an uncertainty of {found.u_power:.1e} instead of {tolerance:g}: "
                "choose a larger tolerance"
            )
            return replace(found, reached=False, why=why)
        rays *= TIMES


def with_rays(scene: Scene, rays: int) -> Scene:
    """Return the scene with this many rays per source."""
    return replace(scene, sources=tuple(source.with_rays(rays) for source in scene.sources))
