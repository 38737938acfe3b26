"""The light budget of a sensor at rest: shares of the emitter's power that add up to 1.

The idea: a ledger cannot separate light reflected by the lens from light that missed everything. Tracing the scene
with black faces and with a black body can. The interface: `budget` of a sensor, which returns a `Budget`.
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
    """Shares of the emitter's power at rest, which add up to 1 within ``u``; without ambient light.

    Attributes
    ----------
    right, left
        At the receivers.
    beside
        Meets nothing: it passes beside the lens and the body.
    above_below
        Passes above or below them, in space.
    reflected
        Is reflected by the body and never enters it.
    leaked
        Leaves it through top or bottom, in space.
    escaped
        Leaves it elsewhere.
    absorbed
        In the material, at walls and at the backs of receivers.
    truncated
        Was followed no further.
    u
        Uncertainty of a share.
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
    """Light budget of a sensor at rest.

    It takes three traces: of the scene itself; with all faces black, so that only light that hits nothing remains; and
    with a body that absorbs all light entering it, so that only light that never enters remains.
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
    """Budget if the trace itself gives the light reflected at the front face; an absorbing body gives the rest.

    A face in space cannot be black.
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
    """The scene with faces that absorb all light."""
    return replace(
        scene,
        interfaces=tuple(
            replace(interface, behaviour="absorbing", receiver=None, surface=None, height_mm=None)
            for interface in scene.interfaces
        ),
    )


def _opaque(scene: Scene) -> Scene:
    """The scene with a body that absorbs all light entering it."""
    regions = tuple(
        replace(region, absorption_per_mm=OPAQUE_PER_MM, scattering_per_mm=0.0) if region.name == "body" else region
        for region in scene.regions
    )
    return replace(scene, regions=regions)


def _settled(scene: Scene) -> tuple[Trace, float]:
    """Powers of a scene, integrated or else sampled, and their uncertainty."""
    if not why_not(scene):
        settled = integrate(scene, "power", TOLERANCE)
        if settled.reached:
            return settled, settled.u_power
    made_of_points = all(source.emission() is not None for source in scene.sources)
    many = scene
    if made_of_points:  # a file has the rays that it has
        many = replace(scene, sources=tuple(source.with_rays(BUDGET_RAYS) for source in scene.sources))
    settled = trace(many, "power", sampling="sobol" if made_of_points else "fan")
    return settled, float(0.5 / np.sqrt(settled.rays))  # no share's standard error is larger
