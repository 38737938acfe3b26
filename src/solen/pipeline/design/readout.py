"""Receiver voltages over the motion of a design, with noise, resolution and a recommended load."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from solen.pipeline.design.designs import open_design, provenance_of
from solen.pipeline.options import FLAT, Out, ProgressBar, Set
from solen.pipeline.outputs import check_outputs, write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor
from solen.sensor.network.volts import NetworkVolts, network_volts
from solen.sensor.readings import DesignReadings, design_readings


def readout(
    file: Path,
    /,
    *,
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
    progress: ProgressBar = None,
) -> Outcome[DesignReadings | NetworkVolts]:
    """Show the receiver voltages of a design over its motion, with noise, and recommend a load.

    For a network of guides, show the voltages over each motion, with the emitters lit in turn.

    Parameters
    ----------
    file
        The design file; its table [readout] describes the circuit.
    """
    check_outputs(out, figure)
    sensor = Sensor.of(open_design(file, set_))
    if sensor.is_network:
        volts = replace(network_volts(sensor.design, progress), sources=(provenance_of(file),))
        return write(volts, "readout", out, figure=figure)
    readings = design_readings(sensor, progress)
    readings = replace(readings, sources=(provenance_of(file),))
    return write(readings, "readout", out, figure=figure)
