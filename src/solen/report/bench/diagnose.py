"""Diagnosed sensors: mean curves with the fitted model, residuals, and parameter correlations."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis.diagnosis import Diagnosis, SensorDiagnoses, words
from solen.analysis.diagnosis.diagnose import model_V
from solen.report.bench.analyse import add_title
from solen.report.canvas import INK, receiver

_COLOUR_MAP = "RdBu_r"
_LABELS = {
    "emitter.offset_mm": "decentre",
    "chip spread_mm2": "chip",
    "angle.zero_deg": "zero angle",
    "loss_per_mm": "loss",
}


def diagnoses_figure(result: SensorDiagnoses) -> Figure:
    """Draw a column for each sensor: measured and modelled curves, residuals with their scatter, and correlations."""
    diagnoses = [sensor.diagnosis for sensor in result.sensors.values()]
    figure = Figure(figsize=(3.6 * len(diagnoses) + 0.6, 8.4))
    axes = figure.subplots(3, len(diagnoses), squeeze=False, height_ratios=(3.0, 1.6, 3.0))
    for column, diagnosis in zip(axes.T, diagnoses, strict=True):
        _curves(column[0], diagnosis)
        _residuals(column[1], diagnosis)
        _correlations(column[2], diagnosis)
    axes[0, 0].set_ylabel("voltage (V)")
    axes[1, 0].set_ylabel("mean − model (mV)")
    add_title(figure, result.simulated)
    return figure


def _curves(axes: Axes, diagnosis: Diagnosis) -> None:
    angle, fitted = diagnosis.cycles.angle_deg, model_V(diagnosis)
    for n, side in enumerate(diagnosis.sides):
        style, mean = receiver(side, n), diagnosis.cycles.mean_V[:, n]
        colour, marker = style["color"], style["marker"]
        axes.plot(angle, mean, marker, ms=2.6, color=colour, mec="none", alpha=0.7, label=side)
        axes.plot(angle, fitted[:, n], color=colour, ls="-" if n else "--", lw=1.2, label=f"{side}, model")
    axes.set_title("\n".join([diagnosis.label, *words(diagnosis)[:2]]), loc="left")
    axes.legend()


def _residuals(axes: Axes, diagnosis: Diagnosis) -> None:
    angle, count = diagnosis.cycles.angle_deg, len(diagnosis.cycles.volts)
    for n, side in enumerate(diagnosis.sides):
        style, residual = receiver(side, n), 1e3 * diagnosis.fitted.residual_V[:, n]
        axes.plot(angle, residual, **style, lw=1.0)
        if count > 1:
            u = 1e3 * diagnosis.cycles.volts[..., n].std(axis=0, ddof=1) / np.sqrt(count)
            axes.fill_between(angle, residual - u, residual + u, color=style["color"], alpha=0.25, lw=0)
    axes.axhline(0.0, color=INK, lw=0.6)
    axes.set_xlabel("angle (°)")
    axes.set_title("residual ± standard uncertainty of the mean", loc="left")


def _correlations(axes: Axes, diagnosis: Diagnosis) -> None:
    names = [_LABELS.get(name, name.rpartition(".")[2]) for name in diagnosis.fitted.names]
    axes.imshow(diagnosis.correlations, vmin=-1.0, vmax=1.0, cmap=_COLOUR_MAP)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize="small")
    axes.set_yticks(range(len(names)), names, fontsize="small")
    axes.grid(visible=False)
    for (i, j), value in np.ndenumerate(diagnosis.correlations):
        if i != j:
            colour = "white" if abs(value) > 0.6 else INK
            text = f"{value:.1f}".replace("0.", ".").replace("1.0", "1")
            axes.text(j, i, text, ha="center", va="center", fontsize="small", color=colour)
    axes.set_title("correlation of the parameters", loc="left")
