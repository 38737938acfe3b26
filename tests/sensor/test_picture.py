"""The drawing of a sensor: rays in the plane, and handles that follow a drag."""

import json
from pathlib import Path

import numpy as np
import pytest

from solen.errors import DesignError
from solen.plane import Point
from solen.sensor import Sensor, dragged, in_plane, picture
from solen.spec import loads, template
from solen.trace import trace

VALUES = {"emitter.offset_mm": 0.05, "body.arm_angle_deg": 9.0}


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    return Sensor.of(loads(template("solen-860")).set(VALUES))


@pytest.mark.parametrize("split", [False, True])
def test_drawn_rays_end_at_the_traced_receivers(sensor: Sensor, split: bool) -> None:
    drawing = picture(sensor, -1.0, 500, split=split)
    x0, z0, x1, z1, power, end = drawing.rays.T
    last = np.append(np.hypot(x0[1:] - x1[:-1], z0[1:] - z1[:-1]) > 1e-9, True)
    traced = trace(in_plane(sensor).scene(-1.0, 500), "power" if split else "count")
    for name in ("right", "left"):
        fraction = power[last & (end == drawing.ends.index(name))].sum() / 500
        assert fraction == pytest.approx(traced.detectors[name].power, abs=0.04 if split else 1e-9)
    assert (drawing.rays[:, :2] >= drawing.outline.min(axis=0) - 1.5).all()


def test_outline_is_that_of_the_body(sensor: Sensor) -> None:
    drawing = picture(sensor, 2.0)
    assert sum(points for _, points in drawing.faces) == len(drawing.outline)
    body = in_plane(sensor).body(2.0)
    lens_points = dict(drawing.faces)["lens"]
    assert drawing.outline[:lens_points][[0, -1]] == pytest.approx(
        np.array([body.face("lens").curve.start, body.face("lens").curve.end])
    )
    width = np.hypot(*(drawing.emitter[1] - drawing.emitter[0]))
    assert width == pytest.approx(sensor.light.width_mm)


@pytest.mark.parametrize("handle", ["turn", "emitter", "pivot", "arm-right", "arm-left"])
def test_handle_follows_a_drag(sensor: Sensor, handle: str) -> None:
    x, z = picture(sensor, 1.5).handles[handle]
    to = picture(sensor, 2.25).handles[handle] if handle == "turn" else (x + 0.2, z - 0.3)
    angle, values = dragged(sensor, handle, to, 1.5)
    position = picture(sensor.set(values), angle).handles[handle]
    assert position == pytest.approx(to, abs=0.02)


def test_drag_stops_at_the_end_of_the_motion(sensor: Sensor) -> None:
    assert dragged(sensor, "turn", (100.0, -1.0))[0] == 3.0
    assert dragged(sensor, "turn", (-100.0, -1.0))[0] == -3.0


def dragged_three_times(sensor: Sensor, handle: str, to: Point, angle_deg: float = 0.0) -> Point:
    """Position of a handle after three steps of a drag, as an emitter's distance changes the lens and so the base."""
    for _ in range(3):
        sensor = sensor.set(dragged(sensor, handle, to, angle_deg)[1])
    return picture(sensor, angle_deg).handles[handle]


def test_bend_follows_a_drag(sensor: Sensor) -> None:
    bent = sensor.set({"motion.kind": "bend", "motion.to_deg": 20.0})
    angle, values = dragged(bent, "turn", picture(bent, 12.5).handles["turn"], 3.0)
    assert (angle, values) == (12.5, {})
    assert dragged(bent, "turn", (100.0, -1.0))[0] == 20.0
    x, z = picture(bent, 12.5).handles["emitter"]
    assert dragged_three_times(bent, "emitter", (x + 0.1, z - 0.2), 12.5) == pytest.approx(
        (x + 0.1, z - 0.2), abs=0.002
    )
    with pytest.raises(DesignError, match="pivot"):
        dragged(bent, "pivot", (0.0, 0.0))


THROUGH = {
    "network.nodes[5].at_mm": [-11.0, 22.5],
    "network.guides[1].direction_deg": None,
    "network.guides[1].length_mm": None,
    "network.guides[1].through_mm": [[-5.5, 20.0]],
}
SLAB = {
    "solen_outline": 1,
    "faces": [
        {"name": name, "curve": {"kind": "segment", "a": a, "b": b}}
        for name, a, b in (
            ("lens", [2.0, 0.0], [-2.0, 0.0]),
            ("wall", [-2.0, 0.0], [-2.0, 9.0]),
            ("receiver-left", [-2.0, 9.0], [0.0, 9.0]),
            ("receiver-right", [0.0, 9.0], [2.0, 9.0]),
            ("wall", [2.0, 9.0], [2.0, 0.0]),
        )
    ],
    "emitters": [{"point": [0.2, -1.0], "axis_deg": 5.0, "width_mm": 0.3}],
}
OUTLINE = """schema = 1
name = "drawn"
[material]
index = 1.44
[body]
kind = "outline"
file = "slab.json"
[emitter]
pattern = "lambertian"
[motion]
moves = ["emitter"]
pivot = [0.5, 2.0]
"""


def test_emitter_and_motion_of_an_outline_follow_a_drag(tmp_path: Path) -> None:
    """The direction and the width of a drawn emitter are unchanged."""
    (tmp_path / "slab.json").write_text(json.dumps(SLAB), encoding="utf-8")
    outline_sensor = Sensor.of(loads(OUTLINE, folder=tmp_path))
    drawing = picture(outline_sensor, 2.0)
    assert list(drawing.handles) == ["turn", "pivot", "emitter"]
    x, z = drawing.handles["emitter"]
    _, values = dragged(outline_sensor, "emitter", (x + 0.1, z - 0.2), 2.0)
    moved = picture(outline_sensor.set(values), 2.0)
    assert moved.handles["emitter"] == pytest.approx((x + 0.1, z - 0.2), abs=0.002)
    assert moved.emitter - drawing.emitter == pytest.approx(np.tile([0.1, -0.2], (2, 1)), abs=0.002)
    assert dragged(outline_sensor, "turn", picture(outline_sensor, 1.25).handles["turn"])[0] == 1.25


@pytest.fixture(scope="module")
def network_sensor() -> Sensor:
    return Sensor.of(loads(template("hand-860")).set(THROUGH))


@pytest.mark.parametrize(
    "handle",
    ["node-thumb-tip", "node-index-tip", "node-ring-tip", "emitter-index", "receiver-ring-side", "through-thumb-1"],
)
def test_parts_of_a_network_follow_a_drag(network_sensor: Sensor, handle: str) -> None:
    """With bent fingers too, a handle moves to where it is dragged, or along the side that it is on."""
    angle = 0.0 if handle.startswith("through") else 6.0
    bent = network_sensor.set(
        {"network.motion[0].at_deg": angle, "network.motion[1].at_deg": -angle, "network.lit": "index"}
    )
    x, z = picture(bent).handles[handle]
    shift = (0.1, -0.2)
    if handle.startswith("receiver"):
        face = bent.body().face("receiver-ring-side").curve
        shift = tuple(np.subtract(face.end, face.start) / 8.0)
    to = (x + shift[0], z + shift[1])
    assert dragged_three_times(bent, handle, to) == pytest.approx(to, abs=0.01)


def test_lens_that_is_not_a_cylinder_is_drawn_as_the_oval() -> None:
    sensor = Sensor.of(loads(template("solen-860")).set({"lens.shape": "line-focus"}))
    assert len(picture(sensor).rays) > 200
