"""Light to volts: each step against its formula written otherwise, limits, monotony, units by pint."""

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
from solen.readout import Adc, Drive, Phototransistor, circuit_of, spread, volts
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


def test_units_are_conserved_from_mw_to_volts() -> None:
    """The same chain with pint, which knows no formula of ours but the units."""
    unit: Any = pint.UnitRegistry()
    power = 0.25 * (1.0 * unit.milliwatt)
    irradiance = power / (10.0 * unit.millimeter**2)
    current = 400.0 * unit.microampere / (unit.milliwatt / unit.centimeter**2) * irradiance + 1.0 * unit.nanoampere
    expected = (5.0 * unit.volt - current * (2.0 * unit.kiloohm)).to("V").magnitude
    assert volts(np.array([0.25, 0.0]), plain_circuit())[0] == pytest.approx(expected, abs=1e-9), "far above the knee"
    assert plain_circuit().irradiance_mW_cm2(np.array([0.25, 0.0]))[0] == pytest.approx(
        irradiance.to("mW/cm^2").magnitude
    )


def test_it_saturates_where_the_data_sheet_says() -> None:
    """2 kΩ on 5 V let 2.5 mA through: 5.6 mW/cm² of a part of 450 µA, at the wavelength of its sensitivity."""
    circuit = paper_circuit(emitter__wavelength_nm=950.0)
    assert circuit.transistor.response == pytest.approx(1.0)
    assert circuit.area_mm2 == pytest.approx((12.0, 12.0), rel=1e-9)
    per_mW_cm2 = 0.12 / float(circuit.drive.power_mW())
    reached = circuit.load_line(circuit.current_mA(np.array([[5.0, 5.6]]) * per_mW_cm2))
    assert reached.volts[0, 0] == pytest.approx(0.5, abs=0.07), "but for the knee"
    assert reached.volts[0, 1] < 0.42


@given(asked=st.floats(0.0, 1e3), load=st.floats(1.0, 1e6), supply=st.floats(1.0, 20.0), knee=st.floats(0.02, 0.5))
def test_the_closed_form_is_the_root_of_the_load_line(asked: float, load: float, supply: float, knee: float) -> None:
    part = replace(PART, knee_V=knee)
    found = load_line(np.array(asked), load, supply, part.saturation_V, knee)

    def excess(v: float) -> float:
        return supply - v - load * implicit_current_A(v, 1e-3 * asked, part)

    root = brentq(excess, part.saturation_V, supply, xtol=1e-13)
    assert float(found.volts) == pytest.approx(root, abs=1e-9 * supply)
    assert part.saturation_V - 1e-12 <= float(found.volts) <= supply


@given(current=st.floats(1e-4, 20.0), load=st.floats(10.0, 1e5))
def test_slopes_are_those_of_finite_differences(current: float, load: float) -> None:
    step = 1e-4 * current
    low, high = (float(load_line(np.array(current + sign * step), load, 5.0).volts) for sign in (-1, 1))
    found = load_line(np.array(current), load, 5.0)
    slope = (high - low) / (2e-3 * step)
    assert float(found.drive_ohm) == pytest.approx(-slope, rel=1e-4, abs=1e-9 * load)
    assert 0.0 < float(found.output_ohm) <= load


@given(low=st.floats(0.0, 1.0), more=st.floats(1e-6, 1.0))
def test_brighter_is_lower_everywhere(low: float, more: float) -> None:
    dim, bright = volts(np.array([[low, 0.0], [low + more, 0.0]]), plain_circuit())[:, 0]
    assert bright < dim


def test_no_light_is_the_supply_less_the_dark_current() -> None:
    dark = volts(np.zeros(2), plain_circuit())
    assert dark == pytest.approx(5.0 - 2000.0 * 1e-9, abs=1e-12)
    hot = volts(np.zeros(2), plain_circuit(), temperature_C=25.0 + 5 * 8.0)
    assert 5.0 - hot == pytest.approx(32 * (5.0 - dark), rel=1e-6), "the dark current doubles every 8 K"


def test_ambient_light_adds_to_the_current() -> None:
    """1 mW/cm² of it is 400 µA, 0.8 V over 2 kΩ."""
    circuit = plain_circuit()
    assert volts(np.zeros(2), circuit, ambient_mW_cm2=1.0) == pytest.approx(4.2, abs=1e-5)
    rows = volts(np.zeros((3, 2)), circuit, ambient_mW_cm2=np.array([0.0, 1.0, 2.0]))
    assert rows[:, 0] == pytest.approx([5.0, 4.2, 3.4], abs=1e-5)
    each = volts(np.zeros((1, 2)), circuit, ambient_mW_cm2=np.array([[0.0, 1.0]]))
    assert each[0] == pytest.approx([5.0, 4.2], abs=1e-5)


def test_temperature_moves_emitter_and_receiver() -> None:
    """10 K: the emitter loses 3.5 %, the receiver gains 10 %."""
    cold, warm = (5.0 - volts(np.array([0.2, 0.0]), plain_circuit(), temperature_C=t)[0] for t in (25.0, 35.0))
    assert warm / cold == pytest.approx(0.965 * 1.1, rel=1e-4)
    rows = volts(np.full((2, 2), 0.2), plain_circuit(), temperature_C=np.array([25.0, 35.0]))
    assert 5.0 - rows[:, 0] == pytest.approx([cold, warm])


def test_the_emitter_follows_its_current() -> None:
    part = library_part("VSMY1850")
    assert isinstance(part, EmitterPart)
    full, tenth = Drive.of(part, 100.0), Drive.of(part, 10.0)
    assert (full.typical_mW, full.min_mW, full.max_mW) == pytest.approx((50.0, 25.0, 75.0))
    assert tenth.typical_mW == pytest.approx(5.0)
    assert tenth.max_mW == pytest.approx(7.5 * 10**0.07), "an exponent of 0.93 leaves more at a low current"
    assert float(full.power_mW(35.0)) == pytest.approx(50.0 * (1 - 0.035))
    assert float(full.power_mW(1e6)) == 0.0


def test_without_a_power_it_is_the_intensity_over_the_pattern() -> None:
    """10 mW/sr over the shipped pattern's 5.0 sr."""
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


def test_the_daylight_filter_shuts_out_visible_emitters() -> None:
    infrared, blue = (spectral_response(receiver(), ((nm, 1.0),)) for nm in (860.0, 450.0))
    assert infrared == pytest.approx(1.17, abs=0.03)
    assert blue / infrared <= 0.0103
    half_low, half_high = (spectral_response(receiver(), ((nm, 1.0),)) * 0.85 for nm in (750.0, 1010.0))
    assert (half_low, half_high) == pytest.approx((0.5, 0.5)), "the stated band"
    assert spectral_response(receiver("TEMT7000X01"), ((470.0, 1.0),)) * 0.87 == pytest.approx(0.1)


def test_a_spectrum_is_weighted() -> None:
    lines = ((850.0, 3.0), (950.0, 1.0))
    single = [spectral_response(receiver(), ((nm, 1.0),)) for nm, _ in lines]
    assert spectral_response(receiver(), lines) == pytest.approx((3 * single[0] + single[1]) / 4)
    assert spectral_response(receiver().model_copy(update={"spectrum": None}), lines) == 1.0


def test_a_flat_window_counts_power_whatever_its_angle() -> None:
    """A half angle of 60° is the cosine, which power through the face holds already; a lens at ±20° loses the side."""
    assert exponent_of(receiver()) == pytest.approx(1.0, abs=1e-12)
    angles, even = np.linspace(-85, 85, 171), np.ones((2, 171))
    assert angular_factor(1.0, angles, even) == pytest.approx(1.0)
    half = receiver().half_angle_deg
    assert half is not None
    narrow = receiver().model_copy(update={"half_angle_deg": half.model_copy(update={"typical": 20.0})})
    m = exponent_of(narrow)
    assert np.cos(np.radians(20.0)) ** m == pytest.approx(0.5)
    one = np.zeros(171)
    one[85 + 20] = 1.0
    assert float(angular_factor(m, angles, one)) == pytest.approx(0.5 / np.cos(np.radians(20.0)))
    assert float(angular_factor(m, angles, np.zeros(171))) == 1.0


def test_parts_spread_by_nine() -> None:
    """A factor 3 of the receivers and one of the emitters."""
    cases = spread(plain_circuit())
    drop = {case: 5.0 - volts(np.array([0.05, 0.0]), one)[0] for case, one in cases.items()}
    assert drop["brightest"] / drop["dimmest"] == pytest.approx(9.0, rel=1e-3)
    assert cases["typical"] == plain_circuit()


def test_drawn_parts_stay_inside_their_limits_and_come_again_with_the_seed() -> None:
    drawn = [plain_circuit().drawn(np.random.default_rng(seed)) for seed in range(200)]
    sensitivities = np.array([one.sensitivity_uA for one in drawn])
    assert sensitivities.min() >= PART.min_uA
    assert sensitivities.max() <= PART.max_uA
    of_mean = 400.0 / np.sqrt(12.0 * sensitivities.size)
    assert sensitivities.mean() == pytest.approx(400.0, abs=4 * of_mean)
    assert len(set(sensitivities.ravel().tolist())) == sensitivities.size, "each receiver is a part of its own"
    assert plain_circuit().drawn(np.random.default_rng(3)) == drawn[3]
    powers = [one.drive.typical_mW for one in drawn]
    assert DRIVE.min_mW <= min(powers) < max(powers) <= DRIVE.max_mW


def test_the_converter_rounds_and_cuts() -> None:
    adc = Adc("small", 3, 0.0, 4.0)
    assert adc.step_V == 0.5
    assert adc.read(np.array([-1.0, 0.24, 0.26, 1.9, 3.6, 9.0])).tolist() == [0.0, 0.0, 0.5, 2.0, 3.5, 3.5]


@pytest.mark.parametrize(
    ("supply", "asked", "expected"), [(5.0, None, 10.0), (3.3, None, 5.0), (5.0, [-5.0, 5.0], 5.0)]
)
def test_the_converters_range_goes_beyond_the_supply(supply: float, asked: object, expected: float) -> None:
    assert paper_circuit(readout__supply_v=supply, readout__adc_range_v=asked).adc.high_V == expected


def test_a_supply_beyond_every_range_takes_the_widest() -> None:
    assert paper_circuit(readout__adc="ATmega328P", readout__supply_v=5.0).adc.high_V == 5.0


@pytest.mark.parametrize(
    ("values", "error", "words"),
    [
        ({"readout__adc_range_v": [-3.0, 3.0]}, SpecError, "range of USB-6218"),
        ({"readout__adc_range_v": [3.0, -3.0]}, SpecError, "must run from low to high"),
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
def test_a_circuit_that_cannot_be_is_refused(values: dict[str, object], error: type[Exception], words: str) -> None:
    with pytest.raises(error) as refusal:
        paper_circuit(**values)
    assert words in str(refusal.value)


@pytest.mark.parametrize(
    ("fractions", "ambient", "words"),
    [
        (np.zeros(3), 0.0, "must have 2 columns"),
        (np.array([0.1, -0.1]), 0.0, "at least 0"),
        (np.array([0.1, np.nan]), 0.0, "numbers that are at least 0"),
        (np.zeros(2), -1.0, "ambient_mW_cm2"),
    ],
)
def test_light_that_is_none_is_refused(fractions: np.ndarray, ambient: float, words: str) -> None:
    with pytest.raises(SpecError, match=words):
        volts(fractions, plain_circuit(), ambient_mW_cm2=ambient)


PLAIN = """
schema = 1
name = "{name}"
kind = "{kind}"
maker = "me"
document = "my notes"
"""
OWN = 'basis = "measured"\nsource = "bench"\n'


def test_parts_of_ones_own_are_read_beside_the_design(tmp_path: Path) -> None:
    """What a part leaves out is as usual: no spectrum is no dependence on the wavelength."""
    mine = PLAIN.format(name="Mine", kind="receiver") + f"[current_ua_per_mw_cm2]\ntypical = 100\n{OWN}"
    adc = PLAIN.format(name="Board", kind="adc") + f"bits = 14\n[[range]]\nlow_v = 0\nhigh_v = 6\nnoise_uv = 50\n{OWN}"
    for name, text in (("mine.toml", mine), ("board.toml", adc)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    design = paper_design(readout__part="mine.toml", readout__adc="board.toml").in_folder(tmp_path)
    assert set(design.files) == {"readout.part", "readout.adc"}
    circuit = circuit_of(design, {"right": 12.0})
    assert circuit.transistor == Phototransistor("Mine", 100.0, 100.0, 100.0)
    assert replace(circuit.adc, noise_V=0.0) == Adc("Board", 14, 0.0, 6.0)
    assert circuit.adc.noise_V == pytest.approx(50e-6)
    assert circuit.sensitivity_uA == (100.0,)
