"""Light budget of a sensor at rest: fractions of the emitter's power that add up to 1.

The ledger of a single trace cannot separate light reflected by the lens from light that missed every surface. Two
further traces, one with black faces and one with a black body, can. Public names: `budget` and `Budget`.
"""

from dataclasses import dataclass, replace

import numpy as np

from solen.scene import Scene
from solen.sensor.sensor import Sensor
from solen.trace import Trace, integrate, trace
from solen.trace.adaptive import why_not

TOLERANCE = 1e-3
BUDGET_RAYS = 2**17
"""Number of rays if the budget cannot be integrated."""
OPAQUE_PER_MM = 1e6


@dataclass(frozen=True)
class Budget:
    """Fractions of the emitter's power at rest, which add up to 1 within ``u``; without ambient light.

    Attributes
    ----------
    right, left
        Detected by the right and the left receiver.
    beside
        Passes the lens and the body at the side and meets no surface.
    above_below
        Passes above or below them, in space.
    reflected
        Is reflected by the body and never enters it.
    leaked
        Leaves the body through its top or bottom, in space.
    escaped
        Leaves the body elsewhere.
    absorbed
        Is absorbed in the material, at walls and at the backs of receivers.
    truncated
        Was not followed further.
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

    Three traces are compared: the scene itself; the scene with all faces black, which leaves only light that is not
    incident on any face; and the scene with a body that absorbs all light entering it, which leaves only light that
    never enters.
    """
    scene = sensor.scene(0.0)
    scene = replace(scene, sources=scene.sources[:1])
    whole, u = _settled(scene)
    right, left = (whole.detectors[name].power for name in ("right", "left"))
    if scene.front is not None:
        return _of_a_face_in_space(scene, whole, u)
    black, u_black = _settled(_black(scene))
    opaque, u_opaque = _settled(_opaque(scene))
    beside = black.ledger.escaped - black.missed
    reflected = max(0.0, opaque.ledger.escaped - black.ledger.escaped)
    return Budget(
        right=right,
        left=left,
        beside=beside,
        above_below=black.missed,
        reflected=reflected,
        leaked=whole.leaked,
        escaped=max(0.0, whole.ledger.escaped - black.ledger.escaped - reflected - whole.leaked),
        absorbed=whole.ledger.absorbed,
        truncated=whole.ledger.truncated,
        u=u + u_black + u_opaque,
    )


def _of_a_face_in_space(scene: Scene, whole: Trace, u: float) -> Budget:
    """Return the budget if the trace itself gives the light reflected at the front face.

    A face in space cannot be black; an absorbing body gives the remaining fractions.
    """
    opaque, u_opaque = _settled(_opaque(scene))
    right, left = (whole.detectors[name].power for name in ("right", "left"))
    return Budget(
        right=right,
        left=left,
        beside=opaque.ledger.escaped - opaque.missed - opaque.reflected,
        above_below=opaque.missed,
        reflected=opaque.reflected,
        leaked=whole.leaked,
        escaped=max(0.0, whole.ledger.escaped - opaque.ledger.escaped - whole.leaked),
        absorbed=whole.ledger.absorbed,
        truncated=whole.ledger.truncated,
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


def _settled(scene: Scene) -> tuple[Trace, float]:
    """Return the powers of a scene, integrated if possible and otherwise sampled, and their uncertainty."""
    if not why_not(scene):
        settled = integrate(scene, "power", TOLERANCE)
        if settled.reached:
            return settled, settled.u_power
    made_of_points = all(source.emission() is not None for source in scene.sources)
    many = scene
    if made_of_points:  # the rays of a file are fixed
        many = replace(scene, sources=tuple(source.with_rays(BUDGET_RAYS) for source in scene.sources))
    settled = trace(many, "power", sampling="sobol" if made_of_points else "fan")
    return settled, float(0.5 / np.sqrt(settled.rays))  # upper bound of a fraction's standard error
