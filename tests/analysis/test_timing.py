"""Timing and hysteresis: an upper bound from one speed, separated by two speeds."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, SensorResponse, Signals, sensor_response
from solen.analysis.timing import at_main_speed
from solen.arrays import FloatArray
from tests.analysis.simulated_support import Protocol


@dataclass(frozen=True)
class TwoSpeeds:
    """A recording of fast and slow cycles with lag and hysteresis.

    With ``update_s``, the recorded angle is updated only at this interval.
    """

    lag_s: float = 0.0
    hysteresis_V: float = 0.0
    fast: int = 6
    slow: int = 3
    noise_V: float = 0.002
    seed: int = 1
    update_s: float = 0.0

    def signals(self) -> Signals:
        """Return the signals of a left and a right receiver at 200 Hz."""
        rng = np.random.default_rng(self.seed)
        protocols = [Protocol(cycles=self.fast), Protocol(cycles=self.slow, speed_deg_per_s=5.0, before_s=0.0)]
        times, angles = np.zeros(1), np.zeros(1)
        for protocol in (protocol for protocol in protocols if protocol.cycles):
            t, a = protocol.corners()
            times, angles = np.append(times, times[-1] + 1e-6 + t), np.append(angles, a)
        time_s = np.arange(0.0, times[-1], 0.005)
        angle = np.interp(time_s, times, angles)
        delayed = np.interp(time_s - self.lag_s, times, angles)
        direction = np.sign(np.gradient(delayed))
        last = np.maximum.accumulate(np.where(direction != 0.0, np.arange(direction.size), 0))
        shape: FloatArray = np.tanh(delayed / 2.0)
        shift = 0.5 * self.hysteresis_V * direction[last] * (1.0 - (delayed / 3.0) ** 2)
        volts = np.column_stack([2.0 - shape + shift, 2.0 + 1.2 * shape + shift])
        volts += self.noise_V * rng.standard_normal(volts.shape)
        if self.update_s:
            updates = np.searchsorted(time_s, np.floor(time_s / self.update_s) * self.update_s)
            angle = angle[updates]
        return Signals("S1", ("left", "right"), time_s, angle, volts, source="S1.csv")


def response_of(recording: TwoSpeeds) -> SensorResponse:
    return sensor_response([recording.signals()], AnalysisOptions())


@pytest.mark.parametrize(("lag_s", "hysteresis_V"), [(0.0, 0.0), (0.016, 0.0), (0.0, 0.1), (0.016, 0.1), (-0.01, 0.05)])
def test_two_speeds_separate_lag_and_hysteresis(lag_s: float, hysteresis_V: float) -> None:
    """16 ms at 15°/s are 0.24° and look like a hysteresis of 0.12 V, about 7 % of full scale."""
    response = response_of(TwoSpeeds(lag_s, hysteresis_V))
    timing = response.timing
    assert timing.separated
    assert timing.speeds_deg_per_s == pytest.approx((5.0, 15.0), rel=0.03)
    assert abs(timing.lag_s - lag_s) < 3.6 * timing.u_lag_s + 1e-4  # t with 6 degrees of freedom, 99 %
    assert timing.u_lag_s < 1e-3
    for name, receiver in response.receivers.items():
        corrected = timing.receivers[name]
        assert corrected.hysteresis_V == pytest.approx(hysteresis_V, abs=max(4.0 * corrected.u_hysteresis_V, 0.006))
        if hysteresis_V == 0.0 and lag_s:
            assert receiver.hysteresis_percent > 3.0
            assert corrected.hysteresis_percent < 0.5
    assert not any("speed" in line for line in response.warnings)


def test_intervals_of_the_lag_have_their_coverage() -> None:
    ratios = []
    for seed in range(40):
        timing = response_of(TwoSpeeds(0.008, 0.05, noise_V=0.01, seed=seed)).timing
        ratios.append(abs(timing.lag_s - 0.008) / timing.u_lag_s)
    assert sum(ratio > 2.45 for ratio in ratios) <= 6  # t with 6 degrees of freedom; 2 of 40 expected


def test_figures_of_merit_refer_to_one_speed() -> None:
    """A lag separates fast and slow ramps, which would otherwise appear as scatter of the sensor."""
    both, fast = response_of(TwoSpeeds(0.016)), response_of(TwoSpeeds(0.016, slow=0))
    assert (both.runs[0].used, both.runs[0].timed) == (tuple(range(1, 6)), tuple(range(1, 9)))
    assert both.cycles_used == fast.cycles_used == 5
    for name, receiver in both.receivers.items():
        expected = fast.receivers[name]
        assert receiver.mean_V == pytest.approx(expected.mean_V, abs=0.004)
        assert receiver.repeatability_percent == pytest.approx(expected.repeatability_percent, rel=0.1)


@pytest.mark.parametrize(
    ("speeds", "used"),
    [
        ([15, 15, 14.9, 5, 5], [1, 1, 1, 0, 0]),
        ([15, 15, 5, 5], [1, 1, 0, 0]),
        ([5, 5, 5, 15, 15], [1, 1, 1, 0, 0]),
        ([15, 13, 11, 9, 6, 5], [1, 1, 1, 1, 1, 1]),  # turned by hand, without a second speed
        ([15, 14.9, 12, 15, 11], [1, 1, 1, 1, 1]),
        ([15, 5, 30], [1, 1, 1]),
    ],
)
def test_main_speed_is_that_of_most_cycles(speeds: list[float], used: list[int]) -> None:
    assert at_main_speed(np.array(speeds, dtype=np.float64)).tolist() == [bool(flag) for flag in used]


def test_uncertainty_of_the_lag_includes_corners_cut_by_interpolation() -> None:
    """If a stage is queried every 20 ms, interpolated angles cut the corners of all cycles alike."""
    signals = TwoSpeeds(noise_V=1e-5).signals()
    coarse = np.arange(signals.time_s[0], signals.time_s[-1], 0.0203)
    cut = np.interp(signals.time_s, coarse, np.interp(coarse, signals.time_s, signals.angle_deg))
    timing = sensor_response([replace(signals, angle_deg=cut)], AnalysisOptions()).timing
    assert abs(timing.lag_s) < 3.0 * timing.u_lag_s


def test_single_speed_does_not_separate_lag_and_hysteresis() -> None:
    response = response_of(TwoSpeeds(0.016, 0.0, slow=0))
    assert not response.timing.separated
    assert np.isnan(response.timing.receivers["left"].hysteresis_V)
    assert any("at a single speed" in line for line in response.warnings)


def test_update_interval_of_the_angle_limits_the_timing() -> None:
    """If a stage is queried every 30 ms, the recorded angle is up to 30 ms old, i.e. 15 ± 15 ms."""
    response = response_of(TwoSpeeds(slow=0, update_s=0.03))
    timing = response.timing
    assert timing.source == "angle"
    assert timing.bound_s == pytest.approx(0.015, rel=0.15)
    assert timing.timing_deg == pytest.approx(2.0 * 15.0 * timing.bound_s, rel=0.05)
    for name, receiver in response.receivers.items():
        assert receiver.hysteresis_V <= timing.receivers[name].timing_V * 1.05
    assert any("at a single speed" in line for line in response.warnings)


def test_uses_the_timing_bound_of_a_bench() -> None:
    signals = replace(TwoSpeeds(slow=0).signals(), timing_bound_s=(0.004, "recording"))
    timing = sensor_response([signals], AnalysisOptions()).timing
    assert (timing.bound_s, timing.source) == (0.004, "recording")
    assert timing.timing_deg == pytest.approx(0.12, rel=0.02)


def test_warns_if_drop_omits_all_cycles_at_a_speed() -> None:
    response = response_of(TwoSpeeds(0.016, fast=1, slow=2))
    (omitted,) = [line for line in response.warnings if "--drop 1" in line]
    assert "1 cycle at 15" in omitted
    assert "figures are for 5" in omitted
    assert sum("at a single speed (5°/s)" in line for line in response.warnings) == 1
    two_speeds = response_of(TwoSpeeds(0.016, fast=2, slow=1))
    assert not any("at a single speed" in line or "--drop" in line for line in two_speeds.warnings)
