"""Checks of a design, and its lens with the profile as a table."""

from collections.abc import Sequence
from pathlib import Path

from solen.pipeline.design.designs import open_design
from solen.pipeline.outputs import write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Check, LensCheck, LensOptions, Sensor, lens_check
from solen.sensor import check as check_sensor
from solen.trace.described import SceneCheck, open_scene, scene_check


def check(path: Path, assignments: Sequence[str] | None = None) -> Outcome[Check]:
    """Check that a design can be built at every angle of its motion, and what follows from it."""
    return Outcome(check_sensor(Sensor.of(open_design(path, assignments))))


def check_scene(path: Path) -> Outcome[SceneCheck]:
    """Check that a scene's file, solen's own or one of ray-optics, can be traced."""
    return Outcome(scene_check(open_scene(path, facets=True)))


def lens(
    path: Path,
    assignments: Sequence[str] | None = None,
    options: LensOptions = LensOptions(),
    *,
    csv: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[LensCheck]:
    """Numbers of a design's lens, its profile as a table of x, z and its figure where they are asked for."""
    figure.check()
    sensor = Sensor.of(open_design(path, assignments))
    table = {"profile": (csv, lambda: sensor.lens.table(options.tolerance_mm).encode())}
    return write(lens_check(sensor), "lens", None, table, figure=figure)
