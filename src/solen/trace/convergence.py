"""How fast each way to choose rays converges to the power at the receivers, and how reliable its uncertainty is.

One scene is traced by fans and by Sobol' samples of ever more rays, and integrated to ever smaller tolerances. The
error of each is its distance from a reference value: adaptive integration to `TIGHT`. For a scene that it does not
know or does not reach that in, it is the best of the last integral, a fan and a sample of four times the rays of the
densest, by the uncertainty that each states.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.curve import check_count
from solen.errors import DesignError
from solen.results import Result
from solen.scene import Rays, Scene
from solen.trace.adaptive import integrate
from solen.trace.engine import trace
from solen.trace.result import Limits, Method, Mode, Trace, check_mode

LEAST_RAYS, MOST_RAYS = 2**4, 2**18
TIGHT = 1e-11
"""Tolerance of the reference value."""
TOLERANCES = tuple(10.0**-k for k in range(1, 10))
DENSER = 4


class Series(Result):
    """One way to choose rays: numbers of rays (N,), the largest error of any receiver's power, and its stated u.

    Powers are fractions of the emitted power; ``u_power`` is NaN for too few rays.
    """

    method: Method
    rays: IntArray
    error: FloatArray
    u_power: FloatArray


class Convergence(Result):
    """Error against rays for each way to choose them, and the trace that the errors are measured from."""

    mode: Mode
    reference: Trace
    series: tuple[Series, ...]


def convergence(
    scene: Scene,
    mode: Mode = "power",
    limits: Limits | None = None,
    *,
    most_rays: int = MOST_RAYS,
    seed: int = 0,
) -> Convergence:
    """Error against rays for a fan, for Sobol' samples and for adaptive integration.

    Parameters
    ----------
    scene
        The scene to trace; the numbers of rays of its sources play no part.
    mode
        As in `solen.trace.trace`. Roulette is compared with the integral in ``"power"``, which it draws from.
    limits
        Where following a ray ends; by default those of `solen.trace.trace` and of `solen.trace.integrate`.
    most_rays
        Rays of the densest fan and sample, at least 16; from there on downwards by powers of two.
    seed
        Seed of the samples and of the roulette.

    Returns
    -------
    Convergence
        A series each for ``"fan"``, ``"sobol"`` and, if the scene can be integrated at all, ``"adaptive"``.

    Raises
    ------
    DesignError
        Unknown mode, too few rays, no receiver, or a source that is a list of rays.
    """
    check_mode(mode)
    check_count("most_rays", most_rays, LEAST_RAYS)
    if not scene.receivers:
        raise DesignError("convergence", value="no receiver", limit="needs a receiver, whose power converges")
    if any(isinstance(source, Rays) for source in scene.sources):
        raise DesignError(
            "convergence", value="a list of rays", limit="needs sources whose number of rays can be chosen"
        )
    whole: Mode = "power" if mode == "roulette" else mode
    found = list(_integrals(scene, whole, limits))
    reference = _reference(scene, whole, limits, most_rays, found)
    found = [one for one in found if one is not reference]
    numbers = [most_rays >> k for k in range(int(math.log2(most_rays / LEAST_RAYS)), -1, -1)]
    scenes = [_with_rays(scene, rays) for rays in numbers]
    fans = [trace(variant, mode, limits, seed=seed) for variant in scenes]
    samples = [trace(variant, mode, limits, sampling="sobol", seed=seed) for variant in scenes]
    series = tuple(_series(reference, traces) for traces in (fans, samples, found) if traces)
    return Convergence(mode, reference, series)


def _reference(scene: Scene, mode: Mode, limits: Limits | None, most_rays: int, found: list[Trace]) -> Trace:
    """The value that is known best: the last integral, or a denser fan or sample."""
    if found and found[-1].u_power <= TIGHT:
        return found[-1]
    dense = _with_rays(scene, DENSER * most_rays)
    others = [trace(dense, mode, limits), trace(dense, mode, limits, sampling="sobol")]
    return min([*found[-1:], *others], key=lambda one: one.u_power)


def _integrals(scene: Scene, mode: Mode, limits: Limits | None) -> Iterator[Trace]:
    """Integrals to ever smaller tolerances, as long as these are reached; none of a scene that can but be sampled."""
    if scene.front is not None:
        return
    for tolerance in (*TOLERANCES, TIGHT):
        try:
            found = integrate(scene, mode, tolerance, limits)
        except DesignError:  # a beam, say, or a scene that scatters
            return
        if not found.reached:
            return
        yield found


def _with_rays(scene: Scene, rays: int) -> Scene:
    """The scene with so many rays, shared out evenly among its sources."""
    each = max(1, rays // len(scene.sources))
    return replace(scene, sources=tuple(source.with_rays(each) for source in scene.sources))


def _series(reference: Trace, result: list[Trace]) -> Series:
    """Errors of traces by their number of rays: of two with the same, as of samples that round it up, the later one."""
    traces = list({run.rays: run for run in result}.values())

    def error(of: Trace) -> float:
        return max(abs(of.detectors[name].power - it.power) for name, it in reference.detectors.items())

    return Series(
        traces[0].method,
        np.array([run.rays for run in traces]),
        np.array([error(run) for run in traces]),
        np.array([run.u_power for run in traces]),
    )
