"""The readout figure: voltage over the motion with the spread between components, and angular resolution."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from solen.errors import SpecError
from solen.report.canvas import INK, LOST, receiver, series
from solen.sensor.network.volts import MotionVolts, NetworkVolts
from solen.sensor.readings import DesignReadings


def readout_figure(readings: DesignReadings) -> Figure:
    """Draw voltage on the left and resolution on the right, marked as simulated."""
    figure = Figure(figsize=(8.2, 3.7))
    volts_axes, angle_axes = figure.subplots(1, 2)
    _volts(volts_axes, readings)
    _resolution(angle_axes, readings)
    figure.suptitle(f"simulated: {readings.name}")
    return figure


def network_volts_figure(volts: NetworkVolts) -> Figure:
    """Draw voltages over each motion in a panel for each emitter, and the resolution of each motion alone."""
    rest, count = volts.at_rest, len(volts.by_motion)
    if not count:
        raise SpecError("network.motion", limit="is missing: no motion can be drawn", remedy="add [[network.motion]]")
    rows = len(rest.emitters) + 1
    figure = Figure(figsize=(max(4.6, 3.4 * count), 2.1 * rows + 0.7))
    panels = figure.subplots(rows, count, squeeze=False, sharex="col", sharey="row")
    for column, (name, motion) in zip(panels.T, volts.by_motion.items(), strict=True):
        for number, axes in enumerate(column[:-1]):
            _network_volts(axes, volts, motion, number)
        axes = column[-1]
        for number, emitter in enumerate(rest.emitters):
            axes.plot(motion.angle_deg, motion.resolution_deg[:, number], **series(number), label=f"{emitter} lit")
        axes.plot(motion.angle_deg, motion.resolution_of_all_deg, color=INK, lw=1.6, label="all")
        _scale_resolution(axes)
        axes.set_xlabel(f"{name} (deg)")
    for emitter, axes in zip(rest.emitters, panels[:, 0], strict=False):
        axes.set_ylabel(f"voltage (V), {emitter} lit")
    panels[-1, 0].set_ylabel("resolution (deg)")
    panels[-1, 0].legend()
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    figure.suptitle(f"simulated: {volts.name}")
    return figure


def _network_volts(axes: Axes, volts: NetworkVolts, motion: MotionVolts, emitter: int) -> None:
    for k, name in enumerate(volts.at_rest.receivers):
        axes.plot(motion.angle_deg, motion.signals.voltage_V[:, emitter, k], **series(k), lw=1.5, label=name)
    axes.axhline(volts.advice.target_V, color=LOST, lw=0.8, ls="--", label="saturates below")
    axes.set_ylim(0.0, 1.05 * volts.circuits[0].supply_V)


def _volts(axes: Axes, readings: DesignReadings) -> None:
    angle, circuit = readings.angle_deg, readings.circuit
    for k, name in enumerate(circuit.names):
        low, high = (readings.voltage_by_case_V[case][:, k] for case in ("brightest", "dimmest"))
        axes.fill_between(angle, low, high, color=receiver(name)["color"], alpha=0.13, lw=0)
        noise = f"{1e3 * float(np.median(readings.noise.reading_V[:, k])):.2g} mV"
        axes.plot(angle, readings.voltage_V[:, k], **receiver(name), lw=1.6, label=f"{name}, noise {noise}")
    axes.axhline(circuit.supply_V, color=LOST, lw=0.8, ls=":")
    axes.axhline(readings.advice.target_V, color=LOST, lw=0.8, ls="--", label="saturates below")
    load = f"{circuit.load_ohm[0]:g} Ω, {circuit.supply_V:g} V, emitter {circuit.drive.current_mA:g} mA"
    axes.set(xlabel="angle (deg)", ylabel="voltage (V), lower if brighter", ylim=(0.0, 1.26 * circuit.supply_V))
    axes.set_title(f"{load}; bands: dimmest to brightest parts")
    axes.legend()


def _resolution(axes: Axes, readings: DesignReadings) -> None:
    for k, name in enumerate(readings.circuit.names):
        axes.plot(readings.angle_deg, readings.resolution_deg[:, k], **receiver(name), lw=1.2, label=name)
    axes.plot(readings.angle_deg, readings.resolution_of_all_deg, color=INK, lw=1.6, label="both")
    _scale_resolution(axes)
    axes.set(xlabel="angle (deg)", ylabel="resolution of one reading (deg, 1 σ)")
    axes.set_title("electronic noise alone, ambient light subtracted")
    axes.legend()


def _scale_resolution(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
