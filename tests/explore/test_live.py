"""Responses of a design that is being changed: rough ones are right within their uncertainty, and refining ends."""

import numpy as np
import pytest

from solen.errors import DesignError
from solen.explore.live import GOAL, coarse, planar_model_error, refined
from solen.sensor import Sensor, as_built, in_plane
from solen.spec import loads, template

FEW = {"motion.step_deg": 1.0}


@pytest.fixture(scope="module")
def chip() -> Sensor:
    return Sensor.of(loads(template("solen-860")).set({**FEW, "emitter.offset_mm": 0.02}))


def test_rough_and_refined_responses_agree_with_the_integral(chip: Sensor) -> None:
    flat = in_plane(chip)
    exact = flat.power()
    rough, *_, last = [coarse(flat), *refined(flat)]
    assert rough is not None
    assert last.finished
    for curve, wide in ((rough, 4.0), (last, 4.0)):
        off = np.abs(curve.response.contrast - exact.contrast)
        assert (off <= wide * (curve.response.u_contrast + exact.u_contrast)).all()
    assert last.response.u_contrast.max() <= GOAL
    assert rough.response.u_contrast.max() > last.response.u_contrast.max()
    assert last.merits is not None
    assert last.merits.slope_per_deg < 0.0


def test_the_plane_misleads_of_the_shipped_design_and_not_of_a_point_beside_itself(chip: Sensor) -> None:
    plane, space = coarse(in_plane(chip), 2**13), coarse(as_built(chip), 2**13)
    assert plane is not None
    assert space is not None
    words = planar_model_error(plane.response, space.response)
    assert "plane" in words
    assert planar_model_error(space.response, space.response) == ""


def test_refining_ends_when_it_is_stopped(chip: Sensor) -> None:
    asked: list[bool] = []

    def stop() -> bool:
        asked.append(True)
        return len(asked) > 1

    assert len(list(refined(in_plane(chip), stop))) <= 1
    bent = Sensor.of(loads(template("paper-860")).set({**FEW, "motion.kind": "bend"}))
    assert coarse(bent) is None
    assert list(refined(bent, lambda: True)) == []


def test_a_body_that_cannot_turn_so_far_is_refused(chip: Sensor) -> None:
    far = Sensor.of(chip.design.set({"motion.from_deg": -80.0, "motion.to_deg": 80.0, "motion.step_deg": 10.0}))
    with pytest.raises(DesignError):
        coarse(in_plane(far))
