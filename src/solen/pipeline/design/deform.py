"""A soft body under load: its shape and forces at one value, its response over the motion."""

import json
from pathlib import Path
from typing import Annotated

from solen import files
from solen.pipeline.design.designs import open_design
from solen.pipeline.options import FLAT, ProgressBar, Set
from solen.pipeline.outputs import figure_bytes, write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor
from solen.sensor.loaded import Deformation, LoadedStudy, loaded_study
from solen.sensor.loaded import deform as deform_sensor
from solen.spec import Design


def deform(
    file: Path,
    /,
    *,
    at: float | None = None,
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[Deformation]:
    """Show a soft body under load: shape, strain, forces and moments of what holds it.

    Parameters
    ----------
    file
        The design file, with motion.kind = "loaded".
    at
        Value of what its motion drives, in its unit; default: the last of the motion.
    """
    figure.check()
    return write(deform_sensor(Sensor.of(open_design(file, set_)), at), "deform", figure=figure)


def run_loaded(design: Design, out: Path, progress: ProgressBar = None) -> Outcome[LoadedStudy]:
    """Response of a soft sensor over its motion: figures, results.json and results.csv in a folder that exists."""
    from solen.report.design import loaded

    result = loaded_study(Sensor.of(design), progress)
    texts: dict[str, bytes] = {
        f"{name}.svg": figure_bytes(draw, Path(f"{name}.svg"), name, FigureOptions())
        for name, draw in loaded.figures(result).items()
    }
    texts["results.json"] = (json.dumps(result.to_dict(), indent=1, allow_nan=False) + "\n").encode()
    texts["results.csv"] = loaded.csv_table(result).encode()
    files.write_all({out / name: content for name, content in texts.items()})
    return Outcome(
        result, {"results": out / "results.json", **{name[:-4]: out / name for name in texts if name.endswith(".svg")}}
    )
