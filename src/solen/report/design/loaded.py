"""Figures of a soft body under load: its strained shape, the light inside it, its response and the forces."""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import TriMesh
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from solen.arrays import FloatArray
from solen.mechanics.design import LoadedState
from solen.report import canvas
from solen.report.canvas import INK, LOST, SPACE, receiver
from solen.report.design.figures import MAX_RAYS, rays_figure, sensor_view
from solen.report.design.table import csv_text
from solen.sensor import SATURATION_CONTRAST, Sensor
from solen.sensor.loaded import Deformation, LoadedStudy
from solen.sensor.traced import value_text

COLUMNS = (
    *("angle_deg", "depth_mm", "force_N", "moment_Nmm", "turn_deg", "lens_turn_deg"),
    *("right", "left", "u_power", "contrast", "rigid_contrast"),
)
LABELS = {"angle_deg": "angle (deg)", "depth_mm": "depth (mm)", "force_N": "force (N)"}
FORCE_MM = 6.0
"""Length of the longest force arrow."""


def figures(study: LoadedStudy) -> dict[str, str]:
    """Return the figures of a study as SVG text, keyed by name."""
    ends = sorted({float(study.values[0]), float(study.values[-1])})
    rays = min(study.design.emitter.rays, MAX_RAYS)
    draws: dict[str, Callable[[], Figure]] = {
        "response": partial(response_figure, study),
        "shape": lambda: shape_figure(study.sensor, study.states[-1], f"{study.drives} at {end_values(study)[-1]}"),
        "rays": lambda: rays_figure([sensor_view(study.sensor, value, rays) for value in ends]),
    }
    return {name: canvas.svg(canvas.drawn(draw), name) for name, draw in draws.items()}


def deformation_figure(result: Deformation) -> Figure:
    """Draw the shape and strain of a loaded body, and the light inside it."""
    return shape_figure(result.sensor, result.state, f"{result.drives} at {value_text(result)}")


def shape_figure(sensor: Sensor, state: LoadedState, title: str) -> Figure:
    """Draw the strain and the forces on the deformed body with its outline at rest, and the light in the body."""
    rays = min(sensor.design.emitter.rays, MAX_RAYS)
    figure = rays_figure([sensor_view(sensor, state.value, rays)] * 2)
    figure.set_size_inches(7.4, 6.8)
    body, light = figure.axes
    half_width = max(map(abs, light.get_xlim())) + 0.5 * FORCE_MM
    low, high = light.get_ylim()
    body.clear()
    mesh = _draw_strain(body, state)
    _draw_forces(body, state)
    body.grid(visible=False)
    for axes, name in ((body, title), (light, "light")):
        axes.set(title=name, xlabel="x (mm)", ylabel="z (mm)")
        axes.set(xlim=(-half_width, half_width), ylim=(low - 1.0, high + FORCE_MM / 2))
        axes.set_aspect("equal")
    figure.colorbar(
        mesh, ax=[body, light], label="largest principal strain (%)", location="bottom", shrink=0.5, extend="max"
    )
    return figure


def response_figure(study: LoadedStudy) -> Figure:
    """Draw powers and contrast against the driven quantity, with the contrast of the rigid sensor, and the load."""
    key = study.design.motion.key
    load = load_curve(study)
    figure = Figure(figsize=(8.2 if load is None else 10.8, 3.5))
    axes = figure.subplots(1, 2 if load is None else 3)
    values = study.values
    for side in ("right", "left"):
        axes[0].plot(values, getattr(study, side), **receiver(side), lw=2.0, label=side)
    axes[0].set(xlabel=LABELS[key], ylabel="fraction of the emitted power")
    axes[0].set_ylim(0, None)
    axes[0].legend()
    axes[1].plot(values, study.contrast, color=INK, lw=2.0, label="soft")
    if study.rigid_contrast is not None:
        axes[1].plot(values, study.rigid_contrast, "--", color=LOST, lw=1.4, label="rigid, rotated by the same angle")
    if study.planes is not None:
        other = study.planes.stress if study.design.mechanics.plane == "strain" else study.planes.strain
        name = "stress" if study.design.mechanics.plane == "strain" else "strain"
        axes[1].plot(study.planes.values, other, "o:", color=SPACE, lw=1.0, ms=4, label=f"plane {name}")
    for bound in (-SATURATION_CONTRAST, SATURATION_CONTRAST):
        axes[1].axhline(bound, color=LOST, lw=0.8, ls=":")
    axes[1].set(xlabel=LABELS[key], ylabel="contrast (R − L)/(R + L)", ylim=(-1.05, 1.05))
    axes[1].legend(loc="lower right" if study.contrast[-1] > study.contrast[0] else "lower left")
    if load is not None:
        x, y, label_x, label_y = load
        axes[2].plot(x, y, color=INK, lw=2.0)
        axes[2].set(xlabel=label_x, ylabel=label_y)
    figure.suptitle(f"simulated: {study.design.name}")
    return figure


def end_values(study: LoadedStudy) -> list[str]:
    """Return the first and last values of the driven quantity, with its unit."""
    return [f"{study.values[i]:g} {study.design.motion.unit}" for i in (0, -1)]


def columns(study: LoadedStudy) -> dict[str, FloatArray]:
    """Return the driven quantity and the available results (N,), keyed by name."""
    available = {name: values for name in COLUMNS if (values := getattr(study, name)) is not None}
    return available | {f"{name}_V": study.voltage_V[:, i] for i, name in enumerate(study.receivers)}


def csv_table(study: LoadedStudy) -> str:
    """Return a CSV table with one row for each value of the driven quantity."""
    table = columns(study)
    return csv_text(table, zip(*table.values(), strict=True))


def load_curve(study: LoadedStudy) -> tuple[FloatArray, FloatArray, str, str] | None:
    """Return values and labels of clamp moment against angle or finger force against depth; None for a pull."""
    if study.angle_deg is not None and study.moment_Nmm is not None:
        return study.angle_deg, study.moment_Nmm, LABELS["angle_deg"], "moment of the clamp (N mm)"
    if study.depth_mm is not None and study.force_N is not None:
        return study.depth_mm, study.force_N, LABELS["depth_mm"], LABELS["force_N"]
    return None


def _draw_strain(axes: Axes, state: LoadedState) -> TriMesh:
    picture = state.deformed.picture
    x, z = (picture.points_mm + picture.displacement_mm).T
    strain = 100.0 * picture.strain
    high = max(float(np.quantile(strain, 0.995)), 1e-6)
    mesh = Triangulation(x, z, picture.triangles)
    colours = axes.tripcolor(mesh, strain, shading="gouraud", cmap="cividis_r", vmin=0.0, vmax=high, rasterized=True)
    for face in state.deformed.body.all_faces:
        axes.plot(*face.curve.flattened(0.01).T, color=LOST, lw=0.7, ls="--")
    for face in state.body.all_faces:
        axes.plot(*face.curve.flattened(0.01).T, color=INK, lw=0.8 if face.part != "receiver" else 2.4)
    return colours


def _draw_forces(axes: Axes, state: LoadedState) -> None:
    """Draw the forces of holds and loads as arrows, which start at the points about which moments are taken."""
    sizes = [float(np.hypot(*reaction.force_N)) for reaction in state.deformed.reactions]
    largest = max(sizes, default=0.0)
    for reaction, size in zip(state.deformed.reactions, sizes, strict=True):
        if size < 0.02 * largest or size == 0.0:
            continue
        start, scale = reaction.about_mm, FORCE_MM / largest
        tip = (start[0] + scale * reaction.force_N[0], start[1] + scale * reaction.force_N[1])
        axes.annotate("", tip, start, arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.2})
        shift, va = (-4, "top") if reaction.force_N[1] > 0.0 else (4, "bottom")  # the label is next to the arrow
        label = f"{reaction.name}\n{size:.2g} N"
        axes.annotate(label, start, xytext=(4, shift), textcoords="offset points", fontsize="small", color=INK, va=va)
