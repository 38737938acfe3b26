"""The figure of an index states its mode, shows masked points, and marks values that are not measured."""

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from solen.arrays import FloatArray
from solen.material.index import forward
from solen.material.index.layer import index_of_layer
from solen.material.index.options import IndexOptions
from solen.recording import Channel, Provenance, Recording
from solen.report.resin.index import TITLES, index_figure

NM = np.linspace(400.0, 900.0, 101)
R, T = forward(1.5, 1e-5, 50.0, NM)


def drawn(
    nm: FloatArray, t: FloatArray, r: FloatArray | None = None, *, simulated: bool = False, **options: Any
) -> Figure:
    columns = {"transmittance": t} | ({} if r is None else {"reflectance": r})
    channels = [Channel(name, name, "1", values, "nm") for name, values in columns.items()]
    recording = Recording((Channel("nm", "wavelength", "nm", nm), *channels), Provenance(simulated=simulated))
    settings = {"thickness_um": 50.0, "literature": "none", "fit": "none"} | options
    return index_figure(index_of_layer(recording, IndexOptions(**settings)))


def texts_of(figure: Figure) -> str:
    axes = figure.axes[2]
    legend = axes.get_legend()
    assert legend is not None
    texts = [text.get_text() for text in legend.get_texts()]
    return "; ".join([figure.get_suptitle(), axes.get_title(loc="right"), *texts])


def test_masked_points_and_band_are_visible() -> None:
    r = R.copy()
    r[:7] = -0.01
    figure = drawn(NM, T, r, u_T=1e-3, u_R=1e-3)
    assert "index from R and T, both measured" in texts_of(figure)
    assert "n masked (7 of 101)" in texts_of(figure)
    (band,) = figure.axes[2].collections
    heights = band.get_datalim(figure.axes[2].transData)
    assert heights.height == pytest.approx(2 * 0.0041, rel=0.3)
    marks = [line for line in figure.axes[2].lines if line.get_marker() == "|"]
    np.testing.assert_array_equal(np.asarray(marks[0].get_xdata()), NM[:7])


def test_figure_states_that_index_is_not_measured() -> None:
    text = texts_of(drawn(NM, T, mode="as-published"))
    assert "as published: R = 1 − T − A with A = −log10 T" in text
    assert "R computed from T, not measured" in text
    assert "not measured" not in texts_of(drawn(NM, T))


def test_each_mode_has_title_and_simulated_data_are_marked() -> None:
    assert {"measured", "absorptance", "as-published", "lossless", "fringes", "joint"} == TITLES.keys()
    assert texts_of(drawn(NM, T, simulated=True)).startswith("simulated, index from T alone")


def test_single_wavelength_is_drawn_as_dot() -> None:
    figure = drawn(NM[:1], T[:1], R[:1])
    assert figure.axes[2].lines[0].get_marker() == "o"
