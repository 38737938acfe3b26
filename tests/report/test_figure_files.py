"""Figures of a design: reproducible files, labels and drawn rays."""

from xml.etree import ElementTree as ET

import pytest

from solen.lens import OvalLens
from solen.report.canvas import encoded, svg
from solen.report.design.figures import rays_figure, sensor_view, study_figure
from solen.report.design.lens import profile_figure
from solen.report.design.summary import effect_rows
from tests.report.conftest import Drawn, Studies


def texts(text: str) -> list[str]:
    """Return the texts of an SVG."""
    root = ET.fromstring(text)  # noqa: S314  drawn by this package
    return ["".join(element.itertext()) for element in root.iter("{http://www.w3.org/2000/svg}text")]


@pytest.mark.parametrize(("suffix", "start"), [(".svg", b"<?xml"), (".png", b"\x89PNG"), (".pdf", b"%PDF")])
def test_files_are_reproducible(studied: Studies, suffix: str, start: bytes) -> None:
    study = studied("dark" if suffix == ".svg" else "paper")
    first, second = (encoded(study_figure(study), suffix, "response") for _ in range(2))
    assert first.startswith(start)
    assert first == second
    assert b"CreationDate" not in first
    assert b"<dc:date>" not in first


def test_salt_makes_ids_unique(studied: Studies) -> None:
    study = studied("no lens")
    first, second = (svg(study_figure(study), salt) for salt in ("first", "second"))
    assert first != second
    assert texts(first) == texts(second)


def test_profile_is_compared_with_indices_of_paper(studied: Studies) -> None:
    lens = studied("paper").case.sensor.lens
    assert isinstance(lens, OvalLens)
    labels = texts(svg(profile_figure(lens), "profile"))
    assert "n = 1.44 (this lens)" in labels
    assert {"n = 1.49", "n = 1.54"} <= set(labels)
    assert "n = 1.44" not in labels
    acrylate = studied("acrylate").case.sensor.lens
    assert isinstance(acrylate, OvalLens)
    labels = texts(svg(profile_figure(acrylate), "profile"))
    assert {"n = 1.44", "n = 1.49", "n = 1.54", f"n = {acrylate.design_index:.4g} (this lens)"} <= set(labels)


def test_omits_impossible_lens_of_other_index() -> None:
    labels = texts(svg(profile_figure(OvalLens(1.0, 20.0, 3.1, 1.54)), "profile"))
    assert "n = 1.44" not in labels
    assert "n = 1.54 (this lens)" in labels


def test_response_shows_receivers_with_and_without_lens(studied: Studies, drawn: Drawn) -> None:
    labels = texts(drawn("paper")["response"])
    for label in ("right, with lens", "left, with lens", "right, no lens", "left, no lens", "dots: counted rays"):
        assert label in labels
    labels = texts(drawn("no lens")["response"])
    assert "right, no lens" in labels
    assert "right, with lens" not in labels
    labels = texts(svg(study_figure(studied("no comparison")), "response"))
    assert "right, with lens" in labels
    assert "right, no lens" not in labels


def test_figures_of_light_are_marked_as_simulated(drawn: Drawn) -> None:
    unmarked = {name for name, svg_ in drawn("paper").items() if not any("simulated" in text for text in texts(svg_))}
    assert unmarked == {"lens-profile", "focus"}


def test_titles_of_views_contain_angles(drawn: Drawn) -> None:
    figures = drawn("paper")
    assert {"-3°", "0°", "+3°"} <= {text.replace("−", "-") for text in texts(figures["rays"])}
    assert {"no lens, 0°", "no lens, +3°"} <= set(texts(figures["rays-without-lens"]))


def test_view_draws_rays_in_colours_of_receivers(studied: Studies) -> None:
    sensor = studied("paper").case.sensor
    title, body, scene, trace = sensor_view(sensor, -3.0, 50)
    assert (title, scene.rays, trace.rays, trace.mode) == ("-3°", 50, 50, "count")
    assert body.face("lens").curve.start != sensor.body().face("lens").curve.start
    figure = rays_figure([(title, body, scene, trace)])
    (axes,) = figure.axes
    rays = [len(lines.get_paths()) for lines in axes.collections]
    detected = trace.detectors["right"].rays
    assert detected > 20
    assert trace.detectors["left"].rays == 0
    assert sorted(rays) == sorted([0, detected, 50 - detected])


def test_response_in_space_is_compared_with_paper(studied: Studies, drawn: Drawn) -> None:
    labels = texts(svg(study_figure(studied("in space")), "response"))
    assert "as in the paper (point source in the plane)" in labels
    assert "dots: counted rays" not in labels
    assert "with a chip, in space" in texts(drawn("paper")["response"])


def test_effects_are_labelled(studied: Studies, drawn: Drawn) -> None:
    labels = texts(drawn("paper")["matters"])
    for row in effect_rows(studied("paper").practice)[1]:
        assert row.name in labels
        assert row.by in labels
