"""Hyperelastic models: every derivative agrees with finite differences of the energy, and known limits hold."""

import numpy as np
import pytest

from solen.errors import SpecError
from solen.material.stiffness import EQUIBIAXIAL, KINDS, MODES, PLANAR, UNIAXIAL, Mode, model
from solen.material.stiffness.toe import measure

PARAMETERS = {
    "neo-hookean": [0.2],
    "mooney-rivlin": [0.15, 0.04],
    "yeoh": [0.18, -0.004, 0.002],
    "ogden-1": [0.3, 2.4],
    "ogden-2": [0.4, -0.02, 1.6, -3.0],
    "ogden-3": [0.6, 0.001, -0.01, 1.3, 5.0, -2.0],
}
STRETCH = np.array([0.45, 0.7, 0.93, 1.0, 1.08, 1.5, 2.7])
STEP = 1e-5  # central differences of smooth functions of order 1: error ~ STEP² plus rounding/STEP, below 1e-8
MODE = list(MODES.values())


@pytest.mark.parametrize("mode", MODE, ids=lambda mode: mode.name)
@pytest.mark.parametrize("kind", KINDS)
def test_the_stress_is_what_the_energy_gains_along_the_way(kind: str, mode: Mode) -> None:
    ours, parameters = model(kind), PARAMETERS[kind]

    def energy(stretch: np.ndarray) -> np.ndarray:
        first, second, _ = mode.principal(stretch)
        return ours.energy(parameters, first, second)

    slope = (energy(STRETCH + STEP) - energy(STRETCH - STEP)) / (2 * STEP) / mode.directions
    np.testing.assert_allclose(ours.stress(parameters, mode, STRETCH), slope, rtol=2e-7, atol=1e-8)


@pytest.mark.parametrize("mode", MODE, ids=lambda mode: mode.name)
@pytest.mark.parametrize("kind", KINDS)
def test_the_jacobian_is_the_stress_by_the_parameters(kind: str, mode: Mode) -> None:
    ours, parameters = model(kind), np.array(PARAMETERS[kind])
    found = ours.jacobian(parameters, mode, STRETCH)
    for column in range(len(parameters)):
        step = np.zeros_like(parameters)
        step[column] = STEP
        change = ours.stress(parameters + step, mode, STRETCH) - ours.stress(parameters - step, mode, STRETCH)
        np.testing.assert_allclose(found[:, column], change / (2 * STEP), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
def test_the_gradient_is_the_energy_by_the_logarithmic_strains(kind: str) -> None:
    ours, parameters = model(kind), PARAMETERS[kind]
    first, second = np.array([0.5, 0.8, 1.0, 1.3, 2.4]), np.array([0.9, 1.4, 1.0, 0.7, 1.1])

    def energy(one: float, two: float) -> np.ndarray:
        return ours.energy(parameters, first * np.exp(one), second * np.exp(two))

    along = [energy(STEP, 0) - energy(-STEP, 0), energy(0, STEP) - energy(0, -STEP)]
    np.testing.assert_allclose(
        ours.gradient(parameters, first, second), np.stack(along, axis=-1) / (2 * STEP), rtol=2e-7, atol=1e-8
    )


@pytest.mark.parametrize("kind", KINDS)
def test_the_hessian_is_the_energy_twice_by_the_logarithmic_strains(kind: str) -> None:
    ours, parameters = model(kind), PARAMETERS[kind]
    first, second, step = np.array([0.5, 0.8, 1.3, 2.4]), np.array([0.9, 1.4, 0.7, 1.1]), 1e-4

    def energy(one: float, two: float) -> np.ndarray:
        return ours.energy(parameters, first * np.exp(one), second * np.exp(two))

    middle = energy(0, 0)
    along = [(energy(step, 0) - 2 * middle + energy(-step, 0)), (energy(0, step) - 2 * middle + energy(0, -step))]
    across = energy(step, step) - energy(step, -step) - energy(-step, step) + energy(-step, -step)
    wanted = np.moveaxis(np.array([[along[0], across / 4], [across / 4, along[1]]]) / step**2, -1, 0)
    # rounding of W (up to 1e-14) over step² = 1e-8: 1e-6; truncation step²/12 of a fourth derivative below 1e4: 1e-5
    np.testing.assert_allclose(ours.hessian(parameters, first, second), wanted, rtol=1e-5, atol=2e-5)


@pytest.mark.parametrize("mode", MODE, ids=lambda mode: mode.name)
@pytest.mark.parametrize("kind", KINDS)
def test_the_first_slope_is_young_times_the_ratio_of_the_mode(kind: str, mode: Mode) -> None:
    ours, parameters = model(kind), PARAMETERS[kind]
    near = np.array([1 - STEP, 1 + STEP])
    slope = float(np.diff(ours.stress(parameters, mode, near))[0]) / (2 * STEP)
    young = 3 * ours.shear_modulus_row(parameters)[0]
    assert slope == pytest.approx(mode.slope_ratio * young, rel=1e-6)
    assert ours.stress(parameters, mode, np.array([1.0]))[0] == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_the_shear_modulus_by_the_parameters(kind: str) -> None:
    ours, parameters = model(kind), np.array(PARAMETERS[kind])
    row = ours.shear_modulus_row(parameters)[1]
    for column in range(len(parameters)):
        step = np.zeros_like(parameters)
        step[column] = STEP
        above, below = (ours.shear_modulus_row(parameters + way * step)[0] for way in (1, -1))
        assert row[column] == pytest.approx((above - below) / (2 * STEP), rel=1e-7, abs=1e-9)


def test_ratios_of_the_modes() -> None:
    assert [mode.slope_ratio for mode in (UNIAXIAL, PLANAR, EQUIBIAXIAL)] == pytest.approx([1, 4 / 3, 2])


def test_models_that_are_one_another() -> None:
    neo, ogden = model("neo-hookean"), model("ogden-1")
    mooney, two = model("mooney-rivlin"), model("ogden-2")
    for mode in MODE:
        np.testing.assert_allclose(
            neo.stress([0.2], mode, STRETCH), ogden.stress([0.4, 2.0], mode, STRETCH), rtol=1e-13, atol=1e-15
        )
        np.testing.assert_allclose(
            mooney.stress([0.2, 0.05], mode, STRETCH),
            two.stress([0.4, -0.1, 2.0, -2.0], mode, STRETCH),
            rtol=1e-12,
            atol=1e-15,
        )


def test_equibiaxial_tension_is_uniaxial_compression_under_a_pressure() -> None:
    """Of an incompressible solid the true stress difference is the same: σ(λ, biaxial) = -σ(λ⁻², uniaxial)."""
    for kind, parameters in PARAMETERS.items():
        ours = model(kind)
        pulled = np.array([1.1, 1.4, 1.9])
        pressed = pulled**-2.0
        biaxial = ours.stress(parameters, EQUIBIAXIAL, pulled) * pulled
        np.testing.assert_allclose(biaxial, -ours.stress(parameters, UNIAXIAL, pressed) * pressed, rtol=1e-11)


def test_the_measure_of_the_toe_is_the_neo_hookean_stress_over_its_modulus() -> None:
    for mode in MODE:
        expected = model("neo-hookean").stress([1 / 6], mode, STRETCH)
        np.testing.assert_allclose(measure(mode, STRETCH - 1), expected, rtol=1e-12, atol=1e-15)


def test_an_unknown_model_is_refused() -> None:
    with pytest.raises(SpecError, match="fit = 'gent'; must be one of neo-hookean"):
        model("gent")
