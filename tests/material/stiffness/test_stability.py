"""Drucker stability: known instabilities are found where they are, and stable models are left alone."""

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
        found = stable_range(model("neo-hookean"), [0.2], mode)
        assert (found.low, found.high) == (None, None)
        assert found.covers(0.1, 10)


def test_the_end_of_a_softening_yeoh_is_the_root_of_its_margin() -> None:
    ours, parameters = model("yeoh"), [0.2, -0.02, 0.0]
    found = stable_range(ours, parameters, UNIAXIAL)
    assert found.high is not None
    assert found.low is not None
    assert abs(margin(ours, parameters, UNIAXIAL, np.array([found.high]))[0]) < 1e-8
    # an independent way: increments of true stress and logarithmic strain along a dense path, uniaxial alone. There
    # dτ·dε > 0 may hold longer than in all directions, never shorter
    stretch = np.linspace(1.0001, 4, 40_000)
    rise = np.diff(ours.stress(parameters, UNIAXIAL, stretch) * stretch)
    assert found.high <= stretch[np.flatnonzero(rise <= 0)[0]] + 1e-3


def test_the_margin_is_the_least_work_of_any_small_step() -> None:
    """Against the definition, with random increments of strain: min over directions of Σ dτ dε / |dε|²."""
    ours, parameters = model("ogden-2"), [0.5, 0.3, 1.5, -4.0]  # μα < 0: unstable at large compression
    rng = np.random.default_rng(1)
    steps = rng.standard_normal((4000, 2))
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    for stretch in (0.6, 1.0, 1.3):
        first, second, _ = UNIAXIAL.principal(np.array([stretch]))
        size = 1e-4

        def gradient(one: np.ndarray, two: np.ndarray) -> np.ndarray:
            by = 1e-6
            energy = ours.energy
            return np.stack(
                [
                    energy(parameters, one * np.exp(by), two) - energy(parameters, one * np.exp(-by), two),
                    energy(parameters, one, two * np.exp(by)) - energy(parameters, one, two * np.exp(-by)),
                ],
                axis=-1,
            ) / (2 * by)

        before = gradient(first, second)
        after = gradient(first * np.exp(size * steps[:, 0]), second * np.exp(size * steps[:, 1]))
        work = np.sum((after - before) * steps, axis=1) / size
        assert work.min() == pytest.approx(
            margin(ours, parameters, UNIAXIAL, np.array([stretch]))[0], rel=2e-3, abs=1e-3
        )


def test_an_unstable_ogden_model_is_flagged_and_not_chosen() -> None:
    """Data of a model that softens: whichever model follows them is unstable over them, and none is chosen."""
    parameters = [1.2, 0.4, 1.0, -2.0]  # μα < 0 in the second term
    stretch = np.linspace(1, 3, 40)
    stress = model("ogden-2").stress(parameters, UNIAXIAL, stretch)
    found = fit("ogden-2", [Curve(UNIAXIAL, stretch, stress)])
    assert found.quality[0].r_squared == pytest.approx(1, abs=1e-9)
    assert not found.stable_in_data
    assert choose([found]) is None
    assert any("unstable (Drucker) in its data: uniaxial stretch" in each for each in cautions(found))
    steady = fit("neo-hookean", [Curve(UNIAXIAL, stretch, stress)])
    assert steady.stable_in_data
    assert choose([found, steady]) is steady


def test_instability_in_a_mode_that_was_not_measured_is_said() -> None:
    parameters = [0.3, -0.02]  # Mooney-Rivlin with C01 < 0: stable while pulled, not biaxially
    stretch = np.linspace(1, 2, 30)
    found = fit(
        "mooney-rivlin", [Curve(UNIAXIAL, stretch, model("mooney-rivlin").stress(parameters, UNIAXIAL, stretch))]
    )
    assert found.stable_in_data
    assert found.stable["equibiaxial"].high is not None
    assert found.stable["equibiaxial"].high < 4
    far = np.linspace(1, 5, 30)
    found = fit("mooney-rivlin", [Curve(UNIAXIAL, far, model("mooney-rivlin").stress(parameters, UNIAXIAL, far))])
    told = " ".join(cautions(found))
    assert "unstable (Drucker) within the stretch ranges of the other modes: equibiaxial stretch above" in told
    assert "planar and equibiaxial deformation was not measured" in told


def test_data_beyond_the_scanned_stretches_are_looked_at() -> None:
    stretch = np.linspace(1, 17, 60)
    for mode in (UNIAXIAL, PLANAR, EQUIBIAXIAL):
        found = fit("neo-hookean", [Curve(mode, stretch, model("neo-hookean").stress([0.1], mode, stretch))])
        assert found.stable_in_data
