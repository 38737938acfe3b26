"""Sentences of the report: each follows from the study, and each number in it is one of the results."""

import re
from dataclasses import replace

import numpy as np
import pytest

from solen.lens import OvalLens
from solen.report.design.background import findings, warnings
from solen.report.design.summary import advice, effect_rows, expected, lens_sentences, lens_table, measured
from solen.sensor import DesignStudy, LensChoice, LensFigures, Practice
from tests.report.conftest import DESIGNS, PRACTICAL, Studies

NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def sections(study: DesignStudy) -> dict[str, str]:
    """Return the sentences of the summary and the background, keyed by heading."""
    rows = [*expected(study), *findings(study)]
    texts = dict(rows)
    assert len(texts) == len(rows)
    return texts


def numbers(text: str) -> list[str]:
    return NUMBER.findall(text)


def check_numbers(texts: list[str], values: list[float]) -> None:
    """Check that each number in a text is the rounded value."""
    assert len(texts) == len(values), (texts, values)
    for text, value in zip(texts, values, strict=True):
        decimals = len(text.partition(".")[2])
        assert float(text) == pytest.approx(value, abs=0.5001 * 10.0**-decimals), (text, value)


@pytest.mark.parametrize("name", DESIGNS)
def test_text_of_every_design_is_complete(studied: Studies, name: str) -> None:
    study = studied(name)
    texts = sections(study)
    assert next(iter(texts)) == "contrast"
    assert list(texts)[-1] == "Not included in these results"
    cells = [
        cell
        for row in effect_rows(study.practice)[1]
        for cell in (row.name, row.by, row.null, row.light, *row.contrast)
    ]
    for text in (*texts.values(), *advice(study), *cells):
        for invalid in ("nan", "None", "inf ", "  ", "-0.000 ", "+-"):
            assert invalid not in text
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
def test_digits_follow_uncertainty(value: float | None, u: float | None, text: str) -> None:
    assert measured(value, u) == text


@pytest.mark.parametrize("name", ["paper", "mismatched", "one-sided", "dim", "acrylate", "in space"])
def test_contrast_at_both_ends(studied: Studies, name: str) -> None:
    study = studied(name)
    summary = study.to_dict()["summary"]
    lens, no_lens = summary["lens"], summary["no_lens"]
    start, u_start, from_deg, end, _, to_deg, *_ = numbers(sections(study)["contrast"])
    values = [lens[key] for key in ("contrast_from", "from_deg", "contrast_to", "to_deg")]
    check_numbers([start, from_deg, end, to_deg], values)
    check_numbers([u_start], [max(lens["u_contrast_from"], 1e-4)])
    check_numbers(numbers(sections(study)["without the lens"])[:1], [no_lens["contrast_from"]])


def test_no_lens_is_described_without_lens(studied: Studies) -> None:
    texts = sections(studied("no lens"))
    assert "without the lens" not in texts
    assert "Alignment" not in texts
    assert "Focus" not in texts
    assert "edge of the lens" not in texts["Light"]


def test_no_contrast_is_reported_without_light(studied: Studies) -> None:
    texts = sections(studied("dark"))
    assert texts["contrast"] == "no light at -3°, no light at +3°"
    assert texts["slope"] == "no light reaches the receivers"


@pytest.mark.parametrize("name", ["paper", "mismatched", "no lens", "acrylate", "dim", "in space"])
def test_slope_null_and_range(studied: Studies, name: str) -> None:
    study = studied(name)
    (summary, *_) = study.to_dict()["summary"].values()
    texts = sections(study)
    check_numbers(numbers(texts["slope"])[:1], [summary["slope_per_deg"]])
    assert texts["slope"].endswith("0° by symmetry")
    saturation_deg = summary["saturation_deg"]
    if saturation_deg is None:
        assert "stays within ±0.95" in texts["range"]
    else:
        check_numbers(numbers(texts["range"])[:1], [saturation_deg])
        assert f"within {saturation_deg:.2g}°" in advice(study)[0]


def test_no_range_is_reported_without_null(studied: Studies) -> None:
    texts = sections(studied("one-sided"))
    assert "no null" in texts["slope"]
    assert texts["range"] == "none, as there is no null"


@pytest.mark.parametrize("name", ["paper", "mismatched", "no lens", "acrylate", "dim"])
def test_light_budget_and_acceptance(studied: Studies, name: str) -> None:
    study = studied(name)
    data = study.to_dict()
    (summary, *_) = data["summary"].values()
    check_numbers(numbers(sections(study)["light"])[:1], [100 * summary["received_share"]])
    values = []
    if data["practice"] is not None:
        fractions = [data["practice"]["budget"][part] for part in ("right", "left", "beside", "reflected")]
        values += [100 * fraction for fraction in fractions if fraction >= 5e-4]
    if data["lens"]["acceptance_deg"] < 60.0:
        values += [data["lens"]["acceptance_deg"], 60.0]
    if study.with_lens is not None:
        values.append(data["lens"]["edge_incidence_deg"])
    check_numbers(numbers(sections(study).get("Light", "")), values)


@pytest.mark.parametrize("name", ["paper", "acrylate"])
def test_alignment_follows_from_magnification(studied: Studies, name: str) -> None:
    study = studied(name)
    magnification = study.to_dict()["lens"]["magnification"]
    check_numbers(
        numbers(sections(study)["Alignment"]), [magnification, 0.01, 0.01 * magnification, 0.2, 0.2 * magnification]
    )


def test_reports_decentre_of_design(studied: Studies) -> None:
    assert "decentred by 0.02 mm" in sections(studied("chip"))["Alignment"]
    assert "by symmetry" not in sections(studied("chip"))["slope"]
    assert "±" in sections(studied("chip"))["slope"].rpartition("null")[2]


def test_reports_sensor_as_built_and_as_in_paper(studied: Studies) -> None:
    built = studied("paper").to_dict()["practice"]["built"]
    (heading,) = [heading for heading in sections(studied("paper")) if heading.startswith("as built")]
    assert heading == "as built (chip 0.2 × 0.2 mm, lambertian within ±60°, in space)"
    start, _, from_deg, end, *_ = numbers(sections(studied("paper"))[heading])
    values = [built["response"]["contrast"][0], -3.0, built["response"]["contrast"][-1]]
    check_numbers([start, from_deg, end], values)
    assert "as in the paper (point source in the plane)" not in sections(studied("paper"))
    assert "as in the paper (point source in the plane)" in sections(studied("in space"))
    assert sections(studied("in space"))["Not included in these results"].startswith("Rays in space")


@pytest.mark.parametrize("name", PRACTICAL)
def test_effects_are_ranked(studied: Studies, name: str) -> None:
    study = studied(name)
    effects = study.to_dict()["practice"]["effects"]
    angles, rows = effect_rows(study.practice)
    assert len(rows) == len(effects) > 0
    assert {angle for effect in effects for angle in effect["angle_deg"]} - {0.0} <= set(angles)
    assert [effect["largest"] for effect in effects] == sorted((effect["largest"] for effect in effects), reverse=True)
    for row, effect in zip(rows, effects, strict=True):
        for angle, text in zip(angles, row.contrast, strict=True):
            if angle in effect["angle_deg"] and text != "none":
                check_numbers(numbers(text)[:1], [effect["contrast"][effect["angle_deg"].index(angle)]])
        if row.null != "–":
            check_numbers(numbers(row.null)[:1], [effect["null_deg"]])


def test_advice_is_ordered_by_effect(studied: Studies) -> None:
    sentences = advice(studied("paper"))
    saturation, supports, centring, chip, *_ = sentences
    assert "within 0.5" in saturation
    assert "supports" in supports
    assert centring.startswith("Centre the emitter")
    assert "10 µm" in centring
    assert "chip" in chip
    assert not any("join" in sentence for sentence in sentences)  # joins do not matter for a pivot at the stem's base


def test_focus_for_other_index(studied: Studies) -> None:
    study = studied("paper")
    lens = study.case.sensor.lens
    assert isinstance(lens, OvalLens)
    foci = [focus_mm(index) for index in (1.43, 1.45) for focus_mm in (lens.paraxial_focus_mm, lens.best_focus_mm)]
    low, low_best, high, high_best = (focus for focus in foci if focus is not None)
    text = sections(study)["Focus"]
    assert text.startswith("If the print's index were 0.01 lower")
    check_numbers(numbers(text), [0.01, low, low_best, 0.01, high, high_best])


def test_reports_uncertain_index(studied: Studies) -> None:
    study = studied("uncertain")
    focus = sections(study)["Focus"]
    assert focus.startswith("The index is 1.460 ± 0.020 (standard uncertainty). If the print's index were 0.02 lower")
    effect = next(each for each in study.to_dict()["practice"]["effects"] if each["key"] == "material.index")
    texts = warnings(study)
    assert texts[0] == "Index: taken from T alone."
    assert texts[1].startswith("The loss was measured at 940 nm, 80 nm from the emitter's 860 nm")
    assert (len(texts) == 3) == (effect["largest"] >= 0.05)


def test_warns_of_index_as_published(studied: Studies) -> None:
    texts = warnings(studied("as published"))
    assert "perhaps not measured" in texts[0]
    assert len(texts) == 2


def test_focus_of_mismatched_lens(studied: Studies) -> None:
    study = studied("mismatched")
    focus = study.to_dict()["foci"][1]
    text = sections(study)["Focus"]
    assert text.startswith("The lens is designed for an index of")
    check_numbers(numbers(text), [1.44, 1.49, focus["paraxial_focus_mm"], focus["marginal_focus_mm"], 20.0])


def test_limits_name_absorption_and_arms(studied: Studies) -> None:
    paper, dim, uncertain = (
        sections(studied(name))["Not included in these results"] for name in ("paper", "dim", "uncertain")
    )
    assert "no absorption is specified" in paper
    assert "assumed to continue" in paper
    assert "absorbs 0.02 per mm" in dim
    assert "absorbs 0.01 ± 0.002 per mm" in uncertain
    assert "specified angle" in dim


@pytest.mark.parametrize("name", ["paper", "from below", "no lens"])
def test_names_brighter_side(studied: Studies, name: str) -> None:
    study = studied(name)
    power = study.case.power
    side = "right" if power.contrast[0] > power.contrast[-1] else "left"
    assert side == ("left" if name == "from below" else "right")
    assert sections(study)["contrast"].endswith(f"(negative) brightens the {side} receiver")


def test_saturation_is_relative_to_null(studied: Studies) -> None:
    study = studied("half way")
    null, saturation_deg = study.case.curve.null_deg(), study.case.curve.saturation_deg()
    assert null == pytest.approx(0.0, abs=0.02)  # of a curve with additional angles near the null
    assert saturation_deg is not None
    assert f"{saturation_deg:.2f}° to each side of the null" in sections(study)["range"]


def test_narrow_cone_does_not_reach_edge(studied: Studies) -> None:
    assert "edge of the lens" not in sections(studied("narrow")).get("Light", "")


def test_different_indices_are_printed_differently(studied: Studies) -> None:
    design_index, material_index = numbers(sections(studied("almost"))["Focus"])[:2]
    assert design_index != material_index


def test_single_angle_is_not_reported_as_range(studied: Studies) -> None:
    text = sections(studied("one angle"))["contrast"]
    assert text.count("°") == 1
    assert numbers(text)[0] == "+0.9993"


def test_no_comparison_is_reported_without_comparison(studied: Studies) -> None:
    assert "without the lens" not in sections(studied("no comparison"))


def choice(at_1_deg: float, displaced: float, *, nonlinearity: float = 0.12, light: float = 0.48) -> Practice:
    """Return a comparison of a layered lens with a cylinder of contrast 0.28 at 1° and a nonlinearity of 7 %."""

    def lens(shape: str, at_1_deg: float, displaced: float, nonlinearity: float, light: float = 0.48) -> LensFigures:
        contrast = np.array([0.9, at_1_deg, 0.5 * at_1_deg])
        return LensFigures(
            shape, np.array([-3.0, -1.0, -0.5]), contrast, np.full(3, 0.004), -at_1_deg, 0.01, 0.5, 0.48, 0.002,
            nonlinearity, 0.005, -1.0, displaced, 0.004, light,
        )  # fmt: skip

    lenses = (lens("cartesian-oval", 0.28, 0.28, 0.07), lens("layered", at_1_deg, displaced, nonlinearity, light))
    return Practice(None, None, (), None, LensChoice(0.1, "cartesian-oval", lenses, {}), {})


def test_table_of_lenses() -> None:
    head, cylinder, layered = lens_table(choice(0.44, 0.42))
    assert head[:5] == ("lens", "contrast at -3°", "contrast at -1°", "contrast at -0.5°", "at -1°, 0.1 mm off in y")
    assert cylinder[0] == "cylinder (this design)"
    assert layered == (
        "layered", "+0.900 ± 0.004", "+0.440 ± 0.004", "+0.220 ± 0.004", "+0.420 ± 0.004", "-0.440 ± 0.010",
        "48.00 ± 0.20 %", "12.0 ± 0.5 %",
    )  # fmt: skip
    assert lens_table(None) == []
    assert lens_sentences(None) == []


@pytest.mark.parametrize(
    ("practice", "is_worthwhile", "values", "linearity"),
    [
        (choice(0.44, 0.42), True, ("1.50 ± 0.04 times", "0.42 instead of 0.28"), ("use the cylinder", "7 %")),
        (choice(0.44, 0.29), False, ("1.036 ± 0.029 times",), ("use the cylinder", "7 %")),
        (choice(0.44, 0.44, light=0.3), False, ("0.982",), ("use the cylinder", "7 %")),
        (choice(0.44, 0.42, nonlinearity=0.03), True, (), ("use the layered lens", "3 %")),
        (choice(0.44, 0.42, nonlinearity=0.075), True, (), ("Neither",)),
    ],
)
def test_advice_on_layered_lens(
    practice: Practice, is_worthwhile: bool, values: tuple[str, ...], linearity: tuple[str, ...]
) -> None:
    gain, *requirements, straightness = lens_sentences(practice)
    assert ("is worthwhile" in gain) is is_worthwhile
    assert all(value in gain for value in values)
    assert all(text in straightness for text in linearity)
    assert len(requirements) == is_worthwhile
    assert all("centred within about 0.1 mm in y. None has been printed yet" in text for text in requirements)


def test_names_given_profiles() -> None:
    practice = choice(0.44, 0.42)
    assert practice.lenses is not None
    cylinder, layered = practice.lenses.lenses
    lenses = replace(practice.lenses, own="layered", lenses=(cylinder, replace(layered, given=True)))
    printed = replace(practice, lenses=lenses)
    assert [row[0] for row in lens_table(printed)[1:]] == ["cylinder", "layered as given (this design)"]
    gain, requirement, _ = lens_sentences(printed)
    assert gain.startswith("The layered lens as given is worthwhile")
    assert gain.endswith("to the less favourable side; the cylinder is as designed.")
    assert "None has been printed" not in requirement
