"""The advised load brings the lowest reading to the target for every set of parts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solen.parts import TrimmerPart, library_part
from solen.readout import advise, cases_of
from solen.readout.advice import slopes_V_per_deg
from tests.readout.circuit_support import plain_circuit

FRACTIONS = np.array([[0.4, 0.0], [0.2, 0.2], [0.0, 0.4]])


def trimmer() -> TrimmerPart:
    part = library_part("TC33X-2-202E")
    assert isinstance(part, TrimmerPart)
    return part


@given(scale=st.floats(1e-3, 50.0), ambient=st.floats(0.0, 1.0))
def test_largest_load_brings_the_lowest_reading_to_the_target(scale: float, ambient: float) -> None:
    advice = advise(plain_circuit(), scale * FRACTIONS, trimmer(), ambient)
    for case, circuit in cases_of(plain_circuit()).items():
        setting = advice.of(case)
        line = circuit.with_load(setting.largest_ohm)
        readings = line.load_line(line.current_mA(scale * FRACTIONS, ambient)).volts
        assert readings.min() == pytest.approx(advice.target_V, abs=1e-9)
        assert setting.saturates == (setting.volts_bright < advice.target_V)
        assert 40.0 <= setting.set_ohm <= 2000.0
        assert (setting.turn is None) == (not 40.0 <= setting.largest_ohm <= 2000.0)


def test_brighter_parts_need_a_smaller_load_in_proportion() -> None:
    advice = advise(plain_circuit(), FRACTIONS, trimmer())
    dim, usual, bright = (advice.of(case).largest_ohm for case in ("dimmest", "typical", "brightest"))
    assert (dim / usual, dim / bright) == pytest.approx((4.0, 9.0), rel=1e-4)


@pytest.mark.parametrize("ambient", [0.0, 0.3])
def test_trimmer_can_be_set_for_all_parts_at_the_advised_current(ambient: float) -> None:
    circuit = plain_circuit()
    advice = advise(circuit, FRACTIONS, trimmer(), ambient)
    assert advice.emitter_current_mA is not None
    factor = advice.emitter_current_mA / circuit.drive.current_mA
    drive = circuit.drive
    stronger = replace(
        drive, typical_mW=factor * drive.typical_mW, min_mW=factor * drive.min_mW, max_mW=factor * drive.max_mW
    )
    stronger_advice = advise(replace(circuit, drive=stronger), FRACTIONS, trimmer(), ambient)
    assert all(setting.turn is not None for setting in stronger_advice.settings)
    assert stronger_advice.of("dimmest").largest_ohm == pytest.approx(0.9 * 1500.0, rel=1e-9), (
        "of the smallest trimmer resistance"
    )


def test_no_current_is_advised_above_the_emitters_rating() -> None:
    assert advise(plain_circuit(), 1e-3 * FRACTIONS, trimmer()).emitter_current_mA is None
    assert advise(plain_circuit(), 0.0 * FRACTIONS, trimmer()).emitter_current_mA is None
    assert advise(plain_circuit(), FRACTIONS, trimmer(), 50.0).emitter_current_mA is None, (
        "ambient light saturates the receivers"
    )


def test_load_is_not_limited_without_light() -> None:
    dark = replace(plain_circuit().transistor, dark_nA=1e-9)
    advice = advise(plain_circuit(transistor=dark), 0.0 * FRACTIONS, trimmer())
    assert advice.of("typical").largest_ohm > 1e9
    assert not advice.of("brightest").saturates
    assert advice.of("typical").used == pytest.approx(0.0, abs=1e-9)


def test_target_at_a_low_supply_is_halfway_to_saturation() -> None:
    assert advise(plain_circuit(supply_V=0.8), FRACTIONS, trimmer()).target_V == pytest.approx(0.475)


def test_slopes_of_a_parabola_are_exact_between_the_ends() -> None:
    angle = np.array([-2.0, -1.0, 0.5, 1.0, 3.0])
    advice = slopes_V_per_deg(angle, np.stack([angle**2, 3 * angle], axis=1))
    assert advice[1:-1, 0] == pytest.approx(2 * angle[1:-1])
    assert advice[:, 1] == pytest.approx(3.0)
    assert slopes_V_per_deg(np.array([1.0]), np.array([[2.0, 3.0]])).tolist() == [[0.0, 0.0]]
