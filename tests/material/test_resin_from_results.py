"""Tables of a resin file from result files: formulas, tables, losses, working curves, moduli, and refusals."""

import math
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solen.errors import DataError
from solen.material import Cauchy, Sellmeier, Tabulated
from solen.material.index_table import gaps, thinned
from solen.material.resin import Resin, dumps_resin
from solen.material.result_files import (
    READERS,
    CureResult,
    CutbackResult,
    IndexResult,
    Selection,
    StiffnessResult,
)


def spectrum(n: list[float | None], **more: Any) -> dict[str, Any]:
    wavelengths = (400.0 + 2.0 * np.arange(len(n))).tolist()
    return {"mode": "measured", "wavelength_nm": wavelengths, "n": n, "u_n": [0.004] * len(n), **more}


def test_a_fitted_formula_is_stored_with_its_covariance() -> None:
    covariance = [[1e-6, 0.0, 0.0], [0.0, 1e-8, 0.0], [0.0, 0.0, 0.0]]
    fit = {"kind": "cauchy", "A": 1.48, "B_um2": 0.004, "C_um4": 0.0, "covariance": covariance, "valid_nm": [450, 900]}
    for form in (fit, {"kind": "cauchy", "terms": 2, "rms": 1e-4, "model": fit}):
        warnings = ["k is masked at 3 of 5", "the bandwidth\nis wide"]
        kept = IndexResult(**spectrum([1.5] * 5, fit=form, warnings=warnings)).as_table()
        assert isinstance(kept, Cauchy)
        assert kept.index(500.0) == pytest.approx(1.48 + 0.004 / 0.25)
        assert kept.u_index(500.0) == pytest.approx(math.sqrt(1e-6 + 1e-8 / 0.25**2))
        assert (kept.mode, kept.range_nm, kept.warnings) == ("measured", (450.0, 900.0), ("the bandwidth is wide",))
    fit = {"kind": "sellmeier", "B": [1.18], "C_um2": [0.011]}
    assert isinstance(IndexResult(**spectrum([1.5] * 5, fit=fit)).as_table(), Sellmeier)


def test_without_a_formula_a_table_is_stored() -> None:
    kept = IndexResult(**spectrum([None, 1.52, 1.51, None, 1.50])).as_table()
    assert isinstance(kept, Tabulated)
    assert kept.wavelength_nm == (402.0, 404.0, 408.0)
    assert kept.n == (1.52, 1.51, 1.50)
    assert kept.u_index(406.0) == pytest.approx(0.004)  # fully correlated: not smaller between two wavelengths
    without_u = IndexResult(**spectrum([1.52, 1.51], u_n=[None, 0.004])).as_table()
    assert without_u.u_index(401.0) is None
    assert "1 of 2 indices have no uncertainty, the first at 400 nm" in without_u.warnings[-1]


def test_a_long_table_is_reduced_to_means_within_its_uncertainty() -> None:
    """A mean over a width w, 1/64 of the range, differs by w²/24 of the curvature, below 1e-5; noise falls as 1/√N."""
    wavelengths = np.linspace(400.0, 900.0, 2001)
    true = 1.48 + 0.006 / (wavelengths * 1e-3) ** 2
    noise = np.random.default_rng(3).normal(0.0, 0.002, wavelengths.size)
    rows = list(zip(wavelengths.tolist(), (true + noise).tolist(), [0.004] * 2001, strict=True))
    kept = thinned([(nm, n, u) for nm, n, u in rows])
    assert len(kept) == 64
    nm, n, u = np.array(kept, dtype=float).T
    assert (np.diff(nm) > 0.0).all()
    assert (nm[0], nm[-1]) == (400.0, 900.0)
    error = n - (1.48 + 0.006 / (nm * 1e-3) ** 2)
    assert np.abs(error[1:-1]).max() < 5 * 0.002 / math.sqrt(2001 / 62)
    assert u == pytest.approx(0.004)
    exact = thinned([(nm, n, None) for nm, n in zip(wavelengths.tolist(), true.tolist(), strict=True)])
    assert max(abs(n - 1.48 - 0.006 / (nm * 1e-3) ** 2) for nm, n, _ in exact) < 1e-5
    assert exact[5][2] is None


def test_rows_of_equal_wavelength_are_averaged() -> None:
    assert thinned([(500.0, 1.5, 0.1), (500.0, 1.6, 0.1), (600.0, 1.4, None)]) == [
        (500.0, pytest.approx(1.55), pytest.approx(0.1)),
        (600.0, 1.4, None),
    ]


def test_a_gap_of_the_index_is_reported() -> None:
    n: list[float | None] = [1.5] * 100
    n[40:70] = [None] * 30
    kept = IndexResult(**spectrum(n)).as_table()
    (line,) = kept.warnings
    assert "478 to 540 nm" in line
    assert gaps([450.0, 500.0, 860.0]) == ()  # the spacing of three points is obvious


def test_refuses_an_index_at_fewer_than_two_wavelengths() -> None:
    with pytest.raises(DataError, match=r"^n; must be known at 2 or more wavelengths, not at 1"):
        IndexResult(**spectrum([None, 1.5, None])).as_table()


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"n": [1.5, 1.5]}, "n = 2; must have 3 entries"),
        ({"n": [1.5, "1.5", 1.5]}, "n[1] = '1.5'; must be a number"),
        ({"u_n": [-0.1, 0.1, 0.1]}, "u_n[0] = -0.1; must be at least 0"),
        ({"wavelength_nm": [0.0, 1.0, 2.0]}, "wavelength_nm[0] = 0.0; must be greater than 0"),
        ({"mode": None}, "mode; must be a string"),
        ({"fit": {"kind": "spline"}}, "fit = 'spline'; must be a cauchy or a sellmeier formula"),
        ({"fit": {"kind": "cauchy", "B_um2": 0.1}}, "index.A; is missing"),
        (
            {"fit": {"kind": "cauchy", "A": 1.5, "covariance": [[1.0]]}},
            "index.covariance",
        ),
        ({"mode": "guessed"}, "index.mode = 'guessed'; must be one of measured"),
        ({"mode": "as-published"}, 'index.warnings; is missing: mode = "as-published" requires at least one'),
        ({"n": [0.5, 0.5, 0.5]}, "index.n = 0.5; must be at least 1"),
    ],
)
def test_refuses_an_invalid_index(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(DataError) as error:
        IndexResult(**spectrum([1.5] * 3) | changes).as_table()
    assert line in str(error.value)
    assert len(str(error.value).splitlines()) == 1


CUTBACK: dict[str, Any] = {
    "absorption_per_mm": 0.01 * math.log(10.0),
    "u_absorption_per_mm": 0.004,
    "loss_dB_per_cm": 1.0,
    "interval95_loss_dB_per_cm": [0.6, 1.4],
    "wavelength_nm": 860.0,
    "sources": [{"file": "guides.csv", "sha256": "ab" * 32, "simulated": False, "metadata": {}, "date": None}],
}


def test_a_loss_is_stored_with_its_interval_per_mm() -> None:
    result = CutbackResult(**CUTBACK)
    loss = result.as_table()
    per_mm = -math.log(10 ** (-0.1)) / 10.0  # of 1 dB/cm
    assert loss.absorption_per_mm == pytest.approx(per_mm)
    assert (loss.u_absorption_per_mm, loss.wavelength_nm) == (0.004, 860.0)
    assert loss.interval95_per_mm == pytest.approx((0.6 * per_mm, 1.4 * per_mm))
    (source,) = result.measured_files()
    assert (source.of, source.file, source.sha256, source.date) == ("loss", "guides.csv", "ab" * 32, "")


def test_the_wavelength_of_a_loss_is_selected_or_reported_as_missing() -> None:
    without = CutbackResult(**CUTBACK | {"wavelength_nm": None})
    assert without.as_table().warnings == ("the wavelength of the measurement is not specified",)
    selected = without.as_table(Selection(loss_wavelength_nm=940.0))
    assert (selected.wavelength_nm, selected.warnings) == (940.0, ())


def test_refuses_inconsistent_loss_and_absorption() -> None:
    with pytest.raises(DataError, match=r"^absorption_per_mm = 0\.03; must be 0\.0230259 per mm for a loss of 1 dB/cm"):
        CutbackResult(**CUTBACK | {"absorption_per_mm": 0.03})


def test_the_loss_of_one_orientation_can_be_selected() -> None:
    lines = [
        {"orientation": "flat", "loss_dB_per_cm": 0.4, "interval95_loss_dB_per_cm": [0.2, 0.7]},
        {"orientation": "upright", "loss_dB_per_cm": 2.0},
    ]
    depends = "the loss depends on the build orientation (dB/cm: flat: 0.4, upright: 2)"
    result = CutbackResult(**CUTBACK, by_orientation=lines, warnings=[depends, "the line bends"])
    assert (result.as_table().warnings, result.as_table(Selection(orientation="flat")).warnings) == (
        (depends, "the line bends"),
        ("the line bends",),
    )
    assert result.as_table().absorption_per_mm == pytest.approx(0.0230, abs=1e-4)
    upright = result.as_table(Selection(orientation="upright"))
    assert upright.absorption_per_mm == pytest.approx(0.0461, abs=1e-4)
    assert (upright.orientation, upright.interval95_per_mm) == ("upright", None)
    assert [loss.orientation for loss in upright.by_orientation] == ["flat", "upright"]
    with pytest.raises(DataError, match="flat, upright"):
        result.as_table(Selection(orientation="edge"))


def test_a_negative_loss_is_replaced_by_zero_with_a_warning() -> None:
    negative = {"absorption_per_mm": None, "u_absorption_per_mm": None, "loss_dB_per_cm": -0.1}
    loss = CutbackResult(**CUTBACK | negative | {"interval95_loss_dB_per_cm": [-0.5, 0.3]}).as_table()
    assert loss.absorption_per_mm == 0.0
    assert all(part in loss.warnings[0] for part in ("-0.1 dB/cm", "0 is used", "0.0069 per mm"))
    with pytest.raises(DataError, match="a guide cannot amplify"):
        CutbackResult(**CUTBACK | negative | {"interval95_loss_dB_per_cm": [-0.9, -0.3]}).as_table()


def test_a_working_curve_is_stored() -> None:
    cure = CureResult(
        Dp_um=181.0,
        Ec_mJ_per_cm2=12.0,
        covariance=[[9.0, 1.0], [1.0, 0.25]],
        interval95_Dp_um=[175.0, 187.0],
        interval95_Ec_mJ_per_cm2=[11.0, 13.0],
        wavelength_nm=385.0,
        irradiance_mW_per_cm2=13.0,
    ).as_table(Selection(cure_wavelength_nm=405.0))
    assert (cure.Dp_um, cure.Ec_mJ_per_cm2, cure.interval95_Dp_um) == (181.0, 12.0, (175.0, 187.0))
    assert cure.covariance == ((9.0, 1.0), (1.0, 0.25))
    assert (cure.wavelength_nm, cure.irradiance_mW_per_cm2) == (405.0, 13.0)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"Dp_um": -181.0}, "cure.Dp_um = -181.0; must be greater than 0"),
        ({"covariance": [[1.0, 2.0], [2.0, 1.0]]}, "cure.covariance = -1.0; must not have negative eigenvalues"),
        ({"covariance": [[-1.0, 0.0], [0.0, 1.0]]}, "cure.covariance = -1.0; must not have negative variances"),
        ({"covariance": [[1.0, 0.5], [0.1, 1.0]]}, "cure.covariance"),
        ({"interval95_Dp_um": [1.0]}, "cure.interval95_Dp_um"),
        ({"Ec_mJ_per_cm2": None}, "cure.Ec_mJ_per_cm2; must be a number"),
    ],
)
def test_refuses_an_invalid_working_curve(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(DataError) as error:
        CureResult(**{"Dp_um": 181.0, "Ec_mJ_per_cm2": 12.0} | changes).as_table()
    assert str(error.value).startswith(line)


MODULUS: dict[str, Any] = {
    "modulus_MPa": 1.5,
    "u_modulus_MPa": 0.1,
    "strain_range": [0.02, 0.1],
    "mode": "compression",
    "model": {"kind": "yeoh", "parameters": {"C10": 0.25, "C20": 0.01}, "u_parameters": {"C10": 0.02, "C20": 0.004}},
}


def test_a_modulus_is_stored_with_its_model() -> None:
    kept = StiffnessResult(**MODULUS).as_table()
    assert (kept.modulus_MPa, kept.u_modulus_MPa, kept.strain_range, kept.test) == (
        1.5,
        0.1,
        (0.02, 0.1),
        "compression",
    )
    assert (kept.model, kept.parameters) == ("yeoh", {"C10": 0.25, "C20": 0.01})
    assert kept.u_parameters["C20"] == 0.004
    assert StiffnessResult(**MODULUS | {"model": None}).as_table().model == ""


def test_one_of_several_materials_is_selected_by_its_label() -> None:
    groups = [
        MODULUS | {"label": "a-PU", "modulus_MPa": 9.0, "specimens": [{"file": "a.csv"}]},
        MODULUS | {"label": "ma-PU", "specimens": [{"file": "m.csv"}]},
    ]
    result = StiffnessResult(**groups[0], groups=groups, sources=[{"file": "a.csv"}, {"file": "m.csv"}])
    assert result.as_table(Selection(label="ma-PU")).modulus_MPa == 1.5
    assert [source.file for source in result.measured_files(Selection(label="ma-PU"))] == ["m.csv"]
    with pytest.raises(DataError, match=r"--label; is required: .* a-PU, ma-PU"):
        result.as_table()
    with pytest.raises(DataError, match="--label = 'PU'"):
        result.as_table(Selection(label="PU"))


ANY_VALUE = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**400), 10**400) | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=5,
)
VALID: dict[str, dict[str, Any]] = {
    "index": spectrum([1.52, 1.51, None, 1.50], fit=None, warnings=[], sources=[{"file": "a.csv"}]),
    "cutback": CUTBACK | {"by_orientation": [{"orientation": "flat", "loss_dB_per_cm": 1.0}]},
    "cure": {"Dp_um": 181.0, "Ec_mJ_per_cm2": 12.0, "covariance": [[9.0, 1.0], [1.0, 0.25]]},
    "stiffness": MODULUS | {"groups": [], "label": "a", "specimens": [{"file": "a.csv"}]},
}


@settings(max_examples=400, deadline=None)
@given(data=st.data(), kind=st.sampled_from(sorted(VALID)), value=ANY_VALUE)
def test_any_value_in_a_result_yields_a_table_or_a_refusal(data: st.DataObject, kind: str, value: Any) -> None:
    """Any JSON value at any position of a result yields a table of finite numbers, or a refusal of one line."""
    document = deepcopy(VALID[kind])
    container: Any = document
    while True:
        key = data.draw(st.sampled_from(sorted(container) if isinstance(container, dict) else range(len(container))))
        if not (isinstance(container[key], dict | list) and container[key] and data.draw(st.booleans())):
            break
        container = container[key]
    container[key] = value
    refusal = ""
    try:
        result = READERS[kind](**document)
        table, _ = result.as_table(), result.measured_files()
    except DataError as error:
        refusal = str(error)
    if refusal:
        assert len(refusal.splitlines()) == 1
        return
    assert table is not None
    assert "nan" not in table.model_dump_json().lower()
    resin = Resin(name="x", **{result.of: table})
    assert "inf" not in dumps_resin(resin)


def test_a_repeated_wavelength_is_one_row_with_or_without_uncertainty() -> None:
    twice = {"wavelength_nm": (600.0, 500.0, 500.0), "n": (1.49, 1.5, 1.5), "u_n": (0.01, None, 0.01)}
    table = IndexResult(mode="lossless", **twice).as_table()
    assert table.index(500.0) == 1.5
    assert table.index(600.0) == 1.49
    assert table.u_index(500.0) is None
