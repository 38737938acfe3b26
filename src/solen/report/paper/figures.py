"""Figures of results arranged as in the paper, with its values and letters, and a note on simulated data.

Values from the paper are drawn in violet and labelled "the paper".
"""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.cure import MeasuredCurve
from solen.material.index.layer import LayerIndex
from solen.metrology.coupons import CouponMeasurement
from solen.paper.statements import paper_value
from solen.report.canvas import HIGHER, INK
from solen.report.design.figures import MAX_RAYS, rays_figure, sensor_view
from solen.report.design.network import sensors_figure
from solen.report.print.fidelity import fidelity_figure
from solen.report.resin.cure import cure_figure
from solen.report.resin.index import index_figure
from solen.sensor import Sensor
from solen.sensor.network import NetworkTrace

PAPER: dict[str, Any] = {"color": HIGHER, "mec": INK, "mew": 0.6, "ms": 6, "ls": ""}
WAVELENGTHS_NM = (450.0, 500.0, 860.0)
LETTER: dict[str, Any] = {
    "weight": "bold",
    "xycoords": "axes fraction",
    "textcoords": "offset points",
    "annotation_clip": False,
}


def layer_figure(index: LayerIndex) -> Figure:
    """Draw T, absorbance and index of the simulated layer, with the minimum T and the three indices of the paper."""
    figure = index_figure(index)
    light, _, n = figure.axes
    low = 0.01 * paper_value("transmittance")
    light.axhline(low, color=HIGHER, lw=1.2, ls=":", label=f"the paper: T above {low:g}")
    light.set_ylim(0.0, 1.25)
    light.legend()
    values = [paper_value(f"index-{nm:g}") for nm in WAVELENGTHS_NM]
    n.plot(WAVELENGTHS_NM, values, "D", **PAPER, label="the paper")
    n.set_ylim(min(values) - 0.02, max(values) + 0.08)
    n.legend()
    return figure


def working_curves(curve: MeasuredCurve) -> Figure:
    """Draw working curves, and the depth that the paper reports as a lower bound."""
    figure = cure_figure(curve)
    axes, energy, depth = figure.axes[0], paper_value("cure-energy"), paper_value("cure-depth")
    axes.plot([energy], [depth], "^", **PAPER, label=f"the paper: above {depth:g} µm at about {energy:g} mJ/cm²")
    axes.legend()
    return figure


def coupon_figure(measured: CouponMeasurement, key: str, letter: str) -> Figure:
    """Draw a measured coupon with the value of the paper, as a line if it is a nominal size or else in the legend."""
    figure = fidelity_figure(measured)
    lettered(figure.axes[0], letter)
    axes, um = figure.axes[-1], paper_value(key)
    style: dict[str, Any] = {"color": HIGHER, "lw": 1.4, "ls": ":"}
    label = f"the paper: {um:g} µm"
    if key == "step":
        axes.axhline(um, **style, label=label)
    elif key == "gap":
        axes.axvline(1e-3 * um, **style, label=label)
    else:
        kind = "smallest pillar, as measured" if key == "pillar" else "smallest difference between holes"
        axes.plot([], [], " ", label=f"{label}, {kind}")
    axes.legend()
    return figure


def robot_figure(traced: NetworkTrace) -> Figure:
    """Draw the rays of each emitter of a network, traced in counting mode, in which no ray is split."""
    return sensors_figure([sensor.set({"trace.mode": "count"}) for sensor in traced.sensors])


def states_figure(sensor: Sensor, angles_deg: Sequence[float], letters: str, zoom_mm: float | None = None) -> Figure:
    """Draw the rays in a sensor at several angles in the plane; ``zoom_mm`` limits the view to the lens."""
    figure = rays_figure([sensor_view(sensor, angle, MAX_RAYS) for angle in angles_deg], zoom_mm)
    for axes, letter in zip(figure.axes, letters, strict=True):
        lettered(axes, letter)
    return figure


def lettered(axes: Axes, letter: str) -> None:
    """Draw a letter at the upper left corner of a panel."""
    axes.annotate(letter, (0.0, 1.0), xytext=(-8.0, 8.0), ha="right", **LETTER)


def marked(figure: Figure, note: str) -> Figure:
    """Add a line at the foot of the figure, which states that data are simulated, with model and seed."""
    if note:
        add_line = figure.suptitle if figure.legends else figure.supxlabel  # a figure legend is at the foot
        add_line(note, x=0.01, ha="left", fontsize=7, color="#8a2f00")
    return figure
