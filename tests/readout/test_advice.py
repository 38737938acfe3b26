"""Advice on the load: what it sets brings the brightest reading to the target, for every set of parts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solen.parts import TrimmerPart, library_part
from solen.readout import advise, spread
from solen.readout.advice import slopes_V_per_deg
from tests.readout.circuit_support import plain_circuit

FRACTIONS = np.array([[0.4, 0.0], [0.2, 0.2], [0.0, 0.4]])


def trimmer() -> TrimmerPart:
    part = library_part("TC33X-2-202E")
    assert isinstance(part, TrimmerPart)
    return part


@given(scale=st.floats(1e-3, 50.0), ambient=st.floats(0.0, 1.0))
def test_the_largest_load_brings_the_brightest_reading_to_the_target(scale: float, ambient: float) -> None:
    found = advise(plain_circuit(), scale * FRACTIONS, trimmer(), ambient)
    for case, circuit in spread(plain_circuit()).items():
        one = found.of(case)
        line = circuit.with_load(one.largest_ohm)
        readings = line.load_line(line.current_mA(scale * FRACTIONS, ambient)).volts
        assert readings.min() == pytest.approx(found.target_V, abs=1e-9)
        assert one.saturates == (one.volts_bright < found.target_V)
        assert 40.0 <= one.set_ohm <= 2000.0
        assert (one.turn is None) == (not 40.0 <= one.largest_ohm <= 2000.0)


def test_brighter_parts_need_a_smaller_load_in_proportion() -> None:
    found = advise(plain_circuit(), FRACTIONS, trimmer())
    dim, usual, bright = (found.of(case).largest_ohm for case in ("dimmest", "typical", "brightest"))
    assert (dim / usual, dim / bright) == pytest.approx((4.0, 9.0), rel=1e-4)


@pytest.mark.parametrize("ambient", [0.0, 0.3])
def test_with_the_advised_current_the_trimmer_reaches_all_parts(ambient: float) -> None:
    circuit = plain_circuit()
    found = advise(circuit, FRACTIONS, trimmer(), ambient)
    assert found.emitter_current_mA is not None
    times = found.emitter_current_mA / circuit.drive.current_mA
    drive = circuit.drive
    stronger = replace(
        drive, typical_mW=times * drive.typical_mW, min_mW=times * drive.min_mW, max_mW=times * drive.max_mW
    )
    again = advise(replace(circuit, drive=stronger), FRACTIONS, trimmer(), ambient)
    assert all(one.turn is not None for one in again.settings)
    assert again.of("dimmest").largest_ohm == pytest.approx(0.9 * 1500.0, rel=1e-9), "of the smallest trimmer"


def test_a_current_beyond_what_the_emitter_carries_is_not_advised() -> None:
    assert advise(plain_circuit(), 1e-3 * FRACTIONS, trimmer()).emitter_current_mA is None
    assert advise(plain_circuit(), 0.0 * FRACTIONS, trimmer()).emitter_current_mA is None
    assert advise(plain_circuit(), FRACTIONS, trimmer(), 50.0).emitter_current_mA is None, "ambient light takes it all"


def test_no_light_asks_for_no_load() -> None:
    dark = replace(plain_circuit().transistor, dark_nA=1e-9)
    found = advise(plain_circuit(transistor=dark), 0.0 * FRACTIONS, trimmer())
    assert found.of("typical").largest_ohm > 1e9
    assert not found.of("brightest").saturates
    assert found.of("typical").used == pytest.approx(0.0, abs=1e-9)


def test_a_low_supply_has_its_target_halfway() -> None:
    assert advise(plain_circuit(supply_V=0.8), FRACTIONS, trimmer()).target_V == pytest.approx(0.475)


def test_slopes_are_exact_for_a_parabola_inside() -> None:
    angle = np.array([-2.0, -1.0, 0.5, 1.0, 3.0])
    found = slopes_V_per_deg(angle, np.stack([angle**2, 3 * angle], axis=1))
    assert found[1:-1, 0] == pytest.approx(2 * angle[1:-1])
    assert found[:, 1] == pytest.approx(3.0)
    assert slopes_V_per_deg(np.array([1.0]), np.array([[2.0, 3.0]])).tolist() == [[0.0, 0.0]]
