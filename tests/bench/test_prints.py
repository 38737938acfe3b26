"""Simulated sensors: the interpolation between traced angles is close to a trace."""

from pathlib import Path

import numpy as np
import pytest

from solen.bench.rig import load_rig
from solen.bench.simulated.sensors import ANGLES, MAX_INTERPOLATION_ERROR, simulated_sensors
from solen.sensor import Sensor
from solen.spec import load


@pytest.mark.parametrize("width_mm", [0.0, 0.2])
def test_interpolation_is_close_to_trace(bench: Path, width_mm: float) -> None:
    """The tolerance is twice that midway between two angles, because the error may be largest elsewhere."""
    design = bench / "sensor.toml"
    text = design.read_text(encoding="utf-8")
    (bench / "sensor.toml").write_text(text.replace("# width_mm = 0.0", f"width_mm = {width_mm}"), encoding="utf-8")
    sensor = simulated_sensors(load_rig(bench / "rig.toml"), bench, 1.0, np.random.default_rng(1))[0]
    angles = np.random.default_rng(2).uniform(-1.0, 1.0, 16)
    traced = Sensor.of(load(design)).power(angles.tolist())
    error = np.abs(sensor.at(traced.angle_deg) - np.column_stack([traced.right, traced.left]))
    assert len(sensor.angle_deg) > ANGLES
    assert np.quantile(error, 0.9) < 2.0 * MAX_INTERPOLATION_ERROR * sensor.fractions.max()
