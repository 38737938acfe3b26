"""Ageing over many cycles: changes, or their absence, are determined within the uncertainties."""

from dataclasses import replace

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, sensor_response
from solen.analysis.ageing import Ageing
from solen.errors import DataError
from tests.analysis.simulated_support import Protocol, Truth, simulated

CYCLES, SWING_PER_CYCLE, DEG_PER_CYCLE = 40, -2e-3, 4e-3
PROTOCOL = Protocol(cycles=CYCLES, hold_s=0.1)


def ageing(seed: int, *, ages: bool = True) -> Ageing:
    """Return the ageing of a sensor.

    Per cycle the swing falls by 0.2 % and the balance shifts by 0.004°; the noise doubles in the second half.
    """
    truth = Truth(protocol=PROTOCOL, seed=seed, noise_V=0.0)
    signals = simulated(truth)
    cycle = np.clip((signals.time_s - PROTOCOL.before_s) * CYCLES / np.ptp(signals.time_s), 0.0, CYCLES) * ages
    shape = np.tanh((signals.angle_deg - DEG_PER_CYCLE * cycle) / truth.width_deg) * (1.0 + SWING_PER_CYCLE * cycle)
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, 0.004, signals.volts.shape) * (1.0 + (cycle > CYCLES / 2))[:, None]
    volts = truth.offset_V + np.column_stack([-shape, shape]) + noise
    result = sensor_response([replace(signals, volts=volts)], AnalysisOptions(every=5, drop=0)).ageing
    assert result is not None
    return result


def test_determines_changes_of_swing_balance_and_noise() -> None:
    result = ageing(1)
    assert result.first_cycle.tolist() == [1, 6, 11, 16, 21, 26, 31, 36]
    right = result.receivers["right"]
    expected = SWING_PER_CYCLE * 2.0 * np.tanh(1.5)
    assert abs(right.swing_V_per_cycle) == pytest.approx(abs(expected), rel=0.1)
    assert result.balance_deg_per_cycle == pytest.approx(DEG_PER_CYCLE, abs=4.0 * result.u_balance_deg_per_cycle + 2e-4)
    assert right.noise_V[:3] == pytest.approx(0.004, rel=0.1)
    assert right.noise_V[-3:] == pytest.approx(0.008, rel=0.1)


def test_changes_are_within_their_uncertainties_without_ageing() -> None:
    ratios = []
    for seed in range(12):
        result = ageing(seed, ages=False)
        left = result.receivers["left"]
        ratios += [
            abs(result.balance_deg_per_cycle) / result.u_balance_deg_per_cycle,
            abs(left.swing_V_per_cycle) / left.u_swing_V_per_cycle,
            abs(left.level_V_per_cycle) / left.u_level_V_per_cycle,
        ]
    assert np.mean(np.array(ratios) < 2.45) > 0.8  # 95 % limit of the t distribution with 6 degrees of freedom


def test_noise_has_the_same_definition_for_groups_and_for_all_cycles() -> None:
    """A residual flicker that alternates from reading to reading contributes to both."""
    truth = Truth(protocol=Protocol(cycles=10), noise_V=0.003)
    signals = simulated(truth)
    flicker = 0.004 * (-1.0) ** np.arange(len(signals.volts))[:, None]
    response = sensor_response([replace(signals, volts=signals.volts + flicker)], AnalysisOptions(every=3, drop=0))
    assert response.ageing is not None
    for name, receiver in response.receivers.items():
        assert receiver.noise_V == pytest.approx(0.005, rel=0.05)
        assert response.ageing.receivers[name].noise_V == pytest.approx(receiver.noise_V, rel=0.08)


def test_refuses_too_few_groups() -> None:
    with pytest.raises(DataError, match=r"--every = 3; makes 2 groups of 6 cycles, but at least 3"):
        sensor_response([simulated(Truth(noise_V=0.01))], AnalysisOptions(every=3, drop=0))
