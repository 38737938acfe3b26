"""`solen resin index` of a layer on its substrate, with a formula through n and the literature beside it."""

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


def found(folder: Path, columns: dict[str, FloatArray], **more: Any) -> dict[str, Any]:
    result = pipeline.index(table(folder, **columns), options=IndexOptions(**{"thickness_um": 25.0} | more)).to_dict()
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    return result


def warned(result: dict[str, Any], words: str) -> bool:
    return any(words in line for line in result["warnings"])


def test_a_layer_measured_against_its_bare_substrate(tmp_path: Path) -> None:
    t, r = on_substrate(N, 5e-5, 25.0, NM, Setup(SHEET))
    result = found(tmp_path, {"T": t, "R": r}, **ON_PET, u_T="0.05%", u_R="0.05%")
    assert (result["mode"], result["baseline"]) == ("measured", "substrate")
    assert result["n"] == pytest.approx(N.tolist(), abs=1e-9)
    resolved = [k for k in result["k"] if k is not None]  # towards long wavelengths it is below three uncertainties
    assert resolved == pytest.approx([5e-5] * len(resolved), abs=1e-12)
    assert len(resolved) > 20
    assert result["u_n"][0] > 1.0 * 0.02
    assert warned(result, "most of u(n) = 0.02")
    assert warned(result, "0.01 in the substrate's index")
    assert not warned(result, "say --baseline substrate")
    assert result["options"]["substrate"] == "pet-drawn"
    known = found(tmp_path, {"T": t, "R": r}, **ON_PET, u_T="0.05%", u_R="0.05%", u_substrate_n=0.001)
    assert known["u_n"][0] < 0.01
    assert not warned(known, "most of u(n)")


def test_side_and_baselines_are_heard(tmp_path: Path) -> None:
    way: Any = {"side": "substrate", "baseline": "air", "baseline_r": "substrate"}
    t, r = on_substrate(N, 5e-5, 25.0, NM, Setup(SHEET, **way))
    said = {**ON_PET, "baseline": "air", "side": "substrate", "r_baseline": "substrate"}
    assert found(tmp_path, {"T": t, "R": r}, **said)["n"] == pytest.approx(N.tolist(), abs=1e-9)


def test_a_substrate_is_a_file_or_a_number_too(tmp_path: Path) -> None:
    t = on_substrate(N, 0.0, 25.0, NM, Setup(Substrate(1.6, 0.0, 100.0))).T
    resin = tmp_path / "sheet.toml"
    resin.write_text(
        'schema = 1\nname = "sheet"\nsource = "own"\n[index]\nkind = "number"\nn = 1.6\nu_n = 0.02\n', encoding="utf-8"
    )
    for name, u in ((str(resin), None), ("1.6", 0.02)):
        result = found(tmp_path, {"T": t}, **{**ON_PET, "substrate": name}, u_substrate_n=u, u_T="0.0001")
        assert result["mode"] == "lossless"
        assert result["n"] == pytest.approx(N.tolist(), abs=1e-9)
        assert result["u_n"][0] == pytest.approx(0.02 * 1.0, rel=0.2)
    exact = found(tmp_path, {"T": t}, **{**ON_PET, "substrate": "1.6"})
    assert warned(exact, "assumed exact")


def test_loss_read_as_index_is_warned_of(tmp_path: Path) -> None:
    """A clear resin with an absorption tail in the blue, T alone: n would fall faster than any polymer's."""
    t = on_substrate(N, 2e-5 * (420 / NM) ** 4, 25.0, NM, Setup(SHEET)).T
    result = found(tmp_path, {"T": t}, **ON_PET)
    assert warned(result, "lossless: k = 0 is assumed, so n is an upper bound")
    assert warned(result, "times the largest")
    assert warned(result, "above the literature of acrylates and photoresins")


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ({"baseline": "substrate"}, "substrate; is required with --baseline substrate; add --substrate pet"),
        ({"substrate": "pet-drawn"}, "baseline; is required with --substrate"),
        ({"substrate": "pet-drawn", "baseline": "air"}, "substrate_thickness_um; is required with --substrate"),
        ({"side": "layer"}, "side; describes a layer on a substrate"),
        ({"u_substrate_n": 0.1}, "u_substrate_n; describes a layer on a substrate"),
        ({**ON_PET, "mode": "as-published"}, "mode = 'as-published'; does not support a substrate"),
        ({**ON_PET, "mode": "measured"}, "--mode measured; requires a measured R"),
        ({**ON_PET, "substrate": "5"}, "--substrate = 5.0; must be a name, a file, or an index above 1"),
        ({**ON_PET, "substrate": "pet"}, "names two materials: drawn film, 1.636 at 633 nm, and pressed plates, 1.565"),
        ({**ON_PET, "substrate": "pett-drawn"}, "did you mean pet"),
        ({**ON_PET, "side": "top"}, "side = 'top'; must be 'layer' or 'substrate'"),
        ({"fit": "spline"}, "fit = 'spline'; must be 'cauchy', 'sellmeier' or 'none'"),
        ({"polymer": ("wax",)}, "polymer = 'wax'; must be 'acrylate'"),
    ],
)
def test_what_is_not_said_or_cannot_be_is_refused(tmp_path: Path, more: dict[str, Any], line: str) -> None:
    t = on_substrate(N, 0.0, 25.0, NM, Setup(SHEET)).T
    with pytest.raises((SpecError, DataError)) as refusal:
        found(tmp_path, {"T": t}, **more)
    assert line in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


def test_a_substrate_that_is_not_known_there_is_reported(tmp_path: Path) -> None:
    t = on_substrate(N, 0.0, 25.0, NM, Setup(SHEET)).T
    with pytest.raises(SolenError, match=r"substrate PC: index at 420 nm; is known only from 436\.8 to 1052 nm"):
        found(tmp_path, {"T": t}, **{**ON_PET, "substrate": "pc"})


def free(**noise: float) -> dict[str, FloatArray]:
    rng = np.random.default_rng(6)
    r, t = forward(N, 5e-5, 25.0, NM)
    return {"T": t, "R": r + noise.get("r", 0.0) * rng.standard_normal(NM.size)}


def test_a_formula_goes_through_n_with_its_covariance(tmp_path: Path) -> None:
    result = found(tmp_path, free(r=5e-4), fit="cauchy", u_R="0.001", u_T="0.001", at_nm=(860.0,), led="VSMY1850")
    fit = result["fit"]
    assert fit["kind"] == "cauchy"
    model = Cauchy(**{key: tuple(one) if key == "valid_nm" else one for key, one in fit["model"].items()})
    assert model.index(860.0) == pytest.approx(1.472 + 0.0049 / 0.86**2, abs=1e-3)
    # the stated accuracy is common to all wavelengths: a fit does not average it away
    assert model.u_index(860.0) == pytest.approx(0.001 * np.hypot(3.9, 0.31), rel=0.1)
    assert result["fit_at"][0]["n"] == pytest.approx(model.index(860.0), abs=1e-12)
    assert result["fit_led"]["n"] == pytest.approx(model.index(850.0), abs=1e-4)
    assert len(fit["n"]) == len(fit["wavelength_nm"]) == len(fit["u_n"])
    one = found(tmp_path, free(r=5e-4), fit="sellmeier")["fit"]
    assert Sellmeier(**{key: tuple(v) if key == "valid_nm" else v for key, v in one["model"].items()}).index(600) > 1.4
    assert found(tmp_path, free(), fit="none")["fit"] is None


def test_repeats_weight_a_formula(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    r, t = forward(N, 5e-5, 25.0, NM)
    columns = {f"R{i}": r + 1e-3 * rng.standard_normal(NM.size) for i in range(5)} | {"T": t}
    result = found(
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


def test_what_is_no_measurement_gets_a_formula_without_uncertainty(tmp_path: Path) -> None:
    result = found(tmp_path, {"T": free()["T"]}, fit="cauchy", mode="as-published", u_T="0.001")
    fit = result["fit"]
    assert fit["model"]["covariance"] is None
    assert not result["measurement"]
    assert set(fit["u_n"]) == {None}


def test_a_formula_that_cannot_be_is_refused_with_its_reason(tmp_path: Path) -> None:
    n = 1.5 - 0.01 / (NM * 1e-3) ** 2
    r, t = forward(n, 5e-5, 25.0, NM)
    with pytest.raises(DataError, match="sellmeier fit of 1 term; has no resonance that would produce this index"):
        found(tmp_path, {"T": t, "R": r}, fit="sellmeier")
    assert warned(found(tmp_path, {"T": t, "R": r}, fit="cauchy"), "rises with the wavelength")


def test_the_class_of_polymers_is_asked_for(tmp_path: Path) -> None:
    r, t = forward(N - 0.08, 5e-5, 25.0, NM)
    assert warned(found(tmp_path, {"T": t, "R": r}), "below the literature of acrylates and photoresins")
    assert not warned(found(tmp_path, {"T": t, "R": r}, polymer=("silicone",)), "the literature of")


def test_the_figure_shows_layer_and_formula(tmp_path: Path) -> None:
    t, r = on_substrate(N, 5e-5, 25.0, NM, Setup(SHEET))
    figure = tmp_path / "n.svg"
    options = IndexOptions(thickness_um=25.0, fit="cauchy", u_T="0.001", u_R="0.001", **ON_PET)
    pipeline.index(table(tmp_path, T=t, R=r), options=options, figure=FigureOptions(figure=figure))
    text = figure.read_text(encoding="utf-8")
    assert "index of a layer on its substrate from R and T, both measured" in text
    assert "cauchy fit ± u" in text
    assert "absorptance 1 − R − T" not in text
