"""Noise: the formulas against constants worked out by hand, and drawn samples against the formulas."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from solen.errors import SpecError
from solen.readout import Adc, noise, settled, volts
from tests.readout.circuit_support import PART, plain_circuit

DRAWS = 200_000
OF_AN_SD = 4.0 / math.sqrt(2.0 * DRAWS)
"""Four standard errors of a standard deviation of that many draws."""
HALF = np.array([[0.2, 0.2]])


def drawn(circuit_of: object, seed: int = 7, fractions: NDArray[np.float64] = HALF) -> NDArray[np.float64]:
    circuit = circuit_of
    many = np.broadcast_to(fractions, (DRAWS, 2))
    return volts(many, circuit, rng=np.random.default_rng(seed))  # type: ignore[arg-type]


def test_the_formulas_are_those_of_schottky_and_johnson() -> None:
    circuit = plain_circuit()
    tau_s = math.hypot(3.0, 2 * 15.0) * 1e-6 / math.log(9.0)
    hz = 1.0 / (4.0 * tau_s)  # π/2 of 1/(2πτ)
    assert circuit.noise_bandwidth_hz == pytest.approx(hz)
    found = noise(circuit, HALF)
    amps = 0.2 * 1.0 / 0.1 * 400e-6 + 1e-9
    assert found.shot_V[0] == pytest.approx(2000 * math.sqrt(2 * 1.602177e-19 * amps * 301 * hz), rel=1e-5)
    assert found.thermal_V[0] == pytest.approx(math.sqrt(4 * 1.380649e-23 * 298.15 * 2000 * hz), rel=1e-6)
    assert found.quantisation_V[0] == pytest.approx(20 / 2**24 / math.sqrt(12))
    parts = (found.shot_V, found.thermal_V, found.converter_V)
    assert found.before_V == pytest.approx(np.sqrt(sum(part**2 for part in parts)))


@pytest.mark.parametrize(
    ("adc", "what"),
    [
        (Adc("fine", 24, -10.0, 10.0), "shot"),
        (Adc("USB-6218", 16, -10.0, 10.0, 229e-6), "converter"),
        (Adc("coarse", 10, 0.0, 5.0, 2500e-6), "converter and steps"),
    ],
)
def test_samples_have_the_noise_of_the_formula(adc: Adc, what: str) -> None:
    circuit = plain_circuit(adc=adc)
    found, one = drawn(circuit), noise(circuit, HALF[0])
    expected = np.hypot(one.before_V, one.quantisation_V)
    assert found.std(axis=0) == pytest.approx(expected, rel=OF_AN_SD + 1e-3), what
    assert found.mean(axis=0) == pytest.approx(
        volts(HALF[0], circuit), abs=5 * float(expected.max()) / math.sqrt(DRAWS) + 1e-6
    )


def test_receivers_and_samples_are_independent() -> None:
    found = drawn(plain_circuit())
    of_r = 4.0 / math.sqrt(DRAWS)
    assert abs(np.asarray(np.corrcoef(found.T))[0, 1]) < of_r
    assert abs(np.asarray(np.corrcoef(found[:-1, 0], found[1:, 0]))[0, 1]) < of_r


@pytest.mark.parametrize("samples", [4, 25])
def test_averaging_helps_by_the_root_of_the_samples(samples: int) -> None:
    adc = Adc("USB-6218", 16, -10.0, 10.0, 229e-6)
    one, many = plain_circuit(adc=adc), plain_circuit(adc=adc, samples=samples)
    expected = noise(many, HALF).reading_V[0, 0]
    assert expected == pytest.approx(noise(one, HALF).reading_V[0, 0] / math.sqrt(samples))
    few = volts(np.broadcast_to(HALF, (20_000, 2)), many, rng=np.random.default_rng(2))
    assert few.std(axis=0) == pytest.approx(expected, rel=4 / math.sqrt(40_000) + 2e-3)


def test_steps_wider_than_the_noise_do_not_average_out() -> None:
    adc = Adc("steps", 8, 0.0, 5.0)
    found = noise(plain_circuit(adc=adc, samples=100), HALF)
    assert found.reading_V[0, 0] == pytest.approx(adc.quantisation_V, rel=1e-2)
    assert np.ptp(drawn(plain_circuit(adc=adc, samples=1))) == 0.0


def test_a_saturated_receiver_is_quiet() -> None:
    dim, bright = (noise(plain_circuit(), np.array([[f, f]])) for f in (0.2, 20.0))
    assert bright.shot_V[0, 0] < 0.05 * dim.shot_V[0, 0]
    assert bright.thermal_V[0, 0] < 0.3 * dim.thermal_V[0, 0]


def test_a_slow_converter_input_narrows_the_band() -> None:
    slow = plain_circuit(adc=Adc("slow", 16, -10.0, 10.0, 0.0, 1.0))
    assert slow.noise_bandwidth_hz == pytest.approx(math.pi / 2 * 1000.0)


def test_the_same_seed_gives_the_same_samples_however_they_are_worked_on(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = np.random.default_rng(0).uniform(0.0, 0.3, (1000, 2))
    circuit = plain_circuit()
    whole = volts(rows, circuit, 0.1, 25.0, np.random.default_rng(5))
    monkeypatch.setattr("solen.readout.samples.ROWS", 17)
    assert np.array_equal(whole, volts(rows, circuit, 0.1, 25.0, np.random.default_rng(5)))
    assert not np.array_equal(whole, volts(rows, circuit, 0.1, 25.0, np.random.default_rng(6)))


def test_the_lag_is_a_first_order() -> None:
    circuit = plain_circuit()
    tau_s = 1e-6 * circuit.time_constant_us[0]
    step = np.where(np.arange(2000)[:, None] < 100, 5.0, 1.0) * np.ones(2)
    rate_hz = 50.0 / tau_s
    found = settled(step, circuit, rate_hz)
    t = (np.arange(2000) - 99) / rate_hz
    expected = np.where(t > 0, 1.0 + 4.0 * np.exp(-t / tau_s), 5.0)
    assert found[:, 0] == pytest.approx(expected, abs=1e-9)
    with pytest.raises(SpecError, match="rate_hz"):
        settled(step, circuit, 0.0)


def test_the_time_constant_grows_with_the_load() -> None:
    fast, slow = (PART.time_constant_us(ohm) for ohm in (100.0, 10_000.0))
    assert fast == pytest.approx(math.hypot(3.0, 1.5) / math.log(9.0))
    assert slow == pytest.approx(150.0 / math.log(9.0), rel=1e-3)
