"""Cycles, ramps and holds are detected for all protocols, encoders and clocks."""

import numpy as np
import pytest

from solen.analysis import find_motion, time_base
from solen.errors import DataError
from tests.analysis.simulated_support import LEVELS, Protocol, Truth, section, simulated

TRUTHS = {
    "paper": Truth(),
    "noisy encoder": Truth(angle_noise_deg=0.03),
    "coarse encoder": Truth(angle_step_deg=0.1),
    "hold at rest": Truth(Protocol(rest_hold_s=0.8)),
    "no hold": Truth(Protocol(hold_s=0.0)),
    "other side first": Truth(Protocol(levels_deg=(0.0, -3.0, 0.0, 3.0))),
    "one side": Truth(Protocol(levels_deg=(0.0, 3.0))),
    "from end to end": Truth(Protocol(levels_deg=(-3.0, 3.0))),
    "other amplitude": Truth(Protocol(levels_deg=(0.0, 10.0, 0.0, -4.0))),
    "staircase": Truth(Protocol(levels_deg=(0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0, -1.0, -2.0, -3.0, -2.0, -1.0))),
    "slow": Truth(Protocol(speed_deg_per_s=0.5), rate_hz=20.0),
    "irregular": Truth(irregular=0.9),
    "few samples": Truth(rate_hz=40.0),
    "about 90°": Truth(Protocol(levels_deg=(90.0, 93.0, 90.0, 87.0))),
}


@pytest.mark.parametrize("name", TRUTHS)
def test_cycles_start_at_the_times_of_the_protocol(name: str) -> None:
    truth = TRUTHS[name]
    signals = simulated(truth)
    motion = find_motion(signals.time_s, signals.angle_deg)
    expected = truth.protocol.starts_s()
    starts = np.array([cycle.start_s for cycle in motion.cycles])
    assert len(starts) == len(expected)
    # an edge is the first sample that departs by 2 % of the range, or by more than the noise
    departure_deg = 0.02 * np.ptp(truth.protocol.levels_deg) + 6.0 * truth.angle_noise_deg
    tolerance_s = 1.0 / truth.rate_hz + departure_deg / truth.protocol.speed_deg_per_s
    assert np.abs(starts - expected).max() < 1.6 * tolerance_s
    ends = np.array([cycle.end_s for cycle in motion.cycles])
    assert (ends[:-1] <= starts[1:] + 1e-9).all()
    assert motion.rest_deg == pytest.approx(truth.protocol.levels_deg[0], abs=0.06)


@pytest.mark.parametrize("name", [name for name in TRUTHS if name not in {"no hold", "staircase"}])
def test_ramps_do_not_include_holds(name: str) -> None:
    """A ramp includes at most one sample of each adjoining hold, and a few within the tolerance of an edge."""
    truth = TRUTHS[name]
    signals = simulated(truth)
    motion = find_motion(signals.time_s, signals.angle_deg)
    duration_s = sum(ramp.stop - ramp.start for ramp in motion.ramps) / truth.rate_hz
    levels = truth.protocol.levels_deg
    distance = sum(abs(a - b) for a, b in zip(levels, (*levels[1:], levels[0]), strict=True))
    expected_s = truth.protocol.cycles * distance / truth.protocol.speed_deg_per_s
    assert duration_s == pytest.approx(expected_s, rel=0.12 if truth.rate_hz < 100.0 else 0.05)


def test_omits_an_incomplete_cycle_with_a_warning() -> None:
    signals = simulated(Truth(Protocol(cycles=4.5)))
    motion = find_motion(signals.time_s, signals.angle_deg)
    assert len(motion.cycles) == 4
    assert any("incomplete" in warning for warning in motion.warnings)


def test_recording_may_begin_during_a_ramp() -> None:
    signals = section(simulated(Truth()), 1.1, 99.0)
    motion = find_motion(signals.time_s, signals.angle_deg)
    assert len(motion.cycles) >= 4
    assert motion.rest_deg == pytest.approx(0.0, abs=1e-6)


def test_cycles_may_have_different_amplitudes() -> None:
    levels = [LEVELS[n % 4] * factor for factor in (1 / 3, 2 / 3, 1.0) for n in range(4)]
    signals = simulated(Truth(Protocol(levels_deg=tuple(levels), cycles=1)))
    assert len(find_motion(signals.time_s, signals.angle_deg).cycles) == 3


def test_spike_of_the_encoder_is_not_taken_for_a_cycle() -> None:
    signals = simulated(Truth())
    signals.angle_deg[700] = 40.0
    assert len(find_motion(signals.time_s, signals.angle_deg).cycles) == 6


def test_refuses_a_list_of_set_points() -> None:
    signals = simulated(Truth(Protocol(speed_deg_per_s=1e5)))
    with pytest.raises(DataError, match="jumps from level to level"):
        find_motion(signals.time_s, signals.angle_deg)


def test_refuses_a_stationary_angle() -> None:
    time_s = np.arange(0.0, 10.0, 0.005)
    angle = np.random.default_rng(2).normal(0.0, 0.01, time_s.size)
    with pytest.raises(DataError, match="no cycle can be detected"):
        find_motion(time_s, angle)


def test_warns_of_gaps_repeated_times_and_disorder() -> None:
    time_s = np.arange(0.0, 10.0, 0.005)
    time_s[300] = time_s[299]
    time_s[[500, 501]] = time_s[[501, 500]]
    time_s[1000:] += 2.0
    base = time_base(time_s)
    warnings = " | ".join(base.warnings)
    assert "1 gap in the samples, the longest 2 s from 4.995 s" in warnings
    assert "have the same time" in warnings
    assert "out of order" in warnings
    assert (np.diff(base.time_s) >= 0.0).all()
    assert base.gaps_s == pytest.approx(np.array([[4.995, 7.0]]))


def test_refuses_a_clock_that_was_set_back() -> None:
    time_s = np.arange(0.0, 10.0, 0.005)
    time_s[700:] -= 1.0
    with pytest.raises(DataError, match="jumps back 1 time, farthest at sample 701"):
        time_base(time_s)
