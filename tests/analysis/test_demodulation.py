"""Subtraction of ambient light: exact for linear changes, otherwise as its transfer function; missing slots."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solen.analysis.demodulation import (
    DROPPED,
    Demodulated,
    Kernel,
    averaged,
    gain,
    readings_per_mains,
    rejection_dB,
    slots_of,
    subtract,
)
from solen.analysis.demodulation.rejection import KERNELS, mean_gain
from solen.analysis.demodulation.subtract import slot_sd
from solen.arrays import FloatArray
from solen.errors import DataError
from solen.readout import Adc, Circuit, Drive, Phototransistor, volts
from tests.analysis.switching_support import PERIOD_S, stream


def demodulated(
    readings: int, ambient: Callable[[FloatArray], FloatArray], kernel: Kernel = "two-sided", emitters: int = 1
) -> Demodulated:
    """Return the readings of a simulated receiver in given ambient light."""
    return subtract(slots_of(*stream(readings, ambient, emitters)), kernel)


def remaining_light(result: Demodulated) -> FloatArray:
    """Return the remaining ambient light in two-sided readings."""
    return (result.signal[:, 0] + result.emitter)[~result.one_sided]


@pytest.mark.parametrize("emitters", [1, 2, 3])
@given(level=st.floats(-10, 10), slope=st.floats(-50, 50))
def test_removes_constant_light_and_linear_changes(emitters: int, level: float, slope: float) -> None:
    result = demodulated(20, lambda t: level + slope * t, emitters=emitters)
    assert np.abs(remaining_light(result)).max() < 1e-12 * (1 + abs(level) + abs(slope))
    assert result.emitters == tuple(range(1, emitters + 1))
    assert result.period_s == pytest.approx(PERIOD_S)


def test_one_sided_subtraction_does_not_remove_linear_changes() -> None:
    """Light that changes by 1 V/s differs by 2.5 mV between an off slot and the next on slot."""
    result = demodulated(50, lambda t: t, "one-sided")
    assert result.signal[1:, 0] + 1.0 == pytest.approx(0.5 * PERIOD_S)


def test_uncertainty_of_one_sided_readings_includes_the_change_of_the_light() -> None:
    """Their error is the change of the light in half a period, which is much larger than the noise."""
    result = demodulated(50, lambda t: t)
    one_sided = result.one_sided
    assert one_sided.any()
    assert np.abs(result.signal[one_sided, 0] + 1.0) == pytest.approx(0.5 * PERIOD_S)
    assert result.u[one_sided, 0] == pytest.approx(0.5 * PERIOD_S, rel=0.05)
    assert result.u[~one_sided, 0].max() < 0.05 * PERIOD_S


def test_two_emitters_may_share_an_off_slot() -> None:
    """For the sequence 0, 1, 2, the off slots before and after a reading are at different distances."""
    time = np.arange(300.0) * 1e-3
    state = np.tile([0, 1, 2], 100)
    values = (3.0 + 7.0 * time - state)[:, None]
    result = subtract(slots_of(time, values, state))
    assert remaining_light(result) == pytest.approx(0.0, abs=1e-12)
    assert result.counts.readings == {1: 100, 2: 100}


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("hz", [0.5, 5.0, 33.0, 50.0, 71.0, 99.5, 119.0, 170.0])
def test_remaining_flicker_agrees_with_the_transfer_function(kernel: Kernel, hz: float) -> None:
    result = demodulated(4000, lambda t: np.cos(2 * np.pi * hz * t + 0.4), kernel)
    remaining = result.signal[1:-1, 0] + 1.0
    expected = float(gain(hz, PERIOD_S, 0.0, kernel))
    assert np.sqrt(2.0 * np.mean(remaining**2)) == pytest.approx(expected, rel=0.01)
    if hz not in (50.0,):  # at 50 Hz only four phases occur, which need not include that of the maximum
        assert np.abs(remaining).max() == pytest.approx(expected, rel=0.01)


def test_averaging_within_a_slot_multiplies_by_the_sinc() -> None:
    """25 samples in 2.5 ms."""
    hz, per_slot = 70.0, 25
    time = np.arange(2 * per_slot * 2000) * PERIOD_S / (2 * per_slot)
    state = (np.arange(len(time)) // per_slot + 1) % 2
    result = subtract(slots_of(time, np.cos(2 * np.pi * hz * time)[:, None], state))
    expected = float(gain(hz, PERIOD_S, 0.5 * PERIOD_S))
    assert np.abs(result.signal[1:-1]).max() == pytest.approx(expected, rel=5e-3)


def test_flicker_at_half_the_rate_is_amplified_by_one_sided_subtraction() -> None:
    one, two = (float(rejection_dB(gain(100.0, PERIOD_S, 0.0, kernel))) for kernel in ("one-sided", "two-sided"))
    assert one == pytest.approx(-10 * np.log10(2.0))
    assert two == pytest.approx(0.0, abs=1e-12)
    slow = [float(rejection_dB(gain(1.0, PERIOD_S, 0.0, kernel))) for kernel in ("one-sided", "two-sided")]
    assert slow == pytest.approx([36.1, 78.2], abs=0.1)
    assert float(rejection_dB(gain(0.0, PERIOD_S, 0.0))) == np.inf
    assert float(gain(200.0, PERIOD_S, 0.0)) == pytest.approx(2.0)  # indistinguishable from the emitter's light


def test_step_of_the_light_changes_one_reading() -> None:
    """Two-sided subtraction leaves half of the step, one-sided subtraction up to the full height."""
    step_s = 100.25 * PERIOD_S
    two_sided, one_sided = (demodulated(200, lambda t: np.where(t > step_s, 1.0, 0.0), kernel) for kernel in KERNELS)
    errors = np.abs(two_sided.signal[:, 0] + 1.0)
    assert errors.max() == pytest.approx(0.5)
    assert np.sum(errors > 1e-12) == 1
    assert np.abs(one_sided.signal[:, 0] + 1.0).max() <= 1.0


def test_uncertainties_are_correct_for_white_noise() -> None:
    """The standard deviation of error/u is 1, to 0.5 % for 20,000 readings with correlated neighbours."""
    rng = np.random.default_rng(3)
    time, values, state = stream(20_000, np.zeros_like)
    result = subtract(slots_of(time, values + 0.01 * rng.standard_normal(values.shape), state))
    z = (result.signal[:, 0] + 1.0) / result.u[:, 0]
    assert z.std() == pytest.approx(1.0, abs=0.025)
    assert result.slot_sd[0] == pytest.approx(0.01, rel=0.025)
    assert result.u[5, 0] == pytest.approx(0.01 * np.sqrt(1.5), rel=0.025)


def test_uncertainty_includes_the_scatter_within_on_slots() -> None:
    rng = np.random.default_rng(5)
    time = np.arange(40_000) * PERIOD_S / 20
    state = (np.arange(len(time)) // 10 + 1) % 2
    noise = np.where(state == 1, 0.05, 0.005) * rng.standard_normal(len(time))
    result = subtract(slots_of(time, (noise - state)[:, None], state))
    z = (result.signal[:, 0] + 1.0) / result.u[:, 0]
    assert z.std() == pytest.approx(1.0, abs=0.05)


def test_counts_missing_slots_and_uses_one_sided_readings() -> None:
    time, values, state = stream(100, lambda t: 2.0 + 3.0 * t)
    kept = np.ones(200, dtype=bool)
    kept[[40, 81, 121, 123]] = False  # an on slot, an off slot, and the off slots on both sides of on slot 122
    result = subtract(slots_of(time[kept], values[kept], state[kept]))
    assert result.counts.missing == {1: 1}
    assert result.counts.without_off == 1
    assert result.counts.readings == {1: 98}
    one_sided_s = [float(t) for t in result.time_s[result.one_sided]]
    assert one_sided_s == pytest.approx([time[i] for i in (0, 80, 82, 120, 124)])
    assert np.abs(remaining_light(result)).max() < 1e-12
    errors = np.abs(result.signal[result.one_sided, 0] + 1.0)
    assert errors == pytest.approx(3.0 * 0.5 * PERIOD_S)


def test_sample_without_a_number_affects_only_its_channel() -> None:
    time, values, state = stream(50, np.zeros_like)
    both = np.concatenate([values, 2.0 * values], axis=1)
    both[41, 0] = np.nan
    result = subtract(slots_of(time, both, state))
    missing = np.isnan(result.signal)
    assert np.flatnonzero(missing[:, 0]).tolist() == [20, 21]
    assert np.isnan(result.u[20, 0])
    assert not missing[:, 1].any()


def test_drops_settling_samples_and_counts_slots_without_samples() -> None:
    time = np.arange(400.0) * 1e-4
    state = (np.arange(400) // 10 + 1) % 2
    settling = np.arange(400) % 10 < 3
    values = np.where(settling, 9.0, -1.0 * state)[:, None]
    slots = slots_of(time, values, state, settle_s=3e-4)
    assert slots.samples.tolist() == [7] * 40
    assert subtract(slots).signal[:, 0] == pytest.approx(-1.0)
    assert slots_of(time, values, state, settle_s=1.1e-3).emptied == 40
    single = stream(10, np.zeros_like)
    assert slots_of(*single, settle_s=1e-6).emptied == 20


def test_dropped_samples_separate_slots() -> None:
    time, state = np.arange(6.0), np.array([1, DROPPED, 0, 0, DROPPED, 1])
    slots = slots_of(time, np.array([[1.0], [9.0], [2.0], [4.0], [9.0], [6.0]]), state)
    assert (slots.state.tolist(), slots.mean[:, 0].tolist()) == ([1, 0, 1], [1.0, 3.0, 6.0])
    assert slots.time_s.tolist() == [0.0, 2.5, 5.0]


def test_flags_readings_that_use_clipped_samples() -> None:
    time, values, state = stream(10, np.zeros_like)
    values[7] = 4.0  # the off slot between readings 3 and 4
    values[12] = -4.0  # the on slot of reading 6
    limits = (np.array([-4.0]), np.array([4.0]))
    result = subtract(slots_of(time, values, state, limits=limits))
    assert np.flatnonzero(result.clipped[:, 0]).tolist() == [3, 4, 6]
    assert result.counts.clipped == 3


@pytest.mark.parametrize(("mains_hz", "readings"), [(50.0, 4), (60.0, 10), (100.0, 2), (200.0, 1)])
def test_means_span_an_integer_number_of_mains_periods(mains_hz: float, readings: int) -> None:
    assert readings_per_mains(PERIOD_S, mains_hz) == readings
    for order in (1, 2, 3):
        if order * mains_hz % 200.0:
            assert float(mean_gain(order * mains_hz, PERIOD_S, readings)) < 1e-12
    assert float(mean_gain(0.0, PERIOD_S, readings)) == 1.0


def test_refuses_a_mains_frequency_without_a_common_period() -> None:
    with pytest.raises(DataError, match="spans whole mains periods"):
        readings_per_mains(1e-6, 50.0)


@pytest.mark.parametrize("emitters", [1, 2])
def test_means_remove_flicker_that_subtraction_does_not(emitters: int) -> None:
    """The amplitude at 100 Hz is 50 times the noise; the uncertainty of the means is that of the noise alone."""
    rng = np.random.default_rng(11)
    time, values, state = stream(8000, lambda t: 0.5 * np.cos(2 * np.pi * 100.0 * t + 0.3), emitters)
    slots = slots_of(time, values + 0.01 * rng.standard_normal(values.shape), state)
    result = subtract(slots)
    means = averaged(result, slots, 4)
    assert np.std(result.signal[:, 0] + result.emitter) > 0.1
    z = (means.signal[:, 0] + means.emitter) / means.u[:, 0]
    assert z.std() == pytest.approx(1.0, abs=0.1)
    assert means.omitted <= 4 * emitters
    assert slot_sd(slots, 4 * emitters)[0] == pytest.approx(0.01, rel=0.1)


def test_means_omit_a_block_with_a_gap() -> None:
    time, values, state = stream(16, np.zeros_like)
    kept = np.ones(32, dtype=bool)
    kept[[12, 13]] = False  # on slot and off slot of reading 6
    slots = slots_of(time[kept], values[kept], state[kept])
    means = averaged(subtract(slots), slots, 4)
    assert means.time_s == pytest.approx([1.5 * PERIOD_S, 8.5 * PERIOD_S, 12.5 * PERIOD_S])
    assert means.omitted == 3


@pytest.mark.parametrize(
    ("time", "state", "message"),
    [
        ([0.0, 1.0, 1.0], [0, 1, 0], "time of sample 3 = 1.0; must be later"),
        ([0.0, np.nan, 1.0], [0, 1, 0], "time of sample 2"),
        ([0.0, 1.0, 2.0], [1, 1, 2], "there are 2 on slots and 0 off slots"),
        ([0.0, 1.0], [0, 1, 0], "at least one sample"),
    ],
)
def test_refuses_samples_that_cannot_be_demodulated(time: list[float], state: list[int], message: str) -> None:
    with pytest.raises(DataError, match=message):
        subtract(slots_of(np.array(time), np.zeros((3, 1)), np.array(state)))


@pytest.mark.evidence
def test_demodulates_an_hour_of_eight_receivers() -> None:
    """11.5 million samples, simulated by the readout with noise."""
    circuit = Circuit(
        names=tuple(f"r{i}" for i in range(8)),
        area_mm2=(12.0,) * 8,
        drive=Drive("LED", 2.0, 1.0, 0.5, 1.5, 0.0035, 850.0),
        transistor=Phototransistor("PT", 450.0, 225.0, 675.0),
        adc=Adc("adc", 16, -10.0, 10.0, 229e-6),
        sensitivity_uA=(450.0,) * 8,
        load_ohm=(2000.0,) * 8,
        supply_V=5.0,
    )
    count = 2 * 200 * 3600
    state = np.arange(1, count + 1) % 2
    power = 0.2 * state[:, None] * np.ones(8)
    values = volts(power, circuit, 0.1, rng=np.random.default_rng(1))
    result = subtract(slots_of(np.arange(count) / 400.0, values, state))
    assert len(result.time_s) == count // 2
    z = (result.signal - result.signal.mean(axis=0)) / result.u
    assert 1.0 < z.std() < 1.05  # off slots do not contain the shot noise of the emitter's light
