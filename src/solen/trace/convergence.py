"""Convergence of each sampling method towards the power at the receivers, and the reliability of its uncertainty.

A scene is traced with fans and with Sobol' samples of increasing ray counts, and integrated to decreasing tolerances.
The error of each result is its difference from a reference value, which is an adaptive integral to
`REFERENCE_TOLERANCE`. If that is impossible or does not reach the tolerance, the reference is the result with the
smallest reported uncertainty among the last integral, a fan and a sample; this fan and this sample have four times as
many rays as the densest fan and the densest sample of the comparison.
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
REFERENCE_TOLERANCE = 1e-11
"""Tolerance of the reference value."""
TOLERANCES = tuple(10.0**-k for k in range(1, 10))
REFERENCE_FACTOR = 4


class Series(Result):
    """One sampling method: ray counts (N,), the largest power error at any receiver, and the reported uncertainty.

    Errors and uncertainties are fractions of the emitted power; ``u_power`` is NaN if there are too few rays.
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
    max_rays: int = MAX_RAYS,
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
    max_rays
        Number of rays in the densest fan and sample, at least 16; the other fans and samples have fewer rays, by
        factors of two.
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
    check_count("max_rays", max_rays, MIN_RAYS)
    if not scene.receivers:
        raise DesignError("convergence", limit="requires a scene with a receiver")
    if any(isinstance(source, Rays) for source in scene.sources):
        raise DesignError("convergence", limit="does not support a source that is a list of rays")
    reference_mode: Mode = "power" if mode == "roulette" else mode
    integrals = list(_integrals(scene, reference_mode, limits))
    reference = _reference(scene, reference_mode, limits, max_rays, integrals)
    integrals = [integral for integral in integrals if integral is not reference]
    ray_counts = [max_rays >> k for k in range(int(math.log2(max_rays / MIN_RAYS)), -1, -1)]
    scenes = [_with_rays(scene, rays) for rays in ray_counts]
    fans = [trace(variant, mode, limits, seed=seed) for variant in scenes]
    samples = [trace(variant, mode, limits, sampling="sobol", seed=seed) for variant in scenes]
    series = tuple(_series(reference, traces) for traces in (fans, samples, integrals) if traces)
    return Convergence(mode, reference, series)


def _reference(scene: Scene, mode: Mode, limits: Limits | None, max_rays: int, integrals: list[Trace]) -> Trace:
    """Return the most accurate available result: the last integral, or a denser fan or sample."""
    if integrals and integrals[-1].u_power <= REFERENCE_TOLERANCE:
        return integrals[-1]
    dense = _with_rays(scene, REFERENCE_FACTOR * max_rays)
    samples = [trace(dense, mode, limits), trace(dense, mode, limits, sampling="sobol")]
    return min([*integrals[-1:], *samples], key=lambda result: result.u_power)


def _integrals(scene: Scene, mode: Mode, limits: Limits | None) -> Iterator[Trace]:
    """Yield integrals to decreasing tolerances until one is not reached; none for a scene that can only be sampled."""
    if scene.front is not None:
        return
    for tolerance in (*TOLERANCES, REFERENCE_TOLERANCE):
        try:
            result = integrate(scene, mode, tolerance, limits)
        except DesignError:  # for example a beam, or a scene that scatters
            return
        if not result.reached:
            return
        yield result


def _with_rays(scene: Scene, rays: int) -> Scene:
    """Return the scene with ``rays`` rays, divided equally among its sources."""
    return with_rays(scene, max(1, rays // len(scene.sources)))


def _series(reference: Trace, results: list[Trace]) -> Series:
    """Return the errors by ray count; of results with equal counts (samples are rounded up), only the last is used."""
    traces = list({traced.rays: traced for traced in results}.values())

    def error(traced: Trace) -> float:
        return max(abs(traced.detectors[name].power - reading.power) for name, reading in reference.detectors.items())

    return Series(
        traces[0].method,
        np.array([traced.rays for traced in traces]),
        np.array([error(traced) for traced in traces]),
        np.array([traced.u_power for traced in traces]),
    )
