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
from solen.report.design.figures import SHOWN_RAYS, colours_of, draw_body, draw_rays, sensor_view
from solen.report.design.table import csv_text
from solen.sensor import Sensor
from solen.sensor.network import NetworkStudy, NetworkTrace
from solen.sensor.network.motions import Determination, Suggestion
from solen.sensor.network.slopes import NetworkSensitivities
from solen.spec.placed import state_of

MAX_COLUMNS = 3
DARK, BEYOND = 0.6, 1.05
"""Fraction above which a cell is dark, and the relative length of a bar without an end."""
PANEL_ROW_IN, MIN_BODY_IN, MAX_BODY_IN, NAMES_IN = 2.5, 4.2, 5.0, 1.4
"""Row height of the panels, minimum height and maximum width of the body next to them, and space for names, in
inches.
"""
NAME_PT, ACROSS = 6.0, 0.35
"""Distance between a name and its position, and the component of a direction above which it counts as being to that
side.
"""
PANEL_IN, MIN_IN = 3.4, 2.2
"""Width of a ray panel, and its minimum height, in inches."""


def rays_in_turn(trace: NetworkTrace) -> Figure:
    """Draw the rays from every emitter of a network, each in its own panel."""
    return rays_of(trace.sensors)


def rays_of(sensors: Sequence[Sensor]) -> Figure:
    """Draw at most `SHOWN_RAYS` rays from every emitter, each in its own panel."""
    columns = min(len(sensors), MAX_COLUMNS)
    rows = math.ceil(len(sensors) / columns)
    low, high = _extent(sensors[0].body())
    high_in = max(MIN_IN, PANEL_IN * float((high[1] - low[1]) / (high[0] - low[0])) + 0.6)
    figure = Figure(figsize=(PANEL_IN * columns, high_in * rows))
    panels = np.ravel(figure.subplots(rows, columns, squeeze=False))
    for axes, sensor in zip(panels, sensors, strict=False):
        shown = min(sensor.design.emitter.rays, SHOWN_RAYS)
        _, body, scene, traced = sensor_view(sensor, 0.0, shown, sensor.design.trace.mode)
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
    """Draw the body with named parts, and each receiver's light by motion and emitter, or the rays if nothing moves."""
    if not study.sweeps:
        return rays_of(study.sensors)
    rows, columns = len(study.sweeps), len(study.at_rest.emitters)
    low, high = _extent(study.sensors[0].body())
    high_in = max(MIN_BODY_IN, PANEL_ROW_IN * rows)
    across = (high_in - NAMES_IN) * float((high[0] - low[0]) / (high[1] - low[1]))
    wide_in = NAMES_IN + min(across, MAX_BODY_IN)
    figure = Figure(figsize=(wide_in + max(4.6, 2.9 * columns), high_in))
    grid = figure.add_gridspec(1, 2, width_ratios=(wide_in, 2.9 * columns))
    every = colours_of(study.sensors[0].scene())
    _draw_parts(figure.add_subplot(grid[0]), study, every)
    panels = grid[1].subgridspec(rows, columns).subplots(squeeze=False, sharex="row", sharey=True)
    colours = {name: every[name] for name in study.at_rest.receivers}
    for (name, response), line in zip(study.sweeps.items(), panels, strict=True):
        angle = response.angle_deg[:, response.motions.index(name)]
        for number, axes in enumerate(line):
            _draw_powers(axes, angle, response.power[:, number], response.u_power[:, number], colours)
            axes.set(xlabel=f"{name} (deg)", title=f"{response.emitters[number]} lit")
        line[0].set_ylabel("fraction of its power")
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
            place = max((face.curve.start, face.curve.end), key=lambda point: abs(point[0] - middle))
            _name_beside(axes, place, (math.copysign(1.0, place[0] - middle), 0.0), face.label, colours[face.label])
    for sensor in sensors:
        pose = sensor.body().emitter
        axes.plot(*pose.point, "o", color=INK, ms=3.5, zorder=4)
        _name_beside(axes, pose.point, heading(pose.axis_deg + 180.0), f"{sensor.design.network.lit} emits", INK)
    axes.set_aspect("equal")
    axes.margins(0.24, 0.06)
    axes.grid(visible=False)
    axes.set(xlabel="x (mm)", ylabel="z (mm)")


def _name_beside(axes: Axes, place: Point, away: Point, name: str, colour: str) -> None:
    """Write a name next to a position, on the side away from the body."""
    x, z = away
    axes.annotate(
        name,
        place,
        xytext=(NAME_PT * x, NAME_PT * z),
        textcoords="offset points",
        ha="left" if x > ACROSS else "right" if x < -ACROSS else "center",
        va="bottom" if z > ACROSS else "top" if z < -ACROSS else "center",
        color=colour,
        fontsize="small",
        zorder=5,
    )


def readings_figure(study: NetworkStudy) -> Figure:
    """Draw the readings over each motion with their uncertainties, in a panel for each motion and reading."""
    names, rows = study.at_rest.readings, len(study.sweeps)
    figure = Figure(figsize=(max(4.6, 2.9 * len(names)), 2.5 * rows))
    panels = figure.subplots(rows, len(names), squeeze=False, sharex="row", sharey="col")
    for (motion, response), line in zip(study.sweeps.items(), panels, strict=True):
        angle = response.angle_deg[:, response.motions.index(motion)]
        for number, axes in enumerate(line):
            one = slice(number, number + 1)
            _draw_powers(axes, angle, response.reading[:, one], response.u_reading[:, one], {names[number]: INK})
            axes.set(xlabel=f"{motion} (deg)", title=names[number])
        line[0].set_ylabel("reading")
    figure.suptitle(f"simulated: {study.design.name}")
    return figure


def slopes_figure(result: NetworkSensitivities) -> Figure:
    """Draw the derivatives of every reading, how well motions are determined, and where more readings would help.

    Violet is positive and orange is negative. If there are only motions, values are per degree, in standard deviations
    of the reading noise.
    """
    found, tried = result.by_voltages, result.suggestions
    columns, many = len(result.keys), len(result.emitters) * len(result.receivers)
    widths = [3.0 + 0.9 * columns, *([2.4 + 0.7 * len(found.motions)] if found else [])]
    heights = [max(1.2 + 0.24 * many, 2.4 if found else 0.0), *([0.9 + 0.34 * (1 + len(tried))] if tried else [])]
    figure = Figure(figsize=(max(sum(widths), 6.0 if tried else 0.0), sum(heights)))
    grid = figure.add_gridspec(len(heights), len(widths), width_ratios=widths, height_ratios=heights)
    _draw_changes(figure.add_subplot(grid[0, 0]), result)
    if found is not None:
        _draw_combinations(figure.add_subplot(grid[0, 1]), found)
    if found is not None and tried:
        _draw_suggestions(figure.add_subplot(grid[1, :]), found, tried)
    figure.suptitle(f"simulated: {result.name}")
    return figure


def _draw_changes(axes: Axes, result: NetworkSensitivities) -> None:
    """Draw each reading's change: per degree in units of its noise for motions alone, otherwise per step."""
    by_noise = result.change_by_noise if all(key.startswith("network.motion") for key in result.keys) else None
    found = result.slope * result.step[:, None, None] if by_noise is None else by_noise
    changes = found.reshape(len(result.keys), -1).T
    most = max(float(np.abs(changes).max()), 1e-12)
    norm = Normalize(-most, most) if by_noise is None else SymLogNorm(1.0, vmin=-most, vmax=most)
    shown = axes.imshow(changes, cmap="PuOr", norm=norm, aspect="auto")
    names = [f"{receiver}, {emitter} lit" for emitter in result.emitters for receiver in result.receivers]
    axes.set_yticks(range(len(names)), names)
    labels = _numbers(result) if by_noise is None or result.by_voltages is None else result.by_voltages.motions
    axes.set_xticks(range(len(labels)), labels, rotation=30, ha="right")
    axes.grid(visible=False)
    what = (
        "change of the fraction of the emitted power"
        if by_noise is None
        else "change per degree, in standard deviations of the reading's noise"
    )
    axes.figure.colorbar(shown, label=what)


def _draw_combinations(axes: Axes, found: Determination) -> None:
    """Draw the fraction of each motion in each combination, and how well each combination is determined."""
    rows = np.array([list(combination.shares.values()) for combination in found.combinations])
    axes.imshow(rows, cmap="PuOr", vmin=-1.0, vmax=1.0, aspect="auto")
    for (row, column), share in np.ndenumerate(rows):
        colour = "white" if abs(share) > DARK else INK
        axes.text(column, row, f"{share:+.2f}", ha="center", va="center", color=colour)
    sds = [
        f"standard\ndeviation\n{combination.sd_deg:.2g}°" if combination.is_determined else "not\ndetermined"
        for combination in found.combinations
    ]
    axes.set_yticks(range(len(sds)), sds)
    axes.set_xticks(range(len(found.motions)), found.motions, rotation=30, ha="right")
    axes.grid(visible=False)
    axes.set_title("combinations of motions\nand how well one reading\ndetermines each", fontsize="medium")


def _draw_suggestions(axes: Axes, now: Determination, tried: Sequence[Suggestion]) -> None:
    """Draw the largest standard deviation of any motion for the present network and with each suggested part."""
    rows = [("as it is", now), *((f"{one.part} at {one.place}", one.by_voltages) for one in tried)]
    most = max((found.worst_sd_deg for _, found in rows if math.isfinite(found.worst_sd_deg)), default=1.0)
    for place, (name, found) in enumerate(rows):
        sd = found.worst_sd_deg
        known = math.isfinite(sd)
        colour = (INK if place == 0 else SPACE) if known else SOFT
        axes.barh(place, sd if known else BEYOND * most, height=0.3, color=colour)
        text = f"{sd:.2g}°" if known else f"{found.rank} of {len(found.motions)} combinations determined"
        axes.annotate(f"{name}: {text}", (0.0, place), (0, 5), textcoords="offset points", va="bottom")
    axes.set_yticks([])
    axes.set_ylim(len(rows) - 0.5, -1.0)
    axes.grid(visible=False)
    axes.set(xlabel="largest standard deviation of a motion (deg)", xlim=(0.0, BEYOND * most))


def _numbers(result: NetworkSensitivities) -> list[str]:
    """Return the keys and their steps as text short enough for an axis."""
    short = (key.removeprefix("network.") for key in result.keys)
    return [f"{key} +{step:.3g}" for key, step in zip(short, result.step.tolist(), strict=True)]


def figures(study: NetworkStudy) -> dict[str, str]:
    """Return a study's figures as SVG text, by name."""
    draws: dict[str, Callable[[], Figure]] = {"rays": partial(rays_of, study.sensors)}
    if study.sweeps:
        draws["response"] = partial(network_figure, study)
    if study.sweeps and study.at_rest.readings:
        draws["readings"] = partial(readings_figure, study)
    return {name: canvas.svg(canvas.drawn(draw), name) for name, draw in draws.items()}


def csv_table(study: NetworkStudy) -> str:
    """Return a CSV table with a row for each state, emitter and receiver; readings without a value are empty."""
    heads = [text for name in study.at_rest.readings for text in (name, f"u_{name}")]
    motions = (f"{name}_deg" for name in study.at_rest.motions)
    rows: list[list[str | float]] = []
    for response in (study.at_rest, *study.sweeps.values()):
        for state, angles in enumerate(response.angle_deg.tolist()):
            readings = np.stack([response.reading[state], response.u_reading[state]], axis=1).ravel().tolist()
            for i, emitter in enumerate(response.emitters):
                for k, receiver in enumerate(response.receivers):
                    numbers = (response.power[state, i, k], response.u_power[state, i, k])
                    rows.append([*angles, emitter, receiver, *numbers, *readings])
    return csv_text([*motions, "emitter", "receiver", "power", "u_power", *heads], rows)


def _draw_powers(
    axes: Axes, angle: FloatArray, power: FloatArray, u_power: FloatArray, colours: dict[str, str]
) -> None:
    for number, (name, colour) in enumerate(colours.items()):
        look = series(number) | {"color": colour}
        axes.plot(angle, power[:, number], **look, lw=1.6, label=name)
        half = np.nan_to_num(u_power[:, number])
        axes.fill_between(angle, power[:, number] - half, power[:, number] + half, color=look["color"], alpha=0.3, lw=0)
    axes.axvline(0.0, color=INK, lw=0.5)


def _receivers(sensor: Sensor) -> list[str]:
    return [placed.name for placed in sensor.design.network.receivers]


def _extent(body: Body) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and largest x and z of a body and its emitter, with a margin."""
    points = np.vstack([body.outline(1e-2), [body.emitter.point]])
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.06 * float((high - low).max())
    return low - room, high + room
