"""From a file of spectra to an index: traces, routes, what is asked for, what is told."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import DataError, SolenError, SpecError
from solen.material.index import forward
from solen.material.index.options import IndexOptions
from solen.material.index.routes import AS_PUBLISHED
from solen.pipeline.resin import index as pipeline
from solen.report.options import FigureOptions

NM = np.arange(500.0, 901.0, 10.0)
N = 1.48 + 5e3 / NM**2
R, T = forward(N, 2e-5, 50.0, NM)


def index(file: Path, options: IndexOptions = IndexOptions(), **named: Any) -> dict[str, Any]:
    """The result as its JSON holds it."""
    return pipeline.index(file, options=options, **named).to_dict()


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


def warned(found: dict[str, Any], words: str) -> str:
    (line,) = [one for one in found["warnings"] if words in one]
    return str(line)


def test_the_simplest_table_gives_n_and_k(tmp_path: Path) -> None:
    found = index(table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R}), options())
    assert found["mode"] == "measured"
    assert found["wavelength_nm"] == NM.tolist()
    assert np.abs(np.array(found["n"]) - N).max() < 1e-9
    assert np.abs(np.array(found["k"]) - 2e-5).max() < 1e-12
    assert found["reason"] == [None] * NM.size
    assert found["u_n"] == found["u_k"] == [None] * NM.size
    assert (found["masked_n"], found["masked_k"]) == (0, 0)
    assert len(found["lossless_n"]) == NM.size
    assert found["sources"][0]["file"] == "layer.csv"
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_percent_and_descending_wavelengths_are_the_same(tmp_path: Path) -> None:
    plain = index(table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R}), options())
    other = table(tmp_path, {"Wavelength (nm)": NM[::-1], "T (%)": 100 * T[::-1], "%R": 100 * R[::-1]})
    turned = index(other, options())
    for key in ("n", "k", "wavelength_nm"):
        np.testing.assert_allclose(turned[key], plain[key], rtol=1e-9)


def test_stated_uncertainties_go_through(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    found = index(file, options(u_T="0.1%", u_R="0.001", u_thickness_um=2.0))
    assert found["u_n"][-1] == pytest.approx(0.001 * np.hypot(3.9, 0.31), rel=0.05)
    assert found["u_k"][-1] == pytest.approx(np.hypot(2e-5 * 0.04, 0.001 * 900 / (4e3 * np.pi * 50) * 1.4), rel=0.1)
    low, high = found["interval95_n"][0]
    assert (high - low) / 2 == pytest.approx(1.959964 * found["u_n"][0], rel=1e-5)
    assert not [line for line in found["warnings"] if "uncertainty" in line]


def test_masked_values_are_null_with_their_reason(tmp_path: Path) -> None:
    bad = R.copy()
    bad[3], bad[5] = -0.01, np.nan
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": np.nan_to_num(bad, nan=2.0)})
    found = index(file, options())
    assert found["n"][3] is None
    assert found["k"][5] is None
    assert found["reason"][3] == found["reason"][5] == "n, k: R is not between 0 and 1"
    assert (found["masked_n"], found["masked_k"]) == (2, 2)


def test_t_alone_gives_the_lossless_index_and_says_so(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T})
    found = index(file, IndexOptions(u_T="0.1%"))
    assert (found["mode"], found["options"]["thickness_um"]) == ("lossless", None)
    assert found["n"] == found["lossless_n"]
    assert (np.array(found["n"]) > N).all()
    assert "k = 0 is assumed" in found["warnings"][0]


def test_an_absorptance_is_taken_where_it_is_said_to_be_one(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "A": 1.0 - R - T})
    with pytest.raises(SpecError, match=r"^--absorbance-kind; must be specified for A: log10, ln or absorptance"):
        index(file, options())
    found = index(file, options(absorbance_kind="absorptance", u_T="0.1%", u_A="0"))
    assert found["mode"] == "absorptance"
    assert np.abs(np.array(found["n"]) - N).max() < 1e-9
    assert found["u_n"][-1] == pytest.approx(0.0042, rel=0.05)


@pytest.mark.parametrize("kind", ["absorptance", "log10"])
def test_an_absorbance_gives_no_measured_index(tmp_path: Path, kind: str) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "Abs": -np.log10(T)})
    line = r"absorbance, −log10 T, which .* n\(700 nm\) = 1\.5\d+, .* have 1.47 to 1.55; measure R"
    with pytest.raises(DataError, match=line) as refusal:
        index(file, options(absorbance_kind=kind))
    assert len(str(refusal.value).splitlines()) == 1
    assert index(file, options(absorbance_kind=kind, mode="lossless"))["mode"] == "lossless"


def test_an_absorbance_alone_is_a_transmittance(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "Abs": -np.log10(T)})
    with pytest.raises(SpecError, match="--absorbance-kind; must be specified for Abs"):
        index(file, options())
    found = index(file, options(absorbance_kind="log10", u_A="0.001"))
    np.testing.assert_allclose(found["T"], T, rtol=1e-12)
    alone = index(table(tmp_path, {"wavelength_nm": NM, "T": T}, "t.csv"), options(u_T="0.001"))
    np.testing.assert_allclose(found["u_n"], np.log(10.0) * T * np.array(alone["u_n"]), rtol=1e-9)
    with pytest.raises(DataError, match="an absorptance alone determines no index"):
        index(file, options(absorbance_kind="absorptance"))


def test_as_published_is_an_explicit_mode_with_a_label(tmp_path: Path) -> None:
    nm, t = np.array([450.0, 500.0, 860.0]), np.array([0.8473, 0.8685, 0.8889])
    file = table(tmp_path, {"wavelength_nm": nm, "T": t})
    assert index(file, options())["mode"] == "lossless"
    found = index(
        file, options(mode="as-published"), out=tmp_path / "n.json", figure=FigureOptions(figure=tmp_path / "n.svg")
    )
    assert [round(n, 2) for n in found["n"]] == [1.54, 1.49, 1.44]
    assert (found["measurement"], found["warnings"][0]) == (False, AS_PUBLISHED)
    assert found["u_n"] == found["k"] == [None] * 3
    kept = json.loads((tmp_path / "n.json").read_text(encoding="utf-8"))
    assert (kept["kind"], kept["mode"], kept["measurement"]) == ("index", "as-published", False)
    drawn = (tmp_path / "n.svg").read_text(encoding="utf-8")
    assert "R computed from T, not measured" in drawn
    assert "as published" in drawn


def test_as_published_takes_no_other_absorbance(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "A": 1.0 - R - T})
    with pytest.raises(DataError, match="trace A; is not −log10 T, which the as-published mode uses for A"):
        index(file, options(mode="as-published"))
    with pytest.raises(SpecError, match="requires A as log10"):
        index(file, options(mode="as-published", absorbance_kind="ln"))


def test_an_absorbance_of_another_baseline_is_reported(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "Abs": -np.log10(T) - 0.03})
    found = index(file, options(mode="lossless", absorbance_kind="log10"))
    assert warned(found, "Abs is not the absorbance of T: they have different baselines")


def test_a_substrate_as_baseline_is_no_free_standing_layer(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T * 1.12, "R": R})
    found = index(file, options())
    assert found["masked_n"] == NM.size
    assert "if so, specify --baseline substrate" in warned(found, "T exceeds 1 at 100% of the wavelengths")
    with pytest.raises(SolenError, match="substrate; is required with"):
        index(file, options(baseline="substrate"))


def test_as_published_has_no_use_for_the_baseline(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T})
    found = index(file, options(mode="as-published", baseline="substrate"))
    assert (found["mode"], found["baseline"]) == ("as-published", "substrate")


def test_the_baseline_is_asked_for(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    assert "specify --baseline" in warned(index(file, options()), "the baseline is not specified")
    assert not [line for line in index(file, options(baseline="air"))["warnings"] if "baseline" in line]


def test_repeats_make_an_uncertainty_and_tell_their_drift(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    columns = {f"scan{i}": T + 5e-4 * i + rng.normal(0.0, 2e-4, NM.size) for i in range(5)}
    file = table(tmp_path, {"wavelength_nm": NM, **columns})
    names = list(columns)
    found = index(file, IndexOptions(transmittance=names, mode="lossless"))
    assert found["traces"] == {"T": names}
    first, *_, last = found["repeats_lossless_n"]
    assert found["repeats_nm"] == 900.0
    assert first > last
    assert f"{first:.3f} … {last:.3f}" in warned(found, "lossless n(900 nm) of the 5 repeats")
    assert "drift in one direction" in warned(found, "5 repeats of T")
    assert "specify the accuracy with --u-T" in warned(found, "the instrument's accuracy")
    assert found["u_common_n"][0] > 5 * found["u_random_n"][0]


def test_several_traces_must_be_chosen_from(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "one (%T)": 100 * T, "two (%T)": 100 * T, "R": R})
    with pytest.raises(DataError, match=r"2 T traces: one, two; choose with --transmittance NAME"):
        index(file, options())
    found = index(file, options(transmittance=["two"], reflectance=["R"]))
    assert (found["mode"], found["traces"]) == ("measured", {"T": ["two"], "R": ["R"]})
    alone = index(file, options(transmittance=["two"]))
    assert alone["mode"] == "lossless"
    assert "note: not used: one, R" in alone["warnings"]


@pytest.mark.parametrize(
    ("chosen", "line"),
    [
        ({"transmittance": ["three"]}, "trace three; not in layer.csv"),
        ({"reflectance": ["one"]}, "--reflectance one; is a T trace; name it with --transmittance"),
        ({"transmittance": ["one", "one"]}, "--transmittance; names a trace twice"),
        ({"reflectance": ["R"]}, "transmittance; is missing; an index requires T"),
    ],
)
def test_traces_that_cannot_be_taken_are_reported(tmp_path: Path, chosen: dict[str, list[str]], line: str) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "one (%T)": 100 * T, "two (%T)": 100 * T, "R": R})
    with pytest.raises(SolenError) as refusal:
        index(file, options(**chosen))
    assert str(refusal.value).startswith(line)


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        ({"wavelength_nm": NM, "T": 100 * T}, "T = 91.3"),
        ({"wavelength_nm": np.full(NM.shape, 500.0), "T": T}, "trace T; has 500 nm twice"),
        ({"wavelength_nm": NM, "height": T}, "layer.csv; contains no transmittance"),
    ],
)
def test_files_without_usable_spectra_are_reported(tmp_path: Path, columns: dict[str, FloatArray], line: str) -> None:
    with pytest.raises(DataError) as refusal:
        index(table(tmp_path, columns), options())
    assert str(refusal.value).startswith(line)


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
        ({"u_T": "0.3"}, "u_T = '0.3'; must be a fraction or a percentage, 0 to 10%; write 0.003 or 0.3%"),
        ({"u_R": "nothing"}, "u_R = 'nothing'"),
        ({"u_R": "1%%"}, "u_R = '1%%'"),
        ({"mode": "absorptance"}, "--mode absorptance; requires a measured absorptance"),
        ({"u_thickness_um": 60.0}, "uncertainty of the thickness = '60 µm'"),
        ({"led": "TEMT7100X01"}, "--led = 'TEMT7100X01'; is not an emitter"),
    ],
)
def test_bad_options_are_reported_in_one_line(tmp_path: Path, values: dict[str, Any], line: str) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    with pytest.raises(SolenError) as refusal:
        index(file, options(**values))
    assert str(refusal.value).startswith(line)
    assert len(str(refusal.value).splitlines()) == 1


def test_nothing_is_written_where_something_is_refused(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    with pytest.raises(SolenError, match="a figure must end in"):
        index(file, options(), out=tmp_path / "n.json", figure=FigureOptions(figure=tmp_path / "n.bmp"))
    assert [path.name for path in tmp_path.iterdir()] == ["layer.csv"]


def test_in_an_led_and_at_a_wavelength(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    found = index(file, options(u_T="0.1%", u_R="0.1%", at_nm=(600.0, 655.0, 1000.0), led="VSMY1850"))
    assert [one["n"] for one in found["at"][:2]] == pytest.approx([1.48 + 5e3 / 600**2, 1.48 + 5e3 / 655**2], abs=1e-5)
    assert found["at"][2]["reason"] == "100% of the light is outside 500 to 900 nm, where n is known"
    assert found["led"]["source"] == "VSMY1850, peak at 850 nm, 30 nm wide"
    assert found["led"]["n"] == pytest.approx(1.48 + 5e3 / 850**2, abs=1e-4)


def test_in_a_measured_spectrum(tmp_path: Path) -> None:
    lamp = np.exp(-(((NM - 700) / 20) ** 2))
    light = table(tmp_path, {"wavelength_nm": NM, "power_mW": lamp}, "led.csv")
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    found = index(file, options(led=str(light)))
    assert found["led"]["source"] == "spectrum of led.csv"
    assert found["led"]["n"] == pytest.approx(float(np.average(N, weights=lamp)), abs=1e-5)
    two = table(tmp_path, {"wavelength_nm": NM, "a": lamp, "b": lamp}, "two.csv")
    with pytest.raises(DataError, match="requires one power column in addition to the wavelength, but has a, b"):
        index(file, options(led=str(two)))


def test_a_part_file_is_light_too(tmp_path: Path) -> None:
    part = Path(__file__).parents[2] / "src" / "solen" / "parts" / "library" / "VSMY1850.toml"
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    assert index(file, options(led=str(part)))["led"]["source"].startswith("VSMY1850")


def test_other_wavelengths_are_interpolated_and_reported(tmp_path: Path) -> None:
    file = tmp_path / "layer.csv"
    rows = ["wavelength_nm,T,wavelength_nm,R"]
    later, _ = forward(1.48 + 5e3 / (NM + 5) ** 2, 2e-5, 50.0, NM + 5)
    rows += [f"{a},{t},{a + 5},{r}" for a, t, r in zip(NM, T, later, strict=True)]
    file.write_text("\n".join(rows) + "\n", encoding="utf-8")
    found = index(file, options())
    assert "R has different wavelengths" in warned(found, "different wavelengths")
    assert found["reason"][0] == "n, k: no number was measured here"
    assert np.abs(np.array(found["n"][1:], dtype=float) - N[1:]).max() < 1e-4


def test_fringes_are_judged_by_the_bandwidth(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    assert "the instrument's bandwidth is not specified" in warned(index(file, options()), "fringes")
    seen = index(file, options(bandwidth_nm=2.0))["warnings"]
    assert any("contains interference" in line for line in seen)
    assert any("the wavelengths are 10 nm apart, which does not resolve the fringes" in line for line in seen)
    assert not [line for line in index(file, options(bandwidth_nm=20.0))["warnings"] if "fringes" in line]


def test_a_formula_goes_with_the_index(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    noisy = {"wavelength_nm": NM, "T": T, "R": R + rng.normal(0.0, 1e-4, NM.size)}
    file = table(tmp_path, noisy)
    found = index(file, options(u_T="0.1%", u_R="0.1%"))
    assert found["fit"]["kind"] == "cauchy"
    assert found["fit"]["model"]["A"] == pytest.approx(1.48, abs=2e-3)
    curve = found["fit"]
    truth = 1.48 + 5e3 / np.array(curve["wavelength_nm"]) ** 2
    assert np.abs(np.array(curve["n"]) - truth).max() < 5e-4
    assert min(curve["u_n"]) > 0.0035  # what is common to all wavelengths does not average out
    other = index(file, options(fit="sellmeier", terms=1))
    assert other["fit"]["model"]["kind"] == "sellmeier"
    assert index(file, options(fit="none"))["fit"] is None
    published = index(file, options(mode="as-published"))
    assert published["fit"] is None
    with pytest.raises(SpecError, match="fit = 'spline'"):
        index(file, options(fit="spline"))


def test_where_no_formula_can_be_had_that_is_reported(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM[:2], "T": T[:2], "R": R[:2]})
    assert "no formula is fitted" in warned(index(file, options()), "no formula")
    with pytest.raises(DataError):
        index(file, options(fit="cauchy"))


def test_a_formula_that_does_not_follow_the_points_is_reported(tmp_path: Path) -> None:
    steep = T - 0.2 * np.exp(-(NM - 500.0) / 15.0)
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    found = index(table(tmp_path, {"wavelength_nm": NM, "T": steep}, "steep.csv"), options())
    assert "it deviates by 0.0" in warned(found, "the cauchy formula does not follow the points")
    assert not [line for line in index(file, options(mode="measured"))["warnings"] if "does not follow" in line]


def test_the_literature_stands_beside_the_index(tmp_path: Path) -> None:
    file = table(tmp_path, {"wavelength_nm": NM, "T": T, "R": R})
    found = index(file, options())
    low, high = found["literature"]["low"], found["literature"]["high"]
    assert all(a < n < b for a, n, b in zip(low, found["n"], high, strict=True))
    assert not [line for line in found["warnings"] if "the literature of" in line]
    assert index(file, options(literature="none"))["literature"] is None
    nm, t = np.array([450.0, 500.0, 860.0]), np.array([0.8473, 0.8685, 0.8889])
    published = index(table(tmp_path, {"wavelength_nm": nm, "T": t}, "three.csv"), options(mode="as-published"))
    assert "2.5 times the largest" in warned(published, "n(450 nm) − n(860 nm) = 0.100")
