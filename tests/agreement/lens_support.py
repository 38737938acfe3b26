"""The paper's sensor in space, with a chip and a lens for skew rays."""

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
    """Return the paper's sensor in space with a chip, a lens and further values of the design."""
    design = Design(name="a", material={"index": 1.44, "absorption_per_mm": values.pop("absorption_per_mm", 0.0)})
    return Sensor.of(with_values(design, CHIP | (lens or {}) | values))


def sampled(scene: Scene | Sensor, angle_deg: float = -1.0, rays: int = RAYS) -> Trace:
    if isinstance(scene, Sensor):
        scene = scene.scene(angle_deg, rays)
    return trace(scene, "power", sampling="sobol")


def contrast(trace: Trace) -> float:
    right, left = (trace.detectors[side].power for side in ("right", "left"))
    return (right - left) / (right + left)


def light(trace: Trace) -> float:
    return sum(reading.power for reading in trace.detectors.values())


def u_contrast(trace: Trace) -> float:
    return 2.0 * trace.u_power / light(trace)
