"""Drucker stability: limits of unstable models, and stable models without limits."""

import numpy as np
import pytest

from solen.material.stiffness import (
    EQUIBIAXIAL,
    MODES,
    PLANAR,
    UNIAXIAL,
    Curve,
    choose,
    fit,
    margin,
    model,
    stable_range,
)
from solen.material.stiffness.cautions import cautions


def test_a_neo_hookean_solid_is_stable_everywhere() -> None:
    for mode in MODES.values():
        limits = stable_range(model("neo-hookean"), [0.2], mode)
        assert (limits.low, limits.high) == (None, None)
        assert limits.covers(0.1, 10)


def test_the_limit_of_a_softening_yeoh_model_is_the_root_of_its_margin() -> None:
    hyperelastic, parameters = model("yeoh"), [0.2, -0.02, 0.0]
    limits = stable_range(hyperelastic, parameters, UNIAXIAL)
    assert limits.high is not None
    assert limits.low is not None
    assert abs(margin(hyperelastic, parameters, UNIAXIAL, np.array([limits.high]))[0]) < 1e-8
    # independent check: increments of true stress and logarithmic strain in the uniaxial direction only, where
    # dτ·dε > 0 holds at least as far as in all directions
    stretch = np.linspace(1.0001, 4, 40_000)
    increments = np.diff(hyperelastic.stress(parameters, UNIAXIAL, stretch) * stretch)
    assert limits.high <= stretch[np.flatnonzero(increments <= 0)[0]] + 1e-3


def test_the_margin_is_the_smallest_work_of_any_strain_increment() -> None:
    """Compared with the definition for random increments: the minimum over directions of Σ dτ dε / |dε|²."""
    hyperelastic, parameters = model("ogden-2"), [0.5, 0.3, 1.5, -4.0]  # μα < 0: unstable at large compression
    rng = np.random.default_rng(1)
    steps = rng.standard_normal((4000, 2))
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)

    def gradient(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        up, down, energy = np.exp(1e-6), np.exp(-1e-6), hyperelastic.energy
        by_first = energy(parameters, first * up, second) - energy(parameters, first * down, second)
        by_second = energy(parameters, first, second * up) - energy(parameters, first, second * down)
        return np.stack([by_first, by_second], axis=-1) / 2e-6

    for stretch in (0.6, 1.0, 1.3):
        first, second, _ = UNIAXIAL.principal(np.array([stretch]))
        size = 1e-4
        before = gradient(first, second)
        after = gradient(first * np.exp(size * steps[:, 0]), second * np.exp(size * steps[:, 1]))
        work = np.sum((after - before) * steps, axis=1) / size
        expected = margin(hyperelastic, parameters, UNIAXIAL, np.array([stretch]))[0]
        assert work.min() == pytest.approx(expected, rel=2e-3, abs=1e-3)


def test_an_unstable_ogden_model_is_reported_and_not_chosen() -> None:
    """A model that fits the data of a softening model is unstable in their range."""
    parameters = [1.2, 0.4, 1.0, -2.0]  # μα < 0 in the second term
    stretch = np.linspace(1, 3, 40)
    stress = model("ogden-2").stress(parameters, UNIAXIAL, stretch)
    unstable = fit("ogden-2", [Curve(UNIAXIAL, stretch, stress)])
    assert unstable.quality[0].r_squared == pytest.approx(1, abs=1e-9)
    assert not unstable.stable_in_data
    assert choose([unstable]) is None
    assert any("unstable (Drucker)" in warning and "uniaxial" in warning for warning in cautions(unstable))
    stable = fit("neo-hookean", [Curve(UNIAXIAL, stretch, stress)])
    assert stable.stable_in_data
    assert choose([unstable, stable]) is stable


def test_an_instability_in_a_mode_that_was_not_measured_is_reported() -> None:
    parameters = [0.3, -0.02]  # Mooney-Rivlin with C01 < 0: stable in tension, unstable in equibiaxial tension
    stretch = np.linspace(1, 2, 30)
    fitted = fit(
        "mooney-rivlin", [Curve(UNIAXIAL, stretch, model("mooney-rivlin").stress(parameters, UNIAXIAL, stretch))]
    )
    assert fitted.stable_in_data
    assert fitted.stable["equibiaxial"].high is not None
    assert fitted.stable["equibiaxial"].high < 4
    large = np.linspace(1, 5, 30)
    fitted = fit("mooney-rivlin", [Curve(UNIAXIAL, large, model("mooney-rivlin").stress(parameters, UNIAXIAL, large))])
    assert any(
        "unstable (Drucker)" in line and "equibiaxial stretches above 2.743" in line for line in cautions(fitted)
    )
    assert any("no planar or equibiaxial test was fitted" in line for line in cautions(fitted))


def test_stretches_outside_the_standard_range_are_checked() -> None:
    stretch = np.linspace(1, 17, 60)
    for mode in (UNIAXIAL, PLANAR, EQUIBIAXIAL):
        fitted = fit("neo-hookean", [Curve(mode, stretch, model("neo-hookean").stress([0.1], mode, stretch))])
        assert fitted.stable_in_data
