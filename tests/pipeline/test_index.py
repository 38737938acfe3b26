"""Index from a file of spectra: traces, routes, required options, warnings and refusals."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import DataError, SolenError, SpecError
from solen.material.index import forward
from solen.material.index.masks import Reason
from solen.material.index.options import IndexOptions
from solen.material.index.routes import AS_PUBLISHED
from solen.pipeline.resin import index as pipeline
from solen.report.options import FigureOptions

NM = np.arange(500.0, 901.0, 10.0)
N = 1.48 + 5e3 / NM**2
R, T = forward(N, 2e-5, 50.0, NM)


def index(file: Path, options: IndexOptions = IndexOptions(), **outputs: Any) -> dict[str, Any]:
    """Return the result as a dictionary, as in its JSON file."""
    return pipeline.index(file, options=options, **outputs).to_dict()


def table(folder: Path, columns: dict[str, FloatArray], name: str = "layer.csv") -> Path:
    file = folder / name
    rows = [
        ",".join(columns),
        *(",".join(repr(float(value)) for value in row) for row in zip(*columns.values(), strict=True)),
    ]
    file.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return file


def options(**values: Any) -> IndexOptions:
    return IndexOptions(**{"thickness_um": 50.0} | values)


def only_warning(result: dict[str, Any], text: str) -> str:
    (line,) = [line for line in result["warnings"] if text in line]
    return str(line)


def test_a_minimal_table_yields_n_and_k(tmp_path: Path) -> None:
    result = index(table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R}), options())
    assert result["mode"] == "measured"
    assert result["wavelength_nm"] == NM.tolist()
    assert np.abs(np.array(result["n"]) - N).max() < 1e-9
    assert np.abs(np.array(result["k"]) - 2e-5).max() < 1e-12
    assert result["reason"] == [None] * NM.size
    assert result["u_n"] == result["u_k"] == [None] * NM.size
    assert (result["masked_n"], result["masked_k"]) == (0, 0)
    assert len(result["lossless_n"]) == NM.size
    assert result["sources"][0]["file"] == "layer.csv"
    assert json.loads(json.dumps(result, allow_nan=False)) == result


def test_percent_and_descending_wavelengths_yield_the_same_index(tmp_path: Path) -> None:
    fractions = index(table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R}), options())
    file = table(tmp_path, {"Wavelength (nm)": NM[::-1], "T (%)": 100 * T[::-1], "%R": 100 * R[::-1]})
    descending = index(file, options())
    for key in ("n", "k", "wavelength_nm"):
        np.testing.assert_allclose(descending[key], fractions[key], rtol=1e-9)


def test_specified_uncertainties_are_propagated(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    result = index(file, options(u_T="0.1%", u_R="0.001", u_thickness_um=2.0))
    assert result["u_n"][-1] == pytest.approx(0.001 * np.hypot(3.9, 0.31), rel=0.05)
    assert result["u_k"][-1] == pytest.approx(np.hypot(2e-5 * 0.04, 0.001 * 900 / (4e3 * np.pi * 50) * 1.4), rel=0.1)
    low, high = result["interval95_n"][0]
    assert (high - low) / 2 == pytest.approx(1.959964 * result["u_n"][0], rel=1e-5)
    assert not [line for line in result["warnings"] if "uncertainty" in line]


def test_masked_values_are_null_with_their_reason(tmp_path: Path) -> None:
    reflectance = R.copy()
    reflectance[3], reflectance[5] = -0.01, 2.0
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": reflectance})
    result = index(file, options())
    assert result["n"][3] is None
    assert result["k"][5] is None
    assert result["reason"][3] == result["reason"][5] == "n, k: R is not between 0 and 1"
    assert (result["masked_n"], result["masked_k"]) == (2, 2)


def test_t_alone_yields_the_lossless_index_with_a_warning(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T})
    result = index(file, IndexOptions(u_T="0.1%"))
    assert (result["mode"], result["options"]["thickness_um"]) == ("lossless", None)
    assert result["n"] == result["lossless_n"]
    assert (np.array(result["n"]) > N).all()
    assert "k = 0 is assumed" in result["warnings"][0]


def test_an_absorptance_requires_its_kind(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "A": 1.0 - R - T})
    with pytest.raises(SpecError, match=r"^--absorbance-kind; is required for A; "):
        index(file, options())
    result = index(file, options(absorbance_kind="absorptance", u_T="0.1%", u_A="0"))
    assert result["mode"] == "absorptance"
    assert np.abs(np.array(result["n"]) - N).max() < 1e-9
    assert result["u_n"][-1] == pytest.approx(0.0042, rel=0.05)


@pytest.mark.parametrize("kind", ["absorptance", "log10"])
def test_refuses_a_measured_index_from_an_absorbance(tmp_path: Path, kind: str) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "Abs": -np.log10(T)})
    line = r"−log10 T, .* n\(700 nm\) = 1\.5\d+.* 1.47 to 1.55"
    with pytest.raises(DataError, match=line) as error:
        index(file, options(absorbance_kind=kind))
    assert len(str(error.value).splitlines()) == 1
    assert index(file, options(absorbance_kind=kind, mode="lossless"))["mode"] == "lossless"


def test_an_absorbance_alone_is_converted_to_a_transmittance(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "Abs": -np.log10(T)})
    with pytest.raises(SpecError, match="--absorbance-kind; is required for Abs"):
        index(file, options())
    result = index(file, options(absorbance_kind="log10", u_A="0.001"))
    np.testing.assert_allclose(result["T"], T, rtol=1e-12)
    from_t = index(table(tmp_path, {"wavelength_nm": NM, "T": T}, "t.csv"), options(u_T="0.001"))
    np.testing.assert_allclose(result["u_n"], np.log(10.0) * T * np.array(from_t["u_n"]), rtol=1e-9)
    with pytest.raises(DataError, match="an absorptance alone determines no index"):
        index(file, options(absorbance_kind="absorptance"))


def test_as_published_is_an_explicit_mode_with_a_label(tmp_path: Path) -> None:
    nm, t = np.array([450.0, 500.0, 860.0]), np.array([0.8473, 0.8685, 0.8889])
    file = table(tmp_path, {"wavelength_nm": nm, "T": t})
    assert index(file, options())["mode"] == "lossless"
    result = index(
        file, options(mode="as-published"), out=tmp_path / "n.json", figure=FigureOptions(figure=tmp_path / "n.svg")
    )
    assert [round(n, 2) for n in result["n"]] == [1.54, 1.49, 1.44]
    assert (result["measurement"], result["warnings"][0]) == (False, AS_PUBLISHED)
    assert result["u_n"] == result["k"] == [None] * 3
    written = json.loads((tmp_path / "n.json").read_text(encoding="utf-8"))
    assert (written["kind"], written["mode"], written["measurement"]) == ("index", "as-published", False)
    figure = (tmp_path / "n.svg").read_text(encoding="utf-8")
    assert "R computed from T, not measured" in figure
    assert "as published" in figure


def test_as_published_refuses_any_other_absorbance(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "A": 1.0 - R - T})
    with pytest.raises(DataError, match="trace A; is not −log10 T"):
        index(file, options(mode="as-published"))
    with pytest.raises(SpecError, match="--absorbance-kind = 'ln'; must be log10"):
        index(file, options(mode="as-published", absorbance_kind="ln"))


def test_warns_of_an_absorbance_with_a_different_baseline(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "Abs": -np.log10(T) - 0.03})
    result = index(file, options(mode="lossless", absorbance_kind="log10"))
    assert only_warning(result, "Abs is not the absorbance of T: they have different baselines")


def test_a_layer_measured_against_its_substrate_is_not_treated_as_free_standing(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T * 1.12, "R": R})
    result = index(file, options())
    assert result["masked_n"] == NM.size
    assert "--baseline substrate" in only_warning(result, "T exceeds 1 at 100% of the wavelengths")
    with pytest.raises(SolenError, match="substrate; is required with"):
        index(file, options(baseline="substrate"))


def test_as_published_accepts_any_baseline(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T})
    result = index(file, options(mode="as-published", baseline="substrate"))
    assert (result["mode"], result["baseline"]) == ("as-published", "substrate")


def test_warns_of_a_missing_baseline(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    assert "--baseline" in only_warning(index(file, options()), "the baseline is not specified")
    assert not [line for line in index(file, options(baseline="air"))["warnings"] if "baseline" in line]


def test_repeats_yield_an_uncertainty_and_a_warning_about_their_drift(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    columns = {f"scan{i}": T + 5e-4 * i + rng.normal(0.0, 2e-4, NM.size) for i in range(5)}
    file = table(tmp_path, {"wavelength_nm": NM, **columns})
    names = list(columns)
    result = index(file, IndexOptions(transmittance=names, mode="lossless"))
    assert result["traces"] == {"T": names}
    first, *_, last = result["repeats_lossless_n"]
    assert result["repeats_nm"] == 900.0
    assert first > last
    assert f"{first:.3f} … {last:.3f}" in only_warning(result, "lossless n(900 nm) of the 5 repeat measurements")
    assert "drift in one direction" in only_warning(result, "5 repeat measurements of T")
    assert "--u-T" in only_warning(result, "the instrument's accuracy")
    assert result["u_common_n"][0] > 5 * result["u_random_n"][0]


def test_one_of_several_traces_must_be_selected(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "one (%T)": 100 * T, "two (%T)": 100 * T, "R": R})
    with pytest.raises(DataError, match=r"2 T traces: one, two; choose with --transmittance NAME"):
        index(file, options())
    result = index(file, options(transmittance=["two"], reflectance=["R"]))
    assert (result["mode"], result["traces"]) == ("measured", {"T": ["two"], "R": ["R"]})
    lossless = index(file, options(transmittance=["two"]))
    assert lossless["mode"] == "lossless"
    assert "note: not used: one, R" in lossless["warnings"]


@pytest.mark.parametrize(
    ("selected", "line"),
    [
        ({"transmittance": ["three"]}, "trace three; is not in layer.csv"),
        ({"reflectance": ["one"]}, "--reflectance one; is a trace of T; name it with --transmittance"),
        ({"transmittance": ["one", "one"]}, "--transmittance; names a trace twice"),
        ({"reflectance": ["R"]}, "transmittance; is missing; an index requires T"),
    ],
)
def test_refuses_invalid_traces(tmp_path: Path, selected: dict[str, list[str]], line: str) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "one (%T)": 100 * T, "two (%T)": 100 * T, "R": R})
    with pytest.raises(SolenError) as error:
        index(file, options(**selected))
    assert str(error.value).startswith(line)


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        ({"wavelength_nm": NM, "T": 100 * T}, "T = 91.3"),
        ({"wavelength_nm": np.full(NM.shape, 500.0), "T": T}, "trace T; has 500 nm twice"),
        ({"wavelength_nm": NM, "height": T}, "layer.csv; contains no transmittance"),
    ],
)
def test_refuses_files_without_usable_spectra(tmp_path: Path, columns: dict[str, FloatArray], line: str) -> None:
    with pytest.raises(DataError) as error:
        index(table(tmp_path, columns), options())
    assert str(error.value).startswith(line)


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"mode": "best"}, "mode = 'best'; must be 'measured', 'absorptance'"),
        ({"baseline": "glass"}, "baseline = 'glass'; must be 'substrate' or 'air'"),
        ({"absorbance_kind": "log2"}, "absorbance_kind = 'log2'"),
        ({"thickness_um": -1.0}, "thickness_um = -1.0; must be greater than 0"),
        ({"thickness_um": None}, "--thickness-um; is missing; measure it"),
        ({"bandwidth_nm": float("nan")}, "bandwidth_nm = nan"),
        ({"at_nm": (0.0,)}, "at_nm = 0.0"),
        ({"at_nm": (0.86,)}, "at_nm = 0.86; must be 100 to 20000, in nm; did you mean 860?"),
        ({"u_T": "0.3"}, "u_T = '0.3'; must be a fraction or a percentage from 0 to 10%; write 0.003 or 0.3%"),
        ({"u_R": "nothing"}, "u_R = 'nothing'"),
        ({"u_R": "1%%"}, "u_R = '1%%'"),
        ({"mode": "absorptance"}, "--mode = 'absorptance'; requires a measured absorptance"),
        ({"u_thickness_um": 60.0}, "uncertainty of the thickness = '60 µm'"),
        ({"led": "TEMT7100X01"}, "--led = 'TEMT7100X01'; is not an emitter"),
    ],
)
def test_refuses_invalid_options_in_one_line(tmp_path: Path, values: dict[str, Any], line: str) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    with pytest.raises(SolenError) as error:
        index(file, options(**values))
    assert str(error.value).startswith(line)
    assert len(str(error.value).splitlines()) == 1


def test_writes_nothing_after_a_refusal(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    with pytest.raises(SolenError, match="a figure must end in"):
        index(file, options(), out=tmp_path / "n.json", figure=FigureOptions(figure=tmp_path / "n.bmp"))
    assert [path.name for path in tmp_path.iterdir()] == ["layer.csv"]


def test_index_at_wavelengths_and_for_an_led(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    result = index(file, options(u_T="0.1%", u_R="0.1%", at_nm=(600.0, 655.0, 1000.0), led="VSMY1850"))
    assert [at["n"] for at in result["at"][:2]] == pytest.approx([1.48 + 5e3 / 600**2, 1.48 + 5e3 / 655**2], abs=1e-5)
    assert result["at"][2]["reason"] == "100% of the light is outside 500 to 900 nm, where n is known"
    assert result["led"]["source"] == "VSMY1850, peak at 850 nm, 30 nm wide"
    assert result["led"]["n"] == pytest.approx(1.48 + 5e3 / 850**2, abs=1e-4)


def test_index_for_a_measured_light_spectrum(tmp_path: Path) -> None:
    lamp = np.exp(-(((NM - 700) / 20) ** 2))
    light = table(tmp_path, {"wavelength_nm": NM, "power_mW": lamp}, "led.csv")
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    result = index(file, options(led=str(light)))
    assert result["led"]["source"] == "spectrum of led.csv"
    assert result["led"]["n"] == pytest.approx(float(np.average(N, weights=lamp)), abs=1e-5)
    ambiguous = table(tmp_path, {"wavelength_nm": NM, "a": lamp, "b": lamp}, "two.csv")
    with pytest.raises(DataError, match=r"one column in addition to the wavelength.* a, b"):
        index(file, options(led=str(ambiguous)))


def test_index_for_a_part_file(tmp_path: Path) -> None:
    part = Path(__file__).parents[2] / "src" / "solen" / "parts" / "library" / "VSMY1850.toml"
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    assert index(file, options(led=str(part)))["led"]["source"].startswith("VSMY1850")


def test_different_wavelengths_are_interpolated_and_reported(tmp_path: Path) -> None:
    file = tmp_path / "layer.csv"
    rows = ["wavelength_nm,T,wavelength_nm,R"]
    shifted_r, _ = forward(1.48 + 5e3 / (NM + 5) ** 2, 2e-5, 50.0, NM + 5)
    rows += [f"{a},{t},{a + 5},{r}" for a, t, r in zip(NM, T, shifted_r, strict=True)]
    file.write_text("\n".join(rows) + "\n", encoding="utf-8")
    result = index(file, options())
    assert "R: wavelengths differ" in only_warning(result, "wavelengths differ")
    assert result["reason"][0] == f"n, k: {Reason.MISSING.words}"
    assert np.abs(np.array(result["n"][1:], dtype=float) - N[1:]).max() < 1e-4


def test_warnings_about_fringes_depend_on_the_bandwidth(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    assert "bandwidth is not specified" in only_warning(index(file, options()), "fringes")
    warnings = index(file, options(bandwidth_nm=2.0))["warnings"]
    assert any("contains interference" in line for line in warnings)
    assert any("the wavelengths are 10 nm apart" in line for line in warnings)
    assert not [line for line in index(file, options(bandwidth_nm=20.0))["warnings"] if "fringes" in line]


def test_a_formula_is_fitted_to_the_index(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    noisy = {"wavelength_nm": NM, "T": T, "R": R + rng.normal(0.0, 1e-4, NM.size)}
    file = table(tmp_path, noisy)
    result = index(file, options(u_T="0.1%", u_R="0.1%"))
    assert result["fit"]["kind"] == "cauchy"
    assert result["fit"]["model"]["A"] == pytest.approx(1.48, abs=2e-3)
    curve = result["fit"]
    truth = 1.48 + 5e3 / np.array(curve["wavelength_nm"]) ** 2
    assert np.abs(np.array(curve["n"]) - truth).max() < 5e-4
    assert min(curve["u_n"]) > 0.0035  # common errors do not average out
    sellmeier = index(file, options(fit="sellmeier", terms=1))
    assert sellmeier["fit"]["model"]["kind"] == "sellmeier"
    assert index(file, options(fit="none"))["fit"] is None
    published = index(file, options(mode="as-published"))
    assert published["fit"] is None
    with pytest.raises(SpecError, match="fit = 'spline'"):
        index(file, options(fit="spline"))


def test_too_few_points_for_a_formula_are_reported(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM[:2], "T": T[:2], "R": R[:2]})
    assert "no formula is fitted" in only_warning(index(file, options()), "no formula")
    with pytest.raises(DataError):
        index(file, options(fit="cauchy"))


def test_warns_of_a_formula_that_does_not_follow_the_points(tmp_path: Path) -> None:
    steep = T - 0.2 * np.exp(-(NM - 500.0) / 15.0)
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    result = index(table(tmp_path, {"wavelength_nm": NM, "T": steep}, "steep.csv"), options())
    assert "it deviates by 0.0" in only_warning(result, "the cauchy formula does not follow the points")
    assert not [line for line in index(file, options(mode="measured"))["warnings"] if "does not follow" in line]


def test_the_index_is_compared_with_the_literature(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    result = index(file, options())
    low, high = result["literature"]["low"], result["literature"]["high"]
    assert all(below < n < above for below, n, above in zip(low, result["n"], high, strict=True))
    assert not [line for line in result["warnings"] if "the literature range of" in line]
    assert index(file, options(literature="none"))["literature"] is None
    nm, t = np.array([450.0, 500.0, 860.0]), np.array([0.8473, 0.8685, 0.8889])
    published = index(table(tmp_path, {"wavelength_nm": nm, "T": t}, "three.csv"), options(mode="as-published"))
    assert "2.5 times the largest" in only_warning(published, "n(450 nm) − n(860 nm) = 0.100")
