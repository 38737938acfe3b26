"""Results as files: strict JSON with null for missing values, and a CSV table with a row for each angle."""

import csv
import io
import json
from typing import Any

import pytest

from solen.report.design.table import csv_table
from solen.sensor import DesignStudy
from solen.spec import Design
from tests.report.conftest import Studies

NAMES = [
    *("paper", "mismatched", "no lens", "one-sided", "dark", "one angle", "acrylate", "odd name", "no comparison"),
    *("as published", "uncertain"),
]


def strict(text: str) -> Any:
    """Parse JSON without NaN and Infinity."""

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


def table(study: DesignStudy) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(csv_table(study))))


@pytest.mark.parametrize("name", NAMES)
def test_results_are_strict_json(studied: Studies, name: str) -> None:
    data = studied(name).to_dict()
    assert strict(json.dumps(data, allow_nan=False)) == data


def test_missing_values_are_null(studied: Studies) -> None:
    dark = studied("dark").to_dict()
    assert dark["summary"]["lens"]["contrast_from"] is None
    assert dark["summary"]["lens"]["null_deg"] is None
    assert dark["response"]["lens"]["power"]["contrast"] == [None, None, None]
    assert None not in dark["response"]["lens"]["power"]["u_power"]
    assert dark["response"]["lens"]["count"]["u_power"] == [None, None, None]
    one_sided = studied("one-sided").to_dict()["summary"]["lens"]
    assert (one_sided["null_deg"], one_sided["slope_per_deg"], one_sided["saturation_deg"]) == (None, None, None)
    assert studied("paper").to_dict()["material"]["u_index"] is None


def test_design_without_lens_has_single_case(studied: Studies) -> None:
    data = studied("no lens").to_dict()
    assert list(data["summary"]) == list(data["response"]) == ["no_lens"]
    assert data["lens"]["shape"] == "none"
    assert list(studied("paper").to_dict()["summary"]) == ["lens", "no_lens"]


def test_states_why_comparison_is_missing(studied: Studies) -> None:
    study = studied("no comparison")
    data = study.to_dict()
    assert list(data["summary"]) == list(data["response"]) == ["lens"]
    assert data["no_lens_refused"] == study.no_lens_refused
    assert "inside the body" in data["no_lens_refused"]
    for name in ("paper", "no lens"):
        assert studied(name).to_dict()["no_lens_refused"] is None


def test_results_contain_design_and_material(studied: Studies) -> None:
    data = studied("acrylate").to_dict()
    assert data["simulated"] is True
    assert data["schema"] == 1
    assert data["design"]["material"]["resin"] == "pmma"
    assert data["material"]["index"] == pytest.approx(1.483, abs=2e-3)
    assert data["lens"]["design_index"] == data["foci"][1]["material_index"] == data["material"]["index"]
    assert "PMMA" in data["material"]["source"]


@pytest.mark.parametrize("name", NAMES)
def test_design_round_trip(studied: Studies, name: str) -> None:
    design = studied(name).design
    assert Design(**studied(name).to_dict()["design"]).in_folder(design.folder) == design


def test_resin_determines_loss_after_round_trip(studied: Studies) -> None:
    design = studied("acrylate").design
    assert not design.material.sets_absorption
    assert not Design(**studied("acrylate").to_dict()["design"]).material.sets_absorption


@pytest.mark.parametrize("name", NAMES)
def test_ledgers_are_closed(studied: Studies, name: str) -> None:
    study = studied(name)
    for case in study.to_dict()["response"].values():
        for response in (case["count"], case["power"]):
            assert response["angle_deg"] == list(study.design.motion.angles_deg())
            for right, left, ledger in zip(response["right"], response["left"], response["ledger"], strict=True):
                assert sum(ledger.values()) == pytest.approx(1.0, abs=1e-12)
                assert right + left == pytest.approx(ledger["detected"], abs=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_summary_is_computed_from_power(studied: Studies, name: str) -> None:
    study = studied(name)
    data = study.to_dict()
    for case, summary in data["summary"].items():
        power = data["response"][case]["power"]
        assert summary["from_deg"] == power["angle_deg"][0]
        assert summary["to_deg"] == power["angle_deg"][-1]
        assert (summary["contrast_from"], summary["contrast_to"]) == (power["contrast"][0], power["contrast"][-1])
        received = [right + left for right, left in zip(power["right"], power["left"], strict=True)]
        assert summary["received_share"] == pytest.approx(sum(received) / len(received))
        assert summary["u_power"] == max(power["u_power"])
        assert summary["ledger_error"] < 1e-12
        assert (summary["null_deg"], summary["slope_per_deg"]) == (
            study.cases[case].null_deg,
            study.cases[case].slope_per_deg,
        )
        assert summary["saturation_deg"] == study.cases[case].curve.saturation_deg()
        assert summary["rays_traced"] == sum(power["rays"]) + sum(data["response"][case]["count"]["rays"])


def test_summary_contains_values_of_paper(studied: Studies) -> None:
    summary = studied("paper").case.summary
    assert summary.contrast_from == pytest.approx(0.999, abs=2e-3)
    assert summary.received_share == pytest.approx(0.521, abs=2e-3)
    assert summary.null_deg == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_table_has_row_for_each_angle(studied: Studies, name: str) -> None:
    study = studied(name)
    rows = table(study)
    cases = list(study.cases)
    kinds = {"count": ("right", "left", "contrast"), "power": ("right", "left", "contrast", "u_power")}
    columns = [f"{case}_{kind}_{name}" for case in cases for kind, names in kinds.items() for name in names]
    assert list(rows[0]) == ["angle_deg", *columns]
    assert [float(row["angle_deg"]) for row in rows] == list(study.design.motion.angles_deg())


@pytest.mark.parametrize("name", NAMES)
def test_the_table_holds_the_numbers_of_the_json_to_the_last_digit(studied: Studies, name: str) -> None:
    study = studied(name)
    for case, kinds in study.to_dict()["response"].items():
        for kind in ("count", "power"):
            one = kinds[kind]
            for what in ("right", "left", "contrast"):
                column = [row[f"{case}_{kind}_{what}"] for row in table(study)]
                assert [None if text == "" else float(text) for text in column] == one[what]


def test_a_contrast_without_light_is_an_empty_cell(studied: Studies) -> None:
    assert [row["lens_power_contrast"] for row in table(studied("dark"))] == ["", "", ""]


def test_the_focus_is_reported_for_the_index_and_its_uncertainty(studied: Studies) -> None:
    foci = studied("uncertain").to_dict()["foci"]
    assert [one["material_index"] for one in foci] == pytest.approx([1.44, 1.46, 1.48])
    assert [one["by_uncertainty"] for one in foci] == [True, False, True]
    for key in ("paraxial_focus_mm", "best_focus_mm", "marginal_focus_mm"):
        focus = [one[key] for one in foci]
        assert focus[1] == pytest.approx(20.0, abs=1e-6)
        assert focus[0] > focus[1] > focus[2]
    assert [one["step"] for one in studied("paper").to_dict()["foci"]] == [-0.01, 0.0, 0.01]


def test_rays_in_space_are_not_counted(studied: Studies) -> None:
    summary = studied("in space").to_dict()["response"]["lens"]
    assert summary["count"] is None
    assert all(0.0 < u < 2e-4 for u in summary["power"]["u_power"])
    assert not any("count" in column for column in table(studied("in space"))[0])


def test_what_is_symmetric_is_printed_so(studied: Studies) -> None:
    rows = table(studied("in space"))
    for row, mirrored in zip(rows, rows[::-1], strict=True):
        assert row["lens_power_right"] == mirrored["lens_power_left"]
    assert [float(row["lens_power_contrast"]) for row in rows][1] == 0.0


def test_what_must_be_known_of_a_material_stands_with_its_numbers(studied: Studies) -> None:
    material = studied("as published").to_dict()["material"]
    assert material["mode"] == "as-published"
    assert all("as published" in text for text in material["warnings"])
    uncertain = studied("uncertain").to_dict()["material"]
    assert (uncertain["u_index"], uncertain["u_absorption_per_mm"]) == (0.02, 0.002)
    paper = studied("paper").to_dict()["material"]
    assert (paper["mode"], paper["u_absorption_per_mm"], paper["warnings"]) == (None, None, [])
