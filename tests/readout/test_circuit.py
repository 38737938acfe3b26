"""Light to volts: each step agrees with an independent formula; units, limits and invalid input."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from solen.errors import DataError, SpecError
from solen.parts import EmitterPart, ReceiverPart, library_part
from solen.readout import Adc, Drive, Phototransistor, cases_of, circuit_of, volts
from solen.readout.emitter import solid_angle_sr
from solen.readout.transistor import angular_factor, exponent_of, load_line, spectral_response
from tests.readout.circuit_support import (
    DRIVE,
    PART,
    implicit_current_A,
    paper_circuit,
    paper_design,
    plain_circuit,
)


def test_units_agree_with_pint_from_mw_to_volts() -> None:
    """The same chain computed with pint, which checks the units."""
    unit: Any = pint.UnitRegistry()
    power = 0.25 * (1.0 * unit.milliwatt)
    irradiance = power / (10.0 * unit.millimeter**2)
    current = 400.0 * unit.microampere / (unit.milliwatt / unit.centimeter**2) * irradiance + 1.0 * unit.nanoampere
    expected = (5.0 * unit.volt - current * (2.0 * unit.kiloohm)).to("V").magnitude
    assert volts(np.array([0.25, 0.0]), plain_circuit())[0] == pytest.approx(expected, abs=1e-9), "far above the knee"
    assert plain_circuit().irradiance_mW_cm2(np.array([0.25, 0.0]))[0] == pytest.approx(
        irradiance.to("mW/cm^2").magnitude
    )


def test_paper_circuit_saturates_at_the_expected_irradiance() -> None:
    """With 2 kΩ at 5 V, a part of 450 µA per mW/cm² saturates at 2.5 mA and 5.6 mW/cm²."""
    circuit = paper_circuit(emitter__wavelength_nm=950.0)
    assert circuit.transistor.response == pytest.approx(1.0)
    assert circuit.area_mm2 == pytest.approx((12.0, 12.0), rel=1e-9)
    per_mW_cm2 = 0.12 / float(circuit.drive.power_mW())
    line = circuit.load_line(circuit.current_mA(np.array([[5.0, 5.6]]) * per_mW_cm2))
    assert line.volts[0, 0] == pytest.approx(0.5, abs=0.07), "within the knee"
    assert line.volts[0, 1] < 0.42


@given(
    current_mA=st.floats(0.0, 1e3),
    load=st.floats(1.0, 1e6),
    supply=st.floats(1.0, 20.0),
    knee=st.floats(0.02, 0.5),
)
def test_closed_form_is_the_root_of_the_load_line(current_mA: float, load: float, supply: float, knee: float) -> None:
    part = replace(PART, knee_V=knee)
    line = load_line(np.array(current_mA), load, supply, part.saturation_V, knee)

    def excess(v: float) -> float:
        return supply - v - load * implicit_current_A(v, 1e-3 * current_mA, part)

    root = brentq(excess, part.saturation_V, supply, xtol=1e-13)
    assert float(line.volts) == pytest.approx(root, abs=1e-9 * supply)
    assert part.saturation_V - 1e-12 <= float(line.volts) <= supply


@given(current=st.floats(1e-4, 20.0), load=st.floats(10.0, 1e5))
def test_slopes_agree_with_finite_differences(current: float, load: float) -> None:
    step = 1e-4 * current
    low, high = (float(load_line(np.array(current + sign * step), load, 5.0).volts) for sign in (-1, 1))
    line = load_line(np.array(current), load, 5.0)
    slope = (high - low) / (2e-3 * step)
    assert float(line.drive_ohm) == pytest.approx(-slope, rel=1e-4, abs=1e-9 * load)
    assert 0.0 < float(line.output_ohm) <= load


@given(low=st.floats(0.0, 1.0), more=st.floats(1e-6, 1.0))
def test_voltage_falls_with_light(low: float, more: float) -> None:
    dim, bright = volts(np.array([[low, 0.0], [low + more, 0.0]]), plain_circuit())[:, 0]
    assert bright < dim


def test_voltage_without_light_is_the_supply_less_the_dark_drop() -> None:
    dark = volts(np.zeros(2), plain_circuit())
    assert dark == pytest.approx(5.0 - 2000.0 * 1e-9, abs=1e-12)
    hot = volts(np.zeros(2), plain_circuit(), temperature_C=25.0 + 5 * 8.0)
    assert 5.0 - hot == pytest.approx(32 * (5.0 - dark), rel=1e-6), "the dark current doubles every 8 K"


def test_ambient_light_adds_to_the_current() -> None:
    """1 mW/cm² of ambient light gives 400 µA, or 0.8 V across 2 kΩ."""
    circuit = plain_circuit()
    assert volts(np.zeros(2), circuit, ambient_mW_cm2=1.0) == pytest.approx(4.2, abs=1e-5)
    rows = volts(np.zeros((3, 2)), circuit, ambient_mW_cm2=np.array([0.0, 1.0, 2.0]))
    assert rows[:, 0] == pytest.approx([5.0, 4.2, 3.4], abs=1e-5)
    each = volts(np.zeros((1, 2)), circuit, ambient_mW_cm2=np.array([[0.0, 1.0]]))
    assert each[0] == pytest.approx([5.0, 4.2], abs=1e-5)


def test_temperature_changes_emitter_and_receiver() -> None:
    """Over 10 K, the emitter loses 3.5 % and the receiver gains 10 %."""
    cold, warm = (5.0 - volts(np.array([0.2, 0.0]), plain_circuit(), temperature_C=t)[0] for t in (25.0, 35.0))
    assert warm / cold == pytest.approx(0.965 * 1.1, rel=1e-4)
    rows = volts(np.full((2, 2), 0.2), plain_circuit(), temperature_C=np.array([25.0, 35.0]))
    assert 5.0 - rows[:, 0] == pytest.approx([cold, warm])


def test_emitter_power_follows_its_current() -> None:
    part = library_part("VSMY1850")
    assert isinstance(part, EmitterPart)
    full, tenth = Drive.of(part, 100.0), Drive.of(part, 10.0)
    assert (full.typical_mW, full.min_mW, full.max_mW) == pytest.approx((50.0, 25.0, 75.0))
    assert tenth.typical_mW == pytest.approx(5.0)
    assert tenth.max_mW == pytest.approx(7.5 * 10**0.07), "with an exponent of 0.93"
    assert float(full.power_mW(35.0)) == pytest.approx(50.0 * (1 - 0.035))
    assert float(full.power_mW(1e6)) == 0.0


def test_power_is_the_intensity_times_the_solid_angle_by_default() -> None:
    """10 mW/sr times the 5.0 sr of the part's pattern."""
    part = library_part("VSMY1850")
    assert isinstance(part, EmitterPart)
    assert solid_angle_sr(part.pattern) == pytest.approx(5.0, abs=0.01)
    bare = part.model_copy(update={"power_mw": None})
    assert Drive.of(bare, 100.0).typical_mW == pytest.approx(50.0, abs=0.1)
    with pytest.raises(DataError, match="specifies neither power_mw nor intensity_mw_per_sr"):
        Drive.of(bare.model_copy(update={"intensity_mw_per_sr": None}), 100.0)
    with pytest.raises(DataError, match="current_ma; is missing"):
        Drive.of(part.model_copy(update={"current_ma": None}), 100.0)


def receiver(name: str = "TEMT7100X01") -> ReceiverPart:
    part = library_part(name)
    assert isinstance(part, ReceiverPart)
    return part


def test_daylight_filter_blocks_visible_light() -> None:
    infrared, blue = (spectral_response(receiver(), ((nm, 1.0),)) for nm in (860.0, 450.0))
    assert infrared == pytest.approx(1.17, abs=0.03)
    assert blue / infrared <= 0.0103
    half_low, half_high = (spectral_response(receiver(), ((nm, 1.0),)) * 0.85 for nm in (750.0, 1010.0))
    assert (half_low, half_high) == pytest.approx((0.5, 0.5)), "the band of the datasheet"
    assert spectral_response(receiver("TEMT7000X01"), ((470.0, 1.0),)) * 0.87 == pytest.approx(0.1)


def test_response_is_weighted_with_the_spectrum() -> None:
    lines = ((850.0, 3.0), (950.0, 1.0))
    single = [spectral_response(receiver(), ((nm, 1.0),)) for nm, _ in lines]
    assert spectral_response(receiver(), lines) == pytest.approx((3 * single[0] + single[1]) / 4)
    assert spectral_response(receiver().model_copy(update={"spectrum": None}), lines) == 1.0


def test_flat_window_detects_power_at_any_angle() -> None:
    """A half angle of 60° is a cosine, which power through a face includes; a lens of ±20° attenuates oblique light."""
    assert exponent_of(receiver()) == pytest.approx(1.0, abs=1e-12)
    angles, even = np.linspace(-85, 85, 171), np.ones((2, 171))
    assert angular_factor(1.0, angles, even) == pytest.approx(1.0)
    half = receiver().half_angle_deg
    assert half is not None
    narrow = receiver().model_copy(update={"half_angle_deg": half.model_copy(update={"typical": 20.0})})
    m = exponent_of(narrow)
    assert np.cos(np.radians(20.0)) ** m == pytest.approx(0.5)
    beam = np.zeros(171)
    beam[85 + 20] = 1.0
    assert float(angular_factor(m, angles, beam)) == pytest.approx(0.5 / np.cos(np.radians(20.0)))
    assert float(angular_factor(m, angles, np.zeros(171))) == 1.0


def test_signal_differs_ninefold_between_extreme_parts() -> None:
    """Receivers and emitters each vary by a factor of 3."""
    cases = cases_of(plain_circuit())
    drop = {case: 5.0 - volts(np.array([0.05, 0.0]), circuit)[0] for case, circuit in cases.items()}
    assert drop["brightest"] / drop["dimmest"] == pytest.approx(9.0, rel=1e-3)
    assert cases["typical"] == plain_circuit()


def test_drawn_parts_are_within_their_limits_and_reproducible() -> None:
    drawn = [plain_circuit().drawn(np.random.default_rng(seed)) for seed in range(200)]
    sensitivities = np.array([circuit.sensitivity_uA for circuit in drawn])
    assert sensitivities.min() >= PART.min_uA
    assert sensitivities.max() <= PART.max_uA
    u_mean = 400.0 / np.sqrt(12.0 * sensitivities.size)
    assert sensitivities.mean() == pytest.approx(400.0, abs=4 * u_mean)
    assert len(set(sensitivities.ravel().tolist())) == sensitivities.size, "each receiver is drawn separately"
    assert plain_circuit().drawn(np.random.default_rng(3)) == drawn[3]
    powers = [circuit.drive.typical_mW for circuit in drawn]
    assert DRIVE.min_mW <= min(powers) < max(powers) <= DRIVE.max_mW


def test_adc_rounds_and_clips() -> None:
    adc = Adc("small", 3, 0.0, 4.0)
    assert adc.step_V == 0.5
    assert adc.read(np.array([-1.0, 0.24, 0.26, 1.9, 3.6, 9.0])).tolist() == [0.0, 0.0, 0.5, 2.0, 3.5, 3.5]


@pytest.mark.parametrize(
    ("supply", "range_v", "expected"), [(5.0, None, 10.0), (3.3, None, 5.0), (5.0, [-5.0, 5.0], 5.0)]
)
def test_default_adc_range_includes_the_supply(supply: float, range_v: object, expected: float) -> None:
    assert paper_circuit(readout__supply_v=supply, readout__adc_range_v=range_v).adc.high_V == expected


def test_supply_above_every_range_selects_the_widest() -> None:
    assert paper_circuit(readout__adc="ATmega328P", readout__supply_v=5.0).adc.high_V == 5.0


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        ({"readout__adc_range_v": [-3.0, 3.0]}, SpecError, "range of USB-6218"),
        ({"readout__adc_range_v": [3.0, -3.0]}, SpecError, "must be in ascending order"),
        ({"readout__part": "VSMY1850"}, DataError, "is of kind emitter, but a receiver"),
        ({"readout__adc": "TEMT7100X01"}, DataError, "is of kind receiver, but an adc"),
        ({"readout__emitter_part": "USB-6218"}, DataError, "is of kind adc, but an emitter"),
        ({"readout__part": "TEMT7100"}, DataError, "did you mean TEMT7100X01"),
        ({"readout__part": "none.toml"}, DataError, "no such file"),
        ({"readout__load_ohm": 0.0}, SpecError, "must be at least 0.001"),
        ({"readout__samples": 0}, SpecError, "must be at least 1"),
        ({"readout__supply_V": 5.0}, SpecError, "did you mean readout.supply_v"),
    ],
)
def test_refuses_invalid_circuits(values: dict[str, object], error: type[Exception], message: str) -> None:
    with pytest.raises(error) as error_info:
        paper_circuit(**values)
    assert message in str(error_info.value)


@pytest.mark.parametrize(
    ("fractions", "ambient", "message"),
    [
        (np.zeros(3), 0.0, "must have 2 columns"),
        (np.array([0.1, -0.1]), 0.0, "at least 0"),
        (np.array([0.1, np.nan]), 0.0, "numbers that are at least 0"),
        (np.zeros(2), -1.0, "ambient_mW_cm2"),
    ],
)
def test_refuses_invalid_light(fractions: np.ndarray, ambient: float, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        volts(fractions, plain_circuit(), ambient_mW_cm2=ambient)


PART_TEXT = """
schema = 1
name = "{name}"
kind = "{kind}"
maker = "me"
document = "my notes"
"""
SOURCE_TEXT = 'basis = "measured"\nsource = "bench"\n'


def test_part_files_are_read_from_the_designs_folder(tmp_path: Path) -> None:
    """Keys that a part file omits have their defaults; without a spectrum, there is no dependence on wavelength."""
    receiver_text = (
        PART_TEXT.format(name="Mine", kind="receiver") + f"[current_ua_per_mw_cm2]\ntypical = 100\n{SOURCE_TEXT}"
    )
    adc = (
        PART_TEXT.format(name="Board", kind="adc")
        + f"bits = 14\n[[range]]\nlow_v = 0\nhigh_v = 6\nnoise_uv = 50\n{SOURCE_TEXT}"
    )
    for name, text in (("mine.toml", receiver_text), ("board.toml", adc)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    design = paper_design(readout__part="mine.toml", readout__adc="board.toml").in_folder(tmp_path)
    assert set(design.files) == {"readout.part", "readout.adc"}
    circuit = circuit_of(design, {"right": 12.0})
    assert circuit.transistor == Phototransistor("Mine", 100.0, 100.0, 100.0)
    assert replace(circuit.adc, noise_V=0.0) == Adc("Board", 14, 0.0, 6.0)
    assert circuit.adc.noise_V == pytest.approx(50e-6)
    assert circuit.sensitivity_uA == (100.0,)
