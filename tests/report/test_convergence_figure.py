"""The convergence figure: error and reported uncertainty of each sampling method, on logarithmic axes."""

import dataclasses
from importlib import import_module

import numpy as np
import pytest
from matplotlib.figure import Figure

from solen.report.canvas import encoded, svg
from solen.report.design.figures import METHODS, convergence_figure
from solen.sensor import Sensor
from solen.spec import loads, template, with_values
from solen.trace import Convergence, Mode, convergence
from tests.report.test_figure_files import texts

MAX_RAYS = 256


def result(mode: Mode = "power", **values: object) -> Convergence:
    design = with_values(loads(template("paper-860")), {key.replace("__", "."): value for key, value in values.items()})
    return convergence(Sensor.of(design).scene(0.2), mode, max_rays=MAX_RAYS)


@pytest.fixture(scope="module")
def power() -> Convergence:
    return result()


def labels(figure: Figure) -> list[str]:
    (legend,) = (axes.get_legend() for axes in figure.axes)
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


def test_draws_every_series_with_dashed_uncertainty(power: Convergence) -> None:
    figure = convergence_figure(power)
    (axes,) = figure.axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    lines = {str(line.get_label()): line for line in axes.lines}
    for series in power.series:
        name, colour, _ = METHODS[series.method]
        error, u = lines[f"{name}: error"], lines[f"{name}: reported u"]
        assert (error.get_linestyle(), u.get_linestyle()) == ("-", "--")
        assert error.get_color() == u.get_color() == colour
        assert np.array_equal(np.asarray(error.get_xdata()), series.rays)
        assert np.array_equal(np.asarray(error.get_ydata()), series.error)
        assert np.array_equal(np.asarray(u.get_ydata()), series.u_power)
    reference = lines["reference: reported u"]
    assert np.allclose(np.asarray(reference.get_ydata(), dtype=float), power.reference.u_power)
    assert labels(figure) == list(lines)


def test_labels_axes_and_states_reference_in_title(power: Convergence) -> None:
    shown = texts(svg(convergence_figure(power), "convergence"))
    assert "rays traced" in shown
    assert "error and reported u (fraction of the emitted power)" in shown
    assert f"simulated, mode power; errors relative to adaptive with {power.reference.rays:,} rays" in shown


def test_omits_and_counts_uncertainties_of_0(power: Convergence) -> None:
    fan, *others = power.series
    certain = dataclasses.replace(fan, u_power=np.where(fan.rays > 64, fan.u_power, 0.0))
    figure = convergence_figure(dataclasses.replace(power, series=(certain, *others)))
    assert f"fan: reported u (3 of {len(fan.u_power)} are 0)" in labels(figure)
    (axes,) = figure.axes
    (line,) = (line for line in axes.lines if str(line.get_label()).startswith("fan: reported u"))
    assert np.isnan(np.asarray(line.get_ydata(), dtype=float)[:3]).all()


def test_reference_for_trapped_light_is_adaptive_integral(monkeypatch: pytest.MonkeyPatch) -> None:
    module = import_module("solen.trace.convergence")
    monkeypatch.setattr(module, "TOLERANCES", (1e-2, 1e-3))
    monkeypatch.setattr(module, "REFERENCE_TOLERANCE", 1e-4)
    gap = result(receivers__coupling="air-gap", receivers__gap_mm=0.5)
    assert gap.reference.method == "adaptive"
    figure = convergence_figure(gap)
    assert f"errors relative to adaptive with {gap.reference.rays:,} rays" in "".join(texts(svg(figure, "convergence")))


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_files_are_reproducible(power: Convergence, suffix: str) -> None:
    first, second = (encoded(convergence_figure(power), suffix, "convergence") for _ in range(2))
    assert first == second
