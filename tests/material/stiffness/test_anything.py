"""Whatever a record holds, it gives finite numbers or one line: no traceback, no NaN."""

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

WILD = st.one_of(
    st.floats(-1.5, 20),
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, -0.0, 1e-300, -1e-300, 1e-12, 1e300, -0.999999]),
)
TAME = st.one_of(st.floats(-0.9, 3), st.sampled_from([0.0, 0.1, 0.1, 0.5]))


@st.composite
def records(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Strain and stress: wild numbers, tame noise, and rubbers in steps, standing still, back and forth."""
    kind = draw(st.sampled_from(["wild", "noise", "noise", "rubber", "steps", "still", "cycles"]))
    if kind in {"wild", "noise"}:
        points, elements = draw(st.integers(1, 60)), WILD if kind == "wild" else TAME
        return draw(arrays(float, points, elements=elements)), draw(arrays(float, points, elements=elements))
    low, high = draw(st.sampled_from([0, 0.01, -0.4])), draw(st.sampled_from([0.001, 0.5, 6]))
    strain = np.linspace(low, high, draw(st.integers(5, 120)))
    strain = np.concatenate([strain, strain[::-1], strain]) if kind == "cycles" else strain
    strain = np.round(strain, 1) if kind == "still" else strain
    stress = strain + 1 - (strain + 1) ** -2.0
    stress = np.round(stress, 1) if kind == "steps" else stress
    size, noise = draw(st.sampled_from([1e-9, 1.0, 1e5])), draw(st.sampled_from([0, 0.01, 1]))
    wobble = np.random.default_rng(draw(st.integers(0, 9))).standard_normal(len(strain))
    return draw(st.sampled_from([1, -1])) * strain, draw(st.sampled_from([1, -1])) * size * (stress + noise * wobble)


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
def test_any_record_gives_finite_numbers_or_one_line(
    record: tuple[np.ndarray, np.ndarray], mode: TestMode | None, toe: str, cycle: str, kind: str, weighting: Weighting
) -> None:
    try:
        test = as_test(*record, specimen_of(Dimensions(cube_mm=10)), mode)
        found = evaluate(test, StiffnessOptions(toe=toe, cycle=cycle))
        mean = mean_modulus([found.young, found.young])
        models = [fit(kind, [found.fitted], weighting)]
    except SolenError:
        return
    values = plain([found, mean, *models])
    assert json.loads(json.dumps(values, allow_nan=False)) == values
    numbers = [found.young.modulus_MPa, mean.u_modulus_MPa, *(value for m in models for value in m.values)]
    assert np.isfinite(numbers).all()
    choose(models)
    assert all("\n" not in told for m in models for told in cautions(m))
