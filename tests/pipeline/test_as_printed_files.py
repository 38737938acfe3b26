"""A design with a measured lens in the commands check, lens, trace, export and run, and refused profiles."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DataError, DesignError, SolenError, SpecError
from solen.lens import profile_text
from solen.pipeline.design import check as pipeline
from solen.pipeline.design.export import export
from solen.pipeline.design.run import run
from solen.pipeline.design.trace import trace
from solen.sensor import Check
from solen.sensor.traced import DesignTrace
from solen.spec import dumps, json_schema, load, loads, save, with_values
from tests.lens.measured_support import X, noise_um, profile

MEASURED = """schema = 1
name = "Print 3"
[material]
index = 1.44
[lens]
shape = "measured"
profile = "lens.json"
[motion]
from_deg = -1.0
to_deg = 1.0
step_deg = 2.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("a print")
    measured = profile(10.0 * np.exp(-(((X - 0.5) / 0.4) ** 2)) + noise_um(0.5), 0.0005)
    (target / "lens.json").write_text(profile_text(measured), encoding="utf-8")
    (target / "sensor.toml").write_text(MEASURED, encoding="utf-8")
    return target


def test_lens_reports_deviation_focus_and_smoothing(folder: Path) -> None:
    result = pipeline.lens(folder / "sensor.toml", csv=folder / "out.csv").to_dict()
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    lens, (focus,) = result["lens"], result["foci"]
    assert lens["shape"] == "measured"
    assert lens["fit"]["simulated"] is True
    assert lens["fit"]["deviation"]["max_um"] == pytest.approx(10.0, abs=0.6)
    assert lens["fit"]["deviation"]["max_x_mm"] == pytest.approx(0.5, abs=0.1)
    assert focus["designed_best_focus_mm"] == pytest.approx(20.0, abs=1e-3)
    assert abs(focus["best_focus_mm"] - 20.0) > 3.0 * focus["u_best_focus_mm"] > 0.0
    assert lens["fit"]["smooth"]["residual"] == pytest.approx(1.0, abs=0.1)
    assert result["warnings"] == []
    assert (folder / "out.csv").read_text(encoding="utf-8").startswith("x_mm,z_mm\n")


def test_check_and_trace(folder: Path) -> None:
    checked = pipeline.check(folder / "sensor.toml").result
    assert isinstance(checked, Check)
    assert checked.lens is not None
    assert checked.lens.shape == "measured"
    result = trace(folder / "sensor.toml", angle_deg=-1.0).result
    assert isinstance(result, DesignTrace)
    assert result.lens == "measured"
    assert result.ledger.total == pytest.approx(1.0)


def test_table_without_uncertainty(folder: Path) -> None:
    rows = "\n".join(f"{x:.6f},{z:.6f}" for x, z in zip(X, profile(noise_um(0.5)).z_mm, strict=True))
    (folder / "lens.csv").write_text(f"x_mm,z_mm\n{rows}\n", encoding="utf-8")
    result = pipeline.check(folder / "sensor.toml", set_=["lens.profile=lens.csv"]).to_dict()
    assert "specifies no uncertainty; 0.49 µm is assumed" in result["warnings"][0]
    assert result["lens"]["fit"]["simulated"] is False


def test_export(folder: Path) -> None:
    result = export(folder / "sensor.toml", folder / "solid", ("dxf", "stl")).result
    assert "the lens has its measured shape" in result.warnings[0]
    assert result.pieces == 1
    assert {path.suffix for path in (folder / "solid").iterdir()} >= {".dxf", ".stl"}


@pytest.fixture(scope="module")
def result(folder: Path) -> dict[str, Any]:
    """Result of a run in which the effect of only one parameter is computed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("solen.sensor.effects.KEYS", ("emitter.offset_mm",))
        patch.setattr("solen.sensor.effects.HOLDS", {})
        return run(folder / "sensor.toml", out=folder / "out").to_dict()


def test_run_compares_designed_and_printed_lens(folder: Path, result: dict[str, Any]) -> None:
    data = json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))
    as_printed = data["as_printed"]
    assert as_printed["simulated"] is True
    assert set(data["response"]) == {"lens", "designed", "no_lens"}
    for source in ("emitter", "chip"):
        comparison = as_printed[source]
        printed, designed = comparison["printed"], comparison["designed"]
        assert designed["angle_deg"] == [-1.0, 1.0]
        difference = np.subtract(printed["contrast"], designed["contrast"])
        assert comparison["difference"] == pytest.approx(difference)
        assert all(u > 0.0 for u in comparison["u_difference"])
        shift = comparison["null_printed_deg"] - comparison["null_designed_deg"]
        assert comparison["null_shift_deg"] == pytest.approx(shift)
        assert 0.3 < np.mean(np.add(printed["right"], printed["left"])) < 0.7
    largest = as_printed["chip"]["largest"]
    assert abs(largest["contrast"]) > 3.0 * largest["u_contrast"]
    assert result["as_printed"]["chip"]["largest"] == largest


def test_report_names_simulated_print(folder: Path, result: dict[str, Any]) -> None:
    page = Path(result["files"]["report"]).read_text(encoding="utf-8")
    assert "As designed and as printed (simulated)" in page
    assert "as printed (measured)" not in page
    assert "lens as designed" in page
    origin, header, *_ = (folder / "out" / "results.csv").read_text(encoding="utf-8").splitlines()
    assert origin == "# simulated by solen, not measured"
    assert "designed_power_contrast" in header


def test_measured_print_is_not_simulated(folder: Path, result: dict[str, Any]) -> None:
    assert result["as_printed"]["simulated"]
    text = (folder / "lens.json").read_text(encoding="utf-8").replace('"simulated": true', '"simulated": false')
    (folder / "real.json").write_text(text, encoding="utf-8")
    result = pipeline.lens(folder / "sensor.toml", set_=["lens.profile=real.json"]).to_dict()
    assert result["lens"]["fit"]["simulated"] is False


INVALID: list[tuple[list[str], type[SolenError], str]] = [
    (["lens.profile=none.json"], DataError, "no such file"),
    (["lens.profile=sensor.toml"], DataError, "lens.profile"),
    (["lens.profile="], SpecError, "lens.profile"),
    (["lens.profile=3"], SpecError, "lens.profile = 3; must be text"),
    (["lens.half_width_mm=2.9"], DesignError, "lens.profile = '2001 points from -2 to 2 mm'"),
    (["lens.focus_mm=1.5"], DesignError, "lens.focus_mm"),
    (["lens.shape=printed"], SpecError, "'layered', 'measured' or 'none'"),
]


@pytest.mark.parametrize(("assignments", "error", "words"), INVALID)
def test_refuses_invalid_profile(folder: Path, assignments: list[str], error: type[SolenError], words: str) -> None:
    with pytest.raises(error) as raised:
        pipeline.check(folder / "sensor.toml", set_=assignments)
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)


def test_profile_is_required_for_measured_lens_only() -> None:
    with pytest.raises(SpecError, match=r'lens\.profile; missing: shape = "measured" needs it; add profile'):
        loads(MEASURED.replace('profile = "lens.json"\n', ""))
    outline = '[body]\nkind = "outline"\nfile = "a.dxf"\n[lens]\nprofile = "lens.json"\n'
    with pytest.raises(SpecError, match=r"lens\.profile = 'lens\.json'; does not apply with body.kind = \"outline\""):
        loads(f'schema = 1\nname = "a"\n[material]\nindex = 1.44\n{outline}')


def test_profile_path_is_updated_on_saving(folder: Path) -> None:
    design = load(folder / "sensor.toml")
    (folder / "deeper").mkdir(exist_ok=True)
    moved = load(save(folder / "deeper" / "copy.toml", design))
    assert moved.lens.profile == "../lens.json"
    assert moved.files["lens.profile"].resolve() == (folder / "lens.json").resolve()
    oval = with_values(design, {"lens.shape": "cartesian-oval", "lens.profile": None})
    assert "profile" not in dumps(oval)


def test_schema_requires_profile() -> None:
    schema = json_schema()
    lens = schema["$defs"]["Lens"]
    needs = {rule["if"]["properties"]["shape"]["const"]: rule["then"]["required"] for rule in lens["allOf"]}
    assert needs == {"measured": ["profile"], "spline": ["knots_um"]}
    assert lens["properties"]["profile"]["type"] == "string"
