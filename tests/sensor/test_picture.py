"""The sensor as it is drawn: rays of the plane, and handles that come where they are dragged."""

import numpy as np
import pytest

from solen.errors import DesignError
from solen.sensor import Sensor, dragged, in_plane, picture
from solen.spec import loads, template
from solen.trace import trace

OFF = {"emitter.offset_mm": 0.05, "body.arm_angle_deg": 9.0}


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    return Sensor.of(loads(template("solen-860")).set(OFF))


@pytest.mark.parametrize("split", [False, True])
def test_the_drawn_rays_end_where_traced_light_does(sensor: Sensor, split: bool) -> None:
    image = picture(sensor, -1.0, 500, split=split)
    x0, z0, x1, z1, power, end = image.rays.T
    last = np.append(np.hypot(x0[1:] - x1[:-1], z0[1:] - z1[:-1]) > 1e-9, True)
    found = trace(in_plane(sensor).scene(-1.0, 500), "power" if split else "count")
    for name in ("right", "left"):
        share = power[last & (end == image.ends.index(name))].sum() / 500
        assert share == pytest.approx(found.detectors[name].power, abs=0.04 if split else 1e-9)
    assert (image.rays[:, :2] >= image.outline.min(axis=0) - 1.5).all()


def test_the_outline_is_the_bodys(sensor: Sensor) -> None:
    image = picture(sensor, 2.0)
    assert sum(points for _, points in image.faces) == len(image.outline)
    body = in_plane(sensor).body(2.0)
    first = dict(image.faces)["lens"]
    assert image.outline[:first][[0, -1]] == pytest.approx(
        np.array([body.face("lens").curve.start, body.face("lens").curve.end])
    )
    width = np.hypot(*(image.emitter[1] - image.emitter[0]))
    assert width == pytest.approx(sensor.light.width_mm)


@pytest.mark.parametrize("handle", ["turn", "emitter", "pivot", "arm-right", "arm-left"])
def test_a_handle_comes_where_it_is_dragged(sensor: Sensor, handle: str) -> None:
    x, z = picture(sensor, 1.5).handles[handle]
    to = picture(sensor, 2.25).handles[handle] if handle == "turn" else (x + 0.2, z - 0.3)
    angle, values = dragged(sensor, handle, to, 1.5)
    there = picture(sensor.set(values), angle).handles[handle]
    assert there == pytest.approx(to, abs=0.02)


def test_a_drag_beyond_the_motion_stops_at_its_end(sensor: Sensor) -> None:
    assert dragged(sensor, "turn", (100.0, -1.0))[0] == 3.0
    assert dragged(sensor, "turn", (-100.0, -1.0))[0] == -3.0


def test_a_handle_that_is_not_there_is_refused() -> None:
    bent = Sensor.of(loads(template("paper-860")).set({"motion.kind": "bend"}))
    assert picture(bent, 1.0).handles == {}
    with pytest.raises(DesignError, match="pivot"):
        dragged(bent, "pivot", (0.0, 0.0))


def test_a_lens_of_space_is_drawn_as_the_oval() -> None:
    sensor = Sensor.of(loads(template("solen-860")).set({"lens.shape": "line-focus"}))
    assert len(picture(sensor).rays) > 200
