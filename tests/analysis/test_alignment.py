"""Alignment of a log on another clock with the voltages, and angles from a protocol for recordings without an angle."""

import math
from dataclasses import replace

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, sensor_response
from solen.analysis.alignment import Alignment, align
from solen.analysis.protocol_angle import Protocol as AngleProtocol
from solen.analysis.protocol_angle import angle_by_protocol
from solen.arrays import FloatArray
from solen.errors import DataError
from tests.analysis.simulated_support import Protocol, Truth, simulated

TRUTH = Truth(noise_V=0.02)


def logged(truth: Truth, lag_s: float, rate: float = 0.0, log_hz: float = 50.0) -> tuple[FloatArray, FloatArray]:
    """Return the times and angles of a stage log whose clock is ahead by a lag at the midpoint of the recording."""
    end = float(truth.protocol.corners()[0][-1])
    times = np.arange(0.0, end, 1.0 / log_hz)
    rng = np.random.default_rng(truth.seed + 1000)
    angle = truth.protocol.angle_deg(times) + 0.003 * rng.standard_normal(times.size)
    return times + lag_s + rate * (times - 0.5 * end), angle


def aligned(truth: Truth, lag_s: float, rate: float = 0.0, log_hz: float = 50.0) -> Alignment:
    signals = simulated(truth)
    return align(signals.time_s, signals.volts, *logged(truth, lag_s, rate, log_hz))


@pytest.mark.parametrize("lag_s", [0.0, 0.0123, -37.77, 1234.5678, 1.7e9])
@pytest.mark.parametrize("log_hz", [20.0, 1000.0])
def test_determines_the_lag_to_a_millisecond(lag_s: float, log_hz: float) -> None:
    """20 mV at 7 V/s are 3 ms per sample, i.e. 0.1 ms for five cycles with 160 samples each."""
    alignment = aligned(TRUTH, lag_s, log_hz=log_hz)
    assert alignment.lag_s == pytest.approx(lag_s, abs=1e-3)
    assert 2e-5 < alignment.u_lag_s < 4e-4


def test_interval_of_the_lag_has_its_coverage() -> None:
    alignments = [aligned(replace(TRUTH, seed=seed), 0.3) for seed in range(40)]
    inside = sum(abs(alignment.lag_s - 0.3) < 2.8 * alignment.u_lag_s for alignment in alignments)
    assert inside >= 34  # 95 % limit of the t distribution with 4 degrees of freedom, minus three standard deviations


@pytest.mark.parametrize(
    ("log_hz", "rate_hz", "step_deg"),
    [(50.0, 20.0, 0.0), (10.0, 200.0, 0.0), (20.0, 200.0, 0.0), (53.0, 200.0, 0.05), (1000.0, 200.0, 0.3)],
    ids=["slow recorder", "log of 10 Hz", "log of 20 Hz", "encoder", "coarse encoder"],
)
def test_interval_of_the_lag_has_its_coverage_if_all_cycles_are_sampled_alike(
    log_hz: float, rate_hz: float, step_deg: float
) -> None:
    """A cycle of 2.4 s is an integer number of samples of both clocks, so errors are common to all cycles."""
    truth = replace(TRUTH, rate_hz=rate_hz)
    times, angles = simulated(truth).time_s, truth.protocol.angle_deg
    inside = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        lag, phases = rng.uniform(-0.5, 0.5), rng.uniform(0.0, 1.0, 2)
        time_s = times + phases[0] / rate_hz
        volts = truth.response_V(angles(time_s)) + 0.02 * rng.standard_normal((time_s.size, 2))
        log_s = np.arange(phases[1] / log_hz, times[-1], 1.0 / log_hz)
        log = angles(log_s) + 0.002 * rng.standard_normal(log_s.size)
        alignment = align(time_s, volts, log_s + lag, step_deg * np.round(log / step_deg) if step_deg else log)
        inside += abs(alignment.lag_s - lag) < 2.8 * alignment.u_lag_s
    assert inside >= 34  # 95 % of 40, minus three standard deviations of the binomial distribution


@pytest.mark.parametrize(("phase_s", "u_s"), [(0.0, 0.1 / 15.0 / math.sqrt(12.0)), (0.0071, 1e-4)])
def test_few_levels_of_a_noiseless_log_are_not_taken_for_encoder_steps(phase_s: float, u_s: float) -> None:
    """50 Hz at 15°/s are 0.3° per entry. If all angles end in the same decimal, they may nevertheless be rounded."""
    signals = simulated(TRUTH)
    log_s = np.arange(phase_s, float(signals.time_s[-1]), 0.02)
    alignment = align(signals.time_s, signals.volts, log_s + 0.3, TRUTH.protocol.angle_deg(log_s))
    assert alignment.lag_s == pytest.approx(0.3, abs=1e-3)
    assert 0.5 * u_s < alignment.u_lag_s < 3.0 * u_s


def test_corrects_the_rate_of_the_clock() -> None:
    truth = replace(TRUTH, protocol=Protocol(cycles=30))
    alignment = aligned(truth, 5.0, rate=300e-6)
    assert alignment.rate_ppm == pytest.approx(300.0, abs=5.0 * alignment.u_rate_ppm)
    assert alignment.u_rate_ppm < 20.0
    assert alignment.lag_s == pytest.approx(5.0, abs=1e-3)
    expected = truth.protocol.angle_deg(simulated(truth).time_s)
    finite = np.isfinite(alignment.angle_deg)
    assert alignment.angle_deg[finite] == pytest.approx(expected[finite], abs=0.3)  # at corners between log entries


def test_omits_a_rate_that_is_not_significant() -> None:
    assert aligned(TRUTH, 0.2).rate_ppm == 0.0


def test_aligned_angles_give_the_true_response() -> None:
    signals = simulated(TRUTH)
    alignment = aligned(TRUTH, 0.4)
    finite = np.isfinite(alignment.angle_deg)
    signals = replace(
        signals, time_s=signals.time_s[finite], angle_deg=alignment.angle_deg[finite], volts=signals.volts[finite]
    )
    response = sensor_response([signals], AnalysisOptions(drop=0))
    expected = TRUTH.response_V(response.passes.angle_deg)[:, 1]
    assert response.receivers["right"].mean_V == pytest.approx(expected, abs=0.035)


def test_warns_that_hysteresis_looks_like_a_lag() -> None:
    alignment = aligned(replace(TRUTH, hysteresis_V=0.05), 0.2)
    assert any("hysteresis and lag cannot be distinguished" in warning for warning in alignment.warnings)
    # 0.05 V between the directions, at 0.45 V/° and 15 °/s, are a lag of 3.7 ms
    assert alignment.lag_s == pytest.approx(0.2, abs=0.004)


def test_refuses_a_log_of_another_recording() -> None:
    signals = simulated(TRUTH)
    noise = np.random.default_rng(3).standard_normal(signals.volts.shape)
    with pytest.raises(DataError, match="does not match the voltages"):
        align(signals.time_s, noise, *logged(TRUTH, 0.0))


@pytest.mark.parametrize(
    "protocol",
    [Protocol(), Protocol(rest_hold_s=0.8), Protocol(levels_deg=(0.0, -3.0, 0.0, 3.0)), Protocol(cycles=3)],
    ids=["paper", "holds at rest", "other side first", "few"],
)
def test_determines_cycles_without_an_angle(protocol: Protocol) -> None:
    truth = replace(TRUTH, protocol=protocol, drift_V_per_min=0.3)
    signals = simulated(truth)
    result = angle_by_protocol(signals.time_s, signals.volts, signals.receivers, AngleProtocol(3.0))
    assert result.starts_s == pytest.approx(protocol.starts_s(), abs=0.005)
    assert result.angle_deg == pytest.approx(protocol.angle_deg(signals.time_s), abs=0.08)  # 5 ms at 15 °/s


def test_first_excursion_is_positive_if_names_do_not_identify_the_sides() -> None:
    signals = simulated(replace(TRUTH, protocol=Protocol(levels_deg=(0.0, -3.0, 0.0, 3.0))))
    result = angle_by_protocol(signals.time_s, signals.volts, ("a", "b"), AngleProtocol(3.0))
    assert result.angle_deg == pytest.approx(-signals.angle_deg, abs=0.08)
    assert any("first excursion is assumed to be positive" in warning for warning in result.warnings)


@pytest.mark.parametrize(
    "protocol",
    [Protocol(hold_s=2.0), Protocol(hold_s=0.2), Protocol(speed_deg_per_s=5.0)],
    ids=["long", "short", "slow"],
)
def test_refuses_a_protocol_that_does_not_match(protocol: Protocol) -> None:
    signals = simulated(replace(TRUTH, protocol=protocol))
    with pytest.raises(DataError, match=r"does not match ±3° at 15°/s with holds of 0\.8 s"):
        angle_by_protocol(signals.time_s, signals.volts, signals.receivers, AngleProtocol(3.0))


@pytest.mark.parametrize(
    "truth",
    [replace(TRUTH, noise_V=0.3), replace(TRUTH, drift_V_per_min=3.0), replace(TRUTH, hysteresis_V=0.3)],
    ids=["noise", "drift", "hysteresis"],
)
def test_protocol_matches_despite_disturbances(truth: Truth) -> None:
    signals = simulated(truth)
    wander = 0.5 * np.sin(0.3 * signals.time_s)[:, None] * [0.0, 1.0]
    result = angle_by_protocol(signals.time_s, signals.volts + wander, signals.receivers, AngleProtocol(3.0))
    assert result.starts_s == pytest.approx(truth.protocol.starts_s(), abs=0.1)


def test_refuses_voltages_that_are_not_periodic() -> None:
    time_s = np.arange(0.0, 20.0, 0.005)
    noise = np.random.default_rng(4).standard_normal((time_s.size, 2))
    with pytest.raises(DataError, match="is not periodic"):
        angle_by_protocol(time_s, noise, ("left", "right"), AngleProtocol(3.0))
    with pytest.raises(DataError, match="less than one and a half cycles"):
        angle_by_protocol(time_s[:400], noise[:400], ("left", "right"), AngleProtocol(3.0))
