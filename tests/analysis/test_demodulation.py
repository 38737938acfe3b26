"""Ambient subtraction: exact where it must be, as its transfer function elsewhere; missing slots told and counted."""

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


def demodulated(readings: int, ambient: object, kernel: Kernel = "two-sided", emitters: int = 1) -> Demodulated:
    return subtract(slots_of(*stream(readings, ambient, emitters)), kernel)  # type: ignore[arg-type]  # a name from the parameters


def left(found: Demodulated) -> FloatArray:
    """What is left of the ambient light, ends apart, where there is one off slot alone."""
    return (found.signal[:, 0] + found.emitter)[~found.one_sided]


@pytest.mark.parametrize("emitters", [1, 2, 3])
@given(level=st.floats(-10, 10), slope=st.floats(-50, 50))
def test_constant_light_and_ramps_leave_nothing(emitters: int, level: float, slope: float) -> None:
    found = demodulated(20, lambda t: level + slope * t, emitters=emitters)
    assert np.abs(left(found)).max() < 1e-12 * (1 + abs(level) + abs(slope))
    assert found.emitters == tuple(range(1, emitters + 1))
    assert found.period_s == pytest.approx(PERIOD_S)


def test_one_sided_lets_a_ramp_through() -> None:
    """A ramp of 1 V/s moves by 2.5 mV from the off slot to the on slot: where two-sided leaves nothing."""
    found = demodulated(50, lambda t: t, "one-sided")
    assert found.signal[1:, 0] + 1.0 == pytest.approx(0.5 * PERIOD_S)


def test_a_reading_with_one_off_slot_is_as_uncertain_as_the_ambient_light_moves() -> None:
    """Its error is what a ramp moves by in half a period; noise, which says nothing of it, is far smaller."""
    found = demodulated(50, lambda t: t)
    alone = found.one_sided
    assert alone.any()
    assert np.abs(found.signal[alone, 0] + 1.0) == pytest.approx(0.5 * PERIOD_S)
    assert found.u[alone, 0] == pytest.approx(0.5 * PERIOD_S, rel=0.05)
    assert found.u[~alone, 0].max() < 0.05 * PERIOD_S


def test_several_emitters_with_one_off_phase_between_rounds() -> None:
    """on 1, on 2, off: emitter 1 is nearer to the off slot before, emitter 2 to that after; ramps go all the same."""
    time = np.arange(300.0) * 1e-3
    state = np.tile([0, 1, 2], 100)
    values = (3.0 + 7.0 * time - state)[:, None]
    found = subtract(slots_of(time, values, state))
    assert left(found) == pytest.approx(0.0, abs=1e-12)
    assert found.counts.readings == {1: 100, 2: 100}


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("hz", [0.5, 5.0, 33.0, 50.0, 71.0, 99.5, 119.0, 170.0])
def test_what_is_left_of_flicker_is_the_transfer_function(kernel: Kernel, hz: float) -> None:
    """Over many phases the largest residual comes to the formula; within 1 % of it, by the phases that are met."""
    found = demodulated(4000, lambda t: np.cos(2 * np.pi * hz * t + 0.4), kernel)
    kept = found.signal[1:-1, 0] + 1.0
    expected = float(gain(hz, PERIOD_S, 0.0, kernel))
    assert np.sqrt(2.0 * np.mean(kept**2)) == pytest.approx(expected, rel=0.01)
    if hz not in (50.0,):  # a frequency of few phases need not meet its largest
        assert np.abs(kept).max() == pytest.approx(expected, rel=0.01)


def test_averaging_inside_a_slot_is_the_sinc() -> None:
    """25 samples over 2.5 ms, against a quadrature of the light over the slot."""
    hz, per_slot = 70.0, 25
    time = np.arange(2 * per_slot * 2000) * PERIOD_S / (2 * per_slot)
    state = (np.arange(len(time)) // per_slot + 1) % 2
    found = subtract(slots_of(time, np.cos(2 * np.pi * hz * time)[:, None], state))
    expected = float(gain(hz, PERIOD_S, 0.5 * PERIOD_S))
    assert np.abs(found.signal[1:-1]).max() == pytest.approx(expected, rel=5e-3)


def test_flicker_at_half_the_rate_is_raised_by_3_db_one_sided_and_kept_two_sided() -> None:
    one, two = (float(rejection_dB(gain(100.0, PERIOD_S, 0.0, kernel))) for kernel in ("one-sided", "two-sided"))
    assert one == pytest.approx(-10 * np.log10(2.0))
    assert two == pytest.approx(0.0, abs=1e-12)
    slow = [float(rejection_dB(gain(1.0, PERIOD_S, 0.0, kernel))) for kernel in ("one-sided", "two-sided")]
    assert slow == pytest.approx([36.1, 78.2], abs=0.1)
    assert float(rejection_dB(gain(0.0, PERIOD_S, 0.0))) == np.inf
    assert float(gain(200.0, PERIOD_S, 0.0)) == pytest.approx(2.0), "light at the rate itself looks like the emitter's"


def test_a_step_touches_two_readings_at_most() -> None:
    """A step between slots is halved by two-sided subtraction, where one-sided has it whole."""
    step_s = 100.25 * PERIOD_S
    two, one = (demodulated(200, lambda t: np.where(t > step_s, 1.0, 0.0), kernel) for kernel in KERNELS)
    errors = np.abs(two.signal[:, 0] + 1.0)
    assert errors.max() == pytest.approx(0.5)
    assert np.sum(errors > 1e-12) == 1
    assert np.abs(one.signal[:, 0] + 1.0).max() <= 1.0


def test_uncertainties_are_nominal_for_white_noise() -> None:
    """The spread of (reading − truth)/u is 1; 20,000 readings tell it to 0.5 %, correlation of neighbours included."""
    rng = np.random.default_rng(3)
    time, values, state = stream(20_000, np.zeros_like)
    found = subtract(slots_of(time, values + 0.01 * rng.standard_normal(values.shape), state))
    z = (found.signal[:, 0] + 1.0) / found.u[:, 0]
    assert z.std() == pytest.approx(1.0, abs=0.025)
    assert found.slot_sd[0] == pytest.approx(0.01, rel=0.025)
    assert found.u[5, 0] == pytest.approx(0.01 * np.sqrt(1.5), rel=0.025)


def test_more_noise_in_the_light_is_seen_inside_slots() -> None:
    rng = np.random.default_rng(5)
    time = np.arange(40_000) * PERIOD_S / 20
    state = (np.arange(len(time)) // 10 + 1) % 2
    noise = np.where(state == 1, 0.05, 0.005) * rng.standard_normal(len(time))
    found = subtract(slots_of(time, (noise - state)[:, None], state))
    z = (found.signal[:, 0] + 1.0) / found.u[:, 0]
    assert z.std() == pytest.approx(1.0, abs=0.05)


def test_missing_slots_are_counted_and_worked_around() -> None:
    time, values, state = stream(100, lambda t: 2.0 + 3.0 * t)
    kept = np.ones(200, dtype=bool)
    kept[[40, 81, 121, 123]] = False  # an on slot, an off slot, and the off slots on both sides of on slot 122
    found = subtract(slots_of(time[kept], values[kept], state[kept]))
    assert found.counts.missing == {1: 1}
    assert found.counts.without_off == 1
    assert found.counts.readings == {1: 98}
    at_gaps = [float(t) for t in found.time_s[found.one_sided]]
    assert at_gaps == pytest.approx([time[i] for i in (0, 80, 82, 120, 124)])
    assert np.abs(left(found)).max() < 1e-12
    lost = np.abs(found.signal[found.one_sided, 0] + 1.0)
    assert lost == pytest.approx(3.0 * 0.5 * PERIOD_S), "one off slot alone cannot see the ramp"


def test_samples_without_a_number_leave_their_channel_alone() -> None:
    time, values, state = stream(50, np.zeros_like)
    both = np.concatenate([values, 2.0 * values], axis=1)
    both[41, 0] = np.nan
    found = subtract(slots_of(time, both, state))
    gone = np.isnan(found.signal)
    assert np.flatnonzero(gone[:, 0]).tolist() == [20, 21]
    assert np.isnan(found.u[20, 0])
    assert not gone[:, 1].any()


def test_settling_samples_are_dropped_and_emptied_slots_counted() -> None:
    time = np.arange(400.0) * 1e-4
    state = (np.arange(400) // 10 + 1) % 2
    lag = np.arange(400) % 10 < 3
    values = np.where(lag, 9.0, -1.0 * state)[:, None]
    found = slots_of(time, values, state, settle_s=3e-4)
    assert found.samples.tolist() == [7] * 40
    assert subtract(found).signal[:, 0] == pytest.approx(-1.0)
    assert slots_of(time, values, state, settle_s=1.1e-3).emptied == 40
    single = stream(10, np.zeros_like)
    assert slots_of(*single, settle_s=1e-6).emptied == 20


def test_dropped_samples_part_slots_and_are_in_none() -> None:
    time, state = np.arange(6.0), np.array([1, DROPPED, 0, 0, DROPPED, 1])
    found = slots_of(time, np.array([[1.0], [9.0], [2.0], [4.0], [9.0], [6.0]]), state)
    assert (found.state.tolist(), found.mean[:, 0].tolist()) == ([1, 0, 1], [1.0, 3.0, 6.0])
    assert found.time_s.tolist() == [0.0, 2.5, 5.0]


def test_clipped_samples_are_flagged_with_the_readings_that_use_them() -> None:
    time, values, state = stream(10, np.zeros_like)
    values[7] = 4.0  # an off slot between readings 3 and 4
    values[12] = -4.0  # the on slot of reading 6
    limits = (np.array([-4.0]), np.array([4.0]))
    found = subtract(slots_of(time, values, state, limits=limits))
    assert np.flatnonzero(found.clipped[:, 0]).tolist() == [3, 4, 6]
    assert found.counts.clipped == 3


@pytest.mark.parametrize(("mains_hz", "readings"), [(50.0, 4), (60.0, 10), (100.0, 2), (200.0, 1)])
def test_means_last_whole_periods_of_the_mains(mains_hz: float, readings: int) -> None:
    assert readings_per_mains(PERIOD_S, mains_hz) == readings
    for times in (1, 2, 3):
        if times * mains_hz % 200.0:
            assert float(mean_gain(times * mains_hz, PERIOD_S, readings)) < 1e-12
    assert float(mean_gain(0.0, PERIOD_S, readings)) == 1.0


def test_a_mains_that_never_fits_is_refused() -> None:
    with pytest.raises(DataError, match="spans whole mains periods"):
        readings_per_mains(1e-6, 50.0)


@pytest.mark.parametrize("emitters", [1, 2])
def test_means_take_flicker_out_that_subtraction_cannot(emitters: int) -> None:
    """100 Hz of 50 times the noise: gone, and the uncertainty of the means is that of the noise alone."""
    rng = np.random.default_rng(11)
    time, values, state = stream(8000, lambda t: 0.5 * np.cos(2 * np.pi * 100.0 * t + 0.3), emitters)
    slots = slots_of(time, values + 0.01 * rng.standard_normal(values.shape), state)
    found = subtract(slots)
    means = averaged(found, slots, 4)
    assert np.std(found.signal[:, 0] + found.emitter) > 0.1
    z = (means.signal[:, 0] + means.emitter) / means.u[:, 0]
    assert z.std() == pytest.approx(1.0, abs=0.1)
    assert means.left_out <= 4 * emitters
    assert slot_sd(slots, 4 * emitters)[0] == pytest.approx(0.01, rel=0.1)


def test_a_block_with_a_gap_is_left_out_of_the_means() -> None:
    time, values, state = stream(16, np.zeros_like)
    kept = np.ones(32, dtype=bool)
    kept[[12, 13]] = False  # on slot and off slot of reading 6
    slots = slots_of(time[kept], values[kept], state[kept])
    means = averaged(subtract(slots), slots, 4)
    assert means.time_s == pytest.approx([1.5 * PERIOD_S, 8.5 * PERIOD_S, 12.5 * PERIOD_S])
    assert means.left_out == 3


@pytest.mark.parametrize(
    ("time", "state", "words"),
    [
        ([0.0, 1.0, 1.0], [0, 1, 0], "time of sample 3 = 1.0; must be later"),
        ([0.0, np.nan, 1.0], [0, 1, 0], "time of sample 2"),
        ([0.0, 1.0, 2.0], [1, 1, 2], "there are 2 and 0"),
        ([0.0, 1.0], [0, 1, 0], "at least one sample"),
    ],
)
def test_samples_that_cannot_be_demodulated_are_refused(time: list[float], state: list[int], words: str) -> None:
    with pytest.raises(DataError) as refusal:
        subtract(slots_of(np.array(time), np.zeros((3, 1)), np.array(state)))
    assert words in str(refusal.value)


@pytest.mark.evidence
def test_an_hour_of_eight_receivers() -> None:
    """11.5 million samples: simulated by the readout, with noise, then demodulated."""
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
    read = volts(power, circuit, 0.1, rng=np.random.default_rng(1))
    found = subtract(slots_of(np.arange(count) / 400.0, read, state))
    assert len(found.time_s) == count // 2
    z = (found.signal - found.signal.mean(axis=0)) / found.u
    assert 1.0 < z.std() < 1.05, "single samples: the light's own shot noise is in no off slot"
