"""Timing and hysteresis: bounded at one speed, told apart at two."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, SensorResponse, Signals, sensor_response
from solen.analysis.timing import at_main_speed
from solen.arrays import FloatArray
from tests.analysis.simulated_support import Protocol


@dataclass(frozen=True)
class Two:
    """A recording of fast and slow cycles: what is late, and what is left of the way before."""

    lag_s: float = 0.0
    hysteresis_V: float = 0.0
    fast: int = 6
    slow: int = 3
    noise_V: float = 0.002
    seed: int = 1
    looks_s: float = 0.0

    def signals(self) -> Signals:
        """Left and right of a response that bends, at 200 Hz."""
        draw = np.random.default_rng(self.seed)
        parts = [Protocol(cycles=self.fast), Protocol(cycles=self.slow, speed_deg_per_s=5.0, before_s=0.0)]
        times, angles = np.zeros(1), np.zeros(1)
        for part in (one for one in parts if one.cycles):
            t, a = part.corners()
            times, angles = np.append(times, times[-1] + 1e-6 + t), np.append(angles, a)
        time_s = np.arange(0.0, times[-1], 0.005)
        angle = np.interp(time_s, times, angles)
        late = np.interp(time_s - self.lag_s, times, angles)
        way = np.sign(np.gradient(late))
        last = np.maximum.accumulate(np.where(way != 0.0, np.arange(way.size), 0))
        shape: FloatArray = np.tanh(late / 2.0)
        shift = 0.5 * self.hysteresis_V * way[last] * (1.0 - (late / 3.0) ** 2)
        volts = np.column_stack([2.0 - shape + shift, 2.0 + 1.2 * shape + shift])
        volts += self.noise_V * draw.standard_normal(volts.shape)
        if self.looks_s:
            place = np.searchsorted(time_s, np.floor(time_s / self.looks_s) * self.looks_s)
            angle = angle[place]
        return Signals("S1", ("left", "right"), time_s, angle, volts, source="S1.csv")


def found_of(two: Two) -> SensorResponse:
    return sensor_response([two.signals()], AnalysisOptions())


@pytest.mark.parametrize(("lag_s", "hysteresis_V"), [(0.0, 0.0), (0.016, 0.0), (0.0, 0.1), (0.016, 0.1), (-0.01, 0.05)])
def test_two_speeds_tell_a_lag_from_a_hysteresis(lag_s: float, hysteresis_V: float) -> None:
    """16 ms at 15°/s are 0.24° and show a hysteresis of 0.12 V, some 7 % of full scale, where there is none."""
    found = found_of(Two(lag_s, hysteresis_V))
    timing = found.timing
    assert timing.separated
    assert timing.speeds_deg_per_s == pytest.approx((5.0, 15.0), rel=0.03)
    assert abs(timing.lag_s - lag_s) < 3.6 * timing.u_lag_s + 1e-4  # t with 6 degrees of freedom, 99 %
    assert timing.u_lag_s < 1e-3
    for name, one in found.receivers.items():
        own = timing.receivers[name]
        assert own.hysteresis_V == pytest.approx(hysteresis_V, abs=max(4.0 * own.u_hysteresis_V, 0.006))
        if hysteresis_V == 0.0 and lag_s:
            assert one.hysteresis_percent > 3.0
            assert own.hysteresis_percent < 0.5
    assert not any("speed" in line for line in found.warnings)


def test_intervals_of_a_lag_by_two_speeds_hold() -> None:
    pulls = []
    for seed in range(40):
        timing = found_of(Two(0.008, 0.05, noise_V=0.01, seed=seed)).timing
        pulls.append(abs(timing.lag_s - 0.008) / timing.u_lag_s)
    assert sum(pull > 2.45 for pull in pulls) <= 6  # t with 6 degrees of freedom; 2 of 40 expected


def test_figures_of_merit_are_of_one_speed() -> None:
    """A lag moves fast and slow ways apart; what they have in common is no scatter of the sensor."""
    both, fast = found_of(Two(0.016)), found_of(Two(0.016, slow=0))
    assert (both.runs[0].used, both.runs[0].timed) == (tuple(range(1, 6)), tuple(range(1, 9)))
    assert both.cycles_used == fast.cycles_used == 5
    for name, own in both.receivers.items():
        alone = fast.receivers[name]
        assert own.mean_V == pytest.approx(alone.mean_V, abs=0.004)
        assert own.repeatability_percent == pytest.approx(alone.repeatability_percent, rel=0.1)


@pytest.mark.parametrize(
    ("speeds", "used"),
    [
        ([15, 15, 14.9, 5, 5], [1, 1, 1, 0, 0]),
        ([15, 15, 5, 5], [1, 1, 0, 0]),
        ([5, 5, 5, 15, 15], [1, 1, 1, 0, 0]),
        ([15, 13, 11, 9, 6, 5], [1, 1, 1, 1, 1, 1]),  # turned by hand: no second speed was meant
        ([15, 14.9, 12, 15, 11], [1, 1, 1, 1, 1]),
        ([15, 5, 30], [1, 1, 1]),
    ],
)
def test_the_speed_of_most_cycles_is_the_main_one(speeds: list[float], used: list[int]) -> None:
    assert at_main_speed(np.array(speeds, dtype=np.float64)).tolist() == [bool(one) for one in used]


def test_angles_across_corners_are_in_the_uncertainty_of_a_lag() -> None:
    """A stage that is asked every 20 ms: straight lines between its answers cut the corners of every cycle alike."""
    two = Two(noise_V=1e-5)
    signals = two.signals()
    coarse = np.arange(signals.time_s[0], signals.time_s[-1], 0.0203)
    cut = np.interp(signals.time_s, coarse, np.interp(coarse, signals.time_s, signals.angle_deg))
    timing = sensor_response([replace(signals, angle_deg=cut)], AnalysisOptions()).timing
    assert abs(timing.lag_s) < 3.0 * timing.u_lag_s


def test_at_one_speed_nothing_can() -> None:
    found = found_of(Two(0.016, 0.0, slow=0))
    assert not found.timing.separated
    assert np.isnan(found.timing.receivers["left"].hysteresis_V)
    assert any("at a single speed" in line for line in found.warnings)


def test_looks_at_the_stage_bound_what_timing_adds() -> None:
    """A stage that is asked every 30 ms: the angle of a row is up to 30 ms old, 15 ± 15 ms."""
    found = found_of(Two(slow=0, looks_s=0.03))
    timing = found.timing
    assert timing.source == "angle"
    assert timing.bound_s == pytest.approx(0.015, rel=0.15)
    assert timing.timing_deg == pytest.approx(2.0 * 15.0 * timing.bound_s, rel=0.05)
    for name, one in found.receivers.items():
        assert one.hysteresis_V <= timing.receivers[name].timing_V * 1.05
    assert any("at a single speed" in line for line in found.warnings)


def test_a_bound_that_a_bench_states_is_taken() -> None:
    signals = replace(Two(slow=0).signals(), timing_bound_s=(0.004, "recording"))
    timing = sensor_response([signals], AnalysisOptions()).timing
    assert (timing.bound_s, timing.source) == (0.004, "recording")
    assert timing.timing_deg == pytest.approx(0.12, rel=0.02)


def test_a_speed_whose_cycles_are_all_left_out_is_stated() -> None:
    found = found_of(Two(0.016, fast=1, slow=2))
    (lost,) = [line for line in found.warnings if "--drop 1" in line]
    assert "1 cycle at 15" in lost
    assert "figures are for 5" in lost
    assert sum("at a single speed (5°/s)" in line for line in found.warnings) == 1
    few = found_of(Two(0.016, fast=2, slow=1))
    assert not any("at a single speed" in line or "--drop" in line for line in few.warnings)
