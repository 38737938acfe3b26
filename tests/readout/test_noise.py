"""The noise formulas agree with values calculated by hand, and drawn samples with the formulas."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from solen.errors import SpecError
from solen.readout import Adc, Circuit, lagged, noise, volts
from tests.readout.circuit_support import PART, plain_circuit

DRAWS = 200_000
MAX_SD_ERROR = 4.0 / math.sqrt(2.0 * DRAWS)
"""Four standard errors of the standard deviation of these draws, relative to it."""
HALF = np.array([[0.2, 0.2]])


def drawn(circuit: Circuit) -> NDArray[np.float64]:
    return volts(np.broadcast_to(HALF, (DRAWS, 2)), circuit, rng=np.random.default_rng(7))


def test_noise_follows_schottky_and_johnson() -> None:
    circuit = plain_circuit()
    tau_s = math.hypot(3.0, 2 * 15.0) * 1e-6 / math.log(9.0)
    hz = 1.0 / (4.0 * tau_s)  # π/2 of 1/(2πτ)
    assert circuit.noise_bandwidth_hz == pytest.approx(hz)
    readings = noise(circuit, HALF)
    amps = 0.2 * 1.0 / 0.1 * 400e-6 + 1e-9
    assert readings.shot_V[0] == pytest.approx(2000 * math.sqrt(2 * 1.602177e-19 * amps * 301 * hz), rel=1e-5)
    assert readings.thermal_V[0] == pytest.approx(math.sqrt(4 * 1.380649e-23 * 298.15 * 2000 * hz), rel=1e-6)
    assert readings.quantisation_V[0] == pytest.approx(20 / 2**24 / math.sqrt(12))
    sources = (readings.shot_V, readings.thermal_V, readings.converter_V)
    assert readings.before_V == pytest.approx(np.sqrt(sum(source**2 for source in sources)))


@pytest.mark.parametrize(
    ("adc", "source"),
    [
        (Adc("fine", 24, -10.0, 10.0), "shot"),
        (Adc("USB-6218", 16, -10.0, 10.0, 229e-6), "converter"),
        (Adc("coarse", 10, 0.0, 5.0, 2500e-6), "converter and steps"),
    ],
)
def test_samples_have_the_noise_of_the_formulas(adc: Adc, source: str) -> None:
    circuit = plain_circuit(adc=adc)
    readings, sample = drawn(circuit), noise(circuit, HALF[0])
    expected = np.hypot(sample.before_V, sample.quantisation_V)
    assert readings.std(axis=0) == pytest.approx(expected, rel=MAX_SD_ERROR + 1e-3), source
    assert readings.mean(axis=0) == pytest.approx(
        volts(HALF[0], circuit), abs=5 * float(expected.max()) / math.sqrt(DRAWS) + 1e-6
    )


def test_receivers_and_samples_are_independent() -> None:
    readings = drawn(plain_circuit())
    max_correlation = 4.0 / math.sqrt(DRAWS)
    assert abs(np.asarray(np.corrcoef(readings.T))[0, 1]) < max_correlation
    assert abs(np.asarray(np.corrcoef(readings[:-1, 0], readings[1:, 0]))[0, 1]) < max_correlation


@pytest.mark.parametrize("samples", [4, 25])
def test_noise_falls_with_the_root_of_the_samples(samples: int) -> None:
    adc = Adc("USB-6218", 16, -10.0, 10.0, 229e-6)
    circuit = plain_circuit(adc=adc, samples=samples)
    expected = noise(circuit, HALF).reading_V[0, 0]
    assert expected == pytest.approx(noise(plain_circuit(adc=adc), HALF).reading_V[0, 0] / math.sqrt(samples))
    readings = volts(np.broadcast_to(HALF, (20_000, 2)), circuit, rng=np.random.default_rng(2))
    assert readings.std(axis=0) == pytest.approx(expected, rel=4 / math.sqrt(40_000) + 2e-3)


def test_quantisation_errors_larger_than_the_noise_do_not_average_out() -> None:
    adc = Adc("steps", 8, 0.0, 5.0)
    readings = noise(plain_circuit(adc=adc, samples=100), HALF)
    assert readings.reading_V[0, 0] == pytest.approx(adc.quantisation_V, rel=1e-2)
    assert np.ptp(drawn(plain_circuit(adc=adc, samples=1))) == 0.0


def test_saturated_receiver_has_less_noise() -> None:
    dim, bright = (noise(plain_circuit(), np.array([[f, f]])) for f in (0.2, 20.0))
    assert bright.shot_V[0, 0] < 0.05 * dim.shot_V[0, 0]
    assert bright.thermal_V[0, 0] < 0.3 * dim.thermal_V[0, 0]


def test_slow_adc_input_limits_the_bandwidth() -> None:
    slow = plain_circuit(adc=Adc("slow", 16, -10.0, 10.0, 0.0, 1.0))
    assert slow.noise_bandwidth_hz == pytest.approx(math.pi / 2 * 1000.0)


def test_samples_depend_on_the_seed_and_not_on_the_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = np.random.default_rng(0).uniform(0.0, 0.3, (1000, 2))
    circuit = plain_circuit()
    unchunked = volts(rows, circuit, 0.1, 25.0, np.random.default_rng(5))
    monkeypatch.setattr("solen.readout.samples.CHUNK_ROWS", 17)
    assert np.array_equal(unchunked, volts(rows, circuit, 0.1, 25.0, np.random.default_rng(5)))
    assert not np.array_equal(unchunked, volts(rows, circuit, 0.1, 25.0, np.random.default_rng(6)))


def test_lag_is_first_order() -> None:
    circuit = plain_circuit()
    tau_s = 1e-6 * circuit.time_constant_us[0]
    step = np.where(np.arange(2000)[:, None] < 100, 5.0, 1.0) * np.ones(2)
    rate_hz = 50.0 / tau_s
    readings = lagged(step, circuit, rate_hz)
    t = (np.arange(2000) - 99) / rate_hz
    expected = np.where(t > 0, 1.0 + 4.0 * np.exp(-t / tau_s), 5.0)
    assert readings[:, 0] == pytest.approx(expected, abs=1e-9)
    with pytest.raises(SpecError, match="rate_hz"):
        lagged(step, circuit, 0.0)


def test_time_constant_grows_with_the_load() -> None:
    fast, slow = (PART.time_constant_us(ohm) for ohm in (100.0, 10_000.0))
    assert fast == pytest.approx(math.hypot(3.0, 1.5) / math.log(9.0))
    assert slow == pytest.approx(150.0 / math.log(9.0), rel=1e-3)
