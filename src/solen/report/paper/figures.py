"""Figures of results in the paper's style, with its values and letters, and a mark on simulated data.

The paper's values are violet diamonds, labelled as the paper's.
"""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.cure import MeasuredCurve
from solen.material.index.layer import LayerIndex
from solen.metrology.coupons import CouponMeasurement
from solen.paper.statements import stated
from solen.report.canvas import HIGHER, INK
from solen.report.design.figures import SHOWN_RAYS, rays_figure, sensor_view
from solen.report.design.network import rays_of
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
    """Draw T, absorbance and index of the simulated layer, with the paper's minimum T and its three indices."""
    figure = index_figure(index)
    light, _, n = figure.axes
    low = 0.01 * stated("transmittance")
    light.axhline(low, color=HIGHER, lw=1.2, ls=":", label=f"the paper: T above {low:g}")
    light.set_ylim(0.0, 1.25)
    light.legend()
    values = [stated(f"index-{nm:g}") for nm in WAVELENGTHS_NM]
    n.plot(WAVELENGTHS_NM, values, "D", **PAPER, label="the paper")
    n.set_ylim(min(values) - 0.02, max(values) + 0.08)
    n.legend()
    return figure


def working_curves(curve: MeasuredCurve) -> Figure:
    """Draw working curves, and the depth that the paper reports as a lower bound."""
    figure = cure_figure(curve)
    axes, energy, depth = figure.axes[0], stated("cure-energy"), stated("cure-depth")
    axes.plot([energy], [depth], "^", **PAPER, label=f"the paper: above {depth:g} µm at about {energy:g} mJ/cm²")
    axes.legend()
    return figure


def coupon_figure(measured: CouponMeasurement, key: str, letter: str) -> Figure:
    """Draw a measured coupon with the paper's value, as a line if it is a nominal size and otherwise as a note."""
    figure = fidelity_figure(measured)
    lettered(figure.axes[0], letter)
    axes, um = figure.axes[-1], stated(key)
    look: dict[str, Any] = {"color": HIGHER, "lw": 1.4, "ls": ":"}
    words = f"the paper: {um:g} µm"
    if key == "step":
        axes.axhline(um, **look, label=words)
    elif key == "gap":
        axes.axvline(1e-3 * um, **look, label=words)
    else:
        of = "smallest pillar, as measured" if key == "pillar" else "smallest difference between holes"
        axes.plot([], [], " ", label=f"{words}, {of}")
    axes.legend()
    return figure


def robot_figure(traced: NetworkTrace) -> Figure:
    """Draw counted rays from each emitter of a network; these rays are never split, so the light paths are visible."""
    return rays_of([sensor.set({"trace.mode": "count"}) for sensor in traced.sensors])


def rays_of_states(sensor: Sensor, angles_deg: Sequence[float], letters: str, zoom_mm: float | None = None) -> Figure:
    """Draw rays in a sensor at several angles in the plane, lettered; ``zoom_mm`` limits the view around the lens."""
    figure = rays_figure([sensor_view(sensor, angle, SHOWN_RAYS) for angle in angles_deg], zoom_mm)
    for axes, letter in zip(figure.axes, letters, strict=True):
        lettered(axes, letter)
    return figure


def lettered(axes: Axes, letter: str) -> None:
    """Draw a letter at the upper left of a panel."""
    axes.annotate(letter, (0.0, 1.0), xytext=(-8.0, 8.0), ha="right", **LETTER)


def marked(figure: Figure, words: str) -> Figure:
    """Add a line at the foot of the figure that says what is simulated, with the model and seed."""
    if words:
        place = figure.suptitle if figure.legends else figure.supxlabel  # a legend of the figure is at its foot
        place(words, x=0.01, ha="left", fontsize=7, color="#8a2f00")
    return figure
