"""Voltages of a design's receivers over its motion, with noise, resolution and advice on the load."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from solen.arrays import Progress
from solen.pipeline.design.designs import open_design, provenance_of
from solen.pipeline.outputs import check_outputs, write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor
from solen.sensor.readings import DesignReadings, design_readings


def readout(
    path: Path,
    assignments: Sequence[str] | None = None,
    *,
    figure: FigureOptions = FigureOptions(),
    out: Path | None = None,
    progress: Progress | None = None,
) -> Outcome[DesignReadings]:
    """Readings of a design over its motion, traced in power."""
    check_outputs(out, figure)
    readings = design_readings(Sensor.of(open_design(path, assignments)), progress)
    readings = replace(readings, sources=(provenance_of(path),))
    return write(readings, "readout", out, figure=figure)
