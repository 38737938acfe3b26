"""Figures of mechanical tests: stress and strain of materials side by side, and the models through the tests."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.stiffness import MODES, model
from solen.report.canvas import INK, LOST, SERIES, STYLE

_MARKERS = {"uniaxial": "o", "planar": "s", "equibiaxial": "^"}
_DASHES = ((4, 2), (1, 1.5), (6, 2, 1, 2))
_ACROSS, _RIVALS = 3, 2


def stiffness_figure(groups: Sequence[Mapping[str, Any]], *, simulated: bool = False) -> Figure:
    """Curves of all specimens, and beside them the models of each material that has any."""
    fitted = [group for group in groups if group["fits"]]
    with mpl.rc_context(STYLE):
        across = min(1 + len(fitted), _ACROSS)
        down = -(-(1 + len(fitted)) // across)
        figure = Figure(figsize=(4.4 * across, 3.7 * down), layout="constrained")
        axes = figure.subplots(down, across, squeeze=False).ravel()
        _draw_curves(axes[0], groups)
        for number, group in enumerate(fitted):
            _draw_models(axes[1 + number], group)
        for empty in axes[1 + len(fitted) :]:
            empty.set_visible(False)
        if simulated:
            figure.suptitle("simulated data", color=LOST, fontsize=9)
    return figure


def _draw_curves(axes: Axes, groups: Sequence[Mapping[str, Any]]) -> None:
    """Every specimen as a line, a colour for each material, and the slope of its modulus."""
    down = all(each["loading"] == "compression" for group in groups for each in group["specimens"])
    sign = -1 if down else 1
    for number, group in enumerate(groups):
        colour = SERIES[number % len(SERIES)]
        alike = [each for each in group["specimens"] if each["mode"] == group["specimens"][0]["mode"]]
        for first, each in enumerate(alike):
            strain, stress = (sign * np.array(each["curve"][name]) for name in ("strain", "stress_MPa"))
            axes.plot(100 * strain, stress, color=colour, lw=1.3, label=None if first else _name(group))
        _draw_slope(axes, group, colour, sign)
    kind = "compressive " if down else ""
    axes.set(xlabel=f"{kind}engineering strain (%)", ylabel=f"{kind}engineering stress (MPa)")
    axes.axhline(0, color=INK, lw=0.6)
    axes.legend(fontsize=8, loc="upper left")
    axes.set_title("tests", fontsize=9, loc="left")


def _draw_slope(axes: Axes, group: Mapping[str, Any], colour: str, sign: int) -> None:
    """Mean modulus as a dashed line from the origin, as far as the stresses reach and a little beyond its range."""
    each = group["specimens"][0]
    if each["mode"] != "uniaxial" or group["modulus_MPa"] <= 0:
        return
    highest = max(np.abs(s["curve"]["stress_MPa"]).max() for s in group["specimens"])
    reach = min(2.5 * group["strain_range"][1], 0.6 * float(highest) / group["modulus_MPa"])
    direction = sign * (-1 if each["loading"] == "compression" else 1)
    ends = np.array([0.0, reach]) * direction
    axes.plot(100 * ends, group["modulus_MPa"] * ends, color=colour, lw=1, dashes=(4, 2))


def _name(group: Mapping[str, Any]) -> str:
    """Label of a material with its modulus."""
    count = len(group["specimens"])
    spread = group["sd_modulus_MPa"]
    told = f"E = {group['modulus_MPa']:.3g} ± {group['u_modulus_MPa'] if spread is None else spread:.2g} MPa"
    told += "" if spread is None else f" (SD, n = {count})"
    return f"{group['label']}: {told}" if group["label"] else told


def _draw_models(axes: Axes, group: Mapping[str, Any]) -> None:
    """The tests as points, the chosen model as a strong line and the next best as thin ones, a colour for each mode."""
    lines = _lines(group)
    for colour, (mode, marker) in zip(SERIES, _MARKERS.items(), strict=False):
        tests = [each for each in group["specimens"] if each["mode"] == mode]
        for first, each in enumerate(tests):
            label = None if first else f"{mode}, measured loading"
            points = (each["fitted"]["stretch"], each["fitted"]["stress_MPa"])
            axes.plot(*points, marker, ms=3.5, mfc="none", color=colour, mew=0.8, label=label)
        for found, look in lines if tests else []:
            low, high = next(each["stretch_range"] for each in found["modes"] if each["mode"] == mode)
            stretch = np.linspace(low, high, 200)
            stress = model(found["kind"]).stress(list(found["parameters"].values()), MODES[mode], stretch)
            axes.plot(stretch, stress, color=colour, **look)
    for found, look in lines:
        remark = " (chosen)" if found["kind"] == _chosen(group) else "" if found["stable_in_data"] else " (unstable)"
        axes.plot([], [], color=INK, label=found["kind"] + remark, **look)
    axes.set(xlabel="stretch λ", ylabel="engineering stress (MPa)")
    axes.axhline(0, color=INK, lw=0.6)
    axes.legend(fontsize=8, loc="best")
    axes.set_title(": ".join(filter(None, (group["label"], "hyperelastic models"))), fontsize=9, loc="left")


def _lines(group: Mapping[str, Any]) -> list[tuple[Mapping[str, Any], dict[str, Any]]]:
    """Fits that are drawn, each with the look of its line: the chosen one, and the next best by AICc."""
    strong = [fit for fit in group["fits"] if fit["kind"] == _chosen(group)]
    rest = [fit for fit in group["fits"] if fit["kind"] != _chosen(group)]
    rest.sort(key=lambda fit: (fit["aicc"] is None, fit["aicc"] or 0.0))
    shown = [(fit, {"lw": 1.8, "zorder": 3}) for fit in strong]
    return shown + [(fit, {"lw": 0.8, "dashes": dashes}) for fit, dashes in zip(rest[:_RIVALS], _DASHES, strict=False)]


def _chosen(group: Mapping[str, Any]) -> str:
    return group["model"]["kind"] if group["model"] else ""
