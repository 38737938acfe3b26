"""The sheet of a job by a working curve: one that was fitted under the printer's lamp, and the process's exposures."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.integrate import quad

from solen.fabricate.process import default_process, process_text, with_cure
from solen.fabricate.process.terms import terms_at
from solen.material.cure.law import CureLaw
from tests.command_support import answered, refusal

LAMP = [[0.3, 2.1], [0.5, 0.7], [0.2, 0.1]]
"""Shares and relative absorptions: one line goes far deeper than the others."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((2.0, 2.0, 0.5)).export("box.stl")
    law = {"lamp": "l", "Dp_um": 80.0, "u_Dp_um": 3.0, "Ec_mJ_per_cm2": 4.0, "u_Ec_mJ_per_cm2": 0.2}
    cure = {"kind": "cure", "Dp_um": 100.0, "Ec_mJ_per_cm2": 5.0, "covariance": [[9.0, 0.1], [0.1, 0.04]]}
    cure["in_lamp"] = law | {"lamp_lines": LAMP, "preferred": "spectrum"}
    Path("cure.json").write_text(json.dumps(cure), encoding="utf-8")
    Path("jacobs.json").write_text(json.dumps(cure | {"in_lamp": None}), encoding="utf-8")
    return tmp_path


def sheet(capfd: pytest.CaptureFixture[str], *options: str) -> tuple[dict[str, Any], str, list[str]]:
    """Settings of a job, their sheet, and its warnings."""
    made = answered(capfd, "print", "layers", "box.stl", "--out", "out", "--sheet-only", *options)
    read = {name: Path(made["files"][name]).read_text(encoding="utf-8") for name in ("settings", "sheet")}
    return json.loads(read["settings"]), read["sheet"], made["warnings"]


def left(depth_um: float, Dp_um: float = 80.0) -> float:
    return sum(share * float(np.exp(-absorption * depth_um / Dp_um)) for share, absorption in LAMP)


@pytest.mark.usefixtures("folder")
def test_depths_and_doses_of_a_sheet_are_those_of_the_lamp(capfd: pytest.CaptureFixture[str]) -> None:
    """Depth where the lines' sum reaches Ec; the mean dose of each layer by integrals of every later exposure."""
    found, text, _ = sheet(capfd, "--cure", "cure.json", "--irradiance-mW-per-cm2", "13")
    assert 26.0 * left(found["cure_depth_um"]) == pytest.approx(4.0, rel=1e-6)
    assert 39.0 * left(found["burn_in_cure_depth_um"]) == pytest.approx(4.0, rel=1e-6)
    exposures = [3.0] * 6 + [2.0] * 14
    assert found["layer_exposures_s"] == exposures
    assert found["layer_doses_mJ_per_cm2"] == pytest.approx([13.0 * s for s in exposures])
    for number in (0, 5, 10, 19):
        total = sum(
            13.0 * exposures[later] * quad(left, 25.0 * (later - number), 25.0 * (later - number + 1))[0] / 25.0
            for later in range(number, 20)
        )
        assert found["layer_received_mJ_per_cm2"][number] == pytest.approx(total, rel=1e-5)
    assert "by 3 lines" in text
    assert f"{found['layer_received_mJ_per_cm2'][10]:.3g}" in text


@pytest.mark.usefixtures("folder")
def test_without_a_lamp_it_is_jacobs(capfd: pytest.CaptureFixture[str]) -> None:
    found, *_ = sheet(capfd, "--cure", "jacobs.json", "--irradiance-mW-per-cm2", "13")
    assert found["cure_depth_um"] == pytest.approx(100.0 * np.log(26.0 / 5.0))
    assert sheet(capfd)[0]["layer_received_mJ_per_cm2"] is None


@pytest.mark.usefixtures("folder")
def test_a_process_states_exposures_and_options_that_differ_are_said(capfd: pytest.CaptureFixture[str]) -> None:
    process = default_process().with_settings(exposure_s=2.5, layer_um=50.0, irradiance_mW_per_cm2=11.0)
    Path("mine.toml").write_text(process_text(process), encoding="utf-8")
    found, _, warnings = sheet(capfd, "--process", "mine.toml")
    assert (found["exposure_s"], found["layer_um"], found["irradiance_mW_per_cm2"]) == (2.5, 50.0, 11.0)
    assert found["cure_depth_um"] is None  # Dp and Ec are assumed
    assert not any("process" in line for line in warnings)
    found, _, warnings = sheet(capfd, "--process", "mine.toml", "--exposure-s", "3", "--cure", "cure.json")
    assert found["exposure_s"] == 3.0
    assert found["cure_depth_um"] > 0.0
    assert any("--exposure-s 3" in line and "2.5" in line for line in warnings)


@pytest.mark.usefixtures("folder")
def test_a_process_takes_the_law_and_its_uncertainty() -> None:
    process = with_cure(default_process(), Path("cure.json"))
    assert process.process.lamp == tuple(map(tuple, LAMP))
    assert (process.uncertainty["Dp_um"], process.uncertainty["Ec_mJ_per_cm2"]) == (3.0, 0.2)
    keys, covariance = with_cure(default_process(), Path("jacobs.json")).covariance()
    assert covariance[keys.index("Dp_um"), keys.index("Ec_mJ_per_cm2")] == pytest.approx(0.1)
    law, settings = process.process.law, process.process
    terms = terms_at(settings, 20, 10 * 25.0 + 12.5)
    doses = settings.exposures(20)
    fine = CureLaw(law.Dp_um, law.Ec_mJ_per_cm2, law.lines).mean_doses(np.repeat(doses, 1), 25.0)
    assert terms.total == pytest.approx(fine[10], rel=0.03)  # in the middle of a layer, and its mean


def test_what_is_no_working_curve_is_refused(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    Path("other.json").write_text('{"kind": "index"}', encoding="utf-8")
    command = ("print", "layers", "box.stl", "--out", "out", "--cure", "other.json")
    assert "other.json" in refusal(capfd, folder, *command)
