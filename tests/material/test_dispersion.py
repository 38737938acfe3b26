"""Index as a function of wavelength: known values, uncertainty compared with finite differences, refusals."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solen.errors import DataError
from solen.material import KINDS, Cauchy, Constant, Dispersion, Sellmeier, Tabulated

# Schott N-BK7, from its datasheet: n_d = 1.51680
BK7 = Sellmeier(
    B=(1.03961212, 0.231792344, 1.01046945), C_um2=(0.00600069867, 0.0200179144, 103.560653), valid_nm=(300, 2500)
)


def error_line(kind: type[Dispersion], **data: Any) -> str:
    with pytest.raises(DataError) as error:
        kind(**data)
    line = str(error.value)
    assert len(line.splitlines()) == 1
    return line


def test_a_constant_index_is_the_same_at_all_wavelengths() -> None:
    assert Constant(n=1.44).index(450) == Constant(n=1.44).index(2000) == 1.44


def test_cauchy_at_one_micrometre_is_the_sum_of_its_coefficients() -> None:
    formula = Cauchy(A=1.5, B_um2=0.004, C_um4=0.0002)
    assert formula.index(1000) == pytest.approx(1.5042, abs=1e-15)
    assert formula.index(500) == pytest.approx(1.5 + 0.004 * 4 + 0.0002 * 16, abs=1e-15)


def test_sellmeier_yields_the_datasheet_index_of_bk7() -> None:
    assert BK7.index(587.5618) == pytest.approx(1.51680, abs=5e-6)


def test_a_table_is_linear_between_its_points() -> None:
    table = Tabulated(wavelength_nm=(400, 500, 700), n=(1.52, 1.50, 1.48))
    assert [table.index(nm) for nm in (400, 450, 500, 600, 700)] == pytest.approx([1.52, 1.51, 1.50, 1.49, 1.48])


@pytest.mark.parametrize("wavelength_nm", [299.9, 2500.1, math.nan, math.inf, -500])
def test_refuses_a_wavelength_outside_the_range(wavelength_nm: float) -> None:
    for function in (BK7.index, BK7.u_index):
        with pytest.raises(DataError, match=r"known only from 300 to 2500 nm; choose a wavelength inside"):
            function(wavelength_nm)


@pytest.mark.parametrize("wavelength_nm", [0, -1, math.inf, math.nan])
def test_a_formula_without_range_refuses_wavelengths_not_above_zero(wavelength_nm: float) -> None:
    with pytest.raises(DataError, match="above 0 nm"):
        Cauchy(A=1.5).index(wavelength_nm)


def test_the_range_of_a_table_is_at_most_its_extent() -> None:
    points: dict[str, Any] = {"wavelength_nm": (400, 500), "n": (1.5, 1.4)}
    assert Tabulated(**points).range_nm == (400, 500)
    assert Tabulated(**points, valid_nm=(420, 480)).range_nm == (420, 480)
    with pytest.raises(DataError, match="known only from 420 to 480 nm"):
        Tabulated(**points, valid_nm=(420, 480)).index(410)
    line = error_line(Tabulated, **points, valid_nm=(390, 480))
    assert line == "index.valid_nm = [390.0, 480.0]; must be within the table, 400 to 500"


@pytest.mark.parametrize(
    ("formula", "wavelength_nm"),
    [
        (Cauchy(A=0.9), 500),
        (Cauchy(A=1e308, B_um2=1e308), 10),
        (Sellmeier(B=(1.0,), C_um2=(0.25,)), 500),
        (Sellmeier(B=(-2.0,), C_um2=(0.01,)), 500),
        (Sellmeier(B=(-0.5,), C_um2=(0.01,)), 500),
    ],
)
def test_refuses_an_index_below_one_or_not_finite(formula: Dispersion, wavelength_nm: float) -> None:
    with pytest.raises(DataError, match=rf"^index at {wavelength_nm} nm = .*; must be finite and at least 1; check"):
        formula.index(wavelength_nm)


def test_without_covariance_there_is_no_uncertainty() -> None:
    table = Tabulated(wavelength_nm=(400, 500), n=(1.5, 1.4))
    assert [curve.u_index(450) for curve in (BK7, Cauchy(A=1.5), Constant(n=1.5), table)] == [None] * 4


def test_the_uncertainty_of_a_constant_is_u_n() -> None:
    assert Constant(n=1.5, u_n=0.002).u_index(500) == pytest.approx(0.002, rel=1e-15)


def test_the_uncertainty_between_independent_points_is_smaller_than_at_them() -> None:
    table = Tabulated(wavelength_nm=(400, 500), n=(1.5, 1.4), covariance=((1e-6, 0), (0, 1e-6)))
    assert table.u_index(400) == pytest.approx(1e-3)
    assert table.u_index(450) == pytest.approx(1e-3 / math.sqrt(2))


def numerical_u(kind: type[Dispersion], keys: dict[str, int], values: list[float], covariance: Any, nm: float) -> float:
    """Return the uncertainty from central differences with respect to the parameters."""

    def index(parameters: list[float]) -> float:
        remaining, data = list(parameters), {}
        for key, count in keys.items():
            data[key] = tuple(remaining[:count]) if kind is Sellmeier else remaining[0]
            remaining = remaining[count:]
        return kind(**data).index(nm)

    slopes = []
    for i, value in enumerate(values):
        step = 1e-5 * max(abs(value), 1e-4)
        up, down = ([*values[:i], value + sign * step, *values[i + 1 :]] for sign in (1, -1))
        slopes.append((index(up) - index(down)) / (2 * step))
    gradient = np.array(slopes)
    return math.sqrt(gradient @ np.array(covariance) @ gradient)


FACTORS = st.lists(st.floats(-1, 1), min_size=16, max_size=16)


def covariance_of(factors: list[float], scales: list[float]) -> tuple[tuple[float, ...], ...]:
    size = len(scales)
    well_conditioned = np.reshape(factors[: size**2], (size, size)) + 5 * np.eye(size)
    root = np.diag(scales) @ well_conditioned
    return tuple(tuple(row) for row in (root @ root.T).tolist())


@given(FACTORS, st.floats(400, 1000))
def test_uncertainty_of_cauchy_agrees_with_finite_differences(factors: list[float], nm: float) -> None:
    covariance = covariance_of(factors, [1e-3, 1e-4, 1e-5])
    formula = Cauchy(A=1.5, B_um2=0.004, C_um4=0.0002, covariance=covariance)
    keys = {"A": 1, "B_um2": 1, "C_um4": 1}
    expected = numerical_u(Cauchy, keys, [1.5, 0.004, 0.0002], covariance, nm)
    assert formula.u_index(nm) == pytest.approx(expected, rel=1e-5)


@given(FACTORS, st.floats(400, 1000))
def test_uncertainty_of_sellmeier_agrees_with_finite_differences(factors: list[float], nm: float) -> None:
    covariance = covariance_of(factors, [1e-3, 1e-3, 1e-5, 1e-5])
    formula = Sellmeier(B=(0.99, 0.19), C_um2=(0.008, 0.022), covariance=covariance)
    expected = numerical_u(Sellmeier, {"B": 2, "C_um2": 2}, [0.99, 0.19, 0.008, 0.022], covariance, nm)
    assert formula.u_index(nm) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("covariance", "line"),
    [
        ([[1, 0], [0, 1]], "must be 3 by 3"),
        ([[1, 0, 0], [0, 1], [0, 0, 1]], "must be 3 by 3"),
        ([], "must be 3 by 3"),
        ([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]], "must be symmetric"),
        ([[1, 2, 0], [2, 1, 0], [0, 0, 1]], "must not have negative eigenvalues"),
        ([[1e-2, 2e-9, 0], [2e-9, 1e-16, 0], [0, 0, 1]], "must not have negative eigenvalues"),
        ([[0, 0.1, 0], [0.1, 1, 0], [0, 0, 1]], "must not have negative eigenvalues"),
        ([[-1, 0, 0], [0, 1, 0], [0, 0, 1]], "must not have negative variances"),
    ],
)
def test_refuses_an_invalid_covariance(covariance: Any, line: str) -> None:
    message = error_line(Cauchy, A=1.5, covariance=covariance)
    assert message.startswith("index.covariance")
    assert line in message


def test_refuses_a_covariance_that_is_not_finite() -> None:
    line = error_line(Cauchy, A=1.5, covariance=[[math.nan, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert line.startswith("index.covariance[0][0] = nan; must be a finite number")


def test_accepts_a_singular_covariance() -> None:
    full = ((1e-6, 1e-6, 0), (1e-6, 1e-6, 0), (0, 0, 0))
    assert Cauchy(A=1.5, covariance=full).u_index(1000) == pytest.approx(2e-3)


@pytest.mark.parametrize(
    ("kind", "data", "line"),
    [
        (Constant, {"n": 0.9}, "index.n = 0.9; must be at least 1"),
        (Constant, {"n": 5}, "index.n = 5; must be less than 5"),
        (Constant, {"n": math.nan}, "index.n = nan; must be a finite number"),
        (Constant, {}, "index.n; is missing; add it"),
        (Constant, {"n": 1.5, "u_n": -1}, "index.u_n = -1; must be at least 0"),
        (Constant, {"n": 1.5, "valid_nm": [700, 400]}, "index.valid_nm = [700.0, 400.0]; must be in ascending order"),
        (Constant, {"n": 1.5, "valid_nm": [0, 400]}, "index.valid_nm[0] = 0; must be greater than 0"),
        (Cauchy, {"A": 1.5, "B": 1}, "index.B; unknown key"),
        (Cauchy, {"A": 1.5, "B_um": 1}, "index.B_um; unknown key; did you mean index.B_um2?"),
        (Cauchy, {"A": "1.5"}, "index.A = '1.5'; must be a number"),
        (Sellmeier, {"B": [1.0], "C_um2": [0.1, 0.2]}, "index.C_um2 = 2; must have 1 entries, one per B"),
        (Sellmeier, {"B": [], "C_um2": []}, "index.B = []"),
        (Sellmeier, {"B": [1.0], "C_um2": [-0.1]}, "index.C_um2[0] = -0.1; must be at least 0"),
        (Tabulated, {"wavelength_nm": [400], "n": [1.5]}, "index.wavelength_nm = [400]; must have at least 2"),
        (Tabulated, {"wavelength_nm": [400, 500], "n": [1, 2, 3]}, "index.n = 3; must have 2 entries"),
        (
            Tabulated,
            {"wavelength_nm": [500, 400], "n": [1.4, 1.5]},
            "index.wavelength_nm = [500.0, 400.0]; must be in ascending order",
        ),
        (
            Tabulated,
            {"wavelength_nm": [400, 400], "n": [1.4, 1.5]},
            "index.wavelength_nm = [400.0, 400.0]; must be in ascending order",
        ),
        (Tabulated, {"wavelength_nm": [400, 500], "n": [1.4, 0.9]}, "index.n = 0.9; must be at least 1"),
        (Tabulated, {"wavelength_nm": "x", "n": [1.4, 0.9]}, "index.wavelength_nm = 'x'; must be a list"),
    ],
)
def test_refuses_invalid_data_with_value_and_limit(kind: type[Dispersion], data: dict[str, Any], line: str) -> None:
    assert error_line(kind, **data).startswith(line)


@pytest.mark.parametrize("kind", KINDS)
def test_the_default_of_kind_is_its_key(kind: str) -> None:
    assert KINDS[kind].model_fields["kind"].default == kind
