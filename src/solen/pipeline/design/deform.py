"""A soft body under load: its shape and forces at one value of the driven quantity."""

from pathlib import Path
from typing import Annotated

from solen.pipeline.design.designs import open_design
from solen.pipeline.options import FLAT, Set
from solen.pipeline.outputs import write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor
from solen.sensor.loaded import Deformation
from solen.sensor.loaded import deform as deform_sensor


def deform(
    file: Path,
    /,
    *,
    at: float | None = None,
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[Deformation]:
    """Show a soft body under load: shape, strain, and forces and moments on its supports.

    Parameters
    ----------
    file
        The design file, with motion.kind = "loaded".
    at
        Value of the quantity that the motion drives, in its unit; default: the last value of the motion.
    """
    figure.check()
    return write(deform_sensor(Sensor.of(open_design(file, set_)), at), "deform", figure=figure)
