"""Figures of a network: its light for each emitter, and its response over each motion."""

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from solen.arrays import FloatArray
from solen.geometry import Body, body_of
from solen.plane import Point, heading
from solen.report import canvas
from solen.report.canvas import INK, LOST, SOFT, SPACE, series
from solen.report.design.figures import MAX_RAYS, colours_of, draw_body, draw_rays, sensor_view
from solen.report.design.table import csv_text
from solen.sensor import Sensor
from solen.sensor.network import NetworkStudy, NetworkTrace
from solen.sensor.network.motions import Determination, Suggestion
from solen.sensor.network.slopes import NetworkSensitivities
from solen.spec.placed import state_of

MAX_COLUMNS = 3
DARK_FRACTION, UNBOUNDED_LENGTH = 0.6, 1.05
"""Fraction above which a cell is dark, and length of a bar for an unbounded value, relative to the longest bar."""
PANEL_ROW_IN, MIN_BODY_IN, MAX_BODY_IN, NAMES_IN = 2.5, 4.2, 5.0, 1.4
"""Row height of the panels, minimum height and maximum width of the body next to them, and space for names, in
inches.
"""
NAME_PT, SIDE_COMPONENT = 6.0, 0.35
"""Distance between a part and its name in points, and the component of the direction to the name above which the name
is aligned to that side.
"""
PANEL_IN, MIN_IN = 3.4, 2.2
"""Width of a ray panel, and its minimum height, in inches."""


def network_rays_figure(trace: NetworkTrace) -> Figure:
    """Draw the rays from every emitter of a network, in a panel for each emitter."""
    return sensors_figure(trace.sensors)


def sensors_figure(sensors: Sequence[Sensor]) -> Figure:
    """Draw at most `MAX_RAYS` rays from every emitter, in a panel for each emitter."""
    columns = min(len(sensors), MAX_COLUMNS)
    rows = math.ceil(len(sensors) / columns)
    low, high = _extent(sensors[0].body())
    high_in = max(MIN_IN, PANEL_IN * float((high[1] - low[1]) / (high[0] - low[0])) + 0.6)
    figure = Figure(figsize=(PANEL_IN * columns, high_in * rows))
    panels = np.ravel(figure.subplots(rows, columns, squeeze=False))
    for axes, sensor in zip(panels, sensors, strict=False):
        rays = min(sensor.design.emitter.rays, MAX_RAYS)
        _, body, scene, traced = sensor_view(sensor, 0.0, rays, sensor.design.trace.mode)
        draw_rays(axes, f"{sensor.design.network.lit} lit", body, scene, traced, names=False)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    for axes in panels[len(sensors) :]:
        axes.set_axis_off()
    colours, names = colours_of(sensors[0].scene()), _receivers(sensors[0])
    lines = [Line2D([], [], color=colours[name], lw=3.0, label=name) for name in names]
    lines.append(Line2D([], [], color=LOST, lw=1.0, label="no receiver"))
    figure.legend(handles=lines, loc="outside lower center", ncols=3)
    figure.suptitle(f"simulated: {sensors[0].design.name}")
    return figure


def network_figure(study: NetworkStudy) -> Figure:
    """Draw the body with named parts, and the powers over each motion for each emitter; without motions, the rays."""
    if not study.sweeps:
        return sensors_figure(study.sensors)
    rows, columns = len(study.sweeps), len(study.at_rest.emitters)
    low, high = _extent(study.sensors[0].body())
    high_in = max(MIN_BODY_IN, PANEL_ROW_IN * rows)
    body_in = (high_in - NAMES_IN) * float((high[0] - low[0]) / (high[1] - low[1]))
    wide_in = NAMES_IN + min(body_in, MAX_BODY_IN)
    figure = Figure(figsize=(wide_in + max(4.6, 2.9 * columns), high_in))
    grid = figure.add_gridspec(1, 2, width_ratios=(wide_in, 2.9 * columns))
    all_colours = colours_of(study.sensors[0].scene())
    _draw_parts(figure.add_subplot(grid[0]), study, all_colours)
    panels = grid[1].subgridspec(rows, columns).subplots(squeeze=False, sharex="row", sharey=True)
    colours = {name: all_colours[name] for name in study.at_rest.receivers}
    for (name, response), row in zip(study.sweeps.items(), panels, strict=True):
        angle = response.angle_deg[:, response.motions.index(name)]
        for number, axes in enumerate(row):
            _draw_curves(axes, angle, response.power[:, number], response.u_power[:, number], colours)
            axes.set(xlabel=f"{name} (deg)", title=f"{response.emitters[number]} lit")
        row[0].set_ylabel("fraction of the emitted power")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    figure.suptitle(f"simulated: {study.design.name}")
    return figure


def _draw_parts(axes: Axes, study: NetworkStudy, colours: dict[str, str]) -> None:
    """Draw the body with named lenses, emitters and receivers, and dotted outlines at the ends of each motion."""
    sensors, body = study.sensors, study.sensors[0].body()
    outline = draw_body(axes, body)
    middle = 0.5 * float(outline[:, 0].min() + outline[:, 0].max())
    for motion in study.design.network.motion:
        for end in (motion.from_deg, motion.to_deg):
            moved = body_of(state_of(study.design, {motion.name: end}), None)
            axes.plot(*moved.outline(1e-2).T, color=LOST, lw=0.7, ls=":", zorder=0)
    for face in (*body.all_faces, *body.separate):
        if face.name.startswith("lens-"):
            axes.plot(*face.curve.flattened().T, color=INK, lw=2.4, zorder=3)
        elif face.part == "receiver":
            axes.plot(*face.curve.flattened().T, color=colours[face.label], lw=3.5, zorder=3)
            outer_end = max((face.curve.start, face.curve.end), key=lambda point: abs(point[0] - middle))
            outward = (math.copysign(1.0, outer_end[0] - middle), 0.0)
            _label(axes, outer_end, outward, face.label, colours[face.label])
    for sensor in sensors:
        pose = sensor.body().emitter
        axes.plot(*pose.point, "o", color=INK, ms=3.5, zorder=4)
        _label(axes, pose.point, heading(pose.axis_deg + 180.0), f"{sensor.design.network.lit} emits", INK)
    axes.set_aspect("equal")
    axes.margins(0.24, 0.06)
    axes.grid(visible=False)
    axes.set(xlabel="x (mm)", ylabel="z (mm)")


def _label(axes: Axes, position: Point, outward: Point, name: str, colour: str) -> None:
    """Write a name next to a position, on the side that faces away from the body."""
    x, z = outward
    axes.annotate(
        name,
        position,
        xytext=(NAME_PT * x, NAME_PT * z),
        textcoords="offset points",
        ha="left" if x > SIDE_COMPONENT else "right" if x < -SIDE_COMPONENT else "center",
        va="bottom" if z > SIDE_COMPONENT else "top" if z < -SIDE_COMPONENT else "center",
        color=colour,
        fontsize="small",
        zorder=5,
    )


def readings_figure(study: NetworkStudy) -> Figure:
    """Draw the readings over each motion with their uncertainties, in a panel for each motion and reading."""
    names, rows = study.at_rest.readings, len(study.sweeps)
    figure = Figure(figsize=(max(4.6, 2.9 * len(names)), 2.5 * rows))
    panels = figure.subplots(rows, len(names), squeeze=False, sharex="row", sharey="col")
    for (motion, response), row in zip(study.sweeps.items(), panels, strict=True):
        angle = response.angle_deg[:, response.motions.index(motion)]
        for number, axes in enumerate(row):
            values, u = response.reading[:, [number]], response.u_reading[:, [number]]
            _draw_curves(axes, angle, values, u, {names[number]: INK})
            axes.set(xlabel=f"{motion} (deg)", title=names[number])
        row[0].set_ylabel("reading")
    figure.suptitle(f"simulated: {study.design.name}")
    return figure


def slopes_figure(result: NetworkSensitivities) -> Figure:
    """Draw the change of every reading, how well the motions are determined, and suggested receivers and emitters.

    Violet is positive and orange is negative. If all keys are motions, changes are per degree, in standard deviations
    of the noise of the reading.
    """
    motions, suggestions = result.by_voltages, result.suggestions
    columns, readings = len(result.keys), len(result.emitters) * len(result.receivers)
    widths, heights = [3.0 + 0.9 * columns], [1.2 + 0.24 * readings]
    if motions is not None:
        widths.append(2.4 + 0.7 * len(motions.motions))
        heights[0] = max(heights[0], 2.4)
    if suggestions:
        heights.append(0.9 + 0.34 * (1 + len(suggestions)))
    figure = Figure(figsize=(max(sum(widths), 6.0 if suggestions else 0.0), sum(heights)))
    grid = figure.add_gridspec(len(heights), len(widths), width_ratios=widths, height_ratios=heights)
    _draw_changes(figure.add_subplot(grid[0, 0]), result)
    if motions is not None:
        _draw_combinations(figure.add_subplot(grid[0, 1]), motions)
    if motions is not None and suggestions:
        _draw_suggestions(figure.add_subplot(grid[1, :]), motions, suggestions)
    figure.suptitle(f"simulated: {result.name}")
    return figure


def _draw_changes(axes: Axes, result: NetworkSensitivities) -> None:
    """Draw the change of each reading: per degree in units of its noise if all keys are motions, otherwise per step."""
    by_noise = result.change_by_noise if all(key.startswith("network.motion") for key in result.keys) else None
    changes = result.slope * result.step[:, None, None] if by_noise is None else by_noise
    changes = changes.reshape(len(result.keys), -1).T
    limit = max(float(np.abs(changes).max()), 1e-12)
    norm = Normalize(-limit, limit) if by_noise is None else SymLogNorm(1.0, vmin=-limit, vmax=limit)
    image = axes.imshow(changes, cmap="PuOr", norm=norm, aspect="auto")
    names = [f"{receiver}, {emitter} lit" for emitter in result.emitters for receiver in result.receivers]
    axes.set_yticks(range(len(names)), names)
    labels = _step_labels(result) if by_noise is None or result.by_voltages is None else result.by_voltages.motions
    axes.set_xticks(range(len(labels)), labels, rotation=30, ha="right")
    axes.grid(visible=False)
    power, noise = "change of the fraction of the emitted power", "change per degree, in units of the reading's noise"
    axes.figure.colorbar(image, label=power if by_noise is None else noise)


def _draw_combinations(axes: Axes, motions: Determination) -> None:
    """Draw the components of each combination of motions, and how well each combination is determined."""
    rows = np.array([list(combination.shares.values()) for combination in motions.combinations])
    axes.imshow(rows, cmap="PuOr", vmin=-1.0, vmax=1.0, aspect="auto")
    for (row, column), component in np.ndenumerate(rows):
        colour = "white" if abs(component) > DARK_FRACTION else INK
        axes.text(column, row, f"{component:+.2f}", ha="center", va="center", color=colour)
    labels = [
        f"standard\ndeviation\n{combination.sd_deg:.2g}°" if combination.is_determined else "not\ndetermined"
        for combination in motions.combinations
    ]
    axes.set_yticks(range(len(labels)), labels)
    axes.set_xticks(range(len(motions.motions)), motions.motions, rotation=30, ha="right")
    axes.grid(visible=False)
    axes.set_title("combinations of motions\nand how well one reading\ndetermines each", fontsize="medium")


def _draw_suggestions(axes: Axes, present: Determination, suggestions: Sequence[Suggestion]) -> None:
    """Draw the largest standard deviation of a motion for the present network and with each suggested part."""
    rows = [("present network", present)]
    rows += [(f"{suggestion.part} at {suggestion.place}", suggestion.by_voltages) for suggestion in suggestions]
    finite = [motions.worst_sd_deg for _, motions in rows if math.isfinite(motions.worst_sd_deg)]
    unbounded = UNBOUNDED_LENGTH * max(finite, default=1.0)
    for row, (name, motions) in enumerate(rows):
        sd = motions.worst_sd_deg
        if math.isfinite(sd):
            axes.barh(row, sd, height=0.3, color=SPACE if row else INK)
            text = f"{sd:.2g}°"
        else:
            axes.barh(row, unbounded, height=0.3, color=SOFT)
            text = f"{motions.rank} of {len(motions.motions)} combinations determined"
        axes.annotate(f"{name}: {text}", (0.0, row), (0, 5), textcoords="offset points", va="bottom")
    axes.set_yticks([])
    axes.set_ylim(len(rows) - 0.5, -1.0)
    axes.grid(visible=False)
    axes.set(xlabel="largest standard deviation of a motion (deg)", xlim=(0.0, unbounded))


def _step_labels(result: NetworkSensitivities) -> list[str]:
    """Return the keys and their steps as short labels for an axis."""
    keys = (key.removeprefix("network.") for key in result.keys)
    return [f"{key} +{step:.3g}" for key, step in zip(keys, result.step.tolist(), strict=True)]


def figures(study: NetworkStudy) -> dict[str, str]:
    """Return the figures of a study as SVG text, keyed by name."""
    draws: dict[str, Callable[[], Figure]] = {"rays": partial(sensors_figure, study.sensors)}
    if study.sweeps:
        draws["response"] = partial(network_figure, study)
    if study.sweeps and study.at_rest.readings:
        draws["readings"] = partial(readings_figure, study)
    return {name: canvas.svg(canvas.drawn(draw), name) for name, draw in draws.items()}


def csv_table(study: NetworkStudy) -> str:
    """Return a CSV table with a row for each state, emitter and receiver; undefined readings are empty."""
    reading_heads = [head for name in study.at_rest.readings for head in (name, f"u_{name}")]
    motions = (f"{name}_deg" for name in study.at_rest.motions)
    rows: list[list[str | float]] = []
    for response in (study.at_rest, *study.sweeps.values()):
        for state, angles in enumerate(response.angle_deg.tolist()):
            readings = np.stack([response.reading[state], response.u_reading[state]], axis=1).ravel().tolist()
            for i, emitter in enumerate(response.emitters):
                for k, receiver in enumerate(response.receivers):
                    powers = (response.power[state, i, k], response.u_power[state, i, k])
                    rows.append([*angles, emitter, receiver, *powers, *readings])
    return csv_text([*motions, "emitter", "receiver", "power", "u_power", *reading_heads], rows)


def _draw_curves(axes: Axes, angle: FloatArray, values: FloatArray, u: FloatArray, colours: dict[str, str]) -> None:
    """Draw columns of values against the angle, with their uncertainties as bands."""
    for number, (name, colour) in enumerate(colours.items()):
        value, half = values[:, number], np.nan_to_num(u[:, number])
        axes.plot(angle, value, **(series(number) | {"color": colour}), lw=1.6, label=name)
        axes.fill_between(angle, value - half, value + half, color=colour, alpha=0.3, lw=0)
    axes.axvline(0.0, color=INK, lw=0.5)


def _receivers(sensor: Sensor) -> list[str]:
    return [placed.name for placed in sensor.design.network.receivers]


def _extent(body: Body) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and largest x and z of a body and its emitter, with a margin."""
    points = np.vstack([body.outline(1e-2), [body.emitter.point]])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.06 * float((high - low).max())
    return low - margin, high + margin
