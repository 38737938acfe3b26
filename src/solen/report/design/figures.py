"""Figures of a design and its rays.

In every figure, the right receiver is blue and the left one orange; light that reaches neither is grey.
"""

from collections.abc import Sequence
from dataclasses import replace

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from solen.curve import Segment
from solen.errors import OutputError
from solen.geometry import Body
from solen.geometry.body import area, polyline
from solen.plane import along
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SERIES, SPACE, receiver
from solen.report.design.summary import effect_rows
from solen.scene import Scene
from solen.sensor import SATURATION_CONTRAST, Case, DesignStudy, Practice, Response, Sensor
from solen.sensor.traced import DesignTrace
from solen.trace import Convergence, Mode, Path, Trace, trace_reference
from solen.trace.scene_file import SceneTrace

COLOURS = {"right": RIGHT, "left": LEFT}
OTHER_COLOURS = ("#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#0072B2", "#D55E00", "#6A3D9A", "#8C6D31")
"""Colours for receivers with other names, in order."""
METHODS = {
    "fan": ("fan", INK, "o"),
    "sobol": ("Sobol' samples", "#CC79A7", "s"),
    "adaptive": ("adaptive", "#009E73", "^"),
}
"""Name, colour and marker of each ray sampling method."""
SIMULATED = "simulated"
"""Note in the title of every figure of traced light."""
MAX_RAYS = 100
"""Largest number of rays drawn in a figure; more would not be distinguishable."""


def study_figure(study: DesignStudy) -> Figure:
    """Draw received power against angle with and without a lens: integrated power as lines, counted rays as dots.

    For a measured lens, the response with the designed lens is also drawn. The contrast is drawn for the design, for
    the sensor as built, and for a point source in the plane, as in the paper.
    """
    lens, no_lens, designed, practice = study.with_lens, study.no_lens, study.designed, study.practice
    figure, power_axes, contrast_axes = _response_axes()
    with_lens = "with lens" if designed is None else "lens as printed"
    for case, name, style in ((lens, with_lens, "-"), (designed, "as designed", "-."), (no_lens, "no lens", "--")):
        if case is not None:
            _draw_response(power_axes, contrast_axes, case, name, style)
    if practice is not None and practice.built is not None and not practice.built.is_design:
        built = practice.built.response
        contrast_axes.plot(built.angle_deg, built.contrast, color=SPACE, lw=1.6, label="with a chip, in space")
    if practice is not None and practice.paper is not None:
        angle, contrast = practice.paper.angle_deg, practice.paper.contrast
        label = "as in the paper (point source in the plane)"
        contrast_axes.plot(angle, contrast, ":", color=LOST, lw=1.4, label=label)
    power_axes.set_ylim(0, None)
    if study.case.count is not None:
        power_axes.plot([], [], ".", color=LOST, ms=5, label="dots: counted rays")
    power_axes.legend()
    contrast_axes.legend()
    figure.suptitle(SIMULATED)
    return figure


def sweep_figure(response: Response) -> Figure:
    """Draw both receivers' powers against the angle, and their contrast, each with an uncertainty band."""
    angle, u_power = response.angle_deg, np.nan_to_num(response.u_power)
    figure, power_axes, contrast_axes = _response_axes()
    for side in ("right", "left"):
        power = getattr(response, side)
        power_axes.plot(angle, power, **receiver(side), lw=2.0, label=side)
        power_axes.fill_between(angle, power - u_power, power + u_power, color=COLOURS[side], alpha=0.3, lw=0)
    u = np.nan_to_num(response.u_contrast)
    contrast_axes.plot(angle, response.contrast, color=INK, lw=2.0)
    contrast_axes.fill_between(angle, response.contrast - u, response.contrast + u, color=INK, alpha=0.3, lw=0)
    power_axes.legend()
    contrast_axes.set_title(f"simulated, mode {response.mode}")
    return figure


def effects_figure(practice: Practice) -> Figure:
    """Draw the change of the contrast at each computed angle if one parameter is increased by its tolerance."""
    effects = practice.effects
    names = [f"{row.name}\n{row.by}" for row in effect_rows(practice)[1]]
    figure = Figure(figsize=(8.2, 0.9 + 0.42 * len(effects)))
    axes = figure.add_subplot()
    angles = sorted({float(angle) for effect in effects for angle in effect.angle_deg})
    height = 0.8 / len(angles)
    for n, angle in enumerate(angles):
        rows = [(row, effect) for row, effect in enumerate(effects) if angle in effect.angle_deg]
        bars = [(row, effect, effect.angle_deg.tolist().index(angle)) for row, effect in rows]
        axes.barh(
            [row + (n - (len(angles) - 1) / 2) * height for row, _, _ in bars],
            [float(effect.contrast[i]) for _, effect, i in bars],
            height,
            xerr=[float(effect.u_contrast[i]) for _, effect, i in bars],
            color=SERIES[n % len(SERIES)],
            error_kw={"lw": 0.8, "ecolor": INK},
            label=f"at {angle:+.3g}°" if angle else "at 0°",
        )
    axes.axvline(0.0, color=INK, lw=0.8)
    axes.set_yticks(range(len(effects)), names)
    axes.invert_yaxis()
    axes.set_axisbelow(True)
    axes.grid(visible=False, axis="y")
    axes.set(xlabel="change of the contrast, for a parameter increased by its tolerance")
    axes.set_title(SIMULATED)
    axes.legend()
    return figure


def convergence_figure(convergence: Convergence) -> Figure:
    """Draw the error and, dashed, the reported uncertainty against the number of rays for each method (log-log).

    Uncertainties of 0 cannot be drawn; the legend contains their number.
    """
    figure = Figure(figsize=(8.4, 4.2))
    axes = figure.add_subplot(xscale="log", yscale="log")
    for series in convergence.series:
        name, colour, marker = METHODS[series.method]
        axes.plot(series.rays, _positive(series.error), marker, ls="-", color=colour, ms=4, label=f"{name}: error")
        zeros = int(np.sum(series.u_power == 0.0))
        label = f"{name}: reported u" + (f" ({zeros} of {len(series.u_power)} are 0)" if zeros else "")
        axes.plot(series.rays, _positive(series.u_power), "--", color=colour, lw=1.2, label=label)
    reference = convergence.reference
    if reference.u_power > 0.0:
        axes.axhline(reference.u_power, color=LOST, lw=1.2, ls=":", label="reference: reported u")
    name = METHODS[reference.method][0]
    axes.set(xlabel="rays traced", ylabel="error and reported u (fraction of the emitted power)")
    axes.set_title(f"simulated, mode {convergence.mode}; errors relative to {name} with {reference.rays:,} rays")
    axes.legend()
    return figure


def rays_figure(views: Sequence[tuple[str, Body, Scene, Trace]], zoom: float | None = None) -> Figure:
    """Draw the rays of several traces, each in a panel with its body.

    Parameters
    ----------
    views
        For each panel: title, body, scene, and a trace that stores its paths.
    zoom
        Half the width, in mm, of the region around emitter and lens that is shown; default: the whole body.
    """
    figure = Figure(figsize=(2.9 * len(views), 6.4 if zoom is None else 3.2))
    for axes, view in zip(np.ravel(figure.subplots(1, len(views))), views, strict=True):
        draw_rays(axes, *view, zoom=zoom)
    figure.suptitle(SIMULATED)
    return figure


def trace_figure(trace: DesignTrace) -> Figure:
    """Draw at most `MAX_RAYS` rays of a design at the trace's angle and in its mode."""
    shown = min(trace.sensor.design.emitter.rays, MAX_RAYS)
    return rays_figure([sensor_view(trace.sensor, trace.value, shown, trace.mode)])


def sensor_view(
    sensor: Sensor, angle_deg: float, rays: int | None = None, mode: Mode = "count"
) -> tuple[str, Body, Scene, Trace]:
    """Return the view of a sensor at an angle for `rays_figure`; by default with counted rays, as in the paper.

    The figure shows the plane: rays of an extruded sensor are also traced in the plane. The reference tracer is used,
    since a few rays do not justify compiling the fast tracer.
    """
    lens = "" if sensor.has_lens else "no lens, "
    unit = sensor.design.motion.unit
    title = f"{lens}{angle_deg:g} {unit}" if unit != "deg" else f"{lens}{angle_deg:+g}°" if angle_deg else f"{lens}0°"
    scene = replace(sensor.scene(angle_deg, rays), extrusion=None, front=None)
    return title, sensor.body(angle_deg), scene, trace_reference(scene, mode, segments=True)


def scene_figure(trace: SceneTrace) -> Figure:
    """Draw a scene file with some of its rays; the view does not include the ends of half-planes.

    Raises
    ------
    OutputError
        If the trace did not store its paths.
    """
    scene, unit = trace.scene, trace.length_unit
    if trace.segments is None:
        raise OutputError("plot", limit="the trace did not store its paths", remedy="trace the scene with paths=True")
    figure = Figure(figsize=(6.4, 5.2))
    axes = figure.add_subplot()
    paths = trace.paths()
    drawn = {*np.linspace(0, trace.rays - 1, min(trace.rays, MAX_RAYS)).astype(int).tolist()}
    paths = [path for path in paths if path.ray in drawn]
    low, high = _extent(scene, paths)
    margin = 0.05 * max(high[0] - low[0], high[1] - low[1])
    escape_mm = 40.0 * margin  # clipped by the axes
    brightest = max((path.power for path in paths), default=1.0)
    colours = [(*mpl.colors.to_rgb(RIGHT), 0.1 + 0.75 * path.power / brightest) for path in paths]
    axes.add_collection(LineCollection([_line(path, escape_mm) for path in paths], colors=colours, linewidths=0.5))
    for interface in scene.interfaces:
        refracting = interface.behaviour == "refracting"
        axes.plot(*interface.curve.flattened(0.01).T, color=LOST if refracting else INK, lw=0.9 if refracting else 1.6)
    for monitor in scene.monitors:
        axes.plot(*zip(monitor.start, monitor.end, strict=True), color=LEFT, lw=1.2, ls="--")
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set(title=f"{SIMULATED}: {scene.name}", xlabel=f"x ({unit})", ylabel=f"z ({unit})")
    axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
    return figure


def _extent(scene: Scene, paths: Sequence[Path]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the lower left and upper right corner of ray origins, monitors and curves, except for half-planes."""
    parts = [path.points_mm[:1] for path in paths if path.parent < 0]
    parts += [np.array([monitor.start, monitor.end]) for monitor in scene.monitors]
    curves = [interface.curve.points(np.linspace(0.0, 1.0, 33)) for interface in scene.interfaces]
    sizes = [float(np.ptp(points, axis=0).max()) for points in curves]
    max_size = 100.0 * float(np.median(sizes)) if len(sizes) > 1 else 1e3
    parts += [points for points, size in zip(curves, sizes, strict=True) if size <= max_size]
    points = np.vstack(parts) if parts else np.array([[0.0, 0.0], [1.0, 1.0]])
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return (low[0], low[1]), (high[0], high[1])


def _positive(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values, with NaN in place of those that are not positive."""
    return np.where(values > 0.0, values, np.nan)


def _response_axes() -> tuple[Figure, Axes, Axes]:
    """Return a figure with axes for the powers and the contrast against the angle."""
    figure = Figure(figsize=(8.2, 3.5))
    power_axes, contrast_axes = figure.subplots(1, 2)
    power_axes.set(xlabel="angle (deg)", ylabel="fraction of the emitted power")
    _contrast_axes(contrast_axes)
    return figure, power_axes, contrast_axes


def _contrast_axes(axes: Axes) -> None:
    axes.set(xlabel="angle (deg)", ylabel="contrast (R − L)/(R + L)", ylim=(-1.05, 1.05))
    for bound in (-SATURATION_CONTRAST, SATURATION_CONTRAST):
        axes.axhline(bound, color=LOST, lw=0.8, ls=":")


def _draw_response(power_axes: Axes, contrast_axes: Axes, case: Case, name: str, style: str) -> None:
    counted, power = case.count, case.curve
    width = 2.0 if style == "-" else 1.2
    for side in ("right", "left"):
        power_axes.plot(
            power.angle_deg, getattr(power, side), style, **receiver(side), lw=width, label=f"{side}, {name}"
        )
        if counted is not None:
            power_axes.plot(counted.angle_deg, getattr(counted, side), ".", color=COLOURS[side], ms=3, alpha=0.6)
    contrast_axes.plot(power.angle_deg, power.contrast, style, color=INK, lw=width, label=name)
    if counted is not None:
        contrast_axes.plot(counted.angle_deg, counted.contrast, ".", color=INK, ms=3, alpha=0.6)


def draw_rays(
    axes: Axes, title: str, body: Body, scene: Scene, trace: Trace, *, zoom: float | None = None, names: bool = True
) -> None:
    """Draw rays in a body, as in `rays_figure`; with ``names``, LED, lens and receivers are labelled."""
    outline = draw_body(axes, body)
    low, high = outline.min(axis=0), outline.max(axis=0)
    escape_mm, colours = 0.12 * float(high[1] - low[1]), colours_of(scene)
    for colour, lines in _coloured(scene, trace, escape_mm, colours).items():
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.45, alpha=0.85, zorder=2))
    faces = {face.name for face in body.all_faces}
    for interface in scene.interfaces:
        if interface.name not in faces or interface.surface is not None:  # pads, mirrors, and walls with a finish
            axes.plot(*interface.curve.flattened().T, color=INK, lw=1.4, ls=(0, (3, 1.5)), zorder=3)
        if interface.receiver is not None:
            curve, colour = interface.curve, colours[interface.receiver]
            axes.plot(*curve.flattened().T, color=colour, lw=3.5, zorder=3)
            if names:
                _label(axes, interface.receiver, curve.middle_point, (0.0, 4.0), colour)
    axes.plot(*body.emitter.point, "o", color=INK, ms=3.5, zorder=4)
    if names:
        _label(axes, "LED", body.emitter.point, (6.0, -9.0), INK)
        for face in body.faces:
            if face.name == "lens" and not isinstance(face.curve, Segment):
                right_end = max(face.curve.start, face.curve.end)
                _label(axes, "lens", right_end, (14.0, 3.0), INK)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set(title=title, xlabel="x (mm)", ylabel="z (mm)")
    if zoom is None:
        axes.set(xlim=(low[0] - 1.5, high[0] + 1.5), ylim=(body.emitter.point[1] - 1.5, high[1] + 1.5))
        return
    base = body.marks["stem-base"]
    axes.set(xlim=(base[0] - zoom, base[0] + zoom), ylim=(body.emitter.point[1] - 0.5, base[1] + zoom))


def draw_body(axes: Axes, body: Body) -> NDArray[np.float64]:
    """Draw the outlines of a body with white holes; return the outer outline."""
    outline = body.outline(1e-3)
    axes.fill(*outline.T, facecolor="#eef3f7", edgecolor=INK, lw=0.8, zorder=1)
    for other in body.others:
        ring = polyline(other, 1e-3)
        axes.fill(*ring.T, facecolor="white" if area(ring) < 0.0 else "#eef3f7", edgecolor=INK, lw=0.8, zorder=1)
    return outline


def _label(axes: Axes, text: str, at: tuple[float, float], offset: tuple[float, float], colour: str) -> None:
    """Write a name next to a part, with a white outline that makes it legible over rays."""
    outline = [withStroke(linewidth=2.0, foreground="white")]
    axes.annotate(
        text, at, xytext=offset, textcoords="offset points", ha="center", color=colour, zorder=5, path_effects=outline
    )


def colours_of(scene: Scene) -> dict[str, str]:
    """Return the colours of the receivers."""
    others = [name for name in scene.receivers if name not in COLOURS]
    return COLOURS | {name: OTHER_COLOURS[i % len(OTHER_COLOURS)] for i, name in enumerate(others)}


def _coloured(
    scene: Scene, trace: Trace, escape_mm: float, colours: dict[str, str]
) -> dict[str, list[NDArray[np.float64]]]:
    """Return ray paths, keyed by colour in drawing order; escaping rays come first and are extended by a length."""
    lines: dict[str, list[NDArray[np.float64]]] = {colour: [] for colour in (LOST, *reversed(colours.values()))}
    for path in trace.paths():
        receiver = scene.interfaces[path.interfaces[-1]].receiver if path.fate == "detected" else None
        lines[LOST if receiver is None else colours[receiver]].append(_line(path, escape_mm))
    return lines


def _line(path: Path, escape_mm: float) -> NDArray[np.float64]:
    """Return the points of a path, extended by a length if the ray escapes."""
    if path.exit_direction is None:
        return path.points_mm
    x, z = path.points_mm[-1]
    return np.vstack([path.points_mm, along((float(x), float(z)), path.exit_direction, escape_mm)])
