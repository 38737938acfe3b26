"""Sensor responses: voltage against angle, as in the paper's figure 4D.

Each half-cycle that is used is drawn as a faint line, and the mean as a strong line within a band of one standard
deviation. In a panel for a single sensor, right is blue and left is orange; in a shared panel each sensor has a colour,
right is solid and left is dashed.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis import SensorResponse, Study
from solen.recording.column_roles import side_of
from solen.report.canvas import LOST, SERIES, receiver

_ACROSS = 4
_SHOWN = 60  # half-cycles that are drawn individually


def study_figure(study: Study) -> Figure:
    """Draw a panel for each sensor, all to the same scale; with several sensors, add a panel that shows all of them."""
    sensors = list(study.sensors.values())
    panels = len(sensors) + (len(sensors) > 1)
    across = 3 if panels in {5, 6} else min(panels, _ACROSS)
    down = -(-panels // across)
    figure = Figure(figsize=(3.3 * across + 0.6, 3.2 * down + 0.3))
    axes = figure.subplots(down, across, squeeze=False, sharey=True).ravel()
    for sensor, panel in zip(sensors, axes, strict=False):
        _draw_sensor(panel, sensor)
    if len(sensors) > 1:
        _draw_all(axes[len(sensors)], sensors, beside=panels % across > 0)
    for empty in axes[panels:]:
        empty.set_visible(False)
    for number, panel in enumerate(axes[:panels]):
        panel.set_xlabel(study.stimulus.label)
        if number % across == 0:
            panel.set_ylabel(label_of(study.unit))
    state_origin(figure, study.simulated, study.remark)
    return figure


def label_of(unit: str) -> str:
    """Return the axis label for receiver values."""
    return "voltage (V)" if unit == "V" else f"signal ({unit})"


def state_origin(figure: Figure, simulated: bool, *remarks: str) -> None:
    """Return a figure title that says whether the data are simulated and how they were processed."""
    title = "; ".join(filter(None, ("simulated data" if simulated else "", *remarks)))
    if title:
        figure.suptitle(title, color=LOST)


def title_of(response: SensorResponse) -> str:
    """Return the sensor's name and lens."""
    return response.label + {None: "", True: ", lens", False: ", no lens"}[response.lens]


def _draw_sensor(axes: Axes, response: SensorResponse) -> None:
    angle = response.passes.angle_deg
    for place, (name, one) in enumerate(response.receivers.items()):
        look = receiver(name, place)
        colour = look["color"]
        ways = response.passes.volts[..., place].reshape(-1, angle.size)
        every = max(1, len(ways) // _SHOWN)
        axes.plot(angle, ways[::every].T, color=colour, lw=0.4, alpha=0.3)
        axes.fill_between(angle, one.mean_V - one.sd_V, one.mean_V + one.sd_V, color=colour, alpha=0.25, lw=0)
        axes.plot(angle, one.mean_V, **look, lw=1.8, label=name)
    count = response.passes.cycles
    axes.set_title(f"{title_of(response)} ({count} cycle{'s' * (count != 1)}, ± SD)", loc="left")
    axes.legend()


def _draw_all(axes: Axes, sensors: Sequence[SensorResponse], *, beside: bool) -> None:
    """Draw the mean curves of all sensors with bands, in grey without a lens, and a legend next to them if it fits."""
    with_lens = [sensor for sensor in sensors if sensor.lens is not False]
    for sensor in sensors:
        plain = sensor.lens is False
        colour = LOST if plain else SERIES[with_lens.index(sensor) % len(SERIES)]
        for name, one in sensor.receivers.items():
            angle = one.angle_deg
            dashes = "--" if side_of(name) == "left" else "-"
            low, high = one.mean_V - one.sd_V, one.mean_V + one.sd_V
            axes.fill_between(angle, low, high, color=colour, alpha=0.2, lw=0)
            axes.plot(angle, one.mean_V, dashes, color=colour, lw=1.4)
        axes.plot(np.nan, np.nan, color=colour, label=title_of(sensor))
    axes.set_title("all: right solid, left dashed", loc="left")
    if beside:
        axes.legend()
    else:
        axes.legend()
