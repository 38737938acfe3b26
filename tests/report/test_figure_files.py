"""Figures: the same bytes for the same numbers, in each kind of file, showing what they say."""

from xml.etree import ElementTree as ET

import pytest

from solen.lens import OvalLens
from solen.report.canvas import encoded, svg
from solen.report.design.figures import rays_figure, sensor_view, study_figure
from solen.report.design.lens import profile_figure
from solen.report.design.summary import matters
from tests.report.conftest import Drawn, Studies


def words(text: str) -> list[str]:
    """All texts of an SVG, which keeps them as text."""
    root = ET.fromstring(text)  # noqa: S314  drawn by this package
    return ["".join(one.itertext()) for one in root.iter("{http://www.w3.org/2000/svg}text")]


def test_figures_are_the_same_byte_for_byte(studied: Studies) -> None:
    dark = studied("dark")
    one, other = (svg(study_figure(dark), "response") for _ in range(2))
    assert one == other


@pytest.mark.parametrize(("suffix", "start"), [(".svg", b"<?xml"), (".png", b"\x89PNG"), (".pdf", b"%PDF")])
def test_each_kind_of_file_is_itself_and_the_same_again(studied: Studies, suffix: str, start: bytes) -> None:
    study = studied("paper")
    first, second = (encoded(study_figure(study), suffix, "response") for _ in range(2))
    assert first.startswith(start)
    assert first == second
    assert b"CreationDate" not in first
    assert b"<dc:date>" not in first


def test_the_salt_keeps_the_names_of_two_figures_apart(studied: Studies) -> None:
    study = studied("no lens")
    one, other = (svg(study_figure(study), salt) for salt in ("one", "other"))
    assert one != other
    assert words(one) == words(other)


def test_the_profile_stands_beside_those_of_the_paper_s_indices(studied: Studies) -> None:
    lens = studied("paper").case.sensor.lens
    assert isinstance(lens, OvalLens)
    told = words(svg(profile_figure(lens), "profile"))
    assert "n = 1.44 (this lens)" in told
    assert {"n = 1.49", "n = 1.54"} <= set(told)
    assert "n = 1.44" not in told
    acrylate = studied("acrylate").case.sensor.lens
    assert isinstance(acrylate, OvalLens)
    told = words(svg(profile_figure(acrylate), "profile"))
    assert {"n = 1.44", "n = 1.49", "n = 1.54", f"n = {acrylate.design_index:.4g} (this lens)"} <= set(told)


def test_a_lens_too_wide_for_another_index_is_drawn_alone() -> None:
    told = words(svg(profile_figure(OvalLens(1.0, 20.0, 3.1, 1.54)), "profile"))
    assert "n = 1.44" not in told
    assert "n = 1.54 (this lens)" in told


def test_the_response_shows_both_receivers_of_both_cases(studied: Studies, drawn: Drawn) -> None:
    told = words(drawn("paper")["response"])
    for label in ("right, with lens", "left, with lens", "right, no lens", "left, no lens", "dots: counted rays"):
        assert label in told
    alone = words(drawn("no lens")["response"])
    assert "right, no lens" in alone
    assert "right, with lens" not in alone
    alone = words(svg(study_figure(studied("no comparison")), "response"))
    assert "right, with lens" in alone
    assert "right, no lens" not in alone


def test_every_figure_of_light_says_that_it_is_simulated(drawn: Drawn) -> None:
    of_the_lens_alone = {"lens-profile", "focus"}
    silent = {name for name, text in drawn("paper").items() if not any("simulated" in word for word in words(text))}
    assert silent == of_the_lens_alone


def test_views_are_titled_by_their_angles(drawn: Drawn) -> None:
    texts = drawn("paper")
    assert {"-3°", "0°", "+3°"} <= {word.replace("−", "-") for word in words(texts["rays"])}
    assert {"no lens, 0°", "no lens, +3°"} <= set(words(texts["rays-without-lens"]))


def test_a_view_draws_every_ray_in_the_colour_of_its_receiver(studied: Studies) -> None:
    sensor = studied("paper").case.sensor
    title, body, scene, trace = sensor_view(sensor, -3.0, 50)
    assert (title, scene.rays, trace.rays, trace.mode) == ("-3°", 50, 50, "count")
    assert body.face("lens").curve.start != sensor.body().face("lens").curve.start
    figure = rays_figure([(title, body, scene, trace)])
    (axes,) = figure.axes
    drawn = [len(lines.get_paths()) for lines in axes.collections]
    detected = trace.detectors["right"].rays
    assert detected > 20
    assert trace.detectors["left"].rays == 0
    assert sorted(drawn) == sorted([0, detected, 50 - detected])


def test_in_space_no_rays_are_counted_and_the_paper_s_point_is_drawn(drawn: Drawn) -> None:
    told = words(drawn("in space")["response"])
    assert "as in the paper (point, plane)" in told
    assert "dots: counted rays" not in told
    assert "with a chip, in space" in words(drawn("paper")["response"])


def test_what_matters_is_drawn_by_its_names(studied: Studies, drawn: Drawn) -> None:
    told = words(drawn("paper")["matters"])
    for row in matters(studied("paper").practice)[1]:
        assert row.name in told
        assert row.by in told
