"""Convergence of each sampling method towards the power at the receivers, and the reliability of its uncertainty.

A scene is traced with fans and with Sobol' samples of increasing ray counts, and integrated to decreasing tolerances.
The error of each result is its difference from a reference value, which is adaptive integration to `TIGHT`. If that is
impossible or does not reach the tolerance, the reference is the result with the smallest reported uncertainty among the
last integral, a fan and a sample; this fan and sample have four times as many rays as the densest ones compared.
"""

import math
from collections.abc import Iterator

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.curve import check_count
from solen.errors import DesignError
from solen.results import Result
from solen.scene import Rays, Scene
from solen.trace.adaptive import integrate
from solen.trace.engine import trace
from solen.trace.nets import with_rays
from solen.trace.result import Limits, Method, Mode, Trace, check_mode

MIN_RAYS, MAX_RAYS = 2**4, 2**18
TIGHT = 1e-11
"""Tolerance of the reference value."""
TOLERANCES = tuple(10.0**-k for k in range(1, 10))
DENSER = 4


class Series(Result):
    """One sampling method: ray counts (N,), the largest power error at any receiver, and the reported uncertainty.

    Powers are fractions of the emitted power; ``u_power`` is NaN if there are too few rays.
    """

    method: Method
    rays: IntArray
    error: FloatArray
    u_power: FloatArray


class Convergence(Result):
    """Errors by ray count for each sampling method, and the reference trace."""

    mode: Mode
    reference: Trace
    series: tuple[Series, ...]


def convergence(
    scene: Scene,
    mode: Mode = "power",
    limits: Limits | None = None,
    *,
    most_rays: int = MAX_RAYS,
    seed: int = 0,
) -> Convergence:
    """Compute the error as a function of the ray count for fans, Sobol' samples and adaptive integration.

    Parameters
    ----------
    scene
        The scene to trace; the ray counts of its sources have no effect.
    mode
        As in `solen.trace.trace`. Roulette is compared with the integral in ``"power"``, which is its expected value.
    limits
        When to stop following a ray; by default the limits of `solen.trace.trace` and `solen.trace.integrate`.
    most_rays
        Number of rays in the densest fan and sample, at least 16; the ray counts of the others are smaller by powers of
        two.
    seed
        Seed of the samples and of the roulette.

    Returns
    -------
    Convergence
        One series each for ``"fan"``, ``"sobol"`` and, if the scene can be integrated, ``"adaptive"``.

    Raises
    ------
    DesignError
        For an unknown mode, too few rays, a scene without receivers, or a source that is a list of rays.
    """
    check_mode(mode)
    check_count("most_rays", most_rays, MIN_RAYS)
    if not scene.receivers:
        raise DesignError("convergence", value="no receiver", limit="the scene requires a receiver")
    if any(isinstance(source, Rays) for source in scene.sources):
        raise DesignError(
            "convergence", value="a list of rays", limit="the ray count of each source must be adjustable"
        )
    whole: Mode = "power" if mode == "roulette" else mode
    found = list(_integrals(scene, whole, limits))
    reference = _reference(scene, whole, limits, most_rays, found)
    found = [one for one in found if one is not reference]
    numbers = [most_rays >> k for k in range(int(math.log2(most_rays / MIN_RAYS)), -1, -1)]
    scenes = [_with_rays(scene, rays) for rays in numbers]
    fans = [trace(variant, mode, limits, seed=seed) for variant in scenes]
    samples = [trace(variant, mode, limits, sampling="sobol", seed=seed) for variant in scenes]
    series = tuple(_series(reference, traces) for traces in (fans, samples, found) if traces)
    return Convergence(mode, reference, series)


def _reference(scene: Scene, mode: Mode, limits: Limits | None, most_rays: int, found: list[Trace]) -> Trace:
    """Return the most accurate available result: the last integral, or a denser fan or sample."""
    if found and found[-1].u_power <= TIGHT:
        return found[-1]
    dense = _with_rays(scene, DENSER * most_rays)
    others = [trace(dense, mode, limits), trace(dense, mode, limits, sampling="sobol")]
    return min([*found[-1:], *others], key=lambda one: one.u_power)


def _integrals(scene: Scene, mode: Mode, limits: Limits | None) -> Iterator[Trace]:
    """Yield integrals to decreasing tolerances until one is not reached; none for a scene that can only be sampled."""
    if scene.front is not None:
        return
    for tolerance in (*TOLERANCES, TIGHT):
        try:
            found = integrate(scene, mode, tolerance, limits)
        except DesignError:  # for example a beam, or a scene that scatters
            return
        if not found.reached:
            return
        yield found


def _with_rays(scene: Scene, rays: int) -> Scene:
    """Return the scene with this many rays, divided equally among its sources."""
    return with_rays(scene, max(1, rays // len(scene.sources)))


def _series(reference: Trace, result: list[Trace]) -> Series:
    """Return trace errors by ray count; of traces with equal counts (samples round up), the last one is used."""
    traces = list({run.rays: run for run in result}.values())

    def error(of: Trace) -> float:
        return max(abs(of.detectors[name].power - it.power) for name, it in reference.detectors.items())

    return Series(
        traces[0].method,
        np.array([run.rays for run in traces]),
        np.array([error(run) for run in traces]),
        np.array([run.u_power for run in traces]),
    )
