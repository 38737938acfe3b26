"""Commands with a measured lens: check, lens, trace, export and run; errors, and designs with a profile."""

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
    folder = tmp_path_factory.mktemp("a print")
    measured = profile(10.0 * np.exp(-(((X - 0.5) / 0.4) ** 2)) + noise_um(0.5), 0.0005)
    (folder / "lens.json").write_text(profile_text(measured), encoding="utf-8")
    (folder / "sensor.toml").write_text(MEASURED, encoding="utf-8")
    return folder


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


def test_check_and_trace_use_the_measured_lens(folder: Path) -> None:
    checked = pipeline.check(folder / "sensor.toml").result
    assert isinstance(checked, Check)
    assert checked.lens is not None
    assert checked.lens.shape == "measured"
    traced = trace(folder / "sensor.toml", angle_deg=-1.0).result
    assert isinstance(traced, DesignTrace)
    assert traced.lens == "measured"
    assert traced.ledger.total == pytest.approx(1.0)


def test_warns_of_a_table_without_uncertainty(folder: Path) -> None:
    rows = "\n".join(f"{x:.6f},{z:.6f}" for x, z in zip(X, profile(noise_um(0.5)).z_mm, strict=True))
    (folder / "lens.csv").write_text(f"x_mm,z_mm\n{rows}\n", encoding="utf-8")
    result = pipeline.check(folder / "sensor.toml", set_=["lens.profile=lens.csv"]).to_dict()
    assert "0.49 µm" in result["warnings"][0]
    assert result["lens"]["fit"]["simulated"] is False


def test_exports_the_measured_lens(folder: Path) -> None:
    result = export(folder / "sensor.toml", folder / "solid", ("dxf", "stl")).result
    assert "measured" in result.warnings[0]
    assert result.pieces == 1
    assert {path.suffix for path in (folder / "solid").iterdir()} >= {".dxf", ".stl"}


@pytest.fixture(scope="module")
def results(folder: Path) -> dict[str, Any]:
    """Results of a run in which the effect of only one parameter is computed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("solen.sensor.effects.KEYS", ("emitter.offset_mm",))
        patch.setattr("solen.sensor.effects.HOLDS", {})
        return run(folder / "sensor.toml", out=folder / "out").to_dict()


def test_a_run_compares_the_designed_and_the_printed_lens(folder: Path, results: dict[str, Any]) -> None:
    data = json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))
    as_printed = data["as_printed"]
    assert as_printed["simulated"] is True
    assert set(data["response"]) == {"lens", "designed", "no_lens"}
    for comparison in (as_printed["emitter"], as_printed["chip"]):
        designed, printed = comparison["designed"], comparison["printed"]
        assert designed["angle_deg"] == [-1.0, 1.0]
        rows = zip(printed["contrast"], designed["contrast"], comparison["difference"], strict=True)
        assert all(after - before == pytest.approx(change) for after, before, change in rows)
        assert all(u > 0.0 for u in comparison["u_difference"])
        shift_deg = comparison["null_printed_deg"] - comparison["null_designed_deg"]
        assert comparison["null_shift_deg"] == pytest.approx(shift_deg)
        received = np.add(printed["right"], printed["left"])
        assert 0.3 < received.mean() < 0.7
    largest = as_printed["chip"]["largest"]
    assert abs(largest["contrast"]) > 3.0 * largest["u_contrast"]
    assert results["as_printed"]["chip"]["largest"] == largest


def test_the_report_marks_a_simulated_profile(folder: Path, results: dict[str, Any]) -> None:
    page = Path(results["files"]["report"]).read_text(encoding="utf-8")
    assert "As designed and as printed (simulated)" in page
    assert "as printed (measured)" not in page
    assert "lens as designed" in page
    origin, header, *_ = (folder / "out" / "results.csv").read_text(encoding="utf-8").splitlines()
    assert origin == "# simulated by solen, not measured"
    assert "designed_power_contrast" in header


def test_a_measured_profile_is_not_simulated(folder: Path, results: dict[str, Any]) -> None:
    assert results["as_printed"]["simulated"]
    text = (folder / "lens.json").read_text(encoding="utf-8").replace('"simulated": true', '"simulated": false')
    (folder / "real.json").write_text(text, encoding="utf-8")
    result = pipeline.lens(folder / "sensor.toml", set_=["lens.profile=real.json"]).to_dict()
    assert result["lens"]["fit"]["simulated"] is False


INVALID: list[tuple[list[str], type[SolenError], str]] = [
    (["lens.profile=none.json"], DataError, "no such file"),
    (["lens.profile=sensor.toml"], DataError, "lens.profile"),
    (["lens.profile="], SpecError, "lens.profile"),
    (["lens.profile=3"], SpecError, "lens.profile = 3; must be a string"),
    (["lens.half_width_mm=2.9"], DesignError, "lens.profile; has 2001 points on the lens, from -2 to 2 mm"),
    (["lens.focus_mm=1.5"], DesignError, "lens.focus_mm"),
    (["lens.shape=printed"], SpecError, "'layered', 'measured' or 'none'"),
]


@pytest.mark.parametrize(("assignments", "error", "text"), INVALID)
def test_refuses_invalid_values(folder: Path, assignments: list[str], error: type[SolenError], text: str) -> None:
    with pytest.raises(error) as raised:
        pipeline.check(folder / "sensor.toml", set_=assignments)
    assert text in str(raised.value)
    assert "\n" not in str(raised.value)


def test_refuses_a_measured_lens_without_profile_and_a_profile_of_a_drawn_body() -> None:
    with pytest.raises(SpecError, match=r'lens\.profile; is missing: required with shape = "measured"'):
        loads(MEASURED.replace('profile = "lens.json"\n', ""))
    outline = '[body]\nkind = "outline"\nfile = "a.dxf"\n[lens]\nprofile = "lens.json"\n'
    with pytest.raises(SpecError, match=r"lens\.profile = 'lens\.json'; does not apply with body.kind = \"outline\""):
        loads(f'schema = 1\nname = "a"\n[material]\nindex = 1.44\n{outline}')


def test_a_saved_design_refers_to_its_profile(folder: Path) -> None:
    design = load(folder / "sensor.toml")
    (folder / "deeper").mkdir(exist_ok=True)
    moved = load(save(folder / "deeper" / "copy.toml", design))
    assert moved.lens.profile == "../lens.json"
    assert moved.files["lens.profile"].resolve() == (folder / "lens.json").resolve()
    oval = with_values(design, {"lens.shape": "cartesian-oval", "lens.profile": None})
    assert "profile" not in dumps(oval)


def test_the_schema_requires_a_profile_for_a_measured_lens() -> None:
    schema = json_schema()
    lens = schema["$defs"]["Lens"]
    required = {rule["if"]["properties"]["shape"]["const"]: rule["then"]["required"] for rule in lens["allOf"]}
    assert required == {"measured": ["profile"], "spline": ["knots_um"]}
    assert lens["properties"]["profile"]["type"] == "string"
