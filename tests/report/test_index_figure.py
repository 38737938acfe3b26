"""The figure of an index shows what it is: its mode, its masks, and whether it is a measurement."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from solen.material.index import IndexSpectrum, Length, as_published, forward, lossless, measured, reading
from solen.pipeline.resin.index import arrays
from solen.report.resin.index import TITLES, index_figure

NM = np.linspace(400.0, 900.0, 101)
R, T = forward(1.5, 1e-5, 50.0, NM)


def drawn(found: IndexSpectrum, simulated: bool = False) -> Figure:
    data = arrays(found) | {"mode": found.mode, "measurement": found.measurement}
    return index_figure(data | {"baseline": "air", "substrate": None, "sources": [{"simulated": simulated}]})


def told(figure: Figure) -> str:
    axes = figure.axes[2]
    legend = axes.get_legend()
    assert legend is not None
    texts = [text.get_text() for text in legend.get_texts()]
    return "; ".join([figure.get_suptitle(), axes.get_title(loc="right"), *texts])


def test_masked_points_and_the_band_are_visible() -> None:
    r = R.copy()
    r[:7] = -0.01
    figure = drawn(measured(NM, reading(T, 1e-3), reading(r, 1e-3), Length(50.0)))
    assert "index from R and T, both measured" in told(figure)
    assert "n masked (7 of 101)" in told(figure)
    (band,) = figure.axes[2].collections
    heights = band.get_datalim(figure.axes[2].transData)
    assert heights.height == pytest.approx(2 * 0.0041, rel=0.3)
    marks = [line for line in figure.axes[2].lines if line.get_marker() == "|"]
    np.testing.assert_array_equal(np.asarray(marks[0].get_xdata()), NM[:7])


def test_what_is_no_measurement_says_so_on_the_picture() -> None:
    text = told(drawn(as_published(NM, reading(T), Length(50.0))))
    assert "as published: R = 1 − T − A with A = −log10 T" in text
    assert "no measurement: R made of T alone" in text
    assert "no measurement" not in told(drawn(lossless(NM, reading(T))))


def test_each_mode_has_a_title_and_simulated_ones_say_so() -> None:
    assert {"measured", "absorptance", "as-published", "lossless"} == TITLES.keys()
    assert told(drawn(lossless(NM, reading(T)), simulated=True)).startswith("simulated, index from T alone")


def test_one_wavelength_is_drawn_as_a_dot() -> None:
    figure = drawn(measured(NM[:1], reading(T[:1]), reading(R[:1]), Length(50.0)))
    assert figure.axes[2].lines[0].get_marker() == "o"
