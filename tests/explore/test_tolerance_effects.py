"""Quick estimates of the effects of tolerances, compared with integration."""

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


def test_effects_agree_with_integration(sensor: Sensor) -> None:
    effects = {effect.key: effect for effect in tolerance_effects(sensor)}
    assert {"emitter.offset_mm", "emitter.width_mm", "material.index", "body.arm_width_mm"} <= effects.keys()
    assert "receivers.gap_mm" not in effects
    for key in ("emitter.offset_mm", "material.index"):
        effect = effects[key]
        low, high = (
            with_deviations(sensor, {key: sign * effect.tolerance}).power(effect.angle_deg.tolist()) for sign in (-1, 1)
        )
        exact = 0.5 * (high.contrast - low.contrast)
        u = 0.5 * (high.u_contrast + low.u_contrast)
        assert (np.abs(effect.contrast - exact) <= 5 * effect.u_contrast + u + 1e-3).all()
        assert effect.u_largest < effect.largest
    offset = effects["emitter.offset_mm"]
    assert offset.largest == max(effect.largest for effect in effects.values())
    assert (combined_change(list(effects.values())) >= np.abs(offset.contrast)).all()


def test_stops_on_request_and_omits_unsupported_motion(sensor: Sensor) -> None:
    assert list(tolerance_effects(sensor, lambda: True)) == []
    assert list(tolerance_effects(sensor.set({"motion.kind": "bend"}))) == []
