"""Responses of a design while it is being changed: uncertainty, end of the refinement, and error of the plane."""

import numpy as np
import pytest

from solen.errors import DesignError
from solen.explore.live import GOAL, coarse, planar_model_error, refined
from solen.sensor import Sensor, as_built, in_plane
from solen.spec import loads, template

FEW_ANGLES = {"motion.step_deg": 1.0}


@pytest.fixture(scope="module")
def chip() -> Sensor:
    return Sensor.of(loads(template("solen-860")).set({**FEW_ANGLES, "emitter.offset_mm": 0.02}))


def test_coarse_and_refined_responses_agree_with_integration(chip: Sensor) -> None:
    planar = in_plane(chip)
    exact = planar.power()
    first, *_, last = [coarse(planar), *refined(planar)]
    assert first is not None
    assert last.finished
    for curve in (first, last):
        difference = np.abs(curve.response.contrast - exact.contrast)
        assert (difference <= 4.0 * (curve.response.u_contrast + exact.u_contrast)).all()
    assert last.response.u_contrast.max() <= GOAL
    assert first.response.u_contrast.max() > last.response.u_contrast.max()
    assert last.merits is not None
    assert last.merits.slope_per_deg < 0.0


def test_reports_error_of_planar_model(chip: Sensor) -> None:
    plane, space = coarse(in_plane(chip), 2**13), coarse(as_built(chip), 2**13)
    assert plane is not None
    assert space is not None
    sentence = planar_model_error(plane.response, space.response)
    assert "plane" in sentence
    assert planar_model_error(space.response, space.response) == ""


def test_refinement_stops_on_request(chip: Sensor) -> None:
    calls: list[bool] = []

    def stop() -> bool:
        calls.append(True)
        return len(calls) > 1

    assert len(list(refined(in_plane(chip), stop))) <= 1
    bent = Sensor.of(loads(template("paper-860")).set({**FEW_ANGLES, "motion.kind": "bend"}))
    assert coarse(bent) is None
    assert list(refined(bent, lambda: True)) == []


def test_refuses_impossible_motion(chip: Sensor) -> None:
    impossible = Sensor.of(chip.design.set({"motion.from_deg": -80.0, "motion.to_deg": 80.0, "motion.step_deg": 10.0}))
    with pytest.raises(DesignError):
        coarse(in_plane(impossible))
