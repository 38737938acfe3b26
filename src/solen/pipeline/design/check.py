"""Checks of a design, and a description of its lens."""

from pathlib import Path
from typing import Annotated

from solen.pipeline.design.designs import is_scene, open_design
from solen.pipeline.options import FLAT, Force, Set
from solen.pipeline.outputs import check_table, write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Check, LensCheck, LensOptions, Sensor, lens_check
from solen.sensor import check as check_sensor
from solen.sensor.network import NetworkCheck, network_check
from solen.trace.scene_file import SceneCheck, open_scene, scene_check


def check(file: Path, /, *, set_: Set = None) -> Outcome[Check | NetworkCheck | SceneCheck]:
    """Check that a design is valid at all angles or loads, or that a scene can be traced.

    Parameters
    ----------
    file
        The design file, or a scene (.json) of solen or ray-optics.
    """
    if is_scene(file, {"--set": set_ and set_[0]}):
        return Outcome(scene_check(open_scene(file, facets=True)))
    design = open_design(file, set_)
    return Outcome(network_check(design) if design.body.kind == "network" else check_sensor(Sensor.of(design)))


def lens(
    file: Path,
    /,
    *,
    options: Annotated[LensOptions, FLAT] = LensOptions(),
    set_: Set = None,
    csv: Path | None = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    force: Force = False,
) -> Outcome[LensCheck]:
    """Describe the lens of a design: shape, acceptance, magnification, and focus in its material.

    Parameters
    ----------
    file
        The design file.
    csv
        Write the profile as a table of x and z in mm (x, y and z for a lens that varies with height).
    """
    figure.check()
    check_table(csv, "a profile", file, force=force)
    sensor = Sensor.of(open_design(file, set_))
    further = {"profile": (csv, lambda: sensor.lens.table(options.tolerance_mm).encode())}
    return write(lens_check(sensor), "lens", None, further, figure=figure)
