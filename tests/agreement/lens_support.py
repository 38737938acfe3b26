"""The paper's sensor with a lens for space and a chip, for tests of its light."""

from solen.scene import Scene
from solen.sensor import Sensor
from solen.spec import Design, with_values
from solen.trace import Trace, trace

PAPER = {"distance_mm": 1.0, "focus_mm": 20.0, "half_width_mm": 2.0, "design_index": 1.44}
CHIP = {
    "emitter.pattern": "lambertian",
    "emitter.cone_deg": 120.0,
    "emitter.width_mm": 0.2,
    "emitter.height_mm": 0.2,
    "trace.dimension": "extruded",
}
LINE: dict[str, object] = {"lens.shape": "line-focus", "lens.y_focus_mm": 2.0}
LAYERED: dict[str, object] = {"lens.shape": "layered"}
RAYS = 2**16


def sensor(lens: dict[str, object] | None = None, /, **values: object) -> Sensor:
    """The paper's sensor in space with a chip, by its lens and by other keys of the design."""
    plain = Design(name="a", material={"index": 1.44, "absorption_per_mm": values.pop("absorption_per_mm", 0.0)})
    return Sensor.of(with_values(plain, CHIP | (lens or {}) | values))


def sampled(of: Sensor | Scene, angle_deg: float = -1.0, rays: int = RAYS) -> Trace:
    scene = of.scene(angle_deg, rays) if isinstance(of, Sensor) else of
    return trace(scene, "power", sampling="sobol")


def contrast(found: Trace) -> float:
    right, left = (found.detectors[side].power for side in ("right", "left"))
    return (right - left) / (right + left)


def light(found: Trace) -> float:
    return sum(reading.power for reading in found.detectors.values())


def u_contrast(found: Trace) -> float:
    return 2.0 * found.u_power / light(found)
