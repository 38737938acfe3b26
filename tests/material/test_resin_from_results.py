"""What a resin keeps of a result: formulas, tables, losses, working curves, moduli, and what must be known of them."""

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


def test_a_fitted_formula_is_kept_with_its_covariance() -> None:
    covariance = [[1e-6, 0.0, 0.0], [0.0, 1e-8, 0.0], [0.0, 0.0, 0.0]]
    fit = {"kind": "cauchy", "A": 1.48, "B_um2": 0.004, "C_um4": 0.0, "covariance": covariance, "valid_nm": [450, 900]}
    for one in (fit, {"kind": "cauchy", "terms": 2, "rms": 1e-4, "model": fit}):
        index = IndexResult(
            **spectrum([1.5] * 5, fit=one, warnings=["k is masked at 3 of 5", "the bandwidth\nis wide"])
        )
        kept = index.as_table()
        assert isinstance(kept, Cauchy)
        assert kept.index(500.0) == pytest.approx(1.48 + 0.004 / 0.25)
        assert kept.u_index(500.0) == pytest.approx(math.sqrt(1e-6 + 1e-8 / 0.25**2))
        assert (kept.mode, kept.range_nm, kept.warnings) == ("measured", (450.0, 900.0), ("the bandwidth is wide",))
    fit = {"kind": "sellmeier", "B": [1.18], "C_um2": [0.011]}
    assert isinstance(IndexResult(**spectrum([1.5] * 5, fit=fit)).as_table(), Sellmeier)


def test_without_a_formula_a_table_is_kept() -> None:
    kept = IndexResult(**spectrum([None, 1.52, 1.51, None, 1.50])).as_table()
    assert isinstance(kept, Tabulated)
    assert kept.wavelength_nm == (402.0, 404.0, 408.0)
    assert kept.n == (1.52, 1.51, 1.50)
    assert kept.u_index(406.0) == pytest.approx(0.004)  # common to all: no smaller between two wavelengths
    unsure = IndexResult(**spectrum([1.52, 1.51], u_n=[None, 0.004])).as_table()
    assert unsure.u_index(401.0) is None
    assert unsure.warnings[-1] == (
        "1 of 2 indices have no uncertainty, the first at 400 nm: the resin's index is stored without uncertainty"
    )


def test_a_long_table_is_thinned_to_means_within_its_uncertainty() -> None:
    """A mean over 1/64 of the range is off by w²/24 of the curvature, below 1e-5; its noise goes as 1/√points."""
    wavelengths = np.linspace(400.0, 900.0, 2001)
    true = 1.48 + 0.006 / (wavelengths * 1e-3) ** 2
    noise = np.random.default_rng(3).normal(0.0, 0.002, wavelengths.size)
    rows = list(zip(wavelengths.tolist(), (true + noise).tolist(), [0.004] * 2001, strict=True))
    kept = thinned([(nm, n, u) for nm, n, u in rows])
    assert len(kept) == 64
    nm, n, u = np.array(kept, dtype=float).T
    assert (np.diff(nm) > 0.0).all()
    assert (nm[0], nm[-1]) == (400.0, 900.0)
    off = n - (1.48 + 0.006 / (nm * 1e-3) ** 2)
    assert np.abs(off[1:-1]).max() < 5 * 0.002 / math.sqrt(2001 / 62)
    assert u == pytest.approx(0.004)
    exact = thinned([(a, b, None) for a, b in zip(wavelengths.tolist(), true.tolist(), strict=True)])
    assert max(abs(b - 1.48 - 0.006 / (a * 1e-3) ** 2) for a, b, _ in exact) < 1e-5
    assert exact[5][2] is None


def test_wavelengths_that_stand_twice_are_taken_together() -> None:
    assert thinned([(500.0, 1.5, 0.1), (500.0, 1.6, 0.1), (600.0, 1.4, None)]) == [
        (500.0, pytest.approx(1.55), pytest.approx(0.1)),
        (600.0, 1.4, None),
    ]


def test_a_range_without_an_index_is_reported() -> None:
    n: list[float | None] = [1.5] * 100
    n[40:70] = [None] * 30
    kept = IndexResult(**spectrum(n)).as_table()
    assert kept.warnings == ("no index is known from 478 to 540 nm: it is interpolated linearly there",)
    assert gaps([450.0, 500.0, 860.0]) == ()  # as wide as the others, or seen at a glance


def test_an_index_at_fewer_than_two_wavelengths_is_none() -> None:
    with pytest.raises(DataError, match=r"^n = 'known at 1'; an index at 2 or more wavelengths is required"):
        IndexResult(**spectrum([None, 1.5, None])).as_table()


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"n": [1.5, 1.5]}, "n = 2; must have 3 entries"),
        ({"n": [1.5, "1.5", 1.5]}, "n[1] = '1.5'; must be a number"),
        ({"u_n": [-0.1, 0.1, 0.1]}, "u_n[0] = -0.1; must be at least 0"),
        ({"wavelength_nm": [0.0, 1.0, 2.0]}, "wavelength_nm[0] = 0.0; must be greater than 0"),
        ({"mode": None}, "mode; must be text"),
        ({"fit": {"kind": "spline"}}, "fit = 'spline'; must be a cauchy or a sellmeier formula"),
        ({"fit": {"kind": "cauchy", "B_um2": 0.1}}, "index.A; missing"),
        (
            {"fit": {"kind": "cauchy", "A": 1.5, "covariance": [[1.0]]}},
            "index.covariance = '1 rows of 1'; must be 3 by 3",
        ),
        ({"mode": "guessed"}, "index.mode = 'guessed'; must be one of measured"),
        ({"mode": "as-published"}, 'index.warnings; is missing: mode = "as-published" requires at least one'),
        ({"n": [0.5, 0.5, 0.5]}, "index.n = 0.5; must be at least 1"),
    ],
)
def test_an_index_that_is_none_is_reported(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(DataError) as refusal:
        IndexResult(**spectrum([1.5] * 3) | changes).as_table()
    assert line in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


CUTBACK: dict[str, Any] = {
    "absorption_per_mm": 0.01 * math.log(10.0),
    "u_absorption_per_mm": 0.004,
    "loss_dB_per_cm": 1.0,
    "interval95_loss_dB_per_cm": [0.6, 1.4],
    "wavelength_nm": 860.0,
    "sources": [{"file": "guides.csv", "sha256": "ab" * 32, "simulated": False, "metadata": {}, "date": None}],
}


def test_a_loss_is_kept_with_its_interval_in_its_unit() -> None:
    found = CutbackResult(**CUTBACK)
    loss = found.as_table()
    one_db_per_cm = -math.log(10 ** (-0.1)) / 10.0
    assert loss.absorption_per_mm == pytest.approx(one_db_per_cm)
    assert (loss.u_absorption_per_mm, loss.wavelength_nm) == (0.004, 860.0)
    assert loss.interval95_per_mm == pytest.approx((0.6 * one_db_per_cm, 1.4 * one_db_per_cm))
    (source,) = found.measured_files()
    assert (source.of, source.file, source.sha256, source.date) == ("loss", "guides.csv", "ab" * 32, "")


def test_the_wavelength_of_a_loss_is_stated_or_missed() -> None:
    without = CutbackResult(**CUTBACK | {"wavelength_nm": None})
    assert without.as_table().warnings == ("the wavelength of the measurement is not specified",)
    stated = without.as_table(Selection(loss_wavelength_nm=940.0))
    assert (stated.wavelength_nm, stated.warnings) == (940.0, ())


def test_a_loss_and_an_absorption_that_are_not_the_same_are_reported() -> None:
    with pytest.raises(DataError, match=r"^absorption_per_mm = 0\.03; 1 dB/cm is 0\.0230259 per mm"):
        CutbackResult(**CUTBACK | {"absorption_per_mm": 0.03})


def test_a_loss_of_one_orientation_can_be_taken() -> None:
    lines = [
        {"orientation": "flat", "loss_dB_per_cm": 0.4, "interval95_loss_dB_per_cm": [0.2, 0.7]},
        {"orientation": "upright", "loss_dB_per_cm": 2.0},
    ]
    depends = "the loss depends on the build orientation (dB/cm: flat: 0.4, upright: 2)"
    found = CutbackResult(**CUTBACK, by_orientation=lines, warnings=[depends, "the line bends"])
    assert (found.as_table().warnings, found.as_table(Selection(orientation="flat")).warnings) == (
        (depends, "the line bends"),
        ("the line bends",),
    )
    assert found.as_table().absorption_per_mm == pytest.approx(0.0230, abs=1e-4)
    upright = found.as_table(Selection(orientation="upright"))
    assert upright.absorption_per_mm == pytest.approx(0.0461, abs=1e-4)
    assert (upright.orientation, upright.interval95_per_mm) == ("upright", None)
    assert [one.orientation for one in upright.by_orientation] == ["flat", "upright"]
    with pytest.raises(DataError, match="contains flat, upright"):
        found.as_table(Selection(orientation="edge"))


def test_a_loss_below_none_is_none_and_said_so() -> None:
    below = {"absorption_per_mm": None, "u_absorption_per_mm": None, "loss_dB_per_cm": -0.1}
    loss = CutbackResult(**CUTBACK | below | {"interval95_loss_dB_per_cm": [-0.5, 0.3]}).as_table()
    assert loss.absorption_per_mm == 0.0
    assert all(part in loss.warnings[0] for part in ("-0.1 dB/cm", "0 is used", "0.0069 per mm"))
    with pytest.raises(DataError, match="a guide cannot amplify"):
        CutbackResult(**CUTBACK | below | {"interval95_loss_dB_per_cm": [-0.9, -0.3]}).as_table()


def test_a_working_curve_is_kept() -> None:
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
        ({"covariance": [[1.0, 2.0], [2.0, 1.0]]}, "cure.covariance = -1.0; must have no negative eigenvalue"),
        ({"covariance": [[-1.0, 0.0], [0.0, 1.0]]}, "cure.covariance = -1.0; must have variances of at least 0"),
        ({"covariance": [[1.0, 0.5], [0.1, 1.0]]}, "cure.covariance"),
        ({"interval95_Dp_um": [1.0]}, "cure.interval95_Dp_um"),
        ({"Ec_mJ_per_cm2": None}, "cure.Ec_mJ_per_cm2; must be a number"),
    ],
)
def test_a_working_curve_that_is_none_is_reported(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(DataError) as refusal:
        CureResult(**{"Dp_um": 181.0, "Ec_mJ_per_cm2": 12.0} | changes).as_table()
    assert str(refusal.value).startswith(line)


MODULUS: dict[str, Any] = {
    "modulus_MPa": 1.5,
    "u_modulus_MPa": 0.1,
    "strain_range": [0.02, 0.1],
    "mode": "compression",
    "model": {"kind": "yeoh", "parameters": {"C10": 0.25, "C20": 0.01}, "u_parameters": {"C10": 0.02, "C20": 0.004}},
}


def test_a_modulus_is_kept_with_its_model() -> None:
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


def test_of_several_materials_one_is_named() -> None:
    groups = [
        MODULUS | {"label": "a-PU", "modulus_MPa": 9.0, "specimens": [{"file": "a.csv"}]},
        MODULUS | {"label": "ma-PU", "specimens": [{"file": "m.csv"}]},
    ]
    found = StiffnessResult(**groups[0], groups=groups, sources=[{"file": "a.csv"}, {"file": "m.csv"}])
    assert found.as_table(Selection(label="ma-PU")).modulus_MPa == 1.5
    assert [one.file for one in found.measured_files(Selection(label="ma-PU"))] == ["m.csv"]
    with pytest.raises(DataError, match="the result contains a-PU, ma-PU; name the material"):
        found.as_table()
    with pytest.raises(DataError, match="--label = 'PU'"):
        found.as_table(Selection(label="PU"))


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**400), 10**400) | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=5,
)
GOOD: dict[str, dict[str, Any]] = {
    "index": spectrum([1.52, 1.51, None, 1.50], fit=None, warnings=[], sources=[{"file": "a.csv"}]),
    "cutback": CUTBACK | {"by_orientation": [{"orientation": "flat", "loss_dB_per_cm": 1.0}]},
    "cure": {"Dp_um": 181.0, "Ec_mJ_per_cm2": 12.0, "covariance": [[9.0, 1.0], [1.0, 0.25]]},
    "stiffness": MODULUS | {"groups": [], "label": "a", "specimens": [{"file": "a.csv"}]},
}


@settings(max_examples=400, deadline=None)
@given(data=st.data(), kind=st.sampled_from(sorted(GOOD)), value=ANYTHING)
def test_whatever_stands_in_a_result_it_is_a_table_or_a_line(data: st.DataObject, kind: str, value: Any) -> None:
    """Any value in any place of a result, as far as JSON goes: a table of finite numbers, or a refusal of one line."""
    document = deepcopy(GOOD[kind])
    place: Any = document
    while True:
        key = data.draw(st.sampled_from(sorted(place) if isinstance(place, dict) else range(len(place))))
        if not (isinstance(place[key], dict | list) and place[key] and data.draw(st.booleans())):
            break
        place = place[key]
    place[key] = value
    refusal = ""
    try:
        found = READERS[kind](**document)
        table, _ = found.as_table(), found.measured_files()
    except DataError as bad:
        refusal = str(bad)
    if refusal:
        assert len(refusal.splitlines()) == 1
        return
    assert table is not None
    assert "nan" not in table.model_dump_json().lower()
    resin = Resin(name="x", **{found.of: table})
    assert "inf" not in dumps_resin(resin)


def test_a_wavelength_that_comes_twice_is_one_row_with_or_without_an_uncertainty() -> None:
    twice = {"wavelength_nm": (600.0, 500.0, 500.0), "n": (1.49, 1.5, 1.5), "u_n": (0.01, None, 0.01)}
    table = IndexResult(mode="lossless", **twice).as_table()
    assert table.index(500.0) == 1.5
    assert table.index(600.0) == 1.49
    assert table.u_index(500.0) is None
