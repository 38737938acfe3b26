"""Figure options: page size, panels, limits, titles and files for journals."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image

from solen.errors import OutputError, SpecError
from solen.report.canvas import drawn, encoded, receiver
from solen.report.options import FigureOptions
from tests.report.lettering import faults


def three_panels() -> Figure:
    """Panels with a band behind a line, a legend and titles."""
    figure = Figure(figsize=(9.6, 3.4))
    x = np.linspace(0.0, 1.0, 50)
    for number, axes in enumerate(figure.subplots(1, 3)):
        axes.fill_between(x, x - 0.3, x + 0.3, color="#0072B2", alpha=0.25, lw=0, label="a band")
        axes.plot(x, x**number, label="a line with a rather long name that needs space")
        axes.set(xlabel="length (mm)", ylabel="level (dB)", title=f"panel {number}")
        axes.legend()
    figure.suptitle("simulated: a figure with a long title that does not fit into a column of a journal")
    return figure


def test_panels_are_stacked_in_column_and_side_by_side_on_page() -> None:
    column, page = (drawn(three_panels, FigureOptions(width_mm=width)) for width in (90.0, 180.0))
    assert column.get_figwidth() * 25.4 == pytest.approx(90.0)
    assert len({round(axes.get_position().y0, 2) for axes in column.axes}) == 3
    assert len({round(axes.get_position().y0, 2) for axes in page.axes}) == 1
    assert faults(column) == faults(page) == []


def test_no_titles_keeps_titles_only_in_metadata() -> None:
    figure = drawn(three_panels, FigureOptions(no_titles=True))
    for suffix in (".pdf", ".png", ".tiff", ".svg"):
        data = encoded(figure, suffix, "a", 100)
        assert b"simulated: a figure" in data
    is_shown = re.sub(r"(?s)<metadata>.*?</metadata>|<title>.*?</title>", "", encoded(figure, ".svg", "a").decode())
    assert "simulated: a figure" not in is_shown
    assert "panel 1" not in is_shown
    (note,) = [text for text in figure.texts if text.get_visible() and "simulated" in text.get_text()]
    assert note.get_text() == "simulated"
    assert faults(figure) == []


def test_selected_panels_have_letters_and_limits() -> None:
    options = FigureOptions(panels="CA", letters="(a)", limits=("x=0.2:0.8", "B.y=-1:2"))
    first, second = sorted(drawn(three_panels, options).axes, key=lambda axes: axes.get_position().x0)
    assert (first.get_title(), second.get_title()) == ("panel 2", "panel 0")
    assert [axes.texts[-1].get_text() for axes in (first, second)] == ["(a)", "(b)"]
    assert first.get_xlim() == second.get_xlim() == (0.2, 0.8)
    assert second.get_ylim() == (-1.0, 2.0)
    assert first.get_ylim() != (-1.0, 2.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"panels": "D"}, "ABC"),
        ({"limits": ("E.x=0:1",)}, "ABC"),
        ({"limits": ("z=0:1",)}, "z=0:1"),
        ({"letters": "3"}, "A, a or"),
        ({"limits": ("x=0:inf",)}, "x=0:inf"),
        ({"limits": ("x=-inf:1",)}, "x=-inf:1"),
        ({"font": "No Such Font"}, "No Such Font"),
    ],
)
def test_refuses_unknown_panels_limits_and_fonts(options: dict[str, str], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        drawn(three_panels, FigureOptions(**options))


def test_refuses_style_without_figure_and_unknown_extension() -> None:
    with pytest.raises(SpecError, match="--width-mm"):
        FigureOptions(width_mm=90.0).check()
    FigureOptions(width_mm=90.0).check(Path("traces.svg"))
    with pytest.raises(OutputError, match=r"a\.bmp"):
        FigureOptions(figure=Path("a.bmp")).check()


def test_refuses_resolution_of_vector_figure() -> None:
    with pytest.raises(SpecError, match="600"):
        FigureOptions(figure=Path("a.svg"), dpi=600).check()
    FigureOptions(figure=Path("a.svg"), dpi=600).check(Path("traces.png"))


def test_limits_of_logarithmic_axis_must_be_above_0() -> None:
    def logarithmic() -> Figure:
        figure = three_panels()
        figure.axes[1].set_xscale("log")
        return figure

    assert drawn(logarithmic, FigureOptions(limits=("A.x=0:1",))).axes[0].get_xlim() == (0.0, 1.0)
    with pytest.raises(SpecError, match="0:1"):
        drawn(logarithmic, FigureOptions(limits=("B.x=0:1",)))


def test_tick_labels_of_shared_axes_do_not_overlap() -> None:
    def shared() -> Figure:
        figure = Figure(figsize=(6.0, 6.0))
        for axes in figure.subplots(2, 3, sharex=True, sharey=True).flat:
            axes.plot([0.0, 1e5], [0.0, 1.0])
            axes.xaxis.set_major_locator(MaxNLocator(12))
        return figure

    figure = drawn(shared, FigureOptions(width_mm=180.0))
    numbers = [[text for text in axes.get_xticklabels() if text.get_text()] for axes in figure.axes]
    assert [bool(is_shown) for is_shown in numbers] == [False] * 3 + [True] * 3
    assert faults(figure) == []


def test_legend_avoids_large_markers() -> None:
    """A disc with its centre next to the legend and its edge under it."""

    def large() -> Figure:
        figure = Figure(figsize=(4.0, 4.0))
        axes = figure.subplots()
        axes.plot([0.76], [0.86], "o", ms=60.0, label="disc")
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        axes.legend(loc="upper right")
        return figure

    assert faults(drawn(large)) == []


def test_panels_after_z_have_two_letters() -> None:
    def many() -> Figure:
        figure = Figure(figsize=(12.0, 12.0))
        figure.subplots(4, 7)
        return figure

    figure = drawn(many, FigureOptions(letters="A", limits=("y=0:2",)))
    assert [axes.texts[-1].get_text() for axes in figure.axes[24:]] == ["Y", "Z", "AA", "AB"]
    assert {axes.get_ylim() for axes in figure.axes} == {(0.0, 2.0)}
    selected = drawn(many, FigureOptions(panels="b,AA", letters="(e)", limits=("B.x=0:5",)))
    assert [axes.texts[-1].get_text() for axes in selected.axes] == ["(e)", "(f)"], (
        "letters of a figure assembled from several files"
    )
    assert len(drawn(many, FigureOptions(panels="AB")).axes) == 1
    with pytest.raises(SpecError, match="'AC'; must be a panel of the figure, A to AB"):
        drawn(many, FigureOptions(panels="A,AC"))


def test_many_panels_in_column_fit_on_page() -> None:
    def six() -> Figure:
        figure = Figure(figsize=(12.0, 3.0))
        for number, axes in enumerate(figure.subplots(1, 6)):
            axes.plot([0.0, 1.0], [0.0, number], label="a line")
            axes.set(xlabel="length (mm)", ylabel="level (dB)")
        return figure

    figure = drawn(six, FigureOptions(width_mm=90.0))
    assert figure.get_figheight() * 25.4 < 240.0
    assert faults(figure) == []


@pytest.mark.parametrize(("name", "marker"), [("left", "<"), ("right", ">"), ("left_mV", "<"), ("photodiode", "s")])
def test_receivers_differ_in_marker(name: str, marker: str) -> None:
    assert receiver(name)["marker"] == marker


def test_raster_files_have_specified_resolution() -> None:
    figure = drawn(three_panels, FigureOptions(width_mm=90.0))
    for suffix in (".png", ".tiff"):
        image = Image.open(io.BytesIO(encoded(figure, suffix, "a", 600)))
        assert image.width == pytest.approx(90.0 / 25.4 * 600, abs=1)
        assert image.info["dpi"][0] == pytest.approx(600, rel=1e-3)


def band() -> Figure:
    """A band behind a line, without lettering."""
    figure = Figure(figsize=(3.0, 2.0))
    axes = figure.add_subplot()
    axes.fill_between([0.0, 1.0], 0.0, 1.0, color="#0072B2", alpha=0.25, lw=0)
    axes.plot([0.0, 1.0], [0.0, 1.0], color="black")
    axes.set_axis_off()
    return figure


def test_eps_blends_bands_with_white_and_is_reproducible() -> None:
    first, second = (encoded(drawn(band), ".eps", "a") for _ in range(2))
    assert first == second
    assert first.startswith(b"%!PS-Adobe")
    blue = np.array([0x00, 0x72, 0xB2]) / 255.0
    expected = 1.0 - 0.25 * (1.0 - blue)
    colours = [
        np.array(list(map(float, channels)))
        for channels in re.findall(rb"([\d.]+) ([\d.]+) ([\d.]+) setrgbcolor", first)
    ]
    assert any(np.allclose(colour, expected, atol=2e-3) for colour in colours)
    assert not any(np.allclose(colour, blue, atol=2e-3) for colour in colours)
