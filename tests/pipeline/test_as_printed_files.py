"""A design with a measured lens, by every door: check, lens, trace, export, sensitivity, run; and what is refused."""

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
    made = tmp_path_factory.mktemp("a print")
    found = profile(10.0 * np.exp(-(((X - 0.5) / 0.4) ** 2)) + noise_um(0.5), 0.0005)
    (made / "lens.json").write_text(profile_text(found), encoding="utf-8")
    (made / "sensor.toml").write_text(MEASURED, encoding="utf-8")
    return made


def test_lens_tells_deviation_focus_and_smoothing(folder: Path) -> None:
    found = pipeline.lens(folder / "sensor.toml", csv=folder / "out.csv").to_dict()
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    lens, (focus,) = found["lens"], found["foci"]
    assert lens["shape"] == "measured"
    assert lens["fit"]["simulated"] is True
    assert lens["fit"]["deviation"]["max_um"] == pytest.approx(10.0, abs=0.6)
    assert lens["fit"]["deviation"]["max_x_mm"] == pytest.approx(0.5, abs=0.1)
    assert focus["designed_best_focus_mm"] == pytest.approx(20.0, abs=1e-3)
    assert abs(focus["best_focus_mm"] - 20.0) > 3.0 * focus["u_best_focus_mm"] > 0.0
    assert lens["fit"]["smooth"]["residual"] == pytest.approx(1.0, abs=0.1)
    assert found["warnings"] == []
    assert (folder / "out.csv").read_text(encoding="utf-8").startswith("x_mm,z_mm\n")


def test_check_and_trace_work_with_it(folder: Path) -> None:
    checked = pipeline.check(folder / "sensor.toml").result
    assert isinstance(checked, Check)
    assert checked.lens is not None
    assert checked.lens.shape == "measured"
    found = trace(folder / "sensor.toml", angle_deg=-1.0).result
    assert isinstance(found, DesignTrace)
    assert found.lens == "measured"
    assert found.ledger.total == pytest.approx(1.0)


def test_a_table_is_a_profile_and_its_missing_uncertainty_is_reported(folder: Path) -> None:
    rows = "\n".join(f"{x:.6f},{z:.6f}" for x, z in zip(X, profile(noise_um(0.5)).z_mm, strict=True))
    (folder / "lens.csv").write_text(f"x_mm,z_mm\n{rows}\n", encoding="utf-8")
    found = pipeline.check(folder / "sensor.toml", set_=["lens.profile=lens.csv"]).to_dict()
    assert "specifies no uncertainty; 0.49 µm is assumed" in found["warnings"][0]
    assert found["lens"]["fit"]["simulated"] is False


def test_it_is_exported_as_it_is_traced(folder: Path) -> None:
    found = export(folder / "sensor.toml", folder / "solid", ("dxf", "stl")).result
    assert "the lens has its measured shape" in found.warnings[0]
    assert found.pieces == 1
    assert {path.suffix for path in (folder / "solid").iterdir()} >= {".dxf", ".stl"}


@pytest.fixture(scope="module")
def ran(folder: Path) -> dict[str, Any]:
    return run(folder / "sensor.toml", out=folder / "out").to_dict()


def test_a_run_shows_designed_against_printed(folder: Path, ran: dict[str, Any]) -> None:
    data = json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))
    found = data["as_printed"]
    assert found["simulated"] is True
    assert set(data["response"]) == {"lens", "designed", "no_lens"}
    for part in ("emitter", "chip"):
        one = found[part]
        assert one["designed"]["angle_deg"] == [-1.0, 1.0]
        rows = zip(one["printed"]["contrast"], one["designed"]["contrast"], one["difference"], strict=True)
        assert all(after - before == pytest.approx(change) for after, before, change in rows)
        assert all(u > 0.0 for u in one["u_difference"])
        assert one["null_shift_deg"] == pytest.approx(one["null_printed_deg"] - one["null_designed_deg"])
        received = [sum(pair) for pair in zip(one["printed"]["right"], one["printed"]["left"], strict=True)]
        assert 0.3 < sum(received) / len(received) < 0.7
    assert abs(found["chip"]["largest"]["contrast"]) > 3.0 * found["chip"]["largest"]["u_contrast"]
    assert ran["as_printed"]["chip"]["largest"] == found["chip"]["largest"]


def test_the_report_says_what_it_is(folder: Path, ran: dict[str, Any]) -> None:
    page = Path(ran["files"]["report"]).read_text(encoding="utf-8")
    assert "As designed and as printed (simulated)" in page
    assert "as printed (measured)" not in page
    assert "lens as designed" in page
    origin, header, *_ = (folder / "out" / "results.csv").read_text(encoding="utf-8").splitlines()
    assert origin == "# simulated by solen, not measured"
    assert "designed_power_contrast" in header


def test_a_measured_print_is_called_measured(folder: Path, ran: dict[str, Any]) -> None:
    assert ran["as_printed"]["simulated"]
    text = (folder / "lens.json").read_text(encoding="utf-8").replace('"simulated": true', '"simulated": false')
    (folder / "real.json").write_text(text, encoding="utf-8")
    found = pipeline.lens(folder / "sensor.toml", set_=["lens.profile=real.json"]).to_dict()
    assert found["lens"]["fit"]["simulated"] is False


REFUSED: list[tuple[list[str], type[SolenError], str]] = [
    (["lens.profile=none.json"], DataError, "no such file"),
    (["lens.profile=sensor.toml"], DataError, "lens.profile"),
    (["lens.profile="], SpecError, "lens.profile"),
    (["lens.profile=3"], SpecError, "lens.profile = 3; must be text"),
    (["lens.half_width_mm=2.9"], DesignError, "lens.profile; has 2001 points on the lens, from -2 to 2 mm"),
    (["lens.focus_mm=1.5"], DesignError, "lens.focus_mm"),
    (["lens.shape=printed"], SpecError, "'layered', 'measured' or 'none'"),
]


@pytest.mark.parametrize(("assignments", "error", "words"), REFUSED)
def test_what_cannot_be_is_refused_in_one_line(
    folder: Path, assignments: list[str], error: type[SolenError], words: str
) -> None:
    with pytest.raises(error) as refusal:
        pipeline.check(folder / "sensor.toml", set_=assignments)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_measured_lens_needs_a_profile_and_a_drawn_body_has_none() -> None:
    with pytest.raises(SpecError, match=r'lens\.profile; missing: shape = "measured" needs it; add profile'):
        loads(MEASURED.replace('profile = "lens.json"\n', ""))
    outline = '[body]\nkind = "outline"\nfile = "a.dxf"\n[lens]\nprofile = "lens.json"\n'
    with pytest.raises(SpecError, match=r"lens\.profile = 'lens\.json'; does not apply with body.kind = \"outline\""):
        loads(f'schema = 1\nname = "a"\n[material]\nindex = 1.44\n{outline}')


def test_the_profile_goes_along_when_a_design_is_saved_elsewhere(folder: Path) -> None:
    design = load(folder / "sensor.toml")
    (folder / "deeper").mkdir(exist_ok=True)
    moved = load(save(folder / "deeper" / "copy.toml", design))
    assert moved.lens.profile == "../lens.json"
    assert moved.files["lens.profile"].resolve() == (folder / "lens.json").resolve()
    oval = with_values(design, {"lens.shape": "cartesian-oval", "lens.profile": None})
    assert "profile" not in dumps(oval)


def test_the_schema_states_that_a_measured_lens_needs_a_profile() -> None:
    schema = json_schema()
    lens = schema["$defs"]["Lens"]
    needs = {rule["if"]["properties"]["shape"]["const"]: rule["then"]["required"] for rule in lens["allOf"]}
    assert needs == {"measured": ["profile"], "spline": ["knots_um"]}
    assert lens["properties"]["profile"]["type"] == "string"
