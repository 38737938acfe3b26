"""The switching clock of the emitters in a waveform: its rate, drift and edges are detected as simulated."""

import numpy as np
import pytest

from solen.analysis.demodulation import DROPPED, find_clock, slots_of, subtract
from solen.arrays import FloatArray
from solen.errors import DataError
from tests.analysis.switching_support import waveform

SAMPLE_US = 100.0


def edge_errors_us(phase: FloatArray, true_phase: FloatArray, rate_hz: float) -> FloatArray:
    """Return the errors of the edges in time, up to a common number of periods."""
    errors = phase - true_phase
    return np.asarray(1e6 * (errors - np.round(np.median(errors))) / rate_hz)


@pytest.mark.parametrize("ppm", [0.0, 40.0, -300.0, 9000.0])
def test_determines_rate_and_edges(ppm: float) -> None:
    time, values, phase = waveform(6.0, ppm=ppm, noise=0.1)
    clock = find_clock(time, values, 200.0)
    assert clock.rate_hz == pytest.approx(200.0 * (1 + 1e-6 * ppm), abs=5e-3)
    assert clock.on_share == pytest.approx(0.5, abs=0.02)
    assert clock.depth == pytest.approx(1.5, abs=0.1)
    assert np.abs(edge_errors_us(clock.phase, phase, 200.0)).max() < SAMPLE_US


def test_follows_a_drifting_clock() -> None:
    """The edges drift by ±0.4 ms in 8 s, i.e. by four samples from those of a clock with a constant rate."""
    drift = 4e-4

    def drift_s(time: FloatArray) -> FloatArray:
        return np.asarray(drift * np.sin(2 * np.pi * time / 8.0))

    time, values, phase = waveform(12.0, noise=0.05, drift_s=drift_s)
    clock = find_clock(time, values, 200.0)
    assert np.abs(edge_errors_us(clock.phase, phase, 200.0)).max() < SAMPLE_US
    assert 1e-6 * clock.wander_us > 0.5 * drift


def test_waveform_gives_the_light_of_each_emitter() -> None:
    time, values, _ = waveform(4.0, emitters=3, noise=0.02, sampled_hz=30_000.0)
    clock = find_clock(time, values, 200.0, emitters=3)
    readings = subtract(slots_of(time, values, clock.states(2e-4, 3)))
    assert readings.emitters == (1, 2, 3)
    means = [readings.signal[readings.of(emitter)].mean(axis=0) for emitter in readings.emitters]
    first = round(-means[0][0])  # the recording may begin with any emitter
    expected = [1 + (first - 1 + k) % 3 for k in range(3)]
    assert [-m[0] for m in means] == pytest.approx(expected, abs=0.01)
    assert [-2 * m[1] for m in means] == pytest.approx(expected, abs=0.01)
    assert readings.counts.missing == {1: 0, 2: 0, 3: 0}
    assert readings.period_s == pytest.approx(5e-3, rel=1e-3)


def test_determines_edges_if_light_raises_the_voltage() -> None:
    time, values, phase = waveform(2.0, noise=0.02)
    clock = find_clock(time, 4.0 - values, 200.0, on="high")
    assert np.abs(edge_errors_us(clock.phase, phase, 200.0)).max() < SAMPLE_US


def test_drops_settling_samples_and_edges() -> None:
    time, values, phase = waveform(1.0, noise=0.01)
    state = find_clock(time, values, 200.0).states(5e-4)
    fraction = phase % 1.0
    settled = (fraction % 0.5) * 5e-3 > 5e-4 + 1e-4
    on = fraction < 0.5
    assert (state[settled & on & (fraction < 0.47)] == 1).all()
    assert (state[settled & ~on & (fraction < 0.97)] == 0).all()
    assert (state[(fraction % 0.5) * 5e-3 < 4e-4] == DROPPED).all()


def test_flicker_does_not_shift_the_edges() -> None:
    time, values, phase = waveform(4.0, noise=0.02)
    flicker = 0.5 * np.cos(2 * np.pi * 100.0 * time)[:, None]
    clock = find_clock(time, values + flicker, 200.0)
    assert np.abs(edge_errors_us(clock.phase, phase, 200.0)).max() < SAMPLE_US


@pytest.mark.parametrize("emitters", [1, 2, 3])
def test_recognises_switching_of_unequal_emitters_in_drifting_light(emitters: int) -> None:
    """At 10 kHz a few periods are an integer number of samples, so each phase is sampled with the same emitter only."""
    time, values, _ = waveform(4.0, noise=0.002, emitters=emitters)
    assert find_clock(time, values + 0.3 * time[:, None], 200.0, emitters=emitters).between_share < 0.15


def test_sample_at_an_edge_belongs_to_no_slot() -> None:
    """If the recorder's clock switches the emitters, the sample at an edge belongs to either phase at random."""
    time, values, _ = waveform(4.0, noise=0.002, start=0.0)
    rng = np.random.default_rng(4)
    phase = 200.0 * time % 1.0
    edge = np.isclose(phase, 0.5) | np.isclose(phase, 0.0) | np.isclose(phase, 1.0)
    values[edge] = np.where(rng.random(edge.sum()) < 0.5, 4.0, 3.0)[:, None]
    clock = find_clock(time, values, 200.0)
    readings = subtract(slots_of(time, values, clock.states(0.0), gap_s=clock.shorter_s))
    assert readings.signal[:, 0] == pytest.approx(-1.0, abs=0.005)


def test_missing_samples_do_not_split_slots_of_a_known_clock() -> None:
    time, values, _ = waveform(4.0, noise=0.002)
    kept = np.random.default_rng(5).random(time.size) > 0.1
    clock = find_clock(time[kept], values[kept], 200.0)
    states = clock.states(3e-4)
    readings = subtract(slots_of(time[kept], values[kept], states, gap_s=clock.shorter_s))
    assert readings.counts.missing == {1: 0}
    assert readings.time_s.size == pytest.approx(800, abs=1)
    split = subtract(slots_of(time[kept], values[kept], states))
    assert split.time_s.size > 1600


@pytest.mark.parametrize("divisor", [2, 3])
def test_refuses_a_fraction_of_the_rate(divisor: int) -> None:
    """At 100 Hz a period contains two on phases."""
    time, values, _ = waveform(4.0, noise=0.02)
    flicker = 0.1 * np.cos(2 * np.pi * 200.0 / divisor * time)[:, None]
    with pytest.raises(DataError, match=f"contains {divisor} on phases; specify 200"):
        find_clock(time, values + flicker, 200.0 / divisor)


def test_third_of_a_sine_is_between_on_and_off() -> None:
    time, values, _ = waveform(4.0, noise=0.02)
    assert find_clock(time, values, 200.0).between_share < 0.03
    sine = np.cos(2 * np.pi * 200.0 * time)[:, None]
    assert find_clock(time, sine, 200.0).between_share == pytest.approx(1 / 3, abs=0.05)


@pytest.mark.parametrize(
    ("seconds", "sampled_hz", "depth", "limit"),
    [
        (2.0, 10_000.0, 0.0, "no clear modulation"),
        (0.03, 10_000.0, 1.0, "at least 8 periods of 200 Hz"),
        (4.0, 1000.0, 1.0, "samples in a period of 200 Hz, but at least 6"),
    ],
)
def test_refuses_a_waveform_without_a_clock(seconds: float, sampled_hz: float, depth: float, limit: str) -> None:
    time, values, _ = waveform(seconds, sampled_hz=sampled_hz)
    rng = np.random.default_rng(0)
    with pytest.raises(DataError, match=limit):
        find_clock(time, depth * values + 0.1 * rng.standard_normal(values.shape), 200.0)
