"""Cycles, ramps and holds are found whatever the protocol, the encoder and the clock do."""

import numpy as np
import pytest

from solen.analysis import find_motion, time_base
from solen.errors import DataError
from tests.analysis.simulated_support import LEVELS, Protocol, Truth, made, part

TRUTHS = {
    "paper": Truth(),
    "noisy encoder": Truth(angle_noise_deg=0.03),
    "coarse encoder": Truth(angle_step_deg=0.1),
    "held at rest": Truth(Protocol(rest_hold_s=0.8)),
    "no hold": Truth(Protocol(hold_s=0.0)),
    "other side first": Truth(Protocol(levels_deg=(0.0, -3.0, 0.0, 3.0))),
    "one side": Truth(Protocol(levels_deg=(0.0, 3.0))),
    "from end to end": Truth(Protocol(levels_deg=(-3.0, 3.0))),
    "other amplitude": Truth(Protocol(levels_deg=(0.0, 10.0, 0.0, -4.0))),
    "stairs": Truth(Protocol(levels_deg=(0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0, -1.0, -2.0, -3.0, -2.0, -1.0))),
    "slow": Truth(Protocol(speed_deg_per_s=0.5), rate_hz=20.0),
    "irregular": Truth(irregular=0.9),
    "few samples": Truth(rate_hz=40.0),
    "away from zero": Truth(Protocol(levels_deg=(90.0, 93.0, 90.0, 87.0))),
}


@pytest.mark.parametrize("name", TRUTHS)
def test_cycles_begin_where_the_protocol_says(name: str) -> None:
    truth = TRUTHS[name]
    signals = made(truth)
    found = find_motion(signals.time_s, signals.angle_deg)
    expected = truth.protocol.starts_s()
    starts = np.array([cycle.start_s for cycle in found.cycles])
    assert len(starts) == len(expected)
    # an edge is where the angle leaves 2 % of its range (or the noise), to a sample
    reach = np.ptp(truth.protocol.levels_deg)
    within = 1.0 / truth.rate_hz + (0.02 * reach + 6.0 * truth.angle_noise_deg) / truth.protocol.speed_deg_per_s
    assert np.abs(starts - expected).max() < 1.6 * within
    ends = np.array([cycle.end_s for cycle in found.cycles])
    assert (ends[:-1] <= starts[1:] + 1e-9).all()
    assert found.rest_deg == pytest.approx(truth.protocol.levels_deg[0], abs=0.06)


@pytest.mark.parametrize("name", [name for name in TRUTHS if name not in {"no hold", "stairs"}])
def test_holds_are_cropped(name: str) -> None:
    """What is left of a hold is at most its first and last sample, and what a ramp's tolerance leaves."""
    truth = TRUTHS[name]
    signals = made(truth)
    found = find_motion(signals.time_s, signals.angle_deg)
    moving = sum(ramp.stop - ramp.start for ramp in found.ramps) / truth.rate_hz
    levels = truth.protocol.levels_deg
    way = sum(abs(a - b) for a, b in zip(levels, (*levels[1:], levels[0]), strict=True))
    truly = truth.protocol.cycles * way / truth.protocol.speed_deg_per_s
    assert moving == pytest.approx(truly, rel=0.12 if truth.rate_hz < 100.0 else 0.05)


def test_an_unfinished_cycle_is_left_out_and_said() -> None:
    signals = made(Truth(Protocol(cycles=4.5)))
    found = find_motion(signals.time_s, signals.angle_deg)
    assert len(found.cycles) == 4
    assert any("incomplete" in warning for warning in found.warnings)


def test_a_recording_that_begins_on_the_way() -> None:
    signals = part(made(Truth()), 1.1, 99.0)
    found = find_motion(signals.time_s, signals.angle_deg)
    assert len(found.cycles) >= 4
    assert found.rest_deg == pytest.approx(0.0, abs=1e-6)


def test_a_growing_amplitude_is_one_cycle_each() -> None:
    levels = [LEVELS[n % 4] * size for size in (1 / 3, 2 / 3, 1.0) for n in range(4)]
    signals = made(Truth(Protocol(levels_deg=tuple(levels), cycles=1)))
    found = find_motion(signals.time_s, signals.angle_deg)
    assert len(found.cycles) == 3


def test_a_spike_of_the_encoder_is_no_cycle() -> None:
    signals = made(Truth())
    signals.angle_deg[700] = 40.0
    assert len(find_motion(signals.time_s, signals.angle_deg).cycles) == 6


def test_set_points_without_a_way_between_them_are_refused() -> None:
    signals = made(Truth(Protocol(speed_deg_per_s=1e5)))
    with pytest.raises(DataError, match="jumps from level to level"):
        find_motion(signals.time_s, signals.angle_deg)


def test_an_angle_that_rests_is_refused() -> None:
    time_s = np.arange(0.0, 10.0, 0.005)
    angle = np.random.default_rng(2).normal(0.0, 0.01, time_s.size)
    with pytest.raises(DataError, match="no cycle can be detected"):
        find_motion(time_s, angle)


def test_gaps_repeats_and_disorder_are_said_with_their_place() -> None:
    time_s = np.arange(0.0, 10.0, 0.005)
    time_s[300] = time_s[299]
    time_s[[500, 501]] = time_s[[501, 500]]
    time_s[1000:] += 2.0
    found = time_base(time_s)
    text = " | ".join(found.warnings)
    assert "1 gap in the samples, the longest 2 s from 4.995 s" in text
    assert "have the same time" in text
    assert "out of order" in text
    assert (np.diff(found.time_s) >= 0.0).all()
    assert found.gaps_s == pytest.approx(np.array([[4.995, 7.0]]))


def test_a_clock_that_was_set_back_is_refused_with_its_sample() -> None:
    time_s = np.arange(0.0, 10.0, 0.005)
    time_s[700:] -= 1.0
    with pytest.raises(DataError, match="jumps back 1 time, farthest at sample 701"):
        time_base(time_s)
