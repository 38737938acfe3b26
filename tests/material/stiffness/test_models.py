"""Hyperelastic models: all derivatives agree with finite differences of the energy; known limits and identities."""

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
STEP = 1e-5  # central differences of smooth functions of order 1: error of about STEP² plus rounding/STEP, below 1e-8
ALL_MODES = list(MODES.values())


@pytest.mark.parametrize("mode", ALL_MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("kind", KINDS)
def test_the_stress_is_the_derivative_of_the_energy(kind: str, mode: Mode) -> None:
    hyperelastic, parameters = model(kind), PARAMETERS[kind]

    def energy(stretch: np.ndarray) -> np.ndarray:
        first, second, _ = mode.principal(stretch)
        return hyperelastic.energy(parameters, first, second)

    slope = (energy(STRETCH + STEP) - energy(STRETCH - STEP)) / (2 * STEP) / mode.directions
    np.testing.assert_allclose(hyperelastic.stress(parameters, mode, STRETCH), slope, rtol=2e-7, atol=1e-8)


@pytest.mark.parametrize("mode", ALL_MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("kind", KINDS)
def test_the_jacobian_is_the_derivative_of_the_stress_with_respect_to_the_parameters(kind: str, mode: Mode) -> None:
    hyperelastic, parameters = model(kind), np.array(PARAMETERS[kind])
    jacobian = hyperelastic.jacobian(parameters, mode, STRETCH)
    for column in range(len(parameters)):
        step = np.zeros_like(parameters)
        step[column] = STEP
        change = hyperelastic.stress(parameters + step, mode, STRETCH) - hyperelastic.stress(
            parameters - step, mode, STRETCH
        )
        np.testing.assert_allclose(jacobian[:, column], change / (2 * STEP), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
def test_the_gradient_is_the_derivative_of_the_energy_with_respect_to_logarithmic_strain(kind: str) -> None:
    hyperelastic, parameters = model(kind), PARAMETERS[kind]
    first, second = np.array([0.5, 0.8, 1.0, 1.3, 2.4]), np.array([0.9, 1.4, 1.0, 0.7, 1.1])

    def energy(strain1: float, strain2: float) -> np.ndarray:
        return hyperelastic.energy(parameters, first * np.exp(strain1), second * np.exp(strain2))

    differences = [energy(STEP, 0) - energy(-STEP, 0), energy(0, STEP) - energy(0, -STEP)]
    expected = np.stack(differences, axis=-1) / (2 * STEP)
    np.testing.assert_allclose(hyperelastic.gradient(parameters, first, second), expected, rtol=2e-7, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_the_hessian_is_the_second_derivative_of_the_energy_with_respect_to_logarithmic_strain(kind: str) -> None:
    hyperelastic, parameters = model(kind), PARAMETERS[kind]
    first, second, step = np.array([0.5, 0.8, 1.3, 2.4]), np.array([0.9, 1.4, 0.7, 1.1]), 1e-4

    def energy(strain1: float, strain2: float) -> np.ndarray:
        return hyperelastic.energy(parameters, first * np.exp(strain1), second * np.exp(strain2))

    centre = energy(0, 0)
    diagonal = [energy(step, 0) - 2 * centre + energy(-step, 0), energy(0, step) - 2 * centre + energy(0, -step)]
    mixed = (energy(step, step) - energy(step, -step) - energy(-step, step) + energy(-step, -step)) / 4
    expected = np.moveaxis(np.array([[diagonal[0], mixed], [mixed, diagonal[1]]]) / step**2, -1, 0)
    # rounding of W, 1e-14, divided by step² is 1e-6; truncation, step²/12 times the fourth derivative, below 1e-5
    np.testing.assert_allclose(hyperelastic.hessian(parameters, first, second), expected, rtol=1e-5, atol=2e-5)


@pytest.mark.parametrize("mode", ALL_MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("kind", KINDS)
def test_the_initial_slope_is_youngs_modulus_times_the_ratio_of_the_mode(kind: str, mode: Mode) -> None:
    hyperelastic, parameters = model(kind), PARAMETERS[kind]
    near = np.array([1 - STEP, 1 + STEP])
    slope = float(np.diff(hyperelastic.stress(parameters, mode, near))[0]) / (2 * STEP)
    young = 3 * hyperelastic.shear_modulus_row(parameters)[0]
    assert slope == pytest.approx(mode.slope_ratio * young, rel=1e-6)
    assert hyperelastic.stress(parameters, mode, np.array([1.0]))[0] == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_of_the_shear_modulus_agree_with_finite_differences(kind: str) -> None:
    hyperelastic, parameters = model(kind), np.array(PARAMETERS[kind])
    row = hyperelastic.shear_modulus_row(parameters)[1]
    for column in range(len(parameters)):
        step = np.zeros_like(parameters)
        step[column] = STEP
        above, below = (hyperelastic.shear_modulus_row(parameters + sign * step)[0] for sign in (1, -1))
        assert row[column] == pytest.approx((above - below) / (2 * STEP), rel=1e-7, abs=1e-9)


def test_ratios_of_the_modes() -> None:
    assert [mode.slope_ratio for mode in (UNIAXIAL, PLANAR, EQUIBIAXIAL)] == pytest.approx([1, 4 / 3, 2])


def test_ogden_models_include_neo_hookean_and_mooney_rivlin() -> None:
    neo, ogden = model("neo-hookean"), model("ogden-1")
    mooney, ogden_2 = model("mooney-rivlin"), model("ogden-2")
    for mode in ALL_MODES:
        np.testing.assert_allclose(
            neo.stress([0.2], mode, STRETCH), ogden.stress([0.4, 2.0], mode, STRETCH), rtol=1e-13, atol=1e-15
        )
        np.testing.assert_allclose(
            mooney.stress([0.2, 0.05], mode, STRETCH),
            ogden_2.stress([0.4, -0.1, 2.0, -2.0], mode, STRETCH),
            rtol=1e-12,
            atol=1e-15,
        )


def test_equibiaxial_tension_equals_uniaxial_compression_up_to_a_pressure() -> None:
    """For an incompressible solid, σ(λ, equibiaxial) = −σ(λ⁻², uniaxial) for the true stress."""
    for kind, parameters in PARAMETERS.items():
        hyperelastic = model(kind)
        stretched = np.array([1.1, 1.4, 1.9])
        compressed = stretched**-2.0
        biaxial = hyperelastic.stress(parameters, EQUIBIAXIAL, stretched) * stretched
        np.testing.assert_allclose(
            biaxial, -hyperelastic.stress(parameters, UNIAXIAL, compressed) * compressed, rtol=1e-11
        )


def test_the_strain_measure_of_the_toe_is_the_neo_hookean_stress_over_the_modulus() -> None:
    for mode in ALL_MODES:
        expected = model("neo-hookean").stress([1 / 6], mode, STRETCH)
        np.testing.assert_allclose(measure(mode, STRETCH - 1), expected, rtol=1e-12, atol=1e-15)


def test_refuses_an_unknown_model() -> None:
    with pytest.raises(SpecError, match="fit = 'gent'; must be one of neo-hookean"):
        model("gent")
