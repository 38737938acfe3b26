"""The figure of a readout: voltage over the motion with the spread of parts, and the resolution of the angle."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from solen.report.canvas import INK, LOST, receiver
from solen.sensor.readings import DesignReadings


def readout_figure(readings: DesignReadings) -> Figure:
    """Volts on the left, resolution on the right; marked as simulated."""
    figure = Figure(figsize=(8.2, 3.7))
    volts_axes, angle_axes = figure.subplots(1, 2)
    _volts(volts_axes, readings)
    _resolution(angle_axes, readings)
    figure.suptitle(f"simulated: {readings.name}")
    return figure


def _volts(axes: Axes, readings: DesignReadings) -> None:
    angle, circuit = readings.angle_deg, readings.circuit
    for place, name in enumerate(circuit.names):
        low, high = (readings.voltage_by_case_V[case][:, place] for case in ("brightest", "dimmest"))
        axes.fill_between(angle, low, high, color=receiver(name)["color"], alpha=0.13, lw=0)
        noise = f"{1e3 * float(np.median(readings.noise.reading_V[:, place])):.2g} mV"
        axes.plot(angle, readings.voltage_V[:, place], **receiver(name), lw=1.6, label=f"{name}, noise {noise}")
    axes.axhline(circuit.supply_V, color=LOST, lw=0.8, ls=":")
    axes.axhline(readings.advice.target_V, color=LOST, lw=0.8, ls="--", label="saturates below")
    load = f"{circuit.load_ohm[0]:g} Ω, {circuit.supply_V:g} V, emitter {circuit.drive.current_mA:g} mA"
    axes.set(xlabel="angle (deg)", ylabel="volts (brighter is lower)", ylim=(0.0, 1.26 * circuit.supply_V))
    axes.set_title(f"{load}; bands: dimmest to brightest parts")
    axes.legend()


def _resolution(axes: Axes, readings: DesignReadings) -> None:
    for place, name in enumerate(readings.circuit.names):
        axes.plot(readings.angle_deg, readings.resolution_deg[:, place], **receiver(name), lw=1.2, label=name)
    axes.plot(readings.angle_deg, readings.resolution_of_all_deg, color=INK, lw=1.6, label="both")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set(xlabel="angle (deg)", ylabel="resolution of one reading (deg, 1 σ)")
    axes.set_title("electronic noise alone, ambient light subtracted")
    axes.legend()
