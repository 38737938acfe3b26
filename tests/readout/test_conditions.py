"""Readings in ambient light and at another temperature."""

import numpy as np
import pytest

from solen.readout.circuit import trimmer_part
from solen.readout.readings import readings_of
from tests.readout.circuit_support import paper_design, plain_circuit


@pytest.mark.parametrize("conditions", [{}, {"ambient_mW_cm2": 4.0}, {"temperature_C": 40.0}])
def test_uncertainty_and_irradiance_are_those_in_ambient_light_and_at_the_temperature(
    conditions: dict[str, float],
) -> None:
    circuit, fractions, u = plain_circuit(), np.array([[0.2, 0.1], [0.3, 0.2]]), np.array([1e-4, 2e-4])
    trimmer = trimmer_part(paper_design())
    results = readings_of(circuit, np.array([-1.0, 1.0]), fractions, u, trimmer, **conditions)
    changed = readings_of(circuit, np.array([-1.0, 1.0]), fractions + u[:, None], u, trimmer, **conditions)
    assert results.u_trace_V == pytest.approx(np.abs(changed.voltage_V - results.voltage_V), rel=0.01)
    per_kelvin = 1.0 - 0.0035 * (conditions.get("temperature_C", 25.0) - 25.0)
    assert results.irradiance_mW_per_cm2 == pytest.approx(fractions * 10.0 * per_kelvin, rel=1e-9)
