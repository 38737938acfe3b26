"""A sensor over many cycles: what ages is found, within its uncertainty, and what does not stays."""

from dataclasses import replace

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, sensor_response
from solen.analysis.ageing import Ageing
from solen.errors import DataError
from tests.analysis.made_support import Protocol, Truth, made

CYCLES, FADES, SHIFTS_DEG = 40, -2e-3, 4e-3
PROTOCOL = Protocol(cycles=CYCLES, hold_s=0.1)


def aged(seed: int, *, ages: bool = True) -> Ageing:
    """Swing falls by 0.2 % a cycle, the null moves by 0.004° a cycle, noise doubles in the second half."""
    truth = Truth(protocol=PROTOCOL, seed=seed, noise_V=0.0)
    signals = made(truth)
    cycle = np.clip((signals.time_s - PROTOCOL.before_s) * CYCLES / np.ptp(signals.time_s), 0.0, CYCLES) * ages
    shape = np.tanh((signals.angle_deg - SHIFTS_DEG * cycle) / truth.width_deg) * (1.0 + FADES * cycle)
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, 0.004, signals.volts.shape) * (1.0 + (cycle > CYCLES / 2))[:, None]
    volts = truth.offset_V + np.column_stack([-shape, shape]) + noise
    found = sensor_response([replace(signals, volts=volts)], AnalysisOptions(every=5, drop=0)).ageing
    assert found is not None
    return found


def test_what_ages_is_found() -> None:
    found = aged(1)
    assert found.first_cycle.tolist() == [1, 6, 11, 16, 21, 26, 31, 36]
    right = found.receivers["right"]
    meant = FADES * 2.0 * np.tanh(1.5)
    assert abs(right.swing_V_per_cycle) == pytest.approx(abs(meant), rel=0.1)
    assert found.balance_deg_per_cycle == pytest.approx(SHIFTS_DEG, abs=4.0 * found.u_balance_deg_per_cycle + 2e-4)
    assert right.noise_V[:3] == pytest.approx(0.004, rel=0.1)
    assert right.noise_V[-3:] == pytest.approx(0.008, rel=0.1)


def test_what_does_not_age_is_within_its_uncertainty() -> None:
    beyond = []
    for seed in range(12):
        found = aged(seed, ages=False)
        one = found.receivers["left"]
        beyond += [
            abs(found.balance_deg_per_cycle) / found.u_balance_deg_per_cycle,
            abs(one.swing_V_per_cycle) / one.u_swing_V_per_cycle,
            abs(one.level_V_per_cycle) / one.u_level_V_per_cycle,
        ]
    assert np.mean(np.array(beyond) < 2.45) > 0.8  # 95 % of a t with 6 degrees of freedom


def test_noise_is_one_thing_for_groups_and_for_all_cycles() -> None:
    """What alternates from reading to reading, as flicker that is left, counts as it is in both."""
    truth = Truth(protocol=Protocol(cycles=10), noise_V=0.003)
    signals = made(truth)
    alternates = 0.004 * (-1.0) ** np.arange(len(signals.volts))[:, None]
    found = sensor_response([replace(signals, volts=signals.volts + alternates)], AnalysisOptions(every=3, drop=0))
    assert found.ageing is not None
    for name, own in found.receivers.items():
        assert own.noise_V == pytest.approx(0.005, rel=0.05)
        assert found.ageing.receivers[name].noise_V == pytest.approx(own.noise_V, rel=0.08)


def test_too_few_cycles_are_refused() -> None:
    with pytest.raises(DataError, match=r"--every = 3; makes 2 groups of 6 cycles, but at least 3"):
        sensor_response([made(Truth(noise_V=0.01))], AnalysisOptions(every=3, drop=0))
