"""Any record yields finite numbers or an error of one line: no traceback, no NaN."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from solen.errors import SolenError
from solen.material.stiffness import (
    Dimensions,
    StiffnessOptions,
    as_test,
    cautions,
    choose,
    evaluate,
    fit,
    mean_modulus,
    specimen_of,
)
from solen.material.stiffness.hyperelastic import Weighting
from solen.material.stiffness.modes import TestMode
from solen.results import plain

ANY_NUMBERS = st.one_of(
    st.floats(-1.5, 20),
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, -0.0, 1e-300, -1e-300, 1e-12, 1e300, -0.999999]),
)
PLAUSIBLE_NUMBERS = st.one_of(st.floats(-0.9, 3), st.sampled_from([0.0, 0.1, 0.1, 0.5]))


@st.composite
def records(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Return strain and stress: any numbers, noise, and rubbers with coarse steps, repeated strains, or cycles."""
    kind = draw(st.sampled_from(["any", "noise", "noise", "rubber", "coarse stress", "coarse strain", "cycles"]))
    if kind in {"any", "noise"}:
        points, elements = draw(st.integers(1, 60)), ANY_NUMBERS if kind == "any" else PLAUSIBLE_NUMBERS
        return draw(arrays(float, points, elements=elements)), draw(arrays(float, points, elements=elements))
    low, high = draw(st.sampled_from([0, 0.01, -0.4])), draw(st.sampled_from([0.001, 0.5, 6]))
    strain = np.linspace(low, high, draw(st.integers(5, 120)))
    strain = np.concatenate([strain, strain[::-1], strain]) if kind == "cycles" else strain
    strain = np.round(strain, 1) if kind == "coarse strain" else strain
    stress = strain + 1 - (strain + 1) ** -2.0
    stress = np.round(stress, 1) if kind == "coarse stress" else stress
    scale, noise = draw(st.sampled_from([1e-9, 1.0, 1e5])), draw(st.sampled_from([0, 0.01, 1]))
    deviations = np.random.default_rng(draw(st.integers(0, 9))).standard_normal(len(strain))
    return draw(st.sampled_from([1, -1])) * strain, draw(st.sampled_from([1, -1])) * scale * (
        stress + noise * deviations
    )


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    record=records(),
    mode=st.sampled_from([None, "tension", "compression", "uniaxial", "planar", "equibiaxial"]),
    toe=st.sampled_from(["auto", "none", "always"]),
    cycle=st.sampled_from(["first", "last"]),
    kind=st.sampled_from(["neo-hookean", "mooney-rivlin", "yeoh", "ogden-1", "ogden-2"]),
    weighting=st.sampled_from(["absolute", "relative"]),
)
@pytest.mark.filterwarnings("error")
def test_any_record_yields_finite_numbers_or_one_line(
    record: tuple[np.ndarray, np.ndarray], mode: TestMode | None, toe: str, cycle: str, kind: str, weighting: Weighting
) -> None:
    try:
        test = as_test(*record, specimen_of(Dimensions(cube_mm=10)), mode)
        specimen = evaluate(test, StiffnessOptions(toe=toe, cycle=cycle))
        mean = mean_modulus([specimen.young, specimen.young])
        models = [fit(kind, [specimen.fitted], weighting)]
    except SolenError:
        return
    values = plain([specimen, mean, *models])
    assert json.loads(json.dumps(values, allow_nan=False)) == values
    numbers = [specimen.young.modulus_MPa, mean.u_modulus_MPa, *(value for fitted in models for value in fitted.values)]
    assert np.isfinite(numbers).all()
    choose(models)
    assert all("\n" not in warning for fitted in models for warning in cautions(fitted))
