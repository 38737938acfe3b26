"""The report's answer and sentences: each follows from the study, and each of its numbers is one of the results."""

import re
from dataclasses import replace

import numpy as np
import pytest

from solen.lens import OvalLens
from solen.report.design.background import findings, warnings
from solen.report.design.summary import advice, expected, lens_table, lens_words, matters, measured
from solen.sensor import DesignStudy, LensChoice, LensFigures, Practice
from tests.report.conftest import DESIGNS, PRACTICAL, Studies

NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def said(study: DesignStudy) -> dict[str, str]:
    """The answer, and what stands behind it."""
    told = [*expected(study), *findings(study)]
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
def test_every_design_is_reported_without_what_no_reader_wants(studied: Studies, name: str) -> None:
    study = studied(name)
    words = said(study)
    assert next(iter(words)) == "contrast"
    assert list(words)[-1] == "Not included in these results"
    cells = [
        cell for row in matters(study.practice)[1] for cell in (row.name, row.by, row.null, row.light, *row.contrast)
    ]
    for text in (*words.values(), *advice(study), *cells):
        for wrong in ("nan", "None", "inf ", "  ", "-0.000 ", "+-"):
            assert wrong not in text
    for text in dict(findings(study)).values():
        assert text[0].isupper()
        assert text.endswith(".")


@pytest.mark.parametrize(
    ("value", "u", "text"),
    [
        (0.649762, 0.00034, "+0.6498 ± 0.0003"),
        (-0.649762, 0.00014, "-0.6498 ± 0.0001"),
        (-0.649762, 0.0012, "-0.6498 ± 0.0012"),
        (-0.2457, 0.0066, "-0.246 ± 0.007"),
        (12.3, 1.6, "+12.3 ± 1.6"),
        (123.4, 41.0, "+123 ± 41"),
        (0.99933897, 3e-7, "+0.9993 ± < 0.0001"),
        (-0.0001, 0.0013, "-0.0001 ± 0.0013"),
        (-0.00001, 0.0013, "0.0000 ± 0.0013"),
        (0.25, 0.0, "+0.25"),
        (0.0, None, "0"),
        (float("nan"), 0.1, "none"),
        (None, None, "none"),
    ],
)
def test_digits_follow_the_uncertainty(value: float | None, u: float | None, text: str) -> None:
    assert measured(value, u) == text


@pytest.mark.parametrize("name", ["paper", "mismatched", "one-sided", "dim", "acrylate", "in space"])
def test_the_contrast_is_that_at_both_ends_with_its_uncertainty(studied: Studies, name: str) -> None:
    study = studied(name)
    found = study.to_dict()["summary"]["lens"]
    told = numbers(said(study)["contrast"])
    agree(
        told[:1] + told[2:4] + told[5:6], [found[key] for key in ("contrast_from", "from_deg", "contrast_to", "to_deg")]
    )
    agree(told[1:2], [max(found["u_contrast_from"], 1e-4)])
    flat = study.to_dict()["summary"]["no_lens"]
    agree(numbers(said(study)["without the lens"])[:1], [flat["contrast_from"]])


def test_without_a_lens_no_lens_is_compared_nor_described(studied: Studies) -> None:
    words = said(studied("no lens"))
    assert "without the lens" not in words
    assert "Alignment" not in words
    assert "Focus" not in words
    assert "lens's edge" not in words["Light"]


def test_without_light_no_contrast_is_reported(studied: Studies) -> None:
    words = said(studied("dark"))
    assert words["contrast"] == "no light at -3°, no light at +3°"
    assert words["slope"] == "no light reaches the receivers"


@pytest.mark.parametrize("name", ["paper", "mismatched", "no lens", "acrylate", "dim", "in space"])
def test_slope_null_and_range_are_those_of_the_results(studied: Studies, name: str) -> None:
    study = studied(name)
    (found, *_) = study.to_dict()["summary"].values()
    words = said(study)
    told = numbers(words["slope"])
    agree(told[:1], [found["slope_per_deg"]])
    assert words["slope"].endswith("0° by symmetry")
    reach = found["saturation_deg"]
    if reach is None:
        assert "stays within ±0.95" in words["range"]
    else:
        agree(numbers(words["range"])[:1], [reach])
        assert f"within {reach:.2g}°" in advice(study)[0]


def test_without_a_null_no_range_is_reported(studied: Studies) -> None:
    words = said(studied("one-sided"))
    assert "no null" in words["slope"]
    assert words["range"] == "none, as there is no null"


@pytest.mark.parametrize("name", ["paper", "mismatched", "no lens", "acrylate", "dim"])
def test_the_light_is_what_is_received_and_what_the_face_accepts(studied: Studies, name: str) -> None:
    study = studied(name)
    data = study.to_dict()
    (found, *_) = data["summary"].values()
    agree(numbers(said(study)["light"])[:1], [100 * found["received_share"]])
    wanted = []
    if data["practice"] is not None:
        shares = [data["practice"]["budget"][part] for part in ("right", "left", "beside", "reflected")]
        wanted += [100 * share for share in shares if share >= 5e-4]
    if data["lens"]["acceptance_deg"] < 60.0:
        wanted += [data["lens"]["acceptance_deg"], 60.0]
    if study.with_lens is not None:
        wanted.append(data["lens"]["edge_incidence_deg"])
    agree(numbers(said(study).get("Light", "")), wanted)


@pytest.mark.parametrize("name", ["paper", "acrylate"])
def test_the_alignment_is_reported_by_the_magnification(studied: Studies, name: str) -> None:
    study = studied(name)
    magnification = study.to_dict()["lens"]["magnification"]
    agree(numbers(said(study)["Alignment"]), [magnification, 0.01, 0.01 * magnification, 0.2, 0.2 * magnification])


def test_a_decentre_of_the_design_is_reported(studied: Studies) -> None:
    assert "decentred by 0.02 mm" in said(studied("chip"))["Alignment"]
    assert "by symmetry" not in said(studied("chip"))["slope"]
    assert "±" in said(studied("chip"))["slope"].rpartition("null")[2]


def test_the_sensor_as_built_stands_beside_a_point_in_the_plane(studied: Studies) -> None:
    built = studied("paper").to_dict()["practice"]["built"]
    (heading,) = [heading for heading in said(studied("paper")) if heading.startswith("as built")]
    assert heading == "as built (chip 0.2 × 0.2 mm, lambertian within ±60°, in space)"
    told = numbers(said(studied("paper"))[heading])
    agree(told[:1] + told[2:4], [built["response"]["contrast"][0], -3.0, built["response"]["contrast"][-1]])
    assert "as in the paper (point, plane)" not in said(studied("paper"))
    assert "as in the paper (point, plane)" in said(studied("in space"))
    assert said(studied("in space"))["Not included in these results"].startswith("Rays in space")


@pytest.mark.parametrize("name", PRACTICAL)
def test_what_matters_is_ranked_and_each_number_is_one_of_the_results(studied: Studies, name: str) -> None:
    study = studied(name)
    effects = study.to_dict()["practice"]["effects"]
    angles, rows = matters(study.practice)
    assert len(rows) == len(effects) > 0
    assert {angle for one in effects for angle in one["angle_deg"]} - {0.0} <= set(angles)
    assert [one["largest"] for one in effects] == sorted((one["largest"] for one in effects), reverse=True)
    for row, one in zip(rows, effects, strict=True):
        for angle, text in zip(angles, row.contrast, strict=True):
            if angle in one["angle_deg"] and text != "none":
                agree(numbers(text)[:1], [one["contrast"][one["angle_deg"].index(angle)]])
        if row.null != "–":
            agree(numbers(row.null)[:1], [one["null_deg"]])


def test_the_advice_begins_with_what_matters_most(studied: Studies) -> None:
    held, first, second, *_ = [one for one in advice(studied("paper")) if not one.startswith("Use it within")]
    assert held.startswith("State how the body is held")
    assert first.startswith("Centre the emitter")
    assert "10 µm" in first
    assert "chip" in second
    assert advice(studied("paper"))[0].startswith("Use it within 0.5")
    assert not any("join" in one for one in advice(studied("paper")))  # about the stem's base it does not matter


def test_a_matched_lens_is_reported_where_another_index_would_focus(studied: Studies) -> None:
    study = studied("paper")
    lens = study.case.sensor.lens
    assert isinstance(lens, OvalLens)
    foci = [at(index) for index in (1.43, 1.45) for at in (lens.paraxial_focus_mm, lens.best_focus_mm)]
    low, low_best, high, high_best = (focus for focus in foci if focus is not None)
    text = said(study)["Focus"]
    assert text.startswith("If the print's index were 0.01 lower")
    agree(numbers(text), [0.01, low, low_best, 0.01, high, high_best])


def test_an_uncertain_index_is_reported_with_its_uncertainty_and_warned_of(studied: Studies) -> None:
    study = studied("uncertain")
    assert said(study)["Focus"].startswith(
        "The index is 1.460 ± 0.020 (standard). If the print's index were 0.02 lower"
    )
    index = next(one for one in study.to_dict()["practice"]["effects"] if one["key"] == "material.index")
    told = warnings(study)
    assert told[0] == "Index: taken from T alone."
    assert told[1].startswith("The loss was measured at 940 nm, 80 nm from the emitter's 860 nm")
    assert (len(told) == 3) == (index["largest"] >= 0.05)


def test_an_index_as_published_is_warned_of(studied: Studies) -> None:
    told = warnings(studied("as published"))
    assert "perhaps not measured" in told[0]
    assert len(told) == 2


def test_a_mismatched_lens_is_reported_where_its_rays_go(studied: Studies) -> None:
    study = studied("mismatched")
    lens = study.to_dict()["foci"][1]
    text = said(study)["Focus"]
    assert text.startswith("The lens is cut for")
    agree(numbers(text), [1.44, 1.49, lens["paraxial_focus_mm"], lens["marginal_focus_mm"], 20.0])


def test_the_limits_name_the_absorption_and_the_assumed_arms(studied: Studies) -> None:
    paper, dim = said(studied("paper")), said(studied("dim"))
    last = "Not included in these results"
    assert "no absorption is stated" in paper[last]
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
    assert said(study)["contrast"].endswith(f"(negative) brightens the {side} receiver")


def test_saturation_off_the_middle_is_reported_from_the_null(studied: Studies) -> None:
    study = studied("half way")
    null, reach = study.case.curve.null_deg(), study.case.curve.saturation_deg()
    assert null == pytest.approx(0.0, abs=0.02)  # of a curve with angles added where it bends
    assert reach is not None
    assert f"{reach:.2f}° to each side of the null" in said(study)["range"]


def test_a_narrow_cone_is_not_said_to_reach_the_edge(studied: Studies) -> None:
    assert "lens's edge" not in said(studied("narrow")).get("Light", "")


def test_two_indices_said_to_differ_are_printed_differently(studied: Studies) -> None:
    one, other = numbers(said(studied("almost"))["Focus"])[:2]
    assert one != other


def test_one_angle_is_not_reported_as_a_range(studied: Studies) -> None:
    text = said(studied("one angle"))["contrast"]
    assert text.count("°") == 1
    assert numbers(text)[0] == "+0.9993"


def test_without_a_comparison_none_is_reported(studied: Studies) -> None:
    assert "without the lens" not in said(studied("no comparison"))


def choice(layered: float, off: float, *, nonlinearity: float = 0.12, light: float = 0.48) -> Practice:
    """A cylinder of 0.28 at 1° and 7 % off a line beside a layered lens."""

    def lens(shape: str, there: float, off: float, nonlinearity: float, light: float = 0.48) -> LensFigures:
        contrast = np.array([0.9, there, 0.5 * there])
        return LensFigures(
            shape, np.array([-3.0, -1.0, -0.5]), contrast, np.full(3, 0.004), -there, 0.01, 0.5, 0.48, 0.002,
            nonlinearity, 0.005, -1.0, off, 0.004, light,
        )  # fmt: skip

    both = (lens("cartesian-oval", 0.28, 0.28, 0.07), lens("layered", layered, off, nonlinearity, light))
    return Practice(None, None, (), None, LensChoice(0.1, "cartesian-oval", both, {}), {})


def test_the_table_of_lenses_holds_what_was_found() -> None:
    head, cylinder, layered = lens_table(choice(0.44, 0.42))
    assert head[:5] == ("lens", "contrast at -3°", "contrast at -1°", "contrast at -0.5°", "at -1°, 0.1 mm off in y")
    assert cylinder[0] == "cylinder (this design)"
    assert layered == (
        "layered", "+0.900 ± 0.004", "+0.440 ± 0.004", "+0.220 ± 0.004", "+0.420 ± 0.004", "-0.440 ± 0.010",
        "48.00 ± 0.20 %", "12.0 ± 0.5 %",
    )  # fmt: skip
    assert lens_table(None) == []
    assert lens_words(None) == []


@pytest.mark.parametrize(
    ("practice", "pays", "straight"),
    [
        (
            choice(0.44, 0.42),
            "is worthwhile for small angles: signal 1.50 ± 0.04 times the cylinder's",
            "use the cylinder: deviation from a straight line 7 %",
        ),
        (choice(0.44, 0.42), "(contrast 0.42 instead of 0.28)", "use the cylinder: deviation from a straight line 7 %"),
        (
            choice(0.44, 0.29),
            "is not worthwhile here: signal 1.036 ± 0.029 times the cylinder's",
            "use the cylinder: deviation from a straight line 7 %",
        ),
        (
            choice(0.44, 0.44, light=0.3),
            "is not worthwhile here: signal 0.982",
            "use the cylinder: deviation from a straight line 7 %",
        ),
        (
            choice(0.44, 0.42, nonlinearity=0.03),
            "is worthwhile",
            "use the layered lens: deviation from a straight line 3 %",
        ),
        (choice(0.44, 0.42, nonlinearity=0.075), "is worthwhile", "Neither"),
    ],
)
def test_when_layers_pay_is_reported_plainly(practice: Practice, pays: str, straight: str) -> None:
    one, *asked, other = lens_words(practice)
    assert pays in one
    assert straight in other
    assert len(asked) == ("is not" not in one)
    assert all("centred within about 0.1 mm in y. None has been printed yet" in text for text in asked)


def test_profiles_that_are_given_are_named() -> None:
    """A print is beside a cylinder that is none."""
    one = choice(0.44, 0.42)
    assert one.lenses is not None
    cylinder, layered = one.lenses.lenses
    printed = replace(one, lenses=replace(one.lenses, own="layered", lenses=(cylinder, replace(layered, given=True))))
    assert [row[0] for row in lens_table(printed)[1:]] == ["cylinder", "layered as given (this design)"]
    gain, asked, _ = lens_words(printed)
    assert gain.startswith("The layered lens as given is worthwhile")
    assert gain.endswith("to the less favourable side; the cylinder is as designed.")
    assert "Nobody" not in asked
