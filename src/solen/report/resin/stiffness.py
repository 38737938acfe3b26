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
_MAX_COLUMNS = 3
_MAX_ALTERNATIVES = 2  # models drawn in addition to the chosen one


def stiffness_figure(stiffness: MeasuredStiffness) -> Figure:
    """Draw the curves of all specimens and, in further panels, the models of each fitted material."""
    fitted = [material for material in stiffness.materials if material.fits]
    columns = min(1 + len(fitted), _MAX_COLUMNS)
    rows = -(-(1 + len(fitted)) // columns)
    figure = Figure(figsize=(4.4 * columns, 3.7 * rows))
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    _draw_curves(axes[0], stiffness.materials)
    for number, material in enumerate(fitted):
        _draw_models(axes[1 + number], material)
    for empty in axes[1 + len(fitted) :]:
        empty.set_visible(False)
    if stiffness.simulated:
        figure.suptitle("simulated data", color=LOST)
    return figure


def _draw_curves(axes: Axes, materials: Sequence[MaterialStiffness]) -> None:
    """Draw the modulus and the specimens of each material, several specimens as mean ± SD of their loading curves."""
    is_compression = all(
        specimen.test.loading == "compression" for material in materials for specimen in material.specimens
    )
    sign = -1 if is_compression else 1
    for number, material in enumerate(materials):
        group = [specimen for specimen in material.specimens if specimen.mode == material.specimens[0].mode]
        curves = [(100 * sign * item.test.curve["strain"], sign * item.test.curve["stress_MPa"]) for item in group]
        if len(curves) > 1:
            peaks = [int(np.argmax(strain)) + 1 for strain, _ in curves]
            curves = [(strain[:peak], stress[:peak]) for (strain, stress), peak in zip(curves, peaks, strict=True)]
        draw_repeats(axes, curves, number, _label(material), lw=1.3)
        _draw_modulus(axes, material, SERIES[number % len(SERIES)], sign)
    loading = "compressive " if is_compression else ""
    axes.set(xlabel=f"{loading}engineering strain (%)", ylabel=f"{loading}engineering stress (MPa)")
    axes.axhline(0, color=INK, lw=0.6)
    axes.legend()
    axes.set_title("tests", loc="left")


def _draw_modulus(axes: Axes, material: MaterialStiffness, colour: str, sign: int) -> None:
    """Draw the mean modulus as a dashed line from the origin to beyond its strain range, below the highest stress."""
    first = material.specimens[0]
    if first.mode != "uniaxial" or material.modulus_MPa <= 0:
        return
    highest = max(float(np.abs(specimen.test.stress_MPa).max()) for specimen in material.specimens)
    end = min(2.5 * material.strain_range[1], 0.6 * highest / material.modulus_MPa)
    strain = np.array([0.0, end]) * sign * first.test.sign
    axes.plot(100 * strain, material.modulus_MPa * strain, color=colour, lw=1, dashes=(4, 2))


def _label(material: MaterialStiffness) -> str:
    """Return the label of a material with its modulus."""
    sd = material.sd_modulus_MPa
    modulus = f"E = {material.modulus_MPa:.3g} ± {material.u_modulus_MPa if sd is None else sd:.2g} MPa"
    return f"{material.label}: {modulus}" if material.label else modulus


def _draw_models(axes: Axes, material: MaterialStiffness) -> None:
    """Draw tests as points, the chosen model as thick lines and the next best as thin ones, coloured by mode."""
    styles = _line_styles(material)
    for colour, (mode, marker) in zip(SERIES, _MARKERS.items(), strict=False):
        tests = [specimen for specimen in material.specimens if specimen.mode == mode]
        for number, specimen in enumerate(tests):
            label = None if number else f"{mode}, measured loading"
            points = (specimen.fitted.stretch, specimen.fitted.stress_MPa)
            axes.plot(*points, marker, ms=3.5, mfc="none", color=colour, mew=0.8, label=label)
        for fit, style in styles if tests else []:
            low, high = next(quality.stretch_range for quality in fit.quality if quality.mode == mode)
            stretch = np.linspace(low, high, 200)
            axes.plot(stretch, fit.model.stress(fit.values, MODES[mode], stretch), color=colour, **style)
    for fit, style in styles:
        suffix = " (chosen)" if _is_chosen(fit, material) else "" if fit.stable_in_data else " (unstable)"
        axes.plot([], [], color=INK, label=fit.kind + suffix, **style)
    axes.set(xlabel="stretch λ", ylabel="engineering stress (MPa)")
    axes.axhline(0, color=INK, lw=0.6)
    axes.legend()
    axes.set_title(": ".join(filter(None, (material.label, "hyperelastic models"))), loc="left")


def _line_styles(material: MaterialStiffness) -> list[tuple[Fit, dict[str, Any]]]:
    """Return the fits to draw, the chosen one and the next best by AICc, with the style of their lines."""
    others = [fit for fit in material.fits if not _is_chosen(fit, material)]
    others.sort(key=lambda fit: (fit.aicc is None, fit.aicc or 0.0))
    styles: list[tuple[Fit, dict[str, Any]]] = [
        (fit, {"lw": 1.8, "zorder": 3}) for fit in material.fits if _is_chosen(fit, material)
    ]
    thin = [{"lw": 0.8, "dashes": dashes} for dashes in _DASHES]
    return [*styles, *zip(others[:_MAX_ALTERNATIVES], thin, strict=False)]


def _is_chosen(fit: Fit, material: MaterialStiffness) -> bool:
    return material.model is not None and fit.kind == material.model.kind
