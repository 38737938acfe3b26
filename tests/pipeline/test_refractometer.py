"""`solen resin refractometer`: a result with the same keys as that of an index."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DataError, OutputError, SolenError, SpecError
from solen.material import Cauchy
from solen.material.index.refractometer import RefractometerOptions
from solen.pipeline.resin.refractometer import refractometer
from solen.report.options import FigureOptions


def evaluate(*n: float, u: float = 5e-4, **more: Any) -> dict[str, Any]:
    return refractometer(list(n), options=RefractometerOptions(u=(u,), **more)).to_dict()


def test_the_result_contains_the_arrays_of_an_index() -> None:
    result = evaluate(1.487)
    arrays = ("wavelength_nm", "n", "u_n", "interval95_n")
    assert {len(result[key]) for key in arrays} == {121}
    assert result["mode"] == "refractometer"
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    fit = result["fit"]
    model = Cauchy(**{key: value if key != "valid_nm" else tuple(value) for key, value in fit.items()})
    position = result["wavelength_nm"].index(860.0)
    assert model.index(860.0) == pytest.approx(result["n"][position], abs=1e-15)
    assert model.u_index(860.0) == pytest.approx(result["u_n"][position], rel=1e-9)
    assert result["n_D"] == pytest.approx(1.487, abs=1e-13)
    assert result["sources"][0]["instrument"] == "refractometer"


def test_knowledge_of_the_material_reduces_the_uncertainty() -> None:
    default, specified = evaluate(1.487), evaluate(1.487, abbe=55.0, u_abbe=3.0)
    silicone = evaluate(1.41, polymer=("silicone",))
    position = default["wavelength_nm"].index(860.0)
    assert specified["u_n"][position] < default["u_n"][position] / 2
    assert specified["abbe"] == pytest.approx(55)
    assert "of silicones" in silicone["prior"]["source"]
    assert len(silicone["warnings"]) == 1
    assert any("below the literature range of acrylates and photoresins" in line for line in evaluate(1.41)["warnings"])


def test_the_index_for_an_emitter_is_the_mean_over_its_spectrum() -> None:
    result = evaluate(1.487, led="VSMY1850", at_nm=(850.0, 860.0))
    assert [index["wavelength_nm"] for index in result["at"]] == [850.0, 860.0]
    assert result["led"]["source"].startswith("VSMY1850")
    assert result["led"]["n"] == pytest.approx(result["at"][0]["n"], abs=2e-5)
    assert result["led"]["u_n"] == pytest.approx(result["at"][0]["u_n"], rel=0.02)


def test_light_outside_the_range_of_the_formula_has_no_index(tmp_path: Path) -> None:
    spectrum = tmp_path / "led.csv"
    spectrum.write_text("wavelength_nm,power\n" + "\n".join(f"{nm},1" for nm in range(950, 1060, 5)), encoding="utf-8")
    result = evaluate(1.487, led=str(spectrum))
    assert result["led"]["n"] is None
    assert "is outside 400 to 1000 nm" in result["led"]["reason"]


def test_the_uncertainty_includes_that_of_the_temperature() -> None:
    exact, uncertain = evaluate(1.487), evaluate(1.487, u_temperature_k=10.0, dn_dt_per_k=-3e-4)
    assert uncertain["u_n_D"] == pytest.approx(np.hypot(exact["u_n_D"], 3e-3), rel=1e-6)
    assert (uncertain["options"]["u_temperature_k"], uncertain["options"]["dn_dt_per_k"]) == (10.0, -3e-4)


def test_writes_all_files_or_none(tmp_path: Path) -> None:
    n, options = [1.5, 1.49], RefractometerOptions(u=(5e-4,), wavelength_nm=(450.0, 600.0))
    out, figure = tmp_path / "n.json", tmp_path / "n.svg"
    result = refractometer(n, options=options, out=out, figure=FigureOptions(figure=figure)).to_dict()
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["kind"] == "refractometer"
    assert written["n"] == result["n"]
    text = figure.read_text(encoding="utf-8")
    assert "literature of acrylates and photoresins" in text
    assert "measured" in text
    with pytest.raises(OutputError, match="a figure must end in"):
        refractometer(n, options=options, out=tmp_path / "other.json", figure=FigureOptions(figure=tmp_path / "n.gif"))
    assert not (tmp_path / "other.json").exists()


@pytest.mark.parametrize(
    ("more", "error", "line"),
    [
        (
            {"n": (1.5, 1.49)},
            SpecError,
            "--wavelength-nm; is missing; specify it once for each index, in the same order",
        ),
        ({"abbe": 50.0}, SpecError, "u_abbe; is required with --abbe; specify both"),
        ({"u_abbe": 5.0}, SpecError, "abbe; is required with --u-abbe; specify both"),
        ({"abbe": 50.0, "u_abbe": 5.0, "polymer": ("acrylate",)}, SpecError, "polymer; cannot be combined with --abbe"),
        ({"polymer": ("rubber",)}, SpecError, "polymer = 'rubber'; must be 'acrylate'"),
        ({"at_nm": (300.0,)}, SpecError, "at_nm = 300.0; must be at least 400"),
        ({"u": (0.0,)}, DataError, "u_n = 0.0; must be above 0 and below 0.5"),
        ({"led": "no-such-part"}, SolenError, "no-such-part"),
    ],
)
def test_refuses_invalid_input_in_one_line(more: dict[str, Any], error: type[SolenError], line: str) -> None:
    values = {"n": (1.49,), "u": (5e-4,)} | more
    n = values.pop("n")
    with pytest.raises(error) as caught:
        refractometer(n, options=RefractometerOptions(**values))
    assert line in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
