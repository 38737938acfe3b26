"""Figures of a network: its light, emitter by emitter, and its response over each of its motions."""

import csv
import io
import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from solen.arrays import FloatArray
from solen.geometry import Body
from solen.report import canvas
from solen.report.canvas import INK, LOST, series
from solen.report.design.figures import SHOWN_RAYS, colours_of, draw_rays, sensor_view
from solen.sensor import Sensor
from solen.sensor.network import NetworkStudy, NetworkTrace
from solen.sensor.network.slopes import NetworkSensitivities

MOST_COLUMNS = 3
PANEL_IN, LEAST_IN = 3.4, 2.2
"""Width of a panel with rays, and its least height, in inches."""


def rays_in_turn(trace: NetworkTrace) -> Figure:
    """Rays of every emitter of a network, a panel each."""
    return rays_of(trace.sensors)


def rays_of(sensors: Sequence[Sensor]) -> Figure:
    """At most `SHOWN_RAYS` rays of every emitter, a panel each."""
    columns = min(len(sensors), MOST_COLUMNS)
    rows = math.ceil(len(sensors) / columns)
    low, high = _extent(sensors[0].body())
    high_in = max(LEAST_IN, PANEL_IN * float((high[1] - low[1]) / (high[0] - low[0])) + 0.6)
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
    return figure


def network_figure(study: NetworkStudy) -> Figure:
    """Response over each motion, a panel for each motion and emitter: what every receiver gets; without one, rays."""
    if not study.sweeps:
        return rays_of(study.sensors)
    rows, columns = len(study.sweeps), len(study.at_rest.emitters)
    figure = Figure(figsize=(max(4.6, 2.9 * columns), 2.5 * rows))
    panels = figure.subplots(rows, columns, squeeze=False, sharex="row", sharey=True)
    every = colours_of(study.sensors[0].scene())
    colours = {name: every[name] for name in study.at_rest.receivers}
    for (name, response), line in zip(study.sweeps.items(), panels, strict=True):
        angle = response.angle_deg[:, response.motions.index(name)]
        for number, axes in enumerate(line):
            _draw_powers(axes, angle, response.power[:, number], response.u_power[:, number], colours)
            axes.set(xlabel=f"{name} (deg)", title=f"{response.emitters[number]} lit")
        line[0].set_ylabel("share of its power")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def readings_figure(study: NetworkStudy) -> Figure:
    """Readings over each motion, a panel for each motion and reading, with their uncertainties."""
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
    return figure


def slopes_figure(result: NetworkSensitivities) -> Figure:
    """Change of every power with every number off by its step, as a table of colours: violet more, orange less."""
    changes = (result.slope * result.step[:, None, None]).reshape(len(result.keys), -1).T
    names = [f"{receiver}, {emitter} lit" for emitter in result.emitters for receiver in result.receivers]
    figure = Figure(figsize=(3.0 + 0.9 * len(result.keys), 1.2 + 0.24 * len(names)))
    axes = figure.add_subplot()
    most = max(float(np.abs(changes).max()), 1e-12)
    shown = axes.imshow(changes, cmap="PuOr", vmin=-most, vmax=most, aspect="auto")
    axes.set_yticks(range(len(names)), names)
    axes.set_xticks(range(len(result.keys)), _numbers(result), rotation=30, ha="right")
    axes.grid(visible=False)
    figure.colorbar(shown, label="change of the share of the emitted power")
    return figure


def _numbers(result: NetworkSensitivities) -> list[str]:
    """Keys with their steps, short enough for an axis."""
    short = (key.removeprefix("network.") for key in result.keys)
    return [f"{key} +{step:.3g}" for key, step in zip(short, result.step.tolist(), strict=True)]


def figures(study: NetworkStudy) -> dict[str, str]:
    """Figures of a study as SVG text, by name."""
    draws: dict[str, Callable[[], Figure]] = {"rays": partial(rays_of, study.sensors)}
    if study.sweeps:
        draws["response"] = partial(network_figure, study)
    if study.sweeps and study.at_rest.readings:
        draws["readings"] = partial(readings_figure, study)
    return {name: canvas.svg(canvas.drawn(draw), name) for name, draw in draws.items()}


def csv_table(study: NetworkStudy) -> str:
    """One row for each state, emitter and receiver; readings are those of the state, empty where one has no value."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heads = [text for name in study.at_rest.readings for text in (name, f"u_{name}")]
    motions = (f"{name}_deg" for name in study.at_rest.motions)
    writer.writerow([*motions, "emitter", "receiver", "power", "u_power", *heads])
    for response in (study.at_rest, *study.sweeps.values()):
        for state, angles in enumerate(response.angle_deg.tolist()):
            pairs = np.stack([response.reading[state], response.u_reading[state]], axis=1)
            readings = ["" if math.isnan(number) else repr(number) for number in pairs.ravel().tolist()]
            for i, emitter in enumerate(response.emitters):
                for k, receiver in enumerate(response.receivers):
                    numbers = (float(response.power[state, i, k]), float(response.u_power[state, i, k]))
                    writer.writerow([*angles, emitter, receiver, *map(repr, numbers), *readings])
    return text.getvalue()


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
    """Least and greatest x and z of a body and its emitter, with some room."""
    points = np.vstack([body.outline(1e-2), [body.emitter.point]])
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.06 * float((high - low).max())
    return low - room, high + room
