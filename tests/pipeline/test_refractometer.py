"""From values of a refractometer to a result that whatever takes an index takes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DataError, OutputError, SolenError, SpecError
from solen.material import Cauchy
from solen.pipeline.resin.refractometer import RefractometerOptions, refractometer


def found(*n: float, u: float = 5e-4, **more: Any) -> dict[str, Any]:
    return refractometer(RefractometerOptions(n=n, u=(u,), **more))


def test_the_arrays_are_those_of_an_index() -> None:
    result = found(1.487)
    arrays = ("wavelength_nm", "n", "u_n", "k", "u_k", "reason", "u95_n")
    assert {len(result[key]) for key in arrays} == {121}
    assert result["mode"] == "refractometer"
    assert set(result["k"]) == {None}
    assert result["reason"][0] == "k: a refractometer does not measure it"
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    fit = result["fit"]
    model = Cauchy(**{key: value if key != "valid_nm" else tuple(value) for key, value in fit["model"].items()})
    at = result["wavelength_nm"].index(860.0)
    assert model.index(860.0) == pytest.approx(result["n"][at], abs=1e-15)
    assert model.u_index(860.0) == pytest.approx(result["u_n"][at], rel=1e-9)
    assert result["line"]["n"] == pytest.approx(1.487, abs=1e-13)
    assert result["sources"][0]["instrument"] == "refractometer"


def test_what_is_known_of_the_material_narrows_the_dispersion() -> None:
    usual, stated, silicone = found(1.487), found(1.487, abbe=55.0, u_abbe=3.0), found(1.41, polymers=("silicone",))
    at = usual["wavelength_nm"].index(860.0)
    assert stated["u_n"][at] < usual["u_n"][at] / 2
    assert stated["dispersion"]["abbe"] == pytest.approx(55)
    assert "of silicones" in silicone["dispersion"]["prior"]["source"]
    assert len(silicone["warnings"]) == 1
    assert any("below the literature of acrylates and photoresins" in line for line in found(1.41)["warnings"])


def test_an_index_in_an_emitters_light_is_the_mean_over_it() -> None:
    result = found(1.487, led="VSMY1850", at_nm=(850.0, 860.0))
    assert [one["wavelength_nm"] for one in result["at"]] == [850.0, 860.0]
    assert result["led"]["source"].startswith("VSMY1850")
    assert result["led"]["n"] == pytest.approx(result["at"][0]["n"], abs=2e-5)
    assert result["led"]["u_n"] == pytest.approx(result["at"][0]["u_n"], rel=0.02)


def test_light_beyond_the_formula_gets_no_index(tmp_path: Path) -> None:
    spectrum = tmp_path / "led.csv"
    spectrum.write_text("wavelength_nm,power\n" + "\n".join(f"{nm},1" for nm in range(950, 1060, 5)), encoding="utf-8")
    result = found(1.487, led=str(spectrum))
    assert result["led"]["n"] is None
    assert "lies outside 400 to 1000 nm" in result["led"]["reason"]


def test_temperature_goes_into_the_uncertainty() -> None:
    cold, warm = found(1.487), found(1.487, u_temperature_k=10.0, dn_dt_per_k=-3e-4)
    assert warm["line"]["u_n"] == pytest.approx(np.hypot(cold["line"]["u_n"], 3e-3), rel=1e-6)
    assert warm["temperature"] == {"u_temperature_k": 10.0, "dn_dt_per_k": -3e-4}


def test_files_are_both_written_or_neither(tmp_path: Path) -> None:
    options = RefractometerOptions(n=(1.5, 1.49), u=(5e-4,), wavelength_nm=(450.0, 600.0))
    out, figure = tmp_path / "n.json", tmp_path / "n.svg"
    result = refractometer(options, out=out, figure=figure)
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["kind"] == "refractometer"
    assert written["n"] == result["n"]
    text = figure.read_text(encoding="utf-8")
    assert "literature of acrylates and photoresins" in text
    assert "measured" in text
    with pytest.raises(OutputError, match="a figure ends in"):
        refractometer(options, out=tmp_path / "other.json", figure=tmp_path / "n.gif")
    assert not (tmp_path / "other.json").exists()


@pytest.mark.parametrize(
    ("more", "error", "line"),
    [
        ({"n": (1.5, 1.49)}, SpecError, "--wavelength-nm; is missing; say it once for each index, in their order"),
        ({"abbe": 50.0}, SpecError, "--u-abbe; is missing beside --abbe; state both"),
        ({"u_abbe": 5.0}, SpecError, "--abbe; is missing beside --u-abbe; state both"),
        ({"abbe": 50.0, "u_abbe": 5.0, "polymers": ("acrylate",)}, SpecError, "--polymer; cannot go with --abbe"),
        ({"polymers": ("rubber",)}, SpecError, "--polymer = 'rubber'; must be one of acrylate, photoresin, silicone"),
        ({"at_nm": (300.0,)}, SpecError, "--at-nm = 300.0; must be from 400 to 1000"),
        ({"u": (0.0,)}, DataError, "u_n = 0.0; must be above 0 and below 0.5"),
        ({"led": "no-such-part"}, SolenError, "no-such-part"),
    ],
)
def test_bad_input_is_one_line(more: dict[str, Any], error: type[SolenError], line: str) -> None:
    with pytest.raises(error) as refusal:
        refractometer(RefractometerOptions(**{"n": (1.49,), "u": (5e-4,)} | more))
    assert line in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1
