"""Quick effects of tolerances equal those from integration of the same numbers."""

import numpy as np
import pytest

from solen.explore.tolerance_effects import combined_change, tolerance_effects
from solen.sensor import Sensor, in_plane
from solen.sensor.effects import with_deviations
from solen.spec import loads, template


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    design = loads(template("solen-860")).set({"motion.step_deg": 1.5, "tolerance.emitter_offset_mm": 0.02})
    return in_plane(Sensor.of(design))


def test_changes_are_those_of_integrated_responses(sensor: Sensor) -> None:
    found = {one.key: one for one in tolerance_effects(sensor)}
    assert {"emitter.offset_mm", "emitter.width_mm", "material.index", "body.arm_width_mm"} <= found.keys()
    assert "receivers.gap_mm" not in found
    for key in ("emitter.offset_mm", "material.index"):
        own = found[key]
        low, high = (
            with_deviations(sensor, {key: sign * own.tolerance}).power(own.angle_deg.tolist()) for sign in (-1, 1)
        )
        exact = 0.5 * (high.contrast - low.contrast)
        u = 0.5 * (high.u_contrast + low.u_contrast)
        assert (np.abs(own.contrast - exact) <= 5 * own.u_contrast + u + 1e-3).all()
        assert own.u_largest < own.largest
    offset = found["emitter.offset_mm"]
    assert offset.largest == max(one.largest for one in found.values())
    assert (combined_change(list(found.values())) >= np.abs(offset.contrast)).all()


def test_it_stops_and_knows_what_the_batch_does_not(sensor: Sensor) -> None:
    assert list(tolerance_effects(sensor, lambda: True)) == []
    assert list(tolerance_effects(sensor.set({"motion.kind": "bend"}))) == []
