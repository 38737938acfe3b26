"""The simulation of a design: response, figures, tables and report in a folder."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from solen import files
from solen.pipeline.design.designs import open_design
from solen.pipeline.names import stem_of
from solen.pipeline.options import ProgressBar, Set
from solen.results import Outcome
from solen.sensor import DesignStudy, Sensor, study
from solen.sensor.loaded import LoadedStudy, loaded_study
from solen.sensor.network import NetworkStudy, network_study
from solen.sensor.precompile import precompile

if TYPE_CHECKING:
    from solen.fabricate import SolidFiles

R = TypeVar("R", DesignStudy, LoadedStudy, NetworkStudy)


def run(
    file: Path, /, *, out: Path, set_: Set = None, progress: ProgressBar = None
) -> Outcome[DesignStudy | LoadedStudy | NetworkStudy]:
    """Simulate a design over its range of motion: response with and without lens, figures, tables and report.

    Parameters
    ----------
    file
        The design file.
    out
        Folder for report.html, results.json, results.csv, the figures and the solid (.stl, .3mf); created if missing.
    """
    from solen.fabricate import solid_files
    from solen.report.design import html, loaded, loaded_page, network, network_page, table

    design = open_design(file, set_)
    with files.output_folder(out):
        solid = solid_files(design, stem_of(file))
        if design.motion.kind == "loaded":
            soft = loaded_study(Sensor.of(design), progress)
            drawn = loaded.figures(soft)
            page = loaded_page.html(soft, drawn, solid)
            return _written(soft, out, drawn, page, loaded.csv_table(soft), solid)
        if design.body.kind == "network":
            networked = network_study(design, progress)
            drawn = network.figures(networked)
            page = network_page.html(networked, drawn, solid)
            return _written(networked, out, drawn, page, network.csv_table(networked), solid)
        if design.trace.dimension == "extruded":
            precompile()
        result = study(design, progress, practical=True)
        drawn = html.figures(result)
        return _written(result, out, drawn, html.html(result, drawn, solid), table.csv_table(result), solid)


def _written(result: R, out: Path, drawn: dict[str, str], report: str, csv: str, solid: "SolidFiles") -> Outcome[R]:
    """Write all files of a run, and remove figures of an earlier design."""
    from solen.report.design.html import FIGURES

    texts = {f"{name}.svg": text for name, text in drawn.items()}
    texts["results.json"] = json.dumps(result.to_dict(), indent=1, allow_nan=False) + "\n"
    texts |= {"results.csv": f"{files.SIMULATED}{csv}", "report.html": report}
    contents: dict[Path, files.Content] = {out / name: text.encode("utf-8") for name, text in texts.items()}
    files.write_all(contents | {out / name: content for name, content in solid.contents.items()})
    for name in FIGURES:
        if name not in drawn:
            files.remove(out / f"{name}.svg")
    return Outcome(result, {"report": out / "report.html"})
