"""Simulated prints: what lies between traced angles is as good as traced."""

from pathlib import Path

import numpy as np
import pytest

from solen.bench.rig import load_rig
from solen.bench.simulated.sensors import ANGLES, MAX_INTERPOLATION_ERROR, simulated_sensors
from solen.sensor import Sensor
from solen.spec import load


@pytest.mark.parametrize("width_mm", [0.0, 0.2])
def test_a_print_is_close_to_its_trace_at_any_angle(bench: Path, width_mm: float) -> None:
    """Twice the bound: midway between two angles it was met, elsewhere an interpolation may be off by a little more."""
    design = bench / "sensor.toml"
    text = design.read_text(encoding="utf-8")
    (bench / "sensor.toml").write_text(text.replace("# width_mm = 0.0", f"width_mm = {width_mm}"), encoding="utf-8")
    one = simulated_sensors(load_rig(bench / "rig.toml"), bench, 1.0, np.random.default_rng(1))[0]
    angles = np.random.default_rng(2).uniform(-1.0, 1.0, 16)
    found = Sensor.of(load(design)).power(angles.tolist())
    off = np.abs(one.at(found.angle_deg) - np.column_stack([found.right, found.left]))
    assert len(one.angle_deg) > ANGLES
    assert np.quantile(off, 0.9) < 2.0 * MAX_INTERPOLATION_ERROR * one.fractions.max()
