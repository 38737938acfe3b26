"""Diagnosed sensors: mean curves with the fitted model, residuals, and parameter correlations."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis.diagnosis import Diagnosis, SensorDiagnoses, words
from solen.analysis.diagnosis.diagnose import model_V
from solen.report.bench.analyse import state_origin
from solen.report.canvas import INK, receiver

_MAP = "RdBu_r"
_SHORT = {
    "emitter.offset_mm": "decentre",
    "chip spread_mm2": "chip",
    "angle.zero_deg": "angle's zero",
    "loss_per_mm": "loss",
}


def diagnoses_figure(result: SensorDiagnoses) -> Figure:
    """Draw a column for each sensor: measured and modelled curves, residuals with their scatter, and correlations."""
    found = [sensor.diagnosis for sensor in result.sensors.values()]
    figure = Figure(figsize=(3.6 * len(found) + 0.6, 8.4))
    axes = figure.subplots(3, len(found), squeeze=False, height_ratios=(3.0, 1.6, 3.0))
    for column, one in enumerate(found):
        _curves(axes[0, column], one)
        _residuals(axes[1, column], one)
        _correlations(axes[2, column], one)
    axes[0, 0].set_ylabel("voltage (V)")
    axes[1, 0].set_ylabel("mean − model (mV)")
    state_origin(figure, result.simulated)
    return figure


def _curves(axes: Axes, diagnosis: Diagnosis) -> None:
    angle, fitted = diagnosis.cycles.angle_deg, model_V(diagnosis)
    for n, side in enumerate(diagnosis.sides):
        look = receiver(side, n)
        axes.plot(
            angle,
            diagnosis.cycles.mean_V[:, n],
            look["marker"],
            ms=2.6,
            color=look["color"],
            mec="none",
            alpha=0.7,
            label=side,
        )
        axes.plot(angle, fitted[:, n], color=look["color"], ls="-" if n else "--", lw=1.2, label=f"{side}, model")
    axes.set_title("\n".join([diagnosis.label, *words(diagnosis)[:2]]), loc="left")
    axes.legend()


def _residuals(axes: Axes, diagnosis: Diagnosis) -> None:
    angle, count = diagnosis.cycles.angle_deg, len(diagnosis.cycles.volts)
    for n, side in enumerate(diagnosis.sides):
        look, rest = receiver(side, n), 1e3 * diagnosis.fitted.residual_V[:, n]
        axes.plot(angle, rest, **look, lw=1.0)
        if count > 1:
            u = 1e3 * diagnosis.cycles.volts[..., n].std(axis=0, ddof=1) / np.sqrt(count)
            axes.fill_between(angle, rest - u, rest + u, color=look["color"], alpha=0.25, lw=0)
    axes.axhline(0.0, color=INK, lw=0.6)
    axes.set_xlabel("angle (°)")
    axes.set_title("residual, ± the uncertainty of the mean over the cycles", loc="left")


def _correlations(axes: Axes, diagnosis: Diagnosis) -> None:
    names = [diagnosis.fitted.model.parameters[place].name for place in diagnosis.fitted.active]
    names = [_SHORT.get(name, name.rpartition(".")[2]) for name in names]
    axes.imshow(diagnosis.correlations, vmin=-1.0, vmax=1.0, cmap=_MAP)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize="small")
    axes.set_yticks(range(len(names)), names, fontsize="small")
    axes.grid(visible=False)
    for (i, j), value in np.ndenumerate(diagnosis.correlations):
        if i != j:
            colour = "white" if abs(value) > 0.6 else INK
            axes.text(
                j,
                i,
                f"{value:.1f}".replace("0.", ".").replace("1.0", "1"),
                ha="center",
                va="center",
                fontsize="small",
                color=colour,
            )
    axes.set_title("parameter correlation", loc="left")
