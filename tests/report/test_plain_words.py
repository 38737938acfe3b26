"""The report's sentences: each follows from the study, and each of its numbers is one of the results."""

import re

import pytest

from solen.lens import OvalLens
from solen.report.design.words import findings, headline, warnings
from solen.sensor import DesignStudy
from tests.report.conftest import DESIGNS, Studies

NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def said(study: DesignStudy) -> dict[str, str]:
    told = findings(study)
    words = dict(told)
    assert len(words) == len(told)
    return words


def numbers(text: str) -> list[str]:
    return NUMBER.findall(text)


def agree(texts: list[str], values: list[float]) -> None:
    """Every number of the text is the value there, rounded as it is written."""
    assert len(texts) == len(values), (texts, values)
    for text, value in zip(texts, values, strict=True):
        places = len(text.partition(".")[2])
        assert float(text) == pytest.approx(value, abs=0.5001 * 10.0**-places), (text, value)


@pytest.mark.parametrize("name", DESIGNS)
def test_every_design_is_told_in_whole_sentences(studied: Studies, name: str) -> None:
    words = said(studied(name))
    assert next(iter(words)) == "The signal"
    assert list(words)[-1] == "Not in these numbers"
    for text in words.values():
        assert text[0].isupper()
        assert text.endswith(".")
        for wrong in ("nan", "None", "inf ", "  ", "-0.000", "+-"):
            assert wrong not in text


@pytest.mark.parametrize("name", ["paper", "mismatched", "one-sided", "dim", "acrylate"])
def test_the_signal_is_the_contrast_at_both_ends_with_lens_and_without(studied: Studies, name: str) -> None:
    study = studied(name)
    found = study.to_dict()["summary"]
    lens, flat = found["lens"], found["no_lens"]
    agree(
        numbers(said(study)["The signal"]),
        [
            *(lens["contrast_from"], lens["from_deg"], lens["contrast_to"], lens["to_deg"]),
            *(flat["contrast_from"], flat["contrast_to"]),
        ],
    )
    assert headline(study) in said(study)["The signal"]


def test_without_a_lens_no_lens_is_compared_nor_described(studied: Studies) -> None:
    words = said(studied("no lens"))
    assert "no lens" in words["The signal"]
    assert "Without the lens" not in words["The signal"]
    assert "magnifies" not in words["Alignment"]
    assert "focal" not in words["Index"]
    assert "as it is cut" not in words["Index"]
    assert "lens's edge" not in words["Light"]


def test_without_light_no_contrast_is_told(studied: Studies) -> None:
    text = said(studied("dark"))["The signal"]
    assert text.count("no light") == 4
    assert numbers(text) == ["-3", "+3"]


@pytest.mark.parametrize("name", ["paper", "mismatched", "no lens", "acrylate", "dim"])
def test_the_range_is_null_slope_and_saturation(studied: Studies, name: str) -> None:
    study = studied(name)
    (found, *_) = study.to_dict()["summary"].values()
    expected = [found["null_deg"], abs(found["slope_per_deg"])]
    text = said(study)["Range"]
    if found["saturation_deg"] is None:
        assert text.endswith(". It stays below 0.95 in this range.")
        expected.append(0.95)
    else:
        assert "hardly its amplitude" in text
        expected += [found["saturation_deg"], 0.95]
    got = numbers(text)
    assert found["slope_per_deg"] == study.case.slope_per_deg
    assert float(got[1]) == pytest.approx(expected[1], rel=0.06)
    agree(got[:1] + got[2:], expected[:1] + expected[2:])


def test_without_a_balance_no_range_is_told(studied: Studies) -> None:
    text = said(studied("one-sided"))["Range"]
    assert "no null" in text
    assert numbers(text) == []


@pytest.mark.parametrize("name", ["paper", "mismatched", "no lens", "acrylate", "dim"])
def test_the_light_is_what_is_received_and_what_the_face_accepts(studied: Studies, name: str) -> None:
    study = studied(name)
    data = study.to_dict()
    (found, *_) = data["summary"].values()
    expected = [100 * found["received_share"]]
    assert data["practice"] is None or data["practice"]["budget"] is not None
    if data["practice"] is not None:
        shares = [data["practice"]["budget"][part] for part in ("right", "left", "beside", "reflected")]
        expected += [100 * share for share in shares if share >= 5e-4]
    if data["lens"]["acceptance_deg"] < 60.0:
        expected += [data["lens"]["acceptance_deg"], 60.0]
    if study.with_lens is not None:
        expected.append(data["lens"]["edge_incidence_deg"])
    agree(numbers(said(study)["Light"]), expected)


@pytest.mark.parametrize("name", ["paper", "acrylate"])
def test_the_alignment_is_told_by_the_magnification(studied: Studies, name: str) -> None:
    study = studied(name)
    magnification = study.to_dict()["lens"]["magnification"]
    text = said(study)["Alignment"].split(" With ")[0]
    agree(numbers(text), [magnification, 0.01, 0.01 * magnification, 0.2, 0.2 * magnification])


def test_the_shift_of_the_balance_point_is_told_of_the_chip(studied: Studies) -> None:
    for name in ("paper", "chip", "in space", "no lens"):
        shift = studied(name).to_dict()["practice"]["null_shift"]
        _, _, text = said(studied(name))["Alignment"].rpartition("the null moves by ")
        assert float(text.split("°")[0]) == pytest.approx(shift["shift_deg"], abs=5.1e-4)
        assert "for each" not in text
    assert "0.02 mm off its place" in said(studied("chip"))["Alignment"]
    assert said(studied("chip"))["Alignment"].count("the chip 0.3 mm wide") == 2
    assert "null" not in said(studied("one-sided"))["Alignment"]


def test_a_real_chip_is_told_beside_the_point(studied: Studies) -> None:
    practice = studied("paper").to_dict()["practice"]
    text = said(studied("paper"))["A real chip"]
    assert "for comparison" in text
    chip, point = practice["chip"]["contrast"], practice["point"]["contrast"]
    assert practice["chip"]["angle_deg"] == [-3.0, -1.0, 0.0, 1.0, 3.0]
    told = numbers(text)
    agree(told[:5] + told[-3:], [0.2, chip[0], -3.0, point[0], chip[1], chip[-1], 3.0, point[-1]])
    own = said(studied("chip"))["A real chip"]
    assert own.startswith("The chip is 0.3 mm wide")
    assert "for comparison" not in own


def test_the_plane_is_told_beside_space(studied: Studies) -> None:
    found = studied("paper").to_dict()["practice"]["in_space"]
    text = said(studied("paper"))["In space"]
    assert "in place of the design's fan" in text
    told = numbers(text.split("a contrast of ")[1])
    space = found["space"]["contrast"]
    agree(told[:2] + told[3:5], [found["plane"]["contrast"][0], space[0], found["plane"]["contrast"][-1], space[-1]])
    assert "focuses shorter" in text
    assert "fan" not in said(studied("in space"))["In space"]
    assert said(studied("in space"))["Not in these numbers"].startswith("Rays in space")


def test_what_is_not_known_of_the_neighbours_is_not_told(studied: Studies) -> None:
    dark, plain = said(studied("dark")), said(studied("acrylate"))
    assert {"A real chip", "In space"}.isdisjoint(dark)
    assert {"A real chip", "In space"}.isdisjoint(plain)
    assert "null" not in dark["Alignment"]
    assert "the contrast is" not in dark["Index"]
    assert "reaches the right receiver" not in dark["Light"]
    assert "whatever the thickness" in plain["Not in these numbers"]


def test_a_matched_lens_is_told_what_another_index_would_do(studied: Studies) -> None:
    study = studied("paper")
    lens = study.case.sensor.lens
    assert isinstance(lens, OvalLens)
    foci = [at(index) for index in (1.43, 1.45) for at in (lens.paraxial_focus_mm, lens.best_focus_mm)]
    low, low_best, high, high_best = (focus for focus in foci if focus is not None)
    text = said(study)["Index"]
    assert text.startswith("If the print's index were 0.01 lower")
    focus, _, response = text.partition(" With ")
    agree(numbers(focus), [0.01, low, low_best, 0.01, high, high_best])
    off = study.to_dict()["practice"]["index"]
    assert [one["index"] for one in off] == pytest.approx([1.43, 1.45])
    ends = [off[0]["response"]["contrast"][0], 1.43, study.to_dict()["practice"]["chip"]["contrast"][0], 1.44]
    agree(numbers(response.partition("contrast is ")[2])[:6], [*ends, off[1]["response"]["contrast"][0], 1.45])


def test_how_far_the_response_moves_is_told_beside_the_chip(studied: Studies) -> None:
    practice = studied("paper").to_dict()["practice"]
    index, chip = practice["index_shift"], practice["chip_shift"]
    text = said(studied("paper"))["Index"].partition("Over the motion")[2]
    agree(numbers(text), [index["contrast"], index["angle_deg"], 0.2, chip["contrast"], chip["angle_deg"]])
    assert warnings(studied("paper")) == []


def test_an_uncertain_index_is_told_with_its_uncertainty_and_warned_of(studied: Studies) -> None:
    study = studied("uncertain")
    material = study.to_dict()["material"]
    assert (material["u_index"], material["mode"]) == (pytest.approx(0.02), "lossless")
    text = said(study)["Index"]
    assert text.startswith(
        f"The index is {material['index']:.6g} ± 0.02 (standard). If the print's index were 0.02 lower"
    )
    index = study.to_dict()["practice"]["index_shift"]
    assert f"moves by at most {index['contrast']:.3f}" in text
    told = warnings(study)
    assert told[0] == "Index: taken from T alone."
    assert told[1].startswith("Loss: measured at 940 nm, 80 nm from the emitter's 860 nm;")
    assert f"moves by up to {index['contrast']:.2g} in contrast" in told[2]
    assert len(told) == 3


def test_an_index_as_published_is_warned_of(studied: Studies) -> None:
    told = warnings(studied("as published"))
    assert "consistent with an absorbance read as an absorptance" in told[0]
    assert len(told) == 2


def test_a_mismatched_lens_is_told_where_its_rays_go(studied: Studies) -> None:
    study = studied("mismatched")
    lens = study.to_dict()["foci"][1]
    text = said(study)["Index"]
    assert text.startswith("The lens is cut for")
    focus, _, _ = text.partition(" With ")
    agree(numbers(focus), [1.44, 1.49, lens["paraxial_focus_mm"], lens["marginal_focus_mm"], 20.0])


def test_the_limits_name_the_absorption_and_the_assumed_arms(studied: Studies) -> None:
    paper, dim = said(studied("paper")), said(studied("dim"))
    last = "Not in these numbers"
    assert "no absorption was given" in paper[last]
    assert "assumed to continue" in paper[last]
    assert "absorbs 0.02 per mm" in dim[last]
    assert "absorbs 0.01 ± 0.002 per mm" in said(studied("uncertain"))[last]
    assert "as given" in dim[last]


@pytest.mark.parametrize("name", ["paper", "from below", "no lens"])
def test_the_side_that_brightens_is_the_one_that_does(studied: Studies, name: str) -> None:
    study = studied(name)
    power = study.case.power
    side = "right" if power.contrast[0] > power.contrast[-1] else "left"
    assert side == ("left" if name == "from below" else "right")
    assert said(study)["The signal"].endswith(f"(a negative angle) brightens the {side} receiver.")


def test_saturation_off_the_middle_is_told_from_the_balance_point(studied: Studies) -> None:
    study = studied("half way")
    null, reach = study.case.power.null_deg(), study.case.power.saturation_deg()
    assert null == pytest.approx(-1.0, abs=0.01)
    assert reach is not None
    assert 1.85 < reach < 2.01
    assert f"About {reach:.2f}° away it first exceeds 0.95" in said(study)["Range"]


def test_a_narrow_cone_is_not_said_to_reach_the_edge(studied: Studies) -> None:
    assert "lens's edge" not in said(studied("narrow"))["Light"]


def test_two_indices_said_to_differ_are_printed_differently(studied: Studies) -> None:
    one, other = numbers(said(studied("almost"))["Index"])[:2]
    assert one != other


def test_darkness_is_not_told_as_a_missing_balance(studied: Studies) -> None:
    assert said(studied("dark"))["Range"] == "No light reaches the receivers at any angle."


def test_one_angle_is_not_told_as_a_range(studied: Studies) -> None:
    text = headline(studied("one angle"))
    assert " to " not in text
    assert numbers(text) == ["+0.999", "-3"]


def test_without_a_comparison_none_is_told(studied: Studies) -> None:
    text = said(studied("no comparison"))["The signal"]
    assert "Without the lens" not in text
    assert "no lens" not in text
