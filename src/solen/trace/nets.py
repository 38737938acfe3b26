"""Light integrated by randomised nets: sixteen scrambled Sobol' nets, ever more points, until they agree.

For light through a face in space. Its rays have four coordinates and what a receiver gets jumps over each of them;
nothing of it can be integrated exactly, as the height can behind upright walls (decision 89). Each net is an estimate
of its own without bias, so that the standard error of their mean is what the integral may be off by.
"""

from dataclasses import replace

from solen.scene import Scene
from solen.trace.engine import trace
from solen.trace.result import Limits, Mode, Trace

FIRST_RAYS, MOST_RAYS, TIMES = 2**15, 2**21, 4
"""Rays to begin with, at most, and how many times as many follow."""


def by_nets(
    scene: Scene,
    tolerance: float,
    mode: Mode = "power",
    limits: Limits | None = None,
    *,
    most_rays: int = MOST_RAYS,
    most_legs: int | None = None,
    threads: int | None = None,
    first_rays: int = FIRST_RAYS,
    seed: int = 0,
) -> Trace:
    """Power at every receiver by ever more rays, until every receiver's standard error is within the tolerance.

    Parameters
    ----------
    scene
        The numbers of rays of its sources play no part.
    tolerance
        Tolerance of each power, as a fraction of the emitted power.
    mode, limits, threads
        As in `solen.trace.trace`.
    most_rays
        Number of rays at which it ends, whatever the error: ``reached`` is False then, and ``why`` says so.
    most_legs
        Number of straight stretches of light beyond which no more rays follow.
    first_rays
        Number of rays that it begins with.
    seed
        Seed of the nets: another gives others.
    """
    rays = first_rays
    while True:
        found = trace(with_rays(scene, rays), mode, limits, sampling="sobol", seed=seed, threads=threads)
        if found.u_power <= tolerance:
            return found
        if rays >= most_rays or (most_legs is not None and TIMES * found.hits > most_legs):
            why = f"{found.rays} rays reach {found.u_power:.1e} and not {tolerance:g}: ask for a larger tolerance"
            return replace(found, reached=False, why=why)
        rays *= TIMES


def with_rays(scene: Scene, rays: int) -> Scene:
    """The scene with this number of rays for each source."""
    return replace(scene, sources=tuple(source.with_rays(rays) for source in scene.sources))
