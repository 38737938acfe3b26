"""Figures of mechanical tests: stress-strain curves of materials side by side, and the fitted models."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.stiffness import MODES, Fit, MaterialStiffness, MeasuredStiffness
from solen.report.canvas import INK, LOST, SERIES, draw_repeats

_MARKERS = {"uniaxial": "o", "planar": "s", "equibiaxial": "^"}
_DASHES = ((4, 2), (1, 1.5), (6, 2, 1, 2))
_ACROSS, _RIVALS = 3, 2


def stiffness_figure(stiffness: MeasuredStiffness) -> Figure:
    """Draw the curves of all specimens and, next to them, the models of each fitted material."""
    fitted = [material for material in stiffness.materials if material.fits]
    across = min(1 + len(fitted), _ACROSS)
    down = -(-(1 + len(fitted)) // across)
    figure = Figure(figsize=(4.4 * across, 3.7 * down))
    axes = figure.subplots(down, across, squeeze=False).ravel()
    _draw_curves(axes[0], stiffness.materials)
    for number, material in enumerate(fitted):
        _draw_models(axes[1 + number], material)
    for empty in axes[1 + len(fitted) :]:
        empty.set_visible(False)
    if stiffness.simulated:
        figure.suptitle("simulated data", color=LOST)
    return figure


def _draw_curves(axes: Axes, materials: Sequence[MaterialStiffness]) -> None:
    """Draw each material's specimens (several as mean ± SD over their common loading) and its modulus."""
    down = all(each.test.loading == "compression" for material in materials for each in material.specimens)
    sign = -1 if down else 1
    for number, material in enumerate(materials):
        colour = SERIES[number % len(SERIES)]
        alike = [each for each in material.specimens if each.mode == material.specimens[0].mode]
        curves = [tuple(sign * each.test.curve[name] for name in ("strain", "stress_MPa")) for each in alike]
        loading = [
            (100 * strain[: int(np.argmax(strain)) + 1], stress[: int(np.argmax(strain)) + 1])
            for strain, stress in curves
        ]
        draw_repeats(
            axes, loading if len(curves) > 1 else [(100 * curves[0][0], curves[0][1])], number, _name(material), lw=1.3
        )
        _draw_slope(axes, material, colour, sign)
    kind = "compressive " if down else ""
    axes.set(xlabel=f"{kind}engineering strain (%)", ylabel=f"{kind}engineering stress (MPa)")
    axes.axhline(0, color=INK, lw=0.6)
    axes.legend()
    axes.set_title("tests", loc="left")


def _draw_slope(axes: Axes, material: MaterialStiffness, colour: str, sign: int) -> None:
    """Draw the mean modulus as a dashed line from the origin to beyond its strain range, below the highest stress."""
    first = material.specimens[0]
    if first.mode != "uniaxial" or material.modulus_MPa <= 0:
        return
    highest = max(float(np.abs(each.test.stress_MPa).max()) for each in material.specimens)
    reach = min(2.5 * material.strain_range[1], 0.6 * highest / material.modulus_MPa)
    ends = np.array([0.0, reach]) * sign * first.test.sign
    axes.plot(100 * ends, material.modulus_MPa * ends, color=colour, lw=1, dashes=(4, 2))


def _name(material: MaterialStiffness) -> str:
    """Return a material's label with its modulus."""
    sd = material.sd_modulus_MPa
    name = f"E = {material.modulus_MPa:.3g} ± {material.u_modulus_MPa if sd is None else sd:.2g} MPa"
    return f"{material.label}: {name}" if material.label else name


def _draw_models(axes: Axes, material: MaterialStiffness) -> None:
    """Draw tests as points, the chosen model as a thick line and the next best as thin ones, coloured by mode."""
    shown = _shown(material)
    for colour, (mode, marker) in zip(SERIES, _MARKERS.items(), strict=False):
        tests = [each for each in material.specimens if each.mode == mode]
        for first, each in enumerate(tests):
            label = None if first else f"{mode}, measured loading"
            points = (each.fitted.stretch, each.fitted.stress_MPa)
            axes.plot(*points, marker, ms=3.5, mfc="none", color=colour, mew=0.8, label=label)
        for fit, look in shown if tests else []:
            low, high = next(quality.stretch_range for quality in fit.quality if quality.mode == mode)
            stretch = np.linspace(low, high, 200)
            axes.plot(stretch, fit.model.stress(fit.values, MODES[mode], stretch), color=colour, **look)
    for fit, look in shown:
        remark = " (chosen)" if _is_chosen(fit, material) else "" if fit.stable_in_data else " (unstable)"
        axes.plot([], [], color=INK, label=fit.kind + remark, **look)
    axes.set(xlabel="stretch λ", ylabel="engineering stress (MPa)")
    axes.axhline(0, color=INK, lw=0.6)
    axes.legend()
    axes.set_title(": ".join(filter(None, (material.label, "hyperelastic models"))), loc="left")


def _shown(material: MaterialStiffness) -> list[tuple[Fit, dict[str, Any]]]:
    """Return the fits to draw, with the style of their lines: the chosen one, and the next best by AICc."""
    rest = [fit for fit in material.fits if not _is_chosen(fit, material)]
    rest.sort(key=lambda fit: (fit.aicc is None, fit.aicc or 0.0))
    shown: list[tuple[Fit, dict[str, Any]]] = [
        (fit, {"lw": 1.8, "zorder": 3}) for fit in material.fits if _is_chosen(fit, material)
    ]
    return shown + [(fit, {"lw": 0.8, "dashes": dashes}) for fit, dashes in zip(rest[:_RIVALS], _DASHES, strict=False)]


def _is_chosen(fit: Fit, material: MaterialStiffness) -> bool:
    return material.model is not None and fit.kind == material.model.kind
