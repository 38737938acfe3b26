"""A stem that bends: the ledger stays whole, and the response is that of about half the rigid turn."""

from typing import Any

import numpy as np
import pytest

from solen.errors import DesignError
from solen.sensor import Sensor
from solen.spec import Design

BEND = {"kind": "bend"}


def sensor(**tables: Any) -> Sensor:
    return Sensor.of(Design.model_validate({"name": "test", "material": {"index": 1.44}} | tables))


@pytest.mark.parametrize("angle_deg", [-0.2, -0.8, 0.4])
def test_a_small_bend_is_a_rigid_turn_by_the_share_that_the_crotch_sees(angle_deg: float) -> None:
    """The base turns by the whole angle but moves back by half the stem's length times it, seen from the crotch."""
    rigid, bending = sensor(), sensor(motion=BEND)
    marks = rigid.body().marks
    to_crotch = marks["crotch"][1] - marks["stem-base"][1]
    share = (to_crotch - 16.2 / 2) / to_crotch
    assert share == pytest.approx(0.494, abs=5e-4)
    bent, turned = bending.integrate(angle_deg), rigid.integrate(share * angle_deg)
    for name in ("right", "left"):
        assert bent.detectors[name].power == pytest.approx(turned.detectors[name].power, abs=1e-4)
    brighter, darker = ("right", "left") if angle_deg < 0 else ("left", "right")
    assert bent.detectors[brighter].power > bent.detectors[darker].power + 0.1


def test_without_an_angle_the_bent_sensor_is_the_straight_one_to_the_last_bit() -> None:
    bent, straight = sensor(motion=BEND).trace(0.0, "power"), sensor().trace(0.0, "power")
    assert bent.detectors["right"].power == straight.detectors["right"].power
    assert bent.hits == straight.hits


def test_a_hundred_bends_keep_the_ledger_whole() -> None:
    draw = np.random.default_rng(7)
    traced = 0
    while traced < 100:
        body = {
            "stem_length_mm": float(draw.uniform(8, 40)),
            "stem_curve_per_mm": float(draw.choice([0.0, draw.uniform(0.0005, 0.006)])),
            "arm_angle_deg": 12.0,
            "arm_width_mm": 1.5,
        }
        motion: dict[str, Any] = dict(BEND)
        if draw.random() < 0.3:
            motion["centre_line"] = [[0, 0], [float(draw.uniform(-1, 1)), 5], [float(draw.uniform(-3, 3)), 10]]
        try:
            found = sensor(body=body, motion=motion).trace(float(draw.uniform(-40, 40)), "power", 100)
        except DesignError:
            continue
        assert found.ledger.total == pytest.approx(1.0, abs=1e-9)
        assert found.undefined == 0
        traced += 1
