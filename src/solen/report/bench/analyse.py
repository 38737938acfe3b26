"""Sensor responses: voltage against angle, as in the paper's figure 4D.

The half-cycles used are thin lines, and their mean is a thick line in a band of one standard deviation. In a panel for
a single sensor, right is blue and left is orange; in a shared panel each sensor has a colour, right is solid and left
is dashed.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis import SensorResponse, Study
from solen.recording.column_roles import side_of
from solen.report.canvas import LOST, SERIES, receiver

_MAX_COLUMNS = 4
_MAX_LINES = 60  # half-cycles drawn in a panel


def study_figure(study: Study) -> Figure:
    """Draw a panel for each sensor, all to the same scale; with several sensors, add a panel that shows all of them."""
    sensors = list(study.sensors.values())
    panels = len(sensors) + (len(sensors) > 1)
    columns = 3 if panels in {5, 6} else min(panels, _MAX_COLUMNS)
    rows = -(-panels // columns)
    figure = Figure(figsize=(3.3 * columns + 0.6, 3.2 * rows + 0.3))
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    for sensor, panel in zip(sensors, axes, strict=False):
        _draw_sensor(panel, sensor)
    if len(sensors) > 1:
        _draw_all(axes[len(sensors)], sensors)
    for empty in axes[panels:]:
        empty.set_visible(False)
    for index, panel in enumerate(axes[:panels]):
        panel.set_xlabel(study.stimulus.label)
        if index % columns == 0:
            panel.set_ylabel(label_of(study.unit))
    add_title(figure, study.simulated, study.smoothing)
    return figure


def label_of(unit: str) -> str:
    """Return the axis label for receiver values."""
    return "voltage (V)" if unit == "V" else f"signal ({unit})"


def add_title(figure: Figure, simulated: bool, *notes: str) -> None:
    """Add a title to a figure if its data are simulated or were filtered."""
    title = "; ".join(filter(None, ("simulated data" if simulated else "", *notes)))
    if title:
        figure.suptitle(title, color=LOST)


def title_of(response: SensorResponse) -> str:
    """Return the sensor's name, and whether it has a lens."""
    return response.label + {None: "", True: ", lens", False: ", no lens"}[response.lens]


def _draw_sensor(axes: Axes, response: SensorResponse) -> None:
    angle = response.passes.angle_deg
    for index, (name, curve) in enumerate(response.receivers.items()):
        style = receiver(name, index)
        colour = style["color"]
        half_cycles = response.passes.volts[..., index].reshape(-1, angle.size)
        every = max(1, len(half_cycles) // _MAX_LINES)
        axes.plot(angle, half_cycles[::every].T, color=colour, lw=0.4, alpha=0.3)
        axes.fill_between(angle, curve.mean_V - curve.sd_V, curve.mean_V + curve.sd_V, color=colour, alpha=0.25, lw=0)
        axes.plot(angle, curve.mean_V, **style, lw=1.8, label=name)
    count = response.passes.cycles
    axes.set_title(f"{title_of(response)} ({count} cycle{'s' * (count != 1)}, ± SD)", loc="left")
    axes.legend()


def _draw_all(axes: Axes, sensors: Sequence[SensorResponse]) -> None:
    """Draw the mean curves of all sensors with bands, in grey for sensors without a lens."""
    with_lens = [sensor for sensor in sensors if sensor.lens is not False]
    for sensor in sensors:
        colour = LOST if sensor.lens is False else SERIES[with_lens.index(sensor) % len(SERIES)]
        for name, curve in sensor.receivers.items():
            dashes = "--" if side_of(name) == "left" else "-"
            low, high = curve.mean_V - curve.sd_V, curve.mean_V + curve.sd_V
            axes.fill_between(curve.angle_deg, low, high, color=colour, alpha=0.2, lw=0)
            axes.plot(curve.angle_deg, curve.mean_V, dashes, color=colour, lw=1.4)
        axes.plot(np.nan, np.nan, color=colour, label=title_of(sensor))
    axes.set_title("all: right solid, left dashed", loc="left")
    axes.legend()
