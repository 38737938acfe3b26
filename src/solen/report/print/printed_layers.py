"""The figure of a predicted print whose lens varies with height: its deviation over the face, and its responses."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.fabricate.process import PrintedLayers
from solen.fabricate.process.face_print import PrintedFace
from solen.report.canvas import INK, LOST, series

SCALE_PERCENTILE = 99.0
"""Percentile of the absolute deviations at which the colour scale ends; corners exceed it."""


def layers_figure(prediction: PrintedLayers) -> Figure:
    """Draw the deviations of the printed and the compensated face, and the contrast for all lenses."""
    faces = [("printed", prediction.face, prediction.rms_um)]
    if prediction.compensated is not None and prediction.compensated_rms_um is not None:
        faces.append(("compensated", prediction.compensated, prediction.compensated_rms_um))
    figure = Figure(figsize=(3.4 * len(faces) + 4.4, 3.9))
    axes = figure.subplots(1, len(faces) + 1, squeeze=False)[0]
    for axis, (name, face, rms_um) in zip(axes, faces, strict=False):
        _draw_face(figure, axis, prediction, face)
        axis.set_title(f"{name}: {rms_um:.3g} µm RMS")
    _draw_responses(axes[-1], prediction)
    figure.suptitle(f"simulated: {prediction.name}, {prediction.layers} layers ({prediction.process})")
    return figure


def _draw_face(figure: Figure, axes: Axes, prediction: PrintedLayers, face: PrintedFace) -> None:
    """Draw the deviation as colours against x and the height above the plate."""
    model = prediction.model
    half, height = model.lens.half_width_mm, model.lens.thickness_mm
    um = np.concatenate([face.um[:, :0:-1], face.um], axis=1)
    limit = max(float(np.percentile(np.abs(um), SCALE_PERCENTILE)), 1.0)
    image = axes.imshow(
        um, extent=(-half, half, 0.0, height), origin="lower", aspect="auto", cmap="RdBu_r", vmin=-limit, vmax=limit
    )
    figure.colorbar(image, ax=axes, label="deviation from the design (µm)", extend="both")
    axes.grid(visible=False)
    axes.set(xlabel="x (mm)", ylabel="height above the plate (mm)")


def _draw_responses(axes: Axes, prediction: PrintedLayers) -> None:
    """Draw the contrast with each lens against the angle."""
    if not prediction.responses:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no response was traced", ha="center", va="center", color=LOST)
        return
    names = list(dict.fromkeys(response.name.split(", ")[0] for response in prediction.responses))
    styles = {"designed": ":", "printed": "-", "compensated": "--"}
    for response in prediction.responses:
        lens, state = response.name.split(", ")
        colour = INK if lens == names[0] else series(names.index(lens))["color"]
        axes.plot(response.angle_deg, response.contrast, color=colour, ls=styles[state], lw=1.6, label=response.name)
    axes.set(xlabel="angle (deg)", ylabel="contrast (R − L)/(R + L)", ylim=(0.0, 1.05))
    axes.legend()
