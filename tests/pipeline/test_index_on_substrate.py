"""`solen resin index` of a layer on its substrate, with a formula fitted to n and a comparison with the literature."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import DataError, SolenError, SpecError
from solen.material import Cauchy, Sellmeier, library_resin
from solen.material.index import forward
from solen.material.index.options import IndexOptions
from solen.material.index.stack import Setup, Substrate, on_substrate
from solen.pipeline.resin import index as pipeline
from solen.report.options import FigureOptions

NM = np.arange(420.0, 901.0, 5.0)
N = 1.472 + 0.0049 / (NM * 1e-3) ** 2
PET = library_resin("pet-drawn")
SHEET = Substrate(
    np.array([PET.index.index(float(nm)) for nm in NM]), PET.loss.absorption_per_mm * NM / (4e6 * np.pi), 100.0
)
ON_PET: dict[str, Any] = {"baseline": "substrate", "substrate": "pet-drawn", "substrate_thickness_um": 100.0}


def table(folder: Path, **columns: FloatArray) -> Path:
    file = folder / "layer.csv"
    rows = zip(NM.tolist(), *(column.tolist() for column in columns.values()), strict=True)
    lines = [",".join(("wavelength_nm", *columns)), *(",".join(map(repr, row)) for row in rows)]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def evaluate(folder: Path, columns: dict[str, FloatArray], **more: Any) -> dict[str, Any]:
    result = pipeline.index(table(folder, **columns), options=IndexOptions(**{"thickness_um": 25.0} | more)).to_dict()
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    return result


def warns(result: dict[str, Any], text: str) -> bool:
    return any(text in line for line in result["warnings"])


def test_a_layer_measured_relative_to_its_bare_substrate(tmp_path: Path) -> None:
    t, r = on_substrate(N, 5e-5, 25.0, NM, Setup(SHEET))
    result = evaluate(tmp_path, {"T": t, "R": r}, **ON_PET, u_T="0.05%", u_R="0.05%")
    assert (result["mode"], result["baseline"]) == ("measured", "substrate")
    assert result["n"] == pytest.approx(N.tolist(), abs=1e-9)
    resolved = [k for k in result["k"] if k is not None]  # at long wavelengths, k is below three uncertainties
    assert resolved == pytest.approx([5e-5] * len(resolved), abs=1e-12)
    assert len(resolved) > 20
    assert result["u_n"][0] > 1.0 * 0.02
    assert warns(result, "most of u(n) = 0.02")
    assert warns(result, "0.01 in the substrate's index")
    assert not warns(result, "--baseline substrate")
    assert result["options"]["substrate"] == "pet-drawn"
    with_u = evaluate(tmp_path, {"T": t, "R": r}, **ON_PET, u_T="0.05%", u_R="0.05%", u_substrate_n=0.001)
    assert with_u["u_n"][0] < 0.01
    assert not warns(with_u, "most of u(n)")


def test_side_and_baselines_are_used(tmp_path: Path) -> None:
    setup: Any = {"side": "substrate", "baseline": "air", "baseline_r": "substrate"}
    t, r = on_substrate(N, 5e-5, 25.0, NM, Setup(SHEET, **setup))
    options = {**ON_PET, "baseline": "air", "side": "substrate", "r_baseline": "substrate"}
    assert evaluate(tmp_path, {"T": t, "R": r}, **options)["n"] == pytest.approx(N.tolist(), abs=1e-9)


def test_a_substrate_is_specified_by_a_file_or_a_number(tmp_path: Path) -> None:
    t = on_substrate(N, 0.0, 25.0, NM, Setup(Substrate(1.6, 0.0, 100.0))).T
    resin = tmp_path / "sheet.toml"
    resin.write_text(
        'schema = 1\nname = "sheet"\nsource = "own"\n[index]\nkind = "number"\nn = 1.6\nu_n = 0.02\n', encoding="utf-8"
    )
    for name, u in ((str(resin), None), ("1.6", 0.02)):
        result = evaluate(tmp_path, {"T": t}, **{**ON_PET, "substrate": name}, u_substrate_n=u, u_T="0.0001")
        assert result["mode"] == "lossless"
        assert result["n"] == pytest.approx(N.tolist(), abs=1e-9)
        assert result["u_n"][0] == pytest.approx(0.02 * 1.0, rel=0.2)
    exact = evaluate(tmp_path, {"T": t}, **{**ON_PET, "substrate": "1.6"})
    assert warns(exact, "assumed to be exact")


def test_warns_of_a_loss_interpreted_as_index(tmp_path: Path) -> None:
    """With T alone and an absorption tail in the blue, n appears to fall faster than that of any polymer."""
    t = on_substrate(N, 2e-5 * (420 / NM) ** 4, 25.0, NM, Setup(SHEET)).T
    result = evaluate(tmp_path, {"T": t}, **ON_PET)
    assert warns(result, "lossless: k = 0 is assumed, so n is an upper bound")
    assert warns(result, "times the largest")
    assert warns(result, "above the literature range of acrylates and photoresins")


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ({"baseline": "substrate"}, "substrate; is required with --baseline substrate; add --substrate pet"),
        ({"substrate": "pet-drawn"}, "baseline; is required with --substrate"),
        ({"substrate": "pet-drawn", "baseline": "air"}, "substrate_thickness_um; is required with --substrate"),
        ({"side": "layer"}, "side; "),
        ({"u_substrate_n": 0.1}, "u_substrate_n; "),
        ({**ON_PET, "mode": "as-published"}, "mode = 'as-published'; does not support a substrate"),
        ({**ON_PET, "mode": "measured"}, "--mode = 'measured'; requires a measured R"),
        ({**ON_PET, "substrate": "5"}, "--substrate = 5.0; must be a name, a file, or an index above 1"),
        ({**ON_PET, "substrate": "pet"}, "--substrate = 'pet'; "),
        ({**ON_PET, "substrate": "pett-drawn"}, "did you mean pet"),
        ({**ON_PET, "side": "top"}, "side = 'top'; must be 'layer' or 'substrate'"),
        ({"fit": "spline"}, "fit = 'spline'; must be 'cauchy', 'sellmeier' or 'none'"),
        ({"polymer": ("wax",)}, "polymer = 'wax'; must be 'acrylate'"),
    ],
)
def test_refuses_missing_and_invalid_options(tmp_path: Path, more: dict[str, Any], line: str) -> None:
    t = on_substrate(N, 0.0, 25.0, NM, Setup(SHEET)).T
    with pytest.raises((SpecError, DataError)) as error:
        evaluate(tmp_path, {"T": t}, **more)
    assert line in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_refuses_wavelengths_outside_the_range_of_the_substrate(tmp_path: Path) -> None:
    t = on_substrate(N, 0.0, 25.0, NM, Setup(SHEET)).T
    with pytest.raises(SolenError, match=r"substrate PC: index at 420 nm; is known only from 436\.8 to 1052 nm"):
        evaluate(tmp_path, {"T": t}, **{**ON_PET, "substrate": "pc"})


def free_standing(r_noise: float = 0.0) -> dict[str, FloatArray]:
    rng = np.random.default_rng(6)
    r, t = forward(N, 5e-5, 25.0, NM)
    return {"T": t, "R": r + r_noise * rng.standard_normal(NM.size)}


def test_a_formula_is_fitted_with_its_covariance(tmp_path: Path) -> None:
    result = evaluate(
        tmp_path, free_standing(5e-4), fit="cauchy", u_R="0.001", u_T="0.001", at_nm=(860.0,), led="VSMY1850"
    )
    fit = result["fit"]
    assert fit["kind"] == "cauchy"
    model = Cauchy(**{key: tuple(value) if key == "valid_nm" else value for key, value in fit["model"].items()})
    assert model.index(860.0) == pytest.approx(1.472 + 0.0049 / 0.86**2, abs=1e-3)
    # the specified accuracy is common to all wavelengths and is not reduced by the fit
    assert model.u_index(860.0) == pytest.approx(0.001 * np.hypot(3.9, 0.31), rel=0.1)
    assert result["fit_at"][0]["n"] == pytest.approx(model.index(860.0), abs=1e-12)
    assert result["fit_led"]["n"] == pytest.approx(model.index(850.0), abs=1e-4)
    assert len(fit["n"]) == len(fit["wavelength_nm"]) == len(fit["u_n"])
    parameters = evaluate(tmp_path, free_standing(5e-4), fit="sellmeier")["fit"]["model"]
    sellmeier = Sellmeier(**parameters | {"valid_nm": tuple(parameters["valid_nm"])})
    assert sellmeier.index(600) > 1.4
    assert evaluate(tmp_path, free_standing(), fit="none")["fit"] is None


def test_repeats_determine_the_weights_of_a_formula(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    r, t = forward(N, 5e-5, 25.0, NM)
    columns = {f"R{i}": r + 1e-3 * rng.standard_normal(NM.size) for i in range(5)} | {"T": t}
    result = evaluate(
        tmp_path,
        columns,
        fit="cauchy",
        reflectance=tuple(f"R{i}" for i in range(5)),
        transmittance=("T",),
        u_T="0.0001",
    )
    fit = result["fit"]
    assert fit["chi2_reduced"] == pytest.approx(1.0, abs=0.5)
    assert result["fit_at"] == []
    i = fit["wavelength_nm"].index(600.0)
    assert abs(fit["n"][i] - 1.472 - 0.0049 / 0.36) < 3 * fit["u_n"][i] < 2e-3


def test_the_formula_of_a_published_index_has_no_uncertainty(tmp_path: Path) -> None:
    result = evaluate(tmp_path, {"T": free_standing()["T"]}, fit="cauchy", mode="as-published", u_T="0.001")
    fit = result["fit"]
    assert fit["model"]["covariance"] is None
    assert not result["measurement"]
    assert set(fit["u_n"]) == {None}


def test_refuses_a_formula_that_cannot_describe_the_index(tmp_path: Path) -> None:
    n = 1.5 - 0.01 / (NM * 1e-3) ** 2
    r, t = forward(n, 5e-5, 25.0, NM)
    with pytest.raises(DataError, match=r"sellmeier fit .*rises"):
        evaluate(tmp_path, {"T": t, "R": r}, fit="sellmeier")
    assert warns(evaluate(tmp_path, {"T": t, "R": r}, fit="cauchy"), "rises with wavelength")


def test_the_class_of_polymers_selects_the_literature(tmp_path: Path) -> None:
    r, t = forward(N - 0.08, 5e-5, 25.0, NM)
    assert warns(evaluate(tmp_path, {"T": t, "R": r}), "below the literature range of acrylates and photoresins")
    assert not warns(evaluate(tmp_path, {"T": t, "R": r}, polymer=("silicone",)), "the literature range of")


def test_the_figure_shows_layer_and_formula(tmp_path: Path) -> None:
    t, r = on_substrate(N, 5e-5, 25.0, NM, Setup(SHEET))
    figure = tmp_path / "n.svg"
    options = IndexOptions(thickness_um=25.0, fit="cauchy", u_T="0.001", u_R="0.001", **ON_PET)
    pipeline.index(table(tmp_path, T=t, R=r), options=options, figure=FigureOptions(figure=figure))
    text = figure.read_text(encoding="utf-8")
    assert "index of a layer on its substrate from R and T, both measured" in text
    assert "cauchy fit ± u" in text
    assert "absorptance 1 − R − T" not in text
