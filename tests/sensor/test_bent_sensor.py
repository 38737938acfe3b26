"""A bending stem: the ledger is complete, and the response is that of about half the rigid rotation."""

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
def test_small_bend_has_the_response_of_half_the_rigid_rotation(angle_deg: float) -> None:
    """The base rotates by the full angle, and seen from the crotch moves back by half the stem's length times it."""
    rigid, bending = sensor(), sensor(motion=BEND)
    marks = rigid.body().marks
    to_crotch = marks["crotch"][1] - marks["stem-base"][1]
    fraction = (to_crotch - 16.2 / 2) / to_crotch
    assert fraction == pytest.approx(0.494, abs=5e-4)
    bent, rotated = bending.integrate(angle_deg), rigid.integrate(fraction * angle_deg)
    for name in ("right", "left"):
        assert bent.detectors[name].power == pytest.approx(rotated.detectors[name].power, abs=1e-4)
    brighter, darker = ("right", "left") if angle_deg < 0 else ("left", "right")
    assert bent.detectors[brighter].power > bent.detectors[darker].power + 0.1


def test_unbent_sensor_has_exactly_the_powers_of_the_straight_one() -> None:
    bent, straight = sensor(motion=BEND).trace(0.0, "power"), sensor().trace(0.0, "power")
    assert bent.detectors["right"].power == straight.detectors["right"].power
    assert bent.hits == straight.hits


def test_ledgers_of_random_bends_are_complete() -> None:
    rng = np.random.default_rng(7)
    traced = 0
    while traced < 40:
        body = {
            "stem_length_mm": float(rng.uniform(8, 40)),
            "stem_curve_per_mm": float(rng.choice([0.0, rng.uniform(0.0005, 0.006)])),
            "arm_angle_deg": 12.0,
            "arm_width_mm": 1.5,
        }
        motion: dict[str, Any] = dict(BEND)
        if rng.random() < 0.3:
            motion["centre_line"] = [[0, 0], [float(rng.uniform(-1, 1)), 5], [float(rng.uniform(-3, 3)), 10]]
        try:
            trace = sensor(body=body, motion=motion).trace(float(rng.uniform(-40, 40)), "power", 100)
        except DesignError:
            continue
        assert trace.ledger.total == pytest.approx(1.0, abs=1e-9)
        assert trace.undefined == 0
        traced += 1
