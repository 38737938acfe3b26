"""Light budget of a sensor at rest: fractions of the emitter's power that add up to 1.

The ledger of a single trace does not separate light reflected by the lens from light that missed every surface. Two
further traces, one with black faces and one with a black body, do.

Public names: `budget` and `Budget`.
"""

from dataclasses import dataclass, replace

import numpy as np

from solen.scene import Scene
from solen.sensor.sensor import Sensor
from solen.trace import Trace, integrate, trace
from solen.trace.adaptive import integration_obstacle

TOLERANCE = 1e-3
BUDGET_RAYS = 2**17
"""Number of rays if the powers cannot be integrated."""
OPAQUE_PER_MM = 1e6


@dataclass(frozen=True)
class Budget:
    """Fractions of the emitter's power at rest, without ambient light; they add up to 1 within ``u``.

    Attributes
    ----------
    right, left
        Detected by the right and the left receiver.
    beside
        Passing beside the lens and the body without meeting a surface.
    above_below
        Passing above or below the lens and the body, in space.
    reflected
        Reflected by the body without entering it.
    leaked
        Leaving the body through its top or bottom, in space.
    escaped
        Leaving the body elsewhere.
    absorbed
        Absorbed in the material, at walls and at the backs of receivers.
    truncated
        Not traced further.
    u
        Uncertainty of each fraction.
    """

    right: float
    left: float
    beside: float
    above_below: float
    reflected: float
    leaked: float
    escaped: float
    absorbed: float
    truncated: float
    u: float


def budget(sensor: Sensor) -> Budget:
    """Return the light budget of a sensor at rest.

    Three traces are compared: the scene itself; the scene with all faces black, from which only light escapes that
    meets no face; and the scene with a body that absorbs all light entering it, from which only light escapes that
    never enters the body.
    """
    scene = sensor.scene(0.0)
    scene = replace(scene, sources=scene.sources[:1])
    actual, u = _powers_of(scene)
    right, left = (actual.detectors[name].power for name in ("right", "left"))
    if scene.front is not None:
        return _budget_of_lens_in_space(scene, actual, u)
    black, u_black = _powers_of(_black(scene))
    opaque, u_opaque = _powers_of(_opaque(scene))
    beside = black.ledger.escaped - black.missed
    reflected = max(0.0, opaque.ledger.escaped - black.ledger.escaped)
    return Budget(
        right=right,
        left=left,
        beside=beside,
        above_below=black.missed,
        reflected=reflected,
        leaked=actual.leaked,
        escaped=max(0.0, actual.ledger.escaped - black.ledger.escaped - reflected - actual.leaked),
        absorbed=actual.ledger.absorbed,
        truncated=actual.ledger.truncated,
        u=u + u_black + u_opaque,
    )


def _budget_of_lens_in_space(scene: Scene, actual: Trace, u: float) -> Budget:
    """Return the budget of a sensor with a lens that is not a cylinder.

    The front face of such a lens cannot be black, but the trace itself gives the light that the face reflects.
    """
    opaque, u_opaque = _powers_of(_opaque(scene))
    right, left = (actual.detectors[name].power for name in ("right", "left"))
    return Budget(
        right=right,
        left=left,
        beside=opaque.ledger.escaped - opaque.missed - opaque.reflected,
        above_below=opaque.missed,
        reflected=opaque.reflected,
        leaked=actual.leaked,
        escaped=max(0.0, actual.ledger.escaped - opaque.ledger.escaped - actual.leaked),
        absorbed=actual.ledger.absorbed,
        truncated=actual.ledger.truncated,
        u=u + u_opaque,
    )


def _black(scene: Scene) -> Scene:
    """Return the scene with faces that absorb all light."""
    return replace(
        scene,
        interfaces=tuple(
            replace(interface, behaviour="absorbing", receiver=None, surface=None, height_mm=None)
            for interface in scene.interfaces
        ),
    )


def _opaque(scene: Scene) -> Scene:
    """Return the scene with a body that absorbs all light entering it."""
    regions = tuple(
        replace(region, absorption_per_mm=OPAQUE_PER_MM, scattering_per_mm=0.0) if region.name == "body" else region
        for region in scene.regions
    )
    return replace(scene, regions=regions)


def _powers_of(scene: Scene) -> tuple[Trace, float]:
    """Return the trace of a scene, integrated if possible and otherwise sampled, and the uncertainty of its powers."""
    if not integration_obstacle(scene):
        result = integrate(scene, "power", TOLERANCE)
        if result.reached:
            return result, result.u_power
    has_points = all(source.emission() is not None for source in scene.sources)
    sampled = scene
    if has_points:  # the rays of a file are fixed
        sampled = replace(scene, sources=tuple(source.with_rays(BUDGET_RAYS) for source in scene.sources))
    result = trace(sampled, "power", sampling="sobol" if has_points else "fan")
    return result, float(0.5 / np.sqrt(result.rays))  # upper bound of a fraction's standard error
